//! `carpus emg` through the program: normalized EMG against SciPy, checks of channels, what is refused.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;

/// Largest difference from SciPy, of excitations between 0 and about 1.
const SCIPY_TOLERANCE: f64 = 1e-9;

fn reference() -> Value {
    serde_json::from_str(include_str!("../../fixtures/emg/reference_emg.json")).expect("valid JSON")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
}

fn emg(study: &Path, out: &Path) -> assert_cmd::assert::Assert {
    Command::cargo_bin("carpus").expect("the program").arg("emg").arg(study).arg("--out").arg(out).assert()
}

const TRIALS: &str = "participant,file,contraction,effort_percent,direction,use
P01,mvc_1.csv,mvc,100,flexion,mvc
P01,mvc_2.csv,mvc,100,extension,mvc
P01,trial.csv,isotonic,25,flexion,train
";

/// The study of the reference, with the constants of a case.
fn study(folder: &Path, reference: &Value, settings: &str) -> PathBuf {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/wrist.osim");
    std::fs::copy(model, folder.join("wrist.osim")).unwrap();
    let toml = format!(
        "[study]\nname = \"EMG\"\nmodel = \"wrist.osim\"\n[dynamometer]\ncoordinate = \"flexion\"\n[muscles]\nactive = \
         [\"ECRL\", \"FCR\"]\n[columns]\nemg = {{ ECRL = \"Ch 1\", FCR = \"Ch 2\" }}\n[emg]\n{settings}"
    );
    std::fs::write(folder.join("study.toml"), toml).unwrap();
    std::fs::write(folder.join("participants.csv"), "participant\nP01\n").unwrap();
    std::fs::write(folder.join("trials.csv"), TRIALS).unwrap();
    for (name, channels) in reference["raw"].as_object().unwrap() {
        let (a, b) = (numbers(&channels[0]), numbers(&channels[1]));
        let mut text = "time_s,angle_deg,moment_n_m,Ch 1,Ch 2\n".to_owned();
        for i in 0..a.len() {
            // A moving angle, so that no check complains.
            let t = i as f64 / 1000.0;
            writeln!(text, "{t},{},{},{},{}", 20.0 * (3.0 * t).sin(), 2.0 * (3.0 * t).sin(), a[i], b[i]).unwrap();
        }
        std::fs::write(folder.join(format!("{name}.csv")), text).unwrap();
    }
    folder.join("study.toml")
}

fn settings(case: &Value) -> String {
    let mut text = format!(
        "kind = \"raw\"\nfilter_order = {}\nband_pass_hz = {}\nenvelope = {}\nrms_window_s = {}\nsavitzky_golay = {{ \
         order = {}, window_s = {} }}\n",
        case["filter_order"],
        case["band_pass_hz"],
        case["envelope"],
        case["rms_window_s"],
        case["savitzky_golay"]["order"],
        case["savitzky_golay"]["window_s"]
    );
    for key in ["mvc_window_s", "resample_hz"] {
        if let Some(value) = case[key].as_f64() {
            writeln!(text, "{key} = {value}").unwrap();
        }
    }
    text
}

#[test]
fn val_scipy_normalized_emg_through_the_program() {
    let reference = reference();
    for (number, case) in reference["cases"].as_array().unwrap().iter().enumerate() {
        let folder = tempfile::tempdir().unwrap();
        // The first case is what a study gets that sets nothing.
        let settings = if number == 0 { "kind = \"raw\"\n".to_owned() } else { settings(case) };
        let study = study(folder.path(), &reference, &settings);
        let out = folder.path().join("out");
        emg(&study, &out).success();
        let results: Value = serde_json::from_str(&std::fs::read_to_string(out.join("emg.json")).unwrap()).unwrap();
        for (channel, level) in numbers(&case["levels"]).iter().enumerate() {
            let found = &results["participants"][0]["channels"][channel];
            let difference = (found["mvc_level"].as_f64().unwrap() - level).abs() / level;
            assert!(difference < SCIPY_TOLERANCE, "{found}: {level}");
            assert_eq!(found["mvc_trial"], ["mvc_1", "mvc_2"][channel]);
        }
        let mut worst = 0.0f64;
        for (trial, channels) in case["normalized"].as_object().unwrap() {
            let mut reader = csv::Reader::from_path(out.join(format!("P01/emg/{trial}.csv"))).unwrap();
            assert_eq!(reader.headers().unwrap(), vec!["time_s", "emg_ECRL", "emg_FCR"]);
            let rows: Vec<Vec<f64>> = reader.deserialize().map(|row| row.unwrap()).collect();
            let every = case["every"].as_u64().unwrap() as usize;
            for channel in 0..2 {
                let theirs = numbers(&channels[channel]);
                let ours: Vec<f64> = rows.iter().step_by(every).map(|row| row[channel + 1]).collect();
                assert_eq!(ours.len(), theirs.len(), "case {number}, {trial}");
                for (a, b) in ours.iter().zip(&theirs) {
                    worst = worst.max((a - b).abs());
                }
            }
        }
        println!("case {number}: largest difference from SciPy {worst:e}");
        assert!(worst < SCIPY_TOLERANCE, "case {number}: {worst:e}");
        let page = std::fs::read_to_string(out.join("P01/report.html")).unwrap();
        assert!(page.contains("Ch 1") && page.contains("Butterworth of order") && page.contains("<polyline"));
    }
}

