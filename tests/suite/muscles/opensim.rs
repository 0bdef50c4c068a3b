//! Muscles against OpenSim 4.6: the shipped tables, and (where OpenSim and the lab models are at hand) the lab's
//! muscles.

use super::tables::{Differences, fixtures, muscles, number, rows, specs};
use crate::reference::{opensim_python, shared};
use crate::validation::{self, Judge};
use carpus::muscles::curves::MillardCurves;
use carpus::muscles::{EQUILIBRIUM_TOLERANCE, EquilibriumStatus, Millard2012, MuscleDynamics};
use carpus::osim::spec::{MuscleKind, MuscleSpec};
use std::collections::HashMap;
use std::path::Path;
use std::process::Command;

/// Curves and derivatives, absolute or relative to the value where that is above 1: rounding of another evaluation
/// order, amplified by slopes of up to several thousand.
const CURVE_TOLERANCE: f64 = 1e-9;
/// OpenSim accepts a curve parameter u with |x(u) − x| up to 100 machine epsilons: its numbers are exact for an
/// abscissa that far away. At a sharp corner the second derivative notices (in one case of the shipped table, where
/// arithmetic with fractions finds ours 2e-6 and OpenSim's 5e-5 from the exact value of 15.5).
const OPENSIM_ABSCISSA_TOLERANCE: f64 = 100.0 * f64::EPSILON;
/// Fibre length in equilibrium [m].
const LENGTH_TOLERANCE: f64 = 1e-7;
/// Tendon force in equilibrium, over maximum isometric force.
const FORCE_TOLERANCE: f64 = 1e-5;
/// State derivatives and outputs, over a scale of each: OpenSim solves for the fibre velocity to a force error of
/// 1e-10·Fmax, divided by a damping of down to 0.01.
const STATE_TOLERANCE: f64 = 2e-8;

type Row = HashMap<String, String>;

fn curve_differences(folder: &Path) -> Vec<Differences> {
    let specs: HashMap<String, MuscleSpec> = specs(folder).into_iter().map(|s| (s.name.clone(), s)).collect();
    let mut curves: HashMap<String, MillardCurves> = HashMap::new();
    let mut differences: Vec<Differences> = Vec::new();
    for row in rows(&folder.join("curves.csv")) {
        let muscle = curves.entry(row["muscle"].clone()).or_insert_with(|| {
            let spec = &specs[&row["muscle"]];
            let MuscleKind::Millard2012Equilibrium(millard) = &spec.kind else { panic!("class") };
            let singular = millard.fiber_damping < 0.001 && !spec.ignore_tendon_compliance;
            MillardCurves::new(millard, singular).expect("curves")
        });
        let curve = match row["curve"].as_str() {
            "active_force_length" => &muscle.active_force_length,
            "force_velocity" => &muscle.force_velocity,
            "force_velocity_inverse" => &muscle.force_velocity_inverse,
            "fiber_force_length" => &muscle.fiber_force_length,
            "tendon_force_length" => &muscle.tendon_force_length,
            other => panic!("unknown curve {other}"),
        };
        let x = number(&row, "x");
        let at = curve.value_and_derivative(x);
        let near = [x - OPENSIM_ABSCISSA_TOLERANCE, x + OPENSIM_ABSCISSA_TOLERANCE];
        let second = curve.second_derivative(x);
        let spread = near.map(|x| (curve.second_derivative(x) - second).abs()).into_iter().fold(0.0, f64::max);
        let ours =
            [("value", at.value, 0.0), ("derivative", at.derivative, 0.0), ("second_derivative", second, spread)];
        for (order, ours, spread) in ours {
            let theirs = number(&row, order);
            let quantity = format!("{} {order}", row["curve"]);
            let index = differences.iter().position(|d| d.quantity == quantity).unwrap_or_else(|| {
                differences.push(Differences::new(quantity, "1"));
                differences.len() - 1
            });
            let beyond_spread = if (ours - theirs).abs() <= spread { 0.0 } else { (ours - theirs).abs() - spread };
            differences[index].push(beyond_spread / theirs.abs().max(1.0), || {
                format!("{} at {x}: {ours} instead of {theirs}", row["muscle"])
            });
        }
    }
    differences
}

#[test]
fn val_opensim_curves_and_their_derivatives() {
    let differences = curve_differences(&fixtures());
    assert_eq!(differences.len(), 15, "five curves, three orders");
    for difference in &differences {
        difference.assert_below(CURVE_TOLERANCE);
    }
}

/// Equilibria against OpenSim's: length, force, and how well OpenSim's and our lengths balance the forces.
struct EquilibriumComparison {
    length: Differences,
    force: Differences,
    our_residual: Differences,
    their_residual: Differences,
    opensim_failures: usize,
    at_lower_bound: usize,
    weakly_determined: usize,
}

