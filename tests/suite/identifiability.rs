//! Intervals of muscle parameters: known truth, priors, ties, further moments, the next trial, and the command.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use carpus::identifiability::{
    Candidate, FreeParameter, Identifiability, MuscleProperty, Prior, RecordedTrial, Request, identify, usual_bounds,
};
use carpus::osim::OsimFile;
use carpus::osim::spec::MuscleSpec;
use carpus::simulation::{MuscleParameters, MusculoskeletalModel, Options, Recording, Setup};
use carpus::study::{Direction, Study, Trial, TrialUse};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;

/// Trials of the demo study that these tests use: both directions, held and moving, at rest.
const TRIALS: [&str; 7] = [
    "isometric_50_flexion_+30deg_1",
    "isometric_50_flexion_-30deg_1",
    "isometric_50_extension_-30deg_1",
    "isometric_50_extension_+30deg_1",
    "isotonic_50_flexion_1",
    "isotonic_50_extension_1",
    "passive_1",
];

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

/// The demo study's trials with three muscles, whose moments are simulated from a known truth without noise.
struct Known {
    model: MusculoskeletalModel,
    muscles: Vec<MuscleSpec>,
    truth: Vec<MuscleParameters>,
    trials: Vec<RecordedTrial>,
    bounds: carpus::study::ParameterBounds,
}

fn known() -> Known {
    let study = Study::read_tables(root("fixtures/demo_study")).unwrap();
    let file = OsimFile::read(root("models/wrist.osim")).unwrap();
    let active = ["ECRB", "FCR", "FCU"];
    let mut setup = Setup::from_settings(&study.settings);
    let position = |m: &str| study.settings.active_muscles.iter().position(|a| a == m).unwrap();
    let columns: Vec<usize> = active.iter().map(|m| position(m)).collect();
    setup.active_muscles = active.map(String::from).to_vec();
    let model = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
    let all: Vec<Trial> = study
        .trials_of("P01")
        .filter(|t| t.usage == TrialUse::Train && TRIALS.contains(&t.name.as_str()))
        .map(|t| study.trial(t).unwrap())
        .collect();
    assert_eq!(all.len(), TRIALS.len());
    let recordings: Vec<Recording> = all
        .iter()
        .map(|t| Recording {
            name: t.info.name.clone(),
            time: &t.time,
            angle: &t.angle,
            excitation: columns.iter().map(|c| t.excitation[*c].as_slice()).collect(),
            held: Vec::new(),
        })
        .collect();
    let prepared = model.prepare_all(&recordings, &Options::default()).unwrap();
    let truth: Vec<MuscleParameters> = model
        .nominal_parameters()
        .into_iter()
        .zip([[1.04, 0.98, 1.3], [0.97, 1.02, 0.8], [1.05, 0.985, 1.2]])
        .map(|(p, [length, slack, force])| MuscleParameters {
            optimal_fiber_length: p.optimal_fiber_length * length,
            tendon_slack_length: p.tendon_slack_length * slack,
            max_isometric_force: p.max_isometric_force * force,
            ..p
        })
        .collect();
    let trials = recordings
        .iter()
        .zip(&prepared)
        .map(|(r, p)| {
            RecordedTrial::new(&r.name, Direction::None, "flexion", r, &p.simulate(&truth).unwrap().moment, p)
        })
        .collect();
    let muscles = active.map(|m| file.spec.muscles.iter().find(|s| s.name == m).unwrap().clone()).to_vec();
    Known { model, muscles, truth, trials, bounds: study.settings.bounds }
}

impl Known {
    fn parameters(&self, properties: &[MuscleProperty]) -> Vec<FreeParameter> {
        let of = |property: MuscleProperty| {
            self.muscles.iter().enumerate().map(move |(m, spec)| {
                let bounds = usual_bounds(property, &self.bounds);
                FreeParameter::new(&spec.name, property, vec![m], property.of(spec).unwrap(), bounds)
            })
        };
        properties.iter().flat_map(|p| of(*p)).collect()
    }

