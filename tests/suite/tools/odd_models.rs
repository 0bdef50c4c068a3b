//! Models of which OpenSim computes a part: the tools give that part, and say what is missing.

use carpus::storage::Storage;
use carpus::tools::{Outcome, run_tool};

/// Two links that turn about z; of the second one MASS is the mass. A muscle from ground to the first one, and a motor.
const MODEL: &str = r#"<OpenSimDocument Version="40000"><Model name="links">
<gravity>0 -9.8 0</gravity>
<BodySet><objects>
<Body name="a"><mass>1</mass><mass_center>0.05 -0.2 0.01</mass_center><inertia>0.02 0.01 0.02 0 0 0</inertia></Body>
<Body name="b"><mass>MASS</mass><mass_center>0 -0.2 0</mass_center><inertia>0 0 0 0 0 0</inertia></Body>
</objects></BodySet>
<JointSet><objects>
<PinJoint name="first"><socket_parent_frame>base</socket_parent_frame><socket_child_frame>/bodyset/a</socket_child_frame>
<coordinates><Coordinate name="q1"/></coordinates>
<frames><PhysicalOffsetFrame name="base"><socket_parent>/ground</socket_parent><translation>0.7 0.3 -0.2</translation><orientation>0.3 0.2 0.1</orientation></PhysicalOffsetFrame></frames></PinJoint>
<PinJoint name="second"><socket_parent_frame>end</socket_parent_frame><socket_child_frame>/bodyset/b</socket_child_frame>
<coordinates><Coordinate name="q2"/></coordinates>
<frames><PhysicalOffsetFrame name="end"><socket_parent>/bodyset/a</socket_parent><translation>0.03 -0.4 0.1</translation><orientation>0.1 0.5 -0.4</orientation></PhysicalOffsetFrame></frames></PinJoint>
</objects></JointSet>
<ForceSet><objects>
<Schutte1993Muscle_Deprecated name="old"><GeometryPath><PathPointSet><objects>
<PathPoint name="p1"><socket_parent_frame>/ground</socket_parent_frame><location>0.7 0.5 -0.2</location></PathPoint>
<PathPoint name="p2"><socket_parent_frame>/bodyset/a</socket_parent_frame><location>0.05 -0.1 0</location></PathPoint>
</objects></PathPointSet></GeometryPath>
<appliesForce>APPLIES</appliesForce><max_isometric_force>30</max_isometric_force><optimal_fiber_length>0.1</optimal_fiber_length><tendon_slack_length>0.2</tendon_slack_length><time_scale>SCALE</time_scale></Schutte1993Muscle_Deprecated>
<CoordinateActuator name="motor"><coordinate>q2</coordinate><optimal_force>4</optimal_force></CoordinateActuator>
</objects></ForceSet>
<ControllerSet><objects><PrescribedController name="on"><actuator_list>motor</actuator_list>
<FunctionSet name="ControlFunctions"><objects><Constant><value>0.5</value></Constant></objects></FunctionSet></PrescribedController></objects></ControllerSet>
</Model></OpenSimDocument>"#;

/// Runs a tool along a motion of both links.
fn run(mass: &str, time_scale: &str, class: &str, inner: &str) -> Result<Outcome, String> {
    run_model(&MODEL.replace("MASS", mass).replace("SCALE", time_scale).replace("APPLIES", "true"), class, inner)
}

fn run_model(model: &str, class: &str, inner: &str) -> Result<Outcome, String> {
    let folder = folder_of(model, class, inner);
    run_tool(&folder.path().join("setup.xml"), None, false).map_err(|e| e.to_string())
}

