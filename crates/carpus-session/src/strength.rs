//! Forces of flexors and extensors scaled to the maximum voluntary moments.

use std::path::Path;

use serde::Serialize;
use serde_json::{Value, json};

use super::account::{csv_text, warning_result};
use super::diagnostic::{Diagnostic, Failure};
use super::json::{pretty, value};
use super::model::Needs;
use super::output::OutputFolder;
use super::progress::Progress;
use super::provenance::{DEFAULT_SEED, input_file};
use super::study::{Study, scaling_refused};
use carpus_report::results::{InputFile, WarningResult};
use carpus_simulation::scaling::{
    GroupScaling, StrengthError, StrengthScaling, TargetSource, scale_participant, strength_scale,
};
use carpus_study::study::{Direction, Participant, named_file};

/// A scaling of forces; options stand in `[strength_scaling]` of study.toml.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StrengthScale {
    /// Whether the model is first scaled to the participant's lengths.
    pub linear: bool,
    /// Written into the results; nothing in it is random.
    pub seed: u64,
}

impl Default for StrengthScale {
    fn default() -> Self {
        StrengthScale { linear: false, seed: DEFAULT_SEED }
    }
}

/// Models whose forces are scaled.
#[derive(Clone, Debug)]
pub struct StrengthScaled {
    /// One for every participant.
    pub participants: Vec<ParticipantStrength>,
    /// What is written as `strength.json`.
    pub value: Value,
    /// Why participants' models could not be scaled.
    pub failed: Vec<Diagnostic>,
}

/// A participant's scaling.
#[derive(Clone, Debug, Serialize)]
pub struct ParticipantStrength {
    /// The participant.
    pub participant: String,
    /// The scaled model, in the folder of the results.
    pub model: String,
    /// Functional groups.
    pub groups: Vec<Group>,
    /// Muscles that were left as they are.
    pub unscaled: Vec<String>,
    /// What a person should know.
    pub warnings: Vec<WarningResult>,
    #[serde(skip)]
    inputs: Vec<InputFile>,
}

/// A functional group: the flexors or the extensors.
#[derive(Clone, Debug, Serialize)]
pub struct Group {
    /// Its direction.
    pub direction: Direction,
    /// Posture of the maximum contraction.
    pub angle_deg: f64,
    /// Maximum voluntary moment.
    pub target_n_m: f64,
    /// Where that is from.
    pub source: TargetSource,
    /// Moment of the group, fully active, before.
    pub before_n_m: f64,
    /// Factor of its maximum isometric forces.
    pub factor: f64,
    /// Its muscles.
    pub muscles: Vec<Muscle>,
}

/// A muscle of a group.
#[derive(Clone, Debug, Serialize)]
pub struct Muscle {
    /// Its name.
    pub muscle: String,
    /// Moment arm in the posture.
    pub moment_arm_m: f64,
    /// Tendon force, fully active, before.
    pub tendon_force_before_n: f64,
    /// Maximum isometric force before.
    pub max_isometric_force_before_n: f64,
    /// Maximum isometric force of the scaled model.
    pub max_isometric_force_n: f64,
}

impl Study {
    /// Scales the forces of every participant's model and writes it: `P01/model.osim`, and `strength.csv` and
    /// `strength.json` of all.
    ///
    /// - `out`: [`Study::output_folder`] of `carpus strength-scale`
    ///
    /// # Errors
    /// No participant whose model could be scaled; the disk; a request to stop.
    pub fn strength_scale(
        &self,
        request: &StrengthScale,
        out: &OutputFolder,
        progress: &dyn Progress,
    ) -> Result<StrengthScaled, Failure> {
        let outcomes = self.each("scaling", progress, |participant| {
            scaled(self, participant.about(), request.linear, out, progress)
        })?;
        let done = outcomes.done;
        let mut inputs: Vec<InputFile> = Vec::new();
        for file in done.iter().flat_map(|outcome| &outcome.inputs) {
            if !inputs.contains(file) {
                inputs.push(file.clone());
            }
        }
        let value = value(&json!({
            "schema": "carpus.strength/1",
            "provenance": self.provenance(request, request.seed, inputs),
            "participants": done,
        }))?;
        out.write("strength.csv", csv(&done)?.as_bytes())?;
        out.write("strength.json", pretty(&value)?.as_bytes())?;
        Ok(StrengthScaled { participants: done, value, failed: outcomes.failed })
    }
}

