//! Spatial velocities, accelerations and forces.

use nalgebra::Vector3;
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// Velocity of a rigid body: angular velocity and velocity of a reference point (the body's origin), expressed in the
/// same frame (ground).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpatialVelocity {
    /// Angular velocity `w_GB` [rad/s].
    pub w: Vector3<f64>,
    /// Velocity `v_GB` of the reference point [m/s].
    pub v: Vector3<f64>,
}

impl SpatialVelocity {
    /// No motion.
    pub fn zero() -> Self {
        Self::default()
    }

    /// Velocity of the body's point at offset `p` [m] from the reference point: `v + w × p`.
    #[inline]
    pub fn velocity_at(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.v + self.w.cross(p)
    }

    /// The same motion with the reference point moved by `p` [m].
    #[inline]
    pub fn shift(&self, p: &Vector3<f64>) -> Self {
        Self { w: self.w, v: self.velocity_at(p) }
    }
}

/// Acceleration of a rigid body in an inertial frame: angular acceleration and acceleration of the body's origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpatialAcceleration {
    /// Angular acceleration [rad/s²].
    pub alpha: Vector3<f64>,
    /// Acceleration of the reference point [m/s²].
    pub a: Vector3<f64>,
}

impl SpatialAcceleration {
    /// Acceleration of the body's point at offset `p` when the body turns with angular velocity `w`:
    /// `a + α × p + w × (w × p)`.
    #[inline]
    pub fn acceleration_at(&self, p: &Vector3<f64>, w: &Vector3<f64>) -> Vector3<f64> {
        self.a + self.alpha.cross(p) + w.cross(&w.cross(p))
    }
}

/// A moment and a force at a reference point (the body's origin), expressed in the same frame (ground).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpatialForce {
    /// Moment about the reference point [N·m].
    pub moment: Vector3<f64>,
    /// Force [N].
    pub force: Vector3<f64>,
}

impl SpatialForce {
    /// A force [N] that acts at offset `p` [m] from the reference point.
    #[inline]
    pub fn from_force_at(p: &Vector3<f64>, force: &Vector3<f64>) -> Self {
        Self { moment: p.cross(force), force: *force }
    }

    /// The equivalent force with its reference point moved back by `p`: `self` acts at offset `p` from the new
    /// reference point.
    #[inline]
    pub fn shift_to_origin(&self, p: &Vector3<f64>) -> Self {
        Self { moment: self.moment + p.cross(&self.force), force: self.force }
    }

    /// Power [W] on a body that moves with `velocity` at the same reference point. With the motion for unit speed of
    /// a coordinate this is the generalized force about that coordinate.
    #[inline]
    pub fn power(&self, velocity: &SpatialVelocity) -> f64 {
        self.moment.dot(&velocity.w) + self.force.dot(&velocity.v)
    }
}

impl Add for SpatialVelocity {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { w: self.w + other.w, v: self.v + other.v }
    }
}

impl Sub for SpatialVelocity {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { w: self.w - other.w, v: self.v - other.v }
    }
}

impl Mul<f64> for SpatialVelocity {
    type Output = Self;
    #[inline]
    fn mul(self, factor: f64) -> Self {
        Self { w: self.w * factor, v: self.v * factor }
    }
}

impl Add for SpatialForce {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { moment: self.moment + other.moment, force: self.force + other.force }
    }
}

impl AddAssign for SpatialForce {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Neg for SpatialForce {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self { moment: -self.moment, force: -self.force }
    }
}
