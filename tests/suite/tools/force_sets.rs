//! Forces of files that a setup adds to its model (`force_set_files`), and a `CorrectionController`
//! (`fixtures/force_sets`).

use std::path::{Path, PathBuf};

use carpus::osim::spec::ForceKind;
use carpus::osim::{Document, OsimFile};
use carpus::storage::Storage;
use carpus::tools::{Outcome, ToolError, run_tool};

use super::references::{References, written};

const FORCE_SETS: References = References {
    folder: "force_sets",
    about: "forces of files added to a model",
    files: &["../components/forces.osim", "forces.xml", "wrist_forces.xml"],
    partly_undefined: &[],
};

/// Forces of every class, `<defaults>` of their file, a file of format 10904 with its classes and properties of old,
/// and two names that are taken already.
#[test]
fn val_opensim_forces_of_files_behind_those_of_the_model() {
    FORCE_SETS.compare("added.xml", "added", 1e-9);
}

#[test]
fn val_opensim_forces_of_a_file_instead_of_those_of_the_model() {
    FORCE_SETS.compare("replaced.xml", "replaced", 1e-9);
}

/// OpenSim's optimizer stops at a convergence criterion of 1e-8.
#[test]
fn val_opensim_static_optimization_with_forces_of_a_file() {
    FORCE_SETS.compare("optimized.xml", "optimized", 1e-6);
}

#[test]
fn val_opensim_forward_with_forces_of_files() {
    FORCE_SETS.compare_forward("forward", &[], 1e-5);
}

#[test]
fn val_opensim_correction_controller() {
    FORCE_SETS.compare_forward("correction", &["ForceReporter_forces"], 1e-6);
}

/// Controls of the file that OpenSim writes stand in the same order; it lacks the labels of the first ones.
#[test]
fn verif_controls_of_a_correction_controller_are_what_it_adds() {
    let outcome = run_tool(&FORCE_SETS.path("correction.xml"), None, false).unwrap_or_else(|e| panic!("{e}"));
    let (controls, states) = (written(&outcome, "run_controls.sto"), written(&outcome, "run_states.sto"));
    assert_eq!(controls.labels[..5], ["q1_corrector", "q2_corrector", "q3_corrector", "s_corrector", "smooth"]);
    let desired = Storage::read(FORCE_SETS.path("desired.sto")).unwrap();
    for (k, time) in controls.time.iter().enumerate() {
        let (wanted, state) = (desired.at(*time), &states.rows[k]);
        for i in 0..4 {
            let expected = 16.0 * (wanted[2 * i] - state[2 * i]) + 8.0 * (wanted[2 * i + 1] - state[2 * i + 1]);
            assert!((controls.rows[k][i] - expected).abs() < 1e-11 * expected.abs().max(1.0), "row {k}, {i}");
        }
    }
    let second = outcome.warnings.iter().any(|(_, _, text)| text.contains("second does nothing, as in OpenSim"));
    assert!(second, "{:?}", outcome.warnings);
}

/// The model, forces and setup of `forward.xml` or `correction.xml` in a folder, after a change of the text of a file.
fn changed(setup: &str, file: &str, from: &str, to: &str) -> Result<Outcome, ToolError> {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("fixtures/force_sets");
    std::fs::create_dir_all(&place).unwrap();
    std::fs::create_dir(folder.path().join("fixtures/components")).unwrap();
    for name in ["../components/forces.osim", "forces.xml", "old_forces.xml", "start.sto", "desired.sto", setup] {
        let text = std::fs::read_to_string(FORCE_SETS.path(name)).unwrap();
        assert!(name != file || text.contains(from), "{name} has {from}");
        let text = if name == file { text.replacen(from, to, 1) } else { text };
        std::fs::write(place.join(name), text).unwrap();
    }
    run_tool(&place.join(setup), None, false)
}

fn refusal(setup: &str, file: &str, from: &str, to: &str) -> String {
    match changed(setup, file, from, to) {
        Ok(_) => panic!("{file} with {to} is taken"),
        Err(error) => format!("{error} | {}", error.hint().unwrap_or_default()),
    }
}

