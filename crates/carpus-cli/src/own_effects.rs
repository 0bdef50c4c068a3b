//! Effects of a laboratory's own that a command's arguments and its study name.

use super::args::{Command, EffectCommand, EffectsFile, StudyArgs};
use super::failure::Failure;
use carpus_effects::export::SideCar;
use carpus_session::own_effects::register_all;

/// Registers the effects that a command's arguments and its study name.
///
/// # Errors
/// A file that is no definition; two effects of one identifier; a muscle that the study does not activate.
pub fn register_those_of(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Effects(args) => register_all(&args.own.files, None),
        Command::Simulate(args) | Command::Compare(args) => register_beside(&args.effects, &args.study),
        Command::Diagnose(args) => register_beside(&args.effects, &args.study),
        Command::Plan(args) => register_beside(&args.effects, &args.study),
        Command::Synth(args) => register_all(&args.own.files, Some(&args.study.input.study)),
        Command::Effect(args) => match &args.command {
            EffectCommand::Add(args) => register_beside(&args.effects, &args.study),
            EffectCommand::Auto(args) => register_beside(&args.effects, &args.study),
            EffectCommand::Remove(args) => register_all(&args.own.files, None),
        },
        _ => Ok(()),
    }
}

/// Also those that come with effects beside the model; what is wrong there is told when the model's effects are read.
fn register_beside(effects: &EffectsFile, study: &StudyArgs) -> Result<(), Failure> {
    register_all(&effects.own.files, Some(&study.input.study))?;
    effects.file().map(SideCar::read);
    Ok(())
}
