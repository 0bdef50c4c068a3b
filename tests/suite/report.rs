//! The results schema and the report page, on results made up here (not computed by the program).

use std::collections::BTreeMap;

use carpus::report::render_report;
use carpus::report::results::{
    Condition, ConditionErrors, Errors, HeldCoordinate, InputFile, Kind, ModelResult, ParameterResult,
    ParticipantResult, Provenance, Results, ResultsError, SCHEMA, Series, StageResult, StudyResult, TrialResult, Use,
    UseErrors, WarningResult, thinned,
};

/// Noise that repeats: a linear congruential generator, uniform in −1…1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as f64 / (1u64 << 30) as f64 - 1.0
    }
}

fn errors(nrmse: f64) -> Errors {
    Errors {
        nrmse: Some(nrmse),
        max_error: Some(2.2 * nrmse),
        xcorr: Some(0.9 * nrmse),
        objective: Some(4.1 * nrmse),
        rmse_n_m: Some(5.0 * nrmse),
        pearson_r: Some(1.0 - nrmse * nrmse),
        r_squared: Some(1.0 - 2.0 * nrmse),
    }
}

fn trial(contraction: &str, effort: f64, direction: &str, repetition: u32, noise: &mut Noise) -> TrialResult {
    let time_s: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.025).collect();
    let moves = contraction == "isotonic";
    let sign = if direction == "flexion" { 1.0 } else { -0.8 };
    let posture = [-30.0, 0.0, 30.0][(repetition as usize - 1) % 3];
    let angle_deg: Vec<f64> =
        time_s.iter().map(|t| if moves { 35.0 * (1.3 * t).sin() } else { posture + 0.3 * noise.next() }).collect();
    let ideal: Vec<f64> = time_s
        .iter()
        .map(|t| {
            let ramp = ((t - 0.6) / 0.4).clamp(0.0, 1.0) * ((4.6 - t) / 0.3).clamp(0.0, 1.0);
            sign * effort * 0.14 * ramp * (1.0 + 0.12 * (2.1 * t).sin())
        })
        .collect();
    let measured_n_m = ideal.iter().map(|m| m + 0.08 * noise.next()).collect();
    let before = ideal.iter().zip(&angle_deg).map(|(m, a)| 1.32 * m + 0.004 * a).collect();
    let after = ideal.iter().map(|m| 0.98 * m).collect();
    let held_out = repetition == 3;
    let gap = 0.3 + 0.03 * noise.next();
    TrialResult {
        id: format!("{contraction}_{effort}_{direction}_{repetition}"),
        file: format!("data/P01/{contraction}_{effort}_{direction}_{repetition}.csv"),
        condition: Condition {
            contraction: contraction.into(),
            effort_percent: Some(effort),
            direction: direction.into(),
        },
        posture_deg: (!moves).then_some(posture),
        held: Vec::new(),
        repetition: Some(repetition),
        trial_use: if held_out { Use::HeldOut } else { Use::Train },
        samples: 5000,
        moment_noise_n_m: Some(0.046),
        errors: BTreeMap::from([
            ("before".to_string(), errors(gap)),
            ("after".to_string(), errors(0.05 + 0.01 * noise.next() + if held_out { 0.012 } else { 0.0 })),
        ]),
        series: Series {
            time_s,
            angle_deg,
            measured_n_m,
            simulated_n_m: BTreeMap::from([("before".to_string(), before), ("after".to_string(), after)]),
        },
    }
}

fn mean(trials: &[&TrialResult], model: &str) -> Errors {
    errors(trials.iter().filter_map(|t| t.errors[model].nrmse).sum::<f64>() / trials.len() as f64)
}

