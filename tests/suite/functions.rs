//! Tests of `functions`: against OpenSim's values, and derivatives against finite differences.

use carpus::functions::{Function, FunctionError};
use carpus::osim::spec::FunctionSpec;
use serde_json::Value;

use crate::validation::{self, Classes, Differences, Judge};

/// Rounding only: both programs evaluate the same polynomials. Relative to the largest magnitude of the function (or
/// of its derivative) on the tested points, because OpenSim evaluates GCV splines by another, equivalent recursion.
const RELATIVE_TOLERANCE: f64 = 1e-12;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("array").iter().map(|v| v.as_f64().expect("number")).collect()
}

/// The specification that a row of the reference file states.
fn specification(class: &str, spec: &Value) -> FunctionSpec {
    let number = |key: &str| spec[key].as_f64().expect("number");
    let (x, y) = if spec["x"].is_array() { (numbers(&spec["x"]), numbers(&spec["y"])) } else { (vec![], vec![]) };
    match class {
        "Constant" => FunctionSpec::Constant { value: number("value") },
        "LinearFunction" => FunctionSpec::Linear { slope: number("slope"), intercept: number("intercept") },
        "SimmSpline" => FunctionSpec::SimmSpline { x, y },
        "PiecewiseLinearFunction" => FunctionSpec::PiecewiseLinear { x, y },
        "PiecewiseConstantFunction" => FunctionSpec::PiecewiseConstant { x, y },
        "StepFunction" => FunctionSpec::Step {
            start_time: number("start_time"),
            end_time: number("end_time"),
            start_value: number("start_value"),
            end_value: number("end_value"),
        },
        "PolynomialFunction" => FunctionSpec::Polynomial { coefficients: numbers(&spec["coefficients"]) },
        "Sine" => FunctionSpec::Sine {
            amplitude: number("amplitude"),
            omega: number("omega"),
            phase: number("phase"),
            offset: number("offset"),
        },
        "MultiplierFunction" => {
            FunctionSpec::Multiplier { scale: number("scale"), function: Box::new(FunctionSpec::SimmSpline { x, y }) }
        }
        "GCVSpline" => FunctionSpec::GcvSpline {
            half_order: number("half_order") as usize,
            error_variance: number("error_variance"),
            weights: vec![1.0; x.len()],
            x,
            y,
        },
        other => panic!("no such class in the reference: {other}"),
    }
}

fn reference() -> Vec<(String, Function, Value)> {
    let rows: Vec<Value> = serde_json::from_str(include_str!("../../fixtures/functions/values.json")).expect("JSON");
    rows.into_iter()
        .map(|row| {
            let spec = specification(row["class"].as_str().expect("class"), &row["spec"]);
            let name = row["name"].as_str().expect("name").to_string();
            let function = Function::compile(&spec).unwrap_or_else(|error| panic!("{name}: {error}"));
            (name, function, row)
        })
        .collect()
}

#[test]
fn val_opensim_values_and_derivatives() {
    const UNIT: &str = "largest magnitude, or 1";
    let mut differences = ["value", "first", "second"].map(|order| Differences::new(order, UNIT));
    let mut classes = Classes::new("value and two derivatives", UNIT, RELATIVE_TOLERANCE, Judge::Max);
    for (name, function, row) in reference() {
        let x = numbers(&row["x"]);
        let evaluations: [fn(&Function, f64) -> f64; 3] =
            [Function::value, Function::derivative, Function::second_derivative];
        for (differences, evaluate) in differences.iter_mut().zip(evaluations) {
            let expected = numbers(&row[differences.quantity.as_str()]);
            let scale = expected.iter().fold(1.0_f64, |scale, value| scale.max(value.abs()));
            for (&x, &expected) in x.iter().zip(&expected) {
                let difference = (evaluate(&function, x) - expected) / scale;
                differences.push(difference, || format!("{name} at {x}"));
                classes.push(row["class"].as_str().expect("class"), difference, || format!("{name} at {x}"));
            }
        }
    }
    for (differences, name) in differences.iter_mut().zip(["value", "first derivative", "second derivative"]) {
        differences.quantity = name.into();
    }
    const MODEL: &str = "all classes (fixtures/functions)";
    let rows = differences.map(|d| d.row("functions", MODEL, RELATIVE_TOLERANCE, Judge::Max));
    validation::write("functions", &[&rows[..], &classes.rows(MODEL)].concat());
    validation::assert_passed(&rows);
}

