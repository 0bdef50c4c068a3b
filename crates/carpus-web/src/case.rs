//! What a page carries: the model file, the trials as fits see them, and what was fitted already.
//!
//! As bytes: length of the header (four bytes, the lowest first), the header (JSON), the model file, the columns of
//! every trial, bone geometry.

use serde::{Deserialize, Serialize};

use super::columns;
use carpus_numerics::signals::OwnSamples;
use carpus_simulation::simulation::{HeldCoordinate, MuscleParameters, Setup};
use carpus_study::study::{
    Contraction, Direction, MomentPart, ParameterBounds, PostureCoordinate, Trial, TrialInfo, TrialUse,
};

/// Schema of the header.
pub const CASE_SCHEMA: &str = "carpus.case/1";

/// A participant's model, trials and earlier fits.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Everything but the long parts.
    pub header: Header,
    /// The model file.
    pub model: Vec<u8>,
    /// The trials, in the order of recording.
    pub trials: Vec<Trial>,
    /// Bone geometry for drawing; empty: there is none.
    pub geometry: Vec<u8>,
}

/// A case without model file and samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// [`CASE_SCHEMA`].
    pub schema: String,
    /// Name of the study.
    pub study: String,
    /// Name of the participant.
    pub participant: String,
    /// Bytes of the model file.
    pub model_bytes: usize,
    /// Bytes of bone geometry.
    #[serde(default)]
    pub geometry_bytes: usize,
    /// What of the model is simulated.
    pub setup: SetupOfCase,
    /// Bounds of the muscles' parameters.
    pub bounds: ParameterBounds,
    /// Largest moment of the session [N·m].
    pub mvc: f64,
    /// Seed of random draws.
    pub seed: u64,
    /// Texts of the effects that the laboratory has defined.
    pub own_effects: Vec<String>,
    /// Effects beside the model, as in `effects.toml`; empty: there are none.
    pub side_car: String,
    /// Fascicle lengths of images that inform fits.
    pub images: Vec<ImageOfCase>,
    /// Without effects, trials are simulated as `carpus compare` and `carpus personalize` do: paths are tabulated over
    /// the recorded angles alone, not over those that effects may reach.
    pub plain: bool,
    /// Trials were averaged to fewer samples.
    pub averaged: bool,
    /// The trials without their samples.
    pub trials: Vec<TrialOfCase>,
    /// Models to go back to: what was fitted before.
    pub states: Vec<StateOfCase>,
}

/// What of a model is simulated ([`Setup`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "fields of Setup")]
pub struct SetupOfCase {
    pub coordinate: String,
    pub posture: Vec<(String, f64)>,
    pub active_muscles: Vec<String>,
    pub parts: Vec<MomentPart>,
    pub dynamometer_damping: f64,
    pub allow_unsupported: bool,
}

/// A fascicle length measured in an image ([`carpus_diagnosis::inference::resting_fiber::RestingFiber`]).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "fields of RestingFiber")]
pub struct ImageOfCase {
    pub muscle: usize,
    pub path_length: f64,
    pub activation: f64,
    pub measured: f64,
    pub standard_deviation: f64,
}

/// A trial without its samples ([`TrialInfo`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "fields of TrialInfo")]
pub struct TrialOfCase {
    pub samples: usize,
    pub name: String,
    pub file: String,
    pub place: usize,
    pub contraction: Contraction,
    pub effort_percent: Option<f64>,
    pub direction: Direction,
    pub posture: Option<f64>,
    pub repetition: Option<u32>,
    #[serde(rename = "use")]
    pub usage: TrialUse,
    pub start_time: Option<f64>,
    pub arm_flipped: bool,
    #[serde(default)]
    pub held: Vec<(String, f64)>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment_samples: Option<OwnSamples>,
}

/// Muscles and effects to go back to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StateOfCase {
    /// How people call it.
    pub label: String,
    /// Maximum isometric force [N], optimal fibre length [m], tendon slack length [m] of every active muscle.
    pub muscles: Vec<[f64; 3]>,
    /// Intervals of the same; empty where none were estimated.
    pub intervals: Vec<[[f64; 2]; 3]>,
    /// Effects with the values of their parameters.
    pub effects: Vec<EffectOfCase>,
}

/// An effect and its values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EffectOfCase {
    /// Identifier.
    pub id: String,
    /// In the order of its parameters, in SI units.
    pub values: Vec<f64>,
    /// 95 % intervals of the same as reported; empty where none were estimated.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub intervals: Vec<[f64; 2]>,
}

