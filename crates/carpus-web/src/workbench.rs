//! A case opened: all trials simulated with any muscle parameters and effects, and compared with what was measured.

use std::path::Path;

use serde::Serialize;

use super::case::{Case, CaseError, EffectOfCase, Header};
use carpus_effects::catalogue::effect;
use carpus_effects::export::{ExportError, SideCar, SideCarError, write_step};
use carpus_effects::forward_model::{ForwardModel, Setting};
use carpus_effects::moments::simulate_all;
use carpus_effects::own_effect::{Definition, register};
use carpus_osim::osim::{OsimError, OsimFile};
use carpus_simulation::evaluation::{ErrorSummary, ErrorTable, EvaluationError, TrialErrors};
use carpus_simulation::simulation::{
    MuscleParameters, MusculoskeletalModel, Options, PreparedTrial, Recording, SimulationError,
    simulate_all as simulate_plain,
};
use carpus_study::study::Trial;

/// A case, ready to be simulated.
pub struct Workbench {
    /// Everything of the case but the model file and the samples.
    pub header: Header,
    /// The model file.
    pub file: OsimFile,
    /// The model compiled for the trials.
    pub model: MusculoskeletalModel,
    /// The trials.
    pub trials: Vec<Trial>,
    /// The trials prepared.
    pub forward: ForwardModel,
    /// Bone geometry for drawing; empty: there is none.
    pub geometry: Vec<u8>,
    pub(crate) given: Vec<Setting>,
    /// The trials as they are simulated without effects; `None`: as with effects.
    plain: Option<Vec<PreparedTrial>>,
}

/// Why a case cannot be worked with.
#[derive(Debug, thiserror::Error)]
pub enum WorkbenchError {
    /// Not a case.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// The model file.
    #[error(transparent)]
    Model(#[from] OsimError),
    /// Effects beside the model.
    #[error(transparent)]
    SideCar(#[from] SideCarError),
    /// An effect of the laboratory's own.
    #[error("an effect of the laboratory's own cannot be read: {0}")]
    OwnEffect(String),
    /// Trials that cannot be simulated.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// Moments that cannot be compared.
    #[error(transparent)]
    Evaluation(#[from] EvaluationError),
    /// A model that cannot be written.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// A fit that found nothing.
    #[error("{0}")]
    Fit(String),
    /// No such effect, or not so many values.
    #[error("effect `{id}`: expected {expected} values, found {found}")]
    Effect {
        /// Identifier.
        id: String,
        /// Parameters that it has; 0 where there is no such effect.
        expected: usize,
        /// Values that were given.
        found: usize,
    },
    /// Not so many muscles.
    #[error("expected parameters of {expected} muscles, found {found}")]
    Muscles {
        /// Active muscles.
        expected: usize,
        /// Given.
        found: usize,
    },
}

/// Simulated moments and their errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulated {
    /// Moment of every trial [N·m], at its samples.
    pub moments: Vec<Vec<f64>>,
    /// Errors.
    pub errors: Errors,
}

/// Errors of all trials; those without a value (a moment that is zero throughout) are `None`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Errors {
    /// NRMSE of every trial.
    pub nrmse: Vec<Option<f64>>,
    /// Root mean squared error of every trial [N·m].
    pub rmse_n_m: Vec<Option<f64>>,
    /// Means over the training trials.
    pub train: Option<Means>,
    /// Means over those held out.
    pub held_out: Option<Means>,
    /// Means over the maximal contractions.
    pub mvc: Option<Means>,
}

/// Means over trials.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Means {
    /// Trials.
    pub trials: usize,
    /// NRMSE.
    pub nrmse: Option<f64>,
    /// Root mean squared error [N·m].
    pub rmse_n_m: Option<f64>,
    /// The same of every condition, by its name.
    pub conditions: Vec<(String, Means)>,
}

/// A model file with what stands beside it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// `model.osim`.
    pub model: Vec<u8>,
    /// `effects.toml`; `None` where nothing stands beside the model.
    pub side_car: Option<String>,
}

