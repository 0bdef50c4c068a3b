//! `diagnosis.json`: written with the files it is about, and used again only for the same files.

use std::path::Path;

use serde_json::Value;

use super::diagnostic::Failure;
use super::output::OutputFolder;
use carpus_diagnosis::diagnose::Outcome;
use carpus_report::diagnosis::DiagnosisResult;
use carpus_report::results::{InputFile, Provenance};

/// A diagnosis of the files at hand.
#[derive(Clone, Debug)]
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
pub fn value(outcome: &Outcome, provenance: &Provenance, restricted: &[String]) -> Result<Value, Failure> {
    let internal = |e: serde_json::Error| Failure::Internal(e.to_string());
    let mut value = serde_json::to_value(&outcome.diagnosis).map_err(internal)?;
    if let Some(map) = value.as_object_mut() {
        map.insert("provenance".to_owned(), serde_json::to_value(provenance).map_err(internal)?);
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
pub fn write(out: &OutputFolder, folder: &Path, value: &Value) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
    out.write(folder.join("diagnosis.json"), text.as_bytes())?;
    for (i, definition) in definitions(value).enumerate() {
        out.write(folder.join(proposal_file(i)), definition.as_bytes())?;
    }
    Ok(())
}

/// Definitions of the proposed formulas.
pub(super) fn definitions(value: &Value) -> impl Iterator<Item = &str> {
    let proposals = value.get("proposals").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    proposals.iter().filter_map(|p| p.get("definition")?.as_str())
}

/// Name of the file of a proposed formula.
pub fn proposal_file(place: usize) -> String {
    format!("proposal_{}.toml", place + 1)
}

/// A diagnosis that was made of the same bytes, with the same seed and version; `None` if there is none.
pub(super) fn read(file: &Path, inputs: &[InputFile], seed: u64) -> Option<KnownDiagnosis> {
    let value: Value = serde_json::from_str(&carpus_numerics::regular_file::read_text(file).ok()?).ok()?;
    let made: Provenance = serde_json::from_value(value.get("provenance")?.clone()).ok()?;
    let all = value.get("restricted_to")?.as_array()?.is_empty();
    let bytes = |files: &[InputFile]| {
        let mut bytes: Vec<_> = files.iter().map(|f| (f.role.clone(), f.sha256.clone())).collect();
        bytes.sort();
        bytes
    };
    let same = made.version == env!("CARGO_PKG_VERSION") && made.seed == seed;
    if !(all && same && bytes(&made.inputs) == bytes(inputs)) {
        return None;
    }
    let result = serde_json::from_value(value.clone()).ok()?;
    Some(KnownDiagnosis { value, result })
}
