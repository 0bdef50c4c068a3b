//! Activation a(t) of one muscle over a trial, from its excitation e(t).
//!
//! Activation does not depend on fibre length, so it is integrated once per trial and muscle; a change of the muscle's
//! lengths or force costs nothing here. The excitation is piecewise linear between samples, as with OpenSim's
//! `PrescribedController` over `PiecewiseLinearFunction`. The dynamics are those of the muscle's class
//! ([`ActivationDynamics`]).

pub(crate) mod tangent;

use super::activation_dynamics::{ActivationDynamics, Branch, steps};
use super::piecewise::{locate, polynomial, quintic};

/// Local error of one step, absolute. Activation errors decay with the time constants, so that the global error stays
/// near it: far below what moves a force by 1e-6 of its maximum.
const STEP_TOLERANCE: f64 = 2e-8;

/// Most pieces per sample, on average over a trial: a sample every 0.4 s, the coarsest that is read, takes 40 of them
/// at usual time constants. Time
/// constants that need more are shorter by orders of magnitude.
const MOST_PIECES_PER_SAMPLE: usize = 1000;

/// Activation cannot be followed: its time constants are too short for the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TooFast {
    /// Time up to which it was followed [s].
    pub(crate) time: f64,
}

/// One piece of a trajectory: a quintic in the local coordinate 0…1.
#[derive(Clone, Copy, Debug)]
struct Piece {
    start: f64,
    per_second: f64,
    coefficients: [f64; 6],
    branch: Branch,
}

/// Activation as a function of time.
#[derive(Clone, Debug)]
pub(crate) struct ActivationTrajectory {
    pieces: Vec<Piece>,
    bounds: [f64; 2],
}

impl ActivationTrajectory {
    /// Integrates activation over the samples `time`, `excitation` (piecewise linear between them).
    ///
    /// Activation starts at the first excitation, within a_min…1: the muscle is taken to be in steady state when the
    /// recording starts. `time` increases strictly and has at least two samples.
    ///
    /// # Errors
    /// [`TooFast`] where time constants are shorter than the steps of time by orders of magnitude.
    pub(crate) fn integrate(
        dynamics: &ActivationDynamics,
        time: &[f64],
        excitation: &[f64],
    ) -> Result<ActivationTrajectory, TooFast> {
        let mut trajectory =
            ActivationTrajectory { pieces: Vec::with_capacity(time.len()), bounds: [dynamics.minimum_activation, 1.0] };
        let most = MOST_PIECES_PER_SAMPLE * time.len();
        let mut a = dynamics.clamp(excitation[0]);
        let mut trial_step = f64::INFINITY;
        for k in 0..time.len() - 1 {
            let slope = (excitation[k + 1] - excitation[k]) / (time[k + 1] - time[k]);
            let segment = Segment { start: time[k], end: time[k + 1], excitation: excitation[k], slope };
            if dynamics.is_ignored() {
                let coefficients = [excitation[k], excitation[k + 1] - excitation[k], 0.0, 0.0, 0.0, 0.0];
                trajectory.push(segment.start, segment.end, coefficients, Branch::Activating);
            } else {
                a = trajectory.integrate_segment(dynamics, segment, a, &mut trial_step, most)?;
            }
        }
        trajectory.pieces.shrink_to_fit();
        Ok(trajectory)
    }

