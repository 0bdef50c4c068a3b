//! Names in setups: forces that are excluded, groups of forces, names that nothing has; controllers wherever they
//! stand.

use carpus::tools::run_tool;

use super::super::reference::shared;
use super::small_model::{Folder, muscle, table, warnings};

/// Elbow moment of the first row with the model of a public bug report whose force set has a group [N·m].
fn elbow(excluded: &str, with_group: bool) -> (f64, String) {
    let source = shared("faults/bug-04-forces-to-exclude-all-drops-loads");
    let folder = tempfile::tempdir().unwrap();
    for file in ["m.mot", "l.mot", "loads.xml"] {
        std::fs::copy(source.join(file), folder.path().join(file)).unwrap();
    }
    let read = |name: &str| std::fs::read_to_string(source.join(name)).unwrap();
    let group =
        "</objects><groups><ObjectGroup name=\"grp\"><members>BIC TRI</members></ObjectGroup></groups></ForceSet>";
    let group = if with_group { group } else { "</objects></ForceSet>" };
    std::fs::write(folder.path().join("arm.osim"), read("arm.osim").replace("</objects></ForceSet>", group)).unwrap();
    let setup = read("ID_setup.xml").replace("<forces_to_exclude>All", &format!("<forces_to_exclude>{excluded}"));
    std::fs::write(folder.path().join("setup.xml"), setup).unwrap();
    let outcome = run_tool(&folder.path().join("setup.xml"), None, false).unwrap_or_else(|e| panic!("{e}"));
    let found = table(&outcome, "id.sto");
    let said = warnings(&outcome);
    let said = said.lines().filter(|line| line.starts_with("forces_to_exclude")).collect::<Vec<_>>().join("\n");
    (found.rows[0][found.find("elbow_flex_moment").unwrap()], said)
}

/// OpenSim 4.6's elbow moments without and with BIC and TRI excluded [N·m], and the difference that eight digits in a
/// file and one in a fibre's equilibrium leave.
const ELBOW: [f64; 2] = [60.418_420_96, 2.393_491_83];
const ELBOW_TOLERANCE: f64 = 1e-4;

#[test]
#[cfg_attr(not(has_shared_data), ignore = "needs shared recordings and setups (CARPUS_SHARED)")]
fn val_opensim_forces_are_excluded_by_name_or_by_group() {
    for (excluded, with_group, expected, said) in [
        ("", false, ELBOW[0], ""),
        ("BIC TRI", false, ELBOW[1], ""),
        ("grp", true, ELBOW[1], ""),
        ("muscles", true, ELBOW[1], ""),
        // With a group in the set OpenSim finds no single force, and says so as of any other name.
        ("BIC TRI", true, ELBOW[0], "force `BIC` acts: as in OpenSim 4.6 only groups are found"),
        ("grp FCR", true, ELBOW[1], "force `FCR` acts"),
        ("grp", false, ELBOW[0], "no force or group `grp`"),
        ("bic", false, ELBOW[0], "no force or group `bic`: nothing is excluded by it (did you mean `BIC`?)"),
        ("/forceset/BIC", false, ELBOW[0], "no force or group `/forceset/BIC`"),
        // External loads are no members of the force set.
        ("E1", false, ELBOW[0], "no force or group `E1`"),
    ] {
        let (found, warned) = elbow(excluded, with_group);
        assert!((found - expected).abs() < ELBOW_TOLERANCE, "{excluded} {with_group}: {found}");
        assert_eq!(warned.is_empty(), said.is_empty(), "{excluded} {with_group}: {warned}");
        assert!(warned.contains(said), "{excluded} {with_group}: {warned}");
    }
}

#[test]
fn verif_every_name_that_matches_nothing_is_said() {
    let folder = Folder::new(&muscle("Millard2012EquilibriumMuscle", "m", ""));
    let motion = "<coordinates_file>motion.mot</coordinates_file>";
    let analysis = |text: &str| format!("{motion}<AnalysisSet><objects>{text}</objects></AnalysisSet>");
    // What OpenSim leaves out is left out, and named.
    for (class, inner, said) in [
        ("InverseDynamicsTool", format!("{motion}<forces_to_exclude>mm</forces_to_exclude>"), "`mm`"),
        (
            "InverseDynamicsTool",
            format!("{motion}<joints_to_report_body_forces>elbwo</joints_to_report_body_forces>"),
            "`elbwo`",
        ),
        ("AnalyzeTool", analysis("<MuscleAnalysis><muscle_list>m mm</muscle_list></MuscleAnalysis>"), "`mm`"),
        (
            "AnalyzeTool",
            analysis("<MuscleAnalysis><moment_arm_coordinate_list>bendd</moment_arm_coordinate_list></MuscleAnalysis>"),
            "`bendd`",
        ),
        ("AnalyzeTool", analysis("<JointReaction><joint_names>elbwo</joint_names></JointReaction>"), "`elbwo`"),
    ] {
        let outcome = folder.run(class, &inner).unwrap_or_else(|e| panic!("{inner}: {e}"));
        assert!(warnings(&outcome).contains(said), "{inner}: {}", warnings(&outcome));
    }
    // What leaves nothing to be computed is an error.
    for (inner, said) in [
        ("<Kinematics><coordinates>bendd</coordinates></Kinematics>", "bendd"),
        ("<BodyKinematics><bodies>hnad</bodies></BodyKinematics>", "hnad"),
        ("<JointReaction><express_in_frame>hnad</express_in_frame></JointReaction>", "hnad"),
        ("<PointKinematics><body_name>hnad</body_name></PointKinematics>", "hnad"),
    ] {
        let error = folder.error("AnalyzeTool", &analysis(inner));
        assert!(error.contains(said), "{error}");
    }
}

