//! Mass matrix and inverse dynamics.
//!
//! Speeds are OpenSim's (see [`Model::update_unit_motion`]); couplers and other constraints are not considered here.
//!
//! # References
//! Featherstone R (2008) *Rigid Body Dynamics Algorithms*, Springer, chapters 5 and 6.

use super::cache::Cache;
use super::index::BaseIndex;
use super::model::Model;
use super::subset::BodySubset;
use carpus_numerics::spatial::{SpatialAcceleration, SpatialForce};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Mass, first moment and inertia of one or more bodies about a point, in ground axes.
#[derive(Clone, Copy, Debug, Default)]
struct CompositeInertia {
    mass: f64,
    /// Mass times the position of the mass centre from the point [kg·m].
    moment: Vector3<f64>,
    /// Inertia about the point [kg·m²].
    inertia: Matrix3<f64>,
}

impl CompositeInertia {
    /// The same bodies about another point, from which the present one is at `r`.
    fn shifted(&self, r: &Vector3<f64>) -> CompositeInertia {
        let h = &self.moment;
        let inertia = self.inertia + Matrix3::from_diagonal_element(2.0 * h.dot(r) + self.mass * r.norm_squared())
            - h * r.transpose()
            - r * h.transpose()
            - self.mass * r * r.transpose();
        CompositeInertia { mass: self.mass, moment: h + self.mass * r, inertia }
    }

    fn add(&mut self, other: &CompositeInertia) {
        self.mass += other.mass;
        self.moment += other.moment;
        self.inertia += other.inertia;
    }

    /// The force that gives bodies at rest an acceleration.
    fn times(&self, acceleration: &SpatialAcceleration) -> SpatialForce {
        SpatialForce {
            moment: self.inertia * acceleration.alpha + self.moment.cross(&acceleration.a),
            force: self.mass * acceleration.a + acceleration.alpha.cross(&self.moment),
        }
    }
}

/// Buffers of [`Model::update_mass_matrix`] and [`Model::inverse_dynamics`].
#[derive(Clone, Debug)]
pub struct DynamicsBuffers {
    inertias: Vec<CompositeInertia>,
    forces: Vec<SpatialForce>,
}

impl Model {
    /// Buffers for this model.
    pub fn new_dynamics_buffers(&self) -> DynamicsBuffers {
        DynamicsBuffers {
            inertias: vec![CompositeInertia::default(); self.n_bases()],
            forces: vec![SpatialForce::default(); self.n_bases()],
        }
    }

    /// Mass matrix M of all speeds: kinetic energy is ½ uᵀ M u. Singular where massless bodies move alone.
    ///
    /// - `cache`: after [`Model::update_positions`] and [`Model::update_joint_axes`]
    /// - `mass_matrix`: receives M [kg, kg·m or kg·m²], square, of size `n_coordinates`
    #[allow(non_snake_case)]
    pub fn update_mass_matrix(&self, cache: &Cache, buffers: &mut DynamicsBuffers, mass_matrix: &mut DMatrix<f64>) {
        let inertias = &mut buffers.inertias;
        inertias[0] = CompositeInertia::default();
        for (i, body) in self.bodies.iter().enumerate() {
            let R_GB = &cache.X_GB[i + 1].R;
            let p = R_GB * body.mass_center;
            let about_center = CompositeInertia {
                mass: body.mass,
                moment: Vector3::zeros(),
                inertia: R_GB * body.inertia * R_GB.transpose(),
            };
            inertias[i + 1] = about_center.shifted(&p);
        }
        mass_matrix.fill(0.0);
        for node in self.nodes.iter().rev() {
            let (inboard, outboard) = (node.inboard.0, node.outboard.0);
            let own = inertias[outboard];
            for (k, &c) in node.coordinates.iter().enumerate() {
                let axis = &cache.joint_axes[c];
                let mut force = own.times(&SpatialAcceleration { alpha: axis.w, a: axis.v });
                for &d in &node.coordinates[..=k] {
                    let value = force.power(&cache.joint_axes[d]);
                    mass_matrix[(c, d)] = value;
                    mass_matrix[(d, c)] = value;
                }
                let mut at = outboard;
                let mut base = node.inboard;
                while let Some(parent) = self.node_of_base[base.0] {
                    force = force.shift_to_origin(&(cache.X_GB[at].p - cache.X_GB[base.0].p));
                    at = base.0;
                    let parent = &self.nodes[parent];
                    for &d in &parent.coordinates {
                        let value = force.power(&cache.joint_axes[d]);
                        mass_matrix[(c, d)] = value;
                        mass_matrix[(d, c)] = value;
                    }
                    base = parent.inboard;
                }
            }
            let shift = cache.X_GB[outboard].p - cache.X_GB[inboard].p;
            let shifted = own.shifted(&shift);
            inertias[inboard].add(&shifted);
        }
    }

