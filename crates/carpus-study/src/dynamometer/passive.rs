//! The moment of the relaxed limb: gravity, stretched tissue, the machine's own weight.

use nalgebra::DMatrix;

use super::regression::{RegressionError, clustered_regression};

/// A passive trial: the machine moves a relaxed joint.
#[derive(Clone, Copy, Debug)]
pub struct PassiveRun<'a> {
    /// Angle \[rad\].
    pub angle: &'a [f64],
    /// Angular velocity [rad/s].
    pub velocity: &'a [f64],
    /// Moment, drag of the machine removed [N·m].
    pub moment: &'a [f64],
}

/// The moment of the relaxed limb as a function of angle and velocity.
///
/// ```text
/// M(q, q̇) = Σ_k c_k x^k − d·q̇        x = (q − centre)/half width of the angles recorded
/// ```
/// Beyond the angles and speeds recorded the nearest value holds: what resists a slow rotation is mostly not viscous,
/// and would be overrated at high speed.
#[derive(Clone, Debug, PartialEq)]
pub struct PassiveCurve {
    /// Range of the angles recorded \[rad\]; beyond it the nearest value holds.
    pub range: [f64; 2],
    /// c₀, c₁, … [N·m].
    pub coefficients: Vec<f64>,
    /// Viscous damping of the joint d [N·m·s/rad].
    pub damping: f64,
    /// Speed up to which it was recorded [rad/s]: the 90th percentile of the fastest trial.
    pub speed: f64,
    /// Root mean square of what is left [N·m].
    pub residual: f64,
    /// Share of the variance explained.
    pub r_squared: f64,
}

/// Why there is no curve.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PassiveError {
    /// No passive trial.
    #[error("no passive trial")]
    NoRun,
    /// The joint hardly moves.
    #[error("the passive trials move by {range_deg:.3} deg; expected at least 1 deg")]
    NoMotion {
        /// Range of the angle \[deg\].
        range_deg: f64,
    },
    /// The regression.
    #[error(transparent)]
    Regression(#[from] RegressionError),
}

impl PassiveCurve {
    /// The moment [N·m].
    pub fn moment(&self, angle: f64, velocity: f64) -> f64 {
        let x = scaled(angle.clamp(self.range[0], self.range[1]), self.range);
        self.coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
            - self.damping * velocity.clamp(-self.speed, self.speed)
    }

    /// Whether the relaxed limb would drive the machine by more than the scatter: moment and angle then have opposite
    /// positive directions.
    pub fn drives_the_machine(&self) -> bool {
        -self.damping * self.speed > self.residual
    }

    /// Whether the angle was recorded.
    pub fn covers(&self, angle: f64) -> bool {
        (self.range[0]..=self.range[1]).contains(&angle)
    }
}

/// 90th percentile of the speed.
fn brisk(velocity: &[f64]) -> f64 {
    let mut speeds: Vec<f64> = velocity.iter().map(|v| v.abs()).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.get(speeds.len() * 9 / 10).copied().unwrap_or(0.0)
}

fn scaled(angle: f64, [low, high]: [f64; 2]) -> f64 {
    (2.0 * angle - low - high) / (high - low)
}

/// Fits the moment of the relaxed limb to passive trials by least squares.
///
/// - `order`: of the polynomial in the angle
///
/// # Errors
/// [`PassiveError`].
pub fn fit_passive(runs: &[PassiveRun<'_>], order: usize) -> Result<PassiveCurve, PassiveError> {
    if runs.is_empty() {
        return Err(PassiveError::NoRun);
    }
    let angles = runs.iter().flat_map(|run| run.angle);
    let range = angles.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], a| [low.min(*a), high.max(*a)]);
    if !(range[1] - range[0] >= 1f64.to_radians()) {
        return Err(PassiveError::NoMotion { range_deg: (range[1] - range[0]).to_degrees() });
    }
    let samples: Vec<(usize, usize)> =
        runs.iter().enumerate().flat_map(|(r, run)| (0..run.angle.len()).map(move |i| (r, i))).collect();
    let design = DMatrix::from_fn(samples.len(), order + 2, |row, column| {
        let (r, i) = samples[row];
        match column {
            0 => -runs[r].velocity[i],
            power => scaled(runs[r].angle[i], range).powi(power as i32 - 1),
        }
    });
    let moment: Vec<f64> = samples.iter().map(|(r, i)| runs[*r].moment[*i]).collect();
    // Only the curve is wanted: halves of the data stand in for clusters.
    let cluster: Vec<usize> = (0..samples.len()).map(|i| usize::from(2 * i >= samples.len())).collect();
    let fit = clustered_regression(&design, &moment, &cluster)?;
    Ok(PassiveCurve {
        range,
        damping: fit.coefficients[0],
        speed: runs.iter().map(|run| brisk(run.velocity)).fold(0.0, f64::max),
        coefficients: fit.coefficients[1..].to_vec(),
        residual: fit.residual,
        r_squared: fit.r_squared,
    })
}