/// Why bytes are no case.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// They end early, or a number is out of reach.
    #[error("the data of this page are damaged: {0}")]
    Damaged(&'static str),
    /// Not a header of this schema.
    #[error("the data of this page are damaged: {0}")]
    Header(#[from] serde_json::Error),
    /// Of another version.
    #[error("schema `{found}`, expected `{CASE_SCHEMA}`")]
    Schema {
        /// The schema that was found.
        found: String,
    },
}

impl Case {
    /// The case as bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let header = serde_json::to_vec(&self.header).unwrap_or_default();
        let mut out = (header.len() as u32).to_le_bytes().to_vec();
        out.extend(header);
        out.extend(&self.model);
        for trial in &self.trials {
            let own = [&trial.time, &trial.angle, &trial.moment];
            own.into_iter().chain(&trial.excitation).for_each(|column| columns::write(column, &mut out));
        }
        out.extend(&self.geometry);
        out
    }

    /// Reads a case.
    ///
    /// # Errors
    /// [`CaseError`].
    pub fn parse(bytes: &[u8]) -> Result<Case, CaseError> {
        let (length, rest) = bytes.split_first_chunk::<4>().ok_or(CaseError::Damaged("no header"))?;
        let (header, rest) =
            rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or(CaseError::Damaged("header"))?;
        let header: Header = serde_json::from_slice(header)?;
        if header.schema != CASE_SCHEMA {
            return Err(CaseError::Schema { found: header.schema });
        }
        let (model, mut rest) = rest.split_at_checked(header.model_bytes).ok_or(CaseError::Damaged("model"))?;
        let mut column = |count: usize| columns::read(&mut rest, count).ok_or(CaseError::Damaged("samples"));
        let mut trials = Vec::with_capacity(header.trials.len());
        for of_case in &header.trials {
            let [time, angle, moment] = [column(of_case.samples)?, column(of_case.samples)?, column(of_case.samples)?];
            let muscles = header.setup.active_muscles.iter();
            let excitation = muscles.map(|_| column(of_case.samples)).collect::<Result<_, _>>()?;
            let info = of_case.info(&header.participant, trials.len());
            let mut trial = Trial::from_samples(info, time, angle, moment, excitation);
            trial.moment_samples = of_case.moment_samples.clone();
            trials.push(trial);
        }
        let geometry = rest.get(..header.geometry_bytes).ok_or(CaseError::Damaged("geometry"))?.to_vec();
        Ok(Case { model: model.to_vec(), trials, geometry, header })
    }
}

impl SetupOfCase {
    /// What a setup says.
    pub fn of(setup: &Setup) -> SetupOfCase {
        SetupOfCase {
            coordinate: setup.coordinate.clone(),
            posture: setup.posture.iter().map(|h| (h.coordinate.clone(), h.value_deg_or_m)).collect(),
            active_muscles: setup.active_muscles.clone(),
            parts: setup.parts.clone(),
            dynamometer_damping: setup.dynamometer_damping,
            allow_unsupported: setup.allow_unsupported,
        }
    }

    /// The setup.
    pub fn setup(&self) -> Setup {
        let held = |(coordinate, value): &(String, f64)| HeldCoordinate {
            coordinate: coordinate.clone(),
            value_deg_or_m: *value,
        };
        Setup {
            coordinate: self.coordinate.clone(),
            posture: self.posture.iter().map(held).collect(),
            active_muscles: self.active_muscles.clone(),
            parts: self.parts.clone(),
            dynamometer_damping: self.dynamometer_damping,
            allow_unsupported: self.allow_unsupported,
        }
    }
}

impl TrialOfCase {
    /// A trial without its samples.
    pub fn of(trial: &Trial) -> TrialOfCase {
        let info = &trial.info;
        TrialOfCase {
            samples: trial.len(),
            name: info.name.clone(),
            file: info.file_as_written.clone(),
            place: info.place,
            contraction: info.contraction,
            effort_percent: info.effort_percent,
            direction: info.direction,
            posture: info.posture,
            repetition: info.repetition,
            usage: info.usage,
            start_time: info.start_time,
            arm_flipped: info.arm_flipped,
            held: info.held.iter().map(|h| (h.coordinate.clone(), h.value_deg_or_m)).collect(),
            moment_samples: trial.moment_samples.clone(),
        }
    }

    fn info(&self, participant: &str, index: usize) -> TrialInfo {
        let held = |(coordinate, value): &(String, f64)| PostureCoordinate {
            coordinate: coordinate.clone(),
            line: 0,
            value_deg_or_m: *value,
        };
        TrialInfo {
            index,
            place: self.place,
            line: 0,
            name: self.name.clone(),
            participant: participant.to_owned(),
            file: self.file.clone().into(),
            file_as_written: self.file.clone(),
            contraction: self.contraction,
            effort_percent: self.effort_percent,
            direction: self.direction,
            posture: self.posture,
            held: self.held.iter().map(held).collect(),
            repetition: self.repetition,
            usage: self.usage,
            start_time: self.start_time,
            arm_flipped: self.arm_flipped,
            emg_file: None,
            table: None,
            emg_table: None,
        }
    }
}

/// A muscle's parameters as a page has them: maximum isometric force, optimal fibre length, tendon slack length.
pub fn three(p: &MuscleParameters) -> [f64; 3] {
    [p.max_isometric_force, p.optimal_fiber_length, p.tendon_slack_length]
}