fn scaled(
    study: &Study,
    participant: &Participant,
    linear: bool,
    out: &OutputFolder,
    progress: &dyn Progress,
) -> Result<ParticipantStrength, Failure> {
    let mut warnings: Vec<Diagnostic> = study.tables.warnings.iter().map(Diagnostic::from).collect();
    let loaded = study.load_model(participant, Needs::Trials { passive: false }, &mut warnings)?;
    let mut file = loaded.file.clone();
    if linear {
        let settings = study.tables.settings.scaling.as_ref();
        scale_participant(&mut file, settings, participant)
            .map_err(|e| scaling_refused(&e, &study.tables.file, &loaded.path))?;
    }
    let scaling = strength_scale(&mut file, &study.tables, participant).map_err(|e| refused(e, &loaded.path))?;
    if !scaling.unscaled.is_empty() {
        let text = format!("{}: not scaled: {}", participant.name, scaling.unscaled.join(", "));
        let hint = "no moment arm in the posture, or no maximum moment in their direction";
        warnings.push(Diagnostic::warning(text).hint(hint));
    }
    progress.warnings(&warnings);
    let name = Path::new(&participant.name).join("model.osim");
    out.write(&name, file.document.bytes())?;
    Ok(ParticipantStrength {
        participant: participant.name.clone(),
        model: name.display().to_string(),
        groups: scaling.groups.iter().map(group).collect(),
        inputs: inputs(study, participant, &loaded.path, &scaling)?,
        unscaled: scaling.unscaled,
        warnings: warnings.iter().map(warning_result).collect(),
    })
}

/// The model, the study's tables, and the trials that a moment was taken from.
fn inputs(
    study: &Study,
    participant: &Participant,
    model: &Path,
    scaling: &StrengthScaling,
) -> Result<Vec<InputFile>, Failure> {
    let mut inputs = study.inputs(participant, model, &[])?;
    for group in &scaling.groups {
        if let TargetSource::Trial(file) = &group.source {
            let path = named_file(&study.tables.folder, file);
            inputs.push(input_file(&path, file, "trial")?);
        }
    }
    Ok(inputs)
}

/// What to tell about a scaling that failed.
pub(super) fn refused(error: StrengthError, model: &Path) -> Failure {
    let hint = error.hint();
    let message = match error {
        StrengthError::Study(errors) => return errors.into(),
        StrengthError::Simulation(_) | StrengthError::Muscle(_) | StrengthError::Equilibrium(_) => {
            Diagnostic::error(error.to_string()).in_file(model)
        }
        _ => Diagnostic::error(error.to_string()),
    };
    hint.into_iter().fold(message, Diagnostic::hint).into()
}

fn group(group: &GroupScaling) -> Group {
    Group {
        direction: group.direction,
        angle_deg: group.angle.to_degrees(),
        target_n_m: group.target,
        source: group.source.clone(),
        before_n_m: group.before,
        factor: group.factor,
        muscles: group
            .muscles
            .iter()
            .map(|m| Muscle {
                muscle: m.name.clone(),
                moment_arm_m: m.moment_arm,
                tendon_force_before_n: m.tendon_force,
                max_isometric_force_before_n: m.before,
                max_isometric_force_n: m.after,
            })
            .collect(),
    }
}

fn csv(outcomes: &[ParticipantStrength]) -> Result<String, Failure> {
    let header = [
        "participant",
        "direction",
        "angle_deg",
        "target_n_m",
        "before_n_m",
        "factor",
        "muscle",
        "moment_arm_m",
        "max_isometric_force_before_n",
        "max_isometric_force_n",
    ];
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.groups.iter().flat_map(move |g| {
            g.muscles.iter().map(move |m| {
                let numbers = [g.angle_deg, g.target_n_m, g.before_n_m, g.factor];
                let mut row = vec![outcome.participant.clone(), g.direction.word().to_string()];
                row.extend(numbers.map(|v| v.to_string()));
                row.push(m.muscle.clone());
                let numbers = [m.moment_arm_m, m.max_isometric_force_before_n, m.max_isometric_force_n];
                row.extend(numbers.map(|v| v.to_string()));
                row
            })
        })
    });
    csv_text(header.iter(), rows)
}
