//! Models with paths by functions, with cables, and with loops that constraints close, as users meet them.

use super::*;
use carpus::effects::forward_model::ForwardModel;
use carpus::effects::silent_muscles::SilentMuscles;
use carpus::osim::OsimFile;
use carpus::scaling::strength_scale;
use carpus::simulation::{MusculoskeletalModel, Options, PreparedTrial, Recording, Setup, SimulationError};
use carpus::study::{Study, Trial};

fn other(name: &str) -> PathBuf {
    root("fixtures/other_paths").join(format!("{name}.osim"))
}

fn info(model: &Path) -> serde_json::Value {
    let output = carpus().arg("info").arg(model).arg("--json").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The bundled wrist in which FCR has a cable through or over these elements.
fn with_cable(folder: &Path, elements: &str) -> PathBuf {
    let text = std::fs::read_to_string(model()).unwrap();
    let fcr = text.find("<Millard2012EquilibriumMuscle name=\"FCR\">").unwrap();
    let start = fcr + text[fcr..].find("<GeometryPath").unwrap();
    let end = start + text[start..].find("</GeometryPath>").unwrap() + "</GeometryPath>".len();
    let path = format!(
        "<Scholz2015GeometryPath name=\"path\"><path_elements>{elements}</path_elements></Scholz2015GeometryPath>"
    );
    let file = folder.join("cable.osim");
    std::fs::write(&file, format!("{}{path}{}", &text[..start], &text[end..])).unwrap();
    file
}

fn cable_point(name: &str, frame: &str, at: &str) -> String {
    format!(
        "<Scholz2015GeometryPathPoint name=\"{name}\"><PathPoint name=\"point\"><socket_parent_frame>{frame}\
         </socket_parent_frame><location>{at}</location></PathPoint></Scholz2015GeometryPathPoint>"
    )
}

const OBSTACLE: &str = "<Scholz2015GeometryPathObstacle name=\"o\"><contact_hint>0 0.01 0</contact_hint>\
                        <socket_contact_geometry>/contactgeometryset/c</socket_contact_geometry>\
                        </Scholz2015GeometryPathObstacle>";

#[test]
fn verif_info_says_what_a_study_can_use() {
    let shown = carpus().arg("info").arg(model()).assert().success();
    shown.stdout(
        contains("in a study:\n  5 muscles can be active: ECRL").and(contains("moved by the dynamometer: elbow")),
    );
    let found = info(&other("functions"));
    assert_eq!(found["study"]["muscles"].as_array().unwrap().len(), 5);
    assert!(found["muscles"].as_array().unwrap().iter().all(|m| m["path"] == "FunctionBasedPath"));
    assert_eq!(info(&other("strut"))["study"]["constraints"], serde_json::json!(["tip_on_hand"]));

    let folder = tempfile::tempdir().unwrap();
    let ends = |middle: &str| {
        let (from, to) = ("/bodyset/humerus", "/bodyset/hand");
        cable_point("a", from, "0 -0.25 0.03") + middle + &cable_point("b", to, "0.01 -0.03 0.01")
    };
    let through = info(&with_cable(folder.path(), &ends("")));
    assert!(through["study"]["muscles"].to_string().contains("FCR"), "{}", through["study"]);
    let over = info(&with_cable(folder.path(), &ends(OBSTACLE)));
    assert_eq!(over["study"]["muscles_not"][0]["name"], "FCR", "{}", over["study"]);
    let items = over["diagnostics"]["items"].to_string();
    assert!(items.contains("Scholz2015GeometryPath over obstacles: neither path nor force is computed"), "{items}");
}

/// The bundled study on another model; with the posture of the study.
fn on(model: &Path) -> StudyCopy {
    let study = StudyCopy::new();
    std::fs::copy(model, study.path("wrist.osim")).unwrap();
    study
}

#[test]
fn verif_studies_take_paths_by_functions_and_closed_loops() {
    for name in ["functions", "rod", "welded_strut"] {
        let study = on(&other(name));
        study.run("compare").success().stdout(contains("held out"));
        let results: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(study.path("out/P01/results.json")).unwrap()).unwrap();
        assert_eq!(results["trials"].as_array().unwrap().len(), 2, "{name}");
    }
}

