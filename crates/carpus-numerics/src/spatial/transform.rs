//! Rigid transforms.

use super::rotation::rotation_body_xyz;
use nalgebra::{Matrix3, Vector3};
use std::ops::Mul;

/// Pose `X_AB` of frame B in frame A: `p_AS = R_AB · p_BS + p_AB`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(non_snake_case)]
pub struct Transform {
    /// Rotation `R_AB`: columns are the axes of B expressed in A.
    pub R: Matrix3<f64>,
    /// Position `p_AB` of the origin of B from the origin of A, expressed in A [m].
    pub p: Vector3<f64>,
}

impl Transform {
    /// Twelve numbers: rotation by rows, position [m].
    pub fn numbers(&self) -> [f64; 12] {
        std::array::from_fn(|i| if i < 9 { self.R[(i / 3, i % 3)] } else { self.p[i - 9] })
    }

    /// The identity.
    pub fn identity() -> Self {
        Self { R: Matrix3::identity(), p: Vector3::zeros() }
    }

    /// From a translation [m] and body-fixed x-y-z angles [rad], as OpenSim states offsets of frames and wrap objects.
    pub fn from_translation_body_xyz(translation: Vector3<f64>, angles: Vector3<f64>) -> Self {
        Self { R: rotation_body_xyz(&angles), p: translation }
    }

    /// `X_BA` from `X_AB`.
    pub fn inverse(&self) -> Self {
        let inverse_rotation = self.R.transpose();
        Self { R: inverse_rotation, p: -(inverse_rotation * self.p) }
    }

    /// Re-expresses in B a point given in A: `p_BS = X_AB⁻¹ · p_AS`, without forming the inverse.
    pub fn inverse_transform_point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.R.tr_mul(&(point - self.p))
    }
}

impl Default for Transform {
    fn default() -> Self {
        Self::identity()
    }
}

impl Mul for Transform {
    type Output = Transform;
    fn mul(self, other: Transform) -> Transform {
        Transform { R: self.R * other.R, p: self.R * other.p + self.p }
    }
}

impl Mul<&Transform> for &Transform {
    type Output = Transform;
    fn mul(self, other: &Transform) -> Transform {
        *self * *other
    }
}

impl Mul<Vector3<f64>> for Transform {
    type Output = Vector3<f64>;
    fn mul(self, point: Vector3<f64>) -> Vector3<f64> {
        self.R * point + self.p
    }
}

impl Mul<Vector3<f64>> for &Transform {
    type Output = Vector3<f64>;
    fn mul(self, point: Vector3<f64>) -> Vector3<f64> {
        self.R * point + self.p
    }
}

impl Mul<&Vector3<f64>> for &Transform {
    type Output = Vector3<f64>;
    fn mul(self, point: &Vector3<f64>) -> Vector3<f64> {
        self.R * point + self.p
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    #[test]
    fn verif_inverse_and_composition() {
        let a = Transform::from_translation_body_xyz(Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.5, 1.0, -2.0));
        let b = Transform::from_translation_body_xyz(Vector3::new(-0.4, 0.2, 0.0), Vector3::new(-0.7, 0.2, 0.9));
        let point = Vector3::new(0.3, 0.4, 0.5);
        assert_abs_diff_eq!((a * b) * point, a * (b * point), epsilon = 1e-15);
        assert_abs_diff_eq!((a * a.inverse()).R, Matrix3::identity(), epsilon = 1e-15);
        assert_abs_diff_eq!((a * a.inverse()).p, Vector3::zeros(), epsilon = 1e-15);
        assert_abs_diff_eq!(a.inverse_transform_point(&(a * point)), point, epsilon = 1e-15);
    }
}
