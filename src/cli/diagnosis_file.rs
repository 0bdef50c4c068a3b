//! `diagnosis.json`: written with the files it is about, and used again only for the same files.

use std::path::Path;

use serde_json::Value;

use super::args::Global;
use super::commands::diagnose::{candidates, diagnosed, with_models};
use super::failure::{self, Failure, Message};
use super::provenance::provenance;
use super::study_run::{ParticipantRun, StudyRun};
use crate::diagnosis::diagnose::Outcome;
use crate::diagnosis::forward_model::ForwardModel;
use crate::report::diagnosis::DiagnosisResult;
use crate::report::results::{InputFile, Provenance};

/// A diagnosis of the files at hand.
pub struct KnownDiagnosis {
    /// As it was written, with all keys.
    pub value: Value,
    /// What of it commands and pages use.
    pub result: DiagnosisResult,
}

/// A diagnosis as it is written: with what it is about.
///
/// - `restricted`: effects it was restricted to; empty: the whole catalogue
///
/// # Errors
/// None that input can cause.
pub fn value(
    outcome: &Outcome,
    run: &ParticipantRun,
    restricted: &[String],
    global: &Global,
) -> Result<Value, Failure> {
    let internal = |e: serde_json::Error| Failure::Internal(e.to_string());
    let mut value = serde_json::to_value(&outcome.diagnosis).map_err(internal)?;
    if let Some(map) = value.as_object_mut() {
        let provenance = serde_json::to_value(provenance(global, run.inputs.clone())).map_err(internal)?;
        map.insert("provenance".to_owned(), provenance);
        map.insert("restricted_to".to_owned(), restricted.into());
    }
    Ok(value)
}

/// What commands and pages use of a diagnosis.
///
/// # Errors
/// None that input can cause.
pub fn result(value: &Value) -> Result<DiagnosisResult, Failure> {
    serde_json::from_value(value.clone()).map_err(|e| Failure::Internal(format!("diagnosis: {e}")))
}

/// Writes a diagnosis, and each formula that it proposes as an effect's file.
///
/// # Errors
/// The disk.
pub fn write(study: &StudyRun, participant: &str, value: &Value) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
    study.out.write(format!("{participant}/diagnosis.json"), text.as_bytes())?;
    for (i, definition) in definitions(value).enumerate() {
        study.out.write(format!("{participant}/{}", proposal_file(i)), definition.as_bytes())?;
    }
    Ok(())
}

/// Definitions of the proposed formulas.
fn definitions(value: &Value) -> impl Iterator<Item = &str> {
    let proposals = value.get("proposals").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    proposals.iter().filter_map(|p| p.get("definition")?.as_str())
}

/// Name of the file of a proposed formula.
pub fn proposal_file(place: usize) -> String {
    format!("proposal_{}.toml", place + 1)
}

/// The diagnosis of these files by the whole catalogue: the one in the output folder if it is of the same bytes, else a
/// new one, which is written there.
///
/// # Errors
/// A trial that cannot be simulated; the disk.
pub fn known_or_made(
    study: &StudyRun,
    run: &ParticipantRun,
    forward: &ForwardModel,
    global: &Global,
) -> Result<KnownDiagnosis, Failure> {
    let name = &run.participant.name;
    let file = study.out.path().join(name).join("diagnosis.json");
    if let Some((value, result)) = read(&file, &run.inputs, global) {
        for file in ["diagnosis.json", "results.json", "report.html", "error.svg"] {
            study.out.keep(Path::new(name).join(file));
        }
        for (i, _) in definitions(&value).enumerate() {
            study.out.keep(Path::new(name).join(proposal_file(i)));
        }
        return Ok(KnownDiagnosis { value, result });
    }
    if file.exists() {
        let text =
            "is of other files, another seed or another version, or leaves effects out: the data are diagnosed anew";
        failure::print(&[Message::warning(text).in_file(&file)]);
    }
    let outcome = diagnosed(study, run, forward, candidates(&[])?, global)?;
    let value = value(&outcome, run, &[], global)?;
    write(study, name, &value)?;
    let results = with_models(study, run, forward, &outcome, &value, global)?;
    super::commands::simulate::write_results(study, Path::new(name), &results)?;
    let result = result(&value)?;
    Ok(KnownDiagnosis { value, result })
}

/// A diagnosis that was made of the same bytes, with the same seed and version; `None` if there is none.
fn read(file: &Path, inputs: &[InputFile], global: &Global) -> Option<(Value, DiagnosisResult)> {
    let value: Value = serde_json::from_str(&crate::regular_file::read_text(file).ok()?).ok()?;
    let made: Provenance = serde_json::from_value(value.get("provenance")?.clone()).ok()?;
    let all = value.get("restricted_to")?.as_array()?.is_empty();
    let bytes = |files: &[InputFile]| {
        let mut bytes: Vec<_> = files.iter().map(|f| (f.role.clone(), f.sha256.clone())).collect();
        bytes.sort();
        bytes
    };
    let same = made.version == env!("CARGO_PKG_VERSION") && made.seed == global.seed;
    if !(all && same && bytes(&made.inputs) == bytes(inputs)) {
        return None;
    }
    let result = serde_json::from_value(value.clone()).ok()?;
    Some((value, result))
}
