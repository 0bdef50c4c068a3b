//! Exact derivatives against finite differences: analytic linearization, and dual numbers through the parameters.

use super::tables::{fixtures, muscles, number, rows};
use carpus::muscles::{EquilibriumStatus, Millard2012, Millard2012Parameters};
use carpus::numerics::{Dual, Scalar};

/// Central difference of several functions at once.
fn difference<const N: usize>(x: f64, h: f64, f: impl Fn(f64) -> [f64; N]) -> [f64; N] {
    let (plus, minus) = (f(x + h), f(x - h));
    std::array::from_fn(|i| (plus[i] - minus[i]) / (2.0 * h))
}

#[test]
fn verif_linearization_equals_finite_differences() {
    let muscles = muscles(&fixtures());
    let mut compared = 0;
    for row in rows(&fixtures().join("states.csv")) {
        let muscle = &muscles[&row["muscle"]];
        let state = ["state_fiber_length", "state_activation", "path_length", "path_speed"].map(|c| number(&row, c));
        let p = *muscle.parameters();
        let at = muscle.linearize(state[0], state[1], state[2], state[3]);
        let gradients = [at.fiber_velocity_by, at.tendon_force_by]
            .map(|g| [g.fiber_length, g.activation, g.path_length, g.path_speed]);
        let outputs = |s: [f64; 4]| {
            let f = muscle.fiber_velocity(s[0], s[1], s[2], s[3]);
            [f.fiber_velocity, f.norm_tendon_force * p.max_isometric_force]
        };
        assert_eq!(outputs(state)[0], at.fiber_velocity);
        assert!((outputs(state)[1] - at.tendon_force).abs() < 1e-12 * p.max_isometric_force);
        let max_speed = p.max_contraction_velocity * p.optimal_fiber_length;
        let steps = [1e-6 * p.optimal_fiber_length, 1e-6, 1e-6 * p.optimal_fiber_length, 1e-6 * max_speed];
        for (variable, step) in steps.into_iter().enumerate() {
            let shifted = |x: f64| {
                let mut s = state;
                s[variable] = x;
                outputs(s)
            };
            let [half, full] = [0.5 * step, step].map(|h| difference(state[variable], h, shifted));
            for output in 0..2 {
                let scale = [max_speed, p.max_isometric_force][output] * 1e-6 / step;
                let error = (gradients[output][variable] - full[output]).abs() / scale.max(full[output].abs());
                // A kink (clamping, buckling) within the step: the difference quotients themselves disagree.
                let kink = (half[output] - full[output]).abs() > 1e-5 * scale.max(full[output].abs());
                assert!(kink || error < 1e-5, "{row:?}: output {output} by {variable}: {gradients:?} {full:?}");
                compared += usize::from(!kink);
            }
        }
    }
    assert!(compared > 1300, "{compared}");
}

const PARAMETERS: usize = 8;

fn to_array<S: Scalar>(p: &Millard2012Parameters<S>) -> [S; PARAMETERS] {
    [
        p.max_isometric_force,
        p.optimal_fiber_length,
        p.tendon_slack_length,
        p.pennation_angle_at_optimal,
        p.max_contraction_velocity,
        p.fiber_damping,
        p.activation_time_constant,
        p.deactivation_time_constant,
    ]
}

fn from_array<S: Scalar>(v: [S; PARAMETERS]) -> Millard2012Parameters<S> {
    Millard2012Parameters {
        max_isometric_force: v[0],
        optimal_fiber_length: v[1],
        tendon_slack_length: v[2],
        pennation_angle_at_optimal: v[3],
        max_contraction_velocity: v[4],
        fiber_damping: v[5],
        activation_time_constant: v[6],
        deactivation_time_constant: v[7],
    }
}

/// The muscle with all parameters as variables.
fn with_duals(muscle: &Millard2012) -> Millard2012<Dual<PARAMETERS>> {
    let values = to_array(muscle.parameters());
    let duals = std::array::from_fn(|i| Dual::variable(values[i], i));
    muscle.with_parameters(from_array(duals)).expect("same values")
}

/// Parameters that can be varied to both sides.
fn variable_parameters(muscle: &Millard2012) -> impl Iterator<Item = usize> + use<> {
    let values = to_array(muscle.parameters());
    (0..PARAMETERS).filter(move |&i| values[i] > 0.0)
}

fn varied(muscle: &Millard2012, parameter: usize, value: f64) -> Millard2012 {
    let mut values = to_array(muscle.parameters());
    values[parameter] = value;
    muscle.with_parameters(from_array(values)).expect("a little different")
}

