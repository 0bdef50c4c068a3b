//! `carpus upgrade`: a model of an old format in the current one.

use crate::args::{Global, UpgradeArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::stdout::print_result;
use carpus_session::upgrade::Upgrade;

/// Runs the command.
///
/// # Errors
/// A model that cannot be read, or the disk.
pub fn run(args: &UpgradeArgs, global: &Global) -> Result<(), Failure> {
    let done = Upgrade { old: args.old.clone() }.run(&args.new, &Bars::new(global))?;
    if global.json {
        return print_result(&done.value().to_string());
    }
    print_result(&format!("format {} → {}\n{}", done.from, done.to, done.file.display()))
}
