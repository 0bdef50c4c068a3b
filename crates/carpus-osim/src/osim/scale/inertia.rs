//! Mass and inertia of a scaled body.

use nalgebra::{Matrix3, Vector3};

/// Mass [kg] and inertia about the mass centre [kg·m²] of a body scaled by `factors` along its axes.
///
/// Equal factors `s`: the inertia grows with `s²`, and with `s³` more if the mass is scaled. Different factors: the
/// body is taken as a cylinder about the axis of least inertia, its radius and length computed from the diagonal and
/// scaled; products of inertia grow with their two factors.
///
/// # References
/// OpenSim 4.6, `Body::scaleInertialProperties`.
pub fn scaled_inertia(
    mass: f64,
    inertia: &Matrix3<f64>,
    factors: &Vector3<f64>,
    scale_mass: bool,
) -> (f64, Matrix3<f64>) {
    let volume = factors.product().abs();
    let unscaled = mass;
    let mass = if scale_mass { mass * volume } else { mass };
    let of_mass = if scale_mass { volume } else { 1.0 };
    if mass <= f64::EPSILON {
        return (mass, Matrix3::zeros());
    }
    if nearly_equal(factors.x, factors.y) && nearly_equal(factors.y, factors.z) {
        return (mass, inertia * of_mass * (factors.x * factors.x));
    }
    let [xx, yy, zz] = [inertia[(0, 0)], inertia[(1, 1)], inertia[(2, 2)]];
    let axis = match (xx <= yy, xx <= zz, yy <= zz) {
        (true, true, _) => 0,
        (false, _, true) => 1,
        _ => 2,
    };
    let other = if axis == 0 { 1 } else { 0 };
    let square_root = |x: f64| if x < 0.0 { 0.0 } else { x.sqrt() };
    let radius = square_root(2.0 * inertia[(axis, axis)] / unscaled);
    let length =
        square_root(12.0 * (inertia[(other, other)] - 0.25 * unscaled * radius * radius) / unscaled) * factors[axis];
    let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    let radius_squared = radius * factors[u] * radius * factors[v];
    let across = mass * (length * length / 12.0 + 0.25 * radius_squared);
    let mut scaled = *inertia;
    for i in 0..3 {
        for j in 0..3 {
            if i == j {
                scaled[(i, i)] = if i == axis { 0.5 * mass * radius_squared } else { across };
            } else {
                scaled[(i, j)] *= factors[i] * factors[j] * of_mass;
            }
        }
    }
    (mass, scaled)
}

/// Simbody's `isNumericallyEqual`.
fn nearly_equal(a: f64, b: f64) -> bool {
    (a - b).abs() <= f64::EPSILON.powf(0.875) * 1f64.max(a.abs()).max(b.abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A solid cylinder along y stays a solid cylinder.
    #[test]
    fn verif_cylinder_scales_as_a_cylinder() {
        let cylinder = |m: f64, r: f64, h: f64| {
            let across = m * (h * h / 12.0 + r * r / 4.0);
            Matrix3::from_diagonal(&Vector3::new(across, 0.5 * m * r * r, across))
        };
        let factors = Vector3::new(1.1, 1.3, 1.1);
        let (mass, inertia) = scaled_inertia(2.0, &cylinder(2.0, 0.04, 0.3), &factors, true);
        assert!((mass - 2.0 * 1.1 * 1.1 * 1.3).abs() < 1e-12);
        assert!((inertia - cylinder(mass, 0.044, 0.39)).norm() < 1e-12);
        let (mass, inertia) = scaled_inertia(2.0, &cylinder(2.0, 0.04, 0.3), &Vector3::repeat(1.2), false);
        assert!(mass == 2.0 && (inertia - cylinder(2.0, 0.048, 0.36)).norm() < 1e-12);
        assert_eq!(scaled_inertia(0.0, &Matrix3::identity(), &factors, true), (0.0, Matrix3::zeros()));
    }
}