    fn request(&self, parameters: Vec<FreeParameter>) -> Request {
        Request {
            model: self.model.clone(),
            muscles: self.muscles.clone(),
            trials: self.trials.clone(),
            parameters,
            level: 0.9,
            seed: 1,
            draws: 400,
            candidates: Vec::new(),
        }
    }

    fn true_value(&self, p: &FreeParameter) -> f64 {
        let truth = &self.truth[p.muscles[0]];
        match p.property {
            MuscleProperty::MaxIsometricForce => truth.max_isometric_force,
            MuscleProperty::OptimalFiberLength => truth.optimal_fiber_length,
            _ => truth.tendon_slack_length,
        }
    }
}

fn show(found: &Identifiability) {
    for k in &found.parameters {
        println!(
            "{:26} {:.5} [{:.5}, {:.5}] {:?}  {:.0} % from data",
            k.parameter.name(),
            k.most_likely,
            k.interval[0],
            k.interval[1],
            k.end_from_data,
            100.0 * k.share_from_data
        );
    }
    println!("{:?}", found.soundness);
}

#[test]
fn verif_noise_free_parameters_are_found_and_lie_in_their_intervals() {
    let known = known();
    let found = identify(&known.request(known.parameters(&MuscleProperty::USUAL))).unwrap();
    show(&found);
    for k in &found.parameters {
        let truth = known.true_value(&k.parameter);
        assert!(k.interval[0] <= truth && truth <= k.interval[1], "{}", k.parameter.name());
        assert!(k.credible[0] <= k.posterior_median && k.posterior_median <= k.credible[1]);
        // The noise that no laboratory goes below leaves these known within 1 %; the rest is not identifiable.
        if k.is_determined() && k.relative_half_width() < 0.02 {
            assert!((k.most_likely / truth - 1.0).abs() < 0.01, "{}: {} {truth}", k.parameter.name(), k.most_likely);
        }
    }
    let sharp = found.parameters.iter().filter(|k| k.is_determined() && k.relative_half_width() < 0.02).count();
    assert!(sharp >= 5, "{sharp} parameters are known to 2 %");
    let soundness = found.soundness.unwrap();
    assert!(soundness.largest_deviance_error < 0.5, "polynomials are exact enough");
    assert!(soundness.largest_r_hat < 1.1);
    // The best known combination is known better than any parameter alone.
    let least = found.parameters.iter().map(|k| k.posterior_log_sd).fold(f64::INFINITY, f64::min);
    assert!(found.combinations[0].log_sd <= least * 1.1);
    assert!(found.combinations.windows(2).all(|c| c[0].share_from_data >= c[1].share_from_data - 1e-12));
}

#[test]
fn verif_result_is_the_same_at_any_number_of_threads() {
    let known = known();
    let mut request = known.request(known.parameters(&[MuscleProperty::MaxIsometricForce]));
    request.trials.truncate(3);
    request.draws = 80;
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| identify(&request).unwrap());
        (found.draws, found.parameters.iter().map(|k| k.interval).collect::<Vec<_>>())
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn verif_a_prior_helps_where_the_data_are_weak_and_hardly_where_they_are_strong() {
    let known = known();
    let mut request = known.request(known.parameters(&MuscleProperty::USUAL));
    request.trials.truncate(3);
    let without = identify(&request).unwrap();
    for p in &mut request.parameters {
        let factor = known.true_value(p) / p.nominal;
        if p.property == MuscleProperty::OptimalFiberLength {
            p.prior = Prior { factor, log_sd: 0.01, source: Some("a table".to_string()) };
        }
    }
    let with = identify(&request).unwrap();
    for (a, b) in without.parameters.iter().zip(&with.parameters) {
        println!("{:26} {:.4} → {:.4}", a.parameter.name(), a.posterior_log_sd, b.posterior_log_sd);
        if a.parameter.property == MuscleProperty::OptimalFiberLength {
            assert!(b.posterior_log_sd < 0.6 * a.posterior_log_sd.max(0.02));
        }
        assert!(b.posterior_log_sd < 1.25 * a.posterior_log_sd);
    }
}

