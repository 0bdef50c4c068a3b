//! Moment arms and lengthening speeds against the length itself.

use approx::assert_abs_diff_eq;
use carpus::multibody::{Cache, Model};
use carpus::osim::OsimFile;
use carpus::osim::spec::CoordinateIndex;
use carpus::paths::{Path, PathError, PathGeometry, PointOrigin};

/// A pin joint at the origin of ground; a muscle from ground over a conditional and a moving point to the body.
const MODEL: &str = r#"<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40000"><Model name="hinge"><BodySet><objects>
<Body name="arm"><mass>1</mass><mass_center>0 0 0</mass_center><inertia>1 1 1 0 0 0</inertia></Body></objects></BodySet>
<JointSet><objects><PinJoint name="pin"><socket_parent_frame>/ground</socket_parent_frame>
<socket_child_frame>/bodyset/arm</socket_child_frame><coordinates><Coordinate name="angle"><default_value>0</default_value>
<range>-1.5 1.5</range></Coordinate></coordinates></PinJoint></objects></JointSet>
<ForceSet><objects><Thelen2003Muscle name="muscle"><GeometryPath name="path"><PathPointSet><objects>
<PathPoint name="p1"><socket_parent_frame>/ground</socket_parent_frame><location>0.03 0.2 0.01</location></PathPoint>
<ConditionalPathPoint name="p2"><socket_parent_frame>/ground</socket_parent_frame><location>0.05 0.1 0</location>
<socket_coordinate>/jointset/pin/angle</socket_coordinate><range>0.5 2</range></ConditionalPathPoint>
<MovingPathPoint name="p3"><socket_parent_frame>/bodyset/arm</socket_parent_frame>
<socket_x_coordinate>/jointset/pin/angle</socket_x_coordinate><socket_y_coordinate>/jointset/pin/angle</socket_y_coordinate>
<socket_z_coordinate>/jointset/pin/angle</socket_z_coordinate>
<x_location><SimmSpline><x>-2 -1 0 1 2</x><y>0.02 0.03 0.045 0.04 0.03</y></SimmSpline></x_location>
<y_location><SimmSpline><x>-2 -1 0 1 2</x><y>-0.1 -0.11 -0.1 -0.12 -0.1</y></SimmSpline></y_location>
<z_location><Constant><value>0.005</value></Constant></z_location></MovingPathPoint>
</objects></PathPointSet></GeometryPath></Thelen2003Muscle></objects></ForceSet></Model></OpenSimDocument>"#;

struct Hinge {
    model: Model,
    path: Path,
    cache: Cache,
    geometry: PathGeometry,
}

impl Hinge {
    fn new() -> Hinge {
        let osim = OsimFile::parse(MODEL, "hinge.osim").unwrap_or_else(|error| panic!("{error}"));
        let model = Model::compile(&osim.spec).unwrap_or_else(|error| panic!("{error}"));
        let path = Path::compile(&osim.spec.muscles[0].path, &osim.spec, &model).unwrap_or_else(|e| panic!("{e}"));
        let (cache, geometry) = (model.new_cache(), path.new_geometry());
        Hinge { model, path, cache, geometry }
    }

    fn length(&mut self, angle: f64) -> f64 {
        self.model.update_positions(&[angle], &mut self.cache);
        self.path.update(&[angle], &self.cache, &mut self.geometry);
        self.geometry.length()
    }

    fn moment_arm(&mut self, angle: f64) -> f64 {
        self.length(angle);
        self.model.update_unit_motion(&[angle], CoordinateIndex(0), &mut self.cache);
        self.path.moment_arm(&[angle], &self.cache, &self.geometry)
    }
}

/// r = −dL/dq, the motion of a moving point included, and dL/dt = −r·q̇.
#[test]
fn verif_moment_arm_and_speed_are_derivatives_of_length() {
    const STEP: f64 = 1e-5; // rad
    const TOLERANCE: f64 = 1e-9; // m; of central differences with this step
    let mut hinge = Hinge::new();
    for angle in [-1.4, -0.9, -0.3, 0.2, 0.45, 0.6, 1.1, 1.45] {
        let slope = (hinge.length(angle + STEP) - hinge.length(angle - STEP)) / (2.0 * STEP);
        let arm = hinge.moment_arm(angle);
        assert_abs_diff_eq!(arm, -slope, epsilon = TOLERANCE);
        let speed = -2.5;
        hinge.model.update_velocities(&[angle], &[speed], &mut hinge.cache);
        let lengthening = hinge.path.lengthening_speed(&[angle], &[speed], &hinge.cache, &hinge.geometry);
        assert_abs_diff_eq!(lengthening, -arm * speed, epsilon = 1e-14);
    }
}

/// A conditional point is part of the path within its range and 1e-5 rad beyond, as in OpenSim.
#[test]
fn verif_conditional_point_is_active_in_its_range() {
    let mut hinge = Hinge::new();
    for (angle, active) in [(0.5 - 1.1e-5, false), (0.5 - 0.9e-5, true), (0.5, true), (1.0, true), (-1.0, false)] {
        hinge.length(angle);
        let found = hinge.geometry.points().iter().any(|point| point.origin == PointOrigin::Point(1));
        assert_eq!(found, active, "at {angle}");
    }
}

/// A path needs two points, and its wraps need points to wrap between.
#[test]
fn verif_impossible_paths_are_refused() {
    let osim = OsimFile::parse(MODEL, "hinge.osim").unwrap_or_else(|error| panic!("{error}"));
    let model = Model::compile(&osim.spec).unwrap_or_else(|error| panic!("{error}"));
    let mut path = osim.spec.muscles[0].path.clone();
    path.points.truncate(1);
    let error = Path::compile(&path, &osim.spec, &model).expect_err("one point is too few");
    assert!(matches!(error, PathError::TooFewPoints { found: 1, .. }), "{error}");
}
