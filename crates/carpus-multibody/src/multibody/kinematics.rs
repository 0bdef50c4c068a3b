//! Poses, velocities, partial velocities and accelerations of bodies.

use super::cache::{Cache, NodeCache};
use super::mobilizer::{Node, Speeds};
use super::model::Model;
use super::subset::BodySubset;
use carpus_numerics::spatial::{SpatialAcceleration, SpatialVelocity, Transform};
use carpus_osim::osim::spec::CoordinateIndex;
use nalgebra::Vector3;

impl Model {
    /// Computes the poses of all bodies.
    ///
    /// - `q`: coordinates [rad or m], length `n_coordinates`; couplers are *not* applied here, see
    ///   [`Model::satisfy_couplers`]
    pub fn update_positions(&self, q: &[f64], cache: &mut Cache) {
        for i in 0..self.nodes.len() {
            self.update_node_position(i, q, cache);
        }
    }

    /// Computes the poses of the bodies of `subset` only; bodies inboard of them must be up to date.
    pub fn update_positions_in(&self, subset: &BodySubset, q: &[f64], cache: &mut Cache) {
        for &i in subset.nodes() {
            self.update_node_position(i, q, cache);
        }
    }

    /// Computes the velocities of all bodies from the rates of the coordinates.
    ///
    /// - `q`: coordinates, as last given to [`Model::update_positions`]
    /// - `qdot`: rates of all coordinates, dependent ones included ([`Model::follow_couplers`]) [rad/s or m/s]
    pub fn update_velocities(&self, q: &[f64], qdot: &[f64], cache: &mut Cache) {
        for i in 0..self.nodes.len() {
            self.update_node_velocity(i, q, qdot, cache);
        }
    }

    /// Computes the velocities of the bodies of `subset` only; bodies inboard of them must be up to date.
    pub fn update_velocities_in(&self, subset: &BodySubset, q: &[f64], qdot: &[f64], cache: &mut Cache) {
        for &i in subset.nodes() {
            self.update_node_velocity(i, q, qdot, cache);
        }
    }

    /// Computes the partial velocity of every body: its velocity for unit speed of coordinate `c`, couplers followed.
    ///
    /// A speed is what OpenSim calls so: the rate of the coordinate, but for the rotations of ball and free joints a
    /// component of the angular velocity expressed in the joint's parent frame.
    ///
    /// - `q`: coordinates, as last given to [`Model::update_positions`], couplers satisfied
    pub fn update_unit_motion(&self, q: &[f64], c: CoordinateIndex, cache: &mut Cache) {
        self.update_cached_coupling(q, c, cache);
        for i in 0..self.nodes.len() {
            self.update_node_partial_velocity(i, q, cache);
        }
    }

    /// Computes the partial velocities of the bodies of `subset` only. Other bodies keep theirs, which are set to zero
    /// when `c` is not the coordinate of the call before: correct for any subset that holds all needed bodies of
    /// [`Model::bodies_moved_by`] and those inboard of them that move.
    pub fn update_unit_motion_in(&self, subset: &BodySubset, q: &[f64], c: CoordinateIndex, cache: &mut Cache) {
        if cache.unit_coordinate != Some(c) {
            cache.partial_velocity.fill(SpatialVelocity::zero());
        }
        self.update_cached_coupling(q, c, cache);
        for &i in subset.nodes() {
            self.update_node_partial_velocity(i, q, cache);
        }
    }

    /// Computes the velocities of the bodies of `subset` for the rates of the coupling vector of the last
    /// [`Model::update_unit_motion_in`] of the same bodies: their partial velocities, except where a speed is not a
    /// rate.
    ///
    /// - `q`: coordinates, as given there
    pub fn update_velocities_of_unit_motion_in(&self, subset: &BodySubset, q: &[f64], cache: &mut Cache) {
        let coupling = std::mem::take(&mut cache.coupling);
        if subset.nodes().iter().all(|&i| self.nodes[i].mobilizer.speeds == Speeds::CoordinateRates) {
            for &i in subset.nodes() {
                let base = self.nodes[i].outboard.0;
                cache.V_GB[base] = cache.partial_velocity[base];
            }
        } else {
            self.update_velocities_in(subset, q, &coupling, cache);
        }
        cache.coupling = coupling;
    }

    /// Computes the accelerations of all bodies in ground (gravity is not included).
    ///
    /// - `q`, `qdot`: as last given to [`Model::update_positions`] and [`Model::update_velocities`]
    /// - `qddot`: second rates of all coordinates, dependent ones included ([`Model::follow_couplers_second`])
    pub fn update_accelerations(&self, q: &[f64], qdot: &[f64], qddot: &[f64], cache: &mut Cache) {
        for i in 0..self.nodes.len() {
            self.update_node_acceleration(i, q, qdot, qddot, cache);
        }
    }

