//! Whether effects show as their descriptions say.

use carpus::effects::effect::FlippedArm;
use carpus::effects::forward_model::Setting;

use super::*;

const HELD: [&str; 2] = ["isometric_50_flexion_+30deg_1", "isometric_50_flexion_-30deg_1"];
const MOVING: [&str; 2] = ["isotonic_50_extension_1", "isotonic_25_flexion_1"];

/// What an effect of one scale adds to the moment of a trial.
fn added(forward: &ForwardModel, trial: usize, id: &str) -> Vec<f64> {
    added_by(forward, trial, &sized(named(id), 1.0))
}

fn added_by(forward: &ForwardModel, trial: usize, setting: &Setting) -> Vec<f64> {
    difference(&moment(forward, trial, std::slice::from_ref(setting)), &moment(forward, trial, &[]))
}

/// Trials whose joint does not move at all.
fn perfectly_held() -> ForwardModel {
    forward_with(&HELD, |trial| {
        let middle = trial.angle[trial.angle.len() / 2];
        trial.angle.fill(middle);
    })
}

#[test]
fn verif_what_needs_motion_does_nothing_when_the_joint_is_held() {
    /// Rounding of speed and acceleration of a constant angle, in their moments [N·m].
    const NOTHING: f64 = 1e-9;
    let held = perfectly_held();
    let moving = forward_with(&MOVING, |_| ());
    for id in [
        "joint_damping",
        "power_law_damping",
        "coulomb_friction",
        "thixotropy",
        "stretch_reflex",
        "inertia",
        "history_dependence",
    ] {
        for trial in 0..HELD.len() {
            let size = largest(added(&held, trial, id));
            assert!(size < NOTHING, "{id} adds {size:.1e} N·m to a held joint");
        }
        assert!((0..MOVING.len()).any(|t| largest(added(&moving, t, id)) > 1e-4), "{id} does nothing in motion");
    }
}

#[test]
fn verif_what_the_joint_adds_does_not_depend_on_effort() {
    /// Rounding [N·m].
    const NOTHING: f64 = 1e-12;
    let full = forward_with(&MOVING, |_| ());
    let half = forward_with(&MOVING, |trial| trial.excitation.iter_mut().flatten().for_each(|e| *e *= 0.5));
    for id in [
        "joint_stiffness",
        "end_range_spring",
        "ligament_stop",
        "joint_damping",
        "power_law_damping",
        "coulomb_friction",
        "thixotropy",
        "gravity",
        "inertia",
        "torque_offset",
        "torque_drift",
    ] {
        for trial in 0..MOVING.len() {
            let change = largest(difference(&added(&full, trial, id), &added(&half, trial, id)));
            assert!(change < NOTHING, "{id} changes by {change:.1e} N·m with effort");
        }
    }
    for id in ["stretch_reflex", "moment_arm_slope", "moment_arm_shift", "torque_gain", "axis_misalignment"] {
        let change = (0..MOVING.len()).map(|t| largest(difference(&added(&full, t, id), &added(&half, t, id))));
        assert!(largest(change) > 1e-4, "{id} should follow effort");
    }
}

#[test]
fn verif_signs_and_shapes_of_the_joints_moments() {
    let forward = forward_with(&["passive_1"], |_| ());
    let setting = |id: &str, values: &[f64]| Setting { effect: named(id), values: values.to_vec() };
    let kinematics = forward.base(0).kinematics();
    let check = |id: &str, values: &[f64], law: &dyn Fn(f64, f64, f64) -> f64| {
        let found = added_by(&forward, 0, &setting(id, values));
        for k in 0..found.len() {
            let expected = law(kinematics.angle[k], kinematics.speed[k], kinematics.acceleration[k]);
            assert!((found[k] - expected).abs() < 1e-12, "{id} at sample {k}: {} instead of {expected}", found[k]);
        }
    };
    check("joint_stiffness", &[1.3, 0.1], &|q, _, _| -1.3 * (q - 0.1));
    check("joint_damping", &[0.07], &|_, v, _| -0.07 * v);
    check("inertia", &[0.004], &|_, _, a| -0.004 * a);
    check("gravity", &[0.4, -0.2], &|q, _, _| -0.4 * q.cos() + 0.2 * q.sin());
    check("torque_offset", &[0.25], &|_, _, _| 0.25);
    check("end_range_spring", &[1.2, 0.5, 5.0, 4.0], &|q, _, _| {
        let end = std::f64::consts::FRAC_PI_2;
        1.2 * (-5.0 * (q + end)).exp() - 0.5 * (4.0 * (q - end)).exp()
    });
    // Against the motion, a step at reversal, not more than breakaway friction.
    let friction = added_by(&forward, 0, &setting("coulomb_friction", &[0.2, 1.25, 0.03]));
    for (f, v) in friction.iter().zip(&kinematics.speed) {
        assert!(f * v <= 0.0 && f.abs() <= 0.25);
        if v.abs() > 0.3 {
            assert!((f.abs() - 0.2).abs() < 1e-4, "{f} at {v} rad/s");
        }
    }
    // A hinge: nothing inside the limits, the line of a spring beyond the transition.
    for [flexion, extension] in [[0.3, 0.4], [0.3, 10.0]] {
        let stop = added_by(&forward, 0, &setting("ligament_stop", &[3.0, flexion, extension]));
        for (f, q) in stop.iter().zip(&kinematics.angle) {
            match q.abs() - if *q > 0.0 { flexion } else { extension } {
                beyond if beyond <= 0.0 => assert_eq!(*f, 0.0),
                beyond if beyond > 0.0175 => assert!((f + 3.0 * beyond * q.signum()).abs() < 1e-12),
                _ => (),
            }
        }
    }
}

