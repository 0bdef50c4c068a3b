//! What is known of every participant: muscle parameters, sizes of effects, values of a table.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::diagnostic::{Diagnostic, Failure};
use crate::provenance::input_file;
use carpus_diagnosis::cohort::CohortDiagnosis;
use carpus_numerics::regular_file::read_text;
use carpus_report::identifiability::{IDENTIFIABILITY_SCHEMA, IdentifiabilityResult};
use carpus_report::results::InputFile;
use carpus_study::study::Participant;

/// What a quantity is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum QuantityKind {
    /// A muscle parameter as a factor of the model's value, compared by its logarithm.
    MuscleParameter,
    /// The size of an effect.
    Effect,
    /// A column of a table.
    Value,
}

/// A number of every participant.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// What it is.
    pub kind: QuantityKind,
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// By participant, in the study's order; `None`: not known.
    pub values: Vec<Option<f64>>,
    /// Mean share of the prior variance that the data removed, of muscle parameters.
    pub share_from_data: Option<f64>,
}

/// All quantities, and the files that they are from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quantities {
    /// In the order of the files.
    pub all: Vec<Quantity>,
    /// The files.
    pub inputs: Vec<InputFile>,
}

impl Quantities {
    /// Reads what there is in folders of results: `PARTICIPANT/identifiability.json`, `cohort.json`.
    ///
    /// - `study`: its name
    ///
    /// # Errors
    /// A folder with neither; a file that is none of these.
    pub fn read_results(
        &mut self,
        study: &str,
        folders: &[PathBuf],
        participants: &[Participant],
    ) -> Result<(), Failure> {
        for folder in folders {
            let before = self.inputs.len();
            for (i, participant) in participants.iter().enumerate() {
                let file = folder.join(&participant.name).join("identifiability.json");
                if file.exists() {
                    self.muscle_parameters(study, &file, i, participants)?;
                }
            }
            let cohort = folder.join("cohort.json");
            if cohort.exists() {
                self.effects(&cohort, participants)?;
            }
            if self.inputs.len() == before {
                let hint = "give folders that carpus identify, or carpus diagnose of several participants, wrote for this \
                            study";
                let text = "no identifiability.json of a participant of the study, and no cohort.json";
                return Err(Diagnostic::error(text).in_file(folder).hint(hint).into());
            }
        }
        // A sum so far.
        for quantity in &mut self.all {
            let known = quantity.values.iter().flatten().count();
            quantity.share_from_data = quantity.share_from_data.map(|sum| sum / known as f64);
        }
        Ok(())
    }

    /// Reads a table with a row a participant.
    ///
    /// - `file`: a column `participant`, and columns of numbers; empty cells are not known
    /// - `all`: participants of the study; those that are not asked for are passed over
    ///
    /// # Errors
    /// No such column; a participant that the study does not have, or twice; a cell that is no number.
    pub fn read_table(
        &mut self,
        file: &Path,
        all: &[Participant],
        participants: &[Participant],
    ) -> Result<(), Failure> {
        let text = read_text(file).map_err(|e| Diagnostic::error(format!("cannot be read: {e}")).in_file(file))?;
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
        let refused = |e: csv::Error| Diagnostic::error(e.to_string()).in_file(file);
        let header = reader.headers().map_err(refused)?.clone();
        let Some(of_name) = header.iter().position(|h| h == "participant") else {
            let text =
                format!("expected a column `participant`, found: {}", header.iter().collect::<Vec<_>>().join(", "));
            return Err(Diagnostic::error(text).in_file(file).at_line(1).into());
        };
        let columns: Vec<usize> = (0..header.len()).filter(|c| *c != of_name).collect();
        let mut values = vec![vec![None; participants.len()]; header.len()];
        let mut seen = vec![false; participants.len()];
        let mut faults = Vec::new();
        for record in reader.records() {
            let record = record.map_err(refused)?;
            let line = record.position().map_or(0, |p| p.line() as usize);
            let mut fault = |text: String| faults.push(Diagnostic::error(text).in_file(file).at_line(line));
            let name = record.get(of_name).unwrap_or_default();
            let Some(i) = participants.iter().position(|p| p.name == name) else {
                if !all.iter().any(|p| p.name == name) {
                    fault(format!("the study has no participant `{name}`"));
                }
                continue;
            };
            if std::mem::replace(&mut seen[i], true) {
                fault(format!("participant `{name}` twice"));
            }
            for c in &columns {
                let cell = record.get(*c).unwrap_or_default();
                match cell.parse::<f64>() {
                    Ok(value) if value.is_finite() => values[*c][i] = Some(value),
                    _ if cell.is_empty() => {}
                    _ => fault(format!("column `{}`: expected a number, found `{cell}`", &header[*c])),
                }
            }
        }
        if !faults.is_empty() {
            return Err(Failure::Input(faults));
        }
        self.all.extend(columns.iter().map(|c| Quantity {
            kind: QuantityKind::Value,
            name: header[*c].to_owned(),
            unit: String::new(),
            values: std::mem::take(&mut values[*c]),
            share_from_data: None,
        }));
        self.inputs.push(input_file(file, &file.display().to_string(), "values")?);
        Ok(())
    }

