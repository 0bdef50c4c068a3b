//! Sensitivity analysis against closed forms, Morris' test function and SALib.

use std::convert::Infallible;
use std::f64::consts::PI;

use carpus::sensitivity::*;
use serde_json::Value;

/// Largest difference from SALib on the same sample and responses.
const SALIB_TOLERANCE: f64 = 1e-10;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
}

fn reference(key: &str) -> Vec<Value> {
    let all: Value = serde_json::from_str(include_str!("../../fixtures/sensitivity/reference_sensitivity.json"))
        .expect("valid JSON");
    all[key].as_array().expect("cases").clone()
}

fn unit(m: usize) -> Vec<Parameter> {
    (0..m).map(|i| Parameter::new(format!("x{}", i + 1), 0.0, 1.0).expect("bounds")).collect()
}

/// Ishigami & Homma (1990) with a = 7, b = 0.1; each input over [−π, π].
fn ishigami(x: &[f64]) -> Result<f64, Infallible> {
    Ok(x[0].sin() + 7.0 * x[1].sin().powi(2) + 0.1 * x[2].powi(4) * x[0].sin())
}

fn ishigami_inputs() -> Vec<Parameter> {
    (1..=3).map(|i| Parameter::new(format!("x{i}"), -PI, PI).expect("bounds")).collect()
}

/// First-order and total indices in closed form.
fn ishigami_indices() -> ([f64; 3], [f64; 3]) {
    let (a, b) = (7.0f64, 0.1f64);
    let v1 = 0.5 * (1.0 + b * PI.powi(4) / 5.0).powi(2);
    let v2 = a * a / 8.0;
    let v13 = b * b * PI.powi(8) * (1.0 / 18.0 - 1.0 / 50.0);
    let v = v1 + v2 + v13;
    ([v1 / v, v2 / v, 0.0], [(v1 + v13) / v, v2 / v, v13 / v])
}

/// Morris (1991), section 4, with the remaining coefficients of first and second order (−1)^i and (−1)^(i+j) in place
/// of random ones, as in the R package `sensitivity`.
fn morris_function(x: &[f64]) -> Result<f64, Infallible> {
    let w: Vec<f64> = (0..20)
        .map(|i| if [2, 4, 6].contains(&i) { 2.0 * (1.1 * x[i] / (x[i] + 0.1) - 0.5) } else { 2.0 * (x[i] - 0.5) })
        .collect();
    let sign = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
    let mut y = 0.0;
    for i in 0..20 {
        y += w[i] * if i < 10 { 20.0 } else { sign(i + 1) };
        for j in i + 1..20 {
            y += w[i] * w[j] * if j < 6 { -15.0 } else { sign(i + j) };
            for k in j + 1..5 {
                y += -10.0 * w[i] * w[j] * w[k];
                for l in k + 1..4 {
                    y += 5.0 * w[i] * w[j] * w[k] * w[l];
                }
            }
        }
    }
    Ok(y)
}

#[test]
fn val_salib_morris_on_identical_samples() {
    let mut worst = 0.0f64;
    for case in reference("morris") {
        let m = case["m"].as_u64().expect("m") as usize;
        let points: Vec<Vec<f64>> = case["x"].as_array().expect("points").iter().map(numbers).collect();
        let sample = MorrisSample::from_trajectories(&points, m).expect("one at a time");
        assert_eq!(sample.points(), points);
        let values: Vec<Result<f64, RunFailure>> = numbers(&case["y"]).into_iter().map(Ok).collect();
        let result = sample.analyze(&unit(m), &values, 100, 1).expect("complete");
        for (i, ours) in result.indices.iter().enumerate() {
            for (key, ours) in [("mu", ours.mu), ("mu_star", ours.mu_star), ("sigma", ours.sigma)] {
                let residual = (ours - numbers(&case[key])[i]).abs();
                assert!(residual < SALIB_TOLERANCE, "{key} of {i}: {residual:e}");
                worst = worst.max(residual);
            }
        }
    }
    println!("largest residual {worst:.1e}");
}