#[test]
fn verif_effects_on_emg_do_nothing_without_emg() {
    let silent = forward_with(&MOVING, |trial| trial.excitation.iter_mut().flatten().for_each(|e| *e = 0.0));
    for id in [
        "emg_floor",
        "emg_crosstalk",
        "emg_gain",
        "emg_gain_drift",
        "electromechanical_delay",
        "emg_nonlinearity",
        "potentiation",
        "fatigue",
    ] {
        for trial in 0..MOVING.len() {
            assert_eq!(largest(added(&silent, trial, id)), 0.0, "{id}");
        }
    }
}

#[test]
fn verif_drifts_follow_the_session() {
    let forward = forward_with(&[HELD[0], MOVING[0], HELD[1]], |_| ());
    for id in ["torque_drift", "emg_gain_drift"] {
        assert_eq!(largest(added(&forward, 0, id)), 0.0, "{id} in the first trial");
        assert!(largest(added(&forward, 2, id)) > 1e-3, "{id} in the last trial");
    }
    let fatigue = added(&forward, 2, "fatigue");
    let potentiation = added(&forward, 2, "potentiation");
    let middle = fatigue.len() / 2;
    assert!(fatigue[middle] * potentiation[middle] < 0.0, "fatigue and potentiation go opposite ways");
}

#[test]
fn verif_an_arm_turned_over_turns_the_sign_of_gravity_alone() {
    let with_arm = |flipped: bool| forward_with(&["passive_1"], |trial| trial.info.arm_flipped = flipped);
    let (upright, flipped) = (with_arm(false), with_arm(true));
    let mut reversed = Vec::new();
    for &effect in CATALOGUE {
        let id = effect.description().id;
        let [up, down] = [&upright, &flipped].map(|forward| added_by(forward, 0, &sized(effect, 1.0)));
        match effect.description().behaviour.flipped_arm {
            FlippedArm::Same => assert!(same_bits(&up, &down), "{id}"),
            FlippedArm::Reversed => {
                assert!(largest(up.iter().copied()) > 0.1, "{id}");
                assert!(largest(up.iter().zip(&down).map(|(up, down)| up + down)) < 1e-12, "{id}");
                reversed.push(id);
            }
        }
    }
    assert_eq!(reversed, ["gravity"]);
}

#[test]
fn verif_rows_that_are_left_out_keep_their_place_in_the_session() {
    let stems = [HELD[1], HELD[0], MOVING[1]];
    let sessions = |forward: ForwardModel| forward.trials.iter().map(|t| t.session).collect::<Vec<_>>();
    // Rows 10, 12 and 18 of the participant, from 0.
    let from_the_table = forward_with(&stems, |trial| assert!([10, 12, 18].contains(&trial.info.place)));
    assert_eq!(sessions(from_the_table), [0.0, 0.25, 1.0]);
    assert_eq!(sessions(forward_with(&stems, |trial| trial.info.place = 0)), [0.0, 0.5, 1.0]);
    let timed = |trial: &mut Trial| trial.info.start_time = Some(10.0 * trial.info.place as f64 - 20.0);
    assert_eq!(sessions(forward_with(&stems, timed)), [0.0, 0.25, 1.0]);
    // Start times of some are those of none.
    let some = |trial: &mut Trial| trial.info.start_time = (trial.info.place == 12).then_some(1.0);
    assert_eq!(sessions(forward_with(&stems, some)), [0.0, 0.25, 1.0]);
}

