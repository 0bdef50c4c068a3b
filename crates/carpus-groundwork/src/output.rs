//! The folder that a command writes into, and what says who made the files in it.

mod claim;
mod ending;
mod folder;
mod manifest;

use std::path::PathBuf;

pub use ending::Leftovers;
pub use folder::OutputFolder;

/// Paths as they are shown.
pub fn shown(files: &[PathBuf]) -> Vec<String> {
    files.iter().map(|file| file.display().to_string()).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::manifest::{MANIFEST, Manifest};
    use super::*;
    use crate::diagnostic::{Diagnostic, Failure};
    use crate::provenance::hash_of;

    #[test]
    fn verif_inputs_are_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("model.osim");
        std::fs::write(&model, "mine").unwrap();
        let out = OutputFolder::create(folder.path(), std::slice::from_ref(&model)).unwrap();
        assert!(matches!(out.write("model.osim", b"theirs"), Err(Failure::Input(_))));
        assert_eq!(std::fs::read_to_string(&model).unwrap(), "mine");
        out.write("results.json", "{\"model\": \"a\u{202e}b\"}".as_bytes()).unwrap();
        let json = std::fs::read_to_string(folder.path().join("results.json")).unwrap();
        assert_eq!(json, "{\"model\": \"a\\u202eb\"}", "what is not shown is written out");
        std::fs::remove_file(folder.path().join("results.json")).unwrap();
        out.write("a/b/other.txt", b"text").unwrap();
        assert_eq!(std::fs::read_to_string(folder.path().join("a/b/other.txt")).unwrap(), "text");
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 2, "no temporary file stays behind");
    }

    /// A run of a command that writes these files.
    fn run(folder: &Path, study: &Path, command: &str, others: &[&str], files: &[&str]) -> Vec<Diagnostic> {
        let out = OutputFolder::create(folder, &[]).unwrap().claimed_for("s", study, command).unwrap();
        files.iter().for_each(|file| drop(out.write(file, file.as_bytes()).unwrap()));
        out.close(command, others).unwrap()
    }

    #[test]
    fn verif_a_run_leaves_nothing_of_the_run_before_that_is_not_its_own() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        let there = |file: &str| folder.join(file).exists();
        let first = ["P01/series/a.csv", "P01/series/b/c.csv", "P01/mine.osim", "P02/series/a.csv", "all.csv"];
        assert!(run(&folder, &study, "simulate", &[], &first).is_empty());
        std::fs::write(folder.join("P01/mine.osim"), "changed by hand").unwrap();
        std::fs::write(folder.join("P01/notes.txt"), "not of this program").unwrap();
        let said = run(&folder, &study, "simulate", &["P02"], &["P01/series/a.csv"]);
        assert_eq!(said.len(), 2);
        assert!(said[0].text.contains("P01/series/b/c.csv") && said[0].text.contains("all.csv"), "{}", said[0].text);
        assert!(said[1].text.contains("P01/mine.osim"), "{}", said[1].text);
        assert!(!there("P01/series/b") && !there("all.csv"), "folders left empty go, too");
        for kept in ["P01/series/a.csv", "P01/mine.osim", "P01/notes.txt", "P02/series/a.csv"] {
            assert!(there(kept), "{kept}");
        }
        assert!(run(&folder, &study, "simulate", &[], &["P01/series/a.csv"])[0].text.contains("P02/series/a.csv"));
    }

    #[test]
    fn verif_what_a_run_that_failed_left_goes_with_the_next() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        let out = OutputFolder::create(&folder, &[]).unwrap().claimed_for("s", &study, "simulate").unwrap();
        out.write("P01/a.csv", b"a").unwrap();
        drop(out);
        assert_eq!(run(&folder, &study, "simulate", &[], &["P01/b.csv"]).len(), 1);
        assert!(!folder.join("P01/a.csv").exists() && folder.join("P01/b.csv").exists());
    }

    #[test]
    fn verif_a_folder_with_results_of_another_study_is_refused() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        let [one, other] = ["one.toml", "other.toml"].map(|name| place.path().join(name));
        std::fs::write(&one, "").unwrap();
        std::fs::write(&other, "").unwrap();
        run(&folder, &one, "simulate", &[], &["a.csv", "study.toml"]);
        let claim =
            |name: &str, study: &Path| OutputFolder::create(&folder, &[]).unwrap().claimed_for(name, study, "simulate");
        assert!(matches!(claim("s", &other), Err(Failure::Input(m)) if m[0].text.contains("another study")));
        assert!(claim("s", &folder.join("study.toml")).is_ok(), "a study that was made here");
        std::fs::remove_file(&one).unwrap();
        assert!(claim("s", &other).is_ok(), "the study was moved");
        assert!(claim("t", &other).is_err());
        std::fs::remove_file(folder.join("a.csv")).unwrap();
        std::fs::remove_file(folder.join("study.toml")).unwrap();
        assert!(claim("t", &other).is_ok(), "nothing is left of it");
    }

    /// A run of a command that makes these files from a source.
    fn run_from(folder: &Path, source: &Path, command: &str, files: &[&str], leftovers: Leftovers) -> Vec<Diagnostic> {
        let out = OutputFolder::create(folder, &[]).unwrap().with_results_of(source);
        files.iter().for_each(|file| drop(out.write(file, file.as_bytes()).unwrap()));
        out.close_with(command, &[], leftovers).unwrap()
    }

    #[test]
    fn verif_results_of_no_study_say_what_they_are_made_from() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        let [a, b] = ["a.c3d", "b.c3d"].map(|name| place.path().join(name));
        [&study, &a, &b].into_iter().for_each(|file| std::fs::write(file, "").unwrap());
        let there = |file: &str| folder.join(file).exists();
        run_from(&folder, &a, "c3d", &["a.trc", "a.csv"], Leftovers::Remove);
        run_from(&folder, &b, "c3d", &["b.trc"], Leftovers::Remove);
        assert!(there("a.trc") && there("a.csv"), "what is made from another file stays");
        let said = run_from(&folder, &a, "c3d", &["a.trc"], Leftovers::Remove);
        assert!(said.len() == 1 && said[0].text.contains("a.csv") && !there("a.csv"), "{said:?}");
        let manifest = Manifest::read(&folder.join(MANIFEST)).unwrap();
        assert_eq!(manifest.files.keys().collect::<Vec<_>>(), ["a.trc", "b.trc"]);
        assert_eq!(manifest.files["b.trc"].source.as_deref(), b.canonicalize().ok().as_deref());
        // OpenSim's tools leave what is there; it is said.
        run_from(&folder, &a, "run-tool", &["x.sto", "y.sto"], Leftovers::Name);
        let said = run_from(&folder, &a, "run-tool", &["x.sto"], Leftovers::Name);
        assert!(said.len() == 1 && said[0].text.contains("left here: y.sto") && there("y.sto"), "{said:?}");
        // What is there and is not of this program stays, unless the tool is one of OpenSim's.
        std::fs::write(folder.join("b.csv"), "mine").unwrap();
        let out = OutputFolder::create(&folder, &[]).unwrap().with_results_of(&b);
        assert!(matches!(out.write("b.csv", b""), Err(Failure::Input(m)) if m[0].text.contains("did not make")));
        assert_eq!(std::fs::read_to_string(folder.join("b.csv")).unwrap(), "mine");
        OutputFolder::create(&folder, &[]).unwrap().overwriting_with_results_of(&b).write("b.csv", b"").unwrap();
        // A study does not take the folder, and its own results are not overwritten by such.
        let taken = OutputFolder::create(&folder, &[]).unwrap().claimed_for("s", &study, "simulate");
        assert!(matches!(taken, Err(Failure::Input(m)) if m[0].text.contains("holds results of c3d")));
        let folder = place.path().join("of_study");
        run(&folder, &study, "simulate", &[], &["all.csv"]);
        let out = OutputFolder::create(&folder, &[]).unwrap().with_results_of(&a);
        assert!(matches!(out.write("all.csv", b""), Err(Failure::Input(m)) if m[0].text.contains("of study `s`")));
    }

    #[test]
    fn verif_a_folder_with_what_is_not_of_the_command_is_refused() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        let claim = |folder: &Path, command: &str| {
            let inputs = [folder.join("study.toml")];
            OutputFolder::create(folder, &inputs).unwrap().claimed_for("s", &study, command).map_err(|e| match e {
                Failure::Input(messages) => messages[0].text.clone(),
                other => format!("{other:?}"),
            })
        };
        run(&folder, &study, "study --steps", &[], &["P01/models/a.osim", "all.csv"]);
        let said = claim(&folder, "compare").unwrap_err();
        assert_eq!(said, "holds results of study --steps, not of compare: P01/models/a.osim, all.csv");
        assert!(claim(&folder, "study").is_ok(), "the same command with other words");
        let diagnosed = place.path().join("diagnosed");
        run(&diagnosed, &study, "diagnose", &[], &["P01/diagnosis.json"]);
        assert!(claim(&diagnosed, "effect").is_ok() && claim(&diagnosed, "plan --effect").is_ok());
        assert!(claim(&diagnosed, "personalize").is_err());
        // Files of another hand; but not what is read, what the system puts there, or a folder that says itself what it
        // holds.
        let foreign = place.path().join("foreign");
        std::fs::create_dir_all(foreign.join("deep/processed")).unwrap();
        run(&foreign.join("deep/processed"), &study, "dynamometer", &[], &["study.toml"]);
        for file in ["study.toml", ".DS_Store", "desktop.ini"] {
            std::fs::write(foreign.join(file), "").unwrap();
        }
        assert!(claim(&foreign, "compare").is_ok());
        std::fs::write(foreign.join("deep/old.csv"), "").unwrap();
        assert_eq!(claim(&foreign, "compare").unwrap_err(), "holds files that are not of compare: deep/old.csv");
        // A run that was killed could not say what it wrote, but did say who it was.
        let killed = place.path().join("killed");
        let out = claim(&killed, "personalize").unwrap();
        out.write("P01/model.osim", b"half").unwrap();
        std::mem::forget(out);
        assert!(claim(&killed, "personalize").is_ok());
        assert!(claim(&killed, "compare").unwrap_err().contains("a run of personalize left that did not end"));
        run(&killed, &study, "personalize", &[], &["P01/model.osim"]);
        assert!(Manifest::read(&killed.join(MANIFEST)).unwrap().begun.is_none());
    }

    #[test]
    fn verif_a_manifest_knows_what_a_later_command_changed() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        run(&folder, &study, "effect", &[], &["P01/results.json", "P01/model.osim", "P01/effects.toml"]);
        let (out, inside) = OutputFolder::of_earlier_run(&folder.join("P01"), "results.json").unwrap();
        assert_eq!((out.path(), inside.as_path()), (folder.as_path(), Path::new("P01")));
        out.write(inside.join("model.osim"), b"another").unwrap();
        std::fs::remove_file(folder.join("P01/effects.toml")).unwrap();
        out.close_changed("effect remove").unwrap();
        drop(out);
        let manifest = Manifest::read(&folder.join(MANIFEST)).unwrap();
        assert_eq!(manifest.files.keys().collect::<Vec<_>>(), ["P01/model.osim", "P01/results.json"]);
        assert_eq!(manifest.files["P01/model.osim"].sha256, hash_of(b"another"));
        // So that the next run knows it as this program's.
        let said = run(&folder, &study, "effect", &[], &["P01/results.json"]);
        assert!(said.len() == 1 && said[0].text.contains("removed"), "{said:?}");
        assert!(!folder.join("P01/model.osim").exists());
    }

    #[test]
    fn verif_a_manifest_cannot_name_files_elsewhere() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "mine").unwrap();
        run(&folder, &study, "simulate", &[], &["a.csv"]);
        let file = folder.join(MANIFEST);
        let manifest = std::fs::read_to_string(&file).unwrap();
        let hostile =
            manifest.replace("\"a.csv\": {", "\"../study.toml\": {").replace(&hash_of(b"a.csv"), &hash_of(b"mine"));
        assert_ne!(manifest, hostile);
        std::fs::write(&file, hostile).unwrap();
        assert!(run(&folder, &study, "simulate", &[], &["b.csv"]).is_empty());
        assert_eq!(std::fs::read_to_string(&study).unwrap(), "mine");
    }

    #[test]
    fn verif_a_file_in_place_of_the_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("results");
        std::fs::write(&file, "").unwrap();
        assert!(matches!(OutputFolder::create(&file, &[]), Err(Failure::Input(_))));
        assert!(matches!(OutputFolder::create(&file.join("below"), &[]), Err(Failure::Input(_))));
    }
}
