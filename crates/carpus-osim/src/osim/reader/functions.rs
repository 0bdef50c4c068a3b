//! OpenSim's functions of one variable.

use super::object::Object;
use super::properties::Bound;
use super::state::Reader;
use crate::functions::Expression;
use crate::osim::document::ElementId;
use crate::osim::error::ProblemKind;
use crate::osim::spec::FunctionSpec;

/// Whether a tag names a function class of OpenSim (supported here or not).
pub(super) fn is_function(tag: &str) -> bool {
    matches!(
        tag,
        "Constant"
            | "LinearFunction"
            | "SimmSpline"
            | "NaturalCubicSpline"
            | "natCubicSpline"
            | "PiecewiseLinearFunction"
            | "PiecewiseConstantFunction"
            | "StepFunction"
            | "GCVSpline"
            | "PolynomialFunction"
            | "MultivariatePolynomialFunction"
            | "MultiplierFunction"
            | "Sine"
            | "ExpressionBasedFunction"
            | "SignalGenerator"
    )
}

impl Reader<'_> {
    /// The function at an element; `None` if its class is not supported (nothing is reported: the caller knows what
    /// that means). Values that cannot be read become problems.
    pub(super) fn function(&mut self, element: ElementId, owner: &Object) -> Option<FunctionSpec> {
        let tag = self.document.tag(element).to_owned();
        self.mark(element);
        let object = Object {
            element: Some(element),
            default: self.defaults.get(&tag).copied(),
            path: owner.path.clone(),
            line: self.document.line(element),
        };
        let function = match tag.as_str() {
            "Constant" => FunctionSpec::Constant { value: self.number(&object, &["value"], 0.0, Bound::Finite) },
            "LinearFunction" => self.linear(&object)?,
            "SimmSpline" | "NaturalCubicSpline" | "natCubicSpline" => {
                let (x, y) = self.points(&object, 2);
                FunctionSpec::SimmSpline { x, y }
            }
            "PiecewiseLinearFunction" => {
                let (x, y) = self.points(&object, 2);
                FunctionSpec::PiecewiseLinear { x, y }
            }
            "PiecewiseConstantFunction" => {
                let (x, y) = self.points(&object, 1);
                FunctionSpec::PiecewiseConstant { x, y }
            }
            "StepFunction" => FunctionSpec::Step {
                start_time: self.number(&object, &["transition_start_time"], 0.99, Bound::Finite),
                end_time: self.number(&object, &["transition_end_time"], 1.01, Bound::Finite),
                start_value: self.number(&object, &["start_value"], 0.0, Bound::Finite),
                end_value: self.number(&object, &["end_value"], 1.0, Bound::Finite),
            },
            "GCVSpline" => self.gcv_spline(&object),
            "PolynomialFunction" => {
                let mut coefficients = self.list(&object, "coefficients");
                if coefficients.is_empty() {
                    coefficients.push(1.0);
                }
                FunctionSpec::Polynomial { coefficients }
            }
            "MultivariatePolynomialFunction" => self.multivariate(&object),
            "ExpressionBasedFunction" => self.expression(&object),
            "MultiplierFunction" => {
                let scale = self.number(&object, &["scale"], 1.0, Bound::Finite);
                let inner = self.own_property(&object, &["function"]);
                let inner = inner.and_then(|inner| self.document.children(inner).first().copied());
                let Some(inner) = inner else {
                    let kind = ProblemKind::Missing { property: "function".to_owned(), expected: "a function" };
                    self.problem(object.line, &object.path, kind);
                    return Some(FunctionSpec::Constant { value: 0.0 });
                };
                FunctionSpec::Multiplier { scale, function: Box::new(self.function(inner, &object)?) }
            }
            "Sine" => FunctionSpec::Sine {
                amplitude: self.number(&object, &["amplitude"], 1.0, Bound::Finite),
                omega: self.number(&object, &["omega"], 1.0, Bound::Finite),
                phase: self.number(&object, &["phase"], 0.0, Bound::Finite),
                offset: self.number(&object, &["offset"], 0.0, Bound::Finite),
            },
            _ => return None,
        };
        Some(function)
    }

    fn linear(&mut self, object: &Object) -> Option<FunctionSpec> {
        let Some(element) = self.property(object, &["coefficients"]) else {
            return Some(FunctionSpec::Linear { slope: 1.0, intercept: 0.0 });
        };
        let values = self.numbers_at(element, object, "coefficients", "slope and intercept").unwrap_or_default();
        match values[..] {
            [] => Some(FunctionSpec::Linear { slope: 1.0, intercept: 0.0 }),
            [slope, intercept] => Some(FunctionSpec::Linear { slope, intercept }),
            // One number is an intercept without slopes.
            [_] => None,
            // Slopes, then the intercept: the order of a polynomial's coefficients, reversed.
            _ => Some(FunctionSpec::MultivariatePolynomial {
                dimension: values.len() - 1,
                order: 1,
                coefficients: values.into_iter().rev().collect(),
            }),
        }
    }

    fn multivariate(&mut self, object: &Object) -> FunctionSpec {
        // OpenSim takes up to six variables; an order beyond a hundred has more terms than any file states.
        let dimension = self.whole_number(object, "dimension", 1..=6);
        let order = self.whole_number(object, "order", 0..=100);
        let coefficients = self.list(object, "coefficients");
        FunctionSpec::MultivariatePolynomial { dimension, order, coefficients }
    }

    fn expression(&mut self, object: &Object) -> FunctionSpec {
        let variables = self.words(object, &["variables"]);
        let Some((element, expression)) = self.string(object, &["expression"]) else {
            let kind = ProblemKind::Missing { property: "expression".to_owned(), expected: "a formula" };
            self.problem(object.line, &object.path, kind);
            return FunctionSpec::Constant { value: 0.0 };
        };
        let names: Vec<&str> = variables.iter().map(String::as_str).collect();
        if let Err(error) = Expression::parse_in(&expression, &names) {
            let found = format!("`{expression}`: {error}");
            let kind = ProblemKind::NotReadable {
                property: "expression".to_owned(),
                expected: "a formula in its variables",
                found,
            };
            self.problem(self.document.line(element), &object.path, kind);
        }
        FunctionSpec::ExpressionBased { expression, variables }
    }

    /// A whole number in a range, its lowest if there is none.
    fn whole_number(
        &mut self,
        object: &Object,
        property: &'static str,
        range: std::ops::RangeInclusive<usize>,
    ) -> usize {
        let lowest = *range.start();
        let found = self.number(object, &[property], lowest as f64, Bound::Finite);
        match range.into_iter().find(|n| *n as f64 == found) {
            Some(number) => number,
            None => {
                let expected = "a whole number that the class takes";
                let kind = ProblemKind::OutOfRange { property: property.to_owned(), expected, found };
                self.problem(object.line, &object.path, kind);
                lowest
            }
        }
    }

    fn gcv_spline(&mut self, object: &Object) -> FunctionSpec {
        let half_order = self.number(object, &["half_order"], 0.0, Bound::Finite);
        if ![1.0, 2.0, 3.0, 4.0].contains(&half_order) {
            let kind = ProblemKind::OutOfRange {
                property: "half_order".to_owned(),
                expected: "1, 2, 3 or 4",
                found: half_order,
            };
            self.problem(object.line, &object.path, kind);
        }
        let error_variance = self.number(object, &["error_variance"], 0.0, Bound::Finite);
        let half_order = (half_order.clamp(1.0, 4.0)) as usize;
        let (x, y) = self.points(object, 2 * half_order);
        let mut weights = self.list(object, "weights");
        weights.resize(x.len(), 1.0);
        let _ = self.property(object, &["coefficients"]); // computed anew by OpenSim
        FunctionSpec::GcvSpline { half_order, error_variance, x, y, weights }
    }

    /// Abscissae and ordinates: the same number of both, at least `minimum`, abscissae not decreasing.
    fn points(&mut self, object: &Object, minimum: usize) -> (Vec<f64>, Vec<f64>) {
        let (x, y) = (self.list(object, "x"), self.list(object, "y"));
        if x.len() != y.len() {
            let found = format!("{} x and {} y", x.len(), y.len());
            let kind = ProblemKind::NotReadable { property: "x, y".to_owned(), expected: "as many x as y", found };
            self.problem(object.line, &object.path, kind);
        } else if x.len() < minimum {
            let expected = if minimum == 2 { "at least two points" } else { "more points" };
            let kind = ProblemKind::NotReadable {
                property: "x, y".to_owned(),
                expected,
                found: format!("{} points", x.len()),
            };
            self.problem(object.line, &object.path, kind);
        } else if x.windows(2).any(|pair| pair[1] < pair[0]) {
            let kind = ProblemKind::NotReadable {
                property: "x".to_owned(),
                expected: "ascending numbers",
                found: "a number smaller than the one before".to_owned(),
            };
            self.problem(object.line, &object.path, kind);
        }
        (x, y)
    }
}
