//! Functions of one variable.

use super::error::FunctionError;
use super::expression::Expression;
use super::gcv_spline::GcvSpline;
use super::piecewise::{PiecewiseConstant, PiecewiseLinear};
use super::points::finite;
use super::simm_spline::SimmSpline;
use crate::osim::spec::FunctionSpec;

/// A function of one variable, ready to be evaluated.
///
/// Units of argument and value are those of whoever owns the function.
#[derive(Clone, Debug)]
pub struct Function {
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Constant(f64),
    Linear { slope: f64, intercept: f64 },
    SimmSpline(SimmSpline),
    PiecewiseLinear(PiecewiseLinear),
    PiecewiseConstant(PiecewiseConstant),
    Step { x0: f64, y0: f64, rise: f64, inverse_width: f64 },
    GcvSpline(GcvSpline),
    Polynomial(Box<[f64]>),
    Expression(Expression),
    Multiplier { scale: f64, function: Box<Function> },
    Sine { amplitude: f64, omega: f64, phase: f64, offset: f64 },
}

impl Function {
    /// Builds a function from its specification.
    ///
    /// # Errors
    /// Any [`FunctionError`]: points missing, unequal in number, not increasing or not finite. OpenSim accepts some of
    /// these and returns NaN or loops forever.
    pub fn compile(spec: &FunctionSpec) -> Result<Function, FunctionError> {
        let kind = match spec {
            FunctionSpec::Constant { value } => Kind::Constant(finite("Constant", "value", *value)?),
            FunctionSpec::Linear { slope, intercept } => Kind::Linear {
                slope: finite("LinearFunction", "coefficients", *slope)?,
                intercept: finite("LinearFunction", "coefficients", *intercept)?,
            },
            FunctionSpec::SimmSpline { x, y } => Kind::SimmSpline(SimmSpline::fit(x, y)?),
            FunctionSpec::PiecewiseLinear { x, y } => Kind::PiecewiseLinear(PiecewiseLinear::new(x, y)?),
            FunctionSpec::PiecewiseConstant { x, y } => Kind::PiecewiseConstant(PiecewiseConstant::new(x, y)?),
            FunctionSpec::Step { start_time, end_time, start_value, end_value } => {
                Self::compile_step(*start_time, *end_time, *start_value, *end_value)?
            }
            FunctionSpec::GcvSpline { half_order, error_variance, x, y, weights: _ } => {
                // OpenSim reads the weights and then fits with unit weights.
                Kind::GcvSpline(GcvSpline::fit(*half_order, *error_variance, x, y)?)
            }
            FunctionSpec::Polynomial { coefficients } => {
                if coefficients.is_empty() {
                    return Err(FunctionError::NoCoefficients);
                }
                for &coefficient in coefficients {
                    finite("PolynomialFunction", "coefficients", coefficient)?;
                }
                Kind::Polynomial(coefficients.clone().into())
            }
            FunctionSpec::MultivariatePolynomial { dimension: 1, order, coefficients } => {
                let (class, expected, found) = ("MultivariatePolynomialFunction", order + 1, coefficients.len());
                if expected != found {
                    return Err(FunctionError::CoefficientCount { class, expected, found });
                }
                for &coefficient in coefficients {
                    finite(class, "coefficients", coefficient)?;
                }
                Kind::Polynomial(coefficients.iter().rev().copied().collect())
            }
            FunctionSpec::MultivariatePolynomial { dimension, .. } => {
                return Err(FunctionError::Dimension { expected: 1, found: *dimension });
            }
            FunctionSpec::ExpressionBased { expression, variables } => {
                if variables.len() != 1 {
                    return Err(FunctionError::Dimension { expected: 1, found: variables.len() });
                }
                Kind::Expression(Expression::parse_in(expression, &[&variables[0]])?)
            }
            FunctionSpec::Multiplier { scale, function } => Kind::Multiplier {
                scale: finite("MultiplierFunction", "scale", *scale)?,
                function: Box::new(Function::compile(function)?),
            },
            FunctionSpec::Sine { amplitude, omega, phase, offset } => Kind::Sine {
                amplitude: finite("Sine", "amplitude", *amplitude)?,
                omega: finite("Sine", "omega", *omega)?,
                phase: finite("Sine", "phase", *phase)?,
                offset: finite("Sine", "offset", *offset)?,
            },
        };
        Ok(Function { kind })
    }

    /// The constant function.
    pub fn constant(value: f64) -> Function {
        Function { kind: Kind::Constant(value) }
    }

    /// `slope · x + intercept`.
    pub fn linear(slope: f64, intercept: f64) -> Function {
        Function { kind: Kind::Linear { slope, intercept } }
    }

    /// The smooth step of Simbody's `Function::Step` from `y0` at `x0` to `y1` at `x1` (`x1` may lie below `x0`).
    ///
    /// # Errors
    /// [`FunctionError::EmptyTransition`] if `x0 == x1`; [`FunctionError::NotFinite`].
    pub fn step(y0: f64, y1: f64, x0: f64, x1: f64) -> Result<Function, FunctionError> {
        Ok(Function { kind: Self::compile_step(x0, x1, y0, y1)? })
    }

