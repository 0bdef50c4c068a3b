//! Typed view of an `.osim` model, faithful to the file: OpenSim's property names and OpenSim's units.
//!
//! References between components (sockets) are already resolved to indices; defaults that OpenSim assumes for absent
//! properties are already filled in. Nothing here computes: see `carpus::multibody::Model` for the compiled model.

mod constraints;
mod forces;
mod functions;
mod joints;
mod location;
mod loops;
mod muscle_property;
mod muscles;
mod paths;

pub use constraints::{ConstraintKind, ConstraintSpec};
pub use forces::{ActuatorActivation, ActuatorKind, ActuatorSpec, ForceKind, ForceSpec, PrescribedForceSpec};
pub use functions::FunctionSpec;
pub use joints::{CoordinateSpec, JointKind, JointSpec, MotionType, TransformAxisSpec};
pub(in crate::osim) use location::is_in_force_set;
pub use location::{BodyIndex, CoordinateIndex, FrameIndex, JointIndex, Location, MuscleIndex, WrapObjectIndex};
pub use muscle_property::MuscleProperty;
pub use muscles::{
    ActiveForceLengthSpec, DeGrooteFregly2016Spec, DeprecatedMuscleKind, DeprecatedMuscleSpec, FiberForceLengthSpec,
    ForceVelocitySpec, Millard2012Spec, MuscleKind, MuscleSpec, OtherMuscleSpec, RigidTendonSpec,
    TendonForceLengthSpec, Thelen2003Spec,
};
pub use paths::{
    PathFunctionsSpec, PathPointKind, PathPointSpec, PathSpec, PathWrapSpec, Quadrant, WrapMethod, WrapObjectSpec,
    WrapShape,
};

use nalgebra::{Matrix3, Vector3};

/// A model as its file states it.
#[derive(Clone, Debug, Default)]
pub struct ModelSpec {
    /// Model name.
    pub name: String,
    /// `OpenSimDocument` version, e.g. 40000.
    pub document_version: u32,
    /// Acceleration due to gravity, expressed in ground [m/s²].
    pub gravity: Vector3<f64>,
    /// Rigid bodies in the order of the file (ground is not among them).
    pub bodies: Vec<BodySpec>,
    /// All frames: ground (index 0), one per body, then offset frames.
    pub frames: Vec<FrameSpec>,
    /// Joints in the order of the file.
    pub joints: Vec<JointSpec>,
    /// Coordinates, in the order of joints and, within a joint, in OpenSim's order (SpatialTransform order for a
    /// CustomJoint).
    pub coordinates: Vec<CoordinateSpec>,
    /// Constraints.
    pub constraints: Vec<ConstraintSpec>,
    /// Wrap objects of all frames.
    pub wrap_objects: Vec<WrapObjectSpec>,
    /// Muscles, in the order of the force set.
    pub muscles: Vec<MuscleSpec>,
    /// Forces other than muscles, in the order of the force set.
    pub forces: Vec<ForceSpec>,
    /// Markers.
    pub markers: Vec<MarkerSpec>,
}

/// A rigid body.
#[derive(Clone, Debug)]
pub struct BodySpec {
    /// Body name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Mass [kg].
    pub mass: f64,
    /// Centre of mass in the body frame [m].
    pub mass_center: Vector3<f64>,
    /// Inertia about the mass centre, in body axes [kg·m²].
    pub inertia: Matrix3<f64>,
    /// The body's frame.
    pub frame: FrameIndex,
}

/// Share of an inertia up to which a negative principal moment is rounding of the numbers in files, which have six
/// digits.
const INERTIA_ROUNDING: f64 = 1e-6;

/// The smallest principal moment of an inertia [kg·m²], if it is negative: no body has such a one.
pub fn negative_principal_moment(inertia: &Matrix3<f64>) -> Option<f64> {
    let size = inertia.norm();
    // The decomposition of what is not finite would not end.
    let smallest = size.is_finite().then(|| inertia.symmetric_eigenvalues().min())?;
    (smallest < -INERTIA_ROUNDING * size).then_some(smallest)
}

/// A frame that something can be fixed to.
#[derive(Clone, Debug)]
pub struct FrameSpec {
    /// Frame name (not unique).
    pub name: String,
    /// Where it stands; `at.path` is unique.
    pub at: Location,
    /// What kind of frame.
    pub kind: FrameKind,
}

/// What a frame is fixed to.
#[derive(Clone, Debug, PartialEq)]
pub enum FrameKind {
    /// The inertial frame.
    Ground,
    /// A body's own frame.
    Body(BodyIndex),
    /// `PhysicalOffsetFrame`: fixed in a parent frame.
    Offset {
        /// Parent frame.
        parent: FrameIndex,
        /// Origin in the parent frame [m].
        translation: Vector3<f64>,
        /// Body-fixed x-y-z rotation sequence from the parent frame [rad].
        orientation: Vector3<f64>,
    },
}

/// A marker.
#[derive(Clone, Debug)]
pub struct MarkerSpec {
    /// Name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Frame.
    pub frame: FrameIndex,
    /// Location in the frame [m].
    pub location: Vector3<f64>,
    /// Whether placing markers leaves it where it is.
    pub fixed: bool,
}