impl Workbench {
    /// Opens a case: its model is compiled and all its trials prepared.
    ///
    /// # Errors
    /// [`WorkbenchError`].
    pub fn open(bytes: &[u8]) -> Result<Workbench, WorkbenchError> {
        let Case { header, model, trials, geometry } = Case::parse(bytes)?;
        for text in &header.own_effects {
            let definition = Definition::parse(text, Path::new("effect.toml"))
                .map_err(|problems| WorkbenchError::OwnEffect(format!("{:?}", problems.first().map(|p| &p.fault))))?;
            register(definition).map_err(|e| WorkbenchError::OwnEffect(e.to_string()))?;
        }
        let given = match header.side_car.as_str() {
            "" => Vec::new(),
            text => SideCar::parse(text, Path::new("effects.toml"))?.effects,
        };
        let file = OsimFile::parse(model, "model.osim")?;
        let model = MusculoskeletalModel::compile(&file.spec, &header.setup.setup())?;
        let forward = ForwardModel::new(&file.spec, &model, &trials)?.with_given(given.clone());
        let is_plain = header.plain && given.is_empty();
        let plain = is_plain.then(|| prepared(&model, &trials)).transpose()?;
        Ok(Workbench { header, file, model, trials, forward, geometry, given, plain })
    }

    /// Parameters of all active muscles from three of each ([`super::case::three`]).
    ///
    /// # Errors
    /// Not so many muscles.
    pub fn parameters(&self, three: &[[f64; 3]]) -> Result<Vec<MuscleParameters>, WorkbenchError> {
        let nominal = self.model.nominal_parameters();
        if three.len() != nominal.len() {
            return Err(WorkbenchError::Muscles { expected: nominal.len(), found: three.len() });
        }
        let of = |(own, [force, fiber, tendon]): (MuscleParameters, &[f64; 3])| MuscleParameters {
            max_isometric_force: *force,
            optimal_fiber_length: *fiber,
            tendon_slack_length: *tendon,
            ..own
        };
        Ok(nominal.into_iter().zip(three).map(of).collect())
    }

    /// Effects by their identifiers; absent ones are left out.
    ///
    /// # Errors
    /// An unknown effect, or not as many values as it has parameters.
    pub fn settings(&self, effects: &[EffectOfCase]) -> Result<Vec<Setting>, WorkbenchError> {
        let of = |e: &EffectOfCase| {
            let known = effect(&e.id);
            let expected = known.map_or(0, |k| k.description().parameters.len());
            let found = e.values.len();
            let known = known.filter(|_| found == expected);
            let known = known.ok_or_else(|| WorkbenchError::Effect { id: e.id.clone(), expected, found })?;
            Ok(Setting { effect: known, values: e.values.clone() })
        };
        let all: Vec<Setting> = effects.iter().map(of).collect::<Result<_, WorkbenchError>>()?;
        Ok(all.into_iter().filter(|s| !s.is_absent()).collect())
    }

    /// Simulates all trials and compares them with what was measured.
    ///
    /// Steps of the integration are those of the model as given: the moments are within the integration's accuracy of
    /// those of [`Workbench::simulate_anew`].
    ///
    /// # Errors
    /// A muscle whose forces cannot be balanced.
    pub fn simulate(&self, muscles: &[MuscleParameters], effects: &[Setting]) -> Result<Simulated, WorkbenchError> {
        match &self.plain {
            Some(plain) if effects.is_empty() => {
                self.compared(simulate_plain(plain, muscles)?.into_iter().map(|t| t.moment))
            }
            _ => self.compared(simulate_all(&self.forward, muscles, effects)?.into_iter().map(|t| t.moment)),
        }
    }

