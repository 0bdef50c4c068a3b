//! Intervals of muscle parameters, what the data leave open, and which trial would narrow it down.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::account::warning_result;
use super::diagnostic::{Diagnostic, Failure};
use super::identify_files;
use super::images::images;
use super::loading::{LoadedParticipant, Purpose, require_memory};
use super::output::OutputFolder;
use super::participant::Session;
use super::personalize::INTERVAL_LEVEL;
use super::prepared::{active_specs, forward_model_of, laboratory};
use super::progress::Progress;
use super::provenance::{DEFAULT_SEED, input_file};
use super::study::{Study, simulation_message};
use carpus_identifiability::{
    FreeParameter, Identifiability, IdentifiabilityError, MuscleProperty, Prior, RecordedTrial, Request,
    SessionRequest, fitted, identify, identify_session, usual_bounds, usual_candidates, usual_recordings,
};
use carpus_osim::osim::spec::MuscleSpec;
use carpus_report::identifiability::IdentifiabilityResult;
use carpus_simulation::simulation::{Recording, SimulationError};
use carpus_study::study::{FurtherMoment, PriorKnowledge, PriorUnit, TrialUse, read_priors};

/// Said in every report that gives intervals of strength, until these hold the truth as often as their level says
/// (`fixtures/identifiability`).
const TOO_NARROW: &str = "intervals of max_isometric_force are somewhat too narrow: in 24 simulated studies of known \
                          truth, 90 % intervals held it in 85 % of cases (those of lengths in 92 to 96 %)";

/// Draws from the posterior where no other number is asked for.
pub const DEFAULT_DRAWS: usize = 2000;

/// Muscles whose parameters have one factor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TiedMuscles {
    /// Name of the group.
    pub name: String,
    /// Its muscles.
    pub muscles: Vec<String>,
}

impl FromStr for TiedMuscles {
    type Err = String;

    fn from_str(text: &str) -> Result<TiedMuscles, String> {
        let expected = || "expected GROUP=MUSCLE,MUSCLE, as in flexors=FCR,FCU".to_string();
        let (name, muscles) = text.split_once('=').ok_or_else(expected)?;
        let muscles: Vec<String> = muscles.split(',').map(|m| m.trim().to_string()).filter(|m| !m.is_empty()).collect();
        if name.is_empty() || muscles.is_empty() {
            Err(expected())
        } else {
            Ok(TiedMuscles { name: name.to_string(), muscles })
        }
    }
}

/// Prior knowledge of muscle parameters, as a table has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Priors {
    /// The table; `None`: in memory.
    pub file: Option<PathBuf>,
    /// Its rows.
    pub values: Vec<PriorKnowledge>,
}

impl Priors {
    /// Reads a table: muscle, property, mean, sd and perhaps unit and source.
    ///
    /// # Errors
    /// All problems of the table, together.
    pub fn read(file: &Path) -> Result<Priors, Failure> {
        Ok(Priors { file: Some(file.to_owned()), values: read_priors(file)? })
    }
}

/// An identification: what the trials with use = train and prior knowledge say about muscle parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Identify {
    /// Seed of the draws from the posterior.
    pub seed: u64,
    /// Properties in question.
    pub properties: Vec<MuscleProperty>,
    /// One factor for several muscles, per property.
    pub tie: Vec<TiedMuscles>,
    /// Prior knowledge beside the bounds.
    pub priors: Option<Priors>,
    /// Level of intervals.
    pub level: f64,
    /// Draws from the posterior.
    pub draws: usize,
}

impl Default for Identify {
    fn default() -> Self {
        let properties = MuscleProperty::USUAL.to_vec();
        let (seed, level, draws) = (DEFAULT_SEED, INTERVAL_LEVEL, DEFAULT_DRAWS);
        Identify { seed, properties, tie: Vec::new(), priors: None, level, draws }
    }
}

