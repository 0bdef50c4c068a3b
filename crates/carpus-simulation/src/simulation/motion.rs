//! The prescribed motion of the dynamometer's coordinate, as a smooth function of time.

use nalgebra::{Matrix2, Vector2};

use super::piecewise::{locate, polynomial, quintic};
use carpus_osim::functions::{Function, FunctionError};
use carpus_osim::osim::spec::FunctionSpec;

/// How the angle between samples is found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum MotionInterpolation {
    /// A natural spline of degree five through every sample: what OpenSim's tools make of a motion file (`GCVSpline`
    /// of degree 5, error variance 0). Follows the recording exactly, its noise included.
    #[default]
    ThroughSamples,
    /// The smoothest spline of degree five whose distance from the samples has this standard deviation [rad or m]
    /// (`GCVSpline` with an error variance): for angles with noticeable noise, whose derivative would be rough.
    Smoothed {
        /// Standard deviation of the angle's noise [rad or m].
        noise: f64,
    },
}

/// Angle, speed and acceleration over time: a quintic polynomial per sample interval.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    times: Vec<f64>,
    /// Reciprocal duration, and coefficients in the local time 0…1, lowest power first.
    pieces: Vec<(f64, [f64; 6])>,
}

impl Motion {
    /// Interpolates samples; `times` increases strictly.
    ///
    /// Speed and acceleration are the derivatives of the interpolated angle: a recorded velocity is not used, so that
    /// lengths and speeds of muscles belong to the same motion.
    ///
    /// # Errors
    /// Fewer than six samples; values that are not finite.
    pub(crate) fn interpolate(
        times: &[f64],
        angles: &[f64],
        interpolation: MotionInterpolation,
    ) -> Result<Motion, FunctionError> {
        // A held angle stays exactly constant: a spline through it would carry rounding.
        let jets: Vec<[f64; 3]> = if angles.iter().all(|a| *a == angles[0]) {
            vec![[angles[0], 0.0, 0.0]; times.len()]
        } else {
            match interpolation {
                MotionInterpolation::ThroughSamples => natural_quintic(times, angles),
                MotionInterpolation::Smoothed { noise } => smoothed(times, angles, noise)?,
            }
        };
        let mut pieces = Vec::with_capacity(times.len() - 1);
        for (pair, ends) in times.windows(2).zip(jets.windows(2)) {
            let h = pair[1] - pair[0];
            pieces.push((1.0 / h, quintic(ends[0], ends[1], h)));
        }
        Ok(Motion { times: times.to_vec(), pieces })
    }

    #[inline]
    fn piece(&self, time: f64, cursor: &mut usize) -> (f64, f64, &[f64; 6]) {
        let i = locate(self.pieces.len(), |i| self.times[i], time, cursor);
        let (per_second, coefficients) = &self.pieces[i];
        ((time - self.times[i]) * per_second, *per_second, coefficients)
    }

    /// Angle at `time` [rad or m].
    #[inline]
    pub(crate) fn angle(&self, time: f64, cursor: &mut usize) -> f64 {
        let (t, _, c) = self.piece(time, cursor);
        polynomial(c, t)
    }

    /// Angle, speed and acceleration at `time`.
    pub(crate) fn jet(&self, time: f64, cursor: &mut usize) -> [f64; 3] {
        let (t, rate, c) = self.piece(time, cursor);
        [
            polynomial(c, t),
            rate * (c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4] + t * 5.0 * c[5])))),
            rate * rate * (2.0 * c[2] + t * (6.0 * c[3] + t * (12.0 * c[4] + t * 20.0 * c[5]))),
        ]
    }

    /// Smallest and largest angle, between samples too.
    pub(crate) fn range(&self) -> [f64; 2] {
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for (_, c) in &self.pieces {
            for k in 0..=4 {
                let t = 0.25 * k as f64;
                let angle = polynomial(c, t);
                range = [range[0].min(angle), range[1].max(angle)];
            }
        }
        range
    }
}

/// Speed [rad/s] and acceleration [rad/s²] at samples of an angle [rad], as a simulation has them.
///
/// - `times`: increasing [s]
///
/// # Errors
/// Fewer than six samples; values that are not finite.
pub fn speed_and_acceleration(times: &[f64], angles: &[f64]) -> Result<[Vec<f64>; 2], FunctionError> {
    let motion = Motion::interpolate(times, angles, MotionInterpolation::default())?;
    let mut cursor = 0;
    let jets: Vec<[f64; 3]> = times.iter().map(|t| motion.jet(*t, &mut cursor)).collect();
    Ok([1, 2].map(|i| jets.iter().map(|jet| jet[i]).collect()))
}

