//! Tests of `diagnosis`: one conformance suite for all effects, and diagnoses of the bundled study.

use std::path::PathBuf;

use carpus::diagnosis::diagnose::{Request, Verdict, diagnose};
use carpus::effects::catalogue::CATALOGUE;
use carpus::effects::effect::{Effect, OsimForm, Role};
use carpus::effects::forward_model::recorded_changes::Change;
use carpus::effects::forward_model::{Core, ForwardModel, Setting};
use carpus::osim::OsimFile;
use carpus::simulation::{MusculoskeletalModel, Setup};
use carpus::study::{Study, Trial};

fn demo() -> (Study, Vec<Trial>, OsimFile) {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let study = Study::read_tables(root.join("fixtures/demo_study")).unwrap();
    let trials = study.load_trials("P01").unwrap();
    let file = OsimFile::read(root.join("models/wrist.osim")).unwrap();
    (study, trials, file)
}

fn forward(study: &Study, trials: &[Trial], file: &OsimFile) -> ForwardModel {
    let model = MusculoskeletalModel::compile(&file.spec, &Setup::from_settings(&study.settings)).unwrap();
    ForwardModel::new(&file.spec, &model, trials).unwrap()
}

/// Trials that excite everything: an isometric one, a movement, a passive sweep.
fn few(trials: Vec<Trial>) -> Vec<Trial> {
    let names = ["isometric_25_flexion_+30deg_1", "isotonic_25_extension_1", "passive_1"];
    trials.into_iter().filter(|t| names.contains(&t.info.name.as_str())).collect()
}

fn moments(forward: &ForwardModel, effects: &[Setting]) -> Vec<Vec<f64>> {
    let variant = forward.variant(effects).unwrap();
    let parameters = forward.nominal_parameters();
    (0..forward.trials.len())
        .map(|g| {
            let input = &forward.recorded_input(g);
            let core = forward.core(&variant, g, input, &parameters, effects, false).unwrap();
            forward.recorded_moment(g, &core, effects)
        })
        .collect()
}

#[test]
fn verif_absent_effects_change_nothing_to_the_last_bit() {
    let (study, trials, file) = demo();
    let forward = forward(&study, &few(trials), &file);
    let without = moments(&forward, &[]);
    for effect in CATALOGUE {
        let id = effect.description().id;
        assert_eq!(moments(&forward, &[Setting::absent(*effect)]), without, "{id}");
    }
    let all: Vec<Setting> = CATALOGUE.iter().map(|e| Setting::absent(*e)).collect();
    assert_eq!(moments(&forward, &all), without, "all at once");
}

#[test]
fn verif_every_effect_changes_some_trial_and_its_derivative_matches_differences() {
    let (study, trials, file) = demo();
    let forward = forward(&study, &few(trials), &file);
    let parameters = forward.nominal_parameters();
    let without = moments(&forward, &[]);
    for effect in CATALOGUE {
        let description = effect.description();
        let settings = [Setting::absent(*effect)];
        let variants = forward.difference_variants(&settings, 0).unwrap();
        for p in description.amplitudes() {
            let mut small = settings.to_vec();
            // Half the derivative's own step: curvature and kinks show as a difference.
            small[0].values[p] = 0.05 * description.parameters[p].scale;
            let with = moments(&forward, &small);
            let (mut error, mut size) = (0.0_f64, 0.0_f64);
            for g in 0..forward.trials.len() {
                let input = &forward.recorded_input(g);
                let variant = forward.variant(&settings).unwrap();
                let core = forward.core(&variant, g, input, &parameters, &settings, true).unwrap();
                let by = forward.effect_derivative(g, &core, input, &parameters, &settings, 0, &variants, p).unwrap();
                for k in 0..by.len() {
                    let difference = (with[g][k] - without[g][k]) / 0.05;
                    error += (difference - by[k]).powi(2);
                    size += by[k].powi(2);
                }
            }
            if description.id == "unmodelled_muscles" {
                // It acts through the model's silent muscles, and the bundled wrist has none: exactly nothing may
                // change.
                assert!(size == 0.0 && with == without, "{} acts without a silent muscle", description.id);
                continue;
            }
            let relative = (error / size).sqrt();
            println!("{}.{}: {relative:.1e}", description.id, description.parameters[p].name);
            assert!(size > 0.0, "{} does nothing", description.id);
            assert!(relative < 0.15, "{}.{}: {relative}", description.id, description.parameters[p].name);
        }
    }
}