#[test]
fn verif_loops_that_do_not_close_are_explained() {
    let text = std::fs::read_to_string(other("strut")).unwrap();
    // Nothing holds the other end of the strut in one direction.
    let edited = |change: &dyn Fn(&str) -> String| {
        let study = StudyCopy::new();
        let changed = change(&text);
        assert_ne!(changed, text);
        std::fs::write(study.path("wrist.osim"), changed).unwrap();
        study
    };
    let point = text.find("<PointConstraint").unwrap();
    let end = point + text[point..].find("</PointConstraint>").unwrap() + "</PointConstraint>".len();
    let rod = "<ConstantDistanceConstraint name=\"rod\"><socket_body_1>/bodyset/strut</socket_body_1><socket_body_2>\
               /bodyset/hand</socket_body_2><location_body_1>0 0 -0.02</location_body_1><location_body_2>0 -0.05 -0.02\
               </location_body_2><constant_distance>0.06</constant_distance></ConstantDistanceConstraint>";
    let free = edited(&|text| format!("{}{rod}{}", &text[..point], &text[end..]));
    free.refused("wrist.osim", &["do not determine the coordinates of their loops: ", "strut_1", "[posture_deg]"]);
    let far = edited(&|text| {
        let from = point + text[point..].find("<location_body_1>").unwrap();
        let to = from + text[from..].find("</location_body_1>").unwrap();
        format!("{}<location_body_1>0 0 -3{}", &text[..from], &text[to..])
    });
    far.refused("wrist.osim", &["does not satisfy the model's constraints tip_on_hand (PointConstraint)"]);
    // A rod that reaches the hand over a part of the trials' angles only.
    let long = StudyCopy::new();
    let text = std::fs::read_to_string(other("rod")).unwrap();
    let from = text.find("<constant_distance>").unwrap();
    let to = from + text[from..].find("</constant_distance>").unwrap();
    let changed = format!("{}<constant_distance>0.09{}", &text[..from], &text[to..]);
    std::fs::write(long.path("wrist.osim"), changed).unwrap();
    long.refused(
        "wrist.osim",
        &["rod (ConstantDistanceConstraint) hold for `flexion` from -0.", "the trials need -0."],
    );
}

/// A model of these fixtures after a change of its text.
fn read_changed(name: &str, change: &dyn Fn(&str) -> String) -> OsimFile {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("changed.osim");
    std::fs::write(&file, change(&std::fs::read_to_string(other(name)).unwrap())).unwrap();
    OsimFile::read(&file).unwrap()
}

/// The coordinate of the wrist's flexion with another range [rad].
fn with_range(text: &str, range: &str) -> String {
    let own = "<range>-1.2217304763960306 1.2217304763960306</range>";
    assert_eq!(text.matches(own).count(), 1);
    text.replace(own, &format!("<range>{range}</range>"))
}

/// The bundled study and one of its trials, from -35° to 35°.
fn demo() -> (Study, Trial) {
    let study = Study::read_tables(root("fixtures/demo_study")).unwrap();
    let trial = study.load_trials("P01").unwrap().into_iter().find(|t| t.info.file_as_written == TRAIN).unwrap();
    (study, trial)
}

#[test]
fn verif_loops_close_as_far_as_trials_are_varied() {
    let (study, mut trial) = demo();
    let mut setup = Setup::from_settings(&study.settings);
    assert_eq!(setup.active_muscles.pop().as_deref(), Some("FCU"));
    trial.excitation.pop();
    for name in ["rod", "strut", "welded_strut"] {
        let file = read_changed(name, &|text| with_range(text, "-0.62 0.62"));
        let model = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
        let forward = ForwardModel::new(&file.spec, &model, std::slice::from_ref(&trial));
        assert!(forward.is_ok(), "{name}: {:?}", forward.err());
        let recording = [Recording::from(&trial)];
        let prepared = model.prepare_all_with_margin(&recording, &Options::default()).unwrap();
        let silent = SilentMuscles::of_trials(&file.spec, &model, &recording, &prepared).unwrap();
        // What a muscle over a strut does at the wrist is compared with OpenSim elsewhere.
        if name == "rod" {
            assert_eq!(silent[0].names, ["FCU"]);
        }
    }
}