/// What a participant's trials say about muscle parameters.
#[derive(Debug)]
pub struct Identified<'a> {
    session: &'a Session<'a>,
    /// What is written as `identifiability.json`.
    pub result: IdentifiabilityResult,
    /// Intervals, posterior and its draws.
    pub found: Identifiability,
    /// Warnings of the session, and those that came up here.
    pub warnings: Vec<Diagnostic>,
}

impl Session<'_> {
    /// Intervals and posterior of muscle parameters by the training trials.
    ///
    /// # Errors
    /// A prior or group that does not suit the model; trials that are too long; a trial that cannot be simulated.
    pub fn identify(&self, request: &Identify) -> Result<Identified<'_>, Failure> {
        let progress = self.progress()?;
        let again = self.read_for(Purpose::Identification)?;
        let run = &self.data;
        let (mut result, found, more) =
            request.answered(self.study, again.as_ref().map_or(run, |session| &session.data), progress)?;
        let warnings: Vec<Diagnostic> = run.warnings.iter().cloned().chain(more).collect();
        result.warnings = warnings.iter().map(warning_result).collect();
        result.provenance = self.study.provenance(request, request.seed, run.inputs.clone());
        if let Some(file) = request.priors.as_ref().and_then(|priors| priors.file.as_ref()) {
            result.provenance.inputs.push(input_file(file, &file.display().to_string(), "priors")?);
        }
        Ok(Identified { session: self, result, found, warnings })
    }
}

impl Identified<'_> {
    /// Writes `identifiability.json`, its tables, draws and report.
    ///
    /// - `folder`: the participant's, in the folder of the results
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder, folder: &Path) -> Result<(), Failure> {
        identify_files::write(out, folder, &self.result)?;
        let draws = identify_files::draws_csv(&self.result, &self.found)?;
        out.write(folder.join("draws.csv"), draws.as_bytes())?;
        Ok(())
    }

    /// Writes the files of `carpus identify` into a folder of results. Returns what a person should know about files of
    /// earlier runs.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of this study and command.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<Vec<Diagnostic>, Failure> {
        self.session.write_results(path.as_ref(), "identify", |out, folder| self.write_to(out, folder))
    }
}

/// Properties by OpenSim's names; without names those usually in question.
///
/// # Errors
/// An unknown name.
pub fn properties_named(names: &[String]) -> Result<Vec<MuscleProperty>, Failure> {
    if names.is_empty() {
        return Ok(MuscleProperty::USUAL.to_vec());
    }
    let known = |name: &String| {
        MuscleProperty::from_name(name).ok_or_else(|| {
            let message = Diagnostic::error(format!("--properties: there is no property `{name}`"));
            let known = MuscleProperty::ALL.map(MuscleProperty::name);
            let hint = match carpus_study::study::nearest(name, known) {
                Some(nearest) => format!("did you mean `{nearest}`?"),
                None => format!("there are: {}", known.join(", ")),
            };
            message.hint(hint).into()
        })
    };
    names.iter().map(known).collect()
}

impl Identify {
    /// What the participant's training trials say, without provenance and warnings of the session; and further
    /// warnings.
    ///
    /// - `run`: read for [`Purpose::Identification`]
    ///
    /// # Errors
    /// A prior or group that does not suit the model; a trial that cannot be simulated; a request to stop.
    pub fn answered(
        &self,
        study: &Study,
        run: &LoadedParticipant,
        progress: &dyn Progress,
    ) -> Result<(IdentifiabilityResult, Identifiability, Vec<Diagnostic>), Failure> {
        let mut warnings = Vec::new();
        // What cannot be simulated has no intervals: better said at once.
        run.simulate(&run.model.nominal_parameters())?;
        let free = parameters(study, run, self, &mut warnings)?;
        let further = &study.tables.settings.columns.further_moments;
        let what = format!("identifying {}", run.participant.name);
        progress.at(&what, 0, 0);
        let tell = |done: usize, steps: usize| progress.at(&what, done, steps);
        let found = if further.is_empty() && free.iter().all(|p| fitted(p.property).is_some()) {
            by_session(study, run, free, self, (&tell, &|| !progress.is_cancelled()))
        } else {
            if free.iter().any(|p| p.property == MuscleProperty::MaxIsometricForce) {
                warnings.push(Diagnostic::warning(TOO_NARROW));
            }
            identified(run, further, free, self)
        };
        progress.finished();
        let found = found?;
        Ok((identify_files::result(study, run, &found, self.level), found, warnings))
    }
}

