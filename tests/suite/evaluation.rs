//! Tests of `evaluation`: hand-computed examples, a second route in numpy and statrs, and invariants.

use approx::{assert_abs_diff_eq, assert_relative_eq};
use carpus::evaluation::{
    Condition, ErrorMeasures, ErrorTable, EvaluationError, Measure, Spread, TrialErrors, Undefined, error_measures,
};
use carpus::study::{Contraction, Direction, TrialUse};
use proptest::prelude::*;
use statrs::statistics::Statistics;

/// The measures by name, undefined ones as NaN.
fn by_name(e: &ErrorMeasures) -> [(&'static str, f64); 11] {
    let value = |m: Measure| m.value().unwrap_or(f64::NAN);
    [
        ("nrmse", value(e.nrmse)),
        ("max_error", value(e.max_error)),
        ("xcorr", value(e.xcorr)),
        ("objective", value(e.objective)),
        ("rmse_n_m", value(e.rmse_n_m)),
        ("rmse_over_max_moment", value(e.rmse_over_max_moment)),
        ("mean_error_n_m", value(e.mean_error_n_m)),
        ("max_abs_error_n_m", value(e.max_abs_error_n_m)),
        ("max_abs_measured_n_m", e.max_abs_measured_n_m),
        ("pearson_r", value(e.pearson_r)),
        ("r_squared", value(e.r_squared)),
    ]
}

#[test]
fn verif_measures_of_a_hand_computed_example() {
    // τ_exp = 1 2 −4, τ_sim = 2 2 −1: errors −1 0 −3, max|τ_exp| = 4.
    let e = error_measures(&[1.0, 2.0, -4.0], &[2.0, 2.0, -1.0]).unwrap();
    let expected = [
        ("nrmse", (1.0 + 0.0 + 3.0) / 4.0 / 3.0),
        ("max_error", 3.0 / 4.0),
        ("xcorr", 1.0 - (2.0 + 4.0 + 4.0) / (1.0 + 4.0 + 16.0)),
        ("objective", 1.0 / 3.0 + 3.0 / 4.0 + 11.0 / 21.0),
        ("rmse_n_m", (10.0f64 / 3.0).sqrt()),
        ("rmse_over_max_moment", (10.0f64 / 3.0).sqrt() / 4.0),
        // means −1/3 and 1
        ("mean_error_n_m", 4.0 / 3.0),
        ("max_abs_error_n_m", 3.0),
        ("max_abs_measured_n_m", 4.0),
        // Σ(Δexp Δsim) = 11; Σ Δexp² = 21 − 1/3; Σ Δsim² = 9 − 3
        ("pearson_r", 11.0 / (62.0f64 / 3.0 * 6.0).sqrt()),
        ("r_squared", 1.0 - 10.0 / (62.0 / 3.0)),
    ];
    for ((name, value), (expected_name, expected)) in by_name(&e).into_iter().zip(expected) {
        assert_eq!(name, expected_name);
        assert_relative_eq!(value, expected, epsilon = 1e-15, max_relative = 1e-15);
    }
    assert_eq!(e.samples, 3);
}

#[test]
fn verif_equation_3_1_as_printed_is_the_mean_absolute_error() {
    // Under a root mean square, the single large error would weigh more: sqrt(9/9)/3, not 3/9/3.
    let e = error_measures(&[3.0; 9], &[0.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0]).unwrap();
    assert_relative_eq!(e.nrmse.value().unwrap(), 1.0 / 9.0, epsilon = 1e-15);
    assert_relative_eq!(e.rmse_over_max_moment.value().unwrap(), 1.0 / 3.0, epsilon = 1e-15);
}

#[test]
fn verif_perfect_and_absent_simulation() {
    let measured = [0.5, -1.5, 2.5];
    let perfect = error_measures(&measured, &measured).unwrap();
    assert_eq!(perfect.objective, Measure::Defined(0.0));
    assert_eq!((perfect.pearson_r, perfect.r_squared), (Measure::Defined(1.0), Measure::Defined(1.0)));
    let absent = error_measures(&measured, &[0.0; 3]).unwrap();
    assert_eq!((absent.xcorr, absent.max_error), (Measure::Defined(1.0), Measure::Defined(1.0)));
    assert_eq!(absent.pearson_r, Measure::Undefined(Undefined::ConstantSimulatedMoment));
}

#[test]
fn verif_undefined_measures_are_typed_and_never_nan_in_json() {
    let zero = error_measures(&[0.0; 4], &[1.0, 2.0, 3.0, 4.0]).unwrap();
    let undefined = Measure::Undefined(Undefined::ZeroMeasuredMoment);
    assert_eq!([zero.nrmse, zero.max_error, zero.xcorr, zero.objective], [undefined; 4]);
    assert_eq!(zero.r_squared, Measure::Undefined(Undefined::ConstantMeasuredMoment));
    assert_relative_eq!(zero.rmse_n_m.value().unwrap(), 7.5f64.sqrt(), epsilon = 1e-15);
    // 0.1 has no exact binary form: its mean differs from it in the last bit, and yet it is constant.
    let constant = error_measures(&[0.1; 7], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]).unwrap();
    assert_eq!(constant.pearson_r, Measure::Undefined(Undefined::ConstantMeasuredMoment));
    for e in [&zero, &constant] {
        let json = serde_json::to_string(e).unwrap();
        assert!(!json.contains("null") && !json.contains("NaN"), "{json}");
        assert_eq!(&serde_json::from_str::<ErrorMeasures>(&json).unwrap(), e);
    }
    assert!(serde_json::to_string(&zero).unwrap().contains(r#""nrmse":{"undefined":"zero_measured_moment"}"#));
    assert_eq!((format!("{:6.2}", zero.nrmse), format!("{:6.2}", zero.rmse_n_m)), ("–     ".into(), "  2.74".into()));
}

#[test]
fn verif_moments_that_cannot_be_compared() {
    let mismatch = EvaluationError::LengthMismatch { measured: 2, simulated: 1 };
    assert_eq!(error_measures(&[1.0, 2.0], &[1.0]), Err(mismatch));
    assert_eq!(error_measures(&[], &[]), Err(EvaluationError::NoSamples));
    let infinite = EvaluationError::NotFinite { which: "simulated", sample: 1, value: f64::INFINITY };
    assert_eq!(error_measures(&[1.0, 2.0], &[1.0, f64::INFINITY]), Err(infinite));
    let nan = error_measures(&[f64::NAN], &[1.0]).unwrap_err().to_string();
    assert!(nan.contains("measured moment is NaN at sample 0"), "{nan}");
}

#[test]
fn val_numpy_gives_the_same_measures() {
    // Rounding of sums of 60 samples; the case on a large offset loses six digits to cancellation in either program.
    const TOLERANCE: f64 = 1e-12;
    const TOLERANCE_LARGE_OFFSET: f64 = 1e-8;
    let text = include_str!("../../fixtures/evaluation/reference_measures.json");
    let fixture: serde_json::Value = serde_json::from_str(text).unwrap();
    let cases = fixture["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 4);
    for case in cases {
        let series =
            |key: &str| -> Vec<f64> { case[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect() };
        let e = error_measures(&series("measured_n_m"), &series("simulated_n_m")).unwrap();
        let name = case["name"].as_str().unwrap();
        let tolerance = if name.contains("large offset") { TOLERANCE_LARGE_OFFSET } else { TOLERANCE };
        for (key, value) in by_name(&e) {
            let expected = case["expected"][key].as_f64().unwrap();
            assert!(
                (value - expected).abs() <= tolerance * expected.abs().max(1.0),
                "{name}: {key} {value} {expected}"
            );
        }
    }
}

fn trial(usage: TrialUse, effort: f64, direction: Direction, measured: &[f64], simulated: &[f64]) -> TrialErrors {
    TrialErrors {
        participant: "P01".into(),
        file: "data/x.csv".into(),
        usage,
        condition: Condition { contraction: Contraction::Isotonic, effort_percent: Some(effort), direction },
        repetition: Some(1),
        errors: error_measures(measured, simulated).unwrap(),
    }
}

#[test]
fn verif_training_and_held_out_trials_are_never_mixed() {
    let (flexion, extension) = (Direction::Flexion, Direction::Extension);
    let measured = [1.0, 2.0];
    let trials = vec![
        trial(TrialUse::Train, 50.0, flexion, &measured, &[1.0, 2.0]),
        trial(TrialUse::Test, 25.0, flexion, &measured, &[3.0, 4.0]),
        trial(TrialUse::Train, 25.0, extension, &measured, &[1.0, 1.0]),
        trial(TrialUse::Train, 25.0, flexion, &measured, &[2.0, 2.0]),
        trial(TrialUse::Train, 25.0, flexion, &measured, &[0.0, 0.0]),
        trial(TrialUse::Mvc, 100.0, flexion, &[0.0, 0.0], &[9.0, 9.0]),
        trial(TrialUse::Ignore, 25.0, flexion, &measured, &[9.0, 9.0]),
    ];
    let table = ErrorTable::from_trials(trials);
    let train = table.train.as_ref().unwrap();
    // NRMSE of the four training trials: 0, 1/4, 1/4, 3/4.
    assert_eq!((train.overall.trials, train.overall.nrmse.mean), (4, Measure::Defined(0.3125)));
    let squares: f64 = [0.0, 0.25, 0.25, 0.75].iter().map(|v: &f64| (v - 0.3125).powi(2)).sum();
    assert_relative_eq!(train.overall.nrmse.standard_deviation.value().unwrap(), (squares / 3.0).sqrt());
    assert_eq!(train.overall.nrmse.max, Measure::Defined(0.75));
    let labels: Vec<String> = train.conditions.iter().map(|c| c.condition.label()).collect();
    assert_eq!(labels, ["isotonic 25 % flexion", "isotonic 25 % extension", "isotonic 50 % flexion"]);
    assert_eq!(train.conditions[0].errors.nrmse.mean, Measure::Defined(0.5));
    assert_eq!(train.conditions[1].errors.nrmse.standard_deviation, Measure::Undefined(Undefined::TooFewTrials));
    // Three of the four simulated moments are constant: no correlation.
    assert_eq!((train.overall.pearson_r.trials, train.overall.pearson_r.undefined_trials), (1, 3));
    let held_out = table.held_out.as_ref().unwrap();
    assert_eq!((held_out.overall.trials, held_out.overall.nrmse.mean), (1, Measure::Defined(1.0)));
    let mvc = table.mvc.as_ref().unwrap();
    assert_eq!(mvc.overall.nrmse.mean, Measure::Undefined(Undefined::NoTrial));
    assert_eq!(table.trials.len(), 7);

    let json = serde_json::to_string(&table).unwrap();
    assert_eq!(serde_json::from_str::<ErrorTable>(&json).unwrap(), table);
    assert!(json.contains(r#""use":"train""#) && json.contains(r#""contraction":"isotonic""#) && !json.contains("NaN"));
    let none = ErrorTable::from_trials(Vec::new());
    assert_eq!((none.train, none.held_out, none.mvc), (None, None, None));
}

fn moments() -> impl Strategy<Value = (Vec<f64>, Vec<f64>)> {
    prop::collection::vec((-20.0..20.0f64, -20.0..20.0f64), 2..60).prop_map(|pairs| pairs.into_iter().unzip())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn verif_dimensionless_measures_do_not_depend_on_the_unit(
        (exp, sim) in moments(), power in -20..20i32, sign: bool
    ) {
        // A power of two scales without rounding, so that equality is exact.
        let factor = 2f64.powi(power) * if sign { 1.0 } else { -1.0 };
        let scaled = |v: &[f64]| v.iter().map(|x| factor * x).collect::<Vec<_>>();
        let a = error_measures(&exp, &sim).unwrap();
        let b = error_measures(&scaled(&exp), &scaled(&sim)).unwrap();
        prop_assert_eq!([a.nrmse, a.max_error, a.xcorr, a.objective], [b.nrmse, b.max_error, b.xcorr, b.objective]);
        prop_assert_eq!([a.rmse_over_max_moment, a.r_squared], [b.rmse_over_max_moment, b.r_squared]);
        let (r_a, r_b) = (a.pearson_r.value().unwrap(), b.pearson_r.value().unwrap());
        prop_assert!((r_a - r_b).abs() < 1e-12);
        prop_assert_eq!(factor.abs() * a.rmse_n_m.value().unwrap(), b.rmse_n_m.value().unwrap());
    }

    #[test]
    fn verif_measures_are_ordered((exp, sim) in moments()) {
        let e = error_measures(&exp, &sim).unwrap();
        let v = |m: Measure| m.value().unwrap();
        // Mean ≤ root mean square ≤ maximum.
        prop_assert!(0.0 <= v(e.nrmse) && v(e.nrmse) <= v(e.rmse_over_max_moment) * (1.0 + 1e-12));
        prop_assert!(v(e.rmse_over_max_moment) <= v(e.max_error) * (1.0 + 1e-12));
        prop_assert!(v(e.mean_error_n_m).abs() <= v(e.rmse_n_m) * (1.0 + 1e-12));
        prop_assert!((-1.0..=1.0).contains(&v(e.pearson_r)) && v(e.r_squared) <= 1.0);
        // R² can never exceed r²: the best line through the points is at least as good as the identity.
        prop_assert!(v(e.r_squared) <= v(e.pearson_r).powi(2) + 1e-9);
    }

    #[test]
    fn verif_order_of_samples_does_not_matter((exp, sim) in moments()) {
        let reversed = |v: &[f64]| v.iter().rev().copied().collect::<Vec<_>>();
        let a = by_name(&error_measures(&exp, &sim).unwrap());
        let b = by_name(&error_measures(&reversed(&exp), &reversed(&sim)).unwrap());
        for ((name, x), (_, y)) in a.into_iter().zip(b) {
            prop_assert!((x - y).abs() <= 1e-12 * x.abs().max(1.0), "{name}: {x} {y}");
        }
    }

    #[test]
    fn verif_pearson_agrees_with_statrs((exp, sim) in moments()) {
        let r = error_measures(&exp, &sim).unwrap().pearson_r.value().unwrap();
        let expected = (&exp).covariance(&sim) / ((&exp).std_dev() * (&sim).std_dev());
        prop_assert!((r - expected).abs() < 1e-9, "{r} {expected}");
    }

    #[test]
    fn verif_spread_agrees_with_statrs(values in prop::collection::vec(-5.0..5.0f64, 2..40)) {
        let spread = Spread::over(values.iter().map(|v| Measure::Defined(*v)));
        assert_abs_diff_eq!(spread.mean.value().unwrap(), (&values).mean(), epsilon = 1e-12);
        assert_abs_diff_eq!(spread.standard_deviation.value().unwrap(), (&values).std_dev(), epsilon = 1e-12);
        prop_assert_eq!(spread.max.value().unwrap(), (&values).max());
    }

    #[test]
    fn verif_any_finite_moments_give_json_without_nan(
        pairs in prop::collection::vec((prop::num::f64::ANY, prop::num::f64::ANY), 1..12)
    ) {
        let (exp, sim): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
        let finite = exp.iter().chain(&sim).all(|v| v.is_finite());
        match error_measures(&exp, &sim) {
            Ok(e) => {
                prop_assert!(finite);
                let json = serde_json::to_string(&e).unwrap();
                prop_assert!(!json.contains("null"), "{json}");
            }
            Err(error) => {
                let is_not_finite = matches!(error, EvaluationError::NotFinite { .. });
                prop_assert!(!finite && is_not_finite);
            }
        }
    }
}
