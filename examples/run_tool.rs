//! A setup file of an OpenSim tool, run without OpenSim: `cargo run --release --example run_tool [SETUP.xml]`.

use std::path::{Path, PathBuf};

use carpus::session::progress::Silent;
use carpus::session::run_tool::RunTool;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let setup = match std::env::args().nth(1) {
        Some(setup) => PathBuf::from(setup),
        None => copied(Path::new("fixtures/components"), Path::new("target/examples/analyze"))?.join("analyze.xml"),
    };
    let done = RunTool::new(setup).run(&Silent)?;
    done.summary.iter().for_each(|line| println!("{line}"));
    done.files.iter().for_each(|file| println!("{}", file.display()));
    Ok(())
}

/// A copy of the files of a folder: a tool writes beside its setup.
fn copied(from: &Path, to: &Path) -> std::io::Result<PathBuf> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        if entry.file_type()?.is_file() {
            std::fs::copy(entry.path(), to.join(entry.file_name()))?;
        }
    }
    Ok(to.to_owned())
}
