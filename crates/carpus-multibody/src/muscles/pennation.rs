//! Fibres that keep the height of the parallelogram they form with the tendon.

use super::error::MuscleError;
use carpus_numerics::numerics::Scalar;

/// Smallest number that OpenSim treats as different from zero (`SimTK::SignificantReal`).
pub(super) fn significant_real() -> f64 {
    f64::EPSILON.powf(7.0 / 8.0)
}

/// Fixed-width pennation: `l sin φ = l_opt sin φ_opt`.
///
/// # References
/// Millard et al. (2013), equation 3, doi:10.1115/1.4023390; OpenSim `MuscleFixedWidthPennationModel`.
#[derive(Clone, Copy, Debug)]
pub struct FixedWidthPennation<S = f64> {
    /// Height of the parallelogram [m]; 0 for a muscle without pennation.
    pub parallelogram_height: S,
    /// Shortest fibre, at the maximum pennation angle [m].
    pub minimum_fiber_length: S,
    /// The same along the tendon [m].
    pub minimum_fiber_length_along_tendon: S,
    is_pennate: bool,
    sin_maximum: f64,
    cos_maximum: f64,
}

/// A fibre's direction.
#[derive(Clone, Copy, Debug)]
pub struct Pennation<S> {
    /// Sine of the pennation angle.
    pub sin: S,
    /// Cosine of the pennation angle.
    pub cos: S,
    /// Whether the fibre is at the maximum pennation angle.
    pub at_maximum: bool,
}

impl<S: Scalar> FixedWidthPennation<S> {
    /// The model for a muscle's properties.
    ///
    /// # Errors
    /// [`MuscleError::InvalidProperty`] unless `optimal_fiber_length` > 0, 0 ≤ `pennation_angle_at_optimal` < π/2 and
    /// 0 ≤ `maximum_pennation_angle` ≤ π/2.
    pub fn new(
        optimal_fiber_length: S,
        pennation_angle_at_optimal: S,
        maximum_pennation_angle: f64,
    ) -> Result<FixedWidthPennation<S>, MuscleError> {
        use std::f64::consts::FRAC_PI_2;
        let check = MuscleError::require;
        let length = optimal_fiber_length.value();
        let angle = pennation_angle_at_optimal.value();
        check(length > 0.0 && length.is_finite(), "optimal_fiber_length", "above 0 m", length)?;
        let ok = (0.0..=FRAC_PI_2 - significant_real()).contains(&angle);
        check(ok, "pennation_angle_at_optimal", "at least 0 and below π/2 rad", angle)?;
        let ok = (0.0..=FRAC_PI_2).contains(&maximum_pennation_angle);
        check(ok, "maximum_pennation_angle", "0 to π/2 rad", maximum_pennation_angle)?;

        let (sin_maximum, cos_maximum) = maximum_pennation_angle.sin_cos();
        let height = optimal_fiber_length * pennation_angle_at_optimal.sin();
        let minimum = if maximum_pennation_angle > significant_real() {
            height / sin_maximum
        } else {
            optimal_fiber_length * 0.01
        };
        Ok(FixedWidthPennation {
            parallelogram_height: height,
            minimum_fiber_length: minimum,
            minimum_fiber_length_along_tendon: minimum * cos_maximum,
            is_pennate: angle > f64::EPSILON,
            sin_maximum,
            cos_maximum,
        })
    }

    /// Direction of a fibre of the given length.
    #[inline]
    pub fn pennation(&self, fiber_length: S) -> Pennation<S> {
        if !self.is_pennate {
            return Pennation { sin: S::constant(0.0), cos: S::constant(1.0), at_maximum: false };
        }
        let sin = self.parallelogram_height / fiber_length;
        if fiber_length.value() > self.minimum_fiber_length.value() && sin.value() < self.sin_maximum {
            Pennation { sin, cos: (-sin * sin + 1.0).sqrt(), at_maximum: false }
        } else {
            Pennation { sin: S::constant(self.sin_maximum), cos: S::constant(self.cos_maximum), at_maximum: true }
        }
    }

    /// dφ/dl [rad/m] of the fixed-width relation, for a fibre longer than the parallelogram is high.
    pub fn angle_slope(&self, fiber_length: S) -> S {
        let sin = self.parallelogram_height / fiber_length;
        -sin / (fiber_length * (-sin * sin + 1.0).sqrt())
    }

    /// Fibre length [m] of a muscle of the given path length with a tendon of the given length.
    pub fn fiber_length(&self, path_length: S, tendon_length: S) -> S {
        let along = path_length - tendon_length;
        if along.value() >= self.minimum_fiber_length_along_tendon.value() {
            if !self.is_pennate {
                return along;
            }
            (self.parallelogram_height * self.parallelogram_height + along * along).sqrt()
        } else {
            self.minimum_fiber_length
        }
    }
}
