//! What a model of this kind never gets right: columns of a smooth relative error of every muscle's moment.
//! It is equation (6) of `docs/src/theory/many-small-errors.md`:
//!
//! ```text
//! h_m = σ_m Σ_j ω_j c_mj B_j(q, a, v),   c_mj ~ N(0, 1)                                       (6)
//! ```
//! B: polynomials of angle, activation and speed up to the second degree, each variable over the range that
//! the session covers: errors of moment arms and of force–length curves go with the angle, those of the EMG's
//! curvature with activation, those of force–velocity curves with speed. ω falls with the degree, because
//! such errors are smooth. The constant is the muscle's strength and is not among them.
//!
//! # References
//! Brynjarsdóttir & O'Hagan (2014), Learning about physical parameters: the importance of model discrepancy,
//! doi:10.1088/0266-5611/30/11/114007.

use carpus_simulation::simulation::TrialKinematics;

/// Columns per muscle.
pub const PER_MUSCLE: usize = WEIGHTS.len();

/// ω of equation (6): standard deviations of the coefficients of q, a, q², a², q a, v.
const WEIGHTS: [f64; 6] = [1.0, 1.0, 0.5, 0.5, 0.5, 0.5];

/// What the session covers.
#[derive(Clone, Copy, Debug)]
pub struct Ranges {
    /// Least and largest angle [rad].
    pub angle: [f64; 2],
    /// Largest speed [rad/s].
    pub speed: f64,
}

impl Ranges {
    /// Of angles [rad] and speeds [rad/s] of several trials.
    pub fn of<'a>(trials: impl Iterator<Item = (&'a [f64], &'a [f64])>) -> Ranges {
        let mut ranges = Ranges { angle: [f64::INFINITY, f64::NEG_INFINITY], speed: 0.0 };
        for (angle, speed) in trials {
            for q in angle {
                ranges.angle = [ranges.angle[0].min(*q), ranges.angle[1].max(*q)];
            }
            ranges.speed = speed.iter().fold(ranges.speed, |most, v| most.max(v.abs()));
        }
        ranges
    }

    /// −1 to 1 over the range of angles; 0 where there is none.
    fn of_angle(&self, q: f64) -> f64 {
        let [low, high] = self.angle;
        let half = 0.5 * (high - low);
        if half > 1e-3 { (q - 0.5 * (low + high)) / half } else { 0.0 }
    }

    fn of_speed(&self, v: f64) -> f64 {
        if self.speed > 1e-2 { v / self.speed } else { 0.0 }
    }
}

/// Standard deviation of a column's coefficient for unit size.
pub fn weight(column: usize) -> f64 {
    WEIGHTS[column % PER_MUSCLE]
}

/// Columns of one muscle over a trial [N·m].
///
/// - `moment`: of the muscle [N·m]
pub fn columns(ranges: &Ranges, kinematics: &TrialKinematics, muscle: usize, moment: &[f64]) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = (0..PER_MUSCLE).map(|_| Vec::with_capacity(moment.len())).collect();
    for (k, moment) in moment.iter().enumerate() {
        let q = ranges.of_angle(kinematics.angle[k]);
        let v = ranges.of_speed(kinematics.speed[k]);
        let a = 2.0 * kinematics.muscles[muscle].activation[k] - 1.0;
        for (column, basis) in out.iter_mut().zip([q, a, q * q, a * a, q * a, v]) {
            column.push(basis * moment);
        }
    }
    out
}
