//! Tests of `personalization`.

use std::path::Path;

use carpus::evaluation::error_measures;
use carpus::osim::OsimFile;
use carpus::personalization::{
    FitOptions, FitProblem, Method, Personalization, Property, TrainingTrial, personalize, write_parameters,
};
use carpus::simulation::{MuscleParameters, MusculoskeletalModel, Options, PreparedTrial, Recording, Setup};
use carpus::study::{Study, Trial, TrialUse};

/// A participant's trials, prepared.
struct Participant {
    file: OsimFile,
    study: Study,
    trials: Vec<Trial>,
    prepared: Vec<PreparedTrial>,
    model: MusculoskeletalModel,
}

fn participant(folder: &Path) -> Participant {
    let study = Study::read(folder).unwrap();
    let who = study.participants[0].clone();
    let file = OsimFile::read(&who.model).unwrap();
    let model = MusculoskeletalModel::compile(&file.spec, &Setup::from_settings(&study.settings)).unwrap();
    let trials: Vec<Trial> = study.trials_of(&who.name).map(|info| study.trial(info).unwrap()).collect();
    let recordings: Vec<Recording> = trials.iter().map(Recording::from).collect();
    let prepared = model.prepare_all(&recordings, &Options::default()).unwrap();
    Participant { file, study, trials, prepared, model }
}

impl Participant {
    fn problem(&self) -> FitProblem<'_> {
        let of_use = self.trials.iter().zip(&self.prepared).filter(|(t, _)| t.info.usage == TrialUse::Train);
        FitProblem {
            trials: of_use.map(|(t, prepared)| TrainingTrial { prepared, measured: &t.moment }).collect(),
            muscles: self.model.muscle_names().map(str::to_owned).collect(),
            nominal: self.model.nominal_parameters(),
            bounds: self.study.settings.bounds,
        }
    }

    fn mean_nrmse(&self, usage: TrialUse, parameters: &[MuscleParameters]) -> f64 {
        let errors: Vec<f64> = self
            .trials
            .iter()
            .zip(&self.prepared)
            .filter(|(t, _)| t.info.usage == usage)
            .map(|(t, p)| {
                let moment = p.simulate(parameters).unwrap().moment;
                error_measures(&t.moment, &moment).unwrap().nrmse.value().unwrap()
            })
            .collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    }
}

fn true_parameters(participant: &Participant, truth: &Path) -> Vec<MuscleParameters> {
    let truth: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(truth).unwrap()).unwrap();
    let nominal = participant.model.nominal_parameters();
    participant
        .model
        .muscle_names()
        .zip(nominal)
        .map(|(name, p)| {
            let of = |property: &str| truth["parameters"][name][property].as_f64().unwrap();
            MuscleParameters {
                max_isometric_force: of("max_isometric_force"),
                optimal_fiber_length: of("optimal_fiber_length"),
                tendon_slack_length: of("tendon_slack_length"),
                ..p
            }
        })
        .collect()
}

fn show(what: &str, participant: &Participant, parameters: &[MuscleParameters]) -> f64 {
    let held_out = participant.mean_nrmse(TrialUse::Test, parameters);
    println!("{what:12} train {:.5}  held out {held_out:.5}", participant.mean_nrmse(TrialUse::Train, parameters));
    held_out
}

fn fit(participant: &Participant, options: &FitOptions) -> Personalization {
    let started = std::time::Instant::now();
    let fit = personalize(&participant.problem(), options, &|_| ()).unwrap();
    println!("{:?}: {} evaluations, {:.2} s", options.method, fit.evaluations, started.elapsed().as_secs_f64());
    for stage in &fit.stages {
        println!(
            "  {:30} {:5}  J {:.4} -> {:.4}",
            stage.name, stage.evaluations, stage.objective_before, stage.objective_after
        );
    }
    fit
}

/// Recovers the demo participant: the bar is a held-out NRMSE within 10 % of what the true parameters give.
fn check_study(folder: &Path) {
    let participant = participant(folder);
    let nominal = show("nominal", &participant, &participant.model.nominal_parameters());
    let truth = true_parameters(&participant, &folder.join("truth.json"));
    let best = show("truth", &participant, &truth);
    let two_stage = fit(&participant, &FitOptions { method: Method::TwoStage, ..FitOptions::default() });
    show("two stages", &participant, &two_stage.parameters);
    let joint = fit(&participant, &FitOptions::default());
    let found = show("joint", &participant, &joint.parameters);
    for (p, t) in joint.fitted.iter().zip(truth.iter().flat_map(|t| Property::ALL.map(|q| q.of(t)))) {
        let known = p.determination.unwrap();
        println!(
            "  {:5} {:22} factor {:.3} (true {:.3}) ± {:.3}, {:3.0} % from data{}",
            p.muscle,
            p.property.name(),
            p.after / p.before,
            t / p.before,
            known.relative_deviation,
            100.0 * known.share_from_data,
            p.at_bound.map_or(String::new(), |b| format!(", at {b:?} bound"))
        );
        assert!(p.after >= p.lower && p.after <= p.upper);
    }
    assert!(found < nominal);
    assert!(found <= 1.1 * best, "held-out NRMSE {found} is more than 10 % above {best}");
}

#[test]
fn val_demo_study_held_out_error_comes_within_ten_percent_of_the_truth() {
    check_study(&Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/demo_study"));
}

/// Other generated studies, for example of a lab's model: a folder with `study.toml` and `truth.json`.
#[test]
fn val_generated_study_held_out_error_comes_within_ten_percent_of_the_truth() {
    match std::env::var_os("CARPUS_GENERATED_STUDY") {
        Some(folder) => check_study(Path::new(&folder)),
        None => eprintln!("SKIPPED: CARPUS_GENERATED_STUDY is not set"),
    }
}