    fn integrate_segment(
        &mut self,
        dynamics: &ActivationDynamics,
        segment: Segment,
        mut a: f64,
        trial_step: &mut f64,
        most: usize,
    ) -> Result<f64, TooFast> {
        let duration = segment.end - segment.start;
        let resolution = 1e-9 * duration;
        let gap = |elapsed: f64, a: f64| segment.excitation + segment.slope * elapsed - dynamics.clamp(a);
        let mut elapsed = 0.0;
        let start_gap = gap(0.0, a);
        let mut branch = if start_gap > 0.0 || (start_gap == 0.0 && segment.slope > 0.0) {
            Branch::Activating
        } else {
            Branch::Deactivating
        };
        let mut rate = dynamics.rate(a, segment.excitation, branch);
        while duration - elapsed > resolution {
            if self.pieces.len() >= most {
                return Err(TooFast { time: segment.start + elapsed });
            }
            let e = segment.excitation + segment.slope * elapsed;
            let mut h = trial_step.min(duration - elapsed);
            if duration - elapsed - h < resolution {
                h = duration - elapsed;
            }
            let (mut next, error, mut end_rate) = dynamics.step(a, e, segment.slope, h, rate, branch);
            if error > STEP_TOLERANCE && h > resolution {
                *trial_step = h * growth(error);
                continue;
            }
            // A step that the sample interval has cut short may lengthen the next one, but not shorten it.
            if h >= *trial_step {
                *trial_step = h * growth(error);
            } else if growth_exceeds(error, *trial_step / h) {
                *trial_step = (h * growth(error)).max(*trial_step);
            }
            let mut crossed = false;
            let end_gap = gap(elapsed + h, next);
            if (branch == Branch::Activating) != (end_gap > 0.0) && end_gap != 0.0 {
                // The excitation meets the activation inside the step: end the step there.
                let piece = hermite(dynamics, [a, next], [rate, end_rate], e, segment.slope, h, branch);
                let (mut low, mut high) = (0.0, h);
                for _ in 0..50 {
                    let middle = 0.5 * (low + high);
                    let on_branch = gap(elapsed + middle, polynomial(&piece, middle / h)) > 0.0;
                    if on_branch == (branch == Branch::Activating) { low = middle } else { high = middle }
                }
                h = high;
                (next, _, end_rate) = dynamics.step(a, e, segment.slope, h, rate, branch);
                crossed = true;
            }
            if h > 0.0 {
                let start = segment.start + elapsed;
                let end = if duration - elapsed - h <= resolution { segment.end } else { start + h };
                let coefficients = hermite(dynamics, [a, next], [rate, end_rate], e, segment.slope, h, branch);
                self.push(start, end, coefficients, branch);
                (a, rate) = (next, end_rate);
                elapsed += h;
            }
            if crossed {
                branch = match branch {
                    Branch::Activating => Branch::Deactivating,
                    Branch::Deactivating => Branch::Activating,
                };
                rate = dynamics.rate(a, segment.excitation + segment.slope * elapsed, branch);
            }
        }
        Ok(a)
    }

    fn push(&mut self, start: f64, end: f64, coefficients: [f64; 6], branch: Branch) {
        self.pieces.push(Piece { start, per_second: 1.0 / (end - start), coefficients, branch });
    }

    /// Activations for two excitations or time constants near those of this trajectory, in exactly the same steps:
    /// differences of such trajectories are differences of one smooth function. Where the excitation meets the
    /// activation, both sides' rates are zero, so that the moment at which a step changes sides matters to second order
    /// only.
    ///
    /// - `time`: the samples of this trajectory
    pub(crate) fn beside(
        &self,
        dynamics: [&ActivationDynamics; 2],
        time: &[f64],
        excitation: [&[f64]; 2],
    ) -> [ActivationTrajectory; 2] {
        let mut beside = dynamics.map(|d| ActivationTrajectory {
            pieces: Vec::with_capacity(self.pieces.len()),
            bounds: [d.minimum_activation, 1.0],
        });
        let mut a = [0, 1].map(|i| dynamics[i].clamp(excitation[i][0]));
        let (mut k, mut known) = (0, None);
        for (j, piece) in self.pieces.iter().enumerate() {
            let start = piece.start;
            let end = self.pieces.get(j + 1).map_or(time[time.len() - 1], |next| next.start);
            while k + 2 < time.len() && start >= time[k + 1] {
                k += 1;
            }
            let slope = excitation.map(|e| (e[k + 1] - e[k]) / (time[k + 1] - time[k]));
            let e = [0, 1].map(|i| excitation[i][k] + slope[i] * (start - time[k]));
            let h = end - start;
            // The rate at the end of a step is that at the start of the next on the same side.
            let rate = match known {
                Some((branch, rate)) if branch == piece.branch => rate,
                _ => [0, 1].map(|i| dynamics[i].rate(a[i], e[i], piece.branch)),
            };
            let (next, _, end_rate) = steps(dynamics, a, e, slope, h, rate, piece.branch);
            for (i, beside) in beside.iter_mut().enumerate() {
                let coefficients = if dynamics[i].is_ignored() {
                    [e[i], slope[i] * h, 0.0, 0.0, 0.0, 0.0]
                } else {
                    hermite(dynamics[i], [a[i], next[i]], [rate[i], end_rate[i]], e[i], slope[i], h, piece.branch)
                };
                beside.push(start, end, coefficients, piece.branch);
            }
            (a, known) = (next, Some((piece.branch, end_rate)));
        }
        beside
    }