#[test]
fn val_salib_sobol_on_identical_samples() {
    let mut worst = 0.0f64;
    for case in reference("sobol") {
        let m = case["m"].as_u64().expect("m") as usize;
        let points: Vec<Vec<f64>> = case["x"].as_array().expect("points").iter().map(numbers).collect();
        let rows: Vec<Vec<f64>> =
            points.chunks_exact(m + 2).map(|row| [row[0].clone(), row[m + 1].clone()].concat()).collect();
        let sample = SobolSample::from_rows(&rows, m).expect("rows");
        assert_eq!(sample.points(), points, "the same hybrids in the same order");
        let values: Vec<Result<f64, RunFailure>> = numbers(&case["y"]).into_iter().map(Ok).collect();
        let result = sample.analyze(&unit(m), &values, FirstOrderEstimator::Saltelli, 0, 1).expect("complete");
        for (i, ours) in result.indices.iter().enumerate() {
            for (key, ours) in [("s1", ours.first_order), ("st", ours.total_order)] {
                let residual = (ours - numbers(&case[key])[i]).abs();
                assert!(residual < SALIB_TOLERANCE, "{key} of {i}: {residual:e}");
                worst = worst.max(residual);
            }
        }
    }
    println!("largest residual {worst:.1e}");
}

#[test]
fn verif_sobol_of_ishigami() {
    let (first, total) = ishigami_indices();
    let sample = SobolSample::latin_hypercube(3, 1 << 14, 7).expect("rows");
    for estimator in [FirstOrderEstimator::Saltelli, FirstOrderEstimator::Jansen] {
        let result = sample.run(&ishigami_inputs(), ishigami, estimator, 200, 7).expect("no failures");
        assert_eq!(result.runs, 5 << 14);
        assert!((result.mean - 3.5).abs() < 0.05, "{}", result.mean);
        for (i, ours) in result.indices.iter().enumerate() {
            println!(
                "{estimator:?} {}: {:.4} ({:.4}) {:.4} ({:.4})",
                ours.name, ours.first_order, first[i], ours.total_order, total[i]
            );
            // 0.02 is three standard errors of the worst estimate at this size (half the width of its interval, 1.5
            // times).
            assert!((ours.first_order - first[i]).abs() < 0.02);
            assert!((ours.total_order - total[i]).abs() < 0.02);
            let [low, high] = ours.total_order_interval_95.expect("resampled");
            assert!(low < ours.total_order && ours.total_order < high && high - low < 0.06);
        }
    }
}

#[test]
fn verif_sobol_sequence_is_nearer_to_ishigami_than_a_hypercube() {
    let (first, total) = ishigami_indices();
    let mean_square = |sample: &dyn Fn(u64) -> SobolSample| {
        let mut sum = 0.0;
        for seed in 0..20 {
            let result = sample(seed)
                .run(&ishigami_inputs(), ishigami, FirstOrderEstimator::Saltelli, 0, seed)
                .expect("no failures");
            for (i, ours) in result.indices.iter().enumerate() {
                sum += (ours.first_order - first[i]).powi(2) + (ours.total_order - total[i]).powi(2);
            }
        }
        (sum / 120.0).sqrt()
    };
    let hypercube = mean_square(&|seed| SobolSample::latin_hypercube(3, 1024, seed).expect("rows"));
    let sequence = mean_square(&|seed| SobolSample::sobol_sequence(3, 1024, seed).expect("rows"));
    println!("root mean square error of indices from 1024 rows: {hypercube:.4} hypercube, {sequence:.4} sequence");
    assert!(sequence < 0.5 * hypercube && sequence < 0.01, "{sequence} {hypercube}");
}

