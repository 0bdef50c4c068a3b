//! Models of kinds that are rare: what OpenSim's tools write for them (`fixtures/model_kinds`).

use carpus::storage::Storage;
use carpus::tools::run_tool;

use super::references::{References, written};

/// Largest difference, relative to what is above 1. States that close loops and satisfy constraints do so to 1e-12.
const TOLERANCE: f64 = 1e-8;
/// The same of inverse dynamics, which is written with eight digits.
const OF_EIGHT_DIGITS: f64 = 2e-8;
/// The same where OpenSim's tool assembles states that satisfy constraints already: it moves them by up to 1e-9 rad,
/// which accelerations of tens of rad/s² multiply.
const REASSEMBLED: f64 = 1e-7;
/// The same where OpenSim's assembly decides on the motion: it ends where the sum of squares changes by 1e-9.
const ASSEMBLED: f64 = 1e-5;

const fn of(model: &'static [&'static str]) -> References {
    References { folder: "model_kinds", about: "models of rare kinds", files: model, partly_undefined: &[] }
}

#[test]
fn val_opensim_forces_on_speeds_that_are_not_rates() {
    let speeds = of(&["speeds.osim"]);
    speeds.compare("speeds.xml", "speeds", TOLERANCE);
    speeds.compare("speeds_inverse.xml", "speeds_inverse", OF_EIGHT_DIGITS);
}

#[test]
fn val_opensim_accelerations_with_a_negative_moment_of_inertia() {
    of(&["negative_inertia.osim"]).compare("negative_inertia.xml", "negative_inertia", TOLERANCE);
}

#[test]
fn val_opensim_loops_of_joints_are_cut() {
    let pins = of(&["loop_of_pins.osim"]);
    pins.compare("loop_of_pins.xml", "loop_of_pins", TOLERANCE);
    pins.compare("loop_of_pins_inverse.xml", "loop_of_pins_inverse", OF_EIGHT_DIGITS);
    of(&["loop_with_ball.osim"]).compare("loop_with_ball.xml", "loop_with_ball", TOLERANCE);
    of(&["loop_with_weld.osim"]).compare("loop_with_weld.xml", "loop_with_weld", TOLERANCE);
}

#[test]
fn val_opensim_forces_and_muscles_of_a_component_set() {
    let set = of(&["component_set.osim"]);
    set.compare("component_set.xml", "component_set", TOLERANCE);
    // Tools exclude only forces of the force set.
    set.compare("component_set_inverse.xml", "component_set_inverse", OF_EIGHT_DIGITS);
}

#[test]
fn val_opensim_coupler_of_two_coordinates() {
    of(&["coupler_of_two.osim"]).compare("coupler_of_two.xml", "coupler_of_two", REASSEMBLED);
}

#[test]
fn val_opensim_paths_by_functions_and_through_points_of_a_cable() {
    let paths = of(&["function_paths.osim"]);
    paths.compare("function_paths.xml", "function_paths", TOLERANCE);
    paths.compare("function_paths_inverse.xml", "function_paths_inverse", OF_EIGHT_DIGITS);
}

#[test]
fn val_opensim_coupler_by_a_formula() {
    of(&["formula_coupler.osim"]).compare("formula_coupler.xml", "formula_coupler", REASSEMBLED);
}

#[test]
fn val_opensim_assembly_moves_what_is_free_to_satisfy_constraints() {
    of(&["free_to_satisfy.osim"]).compare("free_to_satisfy.xml", "free_to_satisfy", ASSEMBLED);
}

#[test]
fn val_opensim_of_coordinates_of_equal_names_the_first_counts() {
    of(&["equal_names.osim"]).compare("equal_names.xml", "equal_names", TOLERANCE);
}

/// A file of a shared fault, by its folder.
fn shared(folder: &str, file: &str) -> std::path::PathBuf {
    crate::reference::shared(&format!("faults/{folder}/{file}"))
}

