//! What joints do beyond rotations and straight displacements: ellipsoids, a pin behind one, arcs.

use carpus_numerics::spatial::{Transform, rotation_about_axis};
use carpus_osim::osim::spec::CoordinateIndex;
use nalgebra::{Matrix3, Vector3};
use num_dual::{Dual2_64, DualNum};

/// An addition to the rotations of a mobilizer.
#[derive(Clone, Debug)]
pub(super) enum Beyond {
    /// The origin of M lies on an ellipsoid in F, where the surface is normal to the z axis of M.
    Ellipsoid { radii: Vector3<f64> },
    /// The same, then a rotation about an axis of the frame that it places.
    EllipsoidAndPin { radii: Vector3<f64>, axis: Vector3<f64>, origin: Vector3<f64>, coordinate: CoordinateIndex },
    /// The origin of M lies at the end of an arc of constant length, tangent to the y axis of F at its start and to
    /// that of M at its end.
    Arc { length: f64 },
}

/// Motion of a frame in another: w and v, or α and a.
pub(super) type Motion = (Vector3<f64>, Vector3<f64>);

impl Beyond {
    /// Numbers that have to be finite.
    pub fn lengths(&self) -> Vec<f64> {
        match self {
            Beyond::Ellipsoid { radii } => radii.iter().copied().collect(),
            Beyond::EllipsoidAndPin { radii, axis, origin, .. } => {
                radii.iter().chain(axis).chain(origin).copied().collect()
            }
            Beyond::Arc { length } => vec![*length],
        }
    }

    pub fn coordinate(&self) -> Option<CoordinateIndex> {
        match self {
            Beyond::EllipsoidAndPin { coordinate, .. } => Some(*coordinate),
            _ => None,
        }
    }

    /// Pose of M in F for the orientation that the rotations give.
    ///
    /// - `angles`: of the rotations [rad]
    #[allow(non_snake_case)]
    pub fn pose(&self, R: Matrix3<f64>, angles: [f64; 3], q: &[f64]) -> Transform {
        match self {
            Beyond::Ellipsoid { radii } => Transform { R, p: radii.component_mul(&R.column(2)) },
            Beyond::EllipsoidAndPin { radii, axis, origin, coordinate } => {
                let turn = rotation_about_axis(axis, q[coordinate.0]);
                let placed = Transform { R, p: radii.component_mul(&R.column(2)) };
                placed * Transform { R: turn, p: origin - turn * origin }
            }
            Beyond::Arc { length } => {
                Transform { R, p: Vector3::from(arc(*length, angles[0].into(), angles[1].into()).map(|x| x.re)) }
            }
        }
    }

    /// Velocity of M in F, expressed in F.
    ///
    /// - `w`: angular velocity of the rotations
    /// - `axes`: of the rotations, expressed in F
    /// - `angles`, `rates`: of the rotations
    pub fn velocity(
        &self,
        w: Vector3<f64>,
        axes: &[Vector3<f64>; 3],
        angles: [f64; 3],
        rates: [f64; 3],
        (q, qdot): (&[f64], &[f64]),
    ) -> Motion {
        match self {
            Beyond::Ellipsoid { radii } => (w, radii.component_mul(&w.cross(&axes[2]))),
            Beyond::EllipsoidAndPin { radii, coordinate, .. } => {
                let v = radii.component_mul(&w.cross(&axes[2]));
                let [to_axis, from_axis, axis] = self.arms(axes, angles, q);
                let total = w + axis * qdot[coordinate.0];
                (total, v + w.cross(&to_axis) + total.cross(&from_axis))
            }
            Beyond::Arc { length } => {
                let moved = |angle: f64, rate: f64| Dual2_64::new(angle, rate, 0.0);
                let p = arc(*length, moved(angles[0], rates[0]), moved(angles[1], rates[1]));
                (w, Vector3::from(p.map(|x| x.v1)))
            }
        }
    }