#[test]
fn verif_sobol_intervals_contain_the_truth_as_often_as_they_say() {
    let (first, total) = ishigami_indices();
    let (mut inside, mut all) = (0, 0);
    for seed in 0..60 {
        let sample = SobolSample::latin_hypercube(3, 512, seed).expect("rows");
        let result = sample.run(&ishigami_inputs(), ishigami, FirstOrderEstimator::Saltelli, 200, seed).expect("runs");
        for (i, ours) in result.indices.iter().enumerate() {
            for (interval, truth) in
                [(ours.first_order_interval_95, first[i]), (ours.total_order_interval_95, total[i])]
            {
                let [low, high] = interval.expect("resampled");
                inside += usize::from((low..=high).contains(&truth));
                all += 1;
            }
        }
    }
    let coverage = inside as f64 / all as f64;
    println!("coverage of 95 % intervals {coverage:.3}");
    assert!((0.90..=0.995).contains(&coverage), "{coverage}");
}

#[test]
fn val_morris_1991_test_function() {
    // Mean of the curved inputs' w: over the grid 0, ⅓, ⅔, 1, and over [0, 1].
    let curved = |x: f64| 2.0 * (1.1 * x / (x + 0.1) - 0.5);
    let over_grid = (0..4).map(|k| curved(f64::from(k) / 3.0)).sum::<f64>() / 4.0;
    let over_range = 2.0 * (1.1 * (1.0 - 0.1 * 11f64.ln()) - 0.5);
    let screens = [
        (MorrisSample::trajectories(20, 400, 4, 3).expect("levels"), over_grid),
        (MorrisSample::radial(20, 400, 3).expect("starts"), over_range),
    ];
    for (sample, mean_curved) in screens {
        let result = sample.screen(&unit(20), morris_function, 200, 5).expect("no failures");
        assert_eq!((result.runs, result.lost_effects), (400 * 21, 0));
        let of = |i: usize| &result.indices[i - 1];
        // Inputs 1–10 matter, 11–20 do not; 8, 9, 10 act almost alone and linearly, 1–7 through curvature or others.
        let least_active = (1..=10).map(|i| of(i).mu_star).fold(f64::INFINITY, f64::min);
        let most_idle = (11..=20).map(|i| of(i).mu_star).fold(0.0, f64::max);
        assert!(least_active > 3.0 * most_idle, "{least_active} {most_idle}");
        for i in 8..=10 {
            assert!(of(i).sigma < 0.25 * of(i).mu_star, "{i}: {:?}", of(i));
            // 2 (20 ± 3 E[w]), the three curved inputs being the only ones whose mean is not zero.
            let sign = if i == 9 { 1.0 } else { -1.0 };
            let exact = 2.0 * (20.0 + 3.0 * sign * mean_curved);
            assert!((of(i).mu - exact).abs() < 4.0 * of(i).sigma / 20.0, "{i}: {exact} {:?}", of(i));
        }
        for i in 1..=7 {
            assert!(of(i).sigma > 0.3 * of(i).mu_star, "{i}: {:?}", of(i));
        }
        for index in &result.indices {
            let [low, high] = index.mu_star_interval_95.expect("resampled");
            assert!(low < index.mu_star && index.mu_star < high);
        }
        let steps = result.convergence(&[10, 25, 100, 400, 1, 401]);
        assert_eq!(steps.iter().map(|s| s.r).collect::<Vec<_>>(), [10, 25, 100, 400]);
        assert!(steps.windows(2).all(|pair| pair[1].widest_interval < pair[0].widest_interval), "{steps:?}");
        let last = steps.last().expect("four");
        assert!(last.mu_star.iter().zip(&result.indices).all(|(a, b)| *a == b.mu_star));
    }
}

#[test]
fn verif_morris_of_a_linear_response_is_its_slopes() {
    let parameters = vec![
        Parameter::new("a", -1.0, 1.0).expect("bounds"),
        Parameter::new("b", 10.0, 15.0).expect("bounds"),
        Parameter::new("idle", 0.0, 1.0).expect("bounds"),
    ];
    let response = |x: &[f64]| Ok::<_, Infallible>(3.0 * x[0] - 2.0 * x[1]);
    let result = MorrisSample::radial(3, 25, 1).expect("starts").screen(&parameters, response, 50, 1).expect("runs");
    assert_eq!(result.runs, 25 * 4, "K = r (m + 1)");
    for (index, slope) in result.indices.iter().zip([6.0, -10.0, 0.0]) {
        assert!((index.mu - slope).abs() < 1e-9 && (index.mu_star - slope.abs()).abs() < 1e-9 && index.sigma < 1e-8);
    }
}

