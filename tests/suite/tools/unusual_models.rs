//! Models of a build that is rare but that OpenSim takes.

use std::path::Path;

use carpus::storage::Storage;
use carpus::tools::{Outcome, run_tool};

use super::opensim::{Bench, motion_of, setup};

/// Axes of a CustomJoint with a function but no coordinate, semi-axes below zero, a frame given by markers of its body,
/// a rigid tendon of no length, and a crank that pushes a slider through a constant distance.
const MODEL: &str = r#"<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40500">
<Model name="unusual">
<BodySet name="bodyset"><objects>
<Body name="a"><mass>2</mass><mass_center>0.01 0.02 0.03</mass_center><inertia>0.1 0.2 0.25 0 0 0</inertia></Body>
<Body name="b">
<components>
<Marker name="m1"><socket_parent_frame>..</socket_parent_frame><location>0.1 0 0.02</location></Marker>
<Marker name="m2"><socket_parent_frame>..</socket_parent_frame><location>0.1 0.2 0</location></Marker>
<Marker name="m3"><socket_parent_frame>..</socket_parent_frame><location>0 0.1 0.3</location></Marker>
<StationDefinedFrame name="hinge">
<socket_point_a>/bodyset/b/m1</socket_point_a><socket_point_b>/bodyset/b/m2</socket_point_b><socket_point_c>/bodyset/b/m3</socket_point_c><socket_origin_point>/bodyset/b/m2</socket_origin_point>
<ab_axis>+y</ab_axis><ab_x_ac_axis>-x</ab_x_ac_axis>
</StationDefinedFrame>
</components>
<mass>1</mass><mass_center>0 0.1 0</mass_center><inertia>0.1 0.1 0.1 0 0 0</inertia></Body>
<Body name="c"><mass>1</mass><mass_center>0 -0.2 0</mass_center><inertia>0.1 0.1 0.1 0 0 0</inertia></Body>
<Body name="crank"><mass>1</mass><mass_center>0.1 0 0</mass_center><inertia>0.01 0.01 0.02 0 0 0</inertia></Body>
<Body name="slider"><mass>1</mass><mass_center>0 0 0</mass_center><inertia>0.01 0.01 0.01 0 0 0</inertia></Body>
</objects></BodySet>
<JointSet name="jointset"><objects>
<CustomJoint name="tilted"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/a</socket_child_frame>
<coordinates><Coordinate name="turn"><default_value>0.2</default_value><range>-3 3</range></Coordinate></coordinates>
<SpatialTransform>
<TransformAxis name="rotation1"><coordinates>turn</coordinates><axis>0 1 0</axis><LinearFunction name="function"><coefficients>1 0</coefficients></LinearFunction></TransformAxis>
<TransformAxis name="rotation2"><coordinates></coordinates><axis>1 0 0</axis><LinearFunction name="function"><coefficients>0.3 0.7</coefficients></LinearFunction></TransformAxis>
<TransformAxis name="rotation3"><coordinates></coordinates><axis>0 0 1</axis><MultiplierFunction name="function"><function><LinearFunction><coefficients>0.1 0.5</coefficients></LinearFunction></function><scale>2</scale></MultiplierFunction></TransformAxis>
</SpatialTransform></CustomJoint>
<EllipsoidJoint name="mirrored"><socket_parent_frame>/bodyset/a</socket_parent_frame><socket_child_frame>/bodyset/b</socket_child_frame>
<coordinates><Coordinate name="b1"><range>-3 3</range></Coordinate><Coordinate name="b2"><range>-3 3</range></Coordinate><Coordinate name="b3"><range>-3 3</range></Coordinate></coordinates>
<radii_x_y_z>-0.1 0.2 -0.15</radii_x_y_z></EllipsoidJoint>
<PinJoint name="hinged"><socket_parent_frame>/bodyset/b/hinge</socket_parent_frame><socket_child_frame>/bodyset/c</socket_child_frame>
<coordinates><Coordinate name="swing"><range>-3 3</range></Coordinate></coordinates></PinJoint>
<PinJoint name="cranked"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/crank</socket_child_frame>
<coordinates><Coordinate name="angle"><default_value>0.6</default_value><range>-3 3</range></Coordinate></coordinates></PinJoint>
<SliderJoint name="slid"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/slider</socket_child_frame>
<coordinates><Coordinate name="way"><default_value>0.65</default_value><range>-3 3</range></Coordinate></coordinates></SliderJoint>
</objects></JointSet>
<ConstraintSet name="constraintset"><objects>
<ConstantDistanceConstraint name="rod"><socket_body_1>/bodyset/crank</socket_body_1><socket_body_2>/bodyset/slider</socket_body_2><location_body_1>0.2 0 0</location_body_1><location_body_2>0 0 0</location_body_2><constant_distance>0.5</constant_distance></ConstantDistanceConstraint>
</objects></ConstraintSet>
<ForceSet name="forceset"><objects>
<Millard2012EquilibriumMuscle name="rigid">
<GeometryPath name="path"><PathPointSet><objects>
<PathPoint name="p1"><socket_parent_frame>/ground</socket_parent_frame><location>0 0 0</location></PathPoint>
<PathPoint name="p2"><socket_parent_frame>/bodyset/slider</socket_parent_frame><location>0 0 0</location></PathPoint>
</objects></PathPointSet></GeometryPath>
<max_isometric_force>100</max_isometric_force><optimal_fiber_length>0.6</optimal_fiber_length><tendon_slack_length>0</tendon_slack_length><ignore_tendon_compliance>true</ignore_tendon_compliance>
</Millard2012EquilibriumMuscle>
</objects></ForceSet>
</Model>
</OpenSimDocument>
"#;