fn compare_equilibria(folder: &Path) -> EquilibriumComparison {
    let muscles = muscles(folder);
    let mut result = EquilibriumComparison {
        length: Differences::new("equilibrium fibre length", "m"),
        force: Differences::new("equilibrium tendon force", "Fmax"),
        our_residual: Differences::new("force imbalance at our equilibrium", "Fmax"),
        their_residual: Differences::new("force imbalance at OpenSim's equilibrium", "Fmax"),
        opensim_failures: 0,
        at_lower_bound: 0,
        weakly_determined: 0,
    };
    for row in rows(&folder.join("equilibrium.csv")) {
        let muscle = &muscles[&row["muscle"]];
        let (path_length, activation) = (number(&row, "path_length"), number(&row, "activation"));
        let ours = muscle.equilibrium(path_length, activation).expect("equilibrium");
        let case = || format!("{} path {path_length} m, activation {activation}: {ours:?}", row["muscle"]);
        match ours.status {
            EquilibriumStatus::FiberAtLowerBound => result.at_lower_bound += 1,
            EquilibriumStatus::WeaklyDetermined => result.weakly_determined += 1,
            EquilibriumStatus::Converged => result.our_residual.push(ours.residual, case),
            EquilibriumStatus::RigidTendon => {}
        }
        if !row["failure"].is_empty() {
            result.opensim_failures += 1;
            continue;
        }
        // OpenSim's solution does not depend on the path's speed, in either of its two modes.
        assert_eq!(row["fiber_length"], row["fiber_length_with_velocity"]);
        let (length, force) = (number(&row, "fiber_length"), number(&row, "tendon_force"));
        result.length.push(ours.fiber_length - length, case);
        result.force.push((ours.tendon_force - force) / muscle.parameters().max_isometric_force, case);
        if ours.status == EquilibriumStatus::Converged {
            result.their_residual.push(muscle.equilibrium_residual(length, path_length, activation), case);
        }
    }
    result
}

fn assert_equilibria(result: &EquilibriumComparison) {
    println!(
        "OpenSim failed {}, fibre at lower bound {}, weakly determined {}",
        result.opensim_failures, result.at_lower_bound, result.weakly_determined
    );
    result.length.assert_below(LENGTH_TOLERANCE);
    result.force.assert_below(FORCE_TOLERANCE);
    result.our_residual.assert_below(1e-13);
    result.their_residual.assert_below(EQUILIBRIUM_TOLERANCE);
}

#[test]
fn val_opensim_equilibrium() {
    let result = compare_equilibria(&fixtures());
    assert_equilibria(&result);
    assert!(result.length.count() > 200);
    assert!(result.at_lower_bound + result.weakly_determined > 10, "slack tendons are among the cases");
    assert!(result.opensim_failures > 5, "states that OpenSim cannot equilibrate are among the cases");
}

/// Name of a reference column, our number for it, and the scale that differences are judged by.
fn outputs(muscle: &Millard2012, at: &MuscleDynamics) -> Vec<(&'static str, f64, f64)> {
    let p = muscle.parameters();
    let (force, l_opt) = (p.max_isometric_force, p.optimal_fiber_length);
    let speed = p.max_contraction_velocity * l_opt;
    let (k, kt) = (force / l_opt, force / p.tendon_slack_length * 30.0);
    vec![
        ("fiber_length", at.fiber_length, l_opt),
        ("normalized_fiber_length", at.normalized_fiber_length, 1.0),
        ("pennation_angle", at.pennation_angle, 1.0),
        ("tendon_length", at.tendon_length, p.tendon_slack_length),
        ("tendon_strain", at.tendon_strain, 1.0),
        ("force_velocity_multiplier", at.force_velocity_multiplier, 1.0),
        ("fiber_velocity", at.fiber_velocity, speed),
        ("normalized_fiber_velocity", at.normalized_fiber_velocity, 1.0),
        ("fiber_velocity_along_tendon", at.fiber_velocity_along_tendon, speed),
        ("pennation_angular_velocity", at.pennation_angular_velocity, speed / l_opt),
        ("tendon_velocity", at.tendon_velocity, speed),
        ("fiber_force", at.fiber_force, force),
        ("active_fiber_force", at.active_fiber_force, force),
        ("passive_fiber_force", at.passive_fiber_force, force),
        ("passive_fiber_elastic_force", at.passive_fiber_elastic_force, force),
        ("passive_fiber_damping_force", at.passive_fiber_damping_force, force),
        ("tendon_force", at.tendon_force, force),
        ("fiber_stiffness", at.fiber_stiffness, k),
        ("fiber_stiffness_along_tendon", at.fiber_stiffness_along_tendon, k),
        ("tendon_stiffness", at.tendon_stiffness, kt),
    ]
}

