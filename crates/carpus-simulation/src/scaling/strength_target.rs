//! Maximum voluntary moments of a participant and the postures in which they were exerted.

use super::strength_error::StrengthError;
use crate::simulation::HeldCoordinate;
use carpus_study::study::{Direction, Participant, Study, Trial, TrialInfo};

/// A moment that a group of muscles has to reach.
#[derive(Clone, Debug, PartialEq)]
pub struct StrengthTarget {
    /// [`Direction::Flexion`] or [`Direction::Extension`].
    pub direction: Direction,
    /// Moment in that direction, above 0 [N·m].
    pub moment: f64,
    /// Value of the dynamometer's coordinate [rad or m].
    pub angle: f64,
    /// Coordinates held otherwise than in the study's posture: those of the trial that the angle is from.
    pub held: Vec<HeldCoordinate>,
    /// Where the moment comes from.
    pub source: TargetSource,
}

/// Where a maximum voluntary moment comes from.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TargetSource {
    /// A column of `participants.csv`.
    Participants,
    /// The trial with the largest moment, its file as `trials.csv` writes it.
    Trial(String),
}

/// The maximum moments of a participant: those of `participants.csv`, else the largest of the MVC trials.
///
/// The posture is `[strength_scaling] posture_deg`, else the `posture_deg` of the MVC trial with the largest moment,
/// else its angle at that moment.
///
/// - `is_translation`: whether the dynamometer's coordinate is one
///
/// # Errors
/// [`StrengthError::NoMoment`] without any; [`StrengthError::NoPosture`]; [`StrengthError::WrongDirection`]; trials
/// that cannot be read.
pub fn strength_targets(
    study: &Study,
    participant: &Participant,
    is_translation: bool,
) -> Result<Vec<StrengthTarget>, StrengthError> {
    let settings = &study.settings.strength;
    let in_posture = settings.posture_deg.map(|value| if is_translation { value } else { value.to_radians() });
    let mut targets = Vec::new();
    for (direction, stated) in
        [(Direction::Flexion, participant.mvc_flexion), (Direction::Extension, participant.mvc_extension)]
    {
        // The trials are only read where they are needed.
        let needed = stated.is_none() || in_posture.is_none();
        let trial = if needed { largest(study, participant, direction)? } else { None };
        let (moment, source) = match (stated, &trial) {
            (Some(moment), _) => (moment, TargetSource::Participants),
            (None, Some(trial)) => (trial.moment, TargetSource::Trial(trial.file.clone())),
            (None, None) => continue,
        };
        let of_trial = trial.filter(|_| in_posture.is_none());
        let held = of_trial.as_ref().map(|trial| trial.held.clone()).unwrap_or_default();
        let angle = in_posture.or(of_trial.map(|trial| trial.angle));
        let unknown =
            || StrengthError::NoPosture { participant: participant.name.clone(), direction: direction.word() };
        targets.push(StrengthTarget { direction, moment, angle: angle.ok_or_else(unknown)?, held, source });
    }
    if targets.is_empty() {
        return Err(StrengthError::NoMoment { participant: participant.name.clone() });
    }
    Ok(targets)
}

/// The largest moment of a trial.
struct Largest {
    file: String,
    moment: f64,
    angle: f64,
    held: Vec<HeldCoordinate>,
}

fn largest(study: &Study, participant: &Participant, direction: Direction) -> Result<Option<Largest>, StrengthError> {
    let settings = &study.settings.strength;
    let positive = settings.flexion_is_positive == (direction == Direction::Flexion);
    let sign = if positive { 1.0 } else { -1.0 };
    let is_mvc = |t: &&TrialInfo| t.is_mvc() && t.direction == direction;
    let mut best: Option<Largest> = None;
    for info in study.trials_of(&participant.name).filter(is_mvc) {
        let trial = study.trial(info)?;
        let (along, at) = peak(&trial, sign, settings.mvc_window);
        let (against, _) = peak(&trial, -sign, settings.mvc_window);
        if against > along {
            let file = info.file.display().to_string();
            return Err(StrengthError::WrongDirection { file, direction: direction.word(), along, found: against });
        }
        if best.as_ref().is_none_or(|best| along > best.moment) {
            let angle = info.posture.unwrap_or(trial.angle[at]);
            let held = info.held.iter().map(HeldCoordinate::from).collect();
            best = Some(Largest { file: info.file_as_written.clone(), moment: along, angle, held });
        }
    }
    Ok(best.filter(|best| best.moment > 0.0))
}

/// Largest mean of the moment over a window, by the trapezoidal rule, and the sample in the window's middle.
fn peak(trial: &Trial, sign: f64, window: f64) -> (f64, usize) {
    let (time, moment) = (&trial.time, &trial.moment);
    let mut best = (f64::NEG_INFINITY, 0);
    let mut last = 0;
    let mut area = 0.0;
    let slice = |i: usize| 0.5 * (moment[i] + moment[i + 1]) * (time[i + 1] - time[i]);
    for first in 0..moment.len() {
        // The shortest window of whole samples that is long enough; half a step is rounding of written times.
        while last + 1 < moment.len() && time[last] - time[first] < window * (1.0 - 1e-6) {
            area += slice(last);
            last += 1;
        }
        let span = time[last] - time[first];
        let is_long_enough = span >= window * (1.0 - 1e-6) || first == 0;
        let mean = if span > 0.0 { area / span } else { moment[first] };
        if is_long_enough && sign * mean > best.0 {
            best = (sign * mean, (first + last) / 2);
        }
        if last > first {
            area -= slice(first);
        } else {
            last = first + 1;
            area = 0.0;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_study::study::{Contraction, TrialUse};

    fn trial(moment: &[f64]) -> Trial {
        let info = TrialInfo::example(Contraction::Mvc, Direction::Flexion, TrialUse::Mvc);
        let time = (0..moment.len()).map(|i| 0.01 * i as f64).collect();
        Trial::from_samples(info, time, vec![0.0; moment.len()], moment.to_vec(), Vec::new())
    }

    #[test]
    fn verif_peak_is_the_largest_mean_of_a_window() {
        // A spike of one sample, and a plateau of 11 samples (0.1 s).
        let mut moment = vec![0.0; 100];
        moment[20] = 50.0;
        moment[60..=70].fill(8.0);
        let (mean, at) = peak(&trial(&moment), 1.0, 0.1);
        assert!((mean - 8.0).abs() < 1e-12 && at == 65, "{mean} at {at}");
        assert_eq!(peak(&trial(&moment), 1.0, 0.0), (50.0, 20));
        // Every window by summation.
        let noisy: Vec<f64> = (0..100).map(|i| (f64::from(i) * 1.7).sin() + (f64::from(i) * 0.1).sin()).collect();
        let direct = (0..95)
            .map(|i| (0..5).map(|k| 0.5 * (noisy[i + k] + noisy[i + k + 1])).sum::<f64>() / 5.0)
            .fold(f64::NEG_INFINITY, f64::max);
        assert!((peak(&trial(&noisy), 1.0, 0.05).0 - direct).abs() < 1e-12);
        // A window longer than the trial is the whole of it.
        assert!((peak(&trial(&[1.0, 2.0, 3.0]), 1.0, 10.0).0 - 2.0).abs() < 1e-12);
        assert!((peak(&trial(&[-1.0, -4.0, -1.0]), -1.0, 0.0).0 - 4.0).abs() < 1e-12);
    }
}