#[test]
fn verif_effects_are_described_in_full() {
    let mut seen = Vec::new();
    for effect in CATALOGUE {
        let d = effect.description();
        assert!(!seen.contains(&d.id), "{} twice", d.id);
        seen.push(d.id);
        assert!(d.parameters.iter().any(|p| p.role == Role::Amplitude), "{}", d.id);
        for p in d.parameters {
            assert!(p.scale > 0.0 && p.plausible[0] < p.plausible[1] && !p.source.is_empty(), "{}.{}", d.id, p.name);
            assert!(p.role == Role::Shape || p.start == 0.0, "{}.{}", d.id, p.name);
        }
        let (OsimForm::Native(form) | OsimForm::Controls(form) | OsimForm::SideCar(form)) = d.osim_form;
        assert!(![d.equation, d.signature, d.experiment, form].contains(&""), "{}", d.id);
    }
}

#[test]
fn verif_sensitivity_to_muscle_parameters_matches_differences_with_effects_on() {
    let (study, trials, file) = demo();
    let forward = forward(&study, &few(trials), &file);
    for ids in [
        &["joint_stiffness", "stretch_reflex", "emg_crosstalk", "moment_arm_slope", "sensor_bandwidth"][..],
        &["joint_compliance", "moment_arm_shift", "time_shift"],
        // The moment of these is that of the joint, which no effect reads.
        &["axis_misalignment", "torque_offset", "time_shift", "sensor_bandwidth"],
    ] {
        check_sensitivity_to_muscles(&forward, &one_scale_of(ids));
    }
}

/// Effects, the first parameter of each one scale away from none.
fn one_scale_of(ids: &[&str]) -> Vec<Setting> {
    let setting = |e: &&'static dyn Effect| {
        let mut setting = Setting::absent(*e);
        setting.values[0] = e.description().parameters[0].scale;
        setting
    };
    CATALOGUE.iter().filter(|e| ids.contains(&e.description().id)).map(setting).collect()
}

fn check_sensitivity_to_muscles(forward: &ForwardModel, effects: &[Setting]) {
    let variant = forward.variant(effects).unwrap();
    let parameters = forward.nominal_parameters();
    let input = forward.recorded_input(1);
    let core = forward.core(&variant, 1, &input, &parameters, effects, true).unwrap();
    let by = forward.sensed_derivatives(1, &core, effects);
    for (column, by) in by.iter().enumerate() {
        let step = 1e-4;
        let side = |sign: f64| {
            let mut moved = parameters.clone();
            let p = &mut moved[column / 3];
            let factor = (sign * step).exp();
            match column % 3 {
                0 => p.max_isometric_force *= factor,
                1 => p.optimal_fiber_length *= factor,
                _ => p.tendon_slack_length *= factor,
            }
            let core = forward.core(&variant, 1, &input, &moved, effects, false).unwrap();
            forward.recorded_moment(1, &core, effects)
        };
        let (up, down) = (side(1.0), side(-1.0));
        let scale = by.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let worst = (0..by.len()).map(|k| ((up[k] - down[k]) / (2.0 * step) - by[k]).abs()).fold(0.0, f64::max);
        assert!(worst < 2e-3 * scale.max(0.1), "column {column}: {worst:e} of {scale:e}");
    }
}

#[test]
fn verif_response_to_excitation_of_a_compliant_joint_matches_differences() {
    let (study, trials, file) = demo();
    check_response_to_excitation(&forward(&study, &few(trials), &file), 0.05);
}

#[test]
fn verif_response_of_a_compliant_joint_with_rigid_tendons_matches_differences() {
    let (study, trials, mut file) = demo();
    for muscle in &mut file.spec.muscles {
        muscle.ignore_tendon_compliance = true;
    }
    // At larger compliances a rigid tendon's force and the joint's speed drive each other up from round to round.
    check_response_to_excitation(&forward(&study, &few(trials), &file), 0.01);
}

