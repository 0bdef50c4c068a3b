//! Prior knowledge of muscle parameters: a table from the literature or from earlier fits.

use std::path::Path;

use super::problem::{Fault, Problem, StudyErrors};
use super::table::Table;

const COLUMNS: [&str; 5] = ["muscle", "property", "mean", "sd", "source"];
const REQUIRED: [(&str, &str); 4] = [
    ("muscle", "OpenSim muscle"),
    ("property", "OpenSim property, e.g. tendon_slack_length"),
    ("mean", "its mean, in the model file's unit"),
    ("sd", "its standard deviation between persons, in the same unit"),
];

/// One row: what is known of a parameter before this participant was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct PriorKnowledge {
    /// OpenSim muscle.
    pub muscle: String,
    /// OpenSim property.
    pub property: String,
    /// Mean, in the model file's unit.
    pub mean: f64,
    /// Standard deviation between persons.
    pub sd: f64,
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
            source: row.text("source").map(str::to_owned),
            line: row.line,
        });
    }
    priors
}