#[test]
fn verif_failed_runs_are_halved_counted_and_listed() {
    let parameters = unit(2);
    // Fails in the upper tenth of the first parameter; linear elsewhere, so shorter steps give the same effect.
    let response = |x: &[f64]| if x[0] > 0.9 { Err("fibre length is zero") } else { Ok(4.0 * x[0] + x[1]) };
    let sample = MorrisSample::radial(2, 50, 2).expect("starts");
    let expected_failures = sample.points().iter().filter(|p| p[0] > 0.9).count();
    let result = sample.screen(&parameters, response, 100, 2).expect("most runs succeed");
    assert!(expected_failures > 0);
    assert_eq!(result.failures.len(), expected_failures);
    assert!(result.failures.iter().all(|f| f.values[0] > 0.9 && f.reason == "fibre length is zero"));
    assert!(result.recovered_effects > 0 && result.extra_runs >= result.recovered_effects);
    let given = result.effects.iter().flatten().filter(|e| e.is_none()).count();
    assert_eq!(result.lost_effects, given);
    assert_eq!(result.indices[0].n_effects + result.indices[1].n_effects + given, 100);
    assert!((result.indices[0].mu - 4.0).abs() < 1e-9 && (result.indices[1].mu - 1.0).abs() < 1e-9);

    let never = |_: &[f64]| Err::<f64, _>("no equilibrium");
    let error = sample.screen(&parameters, never, 100, 2);
    assert!(matches!(
        error,
        Err(SensitivityError::NothingLeft { failed: 150, runs: 150, ref first }) if first == "no equilibrium"
    ));
    let nan = |_: &[f64]| Ok::<_, Infallible>(f64::NAN);
    assert!(matches!(sample.screen(&parameters, nan, 100, 2), Err(SensitivityError::NothingLeft { .. })));

    let sobol = SobolSample::latin_hypercube(2, 200, 2).expect("rows");
    let result = sobol.run(&parameters, response, FirstOrderEstimator::Jansen, 0, 1).expect("most runs succeed");
    assert!(result.indices[0].n_rows < 200 && result.failures.len() > 20);
    let constant = |_: &[f64]| Ok::<_, Infallible>(2.0);
    let error = sobol.run(&parameters, constant, FirstOrderEstimator::Jansen, 0, 1);
    assert_eq!(error, Err(SensitivityError::NoVariation { value: 2.0 }));
}

#[test]
fn verif_latin_hypercube_visits_every_slice_once() {
    for points in [latin_hypercube(37, 5, 9), maximin_latin_hypercube(37, 5, 30, 9)] {
        for dimension in 0..5 {
            let mut slices: Vec<usize> = points.iter().map(|p| (p[dimension] * 37.0) as usize).collect();
            slices.sort_unstable();
            assert!(slices.into_iter().eq(0..37));
        }
    }
    let closest = |points: &[Vec<f64>]| {
        let mut least = f64::INFINITY;
        for i in 0..points.len() {
            for j in 0..i {
                let d: f64 = points[i].iter().zip(&points[j]).map(|(a, b)| (a - b).powi(2)).sum();
                least = least.min(d);
            }
        }
        least
    };
    assert!(closest(&maximin_latin_hypercube(37, 5, 30, 9)) > closest(&latin_hypercube(37, 5, 9)));
}

#[test]
fn verif_same_seed_same_numbers_at_any_thread_count() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let morris = MorrisSample::radial(3, 25, 4).expect("starts");
            let sobol = SobolSample::latin_hypercube(3, 300, 4).expect("rows");
            let estimator = FirstOrderEstimator::Saltelli;
            (
                morris.screen(&ishigami_inputs(), ishigami, 100, 4).expect("runs"),
                sobol.run(&ishigami_inputs(), ishigami, estimator, 100, 4).expect("runs"),
            )
        })
    };
    assert_eq!(run(1), run(4));
    let other = MorrisSample::radial(3, 25, 5).expect("starts");
    assert_ne!(other.points(), MorrisSample::radial(3, 25, 4).expect("starts").points());
}

