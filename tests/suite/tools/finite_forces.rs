//! Muscles that apply no force, and forces that are not finite or change too fast.

use super::opensim::Bench;
use super::small_model::{Folder, model, motion, muscle, setup, table, warnings};

const MILLARD: &str = "Millard2012EquilibriumMuscle";
const ANALYSES: &str = "<output_precision>12</output_precision><initial_time>0</initial_time>\
                        <final_time>0.5</final_time>\
                        <solve_for_equilibrium_for_auxiliary_states>true</solve_for_equilibrium_for_auxiliary_states>\
                        <coordinates_file>motion.mot</coordinates_file><AnalysisSet name=\"Analyses\"><objects>\
                        <MuscleAnalysis name=\"M\"/><ForceReporter name=\"F\"/></objects></AnalysisSet>";

fn idle(class: &str) -> String {
    muscle(class, "idle", "<appliesForce>false</appliesForce>")
}

/// TendonForce and moments are of what a muscle actuates, all else of its state.
#[test]
fn verif_muscles_that_apply_no_force_actuate_nothing() {
    for class in [MILLARD, "Thelen2003Muscle", "DeGrooteFregly2016Muscle", "RigidTendonMuscle"] {
        let [on, off] = ["true", "false"].map(|applies| {
            // So short that fibres are stretched: a rigid tendon without a control carries passive force alone.
            let properties =
                format!("<appliesForce>{applies}</appliesForce><tendon_slack_length>0.15</tendon_slack_length>");
            let folder = Folder::new(&(muscle(class, "m", &properties) + &muscle(MILLARD, "other", "")));
            let inner = ANALYSES.replace(
                "<solve_for_equilibrium_for_auxiliary_states>true",
                "<solve_for_equilibrium_for_auxiliary_states>false",
            );
            folder.run("AnalyzeTool", &inner).unwrap_or_else(|e| panic!("{class}: {e}"))
        });
        let column = |outcome, end: &str| -> Vec<f64> { table(outcome, end).rows.iter().map(|row| row[0]).collect() };
        for end in ["_TendonForce.sto", "_Moment_bend.sto"] {
            assert!(column(&off, end).iter().all(|x| *x == 0.0), "{class} {end}");
            assert!(column(&on, end).iter().any(|x| x.abs() > 1e-3), "{class} {end}");
        }
        for end in ["_FiberForce.sto", "_FiberLength.sto", "_MomentArm_bend.sto", "_MuscleActuatorPower.sto"] {
            assert_eq!(column(&off, end), column(&on, end), "{class} {end}");
        }
        assert_eq!(table(&off, "_forces.sto").labels, ["other"]);
    }
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_muscles_that_apply_no_force() {
    let bench = Bench::new();
    let muscles = idle(MILLARD) + &muscle(MILLARD, "other", "");
    bench.write("small.osim", &model(&muscles));
    bench.write("motion.mot", &motion());
    bench.compare("muscles without force", &bench.path("small.osim"), &setup("AnalyzeTool", ANALYSES), &|_| 1e-5);
}

/// A study cannot activate a muscle that OpenSim would leave silent.
#[test]
fn verif_an_active_muscle_that_applies_no_force_is_refused() {
    use carpus::simulation::{MusculoskeletalModel, Setup, SimulationError};
    let folder = Folder::new(&(idle(MILLARD) + &muscle(MILLARD, "other", "")));
    let spec = carpus::osim::OsimFile::read(folder.path("small.osim")).unwrap().spec;
    let compile = |muscle: &str| {
        let setup = Setup {
            coordinate: "bend".into(),
            posture: Vec::new(),
            active_muscles: vec![muscle.into()],
            parts: vec![carpus::study::MomentPart::Muscles],
            dynamometer_damping: 0.0,
            allow_unsupported: false,
        };
        MusculoskeletalModel::compile(&spec, &setup)
    };
    assert!(compile("other").is_ok());
    let error = compile("idle").unwrap_err();
    assert_eq!(error, SimulationError::AppliesNoForce { name: "idle".into() });
    assert!(error.to_string().contains("muscle `idle` applies no force in the model"), "{error}");
    assert!(error.hint().unwrap().contains("[muscles] active"));
}

/// Of an elastic tendon of no length OpenSim computes infinite forces, and all that does not depend on them.
#[test]
fn verif_a_tendon_of_no_length_does_not_cost_the_analysis() {
    let folder = Folder::new(
        &(muscle("Thelen2003Muscle", "short", "<tendon_slack_length>0</tendon_slack_length>")
            + &muscle(MILLARD, "other", "")),
    );
    let outcome = folder.run("AnalyzeTool", ANALYSES).unwrap();
    let expected = "short: its force is not finite, as in OpenSim: tendon_slack_length is 0";
    assert!(warnings(&outcome).contains(expected), "{}", warnings(&outcome));
    for (end, is_finite) in [
        ("_Length.sto", true),
        ("_PennationAngularVelocity.sto", true),
        ("_MomentArm_bend.sto", true),
        ("_FiberLength.sto", true),
        ("_TendonForce.sto", false),
    ] {
        let found = table(&outcome, end);
        assert!(found.rows.iter().all(|row| row[0].is_finite() == is_finite && row[1].is_finite()), "{end}");
    }
    assert!(table(&outcome, "_TendonForce.sto").rows.iter().all(|row| row[0] == f64::INFINITY));
    // Without it the other is the same.
    let alone = Folder::new(&muscle(MILLARD, "other", "")).run("AnalyzeTool", ANALYSES).unwrap();
    let [with, without] = [&outcome, &alone].map(|o| table(o, "_TendonForce.sto").rows);
    assert!(with.iter().zip(&without).all(|(with, without)| with[1] == without[0]));
    // Rates that are not finite cannot be integrated.
    let error = folder.error("ForwardTool", "<initial_time>0</initial_time><final_time>0.1</final_time>");
    assert!(
        error.contains("short") && error.contains("tendon_slack_length is 0, expected a number above 0"),
        "{error}"
    );
}

/// A muscle without balance is one muscle at many times; what it makes of the results is an error with muscle, pose and
/// cause.
#[test]
fn verif_a_force_that_is_not_finite_is_an_error_with_its_muscle_pose_and_cause() {
    let folder = Folder::new(
        &(muscle(MILLARD, "other", "")
            + &muscle("DeGrooteFregly2016Muscle", "long", "<tendon_slack_length>0.02</tendon_slack_length>")
                .replace("<optimal_fiber_length>0.12", "<optimal_fiber_length>0.03")),
    );
    let error = folder.error("AnalyzeTool", ANALYSES);
    let model = std::fs::read_to_string(folder.path("small.osim")).unwrap();
    let line = 1 + model.lines().position(|line| line.contains("\"long\"")).unwrap();
    assert!(error.starts_with(&format!("small.osim:{line}: long: ")), "{error}");
    for part in [
        " at t = 0 s, at bend 40.11°",
        "could not be balanced at 11 times, the first t = 0 s",
        "no fibre length balances",
    ] {
        assert!(error.contains(part), "{part}: {error}");
    }
    assert!(!error.contains("NaN"), "{error}");
}

/// A control that changes faster than any number of steps can follow ends, with the time that was reached.
#[test]
fn verif_a_simulation_ends_at_the_number_of_steps_that_the_setup_allows() {
    let motor = "<CoordinateActuator \
                 name=\"motor\"><coordinate>bend</coordinate><optimal_force>5</optimal_force></CoordinateActuator>";
    let folder = Folder::new(motor);
    let run = |omega: f64, steps: usize| {
        let control = format!(
            "<initial_time>0</initial_time><final_time>0.2</final_time>\
             <maximum_number_of_integrator_steps>{steps}</maximum_number_of_integrator_steps><ControllerSet><objects>\
             <PrescribedController name=\"c\"><actuator_list>motor</actuator_list><FunctionSet \
             name=\"ControlFunctions\"><objects><Sine name=\"s\"><amplitude>1</amplitude><omega>{omega}</omega>\
             <phase>0</phase><offset>0</offset></Sine></objects></FunctionSet></PrescribedController></objects>\
             </ControllerSet>"
        );
        folder.run("ForwardTool", &control)
    };
    run(10.0, 20_000).unwrap();
    let error = run(1e7, 300).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("300 integrator steps lead to t = ") && text.contains("only, of 0.2 s"), "{text}");
    assert!(error.hint().unwrap().contains("maximum_number_of_integrator_steps"));
}