    /// Activation at `time`, within its bounds. `cursor` remembers the piece for the next call at a nearby time.
    #[inline]
    pub(crate) fn value(&self, time: f64, cursor: &mut usize) -> f64 {
        let i = locate(self.pieces.len(), |i| self.pieces[i].start, time, cursor);
        let piece = &self.pieces[i];
        let t = (time - piece.start) * piece.per_second;
        polynomial(&piece.coefficients, t).max(self.bounds[0]).min(self.bounds[1])
    }
}

/// By which factor the next step may be longer, from the error of the last one.
fn growth(error: f64) -> f64 {
    (0.9 * fifth_root(STEP_TOLERANCE / error.max(1e-30))).clamp(0.2, 4.0)
}

/// Whether [`growth`] is certainly not below `factor`, without the root.
fn growth_exceeds(error: f64, factor: f64) -> bool {
    let f = factor / 0.9;
    let f2 = f * f;
    factor < 4.0 && error.max(1e-30) * (f2 * f2 * f) < STEP_TOLERANCE
}

/// x^(1/5) within 0.3 % for a positive, normal x: a fifth of the exponent, then a step of Newton's method.
fn fifth_root(x: f64) -> f64 {
    // Four fifths of the bits of 1.0, less what centres the error.
    const OFFSET: u64 = 0x3325_D2F1_A9FB_E76D;
    let guess = f64::from_bits(x.to_bits() / 5 + OFFSET);
    let g2 = guess * guess;
    0.8 * guess + 0.2 * x / (g2 * g2)
}

/// Excitation between two samples.
#[derive(Clone, Copy)]
struct Segment {
    start: f64,
    end: f64,
    excitation: f64,
    slope: f64,
}

/// Quintic through both ends of a step with their first and second derivatives.
fn hermite(
    d: &ActivationDynamics,
    [a0, a1]: [f64; 2],
    rates: [f64; 2],
    e0: f64,
    slope: f64,
    h: f64,
    branch: Branch,
) -> [f64; 6] {
    let e1 = e0 + slope * h;
    let left = [a0, rates[0], d.acceleration(a0, e0, slope, rates[0], branch)];
    let right = [a1, rates[1], d.acceleration(a1, e1, slope, rates[1], branch)];
    quintic(left, right, h)
}

#[cfg(test)]
mod tests {
    use super::super::activation_dynamics::ActivationLaw;
    use super::*;

    #[test]
    fn verif_fifth_root() {
        for i in -900..900 {
            let x = 10.0_f64.powf(0.1 * f64::from(i) / 3.0);
            let ratio = fifth_root(x) / x.powf(0.2);
            assert!((ratio - 1.0).abs() < 3e-3, "{x:e}: {ratio}");
        }
    }

    const DYNAMICS: ActivationDynamics = ActivationDynamics {
        activation_time_constant: 0.01,
        deactivation_time_constant: 0.04,
        minimum_activation: 0.01,
        law: ActivationLaw::FirstOrder,
    };

