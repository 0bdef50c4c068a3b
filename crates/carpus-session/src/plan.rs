//! Further trials that would separate the explanations that survive, and what the trials at hand can tell.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value, json};

use super::candidates::{EffectSize, at_size, candidates, known};
use super::diagnosis_file::{self, KnownDiagnosis};
use super::diagnostic::{Diagnostic, Failure};
use super::output::OutputFolder;
use super::participant::Session;
use super::prepared::laboratory;
use super::provenance::DEFAULT_SEED;
use super::result_files::write_results;
use carpus_diagnosis::plan::plan;
use carpus_diagnosis::separability::{Distance, separability};
use carpus_diagnosis::separation::{Separation, most_useful};
use carpus_effects::answers::SEPARABLE_Z;
use carpus_effects::forward_model::ForwardModel;
use carpus_report::diagnosis::DiagnosisResult;
use carpus_report::results::{Results, rounded};

/// Effects that are told apart where the diagnosis leaves fewer than two.
const RIVALS: usize = 3;

/// A plan of further trials.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Seed of everything random.
    pub seed: u64,
    /// Identifiers of the effects to tell apart, at least two; none: those that the diagnosis leaves.
    pub rivals: Vec<String>,
}

impl Default for Plan {
    fn default() -> Self {
        Plan { seed: DEFAULT_SEED, rivals: Vec::new() }
    }
}

impl Plan {
    /// The effects to tell apart, as far as they are named.
    ///
    /// # Errors
    /// An unknown effect; a single one.
    pub fn named(&self) -> Result<Vec<&'static str>, Failure> {
        let named: Vec<&'static str> =
            self.rivals.iter().map(|id| known(id).map(|e| e.description().id)).collect::<Result<_, _>>()?;
        match named.len() {
            1 => Err(Diagnostic::error("--candidates: expected at least two effects to tell apart").into()),
            _ => Ok(named),
        }
    }
}

/// What further trials would do.
#[derive(Clone, Debug)]
pub struct Planned {
    /// Whose trials they are.
    pub participant: String,
    /// Every experiment that was simulated.
    pub separations: Vec<Separation>,
    /// The diagnosis that the plan goes on with, its experiments among it.
    pub diagnosis: KnownDiagnosis,
}

/// How far an effect of a size is from none and from every other in the trials at hand.
#[derive(Clone, Debug)]
pub struct Separability {
    /// Whose trials they are.
    pub participant: String,
    /// From what, and how far.
    pub distances: Vec<Distance>,
    /// What is written as `separability.json`.
    pub value: Value,
}

impl Session<'_> {
    /// Which further trials would tell explanations apart.
    ///
    /// - `forward`: [`super::diagnose::forward_model`] of the session, whose trials were read for a diagnosis
    /// - `diagnosis`: of the same trials
    ///
    /// # Errors
    /// An unknown effect; a trial that cannot be simulated.
    pub fn plan(&self, forward: &ForwardModel, diagnosis: KnownDiagnosis, request: &Plan) -> Result<Planned, Failure> {
        let (run, progress, mut diagnosis) = (&self.data, self.progress()?, diagnosis);
        let named = request.named()?;
        let rivals = if named.is_empty() { rivals(&diagnosis.result)? } else { named };
        let what = format!("planning {}", run.participant.name);
        progress.at(&what, 0, 1);
        let estimation = self.estimation(forward, candidates(&[])?, request.seed)?;
        let separations = plan(&estimation, laboratory(run), &rivals, &|done, all| progress.at(&what, done, all));
        progress.finished();
        let separations =
            separations.map_err(|e| Failure::from(Diagnostic::error(e.to_string()).in_file(&run.loaded.path)))?;
        if let Some(map) = diagnosis.value.as_object_mut() {
            let listed = most_useful(&separations).into_iter().map(short).collect();
            map.insert("separating_experiments".to_owned(), Value::Array(listed));
        }
        Ok(Planned { participant: run.participant.name.clone(), separations, diagnosis })
    }

    /// How far an effect of a size would be, in the trials at hand, from none and from every other effect.
    ///
    /// - `forward`: as in [`Session::plan`]
    ///
    /// # Errors
    /// An unknown effect or parameter; a size out of reach; a trial that cannot be simulated.
    pub fn separability(&self, forward: &ForwardModel, asked: &EffectSize, seed: u64) -> Result<Separability, Failure> {
        let (run, progress) = (&self.data, self.progress()?);
        let (truth, warnings) = at_size(asked, &forward.muscles, &forward.joint)?;
        warnings.iter().for_each(|warning| progress.warning(warning));
        let estimation = self.estimation(forward, candidates(&[])?, seed)?;
        let distances = separability(&estimation, &truth)
            .map_err(|e| Failure::from(Diagnostic::error(e.to_string()).in_file(&run.loaded.path)))?;
        let names = truth.effect.description().parameters.iter().map(|p| p.name);
        let size: BTreeMap<&str, f64> = names.zip(truth.effect.reported(&truth.values, &forward.muscles)).collect();
        let listed = distances.iter().map(|d| json!({ "rival": d.rival, "z": rounded(d.z, 3) }));
        let value = json!({
            "schema": "carpus.separability/1",
            "participant": run.participant.name,
            "effect": asked.id,
            "size": size,
            "separable_z": SEPARABLE_Z,
            "distances": listed.collect::<Vec<_>>(),
            "provenance": self.study.provenance(asked, seed, run.inputs.clone()),
        });
        Ok(Separability { participant: run.participant.name.clone(), distances, value })
    }
}

