//! Tests of the catalogue of effects: one conformance suite for all of them, their signatures, and their forms in
//! files.

mod command;
mod conformance;
mod export;
mod found;
mod opensim;
mod signatures;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use carpus::effects::catalogue::{CATALOGUE, effect};
use carpus::effects::effect::{Description, Effect};
use carpus::effects::forward_model::{ForwardModel, Setting};
use carpus::osim::OsimFile;
use carpus::simulation::{MusculoskeletalModel, Setup};
use carpus::study::{Contraction, Study, Trial};

/// Trials of the bundled study that the tests use: held, moving against a load both ways, moving passively.
const TRIALS: [&str; 4] =
    ["isometric_50_flexion_+30deg_1", "isotonic_50_extension_1", "isotonic_25_flexion_1", "passive_1"];

fn in_repository(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

/// The bundled study, read once.
fn study() -> &'static (Study, OsimFile, MusculoskeletalModel) {
    static STUDY: OnceLock<(Study, OsimFile, MusculoskeletalModel)> = OnceLock::new();
    STUDY.get_or_init(|| {
        let study = Study::read(in_repository("fixtures/demo_study/study.toml")).unwrap_or_else(|e| panic!("{e}"));
        let file = OsimFile::read(in_repository("models/wrist.osim")).unwrap();
        let model = MusculoskeletalModel::compile(&file.spec, &Setup::from_settings(&study.settings)).unwrap();
        (study, file, model)
    })
}

fn trial(stem: &str) -> Trial {
    let (study, ..) = study();
    let info = study.trials_of("P01").find(|t| t.file_as_written.contains(stem)).unwrap();
    study.trial(info).unwrap_or_else(|e| panic!("{e}"))
}

/// A forward model of trials, after a change of each.
fn forward_with(stems: &[&str], change: impl Fn(&mut Trial)) -> ForwardModel {
    let (_, file, model) = study();
    let mut trials: Vec<Trial> = stems.iter().map(|stem| trial(stem)).collect();
    trials.iter_mut().for_each(change);
    ForwardModel::new(&file.spec, model, &trials).unwrap()
}

/// The trials, in the passive one the arm turned over.
fn forward() -> &'static ForwardModel {
    static FORWARD: OnceLock<ForwardModel> = OnceLock::new();
    FORWARD.get_or_init(|| {
        forward_with(&TRIALS, |trial| trial.info.arm_flipped = trial.info.contraction == Contraction::Passive)
    })
}

/// The recorded moment of a trial with effects.
fn moment(forward: &ForwardModel, trial: usize, effects: &[Setting]) -> Vec<f64> {
    let variant = forward.variant(effects).unwrap();
    let input = forward.recorded_input(trial);
    let parameters = forward.nominal_parameters();
    let core = forward.core(&variant, trial, &input, &parameters, effects, false).unwrap();
    forward.recorded_moment(trial, &core, effects)
}

fn named(id: &str) -> &'static dyn Effect {
    effect(id).unwrap_or_else(|| panic!("no effect {id}"))
}

/// The effect with amplitudes `sizes` times their scale, shapes as usual.
fn sized(effect: &'static dyn Effect, sizes: f64) -> Setting {
    let mut setting = Setting::absent(effect);
    for i in effect.description().amplitudes() {
        setting.values[i] = sizes * effect.description().parameters[i].scale;
    }
    setting
}

fn descriptions() -> impl Iterator<Item = &'static Description> {
    CATALOGUE.iter().map(|e| e.description())
}

fn same_bits(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |m, v| if v.is_nan() { f64::NAN } else { m.max(v.abs()) })
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