const INNER: &str = "<output_precision>12</output_precision><initial_time>0</initial_time><final_time>0.2</final_time>\
                     <solve_for_equilibrium_for_auxiliary_states>true</solve_for_equilibrium_for_auxiliary_states>\
                     <coordinates_file>motion.mot</coordinates_file>\
                     <lowpass_cutoff_frequency_for_coordinates>-1</lowpass_cutoff_frequency_for_coordinates>\
                     <AnalysisSet name=\"Analyses\"><objects><Kinematics name=\"Kinematics\"/><BodyKinematics \
                     name=\"BodyKinematics\"/><MuscleAnalysis name=\"MuscleAnalysis\"><muscle_list>all</muscle_list>\
                     <moment_arm_coordinate_list>all</moment_arm_coordinate_list>\
                     <compute_moments>true</compute_moments></MuscleAnalysis></objects></AnalysisSet>";

/// Angles of the crank, with the way of the slider that the rod leaves it.
fn crank_motion() -> String {
    motion_of(&["turn", "b1", "b2", "b3", "swing", "angle", "way"], 12, 0.02, |t| {
        let angle = 0.6 + 0.3 * (3.0 * t).sin();
        let (x, y) = (0.2 * f64::cos(angle), 0.2 * f64::sin(angle));
        let way = x + (0.25 - y * y).sqrt();
        vec![0.2 + t, 0.3 * t.sin(), 0.2 - t * t, 0.1 * t, 0.5 * t.cos(), angle, way]
    })
}

fn written(outcome: &Outcome, name: &str) -> Storage {
    let file = outcome.files.iter().find(|f| f.path.ends_with(name)).unwrap_or_else(|| panic!("{name}"));
    Storage::parse(&file.bytes, Path::new(name)).unwrap()
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_models_of_unusual_build() {
    let bench = Bench::new();
    bench.write("unusual.osim", MODEL);
    bench.write("motion.mot", &crank_motion());
    let model = bench.path("unusual.osim");
    let tolerance = |name: &str| if name.contains("dudt") || name.contains("acc") { 1e-4 } else { 1e-5 };
    bench.compare("analyses of unusual models", &model, &setup("AnalyzeTool", &model, INNER), &tolerance);
    let inner = "<forces_to_exclude>Muscles</forces_to_exclude><coordinates_file>motion.mot</coordinates_file>\
                 <output_gen_force_file>id.sto</output_gen_force_file>";
    let setup = setup("InverseDynamicsTool", &model, inner);
    bench.compare("inverse dynamics of unusual models", &model, &setup, &|_| 1e-6);
}

#[test]
fn verif_moment_arms_follow_constraints_between_bodies() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("unusual.osim");
    std::fs::write(&model, MODEL).unwrap();
    std::fs::write(folder.path().join("motion.mot"), crank_motion()).unwrap();
    let path = folder.path().join("setup.xml");
    std::fs::write(&path, setup("AnalyzeTool", &model, INNER)).unwrap();
    let outcome = run_tool(&path, None, false).unwrap_or_else(|e| panic!("{e}"));
    let [angles, arms] =
        ["run_Kinematics_q.sto", "run_MuscleAnalysis_MomentArm_angle.sto"].map(|n| written(&outcome, n));
    let column = angles.labels.iter().position(|label| label == "angle").unwrap();
    assert!(arms.len() > 5);
    for (row, arm) in angles.rows.iter().zip(&arms.rows) {
        let angle = row[column].to_radians();
        let (x, y) = (0.2 * angle.cos(), 0.2 * angle.sin());
        // way = x + √(0.25 − y²); the muscle is as long as the slider is far.
        let slope = -y - y * x / (0.25 - y * y).sqrt();
        assert!((arm[0] + slope).abs() < 1e-6, "{} instead of {}", arm[0], -slope);
    }
}

