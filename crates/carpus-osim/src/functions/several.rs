//! Polynomials of several variables, with first and second derivatives.

use super::error::FunctionError;
use super::points::finite;
use crate::osim::spec::FunctionSpec;

/// A function of several variables: a sum of products of powers of them.
///
/// OpenSim: `MultivariatePolynomialFunction`, `LinearFunction` of several variables, `Constant`, `MultiplierFunction`
/// of these.
#[derive(Clone, Debug, PartialEq)]
pub struct FunctionOfSeveral {
    /// Number of variables.
    dimension: usize,
    /// Coefficient and powers, one of each variable.
    terms: Vec<(f64, Vec<i32>)>,
}

impl FunctionOfSeveral {
    /// Builds a function of `dimension` variables.
    ///
    /// # Errors
    /// A function of another number of variables; coefficients that are not finite or of another number.
    pub fn compile(spec: &FunctionSpec, dimension: usize) -> Result<FunctionOfSeveral, FunctionError> {
        match spec {
            FunctionSpec::Constant { value } => {
                let terms = vec![(finite("Constant", "value", *value)?, vec![0; dimension])];
                Ok(FunctionOfSeveral { dimension, terms })
            }
            FunctionSpec::Multiplier { scale, function } => {
                let scale = finite("MultiplierFunction", "scale", *scale)?;
                let mut function = FunctionOfSeveral::compile(function, dimension)?;
                function.terms.iter_mut().for_each(|(coefficient, _)| *coefficient *= scale);
                Ok(function)
            }
            FunctionSpec::MultivariatePolynomial { dimension: own, order, coefficients } if *own == dimension => {
                let (expected, found) = (n_terms(dimension, *order), coefficients.len());
                let class = "MultivariatePolynomialFunction";
                if expected != found {
                    return Err(FunctionError::CoefficientCount { class, expected, found });
                }
                let term = |(powers, c): (Vec<i32>, &f64)| Ok((finite(class, "coefficients", *c)?, powers));
                let terms =
                    powers(dimension, *order).into_iter().zip(coefficients).map(term).collect::<Result<_, _>>()?;
                Ok(FunctionOfSeveral { dimension, terms })
            }
            FunctionSpec::MultivariatePolynomial { dimension: own, .. } => {
                Err(FunctionError::Dimension { expected: dimension, found: *own })
            }
            _ => Err(FunctionError::Dimension { expected: dimension, found: 1 }),
        }
    }

    /// Number of variables.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Value; `x` gives the variables.
    pub fn value(&self, x: impl Fn(usize) -> f64) -> f64 {
        self.sum(x, &[])
    }

    /// Derivative by variable `i`.
    pub fn derivative(&self, x: impl Fn(usize) -> f64, i: usize) -> f64 {
        self.sum(x, &[i])
    }

    /// Derivative by variables `i` and `j`.
    pub fn second_derivative(&self, x: impl Fn(usize) -> f64, i: usize, j: usize) -> f64 {
        self.sum(x, &[i, j])
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
        self.terms.iter().map(term).sum()
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
