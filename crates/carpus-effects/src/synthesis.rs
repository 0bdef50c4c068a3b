//! Trials with a hidden effect, simulated by Carpus itself, for teaching and for tests.
//!
//! In: the trials of a study, whose angles and excitations are taken for the true ones. Out: what a lab would have
//! recorded of a person with other muscle parameters and an effect that the model lacks. The simulator is the one that
//! analyses the trials later: such a study shows how the tools work, not that they are right.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::effect::Effect;
use super::forward_model::{ForwardModel, Setting};
use super::joint_traits::JointTraits;
use super::moments::simulate_all;
use carpus_numerics::statistics::normal_of_uniform;
use carpus_osim::osim::spec::MuscleSpec;
use carpus_simulation::simulation::{MuscleParameters, SimulationError};
use carpus_study::study::{Contraction, Trial};

/// How far true lengths and the logarithm of true forces are from the model's: the ranges that they are drawn from.
const FIBER_LENGTH: [f64; 2] = [0.92, 1.08];
const SLACK_LENGTH: [f64; 2] = [0.96, 1.04];
const FORCE: [f64; 2] = [0.7, 1.5];
/// Size of an effect of which no size was asked for, in scales of its amplitudes.
const USUAL_SIZE: f64 = 3.0;

/// Noise of a recording, one standard deviation each.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct RecordingNoise {
    /// EMG envelope, relative.
    pub emg_envelope: f64,
    /// Gain of an EMG channel, per trial, relative.
    pub emg_gain_per_trial: f64,
    /// Baseline that every EMG channel has more, of full excitation.
    pub emg_baseline: f64,
    /// Angle [rad].
    pub angle_rad: f64,
    /// Moment from sample to sample [N·m].
    pub moment_white_n_m: f64,
    /// Slow disturbances of the moment, as a share of the largest moment of the session.
    pub moment_slow_share: f64,
}

impl RecordingNoise {
    /// What laboratories see: EMG 10 % envelope and 5 % gain per trial, 0.2°, 0.05 N·m and 1 % of the largest moment.
    pub const REALISTIC: RecordingNoise = RecordingNoise {
        emg_envelope: 0.10,
        emg_gain_per_trial: 0.05,
        emg_baseline: 0.002,
        angle_rad: 0.2 * std::f64::consts::PI / 180.0,
        moment_white_n_m: 0.05,
        moment_slow_share: 0.01,
    };

    /// All of it times a factor.
    pub fn scaled(self, factor: f64) -> RecordingNoise {
        RecordingNoise {
            emg_envelope: factor * self.emg_envelope,
            emg_gain_per_trial: factor * self.emg_gain_per_trial,
            emg_baseline: factor * self.emg_baseline,
            angle_rad: factor * self.angle_rad,
            moment_white_n_m: factor * self.moment_white_n_m,
            moment_slow_share: factor * self.moment_slow_share,
        }
    }
}

/// Correlation times of noise [s].
const EMG_TIME: f64 = 0.1;
const ANGLE_TIME: f64 = 0.25;
const MOMENT_TIME: f64 = 0.3;

/// A simulated participant.
#[derive(Clone, Debug)]
pub struct Synthetic {
    /// The muscles' true parameters.
    pub parameters: Vec<MuscleParameters>,
    /// The trials as recorded.
    pub trials: Vec<Trial>,
    /// Moment without noise, per trial [N·m].
    pub true_moment: Vec<Vec<f64>>,
}

/// Why a study cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SynthesisError {
    /// A trial cannot be simulated.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// No such parameter.
    #[error("{effect} has no parameter `{name}`; it has {}", .known.join(", "))]
    UnknownParameter {
        /// The effect.
        effect: &'static str,
        /// As given.
        name: String,
        /// The parameters that it has.
        known: Vec<&'static str>,
    },
    /// No parameter value of the effect gives this.
    #[error("{effect}.{name}: {value} {unit} cannot be reached")]
    Unreachable {
        /// The effect.
        effect: &'static str,
        /// The parameter.
        name: &'static str,
        /// As asked for.
        value: f64,
        /// Unit.
        unit: &'static str,
    },
}

