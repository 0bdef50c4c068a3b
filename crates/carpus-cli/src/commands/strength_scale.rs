//! `carpus strength-scale`: forces of flexors and extensors scaled to the maximum voluntary moments.

use std::path::Path;

use serde::Serialize;

use crate::args::{Global, StrengthScaleArgs};
use crate::failure::{self, Diagnostic, Failure};
use crate::provenance::provenance;
use crate::study_run::StudyRun;
use crate::table::{fixed, table};
use carpus_report::results::{InputFile, WarningResult};
use carpus_session::account::{csv_text, warning_result};
use carpus_session::model::Needs;
use carpus_session::study::scaling_refused;
use carpus_simulation::scaling::{
    GroupScaling, StrengthError, StrengthScaling, TargetSource, scale_participant, strength_scale,
};
use carpus_study::study::{Direction, Participant, named_file};

/// A participant's scaling.
#[derive(Serialize)]
struct Outcome {
    participant: String,
    model: String,
    groups: Vec<Group>,
    unscaled: Vec<String>,
    warnings: Vec<WarningResult>,
    #[serde(skip)]
    inputs: Vec<InputFile>,
}

#[derive(Serialize)]
struct Group {
    direction: Direction,
    angle_deg: f64,
    target_n_m: f64,
    source: TargetSource,
    before_n_m: f64,
    factor: f64,
    muscles: Vec<Muscle>,
}

#[derive(Serialize)]
struct Muscle {
    muscle: String,
    moment_arm_m: f64,
    tendon_force_before_n: f64,
    max_isometric_force_before_n: f64,
    max_isometric_force_n: f64,
}

/// Runs the command.
///
/// # Errors
/// The study, its models and MVC trials, or the output folder.
pub fn run(args: &StrengthScaleArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study, "strength-scale")?;
    let outcomes = study.each(|participant| scaled(&study, participant, args.linear))?;
    let done = &outcomes.done;
    let mut inputs: Vec<InputFile> = Vec::new();
    for file in done.iter().flat_map(|outcome| &outcome.inputs) {
        if !inputs.contains(file) {
            inputs.push(file.clone());
        }
    }
    let results = serde_json::json!({
        "schema": "carpus.strength/1",
        "provenance": provenance(global, inputs),
        "participants": done,
    });
    let json = serde_json::to_string_pretty(&results).map_err(|e| Failure::Internal(e.to_string()))?;
    study.out.write("strength.csv", csv(done)?.as_bytes())?;
    study.out.write("strength.json", json.as_bytes())?;
    let text = if global.json { results.to_string() } else { readable(done, study.out.path()) };
    outcomes.print(&study, "strength-scale", &text)
}

fn scaled(study: &StudyRun, participant: &Participant, linear: bool) -> Result<Outcome, Failure> {
    let mut warnings: Vec<Diagnostic> = study.study.tables.warnings.iter().map(Diagnostic::from).collect();
    let loaded = study.study.load_model(participant, Needs::Motion, &mut warnings)?;
    let mut file = loaded.file.clone();
    if linear {
        let settings = study.study.tables.settings.scaling.as_ref();
        scale_participant(&mut file, settings, participant)
            .map_err(|e| scaling_refused(&e, &study.study.tables.file, &loaded.path))?;
    }
    let scaling = strength_scale(&mut file, &study.study.tables, participant).map_err(|e| refused(e, &loaded.path))?;
    if !scaling.unscaled.is_empty() {
        let text = format!("{}: not scaled: {}", participant.name, scaling.unscaled.join(", "));
        let hint = "no moment arm in the posture, or no maximum moment in their direction";
        warnings.push(Diagnostic::warning(text).hint(hint));
    }
    failure::print(&warnings);
    let name = Path::new(&participant.name).join("model.osim");
    study.out.write(&name, file.document.bytes())?;
    Ok(Outcome {
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
    study: &StudyRun,
    participant: &Participant,
    model: &Path,
    scaling: &StrengthScaling,
) -> Result<Vec<InputFile>, Failure> {
    let mut inputs = study.study.inputs(participant, model, &[])?;
    for group in &scaling.groups {
        if let TargetSource::Trial(file) = &group.source {
            let path = named_file(&study.study.tables.folder, file);
            inputs.push(carpus_session::provenance::input_file(&path, file, "trial")?);
        }
    }
    Ok(inputs)
}

/// What to tell about a scaling that failed.
pub fn refused(error: StrengthError, model: &Path) -> Failure {
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

fn csv(outcomes: &[Outcome]) -> Result<String, Failure> {
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

fn readable(outcomes: &[Outcome], folder: &Path) -> String {
    let header = ["participant", "group", "muscles", "angle °", "before N·m", "MVC N·m", "factor"];
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.groups.iter().map(move |g| {
            let muscles: Vec<&str> = g.muscles.iter().map(|m| m.muscle.as_str()).collect();
            vec![
                outcome.participant.clone(),
                g.direction.word().to_string(),
                muscles.join(" "),
                fixed(g.angle_deg, 1),
                fixed(g.before_n_m, 3),
                fixed(g.target_n_m, 3),
                fixed(g.factor, 4),
            ]
        })
    });
    let mut text = table(&header, 3, rows);
    text.push_str("\n\n");
    for outcome in outcomes {
        text.push_str(&format!("{}\n", folder.join(&outcome.model).display()));
    }
    text
}