    /// As [`Workbench::simulate`], of the model file with these muscles and effects written into it: what the program
    /// makes of the files of [`Workbench::export`].
    ///
    /// # Errors
    /// As there; a value that makes the model invalid.
    pub fn simulate_anew(
        &self,
        muscles: &[MuscleParameters],
        effects: &[Setting],
    ) -> Result<Simulated, WorkbenchError> {
        let (file, beside) = self.written(muscles, effects)?;
        let model = MusculoskeletalModel::compile(&file.spec, self.model.setup())?;
        let nominal = model.nominal_parameters();
        if self.plain.is_some() && effects.is_empty() {
            let plain = prepared(&model, &self.trials)?;
            return self.compared(simulate_plain(&plain, &nominal)?.into_iter().map(|t| t.moment));
        }
        let forward = ForwardModel::new(&file.spec, &model, &self.trials)?.with_given(beside);
        self.compared(simulate_all(&forward, &nominal, &[])?.into_iter().map(|t| t.moment))
    }

    fn compared(&self, moments: impl Iterator<Item = Vec<f64>>) -> Result<Simulated, WorkbenchError> {
        let moments: Vec<Vec<f64>> = moments.collect();
        let trials = self.trials.iter().zip(&moments);
        let errors =
            trials.map(|(t, moment)| TrialErrors::calc(&t.info, &t.moment, moment)).collect::<Result<_, _>>()?;
        Ok(Simulated { errors: Errors::of(&ErrorTable::from_trials(errors)), moments })
    }

    /// The model file with these muscles and effects, and what stands beside it: byte for byte what the program writes.
    ///
    /// # Errors
    /// A value that makes the model invalid.
    pub fn export(&self, muscles: &[MuscleParameters], effects: &[Setting]) -> Result<Exported, WorkbenchError> {
        let (file, effects) = self.written(muscles, effects)?;
        let side_car = SideCar { coordinate: self.header.setup.coordinate.clone(), effects };
        Ok(Exported {
            model: file.document.bytes().to_vec(),
            side_car: (!side_car.effects.is_empty()).then(|| side_car.to_toml()),
        })
    }

    /// The file with muscles and effects, and the effects beside it.
    fn written(
        &self,
        muscles: &[MuscleParameters],
        effects: &[Setting],
    ) -> Result<(OsimFile, Vec<Setting>), WorkbenchError> {
        let mut file = self.file.clone();
        let names: Vec<String> = self.model.muscle_names().map(String::from).collect();
        let arm_turns = self.trials.iter().any(|t| t.info.arm_flipped);
        let nominal = self.model.nominal_parameters();
        let beside = write_step(&mut file, self.model.setup(), &names, &nominal, muscles, effects, arm_turns)?;
        Ok((file, self.given.iter().cloned().chain(beside).collect()))
    }
}

/// The trials as the commands prepare them that add no effects.
fn prepared(model: &MusculoskeletalModel, trials: &[Trial]) -> Result<Vec<PreparedTrial>, SimulationError> {
    let recordings: Vec<Recording> = trials.iter().map(Recording::from).collect();
    model.prepare_all(&recordings, &Options { allow_angle_outside_range: true, ..Options::default() })
}

impl Errors {
    fn of(table: &ErrorTable) -> Errors {
        let means = |summary: &ErrorSummary, conditions| Means {
            trials: summary.trials,
            nrmse: summary.nrmse.mean.value(),
            rmse_n_m: summary.rmse_n_m.mean.value(),
            conditions,
        };
        let set = |set: &Option<carpus_simulation::evaluation::SetErrors>| {
            let set = set.as_ref()?;
            let conditions = set.conditions.iter().map(|c| (c.condition.label(), means(&c.errors, Vec::new())));
            Some(means(&set.overall, conditions.collect()))
        };
        Errors {
            nrmse: table.trials.iter().map(|t| t.errors.nrmse.value()).collect(),
            rmse_n_m: table.trials.iter().map(|t| t.errors.rmse_n_m.value()).collect(),
            train: set(&table.train),
            held_out: set(&table.held_out),
            mvc: set(&table.mvc),
        }
    }
}