#[test]
fn verif_derivatives_against_finite_differences() {
    for (name, function, row) in reference() {
        // Points that are no knots: random ones come first in the file.
        for &x in &numbers(&row["x"])[..12] {
            let h = 1e-6;
            let first = (function.value(x + h) - function.value(x - h)) / (2.0 * h);
            let second = (function.derivative(x + h) - function.derivative(x - h)) / (2.0 * h);
            let tolerance = 1e-7 * (1.0 + second.abs() + first.abs());
            assert!((function.derivative(x) - first).abs() < tolerance, "{name}: first derivative at {x}");
            assert!((function.second_derivative(x) - second).abs() < tolerance * 10.0, "{name}: second at {x}");
        }
    }
}

#[test]
fn verif_gcv_spline_interpolates_without_error_variance() {
    for (name, function, row) in reference() {
        if row["class"] == "GCVSpline" && row["spec"]["error_variance"] == 0.0 {
            for (x, y) in numbers(&row["spec"]["x"]).into_iter().zip(numbers(&row["spec"]["y"])) {
                assert!((function.value(x) - y).abs() < 1e-9, "{name} at {x}: {} {y}", function.value(x));
            }
        }
    }
}

#[test]
fn verif_bad_functions_are_named() {
    let spline = |x: &[f64], y: &[f64]| Function::compile(&FunctionSpec::SimmSpline { x: x.into(), y: y.into() });
    assert!(matches!(spline(&[0.0], &[1.0]), Err(FunctionError::TooFewPoints { expected: 2, found: 1, .. })));
    assert!(matches!(spline(&[0.0, 1.0], &[1.0]), Err(FunctionError::LengthMismatch { x: 2, y: 1, .. })));
    assert!(matches!(spline(&[0.0, 2.0, 1.0], &[0.0; 3]), Err(FunctionError::NotIncreasing { index: 3, .. })));
    assert!(matches!(spline(&[0.0, f64::NAN], &[0.0; 2]), Err(FunctionError::NotFinite { property: "x", .. })));
    let gcv = |half_order, x: Vec<f64>| {
        let (y, weights) = (vec![0.0; x.len()], vec![]);
        Function::compile(&FunctionSpec::GcvSpline { half_order, error_variance: 0.0, x, y, weights })
    };
    assert!(matches!(gcv(0, vec![0.0, 1.0]), Err(FunctionError::HalfOrder { found: 0 })));
    assert!(matches!(gcv(3, vec![0.0, 1.0]), Err(FunctionError::TooFewPoints { expected: 6, found: 2, .. })));
    assert!(matches!(gcv(1, vec![1.0, 1.0]), Err(FunctionError::NotIncreasing { .. })));
    // Beyond the range of numbers the search for the smoothing parameter ends, too.
    for (step, error_variance) in [1e298, 1e-300, 1e150].into_iter().flat_map(|s| [0.0, -1.0, 1.0].map(|v| (s, v))) {
        let x: Vec<f64> = (0..50).map(|i| step * f64::from(i)).collect();
        let y = (0..50).map(|i| (0.3 * f64::from(i)).sin()).collect();
        let spec = FunctionSpec::GcvSpline { half_order: 3, error_variance, x, y, weights: vec![] };
        let made = Function::compile(&spec).map(|f| f.value(step));
        assert!(matches!(made, Err(FunctionError::OutOfRange { .. })), "{step} {error_variance}: {made:?}");
    }
    let step = FunctionSpec::Step { start_time: 1.0, end_time: 1.0, start_value: 0.0, end_value: 1.0 };
    assert!(matches!(Function::compile(&step), Err(FunctionError::EmptyTransition { .. })));
    let message = spline(&[0.0, 2.0, 1.0], &[0.0; 3]).expect_err("not increasing").to_string();
    assert_eq!(message, "SimmSpline: expected increasing x, found 1 after 2 (value 3)");
}