/// A model, a motion and a setup.
fn folder_of(model: &str, class: &str, inner: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("links.osim", model);
    let row = |i: i32| {
        let t = 0.05 * f64::from(i);
        format!("{t}\t{}\t{}\n", 0.4 * (3.0 * t).sin(), 0.9 * (2.0 * t + 0.3).cos())
    };
    let rows: String = (0..20).map(row).collect();
    write("q.mot", &format!("q\nversion=1\nnRows=20\nnColumns=3\ninDegrees=no\nendheader\ntime\tq1\tq2\n{rows}"));
    let text = format!(
        "<OpenSimDocument Version=\"40000\"><{class} \
         name=\"t\"><model_file>links.osim</model_file><results_directory>.</results_directory>\
         <initial_time>0.1</initial_time><final_time>0.8</final_time>{inner}</{class}></OpenSimDocument>"
    );
    write("setup.xml", &text);
    folder
}

fn table(outcome: &Outcome, end: &str) -> Storage {
    let file = outcome.files.iter().find(|f| f.path.to_string_lossy().ends_with(end));
    let file =
        file.unwrap_or_else(|| panic!("no {end}: {:?}", outcome.files.iter().map(|f| &f.path).collect::<Vec<_>>()));
    Storage::parse(&file.bytes, &file.path).unwrap()
}

const MOTION: &str = "<coordinates_file>q.mot</coordinates_file>";

#[test]
fn verif_without_mass_accelerations_alone_are_not_numbers() {
    let analyses = "<AnalysisSet><objects><Kinematics/><BodyKinematics/><JointReaction/></objects></AnalysisSet>";
    let outcome = run("0", "0.1", "AnalyzeTool", &format!("{MOTION}{analyses}")).unwrap();
    let warned =
        |w: &(std::path::PathBuf, usize, String)| w.2.contains("accelerations are not numbers") && w.2.contains("q2");
    assert!(outcome.warnings.iter().any(warned), "{:?}", outcome.warnings);
    assert!(table(&outcome, "_dudt.sto").rows.iter().flatten().all(|x| x.is_nan()));
    assert!(table(&outcome, "_acc_global.sto").rows.iter().flatten().any(|x| x.is_nan()));
    for end in ["_Kinematics_q.sto", "_Kinematics_u.sto", "_pos_global.sto", "_vel_global.sto"] {
        assert!(table(&outcome, end).rows.iter().flatten().all(|x| x.is_finite()), "{end}");
    }
    let outcome = run("1", "0.1", "AnalyzeTool", &format!("{MOTION}{analyses}")).unwrap();
    assert!(table(&outcome, "_dudt.sto").rows.iter().flatten().all(|x| x.is_finite()));
    assert!(!outcome.warnings.iter().any(warned), "{:?}", outcome.warnings);
}

#[test]
fn verif_a_joint_that_only_turns_carries_no_force() {
    let inner = "<time_range>0.1 \
                 0.8</time_range><joints_to_report_body_forces>ALL</joints_to_report_body_forces>\
                 <output_body_forces_file>joints.sto</output_body_forces_file>";
    let outcome = run("1", "0.1", "InverseDynamicsTool", &format!("{MOTION}{inner}")).unwrap();
    let joints = table(&outcome, "joints.sto");
    for (label, i) in joints.labels.iter().zip(0..) {
        let largest = joints.rows.iter().map(|row| row[i].abs()).fold(0.0, f64::max);
        let is_force = ["_FX", "_FY", "_FZ"].iter().any(|end| label.ends_with(end));
        assert_eq!(largest == 0.0, is_force, "{label}: {largest}");
    }
}

/// OpenSim leaves controllers on in inverse dynamics: what they make an actuator do is not asked of the joint.
#[test]
fn verif_controllers_act_in_inverse_dynamics() {
    let moments = |excluded: &str| {
        let inner =
            format!("{MOTION}<time_range>0.1 0.8</time_range><forces_to_exclude>{excluded}</forces_to_exclude>");
        table(&run("1", "0.1", "InverseDynamicsTool", &inner).unwrap(), "inverse_dynamics.sto")
    };
    let (with, without) = (moments("Muscles"), moments("Muscles motor"));
    assert_eq!(with.labels, ["q1_moment", "q2_moment"]);
    for (with, without) in with.rows.iter().zip(&without.rows) {
        assert!(
            (with[1] - without[1] + 2.0).abs() < 1e-7 && (with[0] - without[0]).abs() < 1e-7,
            "{with:?} {without:?}"
        );
    }
}