#[test]
fn verif_findings_of_channels_reach_the_report() {
    let mut reference = reference();
    // The amplifier ends at ±0.3, and the trial is stronger than any MVC in the other channel.
    let clipped: Vec<f64> = numbers(&reference["raw"]["trial"][0]).iter().map(|v| v.clamp(-0.3, 0.3)).collect();
    let strong: Vec<f64> = numbers(&reference["raw"]["trial"][1]).iter().map(|v| 6.0 * v).collect();
    reference["raw"]["trial"] = serde_json::json!([clipped, strong]);
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), &reference, "kind = \"raw\"\n");
    let out = folder.path().join("out");
    emg(&study, &out).success();
    let page = std::fs::read_to_string(out.join("P01/report.html")).unwrap();
    assert!(page.contains("clipped") && page.contains("above MVC"), "findings on the page");
    let results: Value = serde_json::from_str(&std::fs::read_to_string(out.join("emg.json")).unwrap()).unwrap();
    let trial = &results["participants"][0]["trials"][2];
    assert!(trial["channels"][1]["highest"].as_f64().unwrap() > 1.05, "{trial}");
}

/// Recordings that need processing are processed by `carpus study` before all else; what it did stands in its report.
#[test]
fn verif_raw_recordings_are_steps_of_a_study() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), &reference(), "kind = \"raw\"\n[processing]\nfilter_hz = 6\n");
    let run = |out: &str, steps: &str| {
        let mut command = Command::cargo_bin("carpus").unwrap();
        command.current_dir(folder.path()).arg("study").arg(&study).args(["--out", out, "--steps", steps]);
        let done = command.assert().success();
        String::from_utf8(done.get_output().stdout.clone()).unwrap()
    };
    run("all", "dynamometer,emg,ultrasound");
    let read = |file: &str| std::fs::read_to_string(folder.path().join(file)).unwrap();
    let page = read("all/report.html");
    for words in
        ["low-pass 6 Hz", "Channels and their level", "Butterworth of order", "Not run: the study has no ultrasound"]
    {
        assert!(page.contains(words), "{words}");
    }
    assert_eq!(read("all/dynamometer_trials.csv").lines().count(), 4);
    let channels = read("all/emg_channels.csv");
    assert!(channels.lines().nth(1).unwrap().starts_with("P01,Ch 1,mvc_1,"), "{channels}");
    assert!(read("all/emg/P01/report.html").contains("<polyline"));
    assert!(read("all/processed/reports/P01.html").contains("<polyline"));
    // The same as the two commands one after the other.
    emg(&folder.path().join("all/processed/study.toml"), &folder.path().join("apart")).success();
    assert_eq!(read("all/emg/P01/emg/trial.csv"), read("apart/P01/emg/trial.csv"));
    // Done again, nothing is computed and nothing changes.
    let again = run("all", "dynamometer,emg,ultrasound");
    assert!(again.contains("1 units were finished before, 0 were computed"), "{again}");
    assert_eq!(page, read("all/report.html"));
}

#[test]
fn verif_bad_emg_is_explained() {
    let refused = |settings: &str, words: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        let study = study(folder.path(), &reference(), settings);
        let failed = emg(&study, &folder.path().join("out")).code(1);
        let text = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        for word in words {
            assert!(text.contains(word), "expected `{word}` in:\n{text}");
        }
    };
    refused("kind = \"normalized\"\n", &["normalized already", "kind = \"raw\""]);
    refused("kind = \"raw\"\nresample_hz = -1\n", &["study.toml:", "resample_hz", "positive rate"]);
    refused("kind = \"raw\"\nresample_hz = 1e-9\n", &["resample_hz", "10 to 100000"]);
    refused("kind = \"raw\"\nband_pass_hz = [1e-300, 250]\n", &["band_pass_hz", "1 ≤ lower"]);
    refused("kind = \"raw\"\nrms_window_s = 1e-12\n", &["rms_window_s", "0.001 to 10"]);
    refused("kind = \"raw\"\nband_pass_hz = [30, 600]\n", &["Ch 1", "600"]);
    refused("kind = \"raw\"\nresample = 100\n", &["unknown", "`resample`", "resample_hz"]);
}
