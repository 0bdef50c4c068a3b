//! Forces that generalized forces of joints stand for.

use nalgebra::{DMatrix, DVector, Vector3};

use super::compiled::System;
use carpus_multibody::multibody::Cache;
use carpus_numerics::numerics::is_finite;
use carpus_numerics::spatial::SpatialForce;

/// Generalized forces up to this are none (Simbody's `SignificantReal`).
const SIGNIFICANT: f64 = 2.008_771_736_785_476_6e-14;
/// Relative error of a velocity that is a difference of larger ones.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

impl System {
    /// Force that each joint's generalized forces stand for, on its outboard body at the origin of the child frame,
    /// expressed in ground (`Joint::calcEquivalentSpatialForce`): the smallest moment or force, whichever does more,
    /// then the other.
    ///
    /// - `cache`: positions and joint axes
    pub fn equivalent_joint_forces(&self, cache: &Cache, generalized: &[f64]) -> Vec<SpatialForce> {
        let joints = self.spec.joints.iter().map(|joint| {
            let columns: Vec<usize> = joint.coordinates.iter().map(|c| c.0).collect();
            let frame = self.model.frame(joint.child_frame);
            let at = cache.X_GF(&self.model, joint.child_frame).p;
            let (shift, origin) = (at - cache.X_GB(frame.base).p, at.norm());
            let mut w = DMatrix::zeros(columns.len(), 3);
            let mut v = DMatrix::zeros(columns.len(), 3);
            self.model.for_each_partial_velocity(cache, frame.base, |c, velocity| {
                if let Some(row) = columns.iter().position(|column| *column == c) {
                    let at = velocity.shift(&shift);
                    // A joint that only turns moves its own origin by no more than rounding.
                    let rounding = ROUNDING * (velocity.v.norm() + velocity.w.norm() * origin);
                    let moves = |v: f64| if v.abs() > rounding { v } else { 0.0 };
                    (0..3).for_each(|k| (w[(row, k)], v[(row, k)]) = (at.w[k], moves(at.v[k])));
                }
            });
            let f = DVector::from_iterator(columns.len(), columns.iter().map(|c| generalized[*c]));
            let (mut force, mut moment) = (least(&v, &f), least(&w, &f));
            let (by_force, by_moment) = (&v * force, &w * moment);
            let (in_force, in_moment) = (by_force.norm(), by_moment.norm());
            if in_force > SIGNIFICANT && in_moment > SIGNIFICANT {
                // The more effective one first, the other for what is left.
                if in_moment / moment.norm() > in_force / force.norm() {
                    force = least(&v, &(f - by_moment));
                } else {
                    moment = least(&w, &(f - by_force));
                }
            }
            SpatialForce { moment, force }
        });
        joints.collect()
    }
}

/// Smallest x with A x = b as nearly as possible.
fn least(a: &DMatrix<f64>, b: &DVector<f64>) -> Vector3<f64> {
    if a.nrows() == 0 || a.amax() == 0.0 {
        return Vector3::zeros();
    }
    if !is_finite(a) {
        return Vector3::repeat(f64::NAN);
    }
    let solved = a.clone().svd(true, true).solve(b, 1e-9 * a.amax()).ok();
    solved.map_or_else(Vector3::zeros, |x| Vector3::new(x[0], x[1], x[2]))
}