mod of_muscles {
    //! Muscle parameters on the bundled study, through the library and through the binary.

    use std::path::PathBuf;

    use assert_cmd::Command;
    use carpus::evaluation::error_measures;
    use carpus::osim::OsimFile;
    use carpus::osim::spec::{ModelSpec, MuscleKind};
    use carpus::sensitivity::{MuscleScreening, ScreenedProperty};
    use carpus::simulation::{FiberAccuracy, MusculoskeletalModel, Options, Recording, Setup, SimulationError};
    use carpus::study::{Study, Trial};
    use predicates::str::contains;

    fn study() -> PathBuf {
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/demo_study/study.toml")
    }

    fn isotonic() -> (Study, ModelSpec, Trial) {
        let study = Study::read_tables(study()).expect("the bundled study");
        let file = OsimFile::read(&study.settings.model).expect("the bundled model");
        let info = study.trials.iter().find(|t| t.name == "isotonic_25_flexion_1").expect("a trial");
        let trial = study.trial(info).expect("readable");
        (study, file.spec, trial)
    }

    fn compile(study: &Study, spec: &ModelSpec) -> MusculoskeletalModel {
        MusculoskeletalModel::compile(spec, &Setup::from_settings(&study.settings)).expect("compiles")
    }

    #[test]
    fn verif_other_damping_is_that_of_a_model_with_it() {
        let (study, spec, trial) = isotonic();
        let recording = Recording::from(&trial);
        let model = compile(&study, &spec);
        let prepared = model.prepare(&recording, &Options::default()).expect("prepared");
        let nominal = prepared.fiber_damping();
        assert_eq!(prepared.with_fiber_damping(&nominal).expect("allowed").fiber_damping(), nominal);

        let mut edited = spec.clone();
        for muscle in &mut edited.muscles {
            if let MuscleKind::Millard2012Equilibrium(properties) = &mut muscle.kind {
                properties.fiber_damping = 0.03;
            }
        }
        let edited = compile(&study, &edited);
        let parameters = model.nominal_parameters();
        let largest = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0f64, |m, (x, y)| m.max((x - y).abs()));
        // Steps are planned with the model's own damping, so the two differ by the error of the integration, which has
        // to fall when it is made more accurate.
        let difference = |options: &Options| {
            let own = model.prepare(&recording, options).expect("prepared");
            let changed = own.with_fiber_damping(&[Some(0.03); 5]).expect("allowed").simulate(&parameters);
            let other = edited.prepare(&recording, options).expect("prepared").simulate(&parameters);
            largest(&changed.expect("simulates").moment, &other.expect("simulates").moment)
        };
        let fine = Options { fiber: FiberAccuracy { tolerance: 1e-9, max_step: 0.02 }, ..Options::default() };
        let (usual, fine) = (difference(&Options::default()), difference(&fine));
        let changed = prepared.with_fiber_damping(&[Some(0.03); 5]).expect("allowed").simulate(&parameters);
        let before = prepared.simulate(&parameters).expect("simulates").moment;
        let effect = largest(&changed.expect("simulates").moment, &before);
        println!("same damping {usual:.1e}, finer steps {fine:.1e}; effect of damping {effect:.1e} N·m");
        // The integration's documented accuracy, 1e-5 of each muscle's maximum isometric force, as a moment.
        let arm = |i: usize| prepared.kinematics().muscles[i].moment_arm.iter().fold(0.0f64, |m, r| m.max(r.abs()));
        let accuracy: f64 = (0..5).map(|i| 1e-5 * parameters[i].max_isometric_force * arm(i)).sum();
        assert!(usual < accuracy, "{usual:e} {accuracy:e}");
        assert!(fine < 0.1 * usual, "{fine:e} {usual:e}");
        assert!(effect > 100.0 * usual);