    /// Generalized forces that the motion in `cache` needs, gravity and given forces on bodies taken off (recursive
    /// Newton–Euler): `M u̇ + c(q, u) − f_gravity − Jᵀ F`.
    ///
    /// - `cache`: after [`Model::update_joint_axes`], [`Model::update_velocities_of_speeds`] and
    ///   [`Model::update_accelerations_of_speeds`]
    /// - `applied`: force on every base at its origin, expressed in ground (empty: none)
    /// - `out`: receives one value per coordinate [N·m or N]
    #[allow(non_snake_case)]
    pub fn inverse_dynamics(
        &self,
        cache: &Cache,
        applied: &[SpatialForce],
        buffers: &mut DynamicsBuffers,
        out: &mut [f64],
    ) {
        let forces = &mut buffers.forces;
        forces[0] = SpatialForce::default();
        for (i, body) in self.bodies.iter().enumerate() {
            let R_GB = &cache.X_GB[i + 1].R;
            let (V, A) = (&cache.V_GB[i + 1], &cache.A_GB[i + 1]);
            let p = R_GB * body.mass_center;
            let in_ground = |vector: &Vector3<f64>| R_GB * (body.inertia * R_GB.tr_mul(vector));
            let force = body.mass * (A.acceleration_at(&p, &V.w) - self.gravity);
            let moment = in_ground(&A.alpha) + V.w.cross(&in_ground(&V.w));
            forces[i + 1] = SpatialForce { moment, force }.shift_to_origin(&p);
        }
        for (force, applied) in forces.iter_mut().zip(applied) {
            *force += -*applied;
        }
        out.fill(0.0);
        self.gather(cache, forces, out);
    }

    /// Adds to `out` the generalized forces Jᵀ F of forces on bodies; `forces` is used up.
    ///
    /// - `cache`: after [`Model::update_positions`] and [`Model::update_joint_axes`]
    /// - `forces`: on every base at its origin, expressed in ground
    pub fn gather(&self, cache: &Cache, forces: &mut [SpatialForce], out: &mut [f64]) {
        (0..self.nodes.len()).rev().for_each(|i| self.gather_node(i, cache, forces, out));
    }

    /// The same for forces on some bodies only; bodies inboard of them must be in the subset.
    pub fn gather_in(&self, subset: &BodySubset, cache: &Cache, forces: &mut [SpatialForce], out: &mut [f64]) {
        subset.nodes().iter().rev().for_each(|i| self.gather_node(*i, cache, forces, out));
    }

    #[inline]
    fn gather_node(&self, i: usize, cache: &Cache, forces: &mut [SpatialForce], out: &mut [f64]) {
        let node = &self.nodes[i];
        let (inboard, outboard) = (node.inboard.0, node.outboard.0);
        let force = forces[outboard];
        for &c in &node.coordinates {
            out[c] += force.power(&cache.joint_axes[c]);
        }
        let shift = cache.X_GB[outboard].p - cache.X_GB[inboard].p;
        forces[inboard] += force.shift_to_origin(&shift);
    }

    /// Velocity of a base, at its origin and expressed in ground, for unit speed of every coordinate that moves it, no
    /// coupler followed: `visit(coordinate, velocity)`.
    ///
    /// - `cache`: after [`Model::update_positions`] and [`Model::update_joint_axes`]
    pub fn for_each_partial_velocity(
        &self,
        cache: &Cache,
        base: BaseIndex,
        mut visit: impl FnMut(usize, carpus_numerics::spatial::SpatialVelocity),
    ) {
        let origin = cache.X_GB[base.0].p;
        let mut at = base;
        while let Some(node) = self.node_of_base[at.0] {
            let node = &self.nodes[node];
            let shift = origin - cache.X_GB[node.outboard.0].p;
            for &c in &node.coordinates {
                visit(c, cache.joint_axes[c].shift(&shift));
            }
            at = node.inboard;
        }
    }

    /// Kinetic energy [J] of the velocities in `cache`.
    #[allow(non_snake_case)]
    pub fn kinetic_energy(&self, cache: &Cache) -> f64 {
        let mut energy = 0.0;
        for (i, body) in self.bodies.iter().enumerate() {
            let R_GB = &cache.X_GB[i + 1].R;
            let V = &cache.V_GB[i + 1];
            let w_B = R_GB.tr_mul(&V.w);
            let v = V.velocity_at(&(R_GB * body.mass_center));
            energy += 0.5 * (body.mass * v.norm_squared() + w_B.dot(&(body.inertia * w_B)));
        }
        energy
    }

    /// Potential energy of gravity [J], zero with all mass centres at the ground's origin.
    pub fn gravity_energy(&self, cache: &Cache) -> f64 {
        let height = |i: usize| (cache.X_GB[i + 1] * self.bodies[i].mass_center).dot(&self.gravity);
        -(0..self.bodies.len()).map(|i| self.bodies[i].mass * height(i)).sum::<f64>()
    }
}
