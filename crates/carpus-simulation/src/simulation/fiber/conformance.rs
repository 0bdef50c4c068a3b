//! What the law of every class of muscles has to keep, on the muscles of `fixtures/muscle_laws`.

use std::path::Path;
use std::sync::Arc;

use super::CurveCache;
use super::equation::{Drive, Fiber, FiberCurves, PARAMETERS};
use super::plan::StepPlan;
use super::step::{Cursor, DriveSource, FiberAccuracy, FiberSample};
use carpus_multibody::muscles::{MuscleModel, MuscleState};
use carpus_osim::osim::OsimFile;
use carpus_osim::osim::spec::{DeprecatedMuscleKind, MuscleKind, OtherMuscleSpec};

/// A muscle of every class whose tendon is a spring.
struct Case {
    name: String,
    model: MuscleModel,
    curves: Arc<FiberCurves>,
    /// Optimal fibre length and tendon slack length [m], sine of the pennation angle.
    own: [f64; PARAMETERS],
}

impl Case {
    fn of(class: &str, muscle: &str) -> Case {
        let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let file = match class {
            "Millard2012EquilibriumMuscle" => root.join("models/wrist.osim"),
            other => root.join(format!("fixtures/muscle_laws/{other}.osim")),
        };
        let mut spec = OsimFile::read(file).unwrap().spec;
        let spec = spec.muscles.iter_mut().find(|m| m.name == muscle).unwrap();
        // A mass is left out: the class's own equation tends to that without it as the mass goes to 0.
        if let MuscleKind::OtherClass { law: Some(law), .. } = &mut spec.kind
            && let OtherMuscleSpec::Deprecated(own) = &mut **law
            && let DeprecatedMuscleKind::Delp1990 { mass, .. } = &mut own.kind
        {
            *mass *= 0.05;
        }
        let model = MuscleModel::from_spec(spec).unwrap();
        let curves = FiberCurves::of(&model, spec, &mut CurveCache::default()).unwrap();
        let own = [spec.optimal_fiber_length, spec.tendon_slack_length, spec.pennation_angle_at_optimal.sin()];
        Case { name: format!("{class} {muscle}"), model, curves, own }
    }

    fn all() -> Vec<Case> {
        let classes = [
            "Millard2012EquilibriumMuscle",
            "Thelen2003Muscle",
            "DeGrooteFregly2016Muscle",
            "Schutte1993Muscle_Deprecated",
            "Delp1990Muscle_Deprecated",
        ];
        classes.iter().flat_map(|class| ["FCR", "ECU", "ECRL"].map(|muscle| Case::of(class, muscle))).collect()
    }

    fn fiber_with(&self, [optimal, slack, sine]: [f64; PARAMETERS]) -> Fiber {
        Fiber::new(Arc::clone(&self.curves), optimal, slack, sine.asin())
    }

    fn fiber(&self) -> Fiber {
        self.fiber_with(self.own)
    }

    /// Path length for a normalized fibre length and a tendon stretched by a share of its slack length [m].
    fn path(&self, x: f64, strain: f64) -> f64 {
        let [optimal, slack, sine] = self.own;
        optimal * (x * x - sine * sine).sqrt() + slack * (1.0 + strain)
    }

    /// What the class's own state is at a normalized fibre length.
    fn state(&self, x: f64, drive: Drive) -> MuscleState {
        let equilibrium_state = match &self.model {
            MuscleModel::DeGrooteFregly2016(_) => self.fiber().tendon_force(x, drive.length).value,
            _ => x * self.own[0],
        };
        MuscleState { activation: drive.activation, equilibrium_state, fiber_velocity: 0.0 }
    }
}

/// Activation and a path that swings, both smooth.
#[derive(Clone, Copy)]
struct Swing {
    middle: f64,
    swing: f64,
}

impl DriveSource for Swing {
    fn drive(&self, time: f64, _: &mut Cursor) -> Drive {
        let activation = 0.45 + 0.4 * (9.0 * time + 0.3).sin();
        Drive { activation, length: self.middle + self.swing * (5.0 * time).sin() }
    }

    fn speed(&self, time: f64) -> f64 {
        self.swing * 5.0 * (5.0 * time).cos()
    }
}

const STATES: [(f64, f64, f64, f64); 6] = [
    (0.9, 0.05, 0.5, 0.02),
    (1.2, -0.3, 0.05, 0.03),
    (0.7, 0.02, 0.9, 0.01),
    (1.45, -0.02, 0.3, 0.035),
    (1.05, 0.01, 0.2, 0.001),
    (0.8, -0.1, 0.15, -0.01),
];