/// Value, slope and second derivative at every sample of the natural spline of degree five through the samples.
///
/// Each interval is the quintic with given values, slopes v and second derivatives a at its ends. The third and fourth
/// derivatives agree at inner samples and vanish at the ends: two equations per sample for v and a, block tridiagonal.
/// The same spline as `GCVSpline` of degree 5 with error variance 0, in linear time.
fn natural_quintic(times: &[f64], angles: &[f64]) -> Vec<[f64; 3]> {
    let n = times.len();
    let mut upper = vec![Matrix2::zeros(); n];
    let mut solution = vec![Vector2::zeros(); n];
    for i in 0..n {
        let (mut diagonal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        if i + 1 < n {
            // Third and fourth derivative at the start of the interval after the sample.
            let h = times[i + 1] - times[i];
            let slope = (angles[i + 1] - angles[i]) / h;
            let (h1, h2, h3) = (1.0 / h, 1.0 / (h * h), 1.0 / (h * h * h));
            diagonal += Matrix2::new(-36.0 * h2, -9.0 * h1, 192.0 * h3, 36.0 * h2);
            upper[i] = Matrix2::new(-24.0 * h2, 3.0 * h1, 168.0 * h3, -24.0 * h2);
            right -= Vector2::new(60.0 * slope * h2, -360.0 * slope * h3);
        }
        if i > 0 {
            // Less those at the end of the interval before it.
            let h = times[i] - times[i - 1];
            let slope = (angles[i] - angles[i - 1]) / h;
            let (h1, h2, h3) = (1.0 / h, 1.0 / (h * h), 1.0 / (h * h * h));
            diagonal -= Matrix2::new(-36.0 * h2, 9.0 * h1, -192.0 * h3, 36.0 * h2);
            let lower = -Matrix2::new(-24.0 * h2, -3.0 * h1, -168.0 * h3, -24.0 * h2);
            right += Vector2::new(60.0 * slope * h2, 360.0 * slope * h3);
            diagonal -= lower * upper[i - 1];
            right -= lower * solution[i - 1];
        }
        // Times increase strictly, so that no block is singular.
        let inverse = diagonal.try_inverse().unwrap_or_else(Matrix2::zeros);
        upper[i] = inverse * upper[i];
        solution[i] = inverse * right;
    }
    for i in (0..n - 1).rev() {
        let next = solution[i + 1];
        solution[i] -= upper[i] * next;
    }
    angles.iter().zip(&solution).map(|(angle, s)| [*angle, s[0], s[1]]).collect()
}

/// Value, slope and second derivative at every sample of the smoothing spline.
fn smoothed(times: &[f64], angles: &[f64], noise: f64) -> Result<Vec<[f64; 3]>, FunctionError> {
    let spline = Function::compile(&FunctionSpec::GcvSpline {
        half_order: 3,
        error_variance: noise * noise,
        x: times.to_vec(),
        y: angles.to_vec(),
        weights: Vec::new(),
    })?;
    Ok(times.iter().map(|&t| [spline.value(t), spline.derivative(t), spline.second_derivative(t)]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_motion_passes_through_samples_and_its_derivatives_are_consistent() {
        let times: Vec<f64> = (0..101).map(|i| 0.01 * i as f64).collect();
        let angles: Vec<f64> = times.iter().map(|t| 0.6 * (3.0 * t).sin()).collect();
        let motion = Motion::interpolate(&times, &angles, MotionInterpolation::ThroughSamples).unwrap();
        let mut cursor = 0;
        for (t, a) in times.iter().zip(&angles) {
            assert!((motion.angle(*t, &mut cursor) - a).abs() < 1e-12);
        }
        for t in [0.2034, 0.5, 0.71, 0.8999] {
            let [angle, speed, acceleration] = motion.jet(t, &mut cursor);
            assert!((angle - 0.6 * (3.0 * t).sin()).abs() < 1e-10);
            assert!((speed - 1.8 * (3.0 * t).cos()).abs() < 1e-7);
            assert!((acceleration + 5.4 * (3.0 * t).sin()).abs() < 1e-4);
        }
        let [low, high] = motion.range();
        assert!((low - 0.0).abs() < 1e-9 && (high - 0.6).abs() < 1e-5);
    }

    #[test]
    fn verif_spline_through_samples_is_opensims() {
        let times: Vec<f64> = (0..200).map(|i| 0.01 * i as f64 + 0.003 * (i as f64).sin()).collect();
        let angles: Vec<f64> = times.iter().map(|t| 0.3 * (4.0 * t).sin() + 0.02 * (55.0 * t).cos()).collect();
        let jets = natural_quintic(&times, &angles);
        for (found, expected) in jets.iter().zip(smoothed(&times, &angles, 0.0).unwrap()) {
            for (k, scale) in [1.0, 10.0, 1000.0].into_iter().enumerate() {
                assert!((found[k] - expected[k]).abs() < 1e-7 * scale, "{found:?} {expected:?}");
            }
        }
    }

    #[test]
    fn verif_smoothing_removes_noise_and_keeps_the_motion() {
        let times: Vec<f64> = (0..401).map(|i| 0.01 * i as f64).collect();
        let noise = |i: usize| 2e-3 * (((i * i * 7919 + 31 * i) % 104_729) as f64).sin();
        let angles: Vec<f64> = times.iter().enumerate().map(|(i, t)| 0.5 * (2.0 * t).sin() + noise(i)).collect();
        let speed_error = |interpolation| {
            let motion = Motion::interpolate(&times, &angles, interpolation).unwrap();
            let mut cursor = 0;
            (50..350).map(|i| (motion.jet(times[i], &mut cursor)[1] - (2.0 * times[i]).cos()).abs()).sum::<f64>()
                / 300.0
        };
        let rough = speed_error(MotionInterpolation::ThroughSamples);
        let smooth = speed_error(MotionInterpolation::Smoothed { noise: 2e-3 / 2.0_f64.sqrt() });
        assert!(smooth < 0.15 * rough, "{smooth} {rough}");
    }
}
