//! Functions of several variables, with first and second derivatives.

use super::error::FunctionError;
use super::expression::Expression;
use super::function::Function;
use super::points::finite;
use crate::osim::spec::FunctionSpec;

/// A function of several variables.
///
/// OpenSim: `MultivariatePolynomialFunction`, `LinearFunction` of several variables, `ExpressionBasedFunction`,
/// `Constant`, `MultiplierFunction` of these; of one variable every [`Function`].
#[derive(Clone, Debug)]
pub struct FunctionOfSeveral {
    /// Number of variables.
    dimension: usize,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Polynomial(Polynomial),
    Formula { factor: f64, formula: Expression },
    One(Box<Function>),
}

/// Products of powers: coefficient and powers of each, one of each variable.
#[derive(Clone, Debug, PartialEq)]
struct Polynomial(Vec<(f64, Vec<i32>)>);

impl FunctionOfSeveral {
    /// Builds a function of `dimension` variables.
    ///
    /// # Errors
    /// A function of another number of variables; coefficients that are not finite or of another number; a formula
    /// that cannot be read.
    pub fn compile(spec: &FunctionSpec, dimension: usize) -> Result<FunctionOfSeveral, FunctionError> {
        let kind = match spec {
            FunctionSpec::Constant { value } => {
                Kind::Polynomial(Polynomial(vec![(finite("Constant", "value", *value)?, vec![0; dimension])]))
            }
            FunctionSpec::Multiplier { scale, function } => {
                let scale = finite("MultiplierFunction", "scale", *scale)?;
                match FunctionOfSeveral::compile(function, dimension)?.kind {
                    Kind::Polynomial(mut polynomial) => {
                        polynomial.0.iter_mut().for_each(|(coefficient, _)| *coefficient *= scale);
                        Kind::Polynomial(polynomial)
                    }
                    Kind::Formula { factor, formula } => Kind::Formula { factor: scale * factor, formula },
                    Kind::One(_) => Kind::One(Box::new(Function::compile(spec)?)),
                }
            }
            FunctionSpec::MultivariatePolynomial { dimension: own, order, coefficients } if *own == dimension => {
                Kind::Polynomial(Polynomial::compile(dimension, *order, coefficients)?)
            }
            FunctionSpec::MultivariatePolynomial { dimension: own, .. } => {
                return Err(FunctionError::Dimension { expected: dimension, found: *own });
            }
            FunctionSpec::ExpressionBased { variables, .. } if variables.len() != dimension => {
                return Err(FunctionError::Dimension { expected: dimension, found: variables.len() });
            }
            FunctionSpec::ExpressionBased { expression, variables } => {
                let names: Vec<&str> = variables.iter().map(String::as_str).collect();
                Kind::Formula { factor: 1.0, formula: Expression::parse_in(expression, &names)? }
            }
            _ if dimension == 1 => Kind::One(Box::new(Function::compile(spec)?)),
            _ => return Err(FunctionError::Dimension { expected: dimension, found: 1 }),
        };
        Ok(FunctionOfSeveral { dimension, kind })
    }

    /// Number of variables.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Value; `x` gives the variables.
    pub fn value(&self, x: impl Fn(usize) -> f64) -> f64 {
        match &self.kind {
            Kind::Polynomial(polynomial) => polynomial.sum(x, &[]),
            Kind::Formula { factor, formula } => {
                let variables: Vec<f64> = (0..self.dimension).map(x).collect();
                factor * formula.value_at(&variables)
            }
            Kind::One(function) => function.value(x(0)),
        }
    }

    /// Derivative by variable `i`.
    pub fn derivative(&self, x: impl Fn(usize) -> f64, i: usize) -> f64 {
        match &self.kind {
            Kind::Polynomial(polynomial) => polynomial.sum(x, &[i]),
            Kind::Formula { factor, formula } => factor * formula.derivative_at(self.dimension, x, i),
            Kind::One(function) => function.derivative(x(0)),
        }
    }

