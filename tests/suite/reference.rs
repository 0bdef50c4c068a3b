//! Where external reference material lies, for tests that need it.
//!
//! Such tests are ignored unless the build script (`build.rs`) has found it. Whoever runs them all the same
//! (`--include-ignored`) is told what is missing: none passes without it.
#![allow(dead_code)]

use std::path::PathBuf;

/// Folder of shared lab models and data: `CARPUS_SHARED`, else `../shared` beside the checkout (or beside the
/// checkout's parent, for worktrees); `None` if absent.
pub fn shared_dir() -> Option<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    std::env::var_os("CARPUS_SHARED")
        .map(PathBuf::from)
        .into_iter()
        .chain([root.join("../shared"), root.join("../../shared")])
        .find(|dir| dir.join("models").is_dir())
}

/// Folders of models to compare on: those of `CARPUS_MODELS` (a list like `PATH`), else the shared models.
pub fn model_folders() -> Vec<PathBuf> {
    match std::env::var_os("CARPUS_MODELS") {
        Some(folders) => std::env::split_paths(&folders).collect(),
        None => shared_dir().map(|dir| dir.join("models")).into_iter().collect(),
    }
}

/// All models to compare on: at least one.
pub fn lab_models() -> Vec<PathBuf> {
    let models = lab_models_if_here();
    assert!(
        !models.is_empty(),
        "no lab models here: name their folder in CARPUS_MODELS, or its parent in CARPUS_SHARED"
    );
    models
}

/// All models to compare on; none where there are none.
pub fn lab_models_if_here() -> Vec<PathBuf> {
    model_folders().iter().flat_map(|folder| osim_files(folder)).collect()
}

/// Name of a model's file without ending.
pub fn stem(model: &std::path::Path) -> String {
    model.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// First digits of a file's SHA-256, to see whether what was made from it is still valid.
pub fn digest(path: &std::path::Path) -> String {
    use sha2::Digest;
    let bytes = std::fs::read(path).expect("readable file");
    sha2::Sha256::digest(bytes).iter().take(8).map(|byte| format!("{byte:02x}")).collect()
}

/// Path of a shared file. Models are looked for in `CARPUS_MODELS`.
pub fn shared(relative: &str) -> PathBuf {
    shared_if_here(relative).unwrap_or_else(|| panic!("{relative} is not here: name its folder in CARPUS_SHARED"))
}

/// As [`shared`]; `None` where it is not here.
pub fn shared_if_here(relative: &str) -> Option<PathBuf> {
    match relative.strip_prefix("models/") {
        Some(name) => model_folders().into_iter().map(|folder| folder.join(name)).find(|path| path.exists()),
        None => shared_dir().map(|dir| dir.join(relative)).filter(|path| path.exists()),
    }
}

/// A Python that can import OpenSim: `CARPUS_PYTHON`, else `python3`.
pub fn opensim_python() -> PathBuf {
    let candidates = std::env::var_os("CARPUS_PYTHON").into_iter().chain([std::ffi::OsString::from("python3")]);
    let mut candidates = candidates.map(PathBuf::from);
    let found = candidates.find(|python| {
        let mut check = std::process::Command::new(python);
        check.args(["-c", "import opensim"]).stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
        check.status().is_ok_and(|status| status.success())
    });
    found.expect("a Python that can import opensim: name it in CARPUS_PYTHON")
}

/// Runs a script of `fixtures/` with the Python that has OpenSim.
pub fn run_script(python: &std::path::Path, script: &str, arguments: &[&std::ffi::OsStr]) {
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(script);
    let output = std::process::Command::new(python).arg(&script).args(arguments).output().expect("Python starts");
    assert!(output.status.success(), "{} failed: {}", script.display(), String::from_utf8_lossy(&output.stderr));
}

/// All `.osim` files in a folder, sorted by name.
pub fn osim_files(dir: &std::path::Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(dir).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "osim"))
        .collect();
    paths.sort();
    paths
}