#[test]
fn verif_expected_gain_of_a_trial_is_what_recording_it_brings() {
    let known = known();
    let mut request = known.request(known.parameters(&MuscleProperty::USUAL));
    let extra = request.trials.split_off(4);
    request.candidates = extra.iter().map(|t| Candidate { name: t.name.clone(), trial: t.clone() }).collect();
    let before = identify(&request).unwrap();
    let mut actual = Vec::new();
    for ranked in &before.next_trials {
        let mut more = request.clone();
        more.candidates.clear();
        more.trials.push(extra.iter().find(|t| t.name == ranked.name).unwrap().clone());
        let after = identify(&more).unwrap();
        let shrinkage = before
            .parameters
            .iter()
            .zip(&after.parameters)
            .map(|(b, a)| 1.0 - a.posterior_log_sd / b.posterior_log_sd)
            .sum::<f64>()
            / before.parameters.len() as f64;
        println!("{:32} expected {:.3}, found {shrinkage:.3}", ranked.name, ranked.mean_shrinkage);
        // First order about another fit, and a posterior from a few hundred draws.
        assert!((shrinkage - ranked.mean_shrinkage).abs() < 0.12, "{}", ranked.name);
        actual.push(shrinkage);
    }
    let best = actual.iter().copied().fold(0.0, f64::max);
    assert!(actual[0] > best - 0.06, "the trial that is recommended is about the best one: {actual:?}");
}

#[test]
fn verif_tied_muscles_and_other_properties() {
    let known = known();
    let mut parameters = known.parameters(&[MuscleProperty::MaxIsometricForce, MuscleProperty::TendonStrain]);
    let bounds = usual_bounds(MuscleProperty::MaxIsometricForce, &known.bounds);
    parameters.retain(|p| p.owner == "ECRB");
    let flexors = known.muscles[1].max_isometric_force;
    parameters.push(FreeParameter::new("flexors", MuscleProperty::MaxIsometricForce, vec![1, 2], flexors, bounds));
    let mut request = known.request(parameters);
    request.trials.truncate(4);
    // Truth: both flexors 10 % stronger, ECRB 20 %, its tendon strain three quarters.
    let mut specs = request.muscles.clone();
    let carpus::osim::spec::MuscleKind::Millard2012Equilibrium(own) = &mut specs[0].kind else { panic!("Millard") };
    own.tendon_force_length.strain_at_one_norm_force *= 0.75;
    if let Some(k) = &mut own.tendon_force_length.stiffness_at_one_norm_force {
        *k /= 0.75;
    }
    let truth = request.model.with_muscles(&specs).unwrap();
    let mut strong = request.model.nominal_parameters();
    strong.iter_mut().zip([1.2, 1.1, 1.1]).for_each(|(p, f)| p.max_isometric_force *= f);
    for trial in &mut request.trials {
        let recording = Recording {
            name: trial.name.clone(),
            time: &trial.time,
            angle: &trial.angle,
            excitation: trial.excitation.iter().map(Vec::as_slice).collect(),
            held: trial.held.clone(),
        };
        let prepared = truth.prepare_like(&recording, &trial.prepared, &Options::default()).unwrap();
        trial.channels[0].measured = prepared.simulate(&strong).unwrap().moment;
    }
    let found = identify(&request).unwrap();
    show(&found);
    let factor = |i: usize| found.parameters[i].most_likely / found.parameters[i].parameter.nominal;
    assert!((factor(0) - 1.2).abs() < 0.012 && (factor(2) - 1.1).abs() < 0.011);
    let strain = &found.parameters[1];
    let true_strain = 0.75 * strain.parameter.nominal;
    assert!(strain.interval[0] <= true_strain && true_strain <= strain.interval[1]);
}

