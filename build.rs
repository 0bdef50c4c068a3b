//! Tells tests what this machine has, so that those that need more are shown as ignored: OpenSim, models, a folder
//! to keep OpenSim's numbers in, a generated study. The library and the program do not depend on it.

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What is looked for, and the variables that say where.
const LOOKED_FOR: [&str; 6] = [
    "CARPUS_PYTHON",
    "CARPUS_SHARED",
    "CARPUS_MODELS",
    "CARPUS_VALIDATION_DIR",
    "CARPUS_GENERATED_STUDY",
    "CARPUS_CHROMIUM",
];

/// Models that some tests are about.
const LAB_MODELS: [&str; 3] = ["Hand_Wrist_Model_for_development.osim", "MOBL_ARMS_41.osim", "MOBL_ARMS_fixed_41.osim"];

fn main() {
    let shared = shared_folder();
    let models = models(shared.as_deref());
    println!("cargo::rerun-if-changed=build.rs");
    LOOKED_FOR.iter().for_each(|name| println!("cargo::rerun-if-env-changed={name}"));
    for (name, is_here) in [
        ("has_opensim", has_opensim()),
        ("has_models", !models.is_empty()),
        ("has_lab_models", LAB_MODELS.iter().all(|name| models.iter().any(|model| model.ends_with(name)))),
        ("has_shared_data", shared.is_some_and(|folder| folder.join("data").is_dir())),
        ("has_validation_dir", env::var_os("CARPUS_VALIDATION_DIR").is_some()),
        ("has_browser", has_browser()),
        ("has_generated_study", env::var_os("CARPUS_GENERATED_STUDY").is_some()),
    ] {
        println!("cargo::rustc-check-cfg=cfg({name})");
        if is_here {
            println!("cargo::rustc-cfg={name}");
        }
    }
}

/// Whether `CARPUS_PYTHON`, else `python3`, finds the package `opensim`. It is not loaded, which would take seconds.
fn has_opensim() -> bool {
    let python = env::var_os("CARPUS_PYTHON").unwrap_or_else(|| "python3".into());
    let find = "import importlib.util, sys; sys.exit(importlib.util.find_spec('opensim') is None)";
    let silent = Command::new(python).args(["-c", find]).stdout(Stdio::null()).stderr(Stdio::null()).status();
    silent.is_ok_and(|status| status.success())
}

/// Whether `CARPUS_CHROMIUM`, else Debian's, is there, with Node and the packages that open reports in it.
fn has_browser() -> bool {
    let chromium = env::var_os("CARPUS_CHROMIUM").unwrap_or_else(|| "/usr/bin/chromium".into());
    let page = Path::new("crates/carpus-web/page");
    let packages = page.join("node_modules/playwright-core");
    // What is watched has to be there, or the script would run each time.
    let watched = if packages.is_dir() { packages.as_path() } else { page };
    println!("cargo::rerun-if-changed={}", watched.display());
    let node = Command::new("node").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    let has_node = node.is_ok_and(|status| status.success());
    has_node && Path::new(&chromium).exists() && packages.is_dir()
}

/// The folder of shared models and recordings, where `tests/suite/reference.rs` looks for it.
fn shared_folder() -> Option<PathBuf> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let named = env::var_os("CARPUS_SHARED").map(PathBuf::from);
    let mut folders = named.into_iter().chain([root.join("../shared"), root.join("../../shared")]);
    folders.find(|folder| folder.join("models").is_dir())
}

/// All models in the folders of `CARPUS_MODELS`, else among the shared ones.
fn models(shared: Option<&Path>) -> Vec<PathBuf> {
    let folders: Vec<PathBuf> = match env::var_os("CARPUS_MODELS") {
        Some(folders) => env::split_paths(&folders).collect(),
        None => shared.map(|folder| folder.join("models")).into_iter().collect(),
    };
    let files = folders.into_iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
    files.map(|file| file.path()).filter(|path| path.extension().is_some_and(|ending| ending == "osim")).collect()
}
