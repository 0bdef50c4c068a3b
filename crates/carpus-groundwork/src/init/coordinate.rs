//! The coordinate that the dynamometer moves, and the posture of the others.

use super::draft::Held;
use super::muscles::flexes;
use super::pieces::Found;
use super::proposal::Note;
use super::proposal::Questions;
use crate::diagnostic::Failure;
use crate::model::LoadedModel;
use crate::path_check;
use crate::quantity::{Quantity, Unit};
use carpus_multibody::multibody::Model;
use carpus_osim::osim::spec::{CoordinateIndex, MotionType};

/// A moment arm from which on a muscle moves a joint [m].
const LEAST_ARM: f64 = 1e-3;
/// Value of the elbow at wrist dynamometers, whose forearm rests on a support [deg].
const USUAL_ELBOW_DEG: f64 = 90.0;

/// The coordinate of the dynamometer.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Its place in the model.
    pub index: CoordinateIndex,
    /// Its name.
    pub name: String,
    /// What was assumed of it.
    pub assumed: Option<Note>,
}

/// The coordinate of that name.
///
/// # Errors
/// There is none, or it is no coordinate that can be set.
pub fn named(loaded: &LoadedModel, name: &str) -> Result<Chosen, Failure> {
    let index = loaded.check_settable(name, Quantity { value: 0.0, unit: Unit::Degree })?;
    Ok(Chosen { index, name: name.to_owned(), assumed: None })
}

/// The coordinate that the recorded muscles move and the names speak of.
///
/// # Errors
/// The paths of the muscles.
pub fn found(
    loaded: &LoadedModel,
    muscles: &[String],
    found: &Found,
    questions: &dyn Questions,
) -> Result<Chosen, Failure> {
    let words = found.words();
    let mut candidates: Vec<(f64, CoordinateIndex)> = Vec::new();
    for index in settable(&loaded.model) {
        let arms = arms(loaded, muscles, index)?;
        let crossing = arms.iter().filter(|arm| arm.abs() > LEAST_ARM).count() as f64;
        let size: f64 = arms.iter().map(|arm| arm.abs()).sum();
        let name = loaded.model.coordinates[index.0].name.to_lowercase();
        let parts: Vec<&str> = name.split(|c: char| !c.is_alphanumeric()).collect();
        // A muscle counts one, and once more where it flexes as its name says, all to one sign; a joint that the files
        // speak of counts as much as all muscles.
        let spoken = words.iter().any(|word| word.len() > 3 && parts.contains(&word.as_str()) && word != "flexion");
        let flexing: f64 = muscles.iter().zip(&arms).map(|(m, arm)| sign_of(*arm) * flexes(m)).sum();
        let both_ways = if name.contains("flex") && found.has_directions() { flexing.abs() } else { 0.0 };
        let bonus = if spoken { muscles.len() as f64 } else { 0.0 } + both_ways;
        candidates.push((crossing + bonus + size, index));
    }
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
    let name = |index: CoordinateIndex| loaded.model.coordinates[index.0].name.clone();
    let Some(&(best, mut index)) = candidates.first() else {
        return Err(loaded.message("the model has no coordinate that can be set".to_owned()).into());
    };
    let others: Vec<CoordinateIndex> = candidates.iter().skip(1).filter(|c| c.0 > 0.0).map(|c| c.1).collect();
    let second = candidates.get(1).map_or(0.0, |c| c.0);
    let mut assumed = None;
    if best - second < 1.5 {
        let answers: Vec<String> = std::iter::once(index).chain(others.iter().copied()).map(name).collect();
        let answer = questions.choose("Which coordinate does the dynamometer move?", &answers);
        index = answer.checked_sub(1).map_or(index, |i| others[i.min(others.len() - 1)]);
        assumed = Some(Note {
            what: format!("the dynamometer moves `{}`", name(index)),
            remedy: format!("the recorded muscles also move {}; --coordinate NAME sets it", answers[1..].join(", ")),
        });
    }
    Ok(Chosen { index, name: name(index), assumed })
}

/// 1 or −1 for a moment arm that moves the joint, else 0.
fn sign_of(arm: f64) -> f64 {
    if arm.abs() > LEAST_ARM { arm.signum() } else { 0.0 }
}