#[test]
fn verif_trials_near_where_a_loop_ends_are_simulated_and_those_beyond_are_refused() {
    let (study, mut trial) = demo();
    // Reaches the hand over a part of the range only, where the wrist deviates farther than muscles do.
    let file = read_changed("rod", &|text| {
        let from = text.find("<constant_distance>").unwrap();
        let to = from + text[from..].find("</constant_distance>").unwrap();
        format!("{}<constant_distance>0.09{}", &text[..from], &text[to..])
    });
    let setup = Setup { active_muscles: Vec::new(), ..Setup::from_settings(&study.settings) };
    trial.excitation.clear();
    let model = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
    let [least, most] = model.closed_range().unwrap();
    assert!(least < -0.5 && (-0.1..0.3).contains(&most), "{least} to {most}");
    let recorded = trial.angle.clone();
    let mut up_to = |highest: f64| {
        trial.angle = recorded.iter().map(|angle| highest - 0.1 + 0.1 * angle / 0.62).collect();
        let recording = [Recording::from(&trial)];
        let options = Options::default();
        let moments = |prepared: Result<Vec<PreparedTrial>, SimulationError>| {
            Ok::<_, SimulationError>(prepared?[0].simulate(&model.nominal_parameters())?.moment)
        };
        let alone = moments(model.prepare_all(&recording, &options));
        let varied = moments(model.prepare_all_with_margin(&recording, &options));
        (alone, varied)
    };
    let (alone, varied) = up_to(most - 0.05);
    let (alone, varied) = (alone.unwrap(), varied.unwrap());
    assert!(alone.iter().any(|moment| moment.abs() > 1e-3), "{alone:?}");
    for (a, b) in alone.iter().zip(&varied) {
        assert!((a - b).abs() < 1e-3, "{a} {b}");
    }
    let (alone, varied) = up_to(most + 0.1);
    assert!(matches!(alone, Err(SimulationError::LoopOpen { .. })), "{alone:?}");
    assert!(matches!(varied, Err(SimulationError::LoopOpen { .. })), "{varied:?}");
}

#[test]
fn verif_loops_close_over_any_range_of_the_coordinate() {
    let (study, _) = demo();
    let setup = Setup::from_settings(&study.settings);
    // A single value, and a range without the default.
    for (range, value) in [("0 0", 0.0), ("0.1 0.6", 0.3)] {
        let file = read_changed("rod", &|text| with_range(text, range));
        let model = MusculoskeletalModel::compile(&file.spec, &setup).unwrap_or_else(|e| panic!("{range}: {e}"));
        let [least, most] = model.closed_range().unwrap();
        assert!(least < value && value < most && most - least < 2.0, "{range}: {least} to {most}");
    }
}

#[test]
fn verif_a_trial_cannot_open_a_loop_by_its_posture() {
    let held = |coordinate: &str, value: &str| {
        let study = on(&other("rod"));
        study.edit("trials.csv", |text| {
            let more = |(i, line): (usize, &str)| match i {
                0 => format!("{line},posture_{coordinate}_deg\n"),
                _ if line.contains(TRAIN) => format!("{line},{value}\n"),
                _ => format!("{line},\n"),
            };
            text.lines().enumerate().map(more).collect()
        });
        study
    };
    let says = ["`deviation` belongs to a loop", "rod (ConstantDistanceConstraint)", "hint", "[posture_deg]"];
    held("deviation", "5").refused("trials.csv", &says);
    held("elbow_flexion", "60").run("compare").success();
}