/// An effect of the size asked for; amplitudes that are not named get a size that is plain to see, if none is named.
///
/// - `values`: names and values of parameters, in the units that the catalogue reports
/// - `muscles`: of the model, for parameters that are properties of muscles
/// - `joint`: for shapes that are not named
///
/// # Errors
/// An unknown parameter; a value out of reach.
pub fn sized(
    effect: &'static dyn Effect,
    values: &[(String, f64)],
    muscles: &[MuscleSpec],
    joint: &JointTraits,
) -> Result<Setting, SynthesisError> {
    let description = effect.description();
    let mut setting = joint.absent(effect);
    for (name, value) in values {
        let Some(i) = description.parameters.iter().position(|p| p.name == name) else {
            let known = description.parameters.iter().map(|p| p.name).collect();
            return Err(SynthesisError::UnknownParameter { effect: description.id, name: name.clone(), known });
        };
        setting.values[i] = reached(&setting, i, *value, muscles)?;
    }
    let named = |i: usize| values.iter().any(|(name, _)| name == description.parameters[i].name);
    if !description.amplitudes().any(named) {
        for i in description.amplitudes() {
            setting.values[i] = usual(&setting, i, muscles, joint)?;
        }
    }
    Ok(setting)
}

/// A size that is plain to see and plausible.
fn usual(setting: &Setting, i: usize, muscles: &[MuscleSpec], joint: &JointTraits) -> Result<f64, SynthesisError> {
    let parameter = &setting.effect.description().parameters[i];
    let reported = |value: f64| {
        let mut values = setting.values.clone();
        values[i] = value;
        setting.effect.reported(&values, muscles)[i]
    };
    let [low, high] = joint.plausible(parameter);
    for size in [USUAL_SIZE, -USUAL_SIZE, USUAL_SIZE / 2.0, -USUAL_SIZE / 2.0] {
        let value = size * joint.scale(parameter);
        if (low..=high).contains(&reported(value)) {
            return Ok(value);
        }
    }
    reached(setting, i, 0.5 * (low + high), muscles)
}

/// The value of a parameter that is reported as `wanted`.
fn reached(setting: &Setting, i: usize, wanted: f64, muscles: &[MuscleSpec]) -> Result<f64, SynthesisError> {
    let description = setting.effect.description();
    let parameter = &description.parameters[i];
    let at = |value: f64| {
        let mut values = setting.values.clone();
        values[i] = value;
        setting.effect.reported(&values, muscles)[i] - wanted
    };
    if at(wanted) == 0.0 {
        return Ok(wanted);
    }
    // Ratios are kept as logarithms: what is reported rises or falls all the way.
    let (mut low, mut high) = (-5.0, 5.0);
    if !(at(low) * at(high) < 0.0) {
        let (effect, name, unit) = (description.id, parameter.name, parameter.unit);
        return Err(SynthesisError::Unreachable { effect, name, value: wanted, unit });
    }
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if at(low) * at(middle) <= 0.0 { high = middle } else { low = middle }
    }
    Ok(0.5 * (low + high))
}

/// Draws the muscle parameters, simulates every trial with the effects, and records it.
///
/// # Errors
/// A trial that cannot be simulated.
pub fn synthesize(
    forward: &ForwardModel,
    trials: &[Trial],
    effects: &[Setting],
    noise: &RecordingNoise,
    seed: u64,
) -> Result<Synthetic, SynthesisError> {
    let parameters = drawn(&forward.nominal_parameters(), seed);
    let true_moment: Vec<Vec<f64>> =
        simulate_all(forward, &parameters, effects)?.into_iter().map(|trial| trial.moment).collect();
    let largest = true_moment.iter().flatten().fold(0.0, |max, m| f64::max(max, m.abs()));
    let recorded = trials
        .iter()
        .zip(&true_moment)
        .enumerate()
        .map(|(g, (trial, moment))| {
            // Every trial has its own stream: leaving one out does not change the others.
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            random.set_stream(1 + g as u64);
            recorded(trial, moment, largest, noise, &mut random)
        })
        .collect();
    Ok(Synthetic { parameters, trials: recorded, true_moment })
}

fn drawn(nominal: &[MuscleParameters], seed: u64) -> Vec<MuscleParameters> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut within = |[low, high]: [f64; 2]| low + (high - low) * random.random::<f64>();
    let muscle = |p: &MuscleParameters| MuscleParameters {
        optimal_fiber_length: p.optimal_fiber_length * within(FIBER_LENGTH),
        tendon_slack_length: p.tendon_slack_length * within(SLACK_LENGTH),
        max_isometric_force: p.max_isometric_force * within(FORCE.map(f64::ln)).exp(),
        ..*p
    };
    nominal.iter().map(muscle).collect()
}