fn model(id: &str, label: &str, trials: &[TrialResult]) -> ModelResult {
    let of_use = |u: Use| trials.iter().filter(move |t| t.trial_use == u);
    let mut conditions = Vec::new();
    for trial_use in [Use::Train, Use::HeldOut] {
        let mut seen: Vec<&Condition> = Vec::new();
        for t in of_use(trial_use) {
            if !seen.contains(&&t.condition) {
                seen.push(&t.condition);
            }
        }
        for condition in seen {
            let members: Vec<_> = of_use(trial_use).filter(|t| t.condition == *condition).collect();
            conditions.push(ConditionErrors {
                condition: condition.clone(),
                trial_use,
                trials: members.len(),
                errors: mean(&members, id),
            });
        }
    }
    let total = |u: Use| {
        let members: Vec<_> = of_use(u).collect();
        UseErrors { trial_use: u, trials: members.len(), errors: mean(&members, id) }
    };
    ModelResult {
        id: id.into(),
        label: label.into(),
        name: "wrist".into(),
        file: format!("{id}/wrist.osim"),
        errors: vec![total(Use::Train), total(Use::HeldOut)],
        conditions,
    }
}

/// A personalization as it could come out.
fn example() -> Results {
    let mut noise = Noise(7);
    let mut trials = Vec::new();
    for contraction in ["isometric", "isotonic"] {
        for effort in [25.0, 50.0] {
            for direction in ["flexion", "extension"] {
                trials.extend((1..=3).map(|r| trial(contraction, effort, direction, r, &mut noise)));
            }
        }
    }
    let muscles = [("ECRL", 0.081, 0.244, 337.3), ("ECRB", 0.0585, 0.2223, 252.5), ("ECU", 0.0622, 0.2285, 192.9)];
    let muscles = muscles.into_iter().chain([("FCR", 0.0628, 0.244, 407.9), ("FCU", 0.0509, 0.265, 479.8)]);
    let parameters = muscles.flat_map(|(muscle, fiber, tendon, force)| {
        [("optimal_fiber_length", "m", fiber, 0.822, 1.178), ("tendon_slack_length", "m", tendon, 0.868, 1.132)]
            .into_iter()
            .chain([("max_isometric_force", "N", force, 0.42, 2.514)])
            .enumerate()
            .map(|(i, (property, unit, before, lower, upper))| ParameterResult {
                muscle: muscle.to_string(),
                property: property.to_string(),
                unit: unit.to_string(),
                before,
                after: before * if muscle == "ECU" && i == 0 { 1.178 } else { [0.94, 1.03, 1.41][i] },
                lower: before * lower,
                upper: before * upper,
                standard_deviation: Some(0.04 * before),
                share_from_data: Some(if muscle == "FCR" { 0.31 } else { 0.87 }),
                interval: None,
            })
            .collect::<Vec<_>>()
    });
    let mut parameters: Vec<_> = parameters.collect();
    parameters.sort_by_key(|p| {
        ["optimal_fiber_length", "tendon_slack_length"].iter().position(|n| *n == p.property).unwrap_or(2)
    });
    let input = |path: &str, role: &str| InputFile {
        path: path.into(),
        role: role.into(),
        sha256: "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08".into(),
    };
    Results {
        schema: SCHEMA.into(),
        kind: Kind::Personalization,
        provenance: Provenance {
            program: "carpus".into(),
            version: "0.1.0".into(),
            command: "carpus personalize study.toml --out results --seed 1".into(),
            seed: 1,
            inputs: vec![input("study.toml", "study"), input("wrist.osim", "model"), input("trials.csv", "trials")],
        },
        study: StudyResult {
            name: "Wrist flexion and extension".into(),
            coordinate: "flexion".into(),
            moment_includes: vec!["muscles".into(), "passive".into()],
            active_muscles: ["ECRL", "ECRB", "ECU", "FCR", "FCU"].map(String::from).to_vec(),
            posture: vec![HeldCoordinate { coordinate: "elbow_flexion".into(), value: 90.0, unit: "deg".into() }],
        },
        participant: ParticipantResult {
            id: "P01".into(),
            mass_kg: Some(71.3),
            height_m: Some(1.75),
            sex: Some("female".into()),
            side: Some("right".into()),
        },
        models: vec![model("before", "Before", &trials), model("after", "Personalized", &trials)],
        trials,
        parameters,
        part_of_the_way: Some(0.83),
        stages: vec![
            StageResult { name: "lengths".into(), evaluations: 12000, objective_before: 1.31, objective_after: 0.62 },
            StageResult { name: "forces".into(), evaluations: 8000, objective_before: 0.62, objective_after: 0.21 },
        ],
        residuals: Vec::new(),
        muscles: None,
        diagnosis: None,
        ledger: None,
        live: None,
        warnings: vec![WarningResult {
            at: Some("data/P01/isotonic_25_flexion_1.csv:812".into()),
            message: "gap of 0.12 s between samples; the angle was interpolated".into(),
            hint: Some("mark the trial `ignore` in trials.csv if the recording stopped there".into()),
        }],
    }
}

