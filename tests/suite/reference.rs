//! Where external reference material lies, for tests that need it. Such tests skip themselves, visibly, without it.
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

/// Path of a shared file, or `None` after printing that the test is skipped.
pub fn shared(relative: &str) -> Option<PathBuf> {
    let found = shared_dir().map(|dir| dir.join(relative)).filter(|path| path.exists());
    if found.is_none() {
        eprintln!("SKIPPED: shared file {relative} is not here");
    }
    found
}

/// A Python that can import OpenSim: `CARPUS_PYTHON`, else `python3`; `None` if neither can.
pub fn opensim_python() -> Option<PathBuf> {
    let candidates = std::env::var_os("CARPUS_PYTHON").into_iter().chain([std::ffi::OsString::from("python3")]);
    candidates.map(PathBuf::from).find(|python| {
        let mut check = std::process::Command::new(python);
        check.args(["-c", "import opensim"]).stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
        check.status().is_ok_and(|status| status.success())
    })
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
