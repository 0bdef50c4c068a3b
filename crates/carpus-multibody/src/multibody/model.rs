//! The compiled model.

use super::coordinate::Coordinate;
use super::coupler::Coupler;
use super::index::BaseIndex;
use super::mobilizer::Node;
use carpus_numerics::spatial::Transform;
use carpus_osim::osim::spec::{BodyIndex, CoordinateIndex, FrameIndex, JointIndex, WrapObjectIndex};
use nalgebra::{Matrix3, Vector3};

/// A rigid body with its mass properties.
#[derive(Clone, Debug)]
pub struct Body {
    /// Body name.
    pub name: String,
    /// Mass [kg].
    pub mass: f64,
    /// Centre of mass in the body frame `p_BBcm` [m].
    pub mass_center: Vector3<f64>,
    /// Inertia about the mass centre, in body axes [kg·m²]; zero for a massless body, as in OpenSim.
    pub inertia: Matrix3<f64>,
}

/// A frame, located in the body (or ground) that it is fixed to.
#[derive(Clone, Debug)]
#[allow(non_snake_case)]
pub struct Frame {
    /// Frame name (not unique).
    pub name: String,
    /// What it is fixed to.
    pub base: BaseIndex,
    /// Pose of the frame in its base.
    pub X_BF: Transform,
}

/// A wrap object, located in the body (or ground) that it is fixed to.
#[derive(Clone, Copy, Debug)]
#[allow(non_snake_case)]
pub struct WrapPlacement {
    /// What it is fixed to.
    pub base: BaseIndex,
    /// Pose of the wrap surface's frame in its base.
    pub X_BW: Transform,
}

/// A body of which a loop of joints took a part: the two halves, welded to one another.
#[derive(Clone, Debug)]
pub struct LoopWeld {
    /// The joint that was cut.
    pub joint: JointIndex,
    /// The body and its part, whose frames coincide.
    pub bases: [BaseIndex; 2],
}

/// The compiled skeleton: bodies, frames, joints, coordinates and couplers. Immutable.
///
/// All indices equal those of the [`ModelSpec`] that it was compiled from. Parts of bodies that close loops of joints
/// follow its bodies.
#[derive(Clone, Debug)]
pub struct Model {
    /// Model name.
    pub name: String,
    /// Acceleration due to gravity, expressed in ground [m/s²].
    pub gravity: Vector3<f64>,
    /// Coordinates.
    pub coordinates: Vec<Coordinate>,
    /// Bodies.
    pub bodies: Vec<Body>,
    /// Frames; frame 0 is ground.
    pub frames: Vec<Frame>,
    /// Where wrap objects are fixed.
    pub wrap_objects: Vec<WrapPlacement>,
    /// Couplers, each after the one that drives its argument.
    pub couplers: Vec<Coupler>,
    /// Names and classes of enforced constraints that this program does not enforce.
    pub unsupported_constraints: Vec<(String, String)>,
    /// Loops of joints: a joint that closes one connects a part of its child instead, with an equal share of the mass,
    /// which is welded to it by a constraint, as in OpenSim.
    pub loop_welds: Vec<LoopWeld>,
    /// Bodies without any joint. OpenSim gives them a FreeJoint; here they rest at ground, its default pose.
    pub unattached_bodies: Vec<BodyIndex>,
    /// Tree nodes, inboard before outboard.
    pub(super) nodes: Vec<Node>,
    /// Node of each base; `None` for ground and unattached bodies.
    pub(super) node_of_base: Vec<Option<usize>>,
    /// Coupler that drives each coordinate.
    pub(super) driven_by: Vec<Option<usize>>,
}

impl Model {
    /// Number of coordinates.
    pub fn n_coordinates(&self) -> usize {
        self.coordinates.len()
    }

    /// Number of bases: ground and all bodies.
    pub fn n_bases(&self) -> usize {
        self.bodies.len() + 1
    }

    /// The coordinate of that name.
    pub fn coordinate(&self, name: &str) -> Option<CoordinateIndex> {
        self.coordinates.iter().position(|c| c.name == name).map(CoordinateIndex)
    }

    /// The body of that name.
    pub fn body(&self, name: &str) -> Option<BodyIndex> {
        self.bodies.iter().position(|b| b.name == name).map(BodyIndex)
    }

    /// CustomJoints of which Simbody's accelerations, and so OpenSim's, contradict their velocities: one coordinate
    /// turns several axes, and a term in the square of its speed is wrong.
    pub fn contradictory_joints(&self) -> impl Iterator<Item = JointIndex> + '_ {
        self.nodes.iter().filter(|node| node.mobilizer.in_simbody.is_some()).map(|node| node.joint)
    }

    /// The same model, its accelerations those of OpenSim where these contradict velocities or masses, too: joints of
    /// which one coordinate turns several axes ([`Model::contradictory_joints`]; Simbody
    /// `MobilizedBody::FunctionBased`), couplers of several coordinates (second derivatives of
    /// `MultivariatePolynomialFunction`), and parts of bodies that close loops, whose inertia about the mass centre is
    /// that of 1 kg about the body's origin (`Body::extendConnectToModel`).
    pub fn with_accelerations_of_opensim(mut self) -> Model {
        self.nodes.iter_mut().for_each(|node| node.mobilizer.follows_simbody = true);
        self.couplers = self.couplers.into_iter().map(Coupler::with_second_rates_of_opensim).collect();
        for part in self.loop_welds.iter().filter_map(|weld| weld.bases[1].body()) {
            let body = &mut self.bodies[part.0];
            if body.mass > 0.0 {
                let c = body.mass_center;
                let of_center = Matrix3::from_diagonal_element(c.norm_squared()) - c * c.transpose();
                body.inertia = body.inertia / body.mass + of_center;
            }
        }
        self
    }

    /// The joint that connects a body, on its way to ground; `None` for an unattached body.
    pub fn inboard_joint(&self, body: BodyIndex) -> Option<JointIndex> {
        self.node_of_base[BaseIndex::from(body).0].map(|i| self.nodes[i].joint)
    }

    /// Where a frame is fixed.
    pub fn frame(&self, frame: FrameIndex) -> &Frame {
        &self.frames[frame.0]
    }

    /// Where a wrap object is fixed.
    pub fn wrap_object(&self, wrap_object: WrapObjectIndex) -> &WrapPlacement {
        &self.wrap_objects[wrap_object.0]
    }
}