/// The frame of a joint's load by its name, and by its path from the model, its bodies or its joints on.
#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_frames_of_joint_loads() {
    let frames =
        ["fore", "/bodyset/fore", "bodyset/fore", "/jointset/wrist/fore_wrist", "wrist/fore_wrist", "child", "/ground"];
    let analysis = |frame: &str| {
        format!(
            "<output_precision>12</output_precision><initial_time>0</initial_time><final_time>0.5</final_time>\
             <coordinates_file>motion.mot</coordinates_file><AnalysisSet name=\"Analyses\"><objects><JointReaction \
             name=\"J\"><joint_names>elbow</joint_names><apply_on_bodies>child</apply_on_bodies>\
             <express_in_frame>{frame}</express_in_frame></JointReaction></objects></AnalysisSet>"
        )
    };
    let folder = Folder::new("");
    let outcomes =
        frames.map(|frame| folder.run("AnalyzeTool", &analysis(frame)).unwrap_or_else(|e| panic!("{frame}: {e}")));
    let loads = |i: usize| table(&outcomes[i], "_ReactionLoads.sto");
    assert!((1..3).all(|i| loads(i) == loads(0)) && loads(3) == loads(4) && loads(3).rows != loads(0).rows);
    assert!(loads(3).labels[0].contains("elbow_on_fore_in_fore_wrist_fx"), "{:?}", loads(3).labels);
    let error = folder.error("AnalyzeTool", &analysis("/nowhere"));
    assert!(error.contains("express_in_frame: expected a frame"), "{error}");
    let bench = Bench::new();
    bench.write("small.osim", &model(""));
    bench.write("motion.mot", &motion());
    for frame in frames {
        bench.compare(
            "frames of joint loads",
            &bench.path("small.osim"),
            &setup("AnalyzeTool", &analysis(frame)),
            &|_| 1e-5,
        );
    }
}

