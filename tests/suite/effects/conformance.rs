//! What every effect has to do.

use carpus::effects::effect::{ExcitationScope, OsimForm, Role, Stage};
use carpus::effects::forward_model::{DIAGNOSIS_ACCURACY, Setting};
use carpus::simulation::{Options, Recording};

use super::*;

/// Identifiers that the design fixes.
const CONTRACT: [&str; 36] = [
    "joint_stiffness",
    "end_range_spring",
    "ligament_stop",
    "joint_damping",
    "power_law_damping",
    "coulomb_friction",
    "thixotropy",
    "stretch_reflex",
    "gravity",
    "inertia",
    "moment_arm_shift",
    "moment_arm_slope",
    "angle_offset",
    "joint_compliance",
    "axis_misalignment",
    "tendon_compliance",
    "max_contraction_velocity",
    "active_force_width",
    "passive_fiber_force",
    "activation_dependent_length",
    "fatigue",
    "potentiation",
    "history_dependence",
    "unmodelled_muscles",
    "electromechanical_delay",
    "activation_dynamics",
    "emg_nonlinearity",
    "emg_crosstalk",
    "emg_gain_drift",
    "emg_floor",
    "emg_gain",
    "torque_offset",
    "torque_gain",
    "torque_drift",
    "time_shift",
    "sensor_bandwidth",
];

/// Effects that the bundled model cannot show: it has no muscle that the study does not activate.
const WITHOUT_INFLUENCE_HERE: [&str; 1] = ["unmodelled_muscles"];