#[test]
fn verif_a_moment_about_a_second_coordinate_tells_muscles_apart() {
    let known = known();
    let mut request = known.request(known.parameters(&MuscleProperty::USUAL));
    request.trials.truncate(2);
    let one = identify(&request).unwrap();
    for trial in &mut request.trials {
        let arms = known.model.moment_arms_about("deviation", &[], &trial.angle).unwrap();
        let forces = trial.prepared.simulate(&known.truth).unwrap();
        let moment: Vec<f64> = (0..trial.time.len())
            .map(|k| arms.iter().zip(&forces.muscles).map(|(a, f)| a[k] * f.tendon_force[k]).sum())
            .collect();
        *trial = trial.clone().with_channel("deviation", &moment, arms);
    }
    let two = identify(&request).unwrap();
    for (a, b) in one.parameters.iter().zip(&two.parameters) {
        println!("{:26} {:.4} → {:.4}", a.parameter.name(), a.posterior_log_sd, b.posterior_log_sd);
        let truth = known.true_value(&b.parameter);
        assert!(b.interval[0] <= truth && truth <= b.interval[1], "{}", b.parameter.name());
    }
    // FCR and FCU flex together and deviate to opposite sides.
    let strength = |f: &Identifiability| {
        let of = |k: &&carpus::identifiability::Knowledge| {
            k.parameter.property == MuscleProperty::MaxIsometricForce && k.parameter.owner != "ECRB"
        };
        f.parameters.iter().filter(of).map(|k| k.posterior_log_sd).sum::<f64>()
    };
    assert!(strength(&two) < 0.8 * strength(&one), "{} {}", strength(&one), strength(&two));
}

fn carpus() -> Command {
    let mut command = Command::cargo_bin("carpus").unwrap();
    command.timeout(std::time::Duration::from_secs(600)).env_remove("RUST_LOG");
    command
}