/// A path that no muscle has is refused before rounding fills tables.
#[test]
fn verif_a_path_of_kilometres_is_refused() {
    use carpus::simulation::{MusculoskeletalModel, Options, Recording, Setup, SimulationError};
    let far = muscle(MILLARD, "far", "").replace("0.02 -0.02 0<", "0.02 1000 0<");
    let folder = Folder::new(&far);
    let spec = carpus::osim::OsimFile::read(folder.path("small.osim")).unwrap().spec;
    let setup = Setup {
        coordinate: "bend".into(),
        posture: Vec::new(),
        active_muscles: vec!["far".into()],
        parts: vec![carpus::study::MomentPart::Muscles],
        dynamometer_damping: 0.0,
        allow_unsupported: false,
    };
    let model = MusculoskeletalModel::compile(&spec, &setup).unwrap();
    let (time, angle, excitation) = ([0.0, 0.1, 0.2, 0.3, 0.4, 0.5], [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0.5; 6]);
    let excitation = vec![&excitation[..]];
    let recording = Recording { name: "t".into(), time: &time, angle: &angle, excitation, held: Vec::new() };
    let Err(error) = model.prepare(&recording, &Options::default()) else { panic!("a path of a kilometre") };
    assert!(matches!(&error, SimulationError::PathLength { muscle, .. } if muscle == "far"), "{error}");
    assert!(error.to_string().contains("expected a length above 0 m and below 20 m"), "{error}");
    assert!(error.hint().unwrap().contains("millimetres"));
}

/// A muscle whose path jumps at a pose that its force leads back to: no step is short enough.
#[test]
fn verif_a_path_that_jumps_is_named_where_a_simulation_ends() {
    let point = |kind: &str, name: &str, frame: &str, at: &str, more: &str| {
        format!(
            "<{kind} name=\"{name}\"><socket_parent_frame>{frame}</socket_parent_frame>\
             <location>{at}</location>{more}</{kind}>"
        )
    };
    let muscle = |name: &str, force: &str, through: &str| {
        let from = point("PathPoint", "a", "/ground", "0 0.3 0", "");
        let to = point("PathPoint", "b", "/bodyset/arm", "0.05 0 0", "");
        format!(
            "<Millard2012EquilibriumMuscle \
             name=\"{name}\"><GeometryPath><PathPointSet><objects>{from}{through}{to}</objects></PathPointSet>\
             </GeometryPath><max_isometric_force>{force}</max_isometric_force>\
             <optimal_fiber_length>0.1</optimal_fiber_length>\
             <tendon_slack_length>0.2</tendon_slack_length></Millard2012EquilibriumMuscle>"
        )
    };
    let condition = "<socket_coordinate>/jointset/pin/q</socket_coordinate><range>0.1 3</range>";
    let far = point("ConditionalPathPoint", "far", "/ground", "0.3 -0.5 0", condition);
    let model = format!(
        "<OpenSimDocument Version=\"40600\"><Model name=\"jump\"><gravity>0 0 0</gravity><BodySet><objects><Body \
         name=\"arm\"><mass>1</mass>\
         <mass_center>0.2 0 0</mass_center><inertia>0.02 0.02 0.02 0 0 \
         0</inertia></Body></objects></BodySet><JointSet><objects>\
         <PinJoint name=\"pin\"><socket_parent_frame>/ground</socket_parent_frame>\
         <socket_child_frame>/bodyset/arm</socket_child_frame>\
         <coordinates><Coordinate name=\"q\"><default_speed_value>1</default_speed_value></Coordinate></coordinates>\
         </PinJoint></objects>\
         </JointSet>\
         <ForceSet><objects>{}{}</objects></ForceSet></Model></OpenSimDocument>",
        muscle("steady", "20", ""),
        muscle("jumper", "50000", &far)
    );
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("m.osim"), model).unwrap();
    let setup = "<OpenSimDocument Version=\"40600\"><ForwardTool \
                 name=\"x\"><model_file>m.osim</model_file><results_directory>o</results_directory>\
                 <initial_time>0</initial_time><final_time>0.5</final_time>\
                 <minimum_integrator_step_size>1e-8</minimum_integrator_step_size>\
                 <solve_for_equilibrium_for_auxiliary_states>true</solve_for_equilibrium_for_auxiliary_states>\
                 </ForwardTool></OpenSimDocument>";
    std::fs::write(folder.path().join("setup.xml"), setup).unwrap();
    let error = carpus::tools::run_tool(&folder.path().join("setup.xml"), None, false).unwrap_err().to_string();
    assert!(error.contains("the length of muscle `jumper` jumps by 1.119 m"), "{error}");
}