    /// Brute force: classical Runge–Kutta with very many steps of the differential equation as OpenSim writes it.
    fn brute_force(time: &[f64], excitation: &[f64], at: &[f64]) -> Vec<f64> {
        let rate = |t: f64, a: f64| {
            let k = time.partition_point(|&s| s <= t).clamp(1, time.len() - 1) - 1;
            let e = excitation[k] + (excitation[k + 1] - excitation[k]) * (t - time[k]) / (time[k + 1] - time[k]);
            let a = a.clamp(0.01, 1.0);
            let tau = if e > a { 0.01 * (0.5 + 1.5 * a) } else { 0.04 / (0.5 + 1.5 * a) };
            (e - a) / tau
        };
        let (mut t, mut a) = (time[0], excitation[0].clamp(0.01, 1.0));
        let mut out = Vec::new();
        for &target in at {
            let steps = ((target - t) / 2e-6).ceil().max(1.0) as usize;
            let h = (target - t) / steps as f64;
            for _ in 0..steps {
                let k1 = rate(t, a);
                let k2 = rate(t + 0.5 * h, a + 0.5 * h * k1);
                let k3 = rate(t + 0.5 * h, a + 0.5 * h * k2);
                let k4 = rate(t + h, a + h * k3);
                a += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
                t += h;
            }
            out.push(a.clamp(0.01, 1.0));
        }
        out
    }

    /// A time constant of a nanosecond (of seconds, that of nanoseconds) would take memory for 10⁸ pieces a second.
    #[test]
    fn verif_time_constants_shorter_than_the_steps_by_orders_of_magnitude_are_refused() {
        let time: Vec<f64> = (0..100).map(|i| 0.01 * f64::from(i)).collect();
        let excitation: Vec<f64> = time.iter().map(|t| 0.5 + 0.4 * (6.0 * t).sin()).collect();
        let with = |activation_time_constant: f64, deactivation_time_constant: f64| {
            let dynamics = ActivationDynamics { activation_time_constant, deactivation_time_constant, ..DYNAMICS };
            ActivationTrajectory::integrate(&dynamics, &time, &excitation)
        };
        assert!(with(1e-9, 0.04).is_err() && with(0.01, 1e-12).is_err());
        let usual = with(0.01, 0.04).unwrap();
        assert!(usual.pieces.len() < 10 * time.len() && usual.pieces.capacity() < 20 * time.len());
        // A hundred times faster than muscle is followed all the same.
        assert!(with(1e-4, 4e-4).is_ok());
        // The coarsest samples that a study may have.
        let coarse: Vec<f64> = (0..100).map(|i| 0.4 * f64::from(i)).collect();
        let alternating: Vec<f64> = (0..100).map(|i| f64::from(i % 2)).collect();
        let pieces = ActivationTrajectory::integrate(&DYNAMICS, &coarse, &alternating).unwrap().pieces.len();
        println!("{pieces} pieces for 100 samples 0.4 s apart");
        assert!(pieces < MOST_PIECES_PER_SAMPLE / 10 * coarse.len(), "{pieces}");
    }

    #[test]
    fn verif_activation_matches_brute_force_on_rough_excitation() {
        let time: Vec<f64> = (0..60).map(|i| 0.3 + 0.01 * i as f64).collect();
        let excitation: Vec<f64> = (0..60)
            .map(|i| (0.45 + 0.45 * (0.7 * i as f64).sin() + 0.08 * (5.1 * i as f64).cos()).clamp(0.0, 1.0))
            .collect();
        let trajectory = ActivationTrajectory::integrate(&DYNAMICS, &time, &excitation).unwrap();
        let at: Vec<f64> = (1..400).map(|i| 0.3 + 0.59 * i as f64 / 400.0).collect();
        let reference = brute_force(&time, &excitation, &at);
        let mut cursor = 0;
        let worst =
            at.iter().zip(&reference).map(|(&t, r)| (trajectory.value(t, &mut cursor) - r).abs()).fold(0.0, f64::max);
        println!("largest activation error {worst:.2e}, {} pieces", trajectory.pieces.len());
        assert!(worst < 1e-6, "{worst:e}");
    }

