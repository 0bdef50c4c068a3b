//! Reading a model for a command, and what of it a result depends on.

use std::path::{Path, PathBuf};

use super::diagnostic::{Diagnostic, Failure, Severity};
use super::quantity::{Assignment, Quantity};
use carpus_multibody::multibody::Model;
use carpus_multibody::paths::{Path as MusclePath, PathGeometry};
use carpus_osim::osim::spec::{ConstraintKind, ConstraintSpec, CoordinateIndex, ModelSpec, MotionType, MuscleIndex};
use carpus_osim::osim::{Diagnostic as Finding, OsimError, OsimFile, Severity as FindingSeverity};
use carpus_study::study::outside_range;

/// A model that was read and compiled.
#[derive(Debug)]
pub struct LoadedModel {
    /// Where it was read from.
    pub path: PathBuf,
    /// The file and its specification.
    pub file: OsimFile,
    /// The compiled skeleton.
    pub model: Model,
}

/// What a result depends on, beyond the paths and properties of muscles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Only the motion of bodies.
    Motion,
    /// Motion of trials, in which loops that constraints and joints close stay closed.
    Trials {
        /// All forces that are not muscles, too.
        passive: bool,
    },
}

/// Reads and compiles a model. Unsupported components that the result depends on are errors, or warnings if allowed.
///
/// # Errors
/// The file is not a usable model; or it has unsupported components that matter, and they are not allowed.
pub fn load(path: &Path, needs: Needs, allow: bool, messages: &mut Vec<Diagnostic>) -> Result<LoadedModel, Failure> {
    let file = OsimFile::read(path).map_err(|e| osim_failure(path, &e))?;
    compiled(path, file, needs, allow, messages)
}

/// As [`load`], of a file in memory.
///
/// - `path`: its name in messages
///
/// # Errors
/// As there.
pub fn compiled(
    path: &Path,
    file: OsimFile,
    needs: Needs,
    allow: bool,
    messages: &mut Vec<Diagnostic>,
) -> Result<LoadedModel, Failure> {
    let findings = &file.diagnostics;
    messages.extend(findings.of(FindingSeverity::Warning).map(|d| finding(path, d, Severity::Warning)));
    // Muscles are judged by those who know which of them act.
    let without_path = file.spec.forces.iter().filter(|f| f.is_muscle_without_path());
    let muscles = file.spec.muscles.iter().map(|m| &m.at).chain(without_path.map(|f| &f.at));
    let muscles: Vec<&str> = muscles.map(|at| at.path.as_str()).collect();
    let is_muscle = |d: &Finding| muscles.contains(&d.path.as_str());
    let matters = |d: &&Finding| match needs {
        Needs::Motion => !acts_by_force(&d.path),
        Needs::Trials { .. } if closes_loop(&file.spec, &d.path) => false,
        Needs::Trials { passive: false } => !acts_by_force(&d.path),
        Needs::Trials { passive: true } => !is_driver(&d.path) && !is_muscle(d),
    };
    let unsupported: Vec<_> = findings.of(FindingSeverity::Unsupported).filter(matters).collect();
    if allow {
        messages.extend(unsupported.iter().map(|d| finding(path, d, Severity::Warning)));
    } else if !unsupported.is_empty() {
        let errors = unsupported.iter().map(|d| finding(path, d, Severity::Error));
        let mut errors: Vec<_> = messages.drain(..).chain(errors).collect();
        if let Some(last) = errors.last_mut() {
            let more = "--allow-unsupported goes on without them";
            last.hint = Some(match last.hint.take() {
                Some(hint) => format!("{hint}; {more}"),
                None => more.to_string(),
            });
        }
        return Err(errors.into());
    }
    let model = Model::compile(&file.spec).map_err(|e| {
        let message = Diagnostic::error(e.to_string()).in_file(path);
        Failure::from(message.at_line(e.at().line))
    })?;
    Ok(LoadedModel { path: path.to_owned(), file, model })
}

/// Whether a component acts only through forces: it changes neither motion nor paths.
fn acts_by_force(path: &str) -> bool {
    is_driver(path) || path.starts_with("/forceset")
}

/// Whether a component is a constraint or joint that a study holds to.
fn closes_loop(spec: &ModelSpec, path: &str) -> bool {
    let enforced = |c: &&ConstraintSpec| !matches!(c.kind, ConstraintKind::Unsupported { .. });
    spec.constraints.iter().filter(enforced).any(|c| c.at.path == path)
        || spec.loop_joints().into_iter().any(|joint| spec.joints[joint.0].at.path == path)
}

/// Whether a component only drives, measures or serves others: excitations and motion are given here.
fn is_driver(path: &str) -> bool {
    ["/controllerset", "/contactgeometryset", "/probeset"].iter().any(|set| path.starts_with(set))
}

