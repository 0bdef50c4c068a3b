//! What the columns of an exported file are: by name, unit and behaviour.

use carpus_numerics::plausible::{Measured, NamedUnit, unit_in_name};
use carpus_study::study::{Exported, is_time_name};

use super::muscles;

/// Part of negative samples from which on EMG is raw: envelopes have next to none.
const NEGATIVE_PART: f64 = 0.2;
/// An angle is recorded in radians if it never exceeds this and its unit is not stated.
const LARGEST_IN_RADIANS: f64 = 3.2;

/// What a column holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Role {
    /// Times.
    Time,
    /// The angle of the joint.
    Angle,
    /// Its speed.
    Velocity,
    /// The moment.
    Moment,
    /// The moment as a recorder of EMG takes it from the dynamometer: a voltage.
    MomentVoltage,
    /// EMG of muscles of the model.
    Emg(Vec<String>),
    /// EMG of something else.
    OtherEmg,
    /// Something else.
    Other,
}

/// A column of a file.
#[derive(Clone, Debug)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// What it holds.
    pub role: Role,
    /// The unit that its name or a line of units states.
    pub unit: Option<&'static NamedUnit>,
    /// Whether an EMG label is the muscle's name itself.
    pub is_exact: bool,
}

/// How EMG is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmgKind {
    /// As it is amplified.
    Raw,
    /// Envelopes, parts of the maximum.
    Normalized,
    /// Envelopes in percent of the maximum.
    Percent,
}

/// The columns of a file.
pub fn columns(file: &Exported, model_muscles: &[&str]) -> Vec<Column> {
    let mut found: Vec<Column> = (0..file.names.len()).map(|i| column(file, i, model_muscles)).collect();
    // Of several angles, the anatomical one is meant.
    let angles: Vec<usize> = (0..found.len()).filter(|i| found[*i].role == Role::Angle).collect();
    if let Some(anatomical) = angles.iter().find(|i| has_word(&found[**i].name, &["anat", "anatomical", "joint"])) {
        angles.iter().filter(|i| *i != anatomical).for_each(|i| found[*i].role = Role::Other);
    }
    for role in [Role::Angle, Role::Velocity, Role::Moment, Role::MomentVoltage] {
        let mut again = found.iter_mut().filter(|column| column.role == role).skip(1);
        again.by_ref().for_each(|column| column.role = Role::Other);
    }
    found
}

fn column(file: &Exported, i: usize, model_muscles: &[&str]) -> Column {
    let name = &file.names[i];
    let unit = |holds| {
        let stated = file.units.get(i).filter(|unit| !unit.is_empty());
        match stated {
            Some(unit) => unit_in_name(&format!("[{}]", unit.trim_matches(['(', ')', '[', ']'])), holds),
            None => unit_in_name(name, holds),
        }
    };
    let of = |role, unit: Option<&'static NamedUnit>| Column { name: name.clone(), role, unit, is_exact: true };
    let is_of = |holds| unit(holds).filter(|unit: &&NamedUnit| unit.of == holds);
    if is_time_name(name) {
        return of(Role::Time, is_of(Measured::Time));
    }
    let has = |words: &[&str]| has_word(name, words);
    if has(&["torque", "moment", "drehmoment", "trq", "couple", "torsion"]) {
        return match is_of(Measured::Voltage) {
            Some(unit) => of(Role::MomentVoltage, Some(unit)),
            None => of(Role::Moment, is_of(Measured::Moment)),
        };
    }
    if has(&["velocity", "speed", "vel", "geschwindigkeit", "winkelgeschwindigkeit", "vitesse"]) {
        return of(Role::Velocity, is_of(Measured::AngularVelocity));
    }
    if has(&["angle", "position", "pos", "winkel", "gelenkwinkel", "goniometer", "rom", "anat"])
        && !has(&["start", "end"])
    {
        return of(Role::Angle, is_of(Measured::Angle));
    }
    if let Some(named) = muscles::named(name, model_muscles) {
        let unit = is_of(Measured::Voltage).or_else(|| is_of(Measured::Part));
        return Column { role: Role::Emg(named.muscles), is_exact: named.is_exact, ..of(Role::Other, unit) };
    }
    let is_voltage = is_of(Measured::Voltage).is_some();
    of(if has(&["emg", "semg"]) || is_voltage { Role::OtherEmg } else { Role::Other }, None)
}

/// Whether a name has one of some words; digits at the end of a word do not count.
fn has_word(name: &str, words: &[&str]) -> bool {
    let lower = name.to_lowercase();
    let mut parts = lower.split(|c: char| !c.is_alphabetic()).filter(|part| !part.is_empty());
    parts.any(|part| words.contains(&part))
}

/// How a channel of EMG is recorded; `None` if it cannot be told.
pub fn emg_kind(samples: &[f64], unit: Option<&NamedUnit>) -> Option<EmgKind> {
    let known: Vec<f64> = samples.iter().copied().filter(|x| x.is_finite()).collect();
    let negative = known.iter().filter(|x| **x < 0.0).count() as f64;
    let largest = known.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if negative > NEGATIVE_PART * known.len() as f64 {
        return Some(EmgKind::Raw);
    }
    if unit.is_some_and(|unit| unit.symbol == "%") {
        return Some(EmgKind::Percent);
    }
    (largest <= 1.05).then_some(EmgKind::Normalized)
}

/// Whether angles without a stated unit are in radians.
pub fn looks_like_radians(angles: &[&[f64]]) -> bool {
    let largest = angles.iter().flat_map(|x| x.iter()).filter(|x| x.is_finite()).fold(0.0, |a, b| f64::max(a, b.abs()));
    largest > 0.0 && largest <= LARGEST_IN_RADIANS
}
