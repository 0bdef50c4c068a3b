//! Functions.

use super::xml::{Xml, numbers};
use crate::osim::spec::FunctionSpec;

impl Xml {
    /// A property that holds a function.
    pub fn function(&mut self, property: &str, function: &FunctionSpec) {
        self.open(property, &[]);
        self.bare_function(function);
        self.close();
    }

    /// A function.
    pub fn bare_function(&mut self, function: &FunctionSpec) {
        let points = |xml: &mut Xml, x: &[f64], y: &[f64]| {
            xml.text("x", &numbers(x));
            xml.text("y", &numbers(y));
        };
        match function {
            FunctionSpec::Constant { value } => {
                self.open("Constant", &[]);
                self.number("value", *value);
            }
            FunctionSpec::Linear { slope, intercept } => {
                self.open("LinearFunction", &[]);
                self.text("coefficients", &numbers(&[*slope, *intercept]));
            }
            FunctionSpec::SimmSpline { x, y } => {
                self.open("SimmSpline", &[]);
                points(self, x, y);
            }
            FunctionSpec::PiecewiseLinear { x, y } => {
                self.open("PiecewiseLinearFunction", &[]);
                points(self, x, y);
            }
            FunctionSpec::PiecewiseConstant { x, y } => {
                self.open("PiecewiseConstantFunction", &[]);
                points(self, x, y);
            }
            FunctionSpec::Step { start_time, end_time, start_value, end_value } => {
                self.open("StepFunction", &[]);
                self.number("transition_start_time", *start_time);
                self.number("transition_end_time", *end_time);
                self.number("start_value", *start_value);
                self.number("end_value", *end_value);
            }
            FunctionSpec::GcvSpline { half_order, error_variance, x, y, weights } => {
                self.open("GCVSpline", &[]);
                self.text("half_order", &half_order.to_string());
                self.number("error_variance", *error_variance);
                points(self, x, y);
                self.text("weights", &numbers(weights));
            }
            FunctionSpec::Polynomial { coefficients } => {
                self.open("PolynomialFunction", &[]);
                self.text("coefficients", &numbers(coefficients));
            }
            FunctionSpec::MultivariatePolynomial { dimension, order, coefficients } => {
                self.open("MultivariatePolynomialFunction", &[]);
                self.text("dimension", &dimension.to_string());
                self.text("order", &order.to_string());
                self.text("coefficients", &numbers(coefficients));
            }
            FunctionSpec::ExpressionBased { expression, variables } => {
                self.open("ExpressionBasedFunction", &[]);
                self.text("expression", expression);
                self.text("variables", &variables.join(" "));
            }
            FunctionSpec::Multiplier { scale, function } => {
                self.open("MultiplierFunction", &[]);
                self.function("function", function);
                self.number("scale", *scale);
            }
            FunctionSpec::Sine { amplitude, omega, phase, offset } => {
                self.open("Sine", &[]);
                self.number("amplitude", *amplitude);
                self.number("omega", *omega);
                self.number("phase", *phase);
                self.number("offset", *offset);
            }
        }
        self.close();
    }
}