    /// Computes the accelerations of the bodies of `subset` only; bodies inboard of them must be up to date.
    pub fn update_accelerations_in(
        &self,
        subset: &BodySubset,
        q: &[f64],
        qdot: &[f64],
        qddot: &[f64],
        cache: &mut Cache,
    ) {
        for &i in subset.nodes() {
            self.update_node_acceleration(i, q, qdot, qddot, cache);
        }
    }

    /// Computes the velocities of all bodies from generalized speeds as OpenSim defines them (see
    /// [`Model::update_unit_motion`]).
    ///
    /// - `u`: speeds of all coordinates, dependent ones included
    pub fn update_velocities_of_speeds(&self, q: &[f64], u: &[f64], cache: &mut Cache) {
        for (i, node) in self.nodes.iter().enumerate() {
            let work = &cache.nodes[i];
            let (w, v) = node.mobilizer.velocity_of_speeds(q, u, &work.axes_F);
            cache.V_GB[node.outboard.0] = outboard_velocity(node, work, &cache.V_GB[node.inboard.0], &w, &v);
        }
    }

    /// Computes the accelerations of all bodies in ground (gravity is not included) from generalized speeds and their
    /// rates.
    ///
    /// - `q`, `u`: as last given to [`Model::update_positions`] and [`Model::update_velocities_of_speeds`]
    /// - `udot`: rates of the speeds of all coordinates, dependent ones included
    pub fn update_accelerations_of_speeds(&self, q: &[f64], u: &[f64], udot: &[f64], cache: &mut Cache) {
        for i in 0..self.nodes.len() {
            let mobilizer = &self.nodes[i].mobilizer;
            let axes = &cache.nodes[i].axes_F;
            let velocity = mobilizer.velocity_of_speeds(q, u, axes);
            let acceleration = mobilizer.acceleration_of_speeds(q, u, udot, axes);
            self.set_node_acceleration(i, velocity, acceleration, cache);
        }
    }

    /// Computes, for every coordinate, the velocity of its joint's outboard body for unit speed, inboard bodies at
    /// rest and no coupler followed.
    ///
    /// - `q`: coordinates, as last given to [`Model::update_positions`]
    pub fn update_joint_axes(&self, q: &[f64], cache: &mut Cache) {
        let mut unit = std::mem::take(&mut cache.coupling);
        unit.fill(0.0);
        cache.unit_coordinate = None;
        for (i, node) in self.nodes.iter().enumerate() {
            let work = &cache.nodes[i];
            for &c in &node.coordinates {
                unit[c] = 1.0;
                let (w, v) = node.mobilizer.velocity_of_speeds(q, &unit, &work.axes_F);
                unit[c] = 0.0;
                cache.joint_axes[c] = outboard_velocity(node, work, &SpatialVelocity::zero(), &w, &v);
            }
        }
        cache.coupling = unit;
    }

    fn update_cached_coupling(&self, q: &[f64], c: CoordinateIndex, cache: &mut Cache) {
        let mut coupling = std::mem::take(&mut cache.coupling);
        self.update_coupling(q, c, &mut coupling);
        cache.coupling = coupling;
        cache.unit_coordinate = Some(c);
    }

    #[allow(non_snake_case)]
    fn update_node_position(&self, i: usize, q: &[f64], cache: &mut Cache) {
        let node = &self.nodes[i];
        let work = &mut cache.nodes[i];
        let X_GP = cache.X_GB[node.inboard.0];
        let X_FM = node.mobilizer.pose(q, &mut work.axes_F);
        // X_GN: joint frame on the inboard body; X_GO: joint frame on the outboard body.
        let X_GN = X_GP * node.X_PF;
        let X_GO = if node.reversed { X_GN * X_FM.inverse() } else { X_GN * X_FM };
        let X_GB = X_GO * node.X_MB;
        let (X_GF, X_GM): (&Transform, &Transform) = if node.reversed { (&X_GO, &X_GN) } else { (&X_GN, &X_GO) };
        work.R_GF = X_GF.R;
        work.p_FM_G = X_GM.p - X_GF.p;
        work.p_inboard_G = X_GN.p - X_GP.p;
        work.p_outboard_G = X_GB.p - X_GO.p;
        cache.X_GB[node.outboard.0] = X_GB;
    }

