//! `carpus upgrade`: a model of an old format in the current one.

use serde_json::json;

use crate::args::{Global, UpgradeArgs};
use crate::failure::{self, Diagnostic, Failure};
use crate::print_result;
use carpus_osim::osim::OsimFile;
use carpus_session::model;
use carpus_session::output::OutputFolder;

/// Runs the command.
///
/// # Errors
/// A model that cannot be read, or the disk.
pub fn run(args: &UpgradeArgs, global: &Global) -> Result<(), Failure> {
    let fail = |error| model::osim_failure(&args.old, &error);
    let file = OsimFile::read(&args.old).map_err(fail)?;
    let before = file.spec.document_version;
    let upgraded = file.upgraded().map_err(fail)?;
    let warnings: Vec<Diagnostic> = upgraded
        .left_out
        .iter()
        .map(|(line, text)| Diagnostic::warning(format!("left out: {text}")).in_file(&args.old).at_line(*line))
        .collect();
    failure::print(&warnings);
    let folder = args.new.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(std::path::Path::new("."));
    let Some(name) = args.new.file_name() else {
        return Err(Diagnostic::error("expected a file to write").in_file(&args.new).into());
    };
    let written =
        OutputFolder::create(folder, std::slice::from_ref(&args.old))?.write(name, upgraded.file.document.bytes())?;
    let after = upgraded.file.spec.document_version;
    if global.json {
        let left: Vec<_> = upgraded.left_out.iter().map(|(line, what)| json!({ "line": line, "what": what })).collect();
        let value = json!({
            "schema": "carpus.upgrade/1", "from": before, "to": after, "file": written.display().to_string(),
            "left_out": left,
        });
        return print_result(&value.to_string());
    }
    print_result(&format!("format {before} → {after}\n{}", written.display()))
}
