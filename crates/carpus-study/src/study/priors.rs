//! Prior knowledge of muscle parameters: a table from the literature or from earlier fits.

use std::path::Path;

use super::fault::Fault;
use super::problem::{Problem, StudyErrors};
use super::table::Table;

const COLUMNS: [&str; 6] = ["muscle", "property", "mean", "sd", "unit", "source"];
const REQUIRED: [(&str, &str); 4] = [
    ("muscle", "OpenSim muscle"),
    ("property", "OpenSim property, e.g. tendon_slack_length"),
    ("mean", "its mean, in the model file's unit or, with unit = model, as a multiple of the model's value"),
    ("sd", "its standard deviation between persons, in the same unit"),
];
/// Words of the column `unit`.
const UNITS: [(&str, PriorUnit); 2] = [("file", PriorUnit::File), ("model", PriorUnit::Model)];

/// What mean and standard deviation of a prior are given in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PriorUnit {
    /// The unit of the model file.
    File,
    /// Multiples of the value in the participant's model.
    Model,
}

/// One row: what is known of a parameter before this participant was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct PriorKnowledge {
    /// OpenSim muscle.
    pub muscle: String,
    /// OpenSim property.
    pub property: String,
    /// Mean.
    pub mean: f64,
    /// Standard deviation between persons.
    pub sd: f64,
    /// What both are given in; the file's unit where the table does not say.
    pub unit: PriorUnit,
    /// Where it is from.
    pub source: Option<String>,
    /// Line of the row.
    pub line: usize,
}

/// Reads a table of priors.
///
/// # Errors
/// Every problem of the table, together.
pub fn read_priors(path: &Path) -> Result<Vec<PriorKnowledge>, StudyErrors> {
    let mut problems = Vec::new();
    let rows = read(path, &mut problems);
    StudyErrors::settle(problems)?;
    Ok(rows)
}

fn read(path: &Path, problems: &mut Vec<Problem>) -> Vec<PriorKnowledge> {
    let Some(table) = Table::read(path, "table of priors", None, problems) else { return Vec::new() };
    if !table.check_columns(&REQUIRED, &COLUMNS, |c| COLUMNS.contains(&c), problems) {
        return Vec::new();
    }
    let mut priors: Vec<PriorKnowledge> = Vec::new();
    for row in table.rows() {
        let muscle = row.required("muscle", "a muscle", problems);
        let property = row.required("property", "a property", problems);
        row.required("mean", "a number above 0", problems);
        row.required("sd", "a number above 0", problems);
        let mean = row.number("mean", "a number above 0", |v| v > 0.0, problems);
        let sd = row.number("sd", "a number above 0", |v| v > 0.0, problems);
        let (Some(muscle), Some(property), Some(mean), Some(sd)) = (muscle, property, mean, sd) else { continue };
        if let Some(first) = priors.iter().find(|p| p.muscle == muscle && p.property == property) {
            let value = format!("{muscle}.{property}");
            row.error(Fault::Duplicate { what: "prior", value, first_line: first.line }, problems);
            continue;
        }
        priors.push(PriorKnowledge {
            muscle: muscle.to_owned(),
            property: property.to_owned(),
            mean,
            sd,
            unit: row.word("unit", "unit of a prior", &UNITS, problems).unwrap_or(PriorUnit::File),
            source: row.text("source").map(str::to_owned),
            line: row.line,
        });
    }
    priors
}