/// A pendulum of 1 kg that a controlled moment of 3 N·m turns.
///
/// - `place`: the list in which the controller stands
fn pendulum(place: [&str; 2]) -> String {
    format!(
        r#"<?xml version="1.0"?><OpenSimDocument Version="40600"><Model name="pendulum"><gravity>0 -9.80665 0</gravity>
<BodySet><objects><Body name="b"><mass>1</mass><mass_center>0 -0.5 0</mass_center><inertia>0.1 0.1 0.1 0 0 0</inertia></Body></objects></BodySet>
<JointSet><objects><PinJoint name="j"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/b</socket_child_frame>
<coordinates><Coordinate name="q"/></coordinates></PinJoint></objects></JointSet>
<ForceSet><objects><CoordinateActuator name="act"><coordinate>q</coordinate><optimal_force>10</optimal_force></CoordinateActuator></objects></ForceSet>
{}<PrescribedController name="ctrl"><socket_actuators>/forceset/act</socket_actuators><FunctionSet name="ControlFunctions"><objects>
<Constant><value>0.3</value></Constant></objects></FunctionSet></PrescribedController>{}
</Model></OpenSimDocument>"#,
        place[0], place[1]
    )
}

/// Angle and speed of the pendulum after 0.5 s as OpenSim 4.6 has them with steps of 1 ms at most [rad, rad/s]. Its own
/// result with steps of any length differs by 1e-5.
const PENDULUM: [f64; 2] = [0.800_108_41, 2.283_854_27];
const PENDULUM_TOLERANCE: f64 = 2e-5;

/// States of the pendulum over 0.5 s, and what was said.
fn swing(place: [&str; 2], inner: &str) -> (carpus::storage::Storage, String, String) {
    let folder = Folder::new("");
    folder.write("small.osim", &pendulum(place));
    let inner =
        format!("<final_time>0.5</final_time><integrator_error_tolerance>1e-7</integrator_error_tolerance>{inner}");
    let outcome = folder.run("ForwardTool", &inner).unwrap_or_else(|e| panic!("{e}"));
    (table(&outcome, "_states.sto"), warnings(&outcome), outcome.summary.join("\n"))
}

#[test]
fn val_opensim_controllers_act_wherever_they_stand() {
    for place in [
        ["<ControllerSet><objects>", "</objects></ControllerSet>"],
        ["<ComponentSet><objects>", "</objects></ComponentSet>"],
        ["<components>", "</components>"],
    ] {
        let (states, said, _) = swing(place, "");
        let end = states.rows.last().unwrap();
        for (found, expected) in end.iter().zip(PENDULUM) {
            assert!((found - expected).abs() < PENDULUM_TOLERANCE, "{place:?}: {end:?} {said}");
        }
        assert!(!said.contains("Controller"), "{said}");
    }
}

#[test]
fn val_opensim_steps_are_as_long_as_the_setup_allows() {
    let place = ["<ControllerSet><objects>", "</objects></ControllerSet>"];
    let steps = |summary: &str| -> usize {
        let at = summary.find("steps: ").unwrap() + 7;
        summary[at..].split(',').next().unwrap().parse().unwrap()
    };
    // OpenSim writes each of 500 steps and the start.
    let (states, _, summary) = swing(place, "<maximum_integrator_step_size>0.001</maximum_integrator_step_size>");
    assert_eq!(states.len(), 501);
    assert!(steps(&summary) >= 500, "{summary}");
    let longest = states.time.windows(2).map(|t| t[1] - t[0]).fold(0.0, f64::max);
    assert!(longest < 0.001 + 1e-9, "{longest}");
    let end = states.rows.last().unwrap();
    assert!((end[0] - PENDULUM[0]).abs() < PENDULUM_TOLERANCE, "{end:?}");
    let (_, said, free) = swing(place, "");
    assert!(steps(&free) < 250 && !said.contains("minimum"), "{free} {said}");
    // Below the least step OpenSim goes on with a larger error; here that is said.
    let least = "<maximum_integrator_step_size>0.1</maximum_integrator_step_size>\
                 <minimum_integrator_step_size>0.05</minimum_integrator_step_size>";
    let (states, said, summary) = swing(place, least);
    // Ten of the least size, and what rounding leaves.
    assert!((5..=11).contains(&steps(&summary)), "{summary}");
    assert!(said.contains("minimum_integrator_step_size") && said.contains("larger error"), "{said}");
    assert!((states.rows.last().unwrap()[0] - PENDULUM[0]).abs() < 0.1);
}