/// What the joint's compliance does to the response is right to 15 %, beside the error that the response has at a stiff
/// joint. Speeds are those of parabolas through samples, not of the motion's spline.
fn check_response_to_excitation(forward: &ForwardModel, compliance: f64) {
    let stiff = errors_of_response(forward, 1e-9);
    for (muscle, (found, stiff)) in errors_of_response(forward, compliance).iter().zip(&stiff).enumerate() {
        let [error, feedback] = *found;
        println!("muscle {muscle}: off by {error:.3}, without feedback by {feedback:.3}, stiff by {:.3}", stiff[0]);
        assert!(stiff[0] < 0.06 && error < stiff[0] + 0.15 * feedback, "muscle {muscle}: {found:?}, {stiff:?}");
    }
}

/// Per muscle: how far the response to a disturbance of its excitation is off, and how far were the joint held, of the
/// response.
fn errors_of_response(forward: &ForwardModel, compliance: f64) -> Vec<[f64; 2]> {
    let mut effects = one_scale_of(&["joint_compliance"]);
    effects[0].values[0] = compliance;
    let parameters = forward.nominal_parameters();
    let model = forward.variant(&effects).unwrap();
    let recorded = forward.recorded_input(1);
    let core = forward.core(&model, 1, &recorded, &parameters, &effects, true).unwrap();
    let n = core.moment.len();
    let (first, width) = (n / 3, 9);
    let disturbance: Vec<f64> = (1..2 * width).map(|k| 1.0 - (k as f64 - width as f64).abs() / width as f64).collect();
    let of_muscle = |muscle: usize| {
        let held_of = |core: &Core| {
            let (solution, excitation) = (&core.solutions[muscle], &core.excitation[muscle]);
            let response =
                core.prepared.scaled_excitation_response(muscle, solution, excitation, &core.factors[muscle]);
            let mut held = vec![0.0; n];
            response.respond(first, &disturbance, |k, moment| held[k] += moment);
            held
        };
        let rounds: Vec<Vec<f64>> = core.rounds().into_iter().map(held_of).collect();
        let found = forward.recorded_changes(1, &core, &effects, [Change::OfRounds(&rounds)]).swap_remove(0);
        let side = |step: f64| {
            let mut excitation = recorded.excitation.clone();
            disturbance.iter().zip(&mut excitation[muscle][first..]).for_each(|(d, e)| *e += step * d);
            let input = forward.input(1, excitation).unwrap();
            let core = forward.core(&model, 1, &input, &parameters, &effects, false).unwrap();
            forward.recorded_moment(1, &core, &effects)
        };
        let step = 1e-3;
        let (up, down) = (side(step), side(-step));
        let norm = |of: &dyn Fn(usize) -> f64| (0..n).map(|k| of(k).powi(2)).sum::<f64>().sqrt();
        let by_difference = |k: usize| (up[k] - down[k]) / (2.0 * step);
        let error = norm(&|k| by_difference(k) - found[k]) / norm(&by_difference);
        let feedback = norm(&|k| by_difference(k) - rounds[0][k]) / norm(&by_difference);
        [error, feedback]
    };
    (0..parameters.len()).map(of_muscle).collect()
}

fn request<'a>(study: &Study, forward: &'a ForwardModel, ids: &[&str]) -> Request<'a> {
    Request {
        participant: "P01".to_string(),
        forward,
        laboratory: None,
        bounds: study.settings.bounds,
        images: Vec::new(),
        candidates: CATALOGUE.iter().copied().filter(|e| ids.contains(&e.description().id)).collect(),
        mvc: 10.9,
        seed: 1,
    }
}

const FEW: [&str; 4] = ["joint_damping", "torque_drift", "time_shift", "emg_nonlinearity"];

#[test]
fn val_opensim_clean_data_raise_nothing() {
    let (study, trials, file) = demo();
    let model = MusculoskeletalModel::compile(&file.spec, &Setup::from_settings(&study.settings)).unwrap();
    let forward = ForwardModel::for_diagnosis(&file.spec, &model, &trials).unwrap();
    let found = diagnose(&request(&study, &forward, &FEW), &|_| {}).unwrap().diagnosis;
    println!("p = {}", found.null_p_value);
    assert_eq!(found.verdict, Verdict::NothingDetectable);
}