        for (damping, count) in [(vec![0.0; 5], false), (vec![1.5; 5], false), (vec![0.1; 4], true)] {
            let damping: Vec<Option<f64>> = damping.into_iter().map(Some).collect();
            match prepared.with_fiber_damping(&damping) {
                Err(SimulationError::ParameterCount { found: 4, expected: 5 }) => assert!(count),
                Err(SimulationError::InvalidParameter { property: "fiber_damping", .. }) => assert!(!count),
                other => panic!("{:?}", other.map(|_| ())),
            }
        }
    }

    #[test]
    fn verif_response_of_the_model_itself_is_its_error() {
        let (study, spec, trial) = isotonic();
        let model = compile(&study, &spec);
        let prepared = model.prepare(&Recording::from(&trial), &Options::default()).expect("prepared");
        let nominal = model.nominal_parameters();
        let screening = MuscleScreening::new(vec![(&prepared, &trial.moment)], &nominal).expect("a trial");
        let simulated = prepared.simulate(&nominal).expect("simulates");
        let error = error_measures(&trial.moment, &simulated.moment).expect("comparable").objective.value();
        let parameters = MuscleScreening::parameters(&model.muscle_names().collect::<Vec<_>>()).expect("bounds");
        assert_eq!(parameters.len(), 25);
        assert!(parameters.iter().all(|p| (p.lower..=p.upper).contains(&1.0)));
        // The moments of muscles are summed in another order.
        let same = |found: Option<f64>, expected: Option<f64>| {
            let (found, expected) = (found.expect("a response"), expected.expect("an error"));
            assert!((found - expected).abs() < 1e-13, "{found} {expected}");
        };
        same(screening.response(&[1.0; 25]).ok(), error);

        // Twice the force of every muscle: the response of the same model with these parameters.
        let mut fractions = [1.0; 25];
        let mut stronger = nominal.clone();
        for (i, muscle) in stronger.iter_mut().enumerate() {
            fractions[5 * i + 2] = 2.0;
            muscle.max_isometric_force *= 2.0;
        }
        let simulated = prepared.simulate(&stronger).expect("simulates");
        let error = error_measures(&trial.moment, &simulated.moment).expect("comparable").objective.value();
        same(screening.response(&fractions).ok(), error);
        assert_eq!(ScreenedProperty::ALL[2].name(), "max_isometric_force");
    }

    fn carpus(arguments: &[&str]) -> Command {
        let mut command = Command::cargo_bin("carpus").expect("built");
        command.timeout(std::time::Duration::from_secs(300)).args(arguments);
        command
    }

    #[test]
    fn verif_command_writes_its_tables_the_same_at_any_thread_count() {
        let run = |threads: &str| {
            let out = tempfile::tempdir().expect("a folder");
            let (path, study) = (out.path().to_str().expect("UTF-8").to_owned(), study());
            let study = study.to_str().expect("UTF-8");
            let arguments =
                ["sensitivity", study, "--out", &path, "--starts", "3", "--sobol", "4", "--resamples", "20"];
            carpus(&arguments).args(["--threads", threads]).assert().success().stdout(contains("isotonic 50 %"));
            ["morris.csv", "sobol.csv", "convergence.csv"]
                .map(|name| std::fs::read_to_string(out.path().join(name)).expect("written"))
        };
        let one = run("1");
        assert_eq!(one, run("3"));
        // Four conditions of 25 parameters, and a header.
        assert_eq!(one[0].lines().count(), 101);
        assert_eq!(one[1].lines().count(), 101);
        assert!(one[0].contains("P01,isometric,25,ECRL,tendon_slack_length,"));
    }

    #[test]
    fn verif_power_command_gives_the_dissertation_numbers() {
        let arguments = ["power", "point-biserial", "--effect", "0.64", "--n", "5", "--tails", "1"];
        carpus(&arguments).assert().success().stdout(contains("power with 5 participants: 0.42"));
        carpus(&arguments).assert().success().stdout(contains("for a power of 0.8: 11"));
        carpus(&["power", "correlation", "--effect", "1"]).assert().code(1).stderr(contains("correlation: expected"));
    }
}