#[test]
fn verif_results_survive_writing_and_reading() {
    let results = example();
    let text = results.to_json();
    assert!(Results::parse(&text).unwrap() == results, "reading gives what was written");
    assert!(text.starts_with("{\n  \"schema\": \"carpus.results/1\","), "the schema comes first");
    assert!(text.lines().any(|l| l.trim_start().starts_with("\"time_s\": [0.0,0.025,")), "a series is one line");
    assert_eq!(text, results.to_json());
}

#[test]
fn verif_inconsistent_results_are_refused() {
    let mut results = example();
    results.schema = "carpus.results/0".into();
    assert!(
        matches!(Results::parse(&results.to_json()), Err(ResultsError::Schema { found }) if found == "carpus.results/0")
    );

    let mut results = example();
    results.trials[1].series.measured_n_m.pop();
    let error = Results::parse(&results.to_json()).unwrap_err();
    assert!(matches!(
        &error,
        ResultsError::SeriesLength { column, expected: 200, found: 199, .. } if column == "measured_n_m"
    ));

    let mut results = example();
    results.trials[0].errors.insert("other".into(), errors(0.1));
    assert!(matches!(Results::parse(&results.to_json()), Err(ResultsError::UnknownModel { .. })));

    let text = example().to_json().replacen("\"seed\"", "\"sed\"", 1);
    assert!(Results::parse(&text).unwrap_err().to_string().contains("sed"));
}

#[test]
fn verif_page_needs_nothing_from_outside() {
    let page = render_report(&example());
    for loading in ["src=", "href=\"http", "url(", "@import", "<link", "<iframe", "style=\"", "onclick"] {
        assert!(!page.contains(loading), "the page contains {loading}");
    }
    assert!(page.contains("default-src 'none'; style-src 'sha256-"));
    if let Some(path) = std::env::var_os("CARPUS_REPORT_OUT") {
        std::fs::write(path, page).unwrap();
    }
}

#[test]
fn verif_page_shows_every_trial_parameter_and_input() {
    let results = example();
    let page = render_report(&results);
    let at = |id: &str| page.find(&format!("<section id=\"{id}\"")).unwrap_or_else(|| panic!("no section {id}"));
    let trials = &page[at("trials")..at("parameters")];
    assert_eq!(trials.matches("<figure class=\"panel").count(), results.trials.len());
    assert_eq!(trials.matches("<figure class=\"panel held\"").count(), 8, "held-out panels");
    assert_eq!(trials.matches("class=\"curve measured\"").count(), results.trials.len());
    assert_eq!(trials.matches("class=\"curve before\"").count(), results.trials.len());
    let angles = &page[at("angles")..at("trials")];
    assert_eq!(angles.matches("<figure class=\"panel").count(), 8, "a figure of every condition that has angles");
    assert_eq!(angles.matches("class=\"band after\"").count(), 8, "the model's range");
    assert!(angles.matches("class=\"dot measured\"").count() >= 2 * 8, "points at two angles and more");
    for parameter in &results.parameters {
        assert!(page.contains(&parameter.muscle) && page.contains(&parameter.property));
    }
    assert_eq!(page.matches("on bound</span>").count(), 1, "the one parameter on its bound is flagged");
    assert_eq!(page.matches("weak</span> 31").count(), 3, "weakly determined values are flagged");
    assert!(page.contains("81.0\u{202f}mm"), "lengths in millimetres");
    for input in &results.provenance.inputs {
        assert!(page.contains(&input.sha256) && page.contains(&input.path));
    }
    assert!(page.contains("gap of 0.12 s"));
}

