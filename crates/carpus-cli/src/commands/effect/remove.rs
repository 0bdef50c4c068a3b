//! `carpus effect remove`: a step back in the ledger.

use super::ledger::readable;
use crate::args::{EffectRemoveArgs, Global};
use crate::failure::Failure;
use crate::stdout::print_result;
use carpus_session::remove_effects::{RemoveEffects, text_of};

/// Runs the command.
///
/// # Errors
/// A folder without a ledger; a step that is not there; the disk.
pub fn run(args: &EffectRemoveArgs, global: &Global) -> Result<(), Failure> {
    let ledger = RemoveEffects { folder: args.folder.clone(), to: args.to }.run()?;
    print_result(&if global.json { text_of(&ledger)? } else { readable(&ledger) })
}