/// A finding as a message.
pub fn finding(path: &Path, diagnostic: &Finding, severity: Severity) -> Diagnostic {
    Diagnostic {
        severity,
        file: Some(path.to_owned()),
        line: Some(diagnostic.line),
        text: format!("{}: {}{}", diagnostic.path, diagnostic.message, elsewhere(diagnostic)),
        hint: diagnostic.hint.clone(),
    }
}

/// At how many further lines the same was found.
pub fn elsewhere(diagnostic: &Finding) -> String {
    match diagnostic.also_at.len() {
        0 => String::new(),
        1 => " (and at 1 more line)".to_string(),
        n => format!(" (and at {n} more lines)"),
    }
}

/// What a file that is no model is, and which command takes it, where its name and content say so.
fn other_than_a_model(path: &Path) -> Option<Diagnostic> {
    let shown = path.display();
    let is_study =
        |file: &Path| carpus_numerics::regular_file::read_text(file).is_ok_and(|text| text.contains("[study]"));
    let of_study = |what: &str| {
        (
            format!("{what}, not a model"),
            format!("give the model that study.toml names; carpus compare {shown} --out compared checks the study"),
        )
    };
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let (text, hint) = match extension.as_str() {
        _ if path.is_dir() && is_study(&path.join("study.toml")) => of_study("this is the folder of a study"),
        "toml" if is_study(path) => of_study("this is a study"),
        "c3d" => {
            let hint = format!("carpus c3d {shown} --out FOLDER shows and converts it");
            ("this is a recording, not a model".to_owned(), hint)
        }
        "csv" | "sto" | "mot" | "trc" => {
            ("this is a table, not a model".to_owned(), "give the path of a model (.osim)".to_owned())
        }
        _ => return None,
    };
    Some(Diagnostic::error(text).in_file(path).hint(hint))
}

/// Why a model file cannot be read, one message per problem.
pub fn osim_failure(path: &Path, error: &OsimError) -> Failure {
    let is_another_file = matches!(error, OsimError::Document(_) | OsimError::NotAModel { .. }) || path.is_dir();
    if let Some(message) = is_another_file.then(|| other_than_a_model(path)).flatten() {
        return message.into();
    }
    let message_in = |file: &Path, text: String, line: usize, hint: Option<String>| {
        let message = Diagnostic::error(text).in_file(file).at_line(line);
        Diagnostic { hint, ..message }
    };
    let message = |text: String, line: usize, hint: Option<String>| message_in(path, text, line, hint);
    let messages = match error {
        OsimError::Read { source, .. } => vec![message(format!("cannot be read: {source}"), 0, error.hint())],
        OsimError::Document(e) => vec![message(e.kind.to_string(), e.line, e.hint())],
        OsimError::NotAModel { line, found, .. } => {
            let text =
                format!("not an OpenSim model: expected <OpenSimDocument Version=\"…\"> with a <Model>, found {found}");
            vec![message(text, *line, error.hint())]
        }
        OsimError::NotAForceSet { line, found, .. } => {
            vec![message(format!("not a set of forces: expected <ForceSet>, found {found}"), *line, error.hint())]
        }
        OsimError::UnsupportedVersion { line, found, oldest, newest, .. } => {
            let text = format!("file format version {found} is not supported; expected {oldest} to {newest}");
            vec![message(text, *line, error.hint())]
        }
        OsimError::Invalid { problems } => problems
            .iter()
            .map(|p| message_in(Path::new(&p.file), format!("{}: {}", p.path, p.kind), p.line, p.hint()))
            .collect(),
    };
    Failure::Input(messages)
}

impl LoadedModel {
    /// Name of the file, for messages.
    pub fn message(&self, text: String) -> Diagnostic {
        Diagnostic::error(text).in_file(&self.path)
    }

    /// The coordinate of that name.
    ///
    /// # Errors
    /// There is none; the message names the nearest.
    pub fn coordinate(&self, name: &str) -> Result<CoordinateIndex, Failure> {
        self.model.coordinate(name).ok_or_else(|| {
            let names = self.model.coordinates.iter().map(|c| c.name.as_str());
            self.unknown("coordinate", name, names).into()
        })
    }

    /// The muscles of these names, or all.
    ///
    /// # Errors
    /// A name that the model does not have.
    pub fn muscles(&self, names: &[String]) -> Result<Vec<MuscleIndex>, Failure> {
        let muscles = &self.file.spec.muscles;
        if names.is_empty() {
            if muscles.is_empty() {
                return Err(self.message("the model has no muscles".to_string()).into());
            }
            return Ok((0..muscles.len()).map(MuscleIndex).collect());
        }
        let find = |name: &String| {
            let found = muscles.iter().position(|m| m.name == *name).map(MuscleIndex);
            found.ok_or_else(|| self.unknown("muscle", name, muscles.iter().map(|m| m.name.as_str())))
        };
        names.iter().map(find).collect::<Result<_, Diagnostic>>().map_err(Failure::from)
    }