    /// Acceleration of M in F, expressed in F; arguments as above, with angular acceleration and second rates.
    #[allow(clippy::too_many_arguments)]
    pub fn acceleration(
        &self,
        (w, alpha): (Vector3<f64>, Vector3<f64>),
        axes: &[Vector3<f64>; 3],
        angles: [f64; 3],
        rates: [f64; 3],
        second: [f64; 3],
        (q, qdot, qddot): (&[f64], &[f64], &[f64]),
    ) -> Motion {
        let on_ellipsoid = |radii: &Vector3<f64>| {
            let normal = &axes[2];
            radii.component_mul(&(alpha.cross(normal) + w.cross(&w.cross(normal))))
        };
        match self {
            Beyond::Ellipsoid { radii } => (alpha, on_ellipsoid(radii)),
            Beyond::EllipsoidAndPin { radii, coordinate, .. } => {
                let [to_axis, from_axis, axis] = self.arms(axes, angles, q);
                let turn = axis * qdot[coordinate.0];
                let total = w + turn;
                let total_alpha = alpha + w.cross(&turn) + axis * qddot[coordinate.0];
                let carried = |alpha: &Vector3<f64>, w: &Vector3<f64>, arm: &Vector3<f64>| {
                    alpha.cross(arm) + w.cross(&w.cross(arm))
                };
                let a = on_ellipsoid(radii) + carried(&alpha, &w, &to_axis) + carried(&total_alpha, &total, &from_axis);
                (total_alpha, a)
            }
            Beyond::Arc { length } => {
                let moved = |k: usize| Dual2_64::new(angles[k], rates[k], second[k]);
                (alpha, Vector3::from(arc(*length, moved(0), moved(1)).map(|x| x.v2)))
            }
        }
    }

    /// From the ellipsoid's point to the pin's axis, from there to the origin of M, and the axis; expressed in F.
    #[allow(non_snake_case)]
    fn arms(&self, axes: &[Vector3<f64>; 3], angles: [f64; 3], q: &[f64]) -> [Vector3<f64>; 3] {
        let Beyond::EllipsoidAndPin { axis, origin, coordinate, .. } = self else { return [Vector3::zeros(); 3] };
        // The last rotation turns its own axis: the others give the rest of the orientation.
        let R = orientation(axes, angles);
        let turn = rotation_about_axis(axis, q[coordinate.0]);
        [R * origin, R * (-(turn * origin)), R * axis]
    }
}

/// Orientation after three rotations of which the axes, each turned by those before it, are known; the first two are
/// y and −x of F.
fn orientation(axes: &[Vector3<f64>; 3], angles: [f64; 3]) -> Matrix3<f64> {
    let first = rotation_about_axis(&axes[0], angles[0]);
    let second = rotation_about_axis(&axes[1], angles[1]);
    let third = rotation_about_axis(&axes[2], angles[2]);
    // Rotations about axes where they stand in F: the last one acts last.
    third * second * first
}

/// End of an arc that leaves the origin along y and ends tangent to the y axis of a frame turned by `x` about x, then
/// by `z` about z.
///
/// OpenSim's velocities of this joint contradict its poses: `getEulerJacobian` gives them in the child frame, and the
/// joint's accelerations lack all terms in the squares of speeds. Here they are those of the poses.
///
/// OpenSim: `ConstantCurvatureJoint::getTransform`.
fn arc(length: f64, x: Dual2_64, z: Dual2_64) -> [Dual2_64; 3] {
    let tangent = [-z.sin(), x.cos() * z.cos(), x.sin() * z.cos()];
    let squared_sine = tangent[0] * tangent[0] + tangent[2] * tangent[2];
    // (1 − cos θ)/(θ sin θ) and sin θ/θ.
    let (across, along) = if squared_sine.re < 1e-3 {
        // θ² as a series in sin² θ, then series in θ².
        let s = squared_sine;
        let square = s
            + s * s / 3.0
            + s * s * s * (8.0 / 45.0)
            + s * s * s * s * (4.0 / 35.0)
            + s * s * s * s * s * (128.0 / 1575.0);
        let across = square * square * square * (17.0 / 40320.0) + square * square / 240.0 + square / 24.0 + 0.5;
        let along = square * square * square * (-1.0 / 5040.0) + square * square / 120.0 - square / 6.0 + 1.0;
        (across, along)
    } else {
        let sine = squared_sine.sqrt();
        let angle = sine.asin();
        ((Dual2_64::from(1.0) - angle.cos()) / (angle * sine), sine / angle)
    };
    [tangent[0] * across * length, along * length, tangent[2] * across * length]
}

#[cfg(test)]
mod tests {
    use super::arc;
    use approx::assert_relative_eq;

    #[test]
    fn verif_arc_is_a_circle_of_given_length() {
        // An arc about z of radius L/θ.
        let angle = 1.2_f64;
        let [x, y, z] = arc(0.5, 0.0.into(), angle.into()).map(|x| x.re);
        let radius = 0.5 / angle;
        assert_relative_eq!(-x, radius * (1.0 - angle.cos()), max_relative = 1e-12);
        assert_relative_eq!(y, radius * angle.sin(), max_relative = 1e-12);
        assert_eq!(z, 0.0);
        // The series, too.
        let angle = 0.03_f64;
        let [x, y, _] = arc(1.0, 0.0.into(), angle.into()).map(|x| x.re);
        assert_relative_eq!(-x, (1.0 - angle.cos()) / angle, max_relative = 1e-12);
        assert_relative_eq!(y, angle.sin() / angle, max_relative = 1e-14);
    }
}
