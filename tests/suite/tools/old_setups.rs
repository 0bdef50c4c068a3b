//! Setup files of formats before 10904 and 20300, and with `<defaults>` (`fixtures/old_setups`).

use carpus::tools::{Outcome, run_tool};

use super::references::{References, written};

const OLD_SETUPS: References = References {
    folder: "old_setups",
    about: "setup files of old",
    files: &["arm.osim", "extra_actuator.xml"],
    partly_undefined: &[],
};

/// A file without `<OpenSimDocument>`, with a `controls_file`, corrective springs and `actuator_set_files`.
#[test]
fn val_opensim_forward_with_a_controls_file_and_corrective_springs() {
    OLD_SETUPS.compare_forward("forward", &[], 1e-7);
}

#[test]
fn val_opensim_analysis_with_a_controls_file() {
    OLD_SETUPS.compare("analyze.xml", "analyze", 1e-12);
}

/// They hold for what the model and the setup leave open.
#[test]
fn val_opensim_defaults_of_a_setup_hold_for_the_model() {
    OLD_SETUPS.compare("defaults.xml", "defaults", 1e-12);
}

/// OpenSim stops at an accuracy of 1e-12.
#[test]
fn val_opensim_inverse_kinematics_with_trials() {
    OLD_SETUPS.compare("inverse_kinematics.xml", "inverse_kinematics", 1e-7);
    OLD_SETUPS.compare("inverse_kinematics_20201.xml", "inverse_kinematics_20201", 1e-7);
}

/// The setup in a folder with all that it reads, after a change of its text.
fn changed(setup: &str, from: &str, to: &str) -> Outcome {
    let folder = tempfile::tempdir().unwrap();
    for name in ["arm.osim", "controls.xml", "extra_actuator.xml", "states.sto", "markers.trc"] {
        std::fs::copy(OLD_SETUPS.path(name), folder.path().join(name)).unwrap();
    }
    let text = std::fs::read_to_string(OLD_SETUPS.path(setup)).unwrap();
    assert!(text.contains(from), "{setup} has {from}");
    let setup = folder.path().join(setup);
    std::fs::write(&setup, text.replace(from, to)).unwrap();
    run_tool(&setup, None, false).unwrap_or_else(|e| panic!("{e}"))
}

fn warnings(outcome: &Outcome) -> Vec<(usize, &str)> {
    outcome.warnings.iter().map(|(_, line, text)| (*line, text.as_str())).collect()
}

/// From format 10904 on a tool has no `controls_file`: it is named, and nothing is controlled.
#[test]
fn verif_present_setups_have_no_controls_file() {
    let outcome = changed("analyze.xml", "\"10903\"", "\"10904\"");
    let found = warnings(&outcome);
    assert!(found.iter().any(|(_, text)| text.contains("controls_file is not used")), "{found:?}");
    assert!(written(&outcome, "run_Actuation_force.sto").rows.iter().flatten().all(|force| *force == 0.0));
}

/// The first counts, and the second is not called unknown.
#[test]
fn verif_a_property_that_stands_twice_is_named() {
    let outcome = changed("analyze.xml", "<final_time>", "<final_time>0.1</final_time><final_time>");
    let found = warnings(&outcome);
    let text = "<final_time> stands here again and was not used: the first counts, as in OpenSim";
    assert!(found.iter().any(|(_, found)| *found == text), "{found:?}");
    assert!((written(&outcome, "run_Actuation_force.sto").time.last().unwrap() - 0.1).abs() < 1e-9);
}

/// The last control is none of the model, so that OpenSim connects the first two only.
#[test]
fn verif_a_control_that_opensim_does_not_connect_is_named() {
    let outcome = changed("analyze.xml", "<final_time>0.15<", "<final_time>0.1<");
    let found = warnings(&outcome);
    assert!(found.iter().any(|(line, text)| *line == 22 && text.contains("motor2 is left out")), "{found:?}");
}

/// Lines of messages are those of the file, though properties have moved; a trial that OpenSim does not run either is
/// named.
#[test]
fn verif_moved_properties_keep_their_lines() {
    let outcome = changed("inverse_kinematics.xml", "<time_range>", "<frames>7</frames><time_range>");
    let text = std::fs::read_to_string(OLD_SETUPS.path("inverse_kinematics.xml")).unwrap();
    let line = |what: &str| 1 + text.lines().position(|line| line.contains(what)).unwrap();
    let expected = [
        (line("<time_range>"), "<frames> is no property of IKTool and was not used"),
        (line("never run"), "<IKTrial> is no property of IKTool and was not used"),
    ];
    assert_eq!(warnings(&outcome), expected);
}