#[test]
fn verif_a_shift_of_clocks_and_a_slow_sensor_do_nothing_to_a_constant_moment() {
    /// Of the simulated moment where it settles [N·m].
    const SETTLED: f64 = 1e-6;
    let constant = forward_with(&HELD[..1], |trial| {
        let (angle, n) = (trial.angle[10], trial.time.len());
        trial.angle.fill(angle);
        trial.excitation.iter_mut().for_each(|e| *e = vec![0.3; n]);
    });
    for id in ["time_shift", "sensor_bandwidth", "electromechanical_delay", "max_contraction_velocity"] {
        let size = largest(added(&constant, 0, id));
        assert!(size < SETTLED, "{id} adds {size:.1e} N·m");
    }
}

#[test]
fn verif_gains_are_gains() {
    let forward = forward_with(&HELD, |_| ());
    for trial in 0..HELD.len() {
        let base = moment(&forward, trial, &[]);
        let gained = added_by(&forward, trial, &Setting { effect: named("torque_gain"), values: vec![0.04] });
        assert!(largest(base.iter().zip(&gained).map(|(b, g)| 0.04 * b - g)) < 1e-12);
    }
}

#[test]
fn verif_optimal_length_follows_activation() {
    // With λ > 0 the fibre at low activation is on a curve stretched by 1 + λ(1 − a): at full activation nothing
    // changes.
    let at = |level: f64| {
        forward_with(&HELD[..1], |trial| {
            let n = trial.time.len();
            trial.excitation.iter_mut().for_each(|e| *e = vec![level; n]);
        })
    };
    let last = |forward: &ForwardModel| *added(forward, 0, "activation_dependent_length").last().unwrap();
    let (full, low) = (last(&at(1.0)).abs(), last(&at(0.3)).abs());
    assert!(full < 1e-9, "{full:.1e} N·m at full activation");
    assert!(low > 1e-3, "{low:.1e} N·m at activation 0.3");
}

#[test]
fn verif_shapes_bend_effects_as_their_equations_say() {
    let forward = forward_with(&["passive_1"], |_| ());
    let setting = |id: &str, values: &[f64]| Setting { effect: named(id), values: values.to_vec() };
    let speed = &forward.base(0).kinematics().speed;
    // A power of speed wherever the joint moves.
    let saturating = added_by(&forward, 0, &setting("power_law_damping", &[0.3, 0.2, 0.001]));
    for (found, v) in saturating.iter().zip(speed).filter(|(_, v)| v.abs() > 0.1) {
        let expected = -0.3 * v.signum() * v.abs().powf(0.2);
        assert!((found - expected).abs() < 1e-4, "{found} instead of {expected} at {v} rad/s");
    }
    // The later a reflex, the later its largest moment; where it saturates at once it is damping.
    let peak = |delay: f64| {
        let moment = added_by(&forward, 0, &setting("stretch_reflex", &[0.2, delay, 1.0]));
        (0..moment.len()).max_by(|a, b| moment[*a].abs().total_cmp(&moment[*b].abs())).unwrap()
    };
    assert!(peak(0.08) > peak(0.02), "{} {}", peak(0.08), peak(0.02));
    // All but the end of a drift is earlier where it slackens.
    let drifting = forward_with(&[HELD[0], MOVING[0], HELD[1]], |_| ());
    let drift = |slackening: f64, trial: usize| {
        largest(added_by(&drifting, trial, &setting("torque_drift", &[0.2, slackening])))
    };
    let session = drifting.trials[1].session;
    let expected = 0.2 * (session + 0.5 * session * (1.0 - session));
    assert!((drift(0.5, 1) - expected).abs() < 1e-12 && drift(0.5, 1) > drift(0.0, 1));
    assert!((drift(0.5, 2) - drift(0.0, 2)).abs() < 1e-12);
    // A fatigue that saturates takes less.
    let fatigue = |saturation: f64| largest(added_by(&drifting, 2, &setting("fatigue", &[1.0, saturation])));
    assert!(fatigue(0.5) < fatigue(0.0));
    // Limits that overlap are none that OpenSim takes.
    let native = |values: &[f64]| named("ligament_stop").native_form(values, 0.0);
    assert!(native(&[1.0, 0.3, 0.4]).is_some() && native(&[1.0, -0.1, 0.05]).is_none());
    // The axis' offset along the arm is a gain at the neutral angle.
    let base = moment(&forward, 0, &[]);
    let off = added_by(&forward, 0, &setting("axis_misalignment", &[0.0, 0.1]));
    for (k, q) in forward.trials[0].angle.iter().enumerate() {
        assert!((off[k] - 0.1 * q.cos() * base[k]).abs() < 1e-12);
    }
}