/// Coordinates beside the dynamometer's that recorded muscles cross, with the values that are proposed.
///
/// # Errors
/// The paths of the muscles.
pub fn posture(
    loaded: &LoadedModel,
    muscles: &[String],
    chosen: &Chosen,
    questions: &dyn Questions,
    assumed: &mut Vec<Note>,
) -> Result<Vec<Held>, Failure> {
    let mut held = Vec::new();
    for (index, crossing) in crossed_by(loaded, muscles, chosen.index)? {
        let coordinate = &loaded.model.coordinates[index.0];
        let default_deg = coordinate.default_value.to_degrees();
        let name = coordinate.name.clone();
        let lower = name.to_lowercase();
        let is_elbow = lower.contains("elbow") && lower.contains("flex");
        let [low, high] = coordinate.range.map(f64::to_degrees);
        let proposed = if is_elbow && default_deg.abs() < 1.0 && (low..=high).contains(&USUAL_ELBOW_DEG) {
            USUAL_ELBOW_DEG
        } else {
            default_deg
        };
        let question =
            format!("{name} in degrees ({} cross it; the model's default is {default_deg:.0})", crossing.join(", "));
        let value_deg = questions.number(&question, proposed);
        let is_default = value_deg == default_deg;
        if !is_default {
            assumed.push(Note {
                what: format!("{name} was held at {value_deg:.0}° (the model's default is {default_deg:.0}°)"),
                remedy: "the forearm rests on a support at wrist dynamometers; set the measured angle in [posture_deg]"
                    .to_owned(),
            });
        }
        held.push(Held { name, value_deg, is_default, muscles: crossing });
    }
    Ok(held)
}

/// Coordinates beside the dynamometer's that muscles cross: name, default [deg], muscles.
///
/// # Errors
/// The paths of the muscles.
pub fn crossed(
    loaded: &LoadedModel,
    muscles: &[String],
    chosen: CoordinateIndex,
) -> Result<Vec<(String, f64, Vec<String>)>, Failure> {
    let named = |(index, crossing): (CoordinateIndex, Vec<String>)| {
        let coordinate = &loaded.model.coordinates[index.0];
        (coordinate.name.clone(), coordinate.default_value.to_degrees(), crossing)
    };
    Ok(crossed_by(loaded, muscles, chosen)?.into_iter().map(named).collect())
}

fn crossed_by(
    loaded: &LoadedModel,
    muscles: &[String],
    chosen: CoordinateIndex,
) -> Result<Vec<(CoordinateIndex, Vec<String>)>, Failure> {
    let mut found = Vec::new();
    for index in settable(&loaded.model).into_iter().filter(|index| *index != chosen) {
        let arms = arms(loaded, muscles, index)?;
        let crosses = muscles.iter().zip(&arms).filter(|(_, arm)| arm.abs() > LEAST_ARM);
        let crossing: Vec<String> = crosses.map(|(muscle, _)| muscle.clone()).collect();
        if !crossing.is_empty() {
            found.push((index, crossing));
        }
    }
    Ok(found)
}

/// Rotations that are neither locked nor follow others.
fn settable(model: &Model) -> Vec<CoordinateIndex> {
    let is_free = |i: &usize| {
        let coordinate = &model.coordinates[*i];
        coordinate.motion_type == MotionType::Rotational
            && !coordinate.locked
            && !model.is_dependent(CoordinateIndex(*i))
    };
    (0..model.coordinates.len()).filter(is_free).map(CoordinateIndex).collect()
}

/// Moment arms of muscles about a coordinate in the model's default posture [m].
fn arms(loaded: &LoadedModel, muscles: &[String], index: CoordinateIndex) -> Result<Vec<f64>, Failure> {
    let posture = loaded.posture(&[], &mut Vec::new())?;
    let indices = loaded.muscles(muscles)?;
    let samples = path_check::samples(loaded, &indices, index, &posture, &[posture[index.0]])?;
    Ok(samples.iter().map(|s| s.first().map_or(0.0, |s| s.moment_arm)).collect())
}
