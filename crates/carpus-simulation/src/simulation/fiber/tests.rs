//! Fibre equation and integration against a second route: the muscle model itself, and brute force.

use std::sync::Arc;

use super::CurveCache;
use super::equation::{Drive, Fiber, FiberCurves, PARAMETERS};
use super::plan::StepPlan;
use super::step::{Cursor, DriveSource, FiberAccuracy, FiberSample};
use carpus_multibody::muscles::Millard2012;
use carpus_osim::osim::spec::{
    ActiveForceLengthSpec, FiberForceLengthSpec, ForceVelocitySpec, Location, Millard2012Spec, MuscleKind, MuscleSpec,
    PathSpec, TendonForceLengthSpec,
};

/// A muscle like ECRB with OpenSim's default curves.
pub(crate) fn muscle_spec(pennation: f64, fiber_damping: f64, ignore_tendon_compliance: bool) -> MuscleSpec {
    MuscleSpec {
        name: "test".into(),
        at: Location::default(),
        applies_force: true,
        path: PathSpec::default(),
        max_isometric_force: 100.0,
        optimal_fiber_length: 0.059,
        tendon_slack_length: 0.2285,
        pennation_angle_at_optimal: pennation,
        max_contraction_velocity: 10.0,
        ignore_tendon_compliance,
        ignore_activation_dynamics: false,
        min_control: 0.01,
        max_control: 1.0,
        kind: MuscleKind::Millard2012Equilibrium(Box::new(Millard2012Spec {
            fiber_damping,
            default_fiber_length: 0.059,
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
                minimum_value: 0.1,
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
                strain_at_one_norm_force: 0.033,
                stiffness_at_one_norm_force: None,
                norm_force_at_toe_end: None,
                curviness: None,
            },
        })),
    }
}

fn muscle(pennation: f64, fiber_damping: f64) -> Millard2012 {
    Millard2012::from_spec(&muscle_spec(pennation, fiber_damping, false)).unwrap()
}

fn tabulated(muscle: &Millard2012) -> Arc<FiberCurves> {
    let spec = muscle_spec(0.0, muscle.parameters().fiber_damping, muscle.ignore_tendon_compliance());
    let MuscleKind::Millard2012Equilibrium(properties) = &spec.kind else { unreachable!() };
    FiberCurves::tabulate(muscle, properties, &mut CurveCache::default())
}

fn fiber(muscle: &Millard2012) -> Fiber {
    let p = muscle.parameters();
    Fiber::new(tabulated(muscle), p.optimal_fiber_length, p.tendon_slack_length, p.pennation_angle_at_optimal)
}

/// Smooth activation and a path that moves through ±`swing` about a middle length.
#[derive(Clone, Copy)]
struct Motion {
    middle: f64,
    swing: f64,
}

impl Motion {
    fn speed(&self, time: f64) -> f64 {
        self.swing * 5.0 * (5.0 * time).cos()
    }
}

impl DriveSource for Motion {
    fn speed(&self, time: f64) -> f64 {
        Motion::speed(self, time)
    }

    fn drive(&self, time: f64, _: &mut Cursor) -> Drive {
        Drive {
            activation: 0.4 + 0.38 * (9.0 * time + 0.3).sin(),
            length: self.middle + self.swing * (5.0 * time).sin(),
        }
    }
}

const USUAL: Motion = Motion { middle: 0.291, swing: 0.012 };