#[test]
fn verif_muscles_of_no_use_refuse_only_what_needs_their_force() {
    let folder = tempfile::tempdir().unwrap();
    let broken =
        MODEL.replace("<ignore_tendon_compliance>true", "<min_control>0</min_control><ignore_tendon_compliance>true");
    let model = folder.path().join("unusual.osim");
    std::fs::write(&model, broken).unwrap();
    std::fs::write(folder.path().join("motion.mot"), crank_motion()).unwrap();
    let path = folder.path().join("setup.xml");
    let inverse = |excluded: &str| {
        let inner =
            format!("<forces_to_exclude>{excluded}</forces_to_exclude><coordinates_file>motion.mot</coordinates_file>");
        std::fs::write(&path, setup("InverseDynamicsTool", &model, &inner)).unwrap();
        run_tool(&path, None, false)
    };
    assert!(inverse("Muscles").is_ok());
    let Err(error) = inverse("") else { panic!("the muscle is needed") };
    let line = MODEL.lines().position(|line| line.contains("name=\"rigid\"")).unwrap() + 1;
    let text = error.to_string();
    assert!(text.contains(&format!("unusual.osim:{line}: rigid: min_control")), "{text}");
}

/// What a ForwardTool writes for a model with these bodies, joints and forces.
fn simulated(bodies: &str, joints: &str, forces: &str) -> Outcome {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("still.osim");
    let text = format!(
        "<OpenSimDocument Version=\"40500\"><Model \
         name=\"still\"><BodySet><objects>{bodies}</objects></BodySet><JointSet><objects>{joints}</objects></JointSet>\
         <ForceSet><objects>{forces}</objects></ForceSet></Model></OpenSimDocument>"
    );
    std::fs::write(&model, text).unwrap();
    let path = folder.path().join("setup.xml");
    let inner = "<initial_time>0</initial_time><final_time>0.02</final_time>";
    std::fs::write(&path, setup("ForwardTool", &model, inner)).unwrap();
    run_tool(&path, None, false).unwrap_or_else(|e| panic!("{e}"))
}

const BODY: &str = "<Body name=\"b\"><mass>1</mass><inertia>1 1 1 0 0 0</inertia></Body>";

#[test]
fn verif_a_model_that_cannot_move_is_simulated() {
    let weld = "<WeldJoint name=\"w\"><socket_parent_frame>/ground</socket_parent_frame>\
                <socket_child_frame>/bodyset/b</socket_child_frame></WeldJoint>";
    let states = written(&simulated(BODY, weld, ""), "run_states.sto");
    assert_eq!((states.labels.len(), states.time.first(), states.time.last()), (0, Some(&0.0), Some(&0.02)));
}

#[test]
fn verif_a_body_without_joint_falls_and_idle_actuators_have_controls() {
    let actuator = |name: &str, applies: bool| {
        format!(
            "<CoordinateActuator \
             name=\"{name}\"><appliesForce>{applies}</appliesForce><coordinate>free_b_coord_0</coordinate>\
             </CoordinateActuator>"
        )
    };
    let outcome = simulated(BODY, "", &(actuator("idle", false) + &actuator("acting", true)));
    let states = written(&outcome, "run_states.sto");
    let height = states.labels.iter().position(|l| l == "/jointset/free_b/free_b_coord_4/value").expect("its name");
    let fallen = states.rows.last().unwrap()[height] + 9.80665 * 0.02 * 0.02 / 2.0;
    // The tool integrates to 1e-5.
    assert!(fallen.abs() < 1e-4, "{fallen}");
    assert_eq!(written(&outcome, "run_controls.sto").labels, ["idle", "acting"]);
}