    fn compile_step(x0: f64, x1: f64, y0: f64, y1: f64) -> Result<Kind, FunctionError> {
        finite("StepFunction", "transition_start_time", x0)?;
        finite("StepFunction", "transition_end_time", x1)?;
        finite("StepFunction", "start_value", y0)?;
        finite("StepFunction", "end_value", y1)?;
        if x0 == x1 {
            return Err(FunctionError::EmptyTransition { at: x0 });
        }
        Ok(Kind::Step { x0, y0, rise: y1 - y0, inverse_width: 1.0 / (x1 - x0) })
    }

    /// The value everywhere, if the function does not depend on its argument.
    pub fn constant_value(&self) -> Option<f64> {
        match &self.kind {
            Kind::Constant(value) => Some(*value),
            Kind::Multiplier { scale, function } => function.constant_value().map(|value| scale * value),
            _ => None,
        }
    }

    /// The value that OpenSim computes where it passes no argument at all, as for an axis of a CustomJoint without
    /// coordinates: a `LinearFunction` gives its first coefficient. `None` where OpenSim reads an argument all the
    /// same.
    pub fn value_of_nothing(&self) -> Option<f64> {
        match &self.kind {
            Kind::Constant(value) => Some(*value),
            Kind::Linear { slope, .. } => Some(*slope),
            Kind::Multiplier { scale, function } => function.value_of_nothing().map(|value| scale * value),
            _ => None,
        }
    }

    /// Whether it is an `ExpressionBasedFunction` (possibly scaled).
    pub fn is_formula(&self) -> bool {
        match &self.kind {
            Kind::Expression(_) => true,
            Kind::Multiplier { function, .. } => function.is_formula(),
            _ => false,
        }
    }

    /// Slope and intercept, if the function is a `LinearFunction` (possibly scaled).
    pub fn linear_coefficients(&self) -> Option<(f64, f64)> {
        match &self.kind {
            Kind::Linear { slope, intercept } => Some((*slope, *intercept)),
            Kind::Multiplier { scale, function } => function.linear_coefficients().map(|(s, i)| (scale * s, scale * i)),
            _ => None,
        }
    }

    /// Value at `x`.
    pub fn value(&self, x: f64) -> f64 {
        match &self.kind {
            Kind::Constant(value) => *value,
            Kind::Linear { slope, intercept } => slope * x + intercept,
            Kind::SimmSpline(spline) => spline.value(x),
            Kind::PiecewiseLinear(function) => function.value(x),
            Kind::PiecewiseConstant(function) => function.value(x),
            Kind::Step { x0, y0, rise, inverse_width } => {
                let s = ((x - x0) * inverse_width).clamp(0.0, 1.0);
                y0 + rise * (s * s * s * (10.0 + s * (6.0 * s - 15.0)))
            }
            Kind::GcvSpline(spline) => spline.value(x),
            Kind::Polynomial(coefficients) => coefficients.iter().fold(0.0, |sum, c| sum * x + c),
            Kind::Expression(formula) => formula.value_at(&[x]),
            Kind::Multiplier { scale, function } => scale * function.value(x),
            Kind::Sine { amplitude, omega, phase, offset } => amplitude * (omega * x + phase).sin() + offset,
        }
    }

    /// First derivative at `x`.
    pub fn derivative(&self, x: f64) -> f64 {
        match &self.kind {
            Kind::Constant(_) | Kind::PiecewiseConstant(_) => 0.0,
            Kind::Linear { slope, .. } => *slope,
            Kind::SimmSpline(spline) => spline.derivative(x),
            Kind::PiecewiseLinear(function) => function.derivative(x),
            Kind::Step { x0, rise, inverse_width, .. } => {
                let s = ((x - x0) * inverse_width).clamp(0.0, 1.0);
                let t = s * (s - 1.0);
                rise * inverse_width * 30.0 * t * t
            }
            Kind::GcvSpline(spline) => spline.derivative(x, 1),
            Kind::Polynomial(coefficients) => {
                let degree = coefficients.len() - 1;
                (0..degree).fold(0.0, |sum, i| sum * x + coefficients[i] * (degree - i) as f64)
            }
            Kind::Expression(formula) => formula.derivative_at(1, |_| x, 0),
            Kind::Multiplier { scale, function } => scale * function.derivative(x),
            Kind::Sine { amplitude, omega, phase, .. } => amplitude * omega * (omega * x + phase).cos(),
        }
    }

    /// Second derivative at `x`.
    pub fn second_derivative(&self, x: f64) -> f64 {
        match &self.kind {
            Kind::Constant(_) | Kind::PiecewiseConstant(_) | Kind::Linear { .. } | Kind::PiecewiseLinear(_) => 0.0,
            Kind::SimmSpline(spline) => spline.second_derivative(x),
            Kind::Step { x0, rise, inverse_width, .. } => {
                let s = ((x - x0) * inverse_width).clamp(0.0, 1.0);
                rise * inverse_width * inverse_width * 60.0 * s * (1.0 + s * (2.0 * s - 3.0))
            }
            Kind::GcvSpline(spline) => spline.derivative(x, 2),
            Kind::Polynomial(coefficients) => {
                let degree = coefficients.len() - 1;
                (0..degree.saturating_sub(1))
                    .fold(0.0, |sum, i| sum * x + coefficients[i] * ((degree - i) * (degree - i - 1)) as f64)
            }
            Kind::Expression(formula) => formula.second_derivative_at(1, |_| x, 0, 0),
            Kind::Multiplier { scale, function } => scale * function.second_derivative(x),
            Kind::Sine { amplitude, omega, phase, .. } => -amplitude * omega * omega * (omega * x + phase).sin(),
        }
    }
}
