//! Paths, their points, and the surfaces that they wrap over.

use nalgebra::Vector3;

use super::functions::FunctionSpec;
use super::location::{CoordinateIndex, FrameIndex, Location, WrapObjectIndex};

/// A surface that paths can wrap over.
#[derive(Clone, Debug)]
pub struct WrapObjectSpec {
    /// Name (not unique among frames).
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Frame that it is fixed to.
    pub frame: FrameIndex,
    /// Whether it is active.
    pub active: bool,
    /// Origin in the frame [m].
    pub translation: Vector3<f64>,
    /// Body-fixed x-y-z rotation [rad].
    pub xyz_body_rotation: Vector3<f64>,
    /// Constrained half of the surface.
    pub quadrant: Quadrant,
    /// Which surface.
    pub shape: WrapShape,
}

/// Which half of a wrap surface a path may use (`quadrant`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quadrant {
    /// Unconstrained (`all`).
    All,
    /// One half: axis 0, 1, 2 for x, y, z and its sign (+1 or −1).
    Half {
        /// 0, 1 or 2.
        axis: usize,
        /// +1 or −1.
        sign: i8,
    },
}

/// Wrap surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WrapShape {
    /// `WrapSphere`.
    Sphere {
        /// Radius [m].
        radius: f64,
    },
    /// `WrapCylinder`, axis along z.
    Cylinder {
        /// Radius [m].
        radius: f64,
        /// Length [m].
        length: f64,
    },
    /// `WrapEllipsoid`.
    Ellipsoid {
        /// Semi-axes [m].
        dimensions: [f64; 3],
    },
    /// `WrapTorus`, axis along z.
    Torus {
        /// Radius of the hole [m], as OpenSim defines it.
        inner_radius: f64,
        /// Outer radius [m], as OpenSim defines it.
        outer_radius: f64,
    },
}

/// A `GeometryPath`.
#[derive(Clone, Debug, Default)]
pub struct PathSpec {
    /// Where it stands.
    pub at: Location,
    /// Points from origin to insertion.
    pub points: Vec<PathPointSpec>,
    /// Wrap instances in the order of the file.
    pub wraps: Vec<PathWrapSpec>,
    /// Functions that take the place of points and wraps: `FunctionBasedPath`.
    pub functions: Option<Box<PathFunctionsSpec>>,
}

/// What a `FunctionBasedPath` states.
#[derive(Clone, Debug)]
pub struct PathFunctionsSpec {
    /// Arguments of the functions, in their order.
    pub coordinates: Vec<CoordinateIndex>,
    /// Length [m].
    pub length: FunctionSpec,
    /// Moment arms [m] about the coordinates; empty: minus the derivatives of the length.
    pub moment_arms: Vec<FunctionSpec>,
    /// Lengthening speed [m/s] by coordinates, then their rates; `None`: by the moment arms.
    pub lengthening_speed: Option<FunctionSpec>,
}

/// A point of a path.
#[derive(Clone, Debug)]
pub struct PathPointSpec {
    /// Point name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Frame that the point is given in.
    pub frame: FrameIndex,
    /// Which kind of point.
    pub kind: PathPointKind,
}

/// Path point classes.
#[derive(Clone, Debug)]
pub enum PathPointKind {
    /// `PathPoint`.
    Fixed {
        /// Location in the frame [m].
        location: Vector3<f64>,
    },
    /// `ConditionalPathPoint`: active while the coordinate is within the range.
    Conditional {
        /// Location in the frame [m].
        location: Vector3<f64>,
        /// The coordinate that decides.
        coordinate: CoordinateIndex,
        /// Range [rad or m].
        range: [f64; 2],
    },
    /// `MovingPathPoint`: each component a function [m] of a coordinate (`None`: constant in OpenSim, function of 0).
    Moving {
        /// x, y, z: function and its argument.
        location: Box<[(FunctionSpec, Option<CoordinateIndex>); 3]>,
    },
}

/// A `PathWrap`: one path over one wrap object.
#[derive(Clone, Debug)]
pub struct PathWrapSpec {
    /// Name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// The wrap object.
    pub wrap_object: WrapObjectIndex,
    /// How an ellipsoid is wrapped.
    pub method: WrapMethod,
    /// First and last path point between which the path may wrap, counted from 1; −1: no limit.
    pub range: [i32; 2],
}

/// `PathWrap::method`, used for ellipsoids.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum WrapMethod {
    /// `hybrid` (the default).
    #[default]
    Hybrid,
    /// `midpoint`.
    Midpoint,
    /// `axial`.
    Axial,
}
