//! Effects of a laboratory's own, put beside the catalogue before a command works.

use std::path::{Path, PathBuf};

use super::args::{Command, EffectCommand};
use super::args_diagnosis::{EffectsFile, OwnEffects};
use super::failure::{Failure, Message};
use crate::diagnosis::export::SideCar;
use crate::diagnosis::own_effect::{Definition, OwnEffect, register, registered};
use crate::study::{Fault, Problem, Study};

/// Registers the effects that a command's arguments and its study name.
///
/// # Errors
/// A file that is no definition; two effects of one identifier; a muscle that the study does not activate.
pub fn register_those_of(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Effects(args) => register_all(&args.own, None),
        Command::Simulate(args) => register_beside(&args.effects, &args.study.study),
        Command::Compare(args) => register_beside(&args.effects, &args.study.study),
        Command::Diagnose(args) => register_beside(&args.effects, &args.study.study),
        Command::Plan(args) => register_beside(&args.effects, &args.study.study),
        Command::Synth(args) => register_all(&args.own, Some(&args.study.study)),
        Command::Effect(args) => match &args.command {
            EffectCommand::Add(args) => register_beside(&args.effects, &args.study.study),
            EffectCommand::Auto(args) => register_beside(&args.effects, &args.study.study),
            EffectCommand::Remove(args) => register_all(&args.own, None),
        },
        _ => Ok(()),
    }
}

/// Also those that come with effects beside the model; what is wrong there is told when the model's effects are read.
fn register_beside(effects: &EffectsFile, study: &Path) -> Result<(), Failure> {
    register_all(&effects.own, Some(study))?;
    effects.file().map(SideCar::read);
    Ok(())
}

fn register_all(own: &OwnEffects, study: Option<&Path>) -> Result<(), Failure> {
    let study = study.and_then(Study::settings_of);
    let mut named: Vec<(&PathBuf, Option<String>)> = Vec::new();
    if let Some((file, settings)) = &study {
        let at = format!("{}:{}", file.display(), settings.own_effects_line);
        named.extend(settings.own_effects.iter().map(|f| (f, Some(at.clone()))));
    }
    named.extend(own.files.iter().map(|f| (f, None)));
    for (file, at) in named {
        let effect = read(file, at)?;
        if let Some((_, settings)) = &study {
            let problems = effect.defined().unknown_muscles(&settings.active_muscles);
            if !problems.is_empty() {
                return Err(messages(&problems));
            }
        }
    }
    Ok(())
}

/// Reads a file and registers its effect.
///
/// - `named_at`: where the file is named, if another file does
///
/// # Errors
/// A file that is no definition; an identifier that another effect has.
pub fn read(file: &Path, named_at: Option<String>) -> Result<&'static OwnEffect, Failure> {
    let definition = Definition::read(file).map_err(|mut problems| {
        for problem in &mut problems {
            if let Fault::MissingFile { named_at: at, .. } = &mut problem.fault {
                *at = named_at.clone();
            }
        }
        messages(&problems)
    })?;
    register(definition).map_err(|e| {
        let message = Message::error(e.to_string()).in_file(file);
        message.hint("give it another id; `carpus effects` lists the catalogue").into()
    })
}

/// Files of the registered effects that lie by themselves.
///
/// - `side_car`: effects beside the model, whose definitions stand in their file
pub fn files(side_car: Option<&Path>) -> Vec<PathBuf> {
    let files = registered().into_iter().map(|e| e.defined().file.clone());
    files.filter(|f| Some(f.as_path()) != side_car).collect()
}

fn messages(problems: &[Problem]) -> Failure {
    problems.iter().map(Message::from).collect::<Vec<Message>>().into()
}