fn compare_states(folder: &Path) -> (Vec<Differences>, usize) {
    let muscles = muscles(folder);
    let mut differences: Vec<Differences> = Vec::new();
    let mut opensim_failures = 0;
    for row in rows(&folder.join("states.csv")) {
        let muscle = &muscles[&row["muscle"]];
        let get = |column: &str| number(&row, column);
        let (fiber, length, speed) = (get("state_fiber_length"), get("path_length"), get("path_speed"));
        let (activation, excitation) = (get("state_activation"), get("excitation"));
        if get("fiber_length").is_nan() {
            opensim_failures += 1;
            continue;
        }
        let at = muscle.dynamics(fiber, activation, length, speed);
        let mut all = outputs(muscle, &at);
        let rate = if muscle.ignore_activation_dynamics() {
            0.0
        } else {
            muscle.activation_dynamics().derivative(activation, excitation)
        };
        all.push(("activation_derivative", rate, 100.0));
        // The short way to the same numbers.
        let quick = muscle.fiber_velocity(fiber, activation, length, speed);
        let force = muscle.parameters().max_isometric_force;
        assert_eq!(quick.fiber_velocity, at.fiber_velocity);
        assert!((quick.norm_tendon_force * force - at.tendon_force).abs() < 1e-12 * force);
        for (index, (quantity, ours, scale)) in all.into_iter().enumerate() {
            let theirs = get(quantity);
            if differences.len() <= index {
                differences.push(Differences::new(quantity, "scale"));
            }
            let difference = if ours == theirs { 0.0 } else { ours - theirs };
            differences[index].push(difference / scale, || describe(&row, ours));
        }
    }
    (differences, opensim_failures)
}

fn describe(row: &Row, ours: f64) -> String {
    let columns = ["muscle", "state_fiber_length", "path_length", "path_speed", "state_activation"];
    let state: Vec<&str> = columns.iter().map(|c| row[*c].as_str()).collect();
    format!("{}: {ours}", state.join(", "))
}

#[test]
fn val_opensim_state_derivatives_and_outputs() {
    let (differences, opensim_failures) = compare_states(&fixtures());
    assert_eq!(opensim_failures, 0);
    for difference in &differences {
        difference.assert_below(STATE_TOLERANCE);
    }
}

#[test]
#[cfg_attr(
    not(all(has_opensim, has_lab_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and lab models (CARPUS_SHARED)"
)]
fn val_opensim_muscles_of_lab_models() {
    let models = ["models/Hand_Wrist_Model_for_development.osim", "models/MOBL_ARMS_41.osim"].map(shared);
    let [mcfarland, mobl] = models;
    let python = opensim_python();
    let folder = tempfile::tempdir().expect("temporary folder");
    let output = Command::new(python)
        .arg(fixtures().join("opensim_muscles.py"))
        .arg("--model")
        .arg(mcfarland)
        .arg("--model")
        .arg(mobl)
        .args(["--count", "1000", "--out"])
        .arg(folder.path())
        .output()
        .expect("reference program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    let curves = curve_differences(folder.path());
    let equilibria = compare_equilibria(folder.path());
    let (states, _) = compare_states(folder.path());
    let rows = rows_of(&curves, &equilibria, &states);
    validation::write("muscles", &rows);
    validation::assert_passed(&rows);
    assert_equilibria(&equilibria);
    assert!(equilibria.length.count() >= 1000);
}

/// The table's rows: curves, equilibrium, state derivatives and outputs.
fn rows_of(curves: &[Differences], equilibria: &EquilibriumComparison, states: &[Differences]) -> Vec<validation::Row> {
    let row = |component: &str, differences: &Differences, tolerance: f64| {
        differences.row(component, "muscles of the McFarland and MoBL models", tolerance, Judge::Max)
    };
    let mut rows: Vec<validation::Row> = curves.iter().map(|d| row("muscle curves", d, CURVE_TOLERANCE)).collect();
    rows.push(row("muscle equilibrium", &equilibria.length, LENGTH_TOLERANCE));
    rows.push(row("muscle equilibrium", &equilibria.force, FORCE_TOLERANCE));
    for row in &mut rows[curves.len()..] {
        row.remark = Some(format!(
            "besides, OpenSim finds no equilibrium in {} states; the fibre is at its lower bound in {}, and hardly \
             determined by any force in {}",
            equilibria.opensim_failures, equilibria.at_lower_bound, equilibria.weakly_determined
        ));
    }
    rows.extend(states.iter().map(|d| row("muscle dynamics", d, STATE_TOLERANCE)));
    rows
}