fn recorded(trial: &Trial, moment: &[f64], largest: f64, noise: &RecordingNoise, random: &mut ChaCha8Rng) -> Trial {
    let time = &trial.time;
    let slow = smooth_noise(time, MOMENT_TIME, random);
    let moment = moment
        .iter()
        .zip(slow)
        .map(|(m, slow)| m + noise.moment_slow_share * largest * slow + noise.moment_white_n_m * normal(random))
        .collect();
    let shake = smooth_noise(time, ANGLE_TIME, random);
    let angle = trial.angle.iter().zip(shake).map(|(a, s)| a + noise.angle_rad * s).collect();
    let excitation = trial
        .excitation
        .iter()
        .map(|e| {
            // Muscles at maximum that EMG is normalized by stay at most at 1: the channel clips.
            let gain = 1.0 + noise.emg_gain_per_trial * normal(random);
            let (envelope, floor) = (smooth_noise(time, EMG_TIME, random), smooth_noise(time, EMG_TIME, random));
            e.iter()
                .zip(envelope.iter().zip(&floor))
                .map(|(e, (n, f))| {
                    let value = e * gain * (1.0 + noise.emg_envelope * n) + noise.emg_baseline * (1.0 + 0.5 * f);
                    value.clamp(0.0, 1.0)
                })
                .collect()
        })
        .collect();
    Trial::from_samples(trial.info.clone(), time.clone(), angle, moment, excitation)
}

/// A draw from N(0, 1).
fn normal(random: &mut ChaCha8Rng) -> f64 {
    normal_of_uniform([1.0 - random.random::<f64>(), random.random()])
}

/// A Gaussian process of unit variance with autocorrelation exp(−(t/`length`)²/2) at these times: as smooth as its
/// kernel, however fine the times are.
fn smooth_noise(time: &[f64], length: f64, random: &mut ChaCha8Rng) -> Vec<f64> {
    // A kernel of width length/√2 over white noise on a grid five times finer than the width.
    let width = length / 2f64.sqrt();
    let step = width / 5.0;
    let reach = 25usize;
    // - `from_middle`: distance from the kernel's middle [steps]
    let kernel = |from_middle: f64| (-0.5 * (from_middle * step / width).powi(2)).exp();
    let norm = (0..=2 * reach).map(|i| kernel(i as f64 - reach as f64).powi(2)).sum::<f64>().sqrt();
    let span = time[time.len() - 1] - time[0];
    let nodes = (span / step).ceil() as usize + 2;
    let white: Vec<f64> = (0..nodes + 2 * reach).map(|_| normal(random)).collect();
    time.iter()
        .map(|t| {
            let x = (t - time[0]) / step;
            let first = (x as usize).min(nodes - 2);
            let near = white.iter().enumerate().skip(first).take(2 * reach + 2);
            near.map(|(i, w)| kernel(i as f64 - reach as f64 - x) * w).sum::<f64>() / norm
        })
        .collect()
}

/// Largest moments [N·m] in the coordinate's positive and negative direction: of maximal contractions if there are any.
pub fn largest_moments(trials: &[Trial], moments: &[Vec<f64>]) -> [f64; 2] {
    let maximal = trials.iter().any(|t| t.info.contraction == Contraction::Mvc);
    let counted = trials.iter().zip(moments).filter(|(t, _)| !maximal || t.info.contraction == Contraction::Mvc);
    counted.flat_map(|(_, m)| m).fold([0.0, 0.0], |[up, down], m| [f64::max(up, *m), f64::max(down, -m)])
}

#[cfg(test)]
mod tests {
    use carpus_numerics::signals::own_samples;

    use super::*;

    /// Recordings of a synthetic study are not taken for signals that were put on a faster grid.
    #[test]
    fn verif_smooth_noise_has_no_corners() {
        for (rate, length) in [(100.0, ANGLE_TIME), (1000.0, ANGLE_TIME), (1000.0, EMG_TIME)] {
            let time: Vec<f64> = (0..3500).map(|i| f64::from(i) / rate).collect();
            for seed in 0..3 {
                let noise = smooth_noise(&time, length, &mut ChaCha8Rng::seed_from_u64(seed));
                assert_eq!(own_samples(&noise), None, "{rate} Hz, seed {seed}");
            }
        }
    }

    #[test]
    fn verif_smooth_noise_has_unit_variance_and_its_correlation_time() {
        let time: Vec<f64> = (0..60_000).map(|i| 0.01 * f64::from(i)).collect();
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let x = smooth_noise(&time, 0.1, &mut random);
        let mean_of = |lag: usize| {
            let n = x.len() - lag;
            (0..n).map(|i| x[i] * x[i + lag]).sum::<f64>() / n as f64
        };
        // 6,000 correlation times: a standard error of about 2 %.
        assert!((mean_of(0) - 1.0).abs() < 0.06, "{}", mean_of(0));
        assert!((mean_of(10) - (-0.5f64).exp()).abs() < 0.06, "{}", mean_of(10));
        assert!(mean_of(60).abs() < 0.06, "{}", mean_of(60));
    }
}