impl Planned {
    /// For programs.
    pub fn value(&self) -> Value {
        json!({ "participant": self.participant, "separating_experiments": self.separations })
    }

    /// Writes `plan.json`, and the most useful experiments into `diagnosis.json` and its report.
    ///
    /// - `folder`: the participant's, in the folder of the results
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder, folder: &Path) -> Result<(), Failure> {
        diagnosis_file::write(out, folder, &self.diagnosis.value)?;
        let all = json!({
            "schema": "carpus.plan/1",
            "participant": self.participant,
            "separable_z": SEPARABLE_Z,
            "experiments": self.separations.iter().map(short).collect::<Vec<_>>(),
        });
        let text = serde_json::to_string_pretty(&all).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
        out.write(folder.join("plan.json"), text.as_bytes())?;
        report_again(out, folder, &self.diagnosis.value)
    }
}

impl Separability {
    /// Writes `separability.json`.
    ///
    /// - `folder`: the participant's, in the folder of the results
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder, folder: &Path) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(&self.value).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
        out.write(folder.join("separability.json"), text.as_bytes())?;
        Ok(())
    }
}

/// An experiment as it is written.
fn short(s: &Separation) -> Value {
    json!({
        "trials": s.trials,
        "separates": s.separates,
        "z_now": rounded(s.z_now, 3),
        "z_then": rounded(s.z_then, 3),
    })
}

/// The effects to tell apart: those of the explanations, and the strongest others where these are fewer than two.
fn rivals(diagnosis: &DiagnosisResult) -> Result<Vec<&'static str>, Failure> {
    let mut ids: Vec<&'static str> = Vec::new();
    let mut add = |id: &str| -> Result<usize, Failure> {
        let id = known(id)?.description().id;
        if !ids.contains(&id) {
            ids.push(id);
        }
        Ok(ids.len())
    };
    let mut count = 0;
    for id in diagnosis.explanations.iter().flat_map(|e| &e.effects) {
        count = add(id)?;
    }
    let mut others: Vec<_> =
        diagnosis.candidates.iter().filter(|c| !diagnosis.not_testable.contains(&c.effect)).collect();
    others.sort_by(|a, b| b.score.unwrap_or(0.0).total_cmp(&a.score.unwrap_or(0.0)));
    let wanted = if count < 2 { RIVALS } else { count };
    for candidate in others {
        if count >= wanted {
            break;
        }
        count = add(&candidate.effect)?;
    }
    Ok(ids)
}

/// Writes the report of the diagnosis again, now that it has experiments.
fn report_again(out: &OutputFolder, folder: &Path, diagnosis: &Value) -> Result<(), Failure> {
    let Ok(text) = carpus_numerics::regular_file::read_text(&out.path().join(folder).join("results.json")) else {
        return Ok(());
    };
    let Ok(mut results) = Results::parse(&text) else { return Ok(()) };
    if results.diagnosis.is_some() {
        results.diagnosis = Some(diagnosis_file::result(diagnosis)?);
        write_results(out, folder, &results)?;
    }
    Ok(())
}