    /// The laws of other classes against very many Runge–Kutta steps of their equations, between samples, too.
    #[test]
    fn verif_activation_of_other_laws_matches_brute_force() {
        let time: Vec<f64> = (0..60).map(|i| 0.01 * f64::from(i)).collect();
        let excitation: Vec<f64> = (0..60)
            .map(|i| (0.4 + 0.4 * (0.14 * f64::from(i)).sin() + 0.02 * (5.1 * f64::from(i)).cos()).clamp(0.0, 1.0))
            .collect();
        for law in
            [ActivationLaw::Linear, ActivationLaw::Smooth { steepness: 0.1 }, ActivationLaw::Smooth { steepness: 9.0 }]
        {
            let dynamics = ActivationDynamics {
                activation_time_constant: 0.011,
                deactivation_time_constant: 0.0685,
                minimum_activation: 0.0,
                law,
            };
            let rate = |t: f64, a: f64| {
                let k = time.partition_point(|&s| s <= t).clamp(1, time.len() - 1) - 1;
                let e = excitation[k] + (excitation[k + 1] - excitation[k]) * (t - time[k]) / (time[k + 1] - time[k]);
                let (act, deact) = (1.0 / 0.011, 1.0 / 0.0685);
                match law {
                    ActivationLaw::Smooth { steepness } => {
                        let f = 0.5 * (steepness * (e - a)).tanh();
                        let s = 0.5 + 1.5 * a;
                        (e - a) * ((0.5 + f) * act / s + (0.5 - f) * s * deact)
                    }
                    _ => (e - a) * (deact + if e >= a { (act - deact) * e } else { 0.0 }),
                }
            };
            let trajectory = ActivationTrajectory::integrate(&dynamics, &time, &excitation).unwrap();
            let (mut t, mut a, mut cursor, mut worst) = (0.0, excitation[0], 0, 0.0_f64);
            let h = 1e-5;
            for i in 0..59_000 {
                let k1 = rate(t, a);
                let k2 = rate(t + 0.5 * h, a + 0.5 * h * k1);
                let k3 = rate(t + 0.5 * h, a + 0.5 * h * k2);
                let k4 = rate(t + h, a + h * k3);
                a += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
                t = h * f64::from(i + 1);
                worst = worst.max((trajectory.value(t, &mut cursor) - a).abs());
            }
            println!("{law:?}: within {worst:.1e}");
            assert!(worst < 2e-6, "{law:?}: {worst:e}");
        }
    }

    #[test]
    fn verif_state_drifts_below_minimum_as_in_opensim_while_muscles_see_the_minimum() {
        let trajectory =
            ActivationTrajectory::integrate(&DYNAMICS, &[0.0, 1.0, 1.001, 2.0], &[0.0, 0.0, 0.3, 0.3]).unwrap();
        let mut cursor = 0;
        assert_eq!(trajectory.value(0.9, &mut cursor), 0.01);
        let at = [1.002, 1.005, 1.02, 1.1];
        let reference = brute_force(&[0.0, 1.0, 1.001, 2.0], &[0.0, 0.0, 0.3, 0.3], &at);
        for (t, r) in at.iter().zip(reference) {
            assert!((trajectory.value(*t, &mut cursor) - r).abs() < 1e-6, "t = {t}");
        }
    }

    #[test]
    fn verif_ignored_dynamics_follow_excitation() {
        let dynamics = ActivationDynamics { law: ActivationLaw::Excitation, ..DYNAMICS };
        let trajectory = ActivationTrajectory::integrate(&dynamics, &[0.0, 1.0, 2.0], &[0.0, 1.2, 0.2]).unwrap();
        let mut cursor = 0;
        let values = [0.0, 0.5, 1.0, 1.5].map(|t| trajectory.value(t, &mut cursor));
        assert!((values[0] - 0.01).abs() < 1e-15 && (values[1] - 0.6).abs() < 1e-12);
        assert!((values[2] - 1.0).abs() < 1e-15 && (values[3] - 0.7).abs() < 1e-12);
    }
}