/// Values at the ends of what is plausible; three standard deviations where a value is a change of a muscle's property.
fn extremes(effect: &'static dyn Effect) -> Vec<Setting> {
    let parameters = effect.description().parameters;
    let direct = effect.reported(&vec![0.25; parameters.len()], &forward().muscles) == vec![0.25; parameters.len()];
    let mut all = Vec::new();
    for end in 0..2 {
        let mut setting = Setting::absent(effect);
        for (value, p) in setting.values.iter_mut().zip(parameters) {
            let spread = [-3.0, 3.0][end] * p.scale;
            *value = if direct { p.plausible[end] } else { p.start + spread };
        }
        all.push(setting);
    }
    all
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn verif_the_catalogue_is_that_of_the_design() {
    let mut ours: Vec<&str> = descriptions().map(|d| d.id).collect();
    let mut theirs = CONTRACT.to_vec();
    ours.sort_unstable();
    theirs.sort_unstable();
    assert_eq!(ours, theirs);
}

#[test]
fn verif_descriptions_are_complete_and_consistent() {
    for d in descriptions() {
        for (what, text) in [
            ("name", d.name),
            ("equation", d.equation),
            ("signature", d.signature),
            ("experiment", d.experiment),
            (
                "form",
                match d.osim_form {
                    OsimForm::Native(text) | OsimForm::Controls(text) | OsimForm::SideCar(text) => text,
                },
            ),
        ] {
            assert!(!text.trim().is_empty(), "{}: {what} is empty", d.id);
        }
        assert!(d.id.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{}", d.id);
        assert!(d.amplitudes().next().is_some(), "{}: nothing turns it off", d.id);
        for rival in d.rivals {
            assert!(effect(rival).is_some(), "{}: rival {rival} is no effect", d.id);
            assert_ne!(*rival, d.id);
        }
        for p in d.parameters {
            let name = format!("{}.{}", d.id, p.name);
            assert!(!p.unit.is_empty() && !p.source.is_empty(), "{name}: unit and source");
            assert!(p.scale > 0.0 && p.scale.is_finite(), "{name}: scale {}", p.scale);
            assert!(p.plausible[0] < p.plausible[1], "{name}: plausible {:?}", p.plausible);
            match p.role {
                Role::Amplitude => assert_eq!(p.start, 0.0, "{name}: absent at 0"),
                Role::Shape => {
                    assert!(p.plausible[0] <= p.start && p.start <= p.plausible[1], "{name}: start {}", p.start);
                }
            }
        }
    }
}

#[test]
fn verif_units_are_those_of_si() {
    let known = [
        "1",
        "s",
        "m",
        "rad",
        "1/rad",
        "rad/s",
        "N·m",
        "N·m/rad",
        "N·m·s/rad",
        "kg·m²",
        "rad/(N·m)",
        "N·m·(s/rad)^p",
        "N·m at 90° extension",
        "N·m at 90° flexion",
        "N·m per session",
        "1 per session",
        "1/min of full excitation",
        "optimal fibre lengths/s",
    ];
    for d in descriptions() {
        for p in d.parameters {
            assert!(known.contains(&p.unit), "{}.{}: unit \"{}\"", d.id, p.name, p.unit);
        }
    }
}

#[test]
fn verif_an_absent_effect_changes_nothing_to_the_last_bit() {
    let forward = forward();
    for trial in 0..TRIALS.len() {
        let base = moment(forward, trial, &[]);
        for effect in CATALOGUE.iter().copied() {
            let id = effect.description().id;
            let absent = Setting::absent(effect);
            assert!(absent.is_absent() && same_bits(&base, &moment(forward, trial, &[absent])), "{id} at 0");
            for mut other in extremes(effect) {
                let d = effect.description();
                d.amplitudes().for_each(|i| other.values[i] = 0.0);
                assert!(same_bits(&base, &moment(forward, trial, &[other])), "{id} at 0 with another shape");
            }
        }
    }
}

#[test]
fn verif_moments_are_as_accurate_as_a_diagnosis_needs() {
    /// A fifth of the least noise that a sensor is taken to have [N·m].
    const LIMIT: f64 = 1e-3;
    let (_, file, model) = study();
    let trials: Vec<Trial> = TRIALS.iter().map(|stem| trial(stem)).collect();
    let forward = ForwardModel::with_accuracy(&file.spec, model, &trials, DIAGNOSIS_ACCURACY).unwrap();
    for (g, stem) in TRIALS.iter().enumerate() {
        let options = Options { allow_angle_outside_range: true, ..Options::default() };
        let prepared = model.prepare(&Recording::from(&trial(stem)), &options).unwrap();
        let accurate = prepared.simulate(&model.nominal_parameters()).unwrap().moment;
        let error = largest(difference(&moment(&forward, g, &[]), &accurate));
        println!("{stem}: {error:.1e} N·m of {:.1}", largest(accurate));
        assert!(error < LIMIT, "{stem}: {error:.1e} N·m");
    }
}

#[test]
fn verif_a_present_effect_changes_something() {
    let forward = forward();
    for effect in CATALOGUE.iter().copied() {
        let id = effect.description().id;
        let changed = (0..TRIALS.len())
            .any(|trial| !same_bits(&moment(forward, trial, &[]), &moment(forward, trial, &[sized(effect, 1.0)])));
        assert_eq!(changed, !WITHOUT_INFLUENCE_HERE.contains(&id), "{id}");
    }
}

#[test]
fn verif_effects_compose_in_one_order_however_they_are_listed() {
    let forward = forward();
    let all: Vec<Setting> = CATALOGUE.iter().map(|e| sized(*e, 0.3)).collect();
    let mut reversed = all.clone();
    reversed.reverse();
    let mut rotated = all.clone();
    rotated.rotate_left(all.len() / 3);
    for trial in 0..TRIALS.len() {
        let expected = moment(forward, trial, &all);
        assert!(expected.iter().all(|m| m.is_finite()));
        assert!(same_bits(&expected, &moment(forward, trial, &reversed)), "reversed, trial {trial}");
        assert!(same_bits(&expected, &moment(forward, trial, &rotated)), "rotated, trial {trial}");
    }
}

#[test]
fn verif_derivatives_at_zero_are_finite_and_agree_from_both_sides() {
    /// Relative to the largest derivative: what curvature over the difference's step may add.
    const ONE_SIDED: f64 = 0.02;
    /// Effects with a kink at 0, where both sides need only be finite: an excitation is cut off at 0, and a recording
    /// that is linear between its samples, shifted, moves along the slope before or behind each sample.
    const KINKS: [&str; 4] = ["emg_floor", "emg_crosstalk", "electromechanical_delay", "time_shift"];
    let forward = forward();
    let mut worst = (0.0_f64, "");
    for effect in CATALOGUE.iter().copied() {
        let d = effect.description();
        for i in d.amplitudes() {
            let at = |trial: usize, step: f64| {
                let mut setting = Setting::absent(effect);
                setting.values[i] = step * d.parameters[i].scale;
                moment(forward, trial, &[setting])
            };
            for trial in 0..TRIALS.len() {
                let (base, h) = (at(trial, 0.0), 1e-3);
                let slope =
                    |step: f64| difference(&at(trial, step), &base).iter().map(|m| m / step).collect::<Vec<_>>();
                let (up, down) = (slope(h), slope(-h));
                let size = largest(up.iter().chain(&down).copied());
                assert!(size.is_finite(), "{} {}", d.id, d.parameters[i].name);
                if size < 1e-9 || KINKS.contains(&d.id) {
                    continue;
                }
                let sides = largest(difference(&up, &down)) / size;
                worst = if sides > worst.0 { (sides, d.id) } else { worst };
                assert!(sides < ONE_SIDED, "{} {}, trial {trial}: {sides:.2e}", d.id, d.parameters[i].name);
            }
        }
    }
    println!("one-sided derivatives differ by {:.1e} ({})", worst.0, worst.1);
}

/// Largest root mean square over trials of (derivative − central difference of whole simulations) / root mean square of
/// the derivative.
fn derivative_error(settings: &[Setting], which: usize, parameter: usize) -> f64 {
    /// Step of the difference, in scales: errors of the integration, divided by it, stay small; so does its square.
    const STEP: f64 = 0.01;
    let forward = forward();
    let parameters = forward.nominal_parameters();
    let variant = forward.variant(settings).unwrap();
    let variants = forward.difference_variants(settings, which).unwrap();
    let scale = settings[which].effect.description().parameters[parameter].scale;
    let (mut error, mut size) = (0.0, 0.0);
    for trial in 0..TRIALS.len() {
        let input = forward.recorded_input(trial);
        let core = forward.core(&variant, trial, &input, &parameters, settings, true).unwrap();
        let derivative = forward
            .effect_derivative(trial, &core, &input, &parameters, settings, which, &variants, parameter)
            .unwrap();
        let side = |sign: f64| {
            let mut settings = settings.to_vec();
            settings[which].values[parameter] += sign * STEP * scale;
            moment(forward, trial, &settings)
        };
        let differences: Vec<f64> = side(1.0).iter().zip(&side(-1.0)).map(|(a, b)| (a - b) / (2.0 * STEP)).collect();
        error += rms(&difference(&derivative, &differences)).powi(2);
        size += rms(&derivative).powi(2);
    }
    if size == 0.0 { error } else { (error / size).sqrt() }
}

#[test]
fn verif_derivatives_match_differences_of_whole_simulations() {
    let mut failed = Vec::new();
    let mut note = |what: String, error: f64, limit: f64| {
        println!("{error:.1e} {what}");
        if !(error < limit) {
            failed.push(format!("{what}: {error:.1e}"));
        }
    };
    let all: Vec<Setting> = CATALOGUE.iter().map(|e| sized(*e, 0.2)).collect();
    for (which, effect) in CATALOGUE.iter().copied().enumerate() {
        let d = effect.description();
        let limit = if KINKED.contains(&d.id) { LIMIT_AT_KINKS } else { LIMIT };
        for (p, parameter) in d.parameters.iter().enumerate() {
            let name = |how: &str| format!("{}.{} {how}", d.id, parameter.name);
            if parameter.role == Role::Amplitude {
                note(name("absent"), derivative_error(&[Setting::absent(effect)], 0, p), limit);
            }
            note(name("present"), derivative_error(&[sized(effect, 0.7)], 0, p), limit);
            note(name("among all"), derivative_error(&all, which, p), limit);
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

/// Relative error of a derivative.
const LIMIT: f64 = 1e-3;
/// Of one with kinks that the difference of whole simulations steps over: excitations cut off at 0, a hinge, and moment
/// arms where a path reaches or leaves a wrap surface.
const LIMIT_AT_KINKS: f64 = 0.02;
const KINKED: [&str; 4] = ["emg_floor", "ligament_stop", "angle_offset", "joint_compliance"];

#[test]
fn verif_extreme_plausible_values_give_numbers() {
    let forward = forward();
    for effect in CATALOGUE.iter().copied() {
        for setting in extremes(effect) {
            for trial in 0..TRIALS.len() {
                let moment = moment(forward, trial, std::slice::from_ref(&setting));
                assert!(moment.iter().all(|m| m.is_finite()), "{setting:?}, trial {trial}");
                assert!(largest(moment) < 500.0, "{setting:?}, trial {trial}");
            }
        }
    }
}

#[test]
fn verif_moments_of_the_joint_are_linear_in_their_amplitudes() {
    /// Rounding, relative to the moment [N·m].
    const TOLERANCE: f64 = 1e-12;
    let forward = forward();
    for effect in CATALOGUE.iter().copied().filter(|e| {
        let d = e.description();
        matches!(d.stage, Stage::Joint | Stage::Inertia)
    }) {
        for trial in 0..TRIALS.len() {
            let base = moment(forward, trial, &[]);
            let one = difference(&moment(forward, trial, &[sized(effect, 0.5)]), &base);
            let three = difference(&moment(forward, trial, &[sized(effect, 1.5)]), &base);
            let left = largest(one.iter().zip(&three).map(|(one, three)| 3.0 * one - three));
            assert!(left < TOLERANCE * 100.0, "{}: {left:.1e}", effect.description().id);
        }
    }
}

/// What an instantaneous effect makes of a few samples is what it makes of them within the whole trial; the others
/// reach further, or need not say so.
#[test]
fn verif_instantaneous_effects_need_the_samples_in_question_alone() {
    let forward = forward();
    let mut instantaneous = 0;
    for effect in CATALOGUE.iter().filter(|e| e.description().behaviour.excitation != ExcitationScope::WholeTrial) {
        instantaneous += 1;
        // Where plausible sizes start at 0 that end is no effect.
        for setting in extremes(*effect).into_iter().filter(|s| s.values.iter().any(|v| *v != 0.0)) {
            // Not the first: what drifts over the session starts there.
            let (trial, settings) = (1, [setting]);
            assert!(forward.excites_instantaneously(&settings));
            let recorded = &forward.trials[trial].excitation;
            let whole = forward.excited(trial, 0..recorded[0].len(), recorded, &settings);
            let (id, samples) = (effect.description().id, 120..171);
            assert!(whole.iter().zip(recorded).any(|(after, before)| after != before), "{id} does nothing");
            let some: Vec<Vec<f64>> = recorded.iter().map(|e| e[samples.clone()].to_vec()).collect();
            let found = forward.excited(trial, samples.clone(), &some, &settings);
            let expected: Vec<Vec<f64>> = whole.iter().map(|e| e[samples.clone()].to_vec()).collect();
            assert_eq!(found, expected, "{id}");
        }
    }
    assert!(instantaneous >= 5);
    let delay = Setting { values: vec![0.05], ..Setting::absent(effect("electromechanical_delay").unwrap()) };
    assert!(!forward.excites_instantaneously(&[delay]));
}

/// What an effect makes of a muscle's excitation is the same where the others' are left out, unless it says that it
/// mixes them.
#[test]
fn verif_excitations_of_other_muscles_may_be_left_out_unless_they_are_mixed() {
    let forward = forward();
    let (trial, muscle) = (1, 0);
    let recorded = &forward.trials[trial].excitation;
    let all = 0..recorded[0].len();
    let alone: Vec<Vec<f64>> =
        recorded.iter().enumerate().map(|(m, e)| if m == muscle { e.clone() } else { Vec::new() }).collect();
    let (mut apart, mut mixing) = (0, 0);
    for effect in CATALOGUE {
        for setting in extremes(*effect).into_iter().filter(|s| s.values.iter().any(|v| *v != 0.0)) {
            let settings = [setting];
            if !forward.excitation_changes(&settings) {
                continue;
            }
            if forward.mixes_muscles(&settings) {
                mixing += 1;
                continue;
            }
            apart += 1;
            let expected = &forward.excited(trial, all.clone(), recorded, &settings)[muscle];
            let found = forward.excited(trial, all.clone(), &alone, &settings);
            assert_eq!(&found[muscle], expected, "{}", effect.description().id);
            assert!(found.iter().enumerate().all(|(m, e)| m == muscle || e.is_empty()));
        }
    }
    assert!(apart >= 7 && mixing >= 1, "{apart} {mixing}");
}