/// The parameters in question, with their priors.
fn parameters(
    study: &Study,
    run: &LoadedParticipant,
    request: &Identify,
    warnings: &mut Vec<Diagnostic>,
) -> Result<Vec<FreeParameter>, Failure> {
    let specs = active_specs(run);
    let mut free = Vec::new();
    for property in &request.properties {
        for (name, members) in owners(&specs, &request.tie)? {
            let spec = &specs[members[0]];
            match property.of(spec) {
                Some(value) if value > 0.0 => {
                    let bounds = usual_bounds(*property, &study.tables.settings.bounds);
                    free.push(FreeParameter::new(&name, *property, members, value, bounds));
                }
                found => {
                    let why = match found {
                        Some(_) => "is 0 in the model and has no factor".to_owned(),
                        None => format!("is no property of a {} as the model has it", spec.class()),
                    };
                    let text = format!("{name}: {} {why}: left out", property.name());
                    warnings.push(Diagnostic::warning(text).in_file(&run.loaded.path).at_line(spec.at.line));
                }
            }
        }
    }
    let Some(Priors { file, values }) = &request.priors else { return Ok(free) };
    for prior in values {
        let at = |message: Diagnostic| match file {
            Some(file) => message.in_file(file).at_line(prior.line),
            None => message,
        };
        if MuscleProperty::from_name(&prior.property).is_none() {
            let known = MuscleProperty::ALL.map(MuscleProperty::name);
            let message = at(Diagnostic::error(format!("there is no property `{}`", prior.property)));
            return Err(message.hint(format!("there are: {}", known.join(", "))).into());
        }
        let found = free.iter_mut().find(|p| p.owner == prior.muscle && p.property.name() == prior.property);
        let Some(parameter) = found else {
            let name = format!("{}.{}", prior.muscle, prior.property);
            warnings.push(at(Diagnostic::warning(format!("{name} is not in question: this prior is not used"))));
            continue;
        };
        let factor = match prior.unit {
            PriorUnit::File => prior.mean / parameter.nominal,
            PriorUnit::Model => prior.mean,
        };
        if !(parameter.lower..=parameter.upper).contains(&factor) {
            let text = format!(
                "{}: the prior's mean is {:.3} times the model's value, outside the bounds {} to {}",
                parameter.name(),
                factor,
                parameter.lower,
                parameter.upper
            );
            return Err(at(Diagnostic::error(text))
                .hint("is the mean in the unit of the model file, or in multiples of its value with unit = model?")
                .into());
        }
        let source = prior.source.clone().unwrap_or_else(|| match file {
            Some(file) => file.display().to_string(),
            None => "prior knowledge in memory".to_owned(),
        });
        let log_sd = (1.0 + (prior.sd / prior.mean).powi(2)).ln().sqrt();
        parameter.prior = Prior { factor, log_sd, source: Some(source) };
    }
    Ok(free)
}

/// Every group of tied muscles, and every muscle that is in none.
fn owners(specs: &[MuscleSpec], tie: &[TiedMuscles]) -> Result<Vec<(String, Vec<usize>)>, Failure> {
    let mut owners: Vec<(String, Vec<usize>)> = Vec::new();
    let mut tied: Vec<usize> = Vec::new();
    for group in tie {
        let mut members = Vec::new();
        for name in &group.muscles {
            let Some(m) = specs.iter().position(|s| s.name == *name) else {
                let message = Diagnostic::error(format!("--tie {}: `{name}` is not an active muscle", group.name));
                let known: Vec<&str> = specs.iter().map(|s| s.name.as_str()).collect();
                let hint = match carpus_study::study::nearest(name, known.iter().copied()) {
                    Some(nearest) => format!("did you mean `{nearest}`?"),
                    None => format!("there are: {}", known.join(", ")),
                };
                return Err(message.hint(hint).into());
            };
            if tied.contains(&m) {
                return Err(Diagnostic::error(format!("--tie {}: {name} is tied already", group.name)).into());
            }
            tied.push(m);
            members.push(m);
        }
        owners.push((group.name.clone(), members));
    }
    let alone = specs.iter().enumerate().filter(|(m, _)| !tied.contains(m));
    owners.extend(alone.map(|(m, s)| (s.name.clone(), vec![m])));
    Ok(owners)
}

