//! Effects of a laboratory's own, put beside the catalogue before any work.

use std::path::{Path, PathBuf};

use super::diagnostic::{Diagnostic, Failure};
use carpus_effects::own_effect::{Definition, OwnEffect, register, registered};
use carpus_study::study::{Fault, Problem, Study};

/// Puts effects beside the catalogue: those that a study's `study.toml` names, then those of further files.
///
/// - `files`: definitions
/// - `study`: the study.toml, or the folder it is in
///
/// # Errors
/// A file that is no definition; two effects of one identifier; a muscle that the study does not activate.
pub fn register_all(files: &[PathBuf], study: Option<&Path>) -> Result<(), Failure> {
    let study = study.and_then(Study::settings_of);
    let mut named: Vec<(&PathBuf, Option<String>)> = Vec::new();
    if let Some((file, settings)) = &study {
        let at = format!("{}:{}", file.display(), settings.own_effects_line);
        named.extend(settings.own_effects.iter().map(|f| (f, Some(at.clone()))));
    }
    named.extend(files.iter().map(|f| (f, None)));
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
        let message = Diagnostic::error(e.to_string()).in_file(file);
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
    problems.iter().map(Diagnostic::from).collect::<Vec<Diagnostic>>().into()
}