    /// The place of a quantity, made where it is not there yet.
    fn place(&mut self, kind: QuantityKind, name: &str, unit: &str, participants: usize) -> &mut Quantity {
        let known = self.all.iter().position(|q| q.kind == kind && q.name == name);
        let place = known.unwrap_or_else(|| {
            let (name, unit, values) = (name.to_owned(), unit.to_owned(), vec![None; participants]);
            self.all.push(Quantity { kind, name, unit, values, share_from_data: None });
            self.all.len() - 1
        });
        &mut self.all[place]
    }

    fn muscle_parameters(
        &mut self,
        study: &str,
        file: &Path,
        of: usize,
        participants: &[Participant],
    ) -> Result<(), Failure> {
        let fault = |what: String| Diagnostic::error(what).in_file(file).hint("is it what carpus identify wrote?");
        let text = read_text(file).map_err(|e| fault(format!("cannot be read: {e}")))?;
        let result: IdentifiabilityResult =
            serde_json::from_str(&text).map_err(|e| fault(format!("not a result of carpus identify: {e}")))?;
        if result.schema != IDENTIFIABILITY_SCHEMA {
            return Err(fault(format!("schema `{}`, expected `{IDENTIFIABILITY_SCHEMA}`", result.schema)).into());
        }
        if result.study != study {
            let text = format!("is of the study `{}`, not of `{study}`", result.study);
            return Err(Diagnostic::error(text).in_file(file).hint("give results of this study").into());
        }
        for parameter in &result.parameters {
            let name = format!("{} {}", parameter.muscle, parameter.property);
            let quantity = self.place(QuantityKind::MuscleParameter, &name, "× model", participants.len());
            if quantity.values[of].is_some() {
                return Err(fault(format!("{name} of {} is in another folder, too", participants[of].name)).into());
            }
            quantity.values[of] = Some((parameter.posterior_median / parameter.model).ln());
            *quantity.share_from_data.get_or_insert(0.0) += parameter.share_from_data;
        }
        self.inputs.push(input_file(file, &file.display().to_string(), "identification")?);
        Ok(())
    }

    /// Sizes of the effects that the cohort has, each by the participant's own trials.
    fn effects(&mut self, file: &Path, participants: &[Participant]) -> Result<(), Failure> {
        let fault = |what: String| Diagnostic::error(what).in_file(file).hint("is it what carpus diagnose wrote?");
        let text = read_text(file).map_err(|e| fault(format!("cannot be read: {e}")))?;
        let mut value: serde_json::Value = serde_json::from_str(&text).map_err(|e| fault(format!("not JSON: {e}")))?;
        if let Some(object) = value.as_object_mut() {
            object.remove("provenance");
        }
        let cohort: CohortDiagnosis = serde_json::from_value(value)
            .map_err(|e| fault(format!("not a result of carpus diagnose of several participants: {e}")))?;
        for effect in &cohort.effects {
            for member in &effect.participants {
                let Some(i) = participants.iter().position(|p| p.name == member.participant) else { continue };
                for (name, size) in &member.parameters {
                    let unit = effect.parameters.get(name).map_or("", |p| p.unit.as_str());
                    let name = format!("{} {name}", effect.effect);
                    let quantity = self.place(QuantityKind::Effect, &name, unit, participants.len());
                    if quantity.values[i].replace(size.alone.value).is_some() {
                        return Err(fault(format!("{name} of {} is in another folder, too", member.participant)).into());
                    }
                }
            }
        }
        self.inputs.push(input_file(file, &file.display().to_string(), "cohort")?);
        Ok(())
    }
}