#[test]
#[cfg_attr(not(has_shared_data), ignore = "needs shared recordings and setups (CARPUS_SHARED)")]
fn val_opensim_shared_model_with_forces_on_the_speeds_of_a_ball() {
    let setup = shared("02-coordinate-speed", "id.xml");
    let ours = written(&run_tool(&setup, None, false).unwrap(), "id.sto");
    let theirs = Storage::read(setup.with_file_name("expected").join("id.sto")).unwrap();
    for (ours, theirs) in ours.rows.iter().flatten().zip(theirs.rows.iter().flatten()) {
        assert!((ours - theirs).abs() < 2e-8 * theirs.abs().max(1.0), "{ours} instead of {theirs}");
    }
}

#[test]
#[cfg_attr(not(has_shared_data), ignore = "needs shared recordings and setups (CARPUS_SHARED)")]
fn val_opensim_shared_model_with_a_component_set() {
    let folder = "bug-01-componentset-dropped-by-run-tool";
    let setup = shared(folder, "ID_setup.xml");
    let forces = written(&run_tool(&setup, None, false).unwrap(), "id.sto");
    let elbow = forces.labels.iter().position(|label| label == "elbow_flex_moment").unwrap();
    assert!((forces.rows[20][elbow] - 8.824_485_33).abs() < 1e-7);
    let setup = shared(folder, "S_setup.xml");
    let outcome = run_tool(&setup, None, false).unwrap();
    let scaled = outcome.files.iter().find(|f| f.path.ends_with("scaled.osim")).unwrap();
    let scaled = carpus::osim::OsimFile::parse(scaled.bytes.clone(), "scaled.osim").unwrap();
    let muscle = scaled.spec.muscles.iter().find(|m| m.name == "XTRA").unwrap();
    assert!((muscle.optimal_fiber_length - 0.116_024_825).abs() < 1e-8, "{}", muscle.optimal_fiber_length);
    assert!((muscle.tendon_slack_length - 0.232_049_650).abs() < 1e-8, "{}", muscle.tendon_slack_length);
}

#[test]
#[cfg_attr(not(has_shared_data), ignore = "needs shared recordings and setups (CARPUS_SHARED)")]
fn val_opensim_shared_models_that_were_refused_run() {
    for (folder, setup) in
        [("bug-13-coupler-of-two-coordinates", "A_setup.xml"), ("bug-14-closed-loop-of-joints", "ID_setup.xml")]
    {
        let setup = shared(folder, setup);
        let outcome = run_tool(&setup, None, false).unwrap_or_else(|e| panic!("{folder}: {e}"));
        let table = outcome.files.iter().find(|f| f.path.extension().is_some_and(|e| e == "sto")).unwrap();
        let table = Storage::parse(&table.bytes, &table.path).unwrap();
        assert!(table.rows.iter().flatten().all(|x| x.is_finite()), "{folder}");
    }
}

/// In forward simulations: the speeds of a ball joint are not the rates of its angles.
#[test]
fn verif_angles_of_a_ball_joint_are_held_by_constraints() {
    let path = of(&[]).path("speeds.osim");
    let text = std::fs::read_to_string(path).unwrap();
    let locked = text.replace(
        "<Coordinate name=\"y\"/>",
        "<Coordinate name=\"y\"><default_value>0.3</default_value><locked>true</locked></Coordinate>",
    );
    assert_ne!(locked, text);
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("m.osim"), locked).unwrap();
    let setup = "<OpenSimDocument Version=\"40600\"><ForwardTool \
                 name=\"run\"><model_file>m.osim</model_file><results_directory>.</results_directory>\
                 <initial_time>0</initial_time><final_time>0.2</final_time></ForwardTool></OpenSimDocument>";
    std::fs::write(folder.path().join("setup.xml"), setup).unwrap();
    let states = written(&run_tool(&folder.path().join("setup.xml"), None, false).unwrap(), "run_states.sto");
    let column = |name: &str| states.labels.iter().position(|label| label.ends_with(name)).unwrap();
    let (x, y) = (column("/x/value"), column("/y/value"));
    let last = states.rows.last().unwrap();
    assert!(states.rows.iter().all(|row| (row[y] - 0.3).abs() < 1e-6), "{last:?}");
    assert!((last[x] - states.rows[0][x]).abs() > 1e-2, "the joint moves: {last:?}");
}