/// The fibre's differential equation as the muscle model states it, integrated by very many Runge–Kutta steps.
fn brute_force(muscle: &Millard2012, motion: Motion, times: &[f64], steps_per_sample: usize) -> Vec<f64> {
    let rate = |t: f64, l: f64| {
        let drive = motion.drive(t, &mut Cursor::default());
        muscle.dynamics(l, drive.activation, drive.length, motion.speed(t)).fiber_velocity
    };
    let start = motion.drive(times[0], &mut Cursor::default());
    let mut l = muscle.equilibrium(start.length, start.activation).unwrap().fiber_length;
    let mut out = vec![l];
    for pair in times.windows(2) {
        let h = (pair[1] - pair[0]) / steps_per_sample as f64;
        for i in 0..steps_per_sample {
            let t = pair[0] + h * i as f64;
            let k1 = rate(t, l);
            let k2 = rate(t + 0.5 * h, l + 0.5 * h * k1);
            let k3 = rate(t + 0.5 * h, l + 0.5 * h * k2);
            let k4 = rate(t + h, l + h * k3);
            l += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
        out.push(l);
    }
    out
}

fn follow<const D: bool>(
    fiber: &Fiber,
    plan: &StepPlan,
    motion: Motion,
    accuracy: FiberAccuracy,
    samples: usize,
) -> Vec<FiberSample> {
    let mut out = vec![FiberSample::default(); samples];
    let mut emitted = 0;
    fiber
        .follow::<D>(
            plan,
            &motion,
            &accuracy,
            |k, sample| {
                assert_eq!(k, emitted);
                out[k] = sample;
                emitted += 1;
            },
            |_| (),
        )
        .unwrap();
    assert_eq!(emitted, samples);
    out
}

fn sample_times(count: usize, interval: f64) -> Vec<f64> {
    (0..count).map(|i| interval * i as f64).collect()
}

#[test]
fn verif_residual_derivatives_match_differences() {
    for (pennation, damping) in [(0.0, 0.1), (0.25, 0.1), (0.25, 0.0)] {
        let muscle = muscle(pennation, damping);
        let curves = tabulated(&muscle);
        let make = |p: [f64; 3]| Fiber::new(Arc::clone(&curves), p[0], p[1], p[2].asin());
        let p0 = [0.059, 0.2285, f64::sin(pennation)];
        let base = make(p0);
        for (x, u, activation, length) in
            [(0.9, 0.05, 0.5, 0.289), (1.2, -0.3, 0.05, 0.302), (0.6, 0.2, 0.9, 0.27), (1.5, -0.02, 0.3, 0.32)]
        {
            let drive = Drive { activation, length };
            let at = base.residual(x, u, drive);
            let h = 1e-6;
            let by_x = (base.residual(x + h, u, drive).r - base.residual(x - h, u, drive).r) / (2.0 * h);
            let by_u = (base.residual(x, u + h, drive).r - base.residual(x, u - h, drive).r) / (2.0 * h);
            assert!((by_x - at.by_x).abs() < 1e-5 * (1.0 + by_x.abs()), "{x} {by_x} {}", at.by_x);
            assert!((by_u - at.by_u).abs() < 1e-6 * (1.0 + by_u.abs()));
            let by_p = base.residual_by_parameters(x, u, drive);
            let force = base.tendon_force(x, length);
            for k in 0..PARAMETERS {
                if k == 2 && pennation == 0.0 {
                    continue; // one-sided: the sine cannot be negative
                }
                let shifted = |sign: f64| {
                    let mut p = p0;
                    p[k] += sign * 1e-7;
                    make(p)
                };
                let r = |f: &Fiber| f.residual(x, u, drive).r;
                let difference = (r(&shifted(1.0)) - r(&shifted(-1.0))) / 2e-7;
                assert!(
                    (difference - by_p[k]).abs() < 1e-5 * (1.0 + difference.abs()),
                    "{k}: {difference} {}",
                    by_p[k]
                );
                let f = |f: &Fiber| f.tendon_force(x, length).value;
                let difference = (f(&shifted(1.0)) - f(&shifted(-1.0))) / 2e-7;
                assert!((difference - force.by_parameters[k]).abs() < 1e-5 * (1.0 + difference.abs()));
            }
        }
    }
}

#[test]
fn verif_imbalance_in_parts_is_the_residual_to_the_last_bit() {
    for (pennation, damping, by_activation) in [(0.0, 0.1, 0.0), (0.25, 0.1, 0.15), (0.25, 0.0, 0.0), (0.1, 0.0, 0.15)]
    {
        let muscle = muscle(pennation, damping);
        let curves = FiberCurves { length_by_activation: by_activation, ..(*tabulated(&muscle)).clone() };
        let fiber = Fiber::new(Arc::new(curves), 0.059, 0.2285, pennation);
        // Below the shortest length, too.
        for (x, u) in [(0.9, 0.05), (1.2, -0.3), (0.6, 0.2), (1.5, -0.02), (0.3, 0.0)] {
            let known = fiber.undriven(x, u);
            for (activation, length) in [(0.5, 0.289), (0.05, 0.302), (0.9, 0.27)] {
                let parts = fiber.imbalance(&known, activation, fiber.pull(&known, length));
                assert_eq!(parts.to_bits(), fiber.residual(x, u, Drive { activation, length }).r.to_bits());
            }
        }
    }
}

#[test]
fn verif_velocity_and_equilibrium_agree_with_the_muscle_model() {
    for (pennation, damping) in [(0.0, 0.1), (0.25, 0.1), (0.25, 0.0)] {
        let muscle = muscle(pennation, damping);
        let fiber = fiber(&muscle);
        for (l, activation, length) in [(0.05, 0.4, 0.287), (0.07, 0.01, 0.3), (0.06, 0.9, 0.292), (0.035, 0.6, 0.26)] {
            let drive = Drive { activation, length };
            let expected = muscle.dynamics(l, activation, length, 0.0).fiber_velocity;
            let found = fiber.velocity(l / 0.059, drive, 0.0) * 10.0 * 0.059;
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
            let expected = muscle.equilibrium(length, activation).unwrap();
            let (x, _) = fiber.static_equilibrium(drive);
            assert!((x * 0.059 - expected.fiber_length).abs() < 1e-7, "{} {}", x * 0.059, expected.fiber_length);
            let force = fiber.tendon_force(x, length).value * 100.0;
            assert!((force - expected.tendon_force).abs() < 1e-4, "{force} {}", expected.tendon_force);
        }
    }
}

#[test]
fn verif_integration_matches_brute_force() {
    let times = sample_times(101, 0.01);
    // Damping 0 stays slow: the undamped fibre is much stiffer than the damped one.
    for (pennation, damping, steps) in [(0.0, 0.1, 200), (0.25, 0.1, 200), (0.25, 0.0, 2000)] {
        let muscle = muscle(pennation, damping);
        let fiber = fiber(&muscle);
        let reference = brute_force(&muscle, USUAL, &times, steps);
        let accuracy = FiberAccuracy::default();
        let plan = StepPlan::build(&fiber, &USUAL, &times, &accuracy).unwrap();
        let found = follow::<false>(&fiber, &plan, USUAL, accuracy, times.len());
        let (mut length_error, mut force_error) = (0.0_f64, 0.0_f64);
        for (k, (sample, l)) in found.iter().zip(&reference).enumerate() {
            let length = USUAL.drive(times[k], &mut Cursor::default()).length;
            let force = fiber.tendon_force(sample.x, length).value;
            let expected = fiber.tendon_force(l / 0.059, length).value;
            length_error = length_error.max((sample.x - l / 0.059).abs());
            force_error = force_error.max((force - expected).abs());
        }
        println!(
            "pennation {pennation} damping {damping}: {} steps, errors {length_error:.1e} of optimal length, \
             {force_error:.1e}·Fmax",
            plan.len()
        );
        assert!(force_error < 1e-5, "{force_error:e}");
    }
}

#[test]
fn verif_integration_converges_when_steps_are_refined() {
    let muscle = muscle(0.15, 0.1);
    let fiber = fiber(&muscle);
    let times = sample_times(81, 0.0125);
    let run = |tolerance: f64| {
        let accuracy = FiberAccuracy { tolerance, max_step: 0.02 };
        let plan = StepPlan::build(&fiber, &USUAL, &times, &accuracy).unwrap();
        (plan.len(), follow::<false>(&fiber, &plan, USUAL, accuracy, times.len()))
    };
    let (_, finest) = run(1e-11);
    let errors = [1e-4, 1e-6, 1e-8].map(|tolerance| {
        let (steps, samples) = run(tolerance);
        let error = samples.iter().zip(&finest).map(|(a, b)| (a.x - b.x).abs()).fold(0.0, f64::max);
        println!("tolerance {tolerance:.0e}: {steps} steps, error {error:.1e}");
        error
    });
    assert!(errors[0] < 1e-4 && errors[1] < 1e-6 && errors[2] < 1e-8);
    assert!(errors[2] < 1e-2 * errors[0].max(1e-7));
}

#[test]
fn verif_sensitivities_match_differences_of_whole_runs() {
    let times = sample_times(61, 0.01);
    for damping in [0.1, 0.0] {
        let muscle = muscle(0.25, damping);
        let curves = tabulated(&muscle);
        let make = |p: [f64; 3]| Fiber::new(Arc::clone(&curves), p[0], p[1], p[2].asin());
        let p0 = [0.059, 0.2285, f64::sin(0.25)];
        let base = make(p0);
        // A lax tolerance, so that no step is divided and both sides of a difference take the same steps.
        let accuracy = FiberAccuracy::default();
        let plan = StepPlan::build(&base, &USUAL, &times, &accuracy).unwrap();
        let lax = FiberAccuracy { tolerance: 1e-3, ..accuracy };
        let with = follow::<true>(&base, &plan, USUAL, lax, times.len());
        let without = follow::<false>(&base, &plan, USUAL, lax, times.len());
        // Without derivatives, the base's samples are those that the plan was made with: the same steps, solved anew.
        for (a, b) in with.iter().zip(&without) {
            assert!((a.x - b.x).abs() < 1e-9 && (a.rate - b.rate).abs() < 1e-6, "{a:?} {b:?}");
        }
        let near = make([1.001 * p0[0], p0[1], p0[2]]);
        let with_near = follow::<true>(&near, &plan, USUAL, lax, times.len());
        for (a, b) in with_near.iter().zip(&follow::<false>(&near, &plan, USUAL, lax, times.len())) {
            assert_eq!(a.x, b.x);
        }
        for k in 0..PARAMETERS {
            let scale = with.iter().map(|s| s.by_parameters[k].abs()).fold(0.0, f64::max);
            let h = 1e-5 * p0[k];
            let run = |sign: f64| {
                let mut p = p0;
                p[k] += sign * h;
                follow::<false>(&make(p), &plan, USUAL, lax, times.len())
            };
            let (up, down) = (run(1.0), run(-1.0));
            let worst = (0..times.len())
                .map(|i| ((up[i].x - down[i].x) / (2.0 * h) - with[i].by_parameters[k]).abs())
                .fold(0.0, f64::max);
            println!("damping {damping} parameter {k}: {:.1e} relative", worst / scale);
            assert!(worst < 1e-6 * scale, "damping {damping}, parameter {k}: {worst:e} of {scale:e}");
        }
    }
}

#[test]
fn verif_slack_tendon_lets_the_fibre_shorten_to_its_limit_and_picks_up_again() {
    // The path is far too short for the tendon for most of the time.
    let motion = Motion { middle: 0.25, swing: 0.03 };
    let muscle = muscle(0.1, 0.1);
    let fiber = fiber(&muscle);
    let times = sample_times(201, 0.01);
    let accuracy = FiberAccuracy::default();
    let plan = StepPlan::build(&fiber, &motion, &times, &accuracy).unwrap();
    let found = follow::<false>(&fiber, &plan, motion, accuracy, times.len());
    let reference = brute_force(&muscle, motion, &times, 400);
    let mut slack = 0;
    for (k, sample) in found.iter().enumerate() {
        assert!(sample.x >= fiber.shortest - 1e-6);
        let length = motion.drive(times[k], &mut Cursor::default()).length;
        let force = fiber.tendon_force(sample.x, length).value;
        let expected = fiber.tendon_force(reference[k] / 0.059, length).value;
        assert!((force - expected).abs() < 2e-5, "t = {}: {force} {expected}", times[k]);
        slack += usize::from(force < 1e-6);
    }
    assert!(slack > 20 && slack < 190, "{slack} slack samples");
}

#[test]
fn verif_fibre_stopped_by_its_pennation_limit_rests_until_pulled() {
    // A steep pennation makes the shortest fibre one that still has active force, so that the limit is really hit.
    let motion = Motion { middle: 0.24, swing: 0.03 };
    let muscle = muscle(0.9, 0.1);
    let fiber = fiber(&muscle);
    assert!(fiber.shortest > 0.6);
    let times = sample_times(201, 0.01);
    let accuracy = FiberAccuracy::default();
    let plan = StepPlan::build(&fiber, &motion, &times, &accuracy).unwrap();
    let found = follow::<false>(&fiber, &plan, motion, accuracy, times.len());
    let reference = brute_force(&muscle, motion, &times, 2000);
    let resting = found.iter().filter(|s| (s.x - fiber.shortest).abs() < 1e-9).count();
    let mut worst = 0.0_f64;
    for (k, sample) in found.iter().enumerate() {
        let length = motion.drive(times[k], &mut Cursor::default()).length;
        let force = fiber.tendon_force(sample.x, length).value;
        let expected = fiber.tendon_force(reference[k] / 0.059, length).value;
        worst = worst.max((force - expected).abs());
    }
    println!("{resting} of {} samples rest; force error {worst:.1e}·Fmax", times.len());
    assert!(resting > 10);
    assert!(worst < 1e-4, "{worst:e}");
}

#[test]
fn verif_rigid_tendon_matches_the_muscle_model_and_its_differences() {
    let muscle = Millard2012::from_spec(&muscle_spec(0.25, 0.1, true)).unwrap();
    let curves = tabulated(&muscle);
    let make = |p: [f64; 3]| Fiber::new(Arc::clone(&curves), p[0], p[1], p[2].asin());
    let p0 = [0.059, 0.2285, f64::sin(0.25)];
    for (activation, length, speed) in
        [(0.5, 0.287, 0.03), (0.2, 0.3, -0.2), (0.9, 0.27, 0.0), (0.3, 0.22, 0.1), (0.01, 0.275, -0.6)]
    {
        let sample = make(p0).rigid_tendon(activation, length, speed);
        let expected = muscle.dynamics(0.06, activation, length, speed).tendon_force / 100.0;
        assert!((sample.force - expected).abs() < 1e-8, "{} {expected}", sample.force);
        for k in 0..PARAMETERS {
            let shifted = |sign: f64| {
                let mut p = p0;
                p[k] += sign * 1e-7;
                make(p).rigid_tendon(activation, length, speed).force
            };
            let difference = (shifted(1.0) - shifted(-1.0)) / 2e-7;
            assert!((difference - sample.by_parameters[k]).abs() < 1e-5 * (1.0 + difference.abs()));
        }
    }
}