#[test]
fn verif_faults_of_files_of_forces_are_told_with_their_file_and_line() {
    for (file, from, to, expected) in [
        (
            "forces.xml",
            "<coordinate>q2<",
            "<coordinate>qq<",
            "forces.xml:234: /forceset/coil: coordinate: no coordinate named \"qq\"",
        ),
        (
            "old_forces.xml",
            "<body_1>upper<",
            "<body_1>uper<",
            "no body named \"uper\" in this model | did you mean \"upper\"?",
        ),
        ("forces.xml", "<expression>-0.8*q", "<expression>-0.8*(q", "forces.xml:246: /forceset/formula: expression"),
        (
            "forces.xml",
            "<stiffness>70<",
            "<stiffness>seventy<",
            "/forceset/band: stiffness: expected a number, found \"seventy\"",
        ),
        (
            "forces.xml",
            "Version=\"40000\"",
            "Version=\"50000\"",
            "forces.xml:3: file format version 50000 is not supported",
        ),
        ("forces.xml", "<ForceSet name=\"added\">", "<ForceSet name=\"added\"><objects>", "forces.xml:"),
        (
            "forward.xml",
            "forces.xml old_forces.xml",
            "../components/forces.osim",
            "not a set of forces: expected <ForceSet>, found <Model> | force_set_files",
        ),
        ("forward.xml", "forces.xml old_forces.xml", "gone.xml", "gone.xml: cannot be read"),
        (
            "forces.xml",
            "<BushingForce name=\"pad\">",
            "<HuntCrossleyForce name=\"contact\"/><BushingForce name=\"pad\">",
            "forces that are not computed: contact (HuntCrossleyForce)",
        ),
        ("forward.xml", "<replace_force_set>false<", "<replace_force_set>true<", "the model has no actuator `smooth`"),
        (
            "forward.xml",
            "<final_time>0.15<",
            "<final_time>1e300<",
            "a time at most 10000 s after initial_time, found \"1e300\"",
        ),
    ] {
        let error = refusal("forward.xml", file, from, to);
        assert!(error.contains(expected), "expected {expected}\n   found {error}");
    }
}

#[test]
fn verif_where_a_correction_controller_cannot_act_is_told() {
    let controller = "<CorrectionController name=\"c\"><kp>1</kp></CorrectionController>";
    let in_model = format!("<ControllerSet>\n<objects>\n{controller}");
    let model = "../components/forces.osim";
    let text = std::fs::read_to_string(FORCE_SETS.path(model)).unwrap();
    let set = &text[text.find("<ControllerSet>").unwrap()..];
    let set = &set[..set.find("<objects>").unwrap() + "<objects>".len()];
    let elsewhere = "CorrectionController is not supported: OpenSim 4.6 runs it only in the <ControllerSet> of a \
                     ForwardTool's setup";
    for (file, from, to, expected) in [
        (model, set, in_model.as_str(), elsewhere),
        (
            "correction.xml",
            "<states_file>desired.sto</states_file>",
            "",
            "states_file is missing: expected the states that a CorrectionController follows",
        ),
        ("correction.xml", "<kp>16<", "<kp>high<", "kp: expected a number, found \"high\""),
        ("old_forces.xml", "name=\"old_general\"", "name=\"s_corrector\"", "makes an actuator `s_corrector`"),
    ] {
        let error = refusal("correction.xml", file, from, to);
        assert!(error.contains(expected), "expected {expected}\n   found {error}");
    }
    let analyze = std::fs::read_to_string(FORCE_SETS.path("replaced.xml")).unwrap();
    let analyze = analyze.replace(
        "</AnalyzeTool>",
        &format!("<ControllerSet><objects>{controller}</objects></ControllerSet></AnalyzeTool>"),
    );
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (from, to) in [
        ("fixtures/force_sets/wrist_forces.xml", "wrist_forces.xml"),
        ("fixtures/force_sets/wrist_states.sto", "wrist_states.sto"),
    ] {
        std::fs::copy(root.join(from), folder.path().join(to)).unwrap();
    }
    let setup = folder.path().join("setup.xml");
    std::fs::write(&setup, analyze).unwrap();
    let error = run_tool(&setup, Some(&root.join("models/wrist.osim")), false).unwrap_err().to_string();
    assert!(error.contains(elsewhere), "{error}");
}

/// One that is not enabled leaves the motion alone, and reports forces of 0.
#[test]
fn verif_a_correction_controller_that_is_not_enabled_does_nothing() {
    let outcome = changed("correction.xml", "correction.xml", "<kp>16<", "<enabled>false</enabled><kp>16<").unwrap();
    let forces = written(&outcome, "run_ForceReporter_forces.sto");
    assert_eq!(forces.labels[3], "s_corrector");
    assert!(forces.rows.iter().all(|row| row[..4] == [0.0; 4]));
}

/// The model's own file is not touched, and its forces keep their places.
#[test]
fn verif_added_forces_are_told_apart_by_their_source() {
    let path = |name: &str| -> PathBuf { FORCE_SETS.path(name) };
    let file = OsimFile::read(path("../components/forces.osim")).unwrap();
    let documents = ["forces.xml", "old_forces.xml"].map(|name| Document::read(path(name)).unwrap());
    let (spec, diagnostics) = file.with_force_sets(&documents, false).unwrap();
    let sources = |source: usize| {
        let muscles = spec.muscles.iter().map(|m| &m.at);
        muscles.chain(spec.forces.iter().map(|f| &f.at)).filter(|at| at.source == source).count()
    };
    assert_eq!([sources(0), sources(1), sources(2)], [file.spec.muscles.len() + file.spec.forces.len(), 21, 9]);
    assert_eq!(diagnostics.len(), 2);
    let (only, _) = file.with_force_sets(&documents, true).unwrap();
    assert_eq!(only.muscles.len() + only.forces.len(), 22 + 9, "without the model's forces one name is free");
    assert!(only.muscles.iter().all(|m| m.at.source > 0));
}