#[test]
fn verif_strength_is_scaled_along_closed_loops() {
    let (study, _) = demo();
    let mut file = read_changed("rod", &str::to_owned);
    let setup = Setup::from_settings(&study.settings);
    let closed = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
    let open = OsimFile::read(model()).unwrap();
    let open = MusculoskeletalModel::compile(&open.spec, &setup).unwrap();
    let scaling = strength_scale(&mut file, &study, &study.participants[0]).unwrap();
    let mut farthest: f64 = 0.0;
    for group in &scaling.groups {
        let arms = |model: &MusculoskeletalModel, name: &str| {
            let i = model.muscle_names().position(|n| n == name).unwrap();
            model.moment_arms_about("flexion", &[], &[group.angle]).unwrap()[i][0]
        };
        for muscle in &group.muscles {
            let expected = arms(&closed, &muscle.name);
            assert!((muscle.moment_arm - expected).abs() < 1e-7, "{}: {expected}", muscle.name);
            farthest = farthest.max((expected - arms(&open, &muscle.name)).abs());
        }
    }
    assert!(farthest > 1e-5, "{farthest}");
}

#[test]
fn verif_info_and_audit_say_what_does_not_move() {
    let folder = tempfile::tempdir().unwrap();
    let locked = folder.path().join("locked.osim");
    let text = std::fs::read_to_string(model()).unwrap();
    std::fs::write(&locked, text.replacen("<locked>false</locked>", "<locked>true</locked>", 1)).unwrap();
    let coordinates = |file: &Path| info(file)["study"]["coordinates"].as_array().unwrap().len();
    assert_eq!(coordinates(&locked) + 1, coordinates(&model()));
    let audited = carpus().arg("audit").arg(other("rod")).assert();
    audited.stderr(contains("constraints do not hold here").and(contains("rod")));
}

#[test]
fn verif_an_active_muscle_without_a_path_that_is_computed_is_named() {
    let study = StudyCopy::new();
    let cable = with_cable(study.folder.path(), &(cable_point("a", "/bodyset/humerus", "0 -0.2 0") + OBSTACLE));
    std::fs::copy(cable, study.path("wrist.osim")).unwrap();
    study.refused("wrist.osim", &["FCR", "Scholz2015GeometryPath over obstacles", "leave it out of [muscles] active"]);
    // A muscle that is not active is not needed.
    study.edit("study.toml", |text| {
        let text = text.replacen("\"ECU\", \"FCR\", \"FCU\"", "\"ECU\", \"FCU\"", 1);
        text.replacen("[emg]\n", "[columns]\nignore = [\"emg_FCR\"]\n[emg]\n", 1)
    });
    study.run("compare").success();
}

#[test]
fn verif_bad_paths_by_functions_are_explained() {
    let refused = |change: &dyn Fn(&str) -> String, says: &str| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("spoilt.osim");
        let text = std::fs::read_to_string(other("formula")).unwrap();
        let changed = change(&text);
        assert_ne!(changed, text);
        std::fs::write(&file, changed).unwrap();
        let failed = carpus().args(["paths", "--sweep", "flexion=0:10:5deg"]).arg(&file).assert().code(1);
        let said = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        assert!(said.contains(says) && said.contains("spoilt.osim") && !said.contains("panicked"), "{says}: {said}");
    };
    refused(&|text| text.replace("/jointset/wrist/flexion /jointset", "/jointset/wrist/flexoin /jointset"), "flexoin");
    refused(&|text| text.replacen("cos(f)", "cosine(f)", 1), "no function \"cosine\"");
    refused(&|text| text.replacen("<variables>f d</variables>", "<variables>f</variables>", 1), "no variable \"d\"");
    refused(
        &|text| text.replacen("/jointset/wrist/flexion /jointset/wrist/deviation", "/jointset/wrist/flexion", 1),
        "expected a function of 1 variables, found one of 2",
    );
    refused(
        &|text| text.replacen("<length_function>", "<length>", 1).replacen("</length_function>", "</length>", 1),
        "length_function",
    );
}
