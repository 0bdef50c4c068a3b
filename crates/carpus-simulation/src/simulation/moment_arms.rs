//! Moment arms of active muscles about any coordinate, along a recorded angle.

use super::error::SimulationError;
use super::model::{HeldCoordinate, MusculoskeletalModel, independent_coordinate};

impl MusculoskeletalModel {
    /// Moment arm of every active muscle about a coordinate at every sample [m], while the dynamometer's coordinate is
    /// at `angle` [rad or m] and all others at the posture of the study. Couplers are followed.
    ///
    /// - `held`: coordinates held otherwise than in the posture of the study
    ///
    /// # Errors
    /// An unknown coordinate, one that a coupler determines, or one that loops of constraints move with.
    pub fn moment_arms_about(
        &self,
        coordinate: &str,
        held: &[HeldCoordinate],
        angle: &[f64],
    ) -> Result<Vec<Vec<f64>>, SimulationError> {
        let skeleton = &self.skeleton;
        let about = independent_coordinate(skeleton, coordinate)?;
        if let Some(loops) = &self.closed_loops {
            loops.check_alone(skeleton, about)?;
        }
        let mut q = self.posture_with(held)?;
        let mut cache = skeleton.new_cache();
        let mut geometries: Vec<_> = self.muscles.iter().map(|m| m.path.new_geometry()).collect();
        let mut arms: Vec<Vec<f64>> = vec![Vec::with_capacity(angle.len()); self.muscles.len()];
        let mut last: Option<f64> = None;
        for &value in angle {
            if last == Some(value) {
                arms.iter_mut().for_each(|a| a.push(a[a.len() - 1]));
                continue;
            }
            last = Some(value);
            q[self.coordinate.0] = value;
            skeleton.satisfy_couplers(&mut q);
            skeleton.update_positions(&q, &mut cache);
            skeleton.update_unit_motion(&q, about, &mut cache);
            for ((muscle, geometry), arms) in self.muscles.iter().zip(&mut geometries).zip(&mut arms) {
                muscle.path.update(&q, &cache, geometry);
                arms.push(muscle.path.moment_arm(&q, &cache, geometry));
            }
        }
        Ok(arms)
    }
}