#[test]
fn verif_derivatives_of_the_balance_match_differences() {
    for case in Case::all() {
        let base = case.fiber();
        for (x, u, activation, strain) in STATES {
            let drive = Drive { activation, length: case.path(x, strain) };
            let at = base.residual(x, u, drive);
            let h = 1e-6;
            let by_x = (base.residual(x + h, u, drive).r - base.residual(x - h, u, drive).r) / (2.0 * h);
            let by_u = (base.residual(x, u + h, drive).r - base.residual(x, u - h, drive).r) / (2.0 * h);
            let name = &case.name;
            assert!((by_x - at.by_x).abs() < 1e-5 * (1.0 + by_x.abs()), "{name} {x}: by x {by_x} {}", at.by_x);
            assert!((by_u - at.by_u).abs() < 1e-6 * (1.0 + by_u.abs()), "{name} {x}: by u {by_u} {}", at.by_u);
            assert!(at.by_u > 0.0, "{name}: R does not increase with u");
            let by_parameters = base.residual_by_parameters(x, u, drive);
            for (k, found) in by_parameters.into_iter().enumerate() {
                let r = |sign: f64| {
                    let mut own = case.own;
                    own[k] += sign * 1e-7;
                    case.fiber_with(own).residual(x, u, drive).r
                };
                let difference = (r(1.0) - r(-1.0)) / 2e-7;
                assert!(
                    (difference - found).abs() < 2e-5 * (1.0 + difference.abs()),
                    "{name} {k}: {difference} {found}"
                );
            }
        }
    }
}

#[test]
fn verif_balance_in_parts_is_the_balance_to_the_last_bit() {
    for case in Case::all() {
        for length_by_activation in [0.0, 0.15] {
            let curves = FiberCurves { length_by_activation, ..(*case.curves).clone() };
            let fiber = Fiber::new(Arc::new(curves), case.own[0], case.own[1], case.own[2].asin());
            for (x, u, activation, strain) in STATES {
                let drive = Drive { activation, length: case.path(x, strain) };
                let known = fiber.undriven(x, u);
                let parts = fiber.imbalance(&known, activation, fiber.pull(&known, drive.length));
                assert_eq!(parts.to_bits(), fiber.residual(x, u, drive).r.to_bits(), "{}", case.name);
            }
        }
    }
}

#[test]
fn verif_velocity_is_that_of_the_muscle_model() {
    for case in Case::all() {
        let fiber = case.fiber();
        for (x, _, activation, strain) in STATES {
            if matches!(case.model, MuscleModel::DeGrooteFregly2016(_)) && strain < 0.0 {
                // Its tendon bears a compressive force there, at which the class's own state is out of bounds.
                continue;
            }
            if case.model.has_velocity_state() {
                // With a mass the velocity is a state; without it, it is that at which the mass would keep its speed.
                continue;
            }
            let drive = Drive { activation, length: case.path(x, strain) };
            let found = fiber.velocity(x, drive, 0.0) * case.curves.max_velocity * case.own[0];
            let expected = case.model.dynamics(case.state(x, drive), drive.length, 0.0).fiber_velocity;
            let tolerance = 1e-6 + 1e-8 * expected.abs();
            assert!((found - expected).abs() < tolerance, "{} {x}: {found} {expected}", case.name);
        }
    }
}

#[test]
fn verif_start_is_that_of_the_muscle_model() {
    for case in Case::all() {
        let fiber = case.fiber();
        for (x, activation, strain) in [(0.9, 0.5, 0.02), (1.1, 0.05, 0.005), (1.3, 0.3, 0.02)] {
            for speed in [0.0, 0.03, -0.05] {
                let drive = Drive { activation, length: case.path(x, strain) };
                let (found, _) = fiber.start(drive, speed);
                let state = case.model.equilibrium(drive.length, speed, activation).unwrap();
                let (found, expected) = match &case.model {
                    MuscleModel::DeGrooteFregly2016(_) => (fiber.tendon_force(found, drive.length).value, state),
                    _ => (found, state / case.own[0]),
                };
                // OpenSim ends its searches within 0.01 N (Schutte, Delp) or 1e-8 of the maximum force.
                let tolerance = if matches!(case.model, MuscleModel::Deprecated(_)) { 2e-5 } else { 1e-6 };
                assert!((found - expected).abs() < tolerance, "{} at {speed} m/s: {found} {expected}", case.name);
                let by = fiber.start_by_parameters(fiber.start(drive, speed).0, false, drive, speed);
                for (k, by) in by.into_iter().enumerate() {
                    let x = |sign: f64| {
                        let mut own = case.own;
                        own[k] += sign * 1e-6;
                        case.fiber_with(own).start(drive, speed).0
                    };
                    let difference = (x(1.0) - x(-1.0)) / 2e-6;
                    assert!((difference - by).abs() < 1e-4 * (1.0 + by.abs()), "{} {k}: {difference} {by}", case.name);
                }
            }
        }
    }
}

/// Activation from nothing, or nothing at all, along a path that swings from a taut tendon to a slack one.
#[derive(Clone, Copy)]
struct Resting {
    slack: f64,
    swing: f64,
    /// Activation at the end of a second.
    activation: f64,
}

impl DriveSource for Resting {
    fn drive(&self, time: f64, _: &mut Cursor) -> Drive {
        Drive { activation: self.activation * time, length: self.slack + self.swing * (6.0 * time).cos() }
    }

    fn speed(&self, time: f64) -> f64 {
        -6.0 * self.swing * (6.0 * time).sin()
    }
}