/// The demo study with three training trials and one held out.
fn small_study() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let source = root("fixtures/demo_study");
    let kept = ["isotonic_50_flexion_1", "isotonic_50_extension_1", "passive_1", "isotonic_50_flexion_2"];
    std::fs::create_dir_all(folder.path().join("data/P01")).unwrap();
    for name in kept {
        let file = format!("data/P01/{name}.csv");
        std::fs::copy(source.join(&file), folder.path().join(&file)).unwrap();
    }
    std::fs::copy(root("models/wrist.osim"), folder.path().join("wrist.osim")).unwrap();
    for name in ["study.toml", "participants.csv", "trials.csv"] {
        let text = std::fs::read_to_string(source.join(name)).unwrap();
        let text = text.replace("../../models/wrist.osim", "wrist.osim");
        let wanted =
            |l: &&str| name != "trials.csv" || l.starts_with("participant") || kept.iter().any(|k| l.contains(k));
        let text: String = text.lines().filter(wanted).map(|l| format!("{l}\n")).collect();
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

#[test]
fn verif_identify_writes_its_account_and_bad_input_is_answered() {
    let study = small_study();
    let out = study.path().join("out");
    let identify = |arguments: &[&str]| {
        let mut command = carpus();
        command.arg("identify").arg(study.path()).arg("--out").arg(&out).args(["--draws", "80"]).args(arguments);
        command.assert()
    };
    let priors = study.path().join("priors.csv");
    std::fs::write(&priors, "muscle,property,mean,sd,source\nFCR,optimal_fiber_length,0.063,0.004,a book\n").unwrap();
    let run = identify(&["--priors", priors.to_str().unwrap(), "--tie", "extensors=ECRL,ECRB,ECU", "--json"]).success();
    let printed: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    assert_eq!(printed[0]["schema"], "carpus.identifiability/1");
    assert_eq!(printed[0]["trials"], 3, "the held-out trial is not used");
    let parameters = printed[0]["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), 9, "extensors, FCR, FCU with three properties each");
    assert!(parameters.iter().any(|p| p["muscle"] == "FCR" && p["prior_source"] == "a book"));
    let next = printed[0]["next_trials"].as_array().unwrap();
    assert!(next.len() > 10);
    let gains: Vec<f64> = next.iter().map(|t| t["mean_shrinkage_percent"].as_f64().unwrap()).collect();
    assert!(gains.iter().all(|g| (0.0..100.0).contains(g)), "a further trial never widens an interval: {gains:?}");
    assert!(gains[0] > 1.5 * gains[gains.len() - 1] && gains[0] > 1.0, "trials tell differently much: {gains:?}");
    let files = [
        "identifiability.json",
        "intervals.csv",
        "combinations.csv",
        "correlations.csv",
        "next_trials.csv",
        "draws.csv",
    ];
    for file in files.iter().chain(&["report.html"]) {
        assert!(out.join("P01").join(file).metadata().unwrap().len() > 100, "{file}");
    }
    let table = study.path().join("population.csv");
    let priors_of = |fits: &std::path::Path| {
        let mut command = carpus();
        command.arg("priors").arg(fits).arg("--out").arg(&table).arg("--json");
        command.assert()
    };
    let run = priors_of(&out).success().stderr(contains("1 earlier fits"));
    let printed: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let learnt = |property: &str| {
        let of = |p: &&serde_json::Value| p["muscle"] == "FCU" && p["property"] == property;
        printed["priors"].as_array().unwrap().iter().find(of).unwrap().clone()
    };
    // One person tells where the mean may be, hardly how persons differ.
    let strength = learnt("max_isometric_force");
    assert!(strength["log_sd"].as_f64() > strength["between_log_sd"].as_f64());
    let run = identify(&["--priors", table.to_str().unwrap(), "--tie", "extensors=ECRL,ECRB,ECU", "--json"]).success();
    let again: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let slack = again[0]["parameters"]
        .as_array()
        .unwrap()
        .iter()
        .find(|p| p["muscle"] == "FCU" && p["property"] == "tendon_slack_length");
    let slack = slack.unwrap();
    let factor = learnt("tendon_slack_length")["factor"].as_f64().unwrap();
    let model = slack["model"].as_f64().unwrap();
    assert!((slack["prior_value"].as_f64().unwrap() / model / factor - 1.0).abs() < 1e-6);
    assert!(slack["prior_source"].as_str().unwrap().contains("earlier fits"));
    std::fs::create_dir(out.join("copy")).unwrap();
    std::fs::copy(out.join("P01/identifiability.json"), out.join("copy/identifiability.json")).unwrap();
    priors_of(&out).code(1).stderr(contains("P01").and(contains("already")));
    std::fs::write(out.join("copy/identifiability.json"), "{}").unwrap();
    priors_of(&out).code(1).stderr(contains("not a result of carpus identify"));
    std::fs::remove_dir_all(out.join("copy")).unwrap();
    priors_of(&study.path().join("data")).code(1).stderr(contains("identifiability.json"));
    identify(&["--properties", "tendon_slack"]).code(1).stderr(contains("tendon_slack_length"));
    identify(&["--tie", "flexors=FCR,FCQ"]).code(1).stderr(contains("FCQ"));
    identify(&["--tie", "flexors"]).code(1).stderr(contains("GROUP=MUSCLE"));
    identify(&["--level", "90"]).code(1).stderr(contains("0.5 to 0.999"));
    std::fs::write(&priors, "muscle,property,mean,sd\nFCR,optimal_fiber_length,63,4\n").unwrap();
    identify(&["--priors", priors.to_str().unwrap()]).code(1).stderr(contains("unit of the model file"));
    std::fs::write(&priors, "muscle,property,mean,sd,unit\nFCR,optimal_fiber_length,63,4,mm\n").unwrap();
    identify(&["--priors", priors.to_str().unwrap()]).code(1).stderr(contains("mm").and(contains("model")));
    std::fs::write(&priors, "muscle,property,mean,std\nFCR,optimal_fiber_length,63,4\n").unwrap();
    identify(&["--priors", priors.to_str().unwrap()]).code(1).stderr(contains("`sd`"));
    let toml = study.path().join("study.toml");
    let text = std::fs::read_to_string(&toml).unwrap();
    std::fs::write(
        &toml,
        text.replace("[posture_deg]", "further_moments = { deviation = \"moment_2\" }\n\n[posture_deg]"),
    )
    .unwrap();
    identify(&[]).code(1).stderr(contains("moment_2"));
}

#[test]
fn val_published_power_analyses_are_printed_beside_what_the_tests_give() {
    let run = carpus().args(["power", "--published"]).assert().success();
    run.stdout(contains("chapter 3")).stdout(contains("0.67")).stdout(contains("0.676")).stdout(contains("25"));
    let run = carpus().args(["power", "--published", "--json"]).assert().success();
    let printed: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let chapter_4 = &printed["analyses"][1];
    assert_eq!(chapter_4["published_needed_n"], chapter_4["tests"][0]["needed_n"]);
    carpus().arg("power").assert().code(1);
}

/// One estimator: a parameter has one interval, whichever command reports it.
#[test]
fn verif_personalize_identify_and_diagnose_report_the_same_intervals() {
    let out = tempfile::tempdir().unwrap();
    let run = |command: &str, arguments: &[&str]| {
        let folder = out.path().join(command);
        let mut all = carpus();
        all.arg(command).arg(root("fixtures/demo_study")).arg("--out").arg(&folder).args(arguments).assert().success();
        folder.join("P01")
    };
    let read =
        |path: PathBuf| -> serde_json::Value { serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap() };
    let personalized = read(run("personalize", &[]).join("results.json"));
    let diagnosed = read(run("diagnose", &[]).join("results.json"));
    let identified = read(run("identify", &["--draws", "40"]).join("identifiability.json"));
    let rows = personalized["parameters"].as_array().unwrap();
    assert_eq!(rows.len(), 15);
    assert_eq!(personalized["parameters"], diagnosed["parameters"]);
    assert_eq!(personalized["part_of_the_way"], diagnosed["part_of_the_way"]);
    for row in rows {
        let same = |p: &&serde_json::Value| p["muscle"] == row["muscle"] && p["property"] == row["property"];
        let other = identified["parameters"].as_array().unwrap().iter().find(same).unwrap();
        let ends = [&row["interval"]["lower"], &row["interval"]["upper"]];
        assert_eq!(ends, [&other["interval"][0], &other["interval"][1]], "{} {}", row["muscle"], row["property"]);
        assert_eq!(row["interval"]["end_from_data"], other["end_from_data"]);
        assert_eq!(row["share_from_data"], other["share_from_data"]);
        assert!(ends[0].as_f64() <= row["after"].as_f64() && row["after"].as_f64() <= ends[1].as_f64());
    }
}

/// A machine that moves the wrist's flexion and also measures the moment about its deviation; five wrist and three
/// finger muscles of the McFarland model, trials by OpenSim. Intervals hold the truth.
#[test]
#[cfg_attr(not(has_lab_models), ignore = "needs lab models (CARPUS_SHARED)")]
fn val_opensim_two_axes_of_the_wrist_with_finger_muscles() {
    let name = "Hand_Wrist_Model_for_development.osim";
    let model = super::reference::shared(&format!("models/{name}"));
    let folder = tempfile::tempdir().unwrap();
    let source = root("fixtures/two_axes");
    std::fs::create_dir_all(folder.path().join("data/P01")).unwrap();
    std::fs::copy(model, folder.path().join(name)).unwrap();
    for entry in std::fs::read_dir(source.join("data/P01")).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join("data/P01").join(path.file_name().unwrap())).unwrap();
    }
    for file in ["participants.csv", "trials.csv"] {
        std::fs::copy(source.join(file), folder.path().join(file)).unwrap();
    }
    let toml = std::fs::read_to_string(source.join("study.toml")).unwrap();
    let further = "further_moments = { deviation = \"moment_deviation_n_m\" }";
    assert!(toml.contains(further));
    let alone = toml.replace(further, "") + "\n[columns]\nignore = [\"moment_deviation_n_m\"]\n";
    let truth: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(source.join("truth.json")).unwrap()).unwrap();
    let identified = |toml: &str| -> serde_json::Value {
        std::fs::write(folder.path().join("study.toml"), toml).unwrap();
        let mut command = carpus();
        command.arg("identify").arg(folder.path()).arg("--out").arg(folder.path().join("out"));
        let done = command.args(["--draws", "40", "--json"]).assert().success();
        serde_json::from_slice(&done.get_output().stdout).unwrap()
    };
    let [one, two] = [alone, toml].map(|toml| identified(&toml)[0]["parameters"].as_array().unwrap().clone());
    let width = |p: &serde_json::Value| {
        let [a, b] = [0, 1].map(|i| p["interval"][i].as_f64().unwrap());
        (b / a).ln()
    };
    let (mut held, mut narrower) = (0, 0);
    for (a, b) in one.iter().zip(&two) {
        let (muscle, property) = (b["muscle"].as_str().unwrap(), b["property"].as_str().unwrap());
        let value = truth["parameters"][muscle][property].as_f64().unwrap();
        let [lower, upper] = [0, 1].map(|i| b["interval"][i].as_f64().unwrap());
        held += usize::from(lower <= value && value <= upper);
        narrower += usize::from(width(b) < width(a) - 1e-6);
        println!(
            "{muscle} {property:22} {value:.5} in [{lower:.5}, {upper:.5}]; log width {:.3} → {:.3}",
            width(a),
            width(b)
        );
    }
    let sum = |all: &[serde_json::Value]| all.iter().map(width).sum::<f64>();
    println!("{held} of {} hold the truth; {narrower} are narrower: {:.2} → {:.2}", two.len(), sum(&one), sum(&two));
    assert_eq!(two.len(), 24);
    // 90 % of 24 are 21.6; fewer than 18 would be a chance of 1 %.
    assert!(held >= 18, "{held}");
}

