//! Where nobody listens: standard output and standard error that are closed, or full. Results are written, and the exit
//! code is right.
#![cfg(unix)]

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn carpus(arguments: &[&str]) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin("carpus"));
    command.args(arguments).env_remove("RAYON_NUM_THREADS").stdin(Stdio::null());
    command
}

/// A pipe of which the reader has gone.
fn deaf() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

/// A disk that is full.
fn full() -> Stdio {
    std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap().into()
}

/// A model with warnings: a class that is not known.
fn warned_model(folder: &Path) -> String {
    let text = std::fs::read_to_string(root("models/wrist.osim")).unwrap();
    let odd = text.replacen("<ForceSet", "<NoClassOfOpenSim name=\"odd\"/>\n<ForceSet", 1);
    assert_ne!(text, odd);
    let file = folder.join("odd.osim");
    std::fs::write(&file, odd).unwrap();
    file.display().to_string()
}

#[test]
fn verif_results_are_written_where_nobody_reads_messages() {
    let folder = tempfile::tempdir().unwrap();
    let model = warned_model(folder.path());
    for (i, stream) in [deaf as fn() -> Stdio, full].into_iter().enumerate() {
        let out = folder.path().join(format!("out_{i}"));
        let out_text = out.display().to_string();
        let sweep = ["paths", &model, "--sweep", "flexion=-20:20:10deg", "--allow-unsupported", "--out", &out_text];
        let status = carpus(&sweep).stdout(Stdio::null()).stderr(stream()).status().unwrap();
        assert_eq!(status.code(), Some(0), "stream {i}");
        assert_eq!(std::fs::read_to_string(out.join("paths.csv")).unwrap().lines().count(), 6);
        // A note before any work, and errors.
        let status =
            carpus(&["effects", "--threads", "100000"]).stdout(Stdio::null()).stderr(stream()).status().unwrap();
        assert_eq!(status.code(), Some(0), "stream {i}");
        let status = carpus(&["info", "/nowhere.osim"]).stdout(Stdio::null()).stderr(stream()).status().unwrap();
        assert_eq!(status.code(), Some(1), "stream {i}");
        let status = carpus(&["no-such-command"]).stdout(Stdio::null()).stderr(stream()).status().unwrap();
        assert_eq!(status.code(), Some(1), "stream {i}");
        let status = carpus(&["simulate", "/nowhere", "--out", &out_text])
            .stdout(Stdio::null())
            .stderr(stream())
            .status()
            .unwrap();
        assert_eq!(status.code(), Some(1), "stream {i}");
    }
    // With somebody there, the warning is there, too.
    let out = folder.path().join("out").display().to_string();
    let sweep = ["paths", &model, "--sweep", "flexion=-20:20:10deg", "--allow-unsupported", "--out", &out];
    let shown = carpus(&sweep).output().unwrap();
    assert!(String::from_utf8_lossy(&shown.stderr).contains("warning"), "{shown:?}");
}

#[test]
fn verif_a_reader_that_has_gone_changes_no_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let out_text = out.display().to_string();
    let model = root("models/wrist.osim").display().to_string();
    let sweep = ["paths", &model, "--sweep", "flexion=-20:20:10deg", "--out", &out_text];
    let status = carpus(&sweep).stdout(deaf()).stderr(deaf()).status().unwrap();
    assert_eq!(status.code(), Some(0));
    assert!(out.join("paths.csv").is_file() && out.join("paths.html").is_file());
    // A model that can be read and not computed with is an error, whether its description is read or not.
    let broken = folder.path().join("broken.osim");
    let coupler = |name: &str, independent: &str, dependent: &str| {
        format!(
            "<CoordinateCouplerConstraint name=\"{name}\">\
             <coupled_coordinates_function><LinearFunction><coefficients>1 0</coefficients></LinearFunction>\
             </coupled_coordinates_function>\
             <independent_coordinate_names>{independent}</independent_coordinate_names>\
             <dependent_coordinate_name>{dependent}</dependent_coordinate_name></CoordinateCouplerConstraint>"
        )
    };
    let circle = coupler("a", "flexion", "deviation") + &coupler("b", "deviation", "flexion");
    let set = format!("<ConstraintSet><objects>{circle}</objects></ConstraintSet><ForceSet");
    let text = std::fs::read_to_string(&model).unwrap();
    std::fs::write(&broken, text.replacen("<ForceSet", &set, 1)).unwrap();
    let broken = broken.display().to_string();
    let read = carpus(&["info", &broken]).output().unwrap();
    let gone = carpus(&["info", &broken]).stdout(deaf()).output().unwrap();
    assert!(!read.stdout.is_empty());
    assert_eq!((read.status.code(), gone.status.code()), (Some(1), Some(1)));
    // A full disk loses the result: that is said.
    let lost = carpus(&["info", &model]).stdout(full()).output().unwrap();
    assert_eq!(lost.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&lost.stderr).contains("cannot write to standard output"), "{lost:?}");
    let status = carpus(&["info", &model]).stdout(full()).stderr(full()).status().unwrap();
    assert_eq!(status.code(), Some(1));
    for asked in ["--help", "--version"] {
        let lost = carpus(&[asked]).stdout(full()).output().unwrap();
        assert!(lost.status.code() == Some(1) && String::from_utf8_lossy(&lost.stderr).contains("standard output"));
        assert!(carpus(&[asked]).stdout(deaf()).output().unwrap().status.success());
    }
}

#[test]
fn verif_threads_are_bound_by_cores_with_a_note() {
    let cores = std::thread::available_parallelism().unwrap().get();
    let note = format!("there are {cores} cores; {cores} threads are started");
    let asked = carpus(&["effects", "--threads", "100000"]).output().unwrap();
    let said = String::from_utf8_lossy(&asked.stderr).into_owned();
    assert!(asked.status.success() && said.contains(&format!("--threads 100000: {note}")), "{said}");
    let by_variable = carpus(&["effects"]).env("RAYON_NUM_THREADS", "100000").output().unwrap();
    let said = String::from_utf8_lossy(&by_variable.stderr).into_owned();
    assert!(by_variable.status.success() && said.contains(&format!("RAYON_NUM_THREADS 100000: {note}")), "{said}");
    let one = carpus(&["effects", "--threads", "1"]).output().unwrap();
    assert!(one.status.success() && one.stderr.is_empty() && one.stdout == carpus_output(&["effects"]));
}

fn carpus_output(arguments: &[&str]) -> Vec<u8> {
    let mut child = carpus(arguments).stdout(Stdio::piped()).spawn().unwrap();
    let mut text = Vec::new();
    child.stdout.take().unwrap().read_to_end(&mut text).unwrap();
    assert!(child.wait().unwrap().success());
    text
}