#[test]
fn verif_headline_tells_rise_as_rise() {
    let mut results = example();
    assert!(render_report(&results).contains("The error on held-out trials fell from"));
    let (a, b) = (results.models[0].errors.clone(), results.models[1].errors.clone());
    results.models[0].errors = b;
    results.models[1].errors = a;
    assert!(render_report(&results).contains("The error on held-out trials rose from"));
}

#[test]
fn verif_numbers_that_read_the_same_are_neither_better_nor_worse() {
    let correlation = |before: f64, after: f64| {
        let mut results = example();
        for (model, r) in results.models.iter_mut().zip([before, after]) {
            model.errors.iter_mut().for_each(|e| e.errors.pearson_r = Some(r));
        }
        let page = render_report(&results);
        let label = page.find("Correlation r").expect("the card");
        let start = page[..label].rfind("<div class=\"card ").expect("its start");
        page[start..label].to_string()
    };
    assert!(!correlation(0.98604, 0.98596).contains("bad"));
    assert!(correlation(0.986, 0.985).contains("bad") && correlation(0.985, 0.986).contains("good"));
}

#[test]
fn verif_page_without_held_out_trials_says_so() {
    let mut results = example();
    results.trials.retain(|t| t.trial_use == Use::Train);
    for model in &mut results.models {
        model.errors.retain(|e| e.trial_use == Use::Train);
        model.conditions.retain(|e| e.trial_use == Use::Train);
    }
    let page = render_report(&results);
    assert!(page.contains("The error on training trials fell") && page.contains("No trial was held out"));
}

#[test]
fn verif_page_of_comparison_and_of_simulation() {
    let mut results = example();
    results.kind = Kind::Comparison;
    results.models.remove(0);
    results.parameters.clear();
    results.stages.clear();
    for trial in &mut results.trials {
        trial.errors.remove("before");
        trial.series.simulated_n_m.remove("before");
    }
    let page = render_report(&results);
    assert!(page.contains("The simulated moment is") && !page.contains("class=\"curve before\""));
    assert!(!page.contains("id=\"parameters\""));

    results.kind = Kind::Simulation;
    results.models[0].errors.clear();
    results.models[0].conditions.clear();
    results.trials.iter_mut().for_each(|t| t.errors.clear());
    let page = render_report(&results);
    assert!(page.contains("24 trials simulated") && !page.contains("id=\"errors\""));
}

#[test]
fn verif_text_from_the_study_is_escaped() {
    let mut results = example();
    results.study.name = "<script>alert(1)</script>".into();
    results.trials[0].id = "a\"><b>".into();
    let page = render_report(&results);
    assert!(!page.contains("<script>alert") && !page.contains("\"><b>"));
}

#[test]
fn verif_undefined_numbers_are_a_dash() {
    let mut results = example();
    for trial in &mut results.trials {
        for e in trial.errors.values_mut() {
            *e = Errors::default();
        }
    }
    let page = render_report(&results);
    assert!(!page.contains("NaN") && !page.contains("inf"));
}

#[test]
fn verif_thinning_keeps_both_ends() {
    assert_eq!(thinned(3, 10), vec![0, 1, 2]);
    let kept = thinned(5001, 400);
    assert_eq!((kept.len(), kept[0], kept[399]), (400, 0, 5000));
    assert!(kept.windows(2).all(|w| w[1] > w[0]));
}