/// As in OpenSim 4.6, which keeps them from file to file: a default of the model, and one of a file that the next one's
/// default of the same class changes in another property.
#[test]
fn verif_defaults_hold_for_the_files_behind() {
    let model = std::fs::read_to_string(FORCE_SETS.path("../components/forces.osim")).unwrap();
    let spring = "<SpringGeneralizedForce name=\"default\">\n<stiffness>123</stiffness>\n</SpringGeneralizedForce>";
    let model = model.replacen("<gravity>", &format!("<defaults>{spring}</defaults><gravity>"), 1);
    let file = OsimFile::parse(model, "model.osim").unwrap();
    let document = |inner: &str| {
        let text = format!("<OpenSimDocument Version=\"40000\">\n<ForceSet>{inner}</ForceSet></OpenSimDocument>");
        Document::parse(text.into_bytes(), "forces.xml").unwrap()
    };
    let actuator = |class: &str, name: &str| format!("<{class} name=\"{name}\"><coordinate>q2</coordinate></{class}>");
    let default = |class: &str, property: &str| format!("<defaults><{class}>\n{property}</{class}></defaults>");
    let documents = [
        default("CoordinateActuator", "<optimal_force>6</optimal_force>") + "<objects/>",
        default("CoordinateActuator", "<max_control>0.7</max_control>")
            + &format!("<objects>{}</objects>", actuator("GeneralizedForce", "a")),
        default("GeneralizedForce", "<optimal_force>9</optimal_force>")
            + &format!(
                "<objects>{}{}</objects>",
                actuator("CoordinateActuator", "b"),
                actuator("GeneralizedForce", "c")
            ),
        "<defaults/><objects><SpringGeneralizedForce \
         name=\"d\"><coordinate>q1</coordinate></SpringGeneralizedForce></objects>"
            .to_owned(),
    ];
    let (spec, _) = file.with_force_sets(&documents.map(|text| document(&text)), false).unwrap();
    let kind = |name: &str| &spec.forces.iter().find(|force| force.name == name).unwrap().kind;
    for name in ["a", "b", "c"] {
        let ForceKind::Actuator(actuator) = kind(name) else { panic!("{:?}", kind(name)) };
        assert_eq!((actuator.optimal_force, actuator.max_control), (6.0, 0.7), "{name}");
    }
    assert!(matches!(kind("d"), ForceKind::SpringGeneralized { stiffness: 123.0, .. }), "{:?}", kind("d"));
    let at = &spec.forces.iter().find(|force| force.name == "a").unwrap().at;
    assert_eq!((at.source, at.line), (2, 3), "lines stay");
}

/// As OpenSim 4.6 reads four such files one after the other: what an old file says is understood by its own format.
#[test]
fn verif_defaults_of_old_files_hold_under_todays_names() {
    let file = OsimFile::read(FORCE_SETS.path("../components/forces.osim")).unwrap();
    let document = |(i, (version, defaults)): (usize, (u32, &str))| {
        let point = |name: &str, y: f64| {
            let parent = "<socket_parent_frame>/bodyset/upper</socket_parent_frame>";
            format!("<PathPoint name=\"{name}\"><body>upper</body>{parent}<location>0 {y} 0</location></PathPoint>")
        };
        let points = format!("<PathPointSet><objects>{}{}</objects></PathPointSet>", point("a", 0.0), point("b", 0.3));
        let text = format!(
            "<OpenSimDocument Version=\"{version}\"><ForceSet><defaults><Thelen2003Muscle>{defaults}</Thelen2003Muscle>\
             </defaults><objects><Thelen2003Muscle \
             name=\"m{i}\"><GeometryPath>{points}</GeometryPath></Thelen2003Muscle>\
             </objects></ForceSet></OpenSimDocument>"
        );
        Document::parse(text.into_bytes(), "forces.xml").unwrap()
    };
    let old = "<isDisabled>true</isDisabled><pennation_angle>0.3</pennation_angle><min_control>0</min_control>\
               <max_control>0.8</max_control>";
    let documents: Vec<_> = [
        (20300, old),
        (40000, ""),
        (40000, "<appliesForce>true</appliesForce>"),
        (20300, "<pennation_angle>0.1</pennation_angle>"),
    ]
    .into_iter()
    .enumerate()
    .map(document)
    .collect();
    let (spec, _) = file.with_force_sets(&documents, true).unwrap();
    let read = |name: &str| {
        let m = spec.muscles.iter().find(|muscle| muscle.name == name).unwrap();
        (m.applies_force, m.pennation_angle_at_optimal, m.min_control, m.max_control)
    };
    assert_eq!(read("m0"), (false, 0.3, 0.01, 0.8));
    assert_eq!(read("m1"), (false, 0.3, 0.01, 0.8));
    assert_eq!(read("m2"), (true, 0.3, 0.01, 0.8));
    assert_eq!(read("m3"), (true, 0.1, 0.01, 0.8));
}
