//! The program as a user runs it against OpenSim: `carpus equilibrium --json` at random postures, for models as they
//! are, and for models whose muscles Carpus has changed and written.

use super::{Differences, Judge, Row};
use crate::reference::{lab_models, opensim_python, run_script, shared_if_here, stem};
use carpus::osim::OsimFile;
use carpus::osim::spec::MuscleKind;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Fibre length in equilibrium [m].
const LENGTH_TOLERANCE: f64 = 1e-7;
/// Tendon force in equilibrium, over maximum isometric force.
const FORCE_TOLERANCE: f64 = 1e-5;
/// Moment at rest, over maximum isometric force times 0.1 m, a long moment arm in the arm.
const MOMENT_TOLERANCE: f64 = 1e-5;
const LONG_MOMENT_ARM: f64 = 0.1;

/// The muscles of a model at rest as the program prints them.
fn carpus_at_rest(model: &Path, posture: &Value) -> Value {
    let mut command = assert_cmd::Command::cargo_bin("carpus").expect("the program");
    command.arg("equilibrium").arg(model).args(["--json", "--quiet", "--allow-unsupported"]);
    command.args(["--activation", &posture["activation"].to_string()]);
    let coordinates = posture["coordinates"].as_object().expect("coordinates");
    for (name, value) in coordinates {
        let unit = posture["units"][name].as_str().expect("unit");
        command.arg("--set").arg(format!("{name}={value}{unit}"));
    }
    let output = command.output().expect("the program runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Equilibria of all muscles of a model at random postures, the program's against OpenSim's.
fn compare(python: &Path, model: &Path, n_postures: usize) -> [Differences; 3] {
    let folder = tempfile::tempdir().expect("temporary folder");
    let reference = folder.path().join("reference.json");
    let postures = n_postures.to_string();
    let arguments = [model.as_os_str(), reference.as_os_str(), "--postures".as_ref(), postures.as_ref()];
    run_script(python, "scripts/equilibrium.py", &arguments);
    let text = std::fs::read_to_string(reference).expect("reference written");
    let reference: Value = serde_json::from_str(&text).expect("JSON");
    let mut length = Differences::listing_above("fibre length at rest", "m", LENGTH_TOLERANCE);
    let mut force = Differences::listing_above("tendon force at rest", "Fmax", FORCE_TOLERANCE);
    let mut moment = Differences::listing_above("moment at rest", "Fmax · 0.1 m", MOMENT_TOLERANCE);
    let mut opensim_failures = Vec::new();
    for (number, posture) in reference["postures"].as_array().expect("postures").iter().enumerate() {
        let ours = carpus_at_rest(model, posture);
        let theirs = posture["muscles"].as_object().expect("muscles");
        let rows = ours["muscles"].as_array().expect("muscles");
        assert_eq!(rows.len(), theirs.len(), "the same muscles");
        for row in rows {
            let name = row["muscle"].as_str().expect("name");
            let theirs = &theirs[name];
            let scale = reference["max_isometric_force"][name].as_f64().expect("force");
            let Some(their_force) = theirs["tendon_force"].as_f64() else {
                opensim_failures.push(format!("{name} at posture {number}: {}", theirs["failure"]));
                println!("OpenSim: {}; Carpus: {row}", opensim_failures[opensim_failures.len() - 1]);
                continue;
            };
            let activation = posture["activation"].as_f64().expect("activation");
            let number_of = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
            let at = |key: &str, theirs: f64| {
                let ours = number_of(key);
                format!("{name} at posture {number}, activation {activation:.4}: {ours} instead of {theirs}")
            };
            let their_length = theirs["fiber_length"].as_f64().unwrap_or(f64::NAN);
            length.push(number_of("fiber_length_m") - their_length, || at("fiber_length_m", their_length));
            force.push((number_of("tendon_force_n") - their_force) / scale, || at("tendon_force_n", their_force));
            for about in row["moments"].as_array().expect("moments") {
                let coordinate = about["coordinate"].as_str().expect("name");
                let their_moment = theirs["moments"][coordinate].as_f64().unwrap_or(f64::NAN);
                let ours = about["moment_n_m"].as_f64().unwrap_or(f64::NAN);
                let case =
                    || format!("{name} about {coordinate} at posture {number}: {ours} instead of {their_moment}");
                moment.push((ours - their_moment) / (scale * LONG_MOMENT_ARM), case);
            }
        }
    }
    if let Some(first) = opensim_failures.first() {
        length.remark(format!("besides, OpenSim finds no equilibrium in {} cases, as {first}", opensim_failures.len()));
    }
    [length, force, moment]
}

fn rows(component: &str, name: &str, differences: &[Differences; 3]) -> Vec<Row> {
    let tolerances = [LENGTH_TOLERANCE, FORCE_TOLERANCE, MOMENT_TOLERANCE];
    differences.iter().zip(tolerances).map(|(d, tolerance)| d.row(component, name, tolerance, Judge::Max)).collect()
}

fn has_millard_muscles(model: &Path) -> bool {
    let file = OsimFile::read(model).unwrap_or_else(|error| panic!("{error}"));
    file.spec.muscles.iter().any(|muscle| matches!(muscle.kind, MuscleKind::Millard2012Equilibrium(_)))
}

fn bundled() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("models/wrist.osim")
}

/// Every Millard muscle of every model at rest, 50 postures, through the program.
#[test]
#[cfg_attr(
    not(all(has_opensim, has_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and models (CARPUS_MODELS or CARPUS_SHARED)"
)]
fn val_opensim_equilibrium_through_the_program() {
    let python = opensim_python();
    let mut all = rows("equilibrium command", "models/wrist.osim", &compare(&python, &bundled(), 50));
    for model in lab_models() {
        if has_millard_muscles(&model) {
            all.extend(rows("equilibrium command", &stem(&model), &compare(&python, &model, 50)));
        }
    }
    super::write("equilibrium_command", &all);
    super::assert_passed(&all);
}

/// Changes every second muscle's parameters, as a personalization does, and writes the file.
fn changed_copy(model: &Path, to: &Path) -> usize {
    let mut file = OsimFile::read(model).unwrap_or_else(|error| panic!("{error}"));
    let mut changes: Vec<(String, &str, f64)> = Vec::new();
    for (i, muscle) in file.spec.muscles.iter().enumerate().filter(|(i, _)| i % 2 == 0) {
        let factor = 0.9 + 0.05 * (i % 5) as f64;
        changes.push((muscle.name.clone(), "optimal_fiber_length", factor * muscle.optimal_fiber_length));
        changes.push((muscle.name.clone(), "tendon_slack_length", muscle.tendon_slack_length / 0.99));
        changes.push((muscle.name.clone(), "max_isometric_force", muscle.max_isometric_force / factor / factor));
        changes.push((muscle.name.clone(), "pennation_angle_at_optimal", muscle.pennation_angle_at_optimal + 0.05));
    }
    let borrowed: Vec<(&str, &str, f64)> = changes.iter().map(|(m, p, v)| (m.as_str(), *p, *v)).collect();
    file.set_muscle_properties(&borrowed).unwrap_or_else(|error| panic!("{error}"));
    file.write(to).unwrap_or_else(|error| panic!("{error}"));
    changes.len()
}

/// A model whose muscles Carpus changed opens in OpenSim and gives the forces and moments that Carpus says.
#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_gives_the_same_forces_for_a_written_model() {
    let python = opensim_python();
    let lab = ["models/Hand_Wrist_Model_for_development.osim", "models/MOBL_ARMS_41.osim"];
    let models = std::iter::once(bundled()).chain(lab.into_iter().filter_map(shared_if_here));
    let folder = tempfile::tempdir().expect("temporary folder");
    let mut all = Vec::new();
    for model in models {
        let copy = folder.path().join(format!("{}_changed.osim", stem(&model)));
        let n_changes = changed_copy(&model, &copy);
        let changed = changed_lines(&model, &copy);
        // A property that a file leaves to its class' default gets a line of its own.
        assert!(changed <= n_changes, "{changed} lines changed by {n_changes} changes");
        let [mut length, force, moment] = compare(&python, &copy, 20);
        length.remark(format!("{n_changes} parameters changed, {changed} lines of the file differ"));
        all.extend(rows("written model", &stem(&model), &[length, force, moment]));
    }
    super::write("written_model", &all);
    super::assert_passed(&all);
}

/// Number of lines of `after` that are not in `before` at their place, or after it.
fn changed_lines(before: &Path, after: &Path) -> usize {
    let text = |path: &Path| String::from_utf8_lossy(&std::fs::read(path).expect("readable")).into_owned();
    let (before, after) = (text(before), text(after));
    let (before, after): (Vec<&str>, Vec<&str>) = (before.lines().collect(), after.lines().collect());
    if before.len() != after.len() {
        return usize::MAX;
    }
    before.iter().zip(&after).filter(|(a, b)| a != b).count()
}
