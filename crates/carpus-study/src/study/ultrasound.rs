//! `ultrasound.csv`: muscle architecture measured by imaging. Optional.

use std::path::Path;

use super::fault::Fault;
use super::nearest::nearest;
use super::participants::size;
use super::problem::Problem;
use super::table::Table;
use carpus_numerics::plausible;

const COLUMNS: [&str; 8] = [
    "participant",
    "muscle",
    "posture_deg",
    "muscle_belly_length_m",
    "external_tendon_length_m",
    "cross_sectional_area_m2",
    "fascicle_length_m",
    "pennation_angle_deg",
];

/// One row of `ultrasound.csv`: one muscle in one posture.
#[derive(Clone, Debug, PartialEq)]
pub struct UltrasoundMeasurement {
    /// Name of the participant.
    pub participant: String,
    /// OpenSim muscle.
    pub muscle: String,
    /// Line of the row.
    pub line: usize,
    /// Angle of the dynamometer's coordinate \[rad\].
    pub posture: Option<f64>,
    /// Length of the muscle belly \[m\].
    pub muscle_belly_length: Option<f64>,
    /// Length of the tendon outside the belly \[m\].
    pub external_tendon_length: Option<f64>,
    /// Anatomical cross-sectional area \[m²\].
    pub cross_sectional_area: Option<f64>,
    /// Fascicle length \[m\].
    pub fascicle_length: Option<f64>,
    /// Pennation angle \[rad\].
    pub pennation_angle: Option<f64>,
}

/// Reads `ultrasound.csv`; an absent file is no measurements.
pub(crate) fn read(path: &Path, participants: &[&str], problems: &mut Vec<Problem>) -> Vec<UltrasoundMeasurement> {
    if !path.exists() {
        return Vec::new();
    }
    let Some(table) = Table::read(path, "ultrasound.csv", None, problems) else { return Vec::new() };
    let required = [("participant", "name of the participant"), ("muscle", "OpenSim muscle")];
    if !table.check_columns(&required, &COLUMNS, |c| COLUMNS.contains(&c), problems) {
        return Vec::new();
    }
    let mut measurements = Vec::new();
    for row in table.rows() {
        let participant = row.required("participant", "a name", problems);
        let muscle = row.required("muscle", "a muscle", problems);
        if let Some(name) = participant.filter(|name| !participants.contains(name)) {
            let fault = Fault::UnknownWord {
                key: "participant".to_owned(),
                what: "participant",
                found: name.to_owned(),
                known: participants.iter().map(|p| (*p).to_owned()).collect(),
                nearest: nearest(name, participants.iter().copied()),
            };
            row.error(fault, problems);
        }
        let posture = row.number("posture_deg", "an angle in degrees", |v| v.abs() <= 360.0, problems);
        let pennation = row.number("pennation_angle_deg", "0 to 90 degrees", |v| (0.0..90.0).contains(&v), problems);
        let measurement = UltrasoundMeasurement {
            participant: participant.unwrap_or_default().to_owned(),
            muscle: muscle.unwrap_or_default().to_owned(),
            line: row.line,
            posture: posture.map(f64::to_radians),
            muscle_belly_length: size(&row, "muscle_belly_length_m", &plausible::BELLY_LENGTH, problems),
            external_tendon_length: size(
                &row,
                "external_tendon_length_m",
                &plausible::EXTERNAL_TENDON_LENGTH,
                problems,
            ),
            cross_sectional_area: size(&row, "cross_sectional_area_m2", &plausible::CROSS_SECTIONAL_AREA, problems),
            fascicle_length: size(&row, "fascicle_length_m", &plausible::FASCICLE_LENGTH, problems),
            pennation_angle: pennation.map(f64::to_radians),
        };
        if participant.is_some() && muscle.is_some() {
            measurements.push(measurement);
        }
    }
    measurements
}
