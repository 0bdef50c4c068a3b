//! Effective moment arm and lengthening speed (OpenSim's `MomentArmSolver`, `GeometryPath::produceForces` and
//! `computeLengtheningSpeed`).

use super::geometry::{CurrentPoint, PathGeometry, PointOrigin};
use super::path::{Path, PointKind};
use crate::multibody::{BaseIndex, Cache};
use carpus_numerics::spatial::SpatialVelocity;
use carpus_osim::osim::spec::CoordinateIndex;
use nalgebra::Vector3;

/// Points nearer than this have no direction between them [m] (Simbody's `SignificantReal`).
const COINCIDENT: f64 = 2.008_771_736_785_476_6e-14;

impl Path {
    /// Effective moment arm about coordinate c [m; dimensionless about a translation].
    ///
    /// ```text
    /// r_c = Σ ê·(v_from − v_to)          over segments between different bodies
    /// ```
    /// with ê the unit vector along the segment and v the velocities of its ends for unit speed of c, couplers
    /// followed: the generalized force about c of a path under unit tension, −dL/dq_c while the points of the path stay
    /// where they are. Positive when tension increases the coordinate, as OpenSim's `Muscle.computeMomentArm`.
    ///
    /// The wrap points count as fixed to their surface. A moving point adds its motion in its body only through
    /// segments to another body, as in OpenSim. Points that coincide add nothing, where OpenSim's result is NaN.
    ///
    /// - `q`: coordinates as given to [`Path::update`]
    /// - `cache`: after [`Model::update_unit_motion`](crate::multibody::Model::update_unit_motion) for c at `q`
    /// - `geometry`: after [`Path::update`] at `q`
    pub fn moment_arm(&self, q: &[f64], cache: &Cache, geometry: &PathGeometry) -> f64 {
        if let Some(functions) = &self.functions {
            return functions.moment_arm(q, cache.coupling());
        }
        let velocity =
            |point: &CurrentPoint| self.velocity(point, q, cache, cache.partial_velocity(point.base), cache.coupling());
        moment_arm_of(geometry, velocity)
    }

    /// The same about a coordinate whose unit speed moves the others as `qdot` says.
    ///
    /// - `qdot`, `cache`: as for [`Path::lengthening_speed`]
    pub fn moment_arm_of_motion(&self, q: &[f64], qdot: &[f64], cache: &Cache, geometry: &PathGeometry) -> f64 {
        if let Some(functions) = &self.functions {
            return functions.moment_arm(q, qdot);
        }
        moment_arm_of(geometry, |point| self.velocity(point, q, cache, cache.V_GB(point.base), qdot))
    }

    /// Lengthening speed dL/dt [m/s]; positive when the path lengthens.
    ///
    /// - `q`: coordinates as given to [`Path::update`]
    /// - `qdot`: their rates [rad/s or m/s], couplers followed
    /// - `cache`: after [`Model::update_velocities`](crate::multibody::Model::update_velocities) at `q`, `qdot`
    /// - `geometry`: after [`Path::update`] at `q`
    pub fn lengthening_speed(&self, q: &[f64], qdot: &[f64], cache: &Cache, geometry: &PathGeometry) -> f64 {
        if let Some(functions) = &self.functions {
            return functions.lengthening_speed(q, qdot);
        }
        let velocity = |point: &CurrentPoint| self.velocity(point, q, cache, cache.V_GB(point.base), qdot);
        let mut speed = 0.0;
        for pair in geometry.points.windows(2) {
            let (from, to) = (&pair[0], &pair[1]);
            let along = to.measured_p_GS - from.measured_p_GS;
            let distance = along.norm();
            let relative = velocity(to) - velocity(from);
            speed += if distance < f64::EPSILON { relative.norm() } else { along.dot(&relative) / distance };
        }
        speed
    }

    /// Forces by which a tension of 1 N in the path acts on bodies, and along coordinates that move its points
    /// (OpenSim's `GeometryPath::produceForces`); moment arms follow from the same.
    ///
    /// - `q`, `cache`, `geometry`: as for [`Path::lengthening_speed`]
    /// - `on_body`: receives base, point of attack in ground [m] and force in ground [N]
    /// - `on_coordinate`: receives coordinate and generalized force
    pub fn unit_tension(
        &self,
        q: &[f64],
        cache: &Cache,
        geometry: &PathGeometry,
        mut on_body: impl FnMut(BaseIndex, &Vector3<f64>, &Vector3<f64>),
        mut on_coordinate: impl FnMut(CoordinateIndex, f64),
    ) {
        if let Some(functions) = &self.functions {
            functions.moment_arms(q).for_each(|(c, arm)| on_coordinate(c, arm));
            return;
        }
        for Piece { from, to, along, distance } in pieces_between_bodies(geometry) {
            let pull = along / distance;
            for (point, force) in [(from, pull), (to, -pull)] {
                on_body(point.base, &point.p_GS, &force);
                let PointOrigin::Point(i) = point.origin else { continue };
                if let PointKind::Moving(moving) = &self.points[i].kind {
                    moving.for_each_slope(&cache.X_GB(point.base).R, q, |c, slope| on_coordinate(c, slope.dot(&force)));
                }
            }
        }
    }

    /// Velocity of a current point in ground [m/s] when its base moves with `base_velocity` and coordinates with
    /// `rates`.
    #[inline]
    #[allow(non_snake_case)]
    fn velocity(
        &self,
        point: &CurrentPoint,
        q: &[f64],
        cache: &Cache,
        base_velocity: &SpatialVelocity,
        rates: &[f64],
    ) -> Vector3<f64> {
        let X_GB = cache.X_GB(point.base);
        let v = base_velocity.velocity_at(&(point.p_GS - X_GB.p));
        match point.origin {
            PointOrigin::Point(i) => match &self.points[i].kind {
                PointKind::Moving(moving) => v + moving.velocity_in_base(&X_GB.R, q, rates),
                PointKind::Fixed { .. } | PointKind::Conditional { .. } => v,
            },
            PointOrigin::WrapStart(_) | PointOrigin::WrapEnd(_) => v,
        }
    }
}

/// A straight piece of a path.
struct Piece<'a> {
    from: &'a CurrentPoint,
    to: &'a CurrentPoint,
    /// From the first to the second, in ground, and its length [m].
    along: Vector3<f64>,
    distance: f64,
}

/// Pieces between different bodies, but those of no length.
fn pieces_between_bodies(geometry: &PathGeometry) -> impl Iterator<Item = Piece<'_>> {
    let pairs = geometry.points.windows(2).map(|pair| (&pair[0], &pair[1]));
    pairs.filter(|(from, to)| from.base != to.base).filter_map(|(from, to)| {
        let along = to.measured_p_GS - from.measured_p_GS;
        let distance = along.norm();
        if distance < COINCIDENT { None } else { Some(Piece { from, to, along, distance }) }
    })
}

/// Σ ê·(v_from − v_to) over pieces between different bodies.
fn moment_arm_of(geometry: &PathGeometry, velocity: impl Fn(&CurrentPoint) -> Vector3<f64>) -> f64 {
    let of = |Piece { from, to, along, distance }: Piece| along.dot(&(velocity(from) - velocity(to))) / distance;
    pieces_between_bodies(geometry).fold(0.0, |sum, piece| sum + of(piece))
}
