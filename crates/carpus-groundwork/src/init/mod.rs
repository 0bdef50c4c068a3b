//! A study from a laboratory's folder of exported files.
//!
//! In: a folder and a model. Out: `study.toml`, `participants.csv` and `trials.csv` beside it, and what was understood,
//! assumed, and could not be told. The laboratory's files stay where and as they are.

mod columns;
mod conditions;
mod coordinate;
mod draft;
mod folder;
mod muscles;
mod people;
mod piece;
mod pieces;
mod proposal;
mod read_file;
mod recordings;
mod text;
mod trials;
mod whose;

use std::path::{Component, Path, PathBuf};

use super::diagnostic::{Diagnostic, Failure, Severity};
use super::model::{self, Needs};
use super::output::OutputFolder;
use carpus_study::study::{Fault, Study as Tables};
pub use coordinate::crossed;
use draft::Draft;
pub use proposal::{Note, Proposal, Proposed, ProposedTrial, Questions};

/// What a study is proposed from.
#[derive(Clone, Debug)]
pub struct Init {
    /// The laboratory's folder.
    pub folder: PathBuf,
    /// The model.
    pub model: PathBuf,
    /// Folder of the study; `None`: beside the laboratory's, with `-study` at the end of its name.
    pub out: Option<PathBuf>,
    /// The coordinate that the dynamometer moves; `None`: it is found.
    pub coordinate: Option<String>,
    /// Whether work goes on without components of the model that would change the result and are not supported.
    pub allow_unsupported: bool,
}

impl Init {
    /// Looks at the folder and writes the study.
    ///
    /// # Errors
    /// The folder or the model cannot be read; there are no recordings of a moment and an angle with EMG; the study's
    /// folder has a study.
    pub fn run(&self, questions: &dyn Questions) -> Result<Proposal, Failure> {
        let out = self.out.clone().unwrap_or_else(|| beside(&self.folder));
        let study = out.join("study.toml");
        if study.exists() {
            let message = Diagnostic::error("there is a study here already").in_file(&study);
            return Err(message.hint("give another folder by --out, or remove it").into());
        }
        let mut messages = Vec::new();
        // As trials of a study are read, which the study written here names.
        let needs = Needs::Trials { passive: false };
        let loaded = model::load(&self.model, needs, self.allow_unsupported, &mut messages)?;
        let mut found = pieces::Found::of(&self.folder, &loaded)?;
        let muscles = found.pieces.muscles.clone();
        let coordinate = match &self.coordinate {
            Some(name) => coordinate::named(&loaded, name)?,
            None => coordinate::found(&loaded, &muscles, &found, questions)?,
        };
        found.assumed.extend(coordinate.assumed.iter().cloned());
        let posture = coordinate::posture(&loaded, &muscles, &coordinate, questions, &mut found.assumed)?;
        found.set_angles(&loaded, &coordinate);
        let trials = found.trials();
        let mut draft = Draft {
            name: self.folder.file_name().map_or_else(|| "study".to_owned(), |n| n.to_string_lossy().into_owned()),
            model: relative(&out, &self.model),
            recordings: relative(&out, &self.folder),
            coordinate: coordinate.name.clone(),
            posture,
            pieces: found.pieces.clone(),
            moment_sign: 1.0,
            velocity_used: found.pieces.velocity.is_some(),
            people: found.people(),
            trials: trials.clone(),
        };
        let inputs = [self.model.clone()];
        let folder = OutputFolder::create(&out, &inputs)?;
        draft.write(&folder)?;
        mend(&mut draft, &study, &folder, &mut found)?;
        let understood = found.understood(&loaded, &draft);
        Ok(Proposal {
            schema: "carpus.init/1",
            study,
            understood,
            assumed: found.assumed,
            unknown: found.unknown,
            trials,
        })
    }
}

/// Reads the study as any command does, turns signs that its checks find reversed, and notes what stays wrong.
fn mend(draft: &mut Draft, study: &Path, folder: &OutputFolder, found: &mut pieces::Found) -> Result<(), Failure> {
    let problems = problems_of(study)?;
    let is_reversed = problems.iter().any(|p| matches!(p.fault, Fault::MomentReversed { .. }));
    let disagrees = problems.iter().any(|p| matches!(p.fault, Fault::VelocityDisagrees { .. }));
    if !(is_reversed || disagrees) {
        found.unknown.extend(errors(&problems));
        return Ok(());
    }
    if is_reversed {
        draft.moment_sign = -1.0;
        found.assumed.push(Note {
            what: "the dynamometer's torque is positive in extension: its sign is turned (sign = -1)".to_owned(),
            remedy:
                "efforts in the direction that the names of the files state were negative throughout; if the names are \
                     at fault, exchange flexion and extension in trials.csv"
                    .to_owned(),
        });
    }
    if disagrees {
        draft.velocity_used = false;
        found.assumed.push(Note {
            what: "the column of the speed disagrees with the angle and is not used".to_owned(),
            remedy: "the derivative of the angle is used; give the speed's unit and sign in [columns] velocity"
                .to_owned(),
        });
    }
    draft.write(folder)?;
    found.unknown.extend(errors(&problems_of(study)?));
    Ok(())
}

fn problems_of(study: &Path) -> Result<Vec<carpus_study::study::Problem>, Failure> {
    let tables = Tables::read_tables(study)?;
    Ok(tables.check_trials(|_| true))
}

fn errors(problems: &[carpus_study::study::Problem]) -> Vec<Note> {
    let errors = problems.iter().filter(|problem| problem.severity == Severity::Error);
    let note = |problem: &carpus_study::study::Problem| Note {
        what: format!("{}: {}", problem.file.display(), problem.fault),
        remedy: problem.hint().unwrap_or_default(),
    };
    errors.map(note).collect()
}

/// The folder beside another that a study of it comes into.
fn beside(folder: &Path) -> PathBuf {
    let absolute = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name = absolute.file_name().map_or_else(|| "recordings".to_owned(), |n| n.to_string_lossy().into_owned());
    let trimmed = PathBuf::from(folder.components().as_path());
    let parent = if trimmed.file_name().is_some() { trimmed.parent().map(Path::to_owned) } else { None };
    parent.unwrap_or_else(|| absolute.parent().map(Path::to_owned).unwrap_or_default()).join(format!("{name}-study"))
}

/// The path of a file as seen from a folder, with slashes; absolute where there is none.
fn relative(from: &Path, to: &Path) -> String {
    let absolute = |path: &Path| {
        let there = path.canonicalize().ok();
        // A folder that is still to be made lies in one that is there.
        there.or_else(|| {
            let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let parent = parent.canonicalize().or_else(|_| std::path::absolute(parent)).ok()?;
            Some(parent.join(path.file_name()?))
        })
    };
    let (Some(from), Some(to)) = (absolute(from), absolute(to)) else { return to.display().to_string() };
    let (from, to): (Vec<Component<'_>>, Vec<Component<'_>>) = (from.components().collect(), to.components().collect());
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return to.iter().collect::<PathBuf>().display().to_string();
    }
    let up = from[common..].iter().map(|_| "..".to_owned());
    let down = to[common..].iter().map(|part| part.as_os_str().to_string_lossy().into_owned());
    let parts: Vec<String> = up.chain(down).collect();
    if parts.is_empty() { ".".to_owned() } else { parts.join("/") }
}