    fn unknown<'a>(&self, what: &str, name: &str, names: impl Iterator<Item = &'a str> + Clone) -> Diagnostic {
        let message = self.message(format!("the model has no {what} `{name}`"));
        match carpus_study::study::nearest(name, names.clone()) {
            Some(nearest) => message.hint(format!("did you mean `{nearest}`?")),
            None => message.hint(format!("it has: {}", first_names(names))),
        }
    }

    /// Checks that a coordinate can be set: the unit suits it and it does not follow another.
    ///
    /// # Errors
    /// It cannot.
    pub fn check_settable(&self, name: &str, value: Quantity) -> Result<CoordinateIndex, Failure> {
        let index = self.coordinate(name)?;
        let coordinate = &self.model.coordinates[index.0];
        if !value.suits(coordinate.motion_type) {
            let (kind, units) = match coordinate.motion_type {
                MotionType::Translational => ("a translation", "m or mm"),
                _ => ("a rotation", "deg or rad"),
            };
            let message = self.message(format!("coordinate `{name}` is {kind}: expected {units}, found {value}"));
            return Err(message.into());
        }
        if self.model.is_dependent(index) {
            let drivers = self.model.names_of_roots(index, "`");
            let message = self.message(format!("coordinate `{name}` follows {drivers} through a coupler"));
            return Err(message.hint(format!("set {drivers} instead")).into());
        }
        Ok(index)
    }

    /// The warning that several coordinates have a name: the first of them is meant, as in OpenSim.
    pub fn ambiguous(&self, index: CoordinateIndex) -> Option<Diagnostic> {
        let specs = &self.file.spec.coordinates;
        let name = &specs[index.0].name;
        let same: Vec<&str> = specs.iter().filter(|c| c.name == *name).map(|c| c.at.path.as_str()).collect();
        let [first, others @ ..] = same.as_slice() else { return None };
        let text =
            format!("coordinate `{name}` is ambiguous: {first} is taken, as in OpenSim, not {}", others.join(", "));
        let message = Diagnostic { severity: Severity::Warning, ..self.message(text) }.at_line(specs[index.0].at.line);
        (!others.is_empty()).then(|| message.hint("give each coordinate a name of its own".to_owned()))
    }

    /// The default posture with some coordinates set and couplers followed [rad or m]. Values outside a coordinate's
    /// range are used, with a warning, and so is the first of several coordinates of one name.
    ///
    /// # Errors
    /// A coordinate that the model does not have, follows another, or is of another kind than the unit.
    pub fn posture(&self, set: &[Assignment], messages: &mut Vec<Diagnostic>) -> Result<Vec<f64>, Failure> {
        let mut q = self.model.default_coordinates();
        for assignment in set {
            let index = self.check_settable(&assignment.coordinate, assignment.value)?;
            messages.extend(self.ambiguous(index));
            q[index.0] = assignment.value.si();
            let coordinate = &self.model.coordinates[index.0];
            if !coordinate.in_range(q[index.0]) {
                messages.push(self.outside_range(index, q[index.0]));
            }
        }
        self.model.satisfy_couplers(&mut q);
        Ok(q)
    }

    /// The warning that a value lies outside a coordinate's range.
    pub fn outside_range(&self, index: CoordinateIndex, value: f64) -> Diagnostic {
        let coordinate = &self.model.coordinates[index.0];
        let is_translation = coordinate.motion_type == MotionType::Translational;
        let outside = outside_range(value, coordinate.range, is_translation);
        let text = format!("coordinate `{}` is {outside}", coordinate.name);
        Diagnostic { severity: Severity::Warning, ..self.message(text) }
            .at_line(self.file.spec.coordinates[index.0].at.line)
    }

    /// The compiled paths of muscles, each with its buffers.
    ///
    /// # Errors
    /// A path that cannot be compiled.
    pub fn muscle_paths(&self, muscles: &[MuscleIndex]) -> Result<Vec<(MusclePath, PathGeometry)>, Failure> {
        let compile = |index: &MuscleIndex| {
            let muscle = &self.file.spec.muscles[index.0];
            let path = MusclePath::compile(&muscle.path, &self.file.spec, &self.model).map_err(|e| {
                Failure::from(self.message(format!("{}: {e}", muscle.at.path)).at_line(muscle.path.at.line))
            })?;
            let geometry = path.new_geometry();
            Ok((path, geometry))
        };
        muscles.iter().map(compile).collect()
    }
}

/// The first few names of a list.
fn first_names<'a>(names: impl Iterator<Item = &'a str> + Clone) -> String {
    const SHOWN: usize = 12;
    let rest = names.clone().count().saturating_sub(SHOWN);
    let shown = names.take(SHOWN).collect::<Vec<_>>().join(", ");
    if rest > 0 { format!("{shown} and {rest} more") } else { shown }
}