    /// Derivative by variables `i` and `j`.
    pub fn second_derivative(&self, x: impl Fn(usize) -> f64, i: usize, j: usize) -> f64 {
        match &self.kind {
            Kind::Polynomial(polynomial) => polynomial.sum(x, &[i, j]),
            Kind::Formula { factor, formula } => factor * formula.second_derivative_at(self.dimension, x, i, j),
            Kind::One(function) => function.second_derivative(x(0)),
        }
    }
}

impl Polynomial {
    fn compile(dimension: usize, order: usize, coefficients: &[f64]) -> Result<Polynomial, FunctionError> {
        let (expected, found) = (n_terms(dimension, order), coefficients.len());
        let class = "MultivariatePolynomialFunction";
        if expected != found {
            return Err(FunctionError::CoefficientCount { class, expected, found });
        }
        let term = |(powers, c): (Vec<i32>, &f64)| Ok((finite(class, "coefficients", *c)?, powers));
        powers(dimension, order).into_iter().zip(coefficients).map(term).collect::<Result<_, _>>().map(Polynomial)
    }

    /// Sum of all terms, each differentiated by some variables.
    fn sum(&self, x: impl Fn(usize) -> f64, by: &[usize]) -> f64 {
        let term = |(coefficient, powers): &(f64, Vec<i32>)| {
            let mut product = *coefficient;
            for (k, &power) in powers.iter().enumerate() {
                let times = by.iter().filter(|i| **i == k).count() as i32;
                if times > power {
                    return 0.0;
                }
                product *= (0..times).map(|t| f64::from(power - t)).product::<f64>() * x(k).powi(power - times);
            }
            product
        };
        self.0.iter().map(term).sum()
    }
}

/// Number of terms: the binomial coefficient of dimension + order over dimension.
fn n_terms(dimension: usize, order: usize) -> usize {
    (1..=dimension).fold(1, |product, k| product * (order + k) / k)
}

/// Powers of the terms in OpenSim's order: up to `order` in sum, those of the last variable change first.
fn powers(dimension: usize, order: usize) -> Vec<Vec<i32>> {
    if dimension == 0 {
        return vec![Vec::new()];
    }
    let mut all = Vec::new();
    for first in 0..=order {
        for rest in powers(dimension - 1, order - first) {
            all.push(std::iter::once(first as i32).chain(rest).collect());
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn compiled(dimension: usize, order: usize, coefficients: &[f64]) -> FunctionOfSeveral {
        let spec = FunctionSpec::MultivariatePolynomial { dimension, order, coefficients: coefficients.to_vec() };
        FunctionOfSeveral::compile(&spec, dimension).expect("polynomial")
    }

    #[test]
    fn verif_coefficients_stand_in_opensims_order() {
        // OpenSim's documentation: c0 + c1 y + c2 y² + c3 x + c4 x y + c5 x².
        let f = compiled(2, 2, &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
        let (x, y) = (1.7, -0.9);
        let at = |k: usize| [x, y][k];
        assert_relative_eq!(
            f.value(at),
            0.1 + 0.2 * y + 0.3 * y * y + 0.4 * x + 0.5 * x * y + 0.6 * x * x,
            epsilon = 1e-15
        );
        assert_relative_eq!(f.derivative(at, 0), 0.4 + 0.5 * y + 1.2 * x, epsilon = 1e-15);
        assert_relative_eq!(f.derivative(at, 1), 0.2 + 0.6 * y + 0.5 * x, epsilon = 1e-15);
        assert_eq!(
            [f.second_derivative(at, 0, 0), f.second_derivative(at, 0, 1), f.second_derivative(at, 1, 1)],
            [1.2, 0.5, 0.6]
        );
    }

    #[test]
    fn verif_number_of_coefficients() {
        for (dimension, order) in [(1, 4), (2, 1), (3, 2), (6, 3)] {
            assert_eq!(powers(dimension, order).len(), n_terms(dimension, order));
        }
        let spec = FunctionSpec::MultivariatePolynomial { dimension: 3, order: 2, coefficients: vec![1.0; 9] };
        let error = FunctionOfSeveral::compile(&spec, 3).unwrap_err();
        assert_eq!(
            error,
            FunctionError::CoefficientCount { class: "MultivariatePolynomialFunction", expected: 10, found: 9 }
        );
    }
}