/// What the warning of `identify` and the manifest say is what the table of 24 simulated studies gives.
#[test]
fn regress_coverage_of_intervals_is_what_is_said() {
    let folder = root("fixtures/identifiability");
    let text = std::fs::read_to_string(folder.join("manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut table = csv::Reader::from_path(folder.join("coverage.csv")).unwrap();
    let header = table.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap();
    let number = |row: &csv::StringRecord, name: &str| -> f64 { row[column(name)].parse().unwrap() };
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    let studies: std::collections::BTreeSet<&str> = rows.iter().map(|r| &r[column("study")]).collect();
    assert_eq!(studies.len(), 24);
    let percent = |chosen: &dyn Fn(&csv::StringRecord) -> bool| {
        let held = |r: &&csv::StringRecord| (number(r, "lower")..=number(r, "upper")).contains(&number(r, "truth"));
        let of: Vec<&csv::StringRecord> = rows.iter().filter(|r| chosen(r)).collect();
        (100.0 * of.iter().copied().filter(|r| held(r)).count() as f64 / of.len() as f64).round()
    };
    let said = &manifest["covered_percent"];
    for property in MuscleProperty::USUAL {
        assert_eq!(percent(&|r| r[column("property")] == *property.name()), said[property.name()].as_f64().unwrap());
    }
    let all = percent(&|_| true);
    assert_eq!(all, said["all"].as_f64().unwrap());
    let determined = percent(&|r| &r[column("determined")] == "True");
    assert_eq!(determined, said["both_ends_from_data"].as_f64().unwrap());
    assert!((85.0..=95.0).contains(&all) && (85.0..=95.0).contains(&determined));
}
