//! Tests over participants, of models and of sensitivity indices, against statsmodels and SciPy.

use carpus::evaluation::{Cohort, CohortMeasure, ConditionError};
use carpus::sensitivity::{CohortIndex, ScreenedProperty, SensitivityCohort};
use carpus::statistics::{Effect, PairedT};
use carpus::study::{Contraction, Direction};
use serde_json::Value;

/// Relative difference from statsmodels and SciPy.
const TOLERANCE: f64 = 1e-9;

fn reference(key: &str) -> Value {
    let all: Value = serde_json::from_str(include_str!("../../fixtures/cohort/reference_cohort.json")).unwrap();
    all[key].clone()
}

fn contraction(value: &Value) -> Contraction {
    if value == "isometric" { Contraction::Isometric } else { Contraction::Isotonic }
}

fn text(value: &Value) -> String {
    value.as_str().unwrap().to_string()
}

fn same(what: &str, found: f64, expected: &Value) {
    let expected = expected.as_f64().unwrap();
    assert!((found - expected).abs() <= TOLERANCE * expected.abs().max(1e-3), "{what}: {found} instead of {expected}");
}

/// - `names`: our names of the reference's factors
fn same_effect(effects: &[Effect], expected: &Value, names: &dyn Fn(&str) -> &'static str) {
    let factors: Vec<&str> =
        expected["factors"].as_array().unwrap().iter().map(|f| names(f.as_str().unwrap())).collect();
    let found = effects.iter().find(|e| e.factors == factors).unwrap_or_else(|| panic!("no effect of {factors:?}"));
    same("F", found.f, &expected["f"]);
    same("p", found.p_value, &expected["p"]);
    assert_eq!([found.df_effect as f64, found.df_error as f64].map(Some), [0, 1].map(|i| expected["df"][i].as_f64()));
}

fn same_test(found: &PairedT, p_bonferroni: f64, expected: &Value) {
    same("difference", found.mean_difference, &expected["difference"]);
    same("standard error", found.standard_error, &expected["se"]);
    same("t", found.t, &expected["t"]);
    same("p", found.p_value, &expected["p"]);
    same("corrected p", p_bonferroni, &expected["p_bonferroni"]);
}

#[test]
fn val_statsmodels_models_over_participants() {
    let expected = reference("evaluation");
    let models: Vec<String> = expected["models"].as_array().unwrap().iter().map(text).collect();
    let error = |row: &Value| ConditionError {
        participant: text(&row["participant"]),
        model: text(&row["model"]),
        contraction: contraction(&row["contraction"]),
        effort_percent: row["effort"].as_f64().unwrap(),
        direction: if row["direction"] == "flexion" { Direction::Flexion } else { Direction::Extension },
        trials: 1,
        nrmse: row["y"].as_f64().unwrap(),
        pearson_r: Some(1.0 - row["y"].as_f64().unwrap()),
        rmse_n_m: 1.0,
    };
    let errors: Vec<ConditionError> = expected["rows"].as_array().unwrap().iter().map(error).collect();
    let cohort = Cohort::new(errors, models.clone());
    let names = |factor: &str| match factor {
        "model" => "model type",
        "contraction" => "evaluation type",
        _ => "effort level",
    };
    let expected_effects = expected["anova"].as_array().unwrap();
    assert_eq!(expected_effects.len(), 7);
    for measure in [CohortMeasure::Nrmse, CohortMeasure::PearsonR] {
        let effects = cohort.anova(measure).unwrap();
        assert_eq!(effects.len(), 7);
        // One minus a value has the same F as the value.
        expected_effects.iter().for_each(|e| same_effect(&effects, e, &names));
    }
    let pairs = cohort.pairwise(CohortMeasure::Nrmse, Contraction::Isotonic, 50.0).unwrap();
    for (found, expected) in pairs.iter().zip(expected["pairwise_isotonic_50"].as_array().unwrap()) {
        assert_eq!(
            [&found.first, &found.second].map(String::as_str).map(Some),
            [0, 1].map(|i| expected["pair"][i].as_str())
        );
        same_test(&found.test, found.p_bonferroni, expected);
    }
    for model in &models {
        let found = cohort.over_participants(model, CohortMeasure::Nrmse, |_| true).unwrap();
        same("mean", found.mean, &expected["over_participants"][model][0]);
        same("standard deviation", found.standard_deviation, &expected["over_participants"][model][1]);
        assert_eq!(found.participants, 8);
    }
    // A participant without a condition is not in the tests.
    let some: Vec<ConditionError> =
        cohort.errors().iter().filter(|e| e.participant != "P01" || e.model != "linear").cloned().collect();
    let effects = Cohort::new(some, models).anova(CohortMeasure::Nrmse).unwrap();
    assert_eq!(effects[0].df_error, 3 * 6);
}

#[test]
fn val_statsmodels_sensitivity_over_participants() {
    let expected = reference("sensitivity");
    let property = ScreenedProperty::TendonSlackLength;
    let index = |row: &Value| CohortIndex {
        participant: text(&row["participant"]),
        contraction: contraction(&row["contraction"]),
        effort_percent: row["effort"].as_f64().unwrap(),
        muscle: text(&row["muscle"]),
        property,
        mu_star: row["y"].as_f64().unwrap(),
        sigma: 0.5,
    };
    let cohort = SensitivityCohort::new(expected["rows"].as_array().unwrap().iter().map(index).collect());
    let effects = cohort.anova_of_conditions(property).unwrap();
    let names = |factor: &str| if factor == "contraction" { "contraction" } else { "effort" };
    expected["anova"].as_array().unwrap().iter().for_each(|e| same_effect(&effects, e, &names));
    let [contractions, efforts] = cohort.main_effects(property).unwrap();
    same_test(&contractions[0].test, contractions[0].p_bonferroni, &expected["main"]["contraction"]);
    same_test(&efforts[0].test, efforts[0].p_bonferroni, &expected["main"]["effort"]);
    let interactions = cohort.interactions(property).unwrap();
    let expected_pairs = expected["interactions"].as_array().unwrap();
    assert_eq!(interactions.len(), expected_pairs.len());
    for (found, expected) in interactions.iter().zip(expected_pairs) {
        let side = |i: usize| (contraction(&expected["pair"][i][0]), expected["pair"][i][1].as_f64().unwrap());
        assert_eq!((found.first, found.second), (side(0), side(1)));
        same_test(&found.test, found.p_bonferroni, expected);
    }
    let muscles = cohort.anova_of_muscles(property, (Contraction::Isotonic, 25.0)).unwrap();
    same("F", muscles.f, &expected["muscles_isotonic_25"]["f"]);
    same("p", muscles.p_value, &expected["muscles_isotonic_25"]["p"]);
    assert_eq!(cohort.pairs_of_muscles(property, (Contraction::Isotonic, 25.0)).unwrap().len(), 10);
    assert!(cohort.anova_of_conditions(ScreenedProperty::FiberDamping).is_err());
}
