//! `carpus effect remove`: a step back in the ledger.

use super::readable;
use crate::args::Global;
use crate::args_diagnosis::EffectRemoveArgs;
use crate::failure::Failure;
use crate::print_result;
use carpus_session::remove_effects::{RemoveEffects, text_of};

/// Runs the command.
///
/// # Errors
/// A folder without a ledger; a step that is not there; the disk.
pub fn run(args: &EffectRemoveArgs, global: &Global) -> Result<(), Failure> {
    let ledger = RemoveEffects { folder: args.folder.clone(), to: args.to }.run()?;
    print_result(&if global.json { text_of(&ledger)? } else { readable(&ledger) })
}