#[test]
fn verif_muscles_without_activation_are_followed() {
    let times: Vec<f64> = (0..100).map(|i| 0.01 * f64::from(i)).collect();
    let accuracy = FiberAccuracy::default();
    // Classes that take an activation of 0.
    for case in Case::all().into_iter().filter(|case| matches!(case.model, MuscleModel::Deprecated(_))) {
        for activation in [0.0, 0.3] {
            let motion = Resting { slack: case.path(1.0, 0.0), swing: 0.5 * case.own[0], activation };
            let fiber = case.fiber();
            let plan = StepPlan::build(&fiber, &motion, &times, &accuracy).unwrap();
            let mut out = vec![FiberSample::default(); times.len()];
            let [optimal, slack, sine] = case.own;
            let other = case.fiber_with([1.02 * optimal, slack, sine]);
            other.follow::<true>(&plan, &motion, &accuracy, |k, sample| out[k] = sample, |_| ()).unwrap();
            let numbers = out.iter().flat_map(|s| [s.x, s.rate].into_iter().chain(s.by_parameters));
            assert!(numbers.clone().all(f64::is_finite), "{} {activation}", case.name);
            println!("{} {activation}: {} steps", case.name, plan.len());
            assert!(plan.len() < 2000, "{} {activation}: {} steps", case.name, plan.len());
        }
    }
}

/// The class's own differential equation, integrated by very many Runge–Kutta steps: normalized tendon force per
/// sample.
fn brute_force(case: &Case, motion: Swing, times: &[f64], steps_per_sample: usize) -> Vec<f64> {
    let rates = |t: f64, [equilibrium_state, fiber_velocity]: [f64; 2]| {
        let drive = motion.drive(t, &mut Cursor::default());
        let state = MuscleState { activation: drive.activation, equilibrium_state, fiber_velocity };
        let rates = case.model.rates(state, drive.length, motion.speed(t));
        ([rates.equilibrium_state, rates.fiber_velocity], rates.tendon_force / case.model.max_isometric_force())
    };
    let moved = |y: [f64; 2], h: f64, by: [f64; 2]| [y[0] + h * by[0], y[1] + h * by[1]];
    let start = motion.drive(times[0], &mut Cursor::default());
    let (x, _) = case.fiber().start(start, motion.speed(times[0]));
    let mut y = [case.state(x, start).equilibrium_state, 0.0];
    let mut out = vec![rates(times[0], y).1];
    for pair in times.windows(2) {
        let h = (pair[1] - pair[0]) / steps_per_sample as f64;
        for i in 0..steps_per_sample {
            let t = pair[0] + h * i as f64;
            let k1 = rates(t, y).0;
            let k2 = rates(t + 0.5 * h, moved(y, 0.5 * h, k1)).0;
            let k3 = rates(t + 0.5 * h, moved(y, 0.5 * h, k2)).0;
            let k4 = rates(t + h, moved(y, h, k3)).0;
            y = [0, 1].map(|j| y[j] + h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
        }
        out.push(rates(pair[1], y).1);
    }
    out
}

/// Largest error of tendon force over maximum isometric force along a motion, and from which sample on it holds for a
/// muscle with a mass, which swings at first.
const FORCE_TOLERANCE: f64 = 3e-5;
const SWINGS: usize = 10;

#[test]
fn verif_integration_and_its_derivatives_match_brute_force_and_differences() {
    let times: Vec<f64> = (0..100).map(|i| 0.01 * f64::from(i)).collect();
    let accuracy = FiberAccuracy::default();
    for case in Case::all() {
        let motion = Swing { middle: case.path(1.0, 0.01), swing: 0.25 * case.own[0] };
        let fiber = case.fiber();
        let plan = StepPlan::build(&fiber, &motion, &times, &accuracy).unwrap();
        let follow = |fiber: &Fiber| {
            let mut out = vec![FiberSample::default(); times.len()];
            fiber.follow::<true>(&plan, &motion, &accuracy, |k, sample| out[k] = sample, |_| ()).unwrap();
            out
        };
        let found = follow(&fiber);
        let length = |t: f64| motion.drive(t, &mut Cursor::default()).length;
        let expected = brute_force(&case, motion, &times, 4000);
        let mut worst = 0.0_f64;
        let swings = if case.model.has_velocity_state() { SWINGS } else { 0 };
        for ((sample, t), expected) in found.iter().zip(&times).zip(&expected).skip(swings) {
            worst = worst.max((fiber.tendon_force(sample.x, length(*t)).value - expected).abs());
        }
        println!("{}: force within {worst:.1e}, {} steps", case.name, plan.len());
        assert!(worst < FORCE_TOLERANCE, "{}: {worst:e}", case.name);
        for k in 0..PARAMETERS {
            let step = 1e-6 * case.own[k];
            let moved = |sign: f64| {
                let mut own = case.own;
                own[k] += sign * step;
                follow(&case.fiber_with(own))
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            for (i, sample) in found.iter().enumerate() {
                let difference = (up[i].x - down[i].x) / (2.0 * step);
                let by = sample.by_parameters[k];
                assert!((difference - by).abs() < 1e-4 * (1.0 + by.abs()), "{} {k} {i}: {difference} {by}", case.name);
            }
        }
    }
}
