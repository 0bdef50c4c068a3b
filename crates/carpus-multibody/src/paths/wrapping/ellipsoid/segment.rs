//! The segment in the ellipsoid's frame, and the plane in which it is wrapped.

use nalgebra::Vector3;

/// The segment and the ellipsoid in scaled lengths.
pub(super) struct Segment {
    /// Semi-axes, scaled.
    pub(super) a: Vector3<f64>,
    pub(super) p1: Vector3<f64>,
    pub(super) p2: Vector3<f64>,
    /// Semi-axes [m].
    pub(super) dimensions: Vector3<f64>,
    /// Scaled length per metre.
    pub(super) factor: f64,
}

impl Segment {
    /// The ellipsoid's equation: negative inside, zero on the surface.
    pub(super) fn level(&self, p: &Vector3<f64>) -> f64 {
        let mut level = -1.0;
        for i in 0..3 {
            level += (p[i] / self.a[i]).powi(2);
        }
        level
    }

    /// Where the line enters and leaves the ellipsoid, if both are between the ends.
    pub(super) fn intersections(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let p1p2 = self.p1 - self.p2;
        let f1 = p1p2.component_div(&self.a);
        let f2 = self.p2.component_div(&self.a);
        let aa = f1.dot(&f1);
        let bb = 2.0 * f1.dot(&f2);
        let cc = f2.dot(&f2) - 1.0;
        let disc = bb * bb - 4.0 * aa * cc;
        if disc < 0.0 {
            return None;
        }
        let root = disc.sqrt();
        let l1 = (-bb + root) / (2.0 * aa);
        let l2 = (-bb - root) / (2.0 * aa);
        let between = 0.0 < l1 && l1 < 1.0 && 0.0 < l2 && l2 < 1.0;
        between.then(|| (self.p2 + p1p2 * l1, self.p2 + p1p2 * l2))
    }
}

/// Plane of the curve: normal·x + offset = 0.
pub(super) struct WrappingPlane {
    pub(super) normal: Vector3<f64>,
    pub(super) offset: f64,
}
