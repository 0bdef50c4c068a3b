//! `carpus effect`: effects into the model and out of it again.

mod add;
mod ledger;
mod remove;

use crate::args::{EffectArgs, EffectCommand, Global};
use crate::failure::Failure;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the effects, a diagnosis that does not support them, or the output folder.
pub fn run(args: &EffectArgs, global: &Global) -> Result<(), Failure> {
    match &args.command {
        EffectCommand::Add(args) => add::run(args, global),
        EffectCommand::Auto(args) => add::run_auto(args, global),
        EffectCommand::Remove(args) => remove::run(args, global),
    }
}
