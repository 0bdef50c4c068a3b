//! Buffers for computed kinematics.

use super::index::BaseIndex;
use super::model::Model;
use carpus_numerics::spatial::{SpatialAcceleration, SpatialVelocity, Transform};
use carpus_osim::osim::spec::{CoordinateIndex, FrameIndex};
use nalgebra::{Matrix3, Vector3};

/// Poses, velocities and accelerations of all bodies of one model; filled by `Model::update_*`.
#[derive(Clone, Debug)]
#[allow(non_snake_case)]
pub struct Cache {
    pub(super) X_GB: Vec<Transform>,
    pub(super) V_GB: Vec<SpatialVelocity>,
    pub(super) A_GB: Vec<SpatialAcceleration>,
    pub(super) partial_velocity: Vec<SpatialVelocity>,
    pub(super) nodes: Vec<NodeCache>,
    pub(super) coupling: Vec<f64>,
    /// Coordinate that `partial_velocity` and `coupling` belong to.
    pub(super) unit_coordinate: Option<CoordinateIndex>,
    /// Velocity of the outboard body for unit speed of each coordinate, bodies inboard of its joint at rest.
    pub(super) joint_axes: Vec<SpatialVelocity>,
}

/// Intermediate results of one joint.
#[derive(Clone, Copy, Debug)]
#[allow(non_snake_case)]
pub(super) struct NodeCache {
    /// Orientation of the joint's parent frame F in ground.
    pub R_GF: Matrix3<f64>,
    /// Rotation axes, expressed in F after the rotations before them.
    pub axes_F: [Vector3<f64>; 3],
    /// From the origin of F to the origin of M, expressed in ground.
    pub p_FM_G: Vector3<f64>,
    /// From the inboard body's origin to the origin of the joint frame on it, expressed in ground.
    pub p_inboard_G: Vector3<f64>,
    /// From the origin of the joint frame on the outboard body to that body's origin, expressed in ground.
    pub p_outboard_G: Vector3<f64>,
}

impl Cache {
    pub(super) fn new(model: &Model) -> Self {
        let node = NodeCache {
            R_GF: Matrix3::identity(),
            axes_F: [Vector3::zeros(); 3],
            p_FM_G: Vector3::zeros(),
            p_inboard_G: Vector3::zeros(),
            p_outboard_G: Vector3::zeros(),
        };
        Self {
            X_GB: vec![Transform::identity(); model.n_bases()],
            V_GB: vec![SpatialVelocity::zero(); model.n_bases()],
            A_GB: vec![SpatialAcceleration::default(); model.n_bases()],
            partial_velocity: vec![SpatialVelocity::zero(); model.n_bases()],
            nodes: vec![node; model.nodes.len()],
            coupling: vec![0.0; model.n_coordinates()],
            unit_coordinate: None,
            joint_axes: vec![SpatialVelocity::zero(); model.n_coordinates()],
        }
    }

    /// Pose of ground or a body in ground, after [`Model::update_positions`].
    #[allow(non_snake_case)]
    pub fn X_GB(&self, base: impl Into<BaseIndex>) -> &Transform {
        &self.X_GB[base.into().0]
    }

    /// Pose of a frame in ground, after [`Model::update_positions`].
    #[allow(non_snake_case)]
    pub fn X_GF(&self, model: &Model, frame: FrameIndex) -> Transform {
        let frame = model.frame(frame);
        self.X_GB[frame.base.0] * frame.X_BF
    }

    /// Velocity of ground or a body (at its origin, expressed in ground), after [`Model::update_velocities`].
    #[allow(non_snake_case)]
    pub fn V_GB(&self, base: impl Into<BaseIndex>) -> &SpatialVelocity {
        &self.V_GB[base.into().0]
    }

    /// Acceleration of ground or a body (at its origin, expressed in ground), after [`Model::update_accelerations`].
    #[allow(non_snake_case)]
    pub fn A_GB(&self, base: impl Into<BaseIndex>) -> &SpatialAcceleration {
        &self.A_GB[base.into().0]
    }

    /// Partial velocity of ground or a body: its velocity for unit speed of the coordinate last given to
    /// [`Model::update_unit_motion`], couplers followed.
    pub fn partial_velocity(&self, base: impl Into<BaseIndex>) -> &SpatialVelocity {
        &self.partial_velocity[base.into().0]
    }

    /// The coordinate last given to [`Model::update_unit_motion`].
    pub fn unit_coordinate(&self) -> Option<CoordinateIndex> {
        self.unit_coordinate
    }

    /// Coupling vector dqᵢ/dq_c of the last [`Model::update_unit_motion`].
    pub fn coupling(&self) -> &[f64] {
        &self.coupling
    }
}

impl Model {
    /// Buffers for this model. Poses are those of nothing yet: call [`Model::update_positions`] first.
    pub fn new_cache(&self) -> Cache {
        Cache::new(self)
    }
}