    #[allow(non_snake_case)]
    fn update_node_velocity(&self, i: usize, q: &[f64], qdot: &[f64], cache: &mut Cache) {
        let node = &self.nodes[i];
        let work = &cache.nodes[i];
        let (w, v) = node.mobilizer.velocity(q, qdot, &work.axes_F);
        cache.V_GB[node.outboard.0] = outboard_velocity(node, work, &cache.V_GB[node.inboard.0], &w, &v);
    }

    #[allow(non_snake_case)]
    fn update_node_partial_velocity(&self, i: usize, q: &[f64], cache: &mut Cache) {
        let node = &self.nodes[i];
        let work = &cache.nodes[i];
        let (w, v) = node.mobilizer.velocity_of_speeds(q, &cache.coupling, &work.axes_F);
        cache.partial_velocity[node.outboard.0] =
            outboard_velocity(node, work, &cache.partial_velocity[node.inboard.0], &w, &v);
    }

    fn update_node_acceleration(&self, i: usize, q: &[f64], qdot: &[f64], qddot: &[f64], cache: &mut Cache) {
        let mobilizer = &self.nodes[i].mobilizer;
        let axes = &cache.nodes[i].axes_F;
        let velocity = mobilizer.velocity(q, qdot, axes);
        let acceleration = mobilizer.acceleration(q, qdot, qddot, axes);
        self.set_node_acceleration(i, velocity, acceleration, cache);
    }

    /// Acceleration of the outboard body from the velocity and acceleration of M in F, expressed in F.
    #[allow(non_snake_case)]
    fn set_node_acceleration(
        &self,
        i: usize,
        (w_F, v_F): (Vector3<f64>, Vector3<f64>),
        (alpha_F, a_F): (Vector3<f64>, Vector3<f64>),
        cache: &mut Cache,
    ) {
        let node = &self.nodes[i];
        let work = &cache.nodes[i];
        let (w_FM, v_FM) = (work.R_GF * w_F, work.R_GF * v_F);
        let (alpha_FM, a_FM) = (work.R_GF * alpha_F, work.R_GF * a_F);
        let (V_inboard, A_inboard) = (&cache.V_GB[node.inboard.0], &cache.A_GB[node.inboard.0]);
        let w_outboard = cache.V_GB[node.outboard.0].w;
        let a_inboard_joint = A_inboard.acceleration_at(&work.p_inboard_G, &V_inboard.w);
        // The relative motion is given as seen from F, so Coriolis terms carry the angular velocity of F.
        let (alpha, a_outboard_joint) = if node.reversed {
            let alpha = A_inboard.alpha - alpha_FM - w_outboard.cross(&w_FM);
            let carried = SpatialAcceleration { alpha, a: Vector3::zeros() };
            let relative = carried.acceleration_at(&work.p_FM_G, &w_outboard) + 2.0 * w_outboard.cross(&v_FM) + a_FM;
            (alpha, a_inboard_joint - relative)
        } else {
            let alpha = A_inboard.alpha + alpha_FM + V_inboard.w.cross(&w_FM);
            let carried = SpatialAcceleration { alpha: A_inboard.alpha, a: Vector3::zeros() };
            let relative = carried.acceleration_at(&work.p_FM_G, &V_inboard.w) + 2.0 * V_inboard.w.cross(&v_FM) + a_FM;
            (alpha, a_inboard_joint + relative)
        };
        let at_joint = SpatialAcceleration { alpha, a: a_outboard_joint };
        let a = at_joint.acceleration_at(&work.p_outboard_G, &w_outboard);
        cache.A_GB[node.outboard.0] = SpatialAcceleration { alpha, a };
    }
}

/// Velocity of the outboard body at its origin, from that of the inboard body and the velocity (w, v) of M in F,
/// expressed in F.
#[allow(non_snake_case)]
fn outboard_velocity(
    node: &Node,
    work: &NodeCache,
    inboard: &SpatialVelocity,
    w_F: &Vector3<f64>,
    v_F: &Vector3<f64>,
) -> SpatialVelocity {
    let (w_relative, v_relative) = (work.R_GF * w_F, work.R_GF * v_F);
    let v_joint = inboard.velocity_at(&work.p_inboard_G);
    let at_joint = if node.reversed {
        let w = inboard.w - w_relative;
        SpatialVelocity { w, v: v_joint - w.cross(&work.p_FM_G) - v_relative }
    } else {
        SpatialVelocity { w: inboard.w + w_relative, v: v_joint + inboard.w.cross(&work.p_FM_G) + v_relative }
    };
    at_joint.shift(&work.p_outboard_G)
}
