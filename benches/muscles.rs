//! Time per curve evaluation, fibre velocity, linearization and equilibrium. `cargo bench --bench muscles`.

use carpus::muscles::{Millard2012, Millard2012Parameters};
use carpus::numerics::{Dual, Scalar};
use carpus::osim::spec::{
    ActiveForceLengthSpec, FiberForceLengthSpec, ForceVelocitySpec, Location, Millard2012Spec, MuscleKind, MuscleSpec,
    PathSpec, TendonForceLengthSpec,
};
use std::hint::black_box;
use std::time::Instant;

/// Arguments per round.
const SAMPLES: usize = 1000;
/// Rounds; the fastest counts.
const ROUNDS: usize = 400;

/// OpenSim's default muscle.
fn muscle() -> Millard2012 {
    let millard = Millard2012Spec {
        fiber_damping: 0.1,
        default_fiber_length: 0.06,
        default_activation: 0.05,
        minimum_activation: 0.01,
        activation_time_constant: 0.01,
        deactivation_time_constant: 0.04,
        maximum_pennation_angle: 0.1_f64.acos(),
        active_force_length: ActiveForceLengthSpec {
            min_norm_active_fiber_length: 0.4441,
            transition_norm_fiber_length: 0.73,
            max_norm_active_fiber_length: 1.8123,
            shallow_ascending_slope: 0.8616,
            minimum_value: 0.0,
        },
        force_velocity: ForceVelocitySpec {
            concentric_slope_at_vmax: 0.0,
            concentric_slope_near_vmax: 0.25,
            isometric_slope: 5.0,
            eccentric_slope_at_vmax: 0.0,
            eccentric_slope_near_vmax: 0.15,
            max_eccentric_velocity_force_multiplier: 1.4,
            concentric_curviness: 0.6,
            eccentric_curviness: 0.9,
        },
        fiber_force_length: FiberForceLengthSpec {
            strain_at_zero_force: 0.0,
            strain_at_one_norm_force: 0.7,
            stiffness_at_low_force: None,
            stiffness_at_one_norm_force: None,
            curviness: None,
        },
        tendon_force_length: TendonForceLengthSpec {
            strain_at_one_norm_force: 0.049,
            stiffness_at_one_norm_force: None,
            norm_force_at_toe_end: None,
            curviness: None,
        },
    };
    let spec = MuscleSpec {
        name: "default".into(),
        at: Location::default(),
        applies_force: true,
        path: PathSpec::default(),
        max_isometric_force: 300.0,
        optimal_fiber_length: 0.06,
        tendon_slack_length: 0.2,
        pennation_angle_at_optimal: 0.1,
        max_contraction_velocity: 10.0,
        ignore_tendon_compliance: false,
        ignore_activation_dynamics: false,
        min_control: 0.01,
        max_control: 1.0,
        kind: MuscleKind::Millard2012Equilibrium(Box::new(millard)),
    };
    Millard2012::from_spec(&spec).expect("default muscle")
}

/// Prints nanoseconds per call of `f` over arguments spread between 0 and 1 in a fixed irregular order.
fn time(name: &str, mut f: impl FnMut(f64) -> f64) {
    let arguments: Vec<f64> = (0..SAMPLES).map(|i| (i as f64 * 0.618_033_988_749_895).fract()).collect();
    let mut fastest = f64::INFINITY;
    for _ in 0..ROUNDS {
        let start = Instant::now();
        let mut sum = 0.0;
        for &x in &arguments {
            sum += f(black_box(x));
        }
        black_box(sum);
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    println!("{name:<44} {:>9.1} ns", fastest / SAMPLES as f64 * 1e9);
}

fn main() {
    let muscle = muscle();
    let curves = muscle.curves();
    time("active force-length, value and slope", |x| {
        let at = curves.active_force_length.value_and_derivative(0.45 + 1.35 * x);
        at.value + at.derivative
    });
    time("force-velocity, value and slope", |x| {
        let at = curves.force_velocity.value_and_derivative(2.0 * x - 1.0);
        at.value + at.derivative
    });
    time("tendon, value and slope", |x| {
        let at = curves.tendon_force_length.value_and_derivative(1.0 + 0.03 * x);
        at.value + at.derivative
    });
    time("tendon, value alone", |x| curves.tendon_force_length.value(1.0 + 0.03 * x));
    let state = |x: f64| (0.04 + 0.04 * x, 0.02 + 0.9 * (7.0 * x).fract(), 0.247 + 0.04 * x);
    time("fibre velocity", |x| {
        let (fiber, activation, path) = state(x);
        muscle.fiber_velocity(fiber, activation, path, 0.0).fiber_velocity
    });
    time("linearization", |x| {
        let (fiber, activation, path) = state(x);
        muscle.linearize(fiber, activation, path, 0.0).fiber_velocity_by.fiber_length
    });
    time("all outputs", |x| {
        let (fiber, activation, path) = state(x);
        muscle.dynamics(fiber, activation, path, 0.0).tendon_force
    });
    let p = muscle.parameters();
    let duals = Millard2012Parameters {
        max_isometric_force: Dual::<4>::variable(p.max_isometric_force, 0),
        optimal_fiber_length: Dual::variable(p.optimal_fiber_length, 1),
        tendon_slack_length: Dual::variable(p.tendon_slack_length, 2),
        pennation_angle_at_optimal: Dual::variable(p.pennation_angle_at_optimal, 3),
        ..p.lift()
    };
    let dual_muscle = muscle.with_parameters(duals).expect("same values");
    time("fibre velocity with 4 parameter derivatives", |x| {
        let (fiber, activation, path) = state(x);
        let [fiber, activation, path] = [fiber, activation, path].map(Dual::constant);
        dual_muscle.fiber_velocity(fiber, activation, path, Dual::constant(0.0)).fiber_velocity.gradient[2]
    });
    time("equilibrium", |x| {
        let (_, activation, path) = state(x);
        muscle.equilibrium(path, activation).map_or(f64::NAN, |at| at.tendon_force)
    });
    time("new parameters", |x| {
        let parameters = Millard2012Parameters { optimal_fiber_length: 0.05 + 0.02 * x, ..*p };
        muscle.with_parameters(parameters).map_or(f64::NAN, |m| m.minimum_fiber_length())
    });
}
