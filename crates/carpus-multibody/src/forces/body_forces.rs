//! Weight and inertia of the bodies as generalized forces about one coordinate.

use nalgebra::Vector3;

use crate::multibody::{BaseIndex, BodySubset, Cache, Model};
use carpus_osim::osim::spec::BodyIndex;

/// Generalized force of gravity [N·m or N] on the bodies of `subset`, about the coordinate that
/// [`Model::update_unit_motion`] was last called for on `cache`:
///
/// ```text
/// f = Σ_B m_B g · v_Bcm(q̇_c = 1)
/// ```
/// Only bodies that move with the coordinate contribute, so [`Model::bodies_moved_by`] is enough of a subset.
pub fn gravity_force(model: &Model, subset: &BodySubset, cache: &Cache) -> f64 {
    let mut sum = 0.0;
    for (body, base) in massive_bodies(model, subset) {
        let p_cm = cache.X_GB(base).R * body.mass_center;
        sum += body.mass * model.gravity.dot(&cache.partial_velocity(base).velocity_at(&p_cm));
    }
    sum
}

/// Σ m_B v_Bcm of the bodies of `subset` for unit speed of the coordinate of the cache's unit motion [kg·m/rad or kg]:
/// its length times g is the largest moment that gravity, however directed, has about the coordinate.
pub fn first_moment_of_mass(model: &Model, subset: &BodySubset, cache: &Cache) -> Vector3<f64> {
    let moment = |(body, base): (&crate::multibody::Body, BaseIndex)| {
        let p_cm = cache.X_GB(base).R * body.mass_center;
        body.mass * cache.partial_velocity(base).velocity_at(&p_cm)
    };
    massive_bodies(model, subset).map(moment).sum()
}

/// Generalized inertia force [N·m or N] of the bodies of `subset` about the coordinate of the cache's unit motion
/// (Kane's F*), for the velocities and accelerations in `cache`:
///
/// ```text
/// f = −Σ_B [ m a_Bcm · v_Bcm(q̇_c = 1) + (I α + ω × I ω) · w_B(q̇_c = 1) ]
/// ```
/// Negative when inertia resists an acceleration in the positive sense of the coordinate; gravity is not included.
///
/// Kane TR, Levinson DA (1985) *Dynamics: Theory and Applications*, McGraw-Hill, section 4.11.
#[allow(non_snake_case)]
pub fn inertia_force(model: &Model, subset: &BodySubset, cache: &Cache) -> f64 {
    let mut sum = 0.0;
    for (body, base) in massive_bodies(model, subset) {
        let R_GB = &cache.X_GB(base).R;
        let (V, A, unit) = (cache.V_GB(base), cache.A_GB(base), cache.partial_velocity(base));
        let p_cm = R_GB * body.mass_center;
        let in_ground = |vector| R_GB * (body.inertia * R_GB.tr_mul(&vector));
        let moment = in_ground(A.alpha) + V.w.cross(&in_ground(V.w));
        let force = body.mass * A.acceleration_at(&p_cm, &V.w);
        sum -= force.dot(&unit.velocity_at(&p_cm)) + moment.dot(&unit.w);
    }
    sum
}

fn massive_bodies<'a>(
    model: &'a Model,
    subset: &'a BodySubset,
) -> impl Iterator<Item = (&'a crate::multibody::Body, BaseIndex)> {
    model
        .bodies
        .iter()
        .enumerate()
        .map(|(i, body)| (body, BaseIndex::from(BodyIndex(i))))
        .filter(|(body, base)| body.mass != 0.0 && subset.contains(*base))
}
