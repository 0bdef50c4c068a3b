//! `carpus upgrade`: a model of an old format in the current one.

use serde_json::json;

use crate::args::{Global, UpgradeArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::print_result;
use carpus_session::upgrade::Upgrade;

/// Runs the command.
///
/// # Errors
/// A model that cannot be read, or the disk.
pub fn run(args: &UpgradeArgs, global: &Global) -> Result<(), Failure> {
    let done = Upgrade { old: args.old.clone() }.run(&args.new, &Bars::new(global))?;
    if global.json {
        let left: Vec<_> = done.left_out.iter().map(|(line, what)| json!({ "line": line, "what": what })).collect();
        let value = json!({
            "schema": "carpus.upgrade/1", "from": done.from, "to": done.to, "file": done.file.display().to_string(),
            "left_out": left,
        });
        return print_result(&value.to_string());
    }
    print_result(&format!("format {} → {}\n{}", done.from, done.to, done.file.display()))
}