/// Lengths and forces by the model of a session that every command shares.
fn by_session(
    study: &Study,
    run: &LoadedParticipant,
    parameters: Vec<FreeParameter>,
    asked: &Identify,
    (progress, goes_on): (&dyn Fn(usize, usize), &dyn Fn() -> bool),
) -> Result<Identifiability, Failure> {
    let forward = forward_model_of(run)?;
    let request = SessionRequest {
        forward: &forward,
        laboratory: laboratory(run),
        bounds: study.tables.settings.bounds,
        images: images(study, run)?,
        parameters,
        level: asked.level,
        seed: asked.seed,
        draws: asked.draws,
        candidates: usual_recordings(&run.model, &run.trials),
    };
    identify_session(&request, progress, goes_on).map_err(|e| failed(run, e))
}

fn identified(
    run: &LoadedParticipant,
    further: &[FurtherMoment],
    parameters: Vec<FreeParameter>,
    asked: &Identify,
) -> Result<Identifiability, Failure> {
    let mut candidates = usual_candidates(&run.model, &run.trials).map_err(|e| failed(run, e.into()))?;
    for candidate in &mut candidates {
        for about in further {
            let trial = candidate.trial.clone();
            let zeros = vec![0.0; trial.time.len()];
            let arms = run
                .model
                .moment_arms_about(&about.coordinate, &trial.held, &trial.angle)
                .map_err(|e| failed(run, e.into()))?;
            candidate.trial = trial.with_channel(&about.coordinate, &zeros, arms);
        }
    }
    let estimation = estimation(run, further, parameters, asked)?;
    identify(&Request { candidates, ..estimation }).map_err(|e| failed(run, e))
}

fn failed(run: &LoadedParticipant, error: IdentifiabilityError) -> Failure {
    match error {
        IdentifiabilityError::Stopped => Failure::Cancelled,
        IdentifiabilityError::Simulation(error) => simulation_message(&error, &run.loaded).into(),
        other => Diagnostic::error(other.to_string()).in_file(&run.loaded.path).into(),
    }
}

/// A request without candidates for the next trial.
fn estimation(
    run: &LoadedParticipant,
    further: &[FurtherMoment],
    parameters: Vec<FreeParameter>,
    asked: &Identify,
) -> Result<Request, Failure> {
    require_memory(&run.trials, run.model.muscle_names().count(), false, &run.trials_file)?;
    let coordinate = &run.model.setup().coordinate;
    let trials = run
        .trials
        .iter()
        .zip(&run.prepared)
        .filter(|(t, _)| t.info.usage == TrialUse::Train)
        .map(|(t, p)| {
            let trial =
                RecordedTrial::new(&t.info.name, t.info.direction, coordinate, &Recording::from(t), &t.moment, p)
                    .sampled_every(t.rows_per_moment());
            further.iter().zip(&t.further_moments).try_fold(trial, |trial, (about, measured)| {
                let arms = run.model.moment_arms_about(&about.coordinate, &trial.held, &t.angle)?;
                Ok(trial.with_channel(&about.coordinate, measured, arms))
            })
        })
        .collect::<Result<Vec<_>, SimulationError>>()
        .map_err(|e| failed(run, e.into()))?;
    Ok(Request {
        model: run.model.clone(),
        muscles: active_specs(run),
        trials,
        parameters,
        level: asked.level,
        seed: asked.seed,
        draws: asked.draws,
        candidates: Vec::new(),
    })
}