/// Files of the nineties state a time scale of 0, by which OpenSim divides.
#[test]
fn verif_a_time_scale_of_0_leaves_what_needs_none() {
    let analyses = "<solve_for_equilibrium_for_auxiliary_states>true</solve_for_equilibrium_for_auxiliary_states>\
                    <AnalysisSet><objects><MuscleAnalysis/></objects></AnalysisSet>";
    let inner = format!("{MOTION}{analyses}");
    let [none, some] = ["0", "0.1"].map(|scale| run("1", scale, "AnalyzeTool", &inner).unwrap());
    for end in ["_Length.sto", "_TendonForce.sto", "_FiberLength.sto"] {
        assert_eq!(table(&none, end).rows, table(&some, end).rows, "{end}");
    }
    assert!(!table(&none, "_FiberVelocity.sto").rows.iter().flatten().any(|x| x.is_finite()));
    assert!(table(&some, "_FiberVelocity.sto").rows.iter().flatten().all(|x| x.is_finite()));
    let Err(error) = run("1", "0", "ForwardTool", "") else { panic!("rates that are no numbers") };
    assert!(error.contains("old") && error.contains("time_scale is 0, expected a number above 0"), "{error}");
}

/// Tendon forces of OpenSim's deprecated muscles are what they actuate.
#[test]
fn verif_idle_muscles_of_the_oldest_kinds_have_no_tendon_force() {
    let analyses = "<AnalysisSet><objects><MuscleAnalysis/></objects></AnalysisSet>";
    let forces = |applies: &str, end: &str| {
        let model = MODEL.replace("MASS", "1").replace("SCALE", "0.1").replace("APPLIES", applies);
        let outcome = run_model(&model, "AnalyzeTool", &format!("{MOTION}{analyses}")).unwrap();
        table(&outcome, end).rows.concat()
    };
    for end in ["_TendonForce.sto", "_Moment_q1.sto"] {
        assert!(forces("false", end).iter().all(|x| *x == 0.0), "{end}");
        assert!(forces("true", end).iter().any(|x| x.abs() > 1e-3), "{end}");
    }
    assert_eq!(forces("false", "_ActiveFiberForce.sto"), forces("true", "_ActiveFiberForce.sto"));
}

/// What is said about the results is printed however much there is to say about the model.
#[test]
fn verif_remarks_about_the_model_do_not_hide_that_actuators_are_too_weak() {
    let spring = "<SpringGeneralizedForce \
                  name=\"same\"><coordinate>q1</coordinate><stiffness>0</stiffness></SpringGeneralizedForce>";
    let remarks = spring.repeat(20);
    let model = MODEL.replace("MASS", "1").replace("SCALE", "0.1").replace("APPLIES", "true");
    let model = model.replace("<ForceSet><objects>", &format!("<ForceSet><objects>{remarks}"));
    let analyses = "<AnalysisSet><objects><StaticOptimization name=\"SO\"/></objects></AnalysisSet>";
    let inner = format!("{MOTION}{analyses}");
    let folder = folder_of(&model, "AnalyzeTool", &inner);
    let mut command = assert_cmd::Command::cargo_bin("carpus").unwrap();
    let run = command.arg("run-tool").arg(folder.path().join("setup.xml")).assert().success();
    let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    let lines: Vec<&str> = said.lines().filter(|line| line.contains("cannot make the motion")).collect();
    let [line] = lines.as_slice() else { panic!("{said}") };
    assert!(line.contains("SO: at ") && line.contains(" times") && said.contains("more warnings"), "{said}");
}
