//! Residuals of a model along axes, for results.

use std::borrow::Cow;

use super::loading::LoadedParticipant;
use carpus_effects::denoising::denoised;
use carpus_report::residuals::{AxisCurve, FrequencyBand, ResidualResult};
use carpus_report::results::rounded;
use carpus_simulation::evaluation::residuals::{MuscleName, ResidualTrial, SessionUnit, along_axes};
use carpus_simulation::simulation::speed_and_acceleration;
use carpus_study::study::{Trial, TrialUse};

/// Digits that results keep.
const DIGITS: i32 = 6;

/// The residual of a model over a participant's trials, maximal contractions left out. Angle, speed and acceleration
/// are without the recorded angle's white noise, as in a diagnosis.
///
/// - `moments`: simulated moments of all trials [N·m]
pub fn residual_result(run: &LoadedParticipant, model: &str, moments: &[Vec<f64>]) -> ResidualResult {
    let timed = run.trials.iter().all(|t| t.info.start_time.is_some());
    let smooth = denoised(&run.trials).trials;
    let smooth = matches!(smooth, Cow::Owned(_)).then_some(smooth);
    let trials: Vec<ResidualTrial> = (0..run.trials.len())
        .filter(|i| run.trials[*i].info.usage != TrialUse::Mvc)
        .map(|i| {
            let trial = residual_trial(run, i, &moments[i], timed);
            match &smooth {
                Some(smooth) => along_angle(trial, &smooth[i]),
                None => trial,
            }
        })
        .collect();
    let session = if timed { SessionUnit::Minutes } else { SessionUnit::Order };
    let found = along_axes(&trials, &trials, &muscle_names(run), session);
    let keep = |v: f64| rounded(v, DIGITS);
    let axis = |a: carpus_simulation::evaluation::residuals::AxisCurve| AxisCurve {
        axis: a.axis,
        unit: a.unit.to_owned(),
        share_of_error: keep(a.share),
        curve: a.bins.iter().map(|b| (keep(b.at), keep(b.mean), b.interval.map(|i| i.map(keep)))).collect(),
    };
    ResidualResult {
        model: model.to_owned(),
        rms_n_m: keep(found.rms),
        repetition_noise_n_m: found.repetitions.map(|r| keep(r.noise)),
        repetition_pairs: found.repetitions.map_or(0, |r| r.pairs),
        axes: found.axes.into_iter().map(axis).collect(),
        bands: found
            .bands
            .iter()
            .map(|b| FrequencyBand {
                low_hz: b.low,
                high_hz: b.high,
                share_of_error: keep(b.share),
                interval: b.interval.map(|i| i.map(keep)),
            })
            .collect(),
    }
}

fn residual_trial(run: &LoadedParticipant, i: usize, moment: &[f64], timed: bool) -> ResidualTrial {
    let trial = &run.trials[i];
    let kinematics = run.prepared[i].kinematics();
    let start = trial.info.start_time.filter(|_| timed).map(|s| s / 60.0);
    ResidualTrial {
        time: trial.time.clone(),
        residual: trial.moment.iter().zip(moment).map(|(y, s)| y - s).collect(),
        angle: kinematics.angle.clone(),
        speed: kinematics.speed.clone(),
        acceleration: kinematics.acceleration.clone(),
        activation: kinematics.muscles.iter().map(|m| m.activation.clone()).collect(),
        session: start.unwrap_or((trial.info.place + 1) as f64),
        effort: trial.info.effort_percent,
        condition: condition(trial),
    }
}

/// The same residual along another angle; along its own where that cannot be differentiated.
fn along_angle(trial: ResidualTrial, smooth: &Trial) -> ResidualTrial {
    match speed_and_acceleration(&smooth.time, &smooth.angle) {
        Ok([speed, acceleration]) => ResidualTrial { angle: smooth.angle.clone(), speed, acceleration, ..trial },
        Err(_) => trial,
    }
}

/// Trials of the same condition repeat each other.
fn condition(trial: &Trial) -> String {
    let info = &trial.info;
    let bits = |v: Option<f64>| v.map(f64::to_bits);
    let (effort, posture) = (bits(info.effort_percent), bits(info.posture));
    let held: Vec<(&str, u64)> =
        info.held.iter().map(|h| (h.coordinate.as_str(), h.value_deg_or_m.to_bits())).collect();
    format!("{:?} {:?} {effort:?} {posture:?} {} {held:?}", info.contraction, info.direction, info.arm_word())
}

fn muscle_names(run: &LoadedParticipant) -> Vec<MuscleName> {
    let direction = |m: usize| {
        let arms = run.prepared.iter().flat_map(|t| &t.kinematics().muscles[m].moment_arm);
        if arms.sum::<f64>() < 0.0 { -1.0 } else { 1.0 }
    };
    run.model
        .muscle_names()
        .enumerate()
        .map(|(m, name)| MuscleName { name: name.to_owned(), direction: direction(m) })
        .collect()
}
