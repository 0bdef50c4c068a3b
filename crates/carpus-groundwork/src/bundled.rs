//! The bundled study: a part of the program, so that it is there wherever that runs.

use std::path::Path;

use super::diagnostic::Failure;
use super::output::OutputFolder;
use carpus_osim::osim::OsimFile;

/// Name and content of every file of the bundled study.
macro_rules! bundled {
    ($($name:literal)*) => { [$(($name, include_str!(concat!("../bundled/", $name)))),*] };
}

/// The bundled study.
const STUDY: [(&str, &str); 31] = bundled!(
    "study.toml" "participants.csv" "trials.csv"
    "data/P01/mvc_flexion.csv" "data/P01/mvc_extension.csv"
    "data/P01/isometric_25_flexion_-30deg_1.csv" "data/P01/isometric_25_flexion_+0deg_1.csv"
    "data/P01/isometric_25_flexion_+30deg_1.csv" "data/P01/isometric_25_flexion_+0deg_2.csv"
    "data/P01/isometric_25_extension_-30deg_1.csv" "data/P01/isometric_25_extension_+0deg_1.csv"
    "data/P01/isometric_25_extension_+30deg_1.csv" "data/P01/isometric_25_extension_+30deg_2.csv"
    "data/P01/isometric_50_flexion_-30deg_1.csv" "data/P01/isometric_50_flexion_+0deg_1.csv"
    "data/P01/isometric_50_flexion_+30deg_1.csv" "data/P01/isometric_50_flexion_-30deg_2.csv"
    "data/P01/isometric_50_extension_-30deg_1.csv" "data/P01/isometric_50_extension_+0deg_1.csv"
    "data/P01/isometric_50_extension_+30deg_1.csv" "data/P01/isometric_50_extension_+0deg_2.csv"
    "data/P01/isotonic_25_flexion_1.csv" "data/P01/isotonic_25_flexion_2.csv"
    "data/P01/isotonic_25_extension_1.csv" "data/P01/isotonic_25_extension_2.csv"
    "data/P01/isotonic_50_flexion_1.csv" "data/P01/isotonic_50_flexion_2.csv"
    "data/P01/isotonic_50_extension_1.csv" "data/P01/isotonic_50_extension_2.csv"
    "data/P01/passive_1.csv" "data/P01/passive_2.csv"
);
/// The bundled model.
const MODEL: &str = include_str!("../bundled/wrist.osim");

/// The bundled model: a wrist with the five muscles that move it.
///
/// # Errors
/// A fault of this program.
pub fn model() -> Result<OsimFile, Failure> {
    OsimFile::parse(MODEL, "wrist.osim").map_err(|e| Failure::Internal(e.to_string()))
}

/// Writes the bundled study with its model to `study` in a folder.
///
/// # Errors
/// The disk.
pub fn write_study(folder: &OutputFolder) -> Result<(), Failure> {
    for (name, text) in STUDY {
        folder.write(Path::new("study").join(name), text.as_bytes())?;
    }
    folder.write("study/wrist.osim", MODEL.as_bytes())?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The package holds copies of its own, because a package cannot hold files from outside of it.
    #[test]
    fn verif_bundle_is_the_demo_study_and_its_model() {
        let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let there = |path: String| std::fs::read_to_string(root.join(path)).unwrap();
        assert_eq!(MODEL, there("models/wrist.osim".to_owned()));
        for (name, text) in STUDY {
            let original = there(format!("fixtures/demo_study/{name}"));
            let original = original.replace("model = \"../../models/wrist.osim\"", "model = \"wrist.osim\"");
            assert!(text == original, "crates/carpus-groundwork/bundled/{name} is not that of fixtures/demo_study");
        }
        let trials = STUDY.iter().find(|(name, _)| *name == "trials.csv").unwrap().1;
        let listed: Vec<&str> = trials.lines().skip(1).filter_map(|l| l.split(',').nth(1)).collect();
        let bundled: Vec<&str> = STUDY.iter().map(|(name, _)| *name).filter(|n| n.starts_with("data/")).collect();
        assert_eq!(bundled, listed);
    }
}