#[test]
fn verif_parameter_derivatives_of_fiber_velocity_and_force() {
    let muscles = muscles(&fixtures());
    let mut compared = 0;
    for row in rows(&fixtures().join("states.csv")) {
        let muscle = &muscles[&row["muscle"]];
        let state = ["state_fiber_length", "state_activation", "path_length", "path_speed"].map(|c| number(&row, c));
        let dual_state = state.map(Dual::<PARAMETERS>::constant);
        let dual = with_duals(muscle).dynamics(dual_state[0], dual_state[1], dual_state[2], dual_state[3]);
        let exact = [dual.fiber_velocity, dual.tendon_force, dual.fiber_stiffness];
        for parameter in variable_parameters(muscle) {
            let value = to_array(muscle.parameters())[parameter];
            let outputs = |x: f64| {
                let at = varied(muscle, parameter, x).dynamics(state[0], state[1], state[2], state[3]);
                [at.fiber_velocity, at.tendon_force, at.fiber_stiffness]
            };
            let [half, full] = [0.5e-6, 1e-6].map(|h| difference(value, h * value, outputs));
            for output in 0..3 {
                let scale = (exact[output].value.abs() / value).max(full[output].abs()).max(1e-3);
                let error = (exact[output].gradient[parameter] - full[output]).abs() / scale;
                let kink = (half[output] - full[output]).abs() > 1e-5 * scale;
                assert!(kink || error < 1e-5, "{row:?}: {output} by {parameter}: {:?} {full:?}", exact[output]);
                compared += usize::from(!kink);
            }
        }
    }
    assert!(compared > 3500, "{compared}");
}

#[test]
fn verif_parameter_derivatives_of_equilibrium() {
    let muscles = muscles(&fixtures());
    let mut compared = 0;
    for row in rows(&fixtures().join("equilibrium.csv")) {
        let muscle = &muscles[&row["muscle"]];
        let (path, activation) = (number(&row, "path_length"), number(&row, "activation"));
        let dual =
            with_duals(muscle).equilibrium(Dual::constant(path), Dual::constant(activation)).expect("equilibrium");
        if dual.status != EquilibriumStatus::Converged {
            continue;
        }
        let exact = [dual.fiber_length, dual.tendon_force];
        for parameter in variable_parameters(muscle) {
            let value = to_array(muscle.parameters())[parameter];
            let outputs = |x: f64| {
                let at = varied(muscle, parameter, x).equilibrium(path, activation).expect("equilibrium");
                [at.fiber_length, at.tendon_force]
            };
            let full = difference(value, 1e-6 * value, outputs);
            for output in 0..2 {
                let scale = (exact[output].value.abs() / value).max(full[output].abs());
                let error = (exact[output].gradient[parameter] - full[output]).abs() / scale;
                assert!(error < 1e-5, "{row:?}: {output} by {parameter}: {:?} {full:?}", exact[output]);
                compared += 1;
            }
        }
    }
    assert!(compared > 1000, "{compared}");
}

#[test]
fn verif_activation_derivative_slope() {
    for muscle in muscles(&fixtures()).values() {
        let dynamics = muscle.activation_dynamics();
        for (activation, excitation) in [(0.3, 0.9), (0.3, 0.1), (0.02, 0.6), (0.99, 0.0), (0.5, 1.0)] {
            let [numeric] = difference(activation, 1e-6, |a| [dynamics.derivative(a, excitation)]);
            let exact = dynamics.derivative_slope(activation, excitation);
            assert!((exact - numeric).abs() < 1e-6 * exact.abs(), "{exact} {numeric}");
        }
        assert_eq!(dynamics.derivative_slope(-0.5, 0.3), 0.0);
    }
}

#[test]
fn verif_equilibrium_is_where_the_fiber_rests() {
    let muscles = muscles(&fixtures());
    let mut compared = 0;
    for row in rows(&fixtures().join("equilibrium.csv")) {
        let muscle = &muscles[&row["muscle"]];
        let (path, activation) = (number(&row, "path_length"), number(&row, "activation"));
        let equilibrium = muscle.equilibrium(path, activation).expect("equilibrium");
        let rest = muscle.fiber_velocity(equilibrium.fiber_length, activation, path, 0.0);
        let tolerance = if equilibrium.status == EquilibriumStatus::Converged { 1e-11 } else { 2e-5 };
        assert!(rest.norm_fiber_velocity.abs() < tolerance, "{row:?}: {equilibrium:?} {rest:?}");
        compared += 1;
    }
    assert!(compared > 200);
}
