//! Rotation matrices from and to angles.

use nalgebra::{Matrix3, Vector3};

/// Rotation by `angle` [rad] about the unit vector `axis` (Rodrigues' formula).
///
/// ```text
/// R = cos θ · 1 + sin θ · [a]× + (1 − cos θ) · a aᵀ
/// ```
pub fn rotation_about_axis(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    let (x, y, z) = (axis.x, axis.y, axis.z);
    let t = 1.0 - c;
    Matrix3::new(
        c + t * x * x,
        t * x * y - s * z,
        t * x * z + s * y,
        t * x * y + s * z,
        c + t * y * y,
        t * y * z - s * x,
        t * x * z - s * y,
        t * y * z + s * x,
        c + t * z * z,
    )
}

/// Body-fixed x-y-z rotation sequence `R = Rx(θ₁) · Ry(θ₂) · Rz(θ₃)`, angles [rad]: the convention of OpenSim's
/// `orientation` and `xyz_body_rotation` properties.
pub fn rotation_body_xyz(angles: &Vector3<f64>) -> Matrix3<f64> {
    let (s1, c1) = angles.x.sin_cos();
    let (s2, c2) = angles.y.sin_cos();
    let (s3, c3) = angles.z.sin_cos();
    Matrix3::new(
        c2 * c3,
        -c2 * s3,
        s2,
        c1 * s3 + s1 * s2 * c3,
        c1 * c3 - s1 * s2 * s3,
        -s1 * c2,
        s1 * s3 - c1 * s2 * c3,
        s1 * c3 + c1 * s2 * s3,
        c1 * c2,
    )
}

/// Angles [rad] of the body-fixed x-y-z sequence that gives `R`; inverse of [`rotation_body_xyz`].
///
/// θ₁ and θ₃ lie in [−π, π], θ₂ in [−π/2, π/2]. At gimbal lock (cos θ₂ = 0) the third angle is set to zero, as
/// Simbody's `convertRotationToBodyFixedXYZ` does.
#[allow(non_snake_case)]
pub fn body_xyz_angles(R: &Matrix3<f64>) -> Vector3<f64> {
    // |cos θ₂| from all four elements that contain it, as Simbody computes it.
    let cos2 = ((R[(0, 0)].powi(2) + R[(0, 1)].powi(2) + R[(1, 2)].powi(2) + R[(2, 2)].powi(2)) / 2.0).sqrt();
    let theta2 = R[(0, 2)].atan2(cos2);
    if cos2 > 4.0 * f64::EPSILON {
        return Vector3::new((-R[(1, 2)]).atan2(R[(2, 2)]), theta2, (-R[(0, 1)]).atan2(R[(0, 0)]));
    }
    let theta1 = if R[(0, 2)] > 0.0 {
        (R[(1, 0)] + R[(2, 1)]).atan2(R[(1, 1)] - R[(2, 0)])
    } else {
        (R[(2, 1)] - R[(1, 0)]).atan2(R[(1, 1)] + R[(2, 0)])
    };
    Vector3::new(theta1, theta2, 0.0)
}

/// The matrix N with `θ̇ = N(θ) · w_FM_M`: rates of body-fixed x-y-z angles from the angular velocity expressed in the
/// rotated frame M. Singular at θ₂ = ±π/2.
///
/// Simbody: `Rotation::calcNForBodyXYZInBodyFrame`.
pub fn angular_rate_matrix_body_xyz(angles: &Vector3<f64>) -> Matrix3<f64> {
    let (s2, c2) = angles.y.sin_cos();
    let (s3, c3) = angles.z.sin_cos();
    Matrix3::new(c3 / c2, -s3 / c2, 0.0, s3, c3, 0.0, -s2 * c3 / c2, s2 * s3 / c2, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    #[test]
    fn verif_body_xyz_is_product_of_axis_rotations() {
        let angles = Vector3::new(0.7, -1.1, 2.9);
        let product = rotation_about_axis(&Vector3::x(), angles.x)
            * rotation_about_axis(&Vector3::y(), angles.y)
            * rotation_about_axis(&Vector3::z(), angles.z);
        assert_abs_diff_eq!(rotation_body_xyz(&angles), product, epsilon = 1e-15);
        assert_abs_diff_eq!(body_xyz_angles(&product), angles, epsilon = 1e-14);
    }

    #[test]
    fn verif_gimbal_lock_round_trip() {
        for theta2 in [std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2] {
            let rotation = rotation_body_xyz(&Vector3::new(0.4, theta2, -0.3));
            let angles = body_xyz_angles(&rotation);
            assert_abs_diff_eq!(rotation_body_xyz(&angles), rotation, epsilon = 1e-14);
        }
    }

    #[test]
    fn verif_angular_rate_matrix_against_finite_differences() {
        let (angles, rates) = (Vector3::new(0.7, -1.1, 2.9), Vector3::new(0.2, -0.5, 1.3));
        let h = 1e-6;
        let derivative =
            (rotation_body_xyz(&(angles + rates * h)) - rotation_body_xyz(&(angles - rates * h))) / (2.0 * h);
        // Rᵀ Ṙ = [w_FM_M]×
        let cross = rotation_body_xyz(&angles).transpose() * derivative;
        let w_in_m = Vector3::new(cross[(2, 1)], cross[(0, 2)], cross[(1, 0)]);
        assert_abs_diff_eq!(angular_rate_matrix_body_xyz(&angles) * w_in_m, rates, epsilon = 1e-8);
    }
}
