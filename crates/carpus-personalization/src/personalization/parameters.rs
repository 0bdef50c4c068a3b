//! The parameters that are fitted, as factors of the model's own values.

use super::error::PersonalizationError;
use super::problem::FitProblem;
use carpus_diagnosis::inference::muscles::MuscleEstimate;
use carpus_simulation::simulation::{MuscleParameters, Property};
use carpus_study::study::{ParameterBounds, RelativeBounds};

/// A bound that a fitted value lies at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoundHit {
    /// The lower bound.
    Lower,
    /// The upper bound.
    Upper,
}

/// A fitted parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedParameter {
    /// The muscle.
    pub muscle: String,
    /// The property.
    pub property: Property,
    /// Value before the fit, in [`Property::unit`].
    pub before: f64,
    /// Fitted value.
    pub after: f64,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// The bound that it lies at, if it does.
    pub at_bound: Option<BoundHit>,
    /// What the trials say of it; only of [`personalize`](super::personalize).
    pub estimate: Option<MuscleEstimate>,
}

/// All fitted parameters as one vector of factors: optimal fibre lengths of all muscles, then tendon slack lengths,
/// then maximum isometric forces.
#[derive(Clone, Debug)]
pub(super) struct ParameterSpace {
    muscles: Vec<String>,
    nominal: Vec<MuscleParameters>,
    bounds: [RelativeBounds; 3],
}

impl ParameterSpace {
    pub(super) fn of(problem: &FitProblem) -> Result<ParameterSpace, PersonalizationError> {
        ParameterSpace::new(problem.muscles.clone(), problem.nominal.clone(), &problem.bounds)
    }

    pub(super) fn new(
        muscles: Vec<String>,
        nominal: Vec<MuscleParameters>,
        b: &ParameterBounds,
    ) -> Result<ParameterSpace, PersonalizationError> {
        let expected = nominal.len();
        if expected == 0 {
            return Err(PersonalizationError::NoMuscles);
        }
        if muscles.len() != expected {
            let found = muscles.len();
            return Err(PersonalizationError::Count { what: "names of muscles", found, expected });
        }
        let bounds = [b.optimal_fiber_length, b.tendon_slack_length, b.max_isometric_force];
        for (property, RelativeBounds { lower, upper }) in Property::ALL.into_iter().zip(bounds) {
            if !(lower > 0.0 && lower <= 1.0 && upper >= 1.0 && upper > lower && upper.is_finite()) {
                return Err(PersonalizationError::Bounds { property: property.name(), lower, upper });
            }
        }
        Ok(ParameterSpace { muscles, nominal, bounds })
    }

    /// Number of muscles.
    pub(super) fn n_muscles(&self) -> usize {
        self.nominal.len()
    }

    /// Number of parameters.
    pub(super) fn len(&self) -> usize {
        3 * self.n_muscles()
    }

    /// The factors of the model itself.
    pub(super) fn unchanged(&self) -> Vec<f64> {
        vec![1.0; self.len()]
    }

    /// Bounds of the factor at a position of the vector.
    pub(super) fn bounds(&self, index: usize) -> RelativeBounds {
        self.bounds[index / self.n_muscles()]
    }

    /// The factors that parameters stand for.
    pub(super) fn factors(&self, parameters: &[MuscleParameters]) -> Vec<f64> {
        let of = |property: Property| {
            parameters.iter().zip(&self.nominal).map(move |(p, nominal)| property.of(p) / property.of(nominal))
        };
        Property::ALL.into_iter().flat_map(of).collect()
    }

    /// The parameters that factors stand for.
    pub(super) fn parameters(&self, factors: &[f64]) -> Vec<MuscleParameters> {
        let n = self.n_muscles();
        let mut out = self.nominal.clone();
        for (k, property) in Property::ALL.into_iter().enumerate() {
            for (m, parameters) in out.iter_mut().enumerate() {
                *property.of_mut(parameters) *= factors[k * n + m];
            }
        }
        out
    }

    /// `factors` with those from `first` on taken from a point of the unit box, whose sides are the bounds.
    pub(super) fn placed(&self, factors: &[f64], first: usize, point: &[f64]) -> Vec<f64> {
        let mut out = factors.to_vec();
        for (i, x) in point.iter().enumerate() {
            let RelativeBounds { lower, upper } = self.bounds(first + i);
            out[first + i] = lower + x * (upper - lower);
        }
        out
    }

    /// The inverse of [`ParameterSpace::placed`] for `n` factors.
    pub(super) fn unit_point(&self, factors: &[f64], first: usize, n: usize) -> Vec<f64> {
        let position = |i: usize| {
            let RelativeBounds { lower, upper } = self.bounds(i);
            (factors[i] - lower) / (upper - lower)
        };
        (first..first + n).map(position).collect()
    }

    /// Whether factors of this property are searched on a logarithmic scale: forces span more than a factor of five.
    fn logarithmic(&self, index: usize) -> bool {
        index >= 2 * self.n_muscles()
    }

    /// All factors as a point of the unit box, forces logarithmically.
    pub(super) fn to_unit(&self, factors: &[f64]) -> Vec<f64> {
        let position = |(i, factor): (usize, &f64)| {
            let RelativeBounds { lower, upper } = self.bounds(i);
            if self.logarithmic(i) {
                (factor / lower).ln() / (upper / lower).ln()
            } else {
                (factor - lower) / (upper - lower)
            }
        };
        factors.iter().enumerate().map(position).collect()
    }

    /// The factor at a coordinate of the unit box of [`ParameterSpace::to_unit`], and its derivative by the coordinate.
    pub(super) fn at_unit(&self, index: usize, x: f64) -> (f64, f64) {
        let RelativeBounds { lower, upper } = self.bounds(index);
        let x = x.clamp(0.0, 1.0);
        if self.logarithmic(index) {
            let rate = (upper / lower).ln();
            let factor = lower * (rate * x).exp();
            (factor.clamp(lower, upper), rate * factor)
        } else {
            (lower + x * (upper - lower), upper - lower)
        }
    }

    /// Every parameter, muscle by muscle.
    ///
    /// - `estimates`: of each, in this order, or of none
    pub(super) fn fitted(&self, factors: &[f64], estimates: Option<Vec<MuscleEstimate>>) -> Vec<FittedParameter> {
        let mut estimates = estimates.into_iter().flatten();
        let n = self.n_muscles();
        let mut out = Vec::with_capacity(self.len());
        for m in 0..n {
            for (k, property) in Property::ALL.into_iter().enumerate() {
                let index = k * n + m;
                let before = property.of(&self.nominal[m]);
                let RelativeBounds { lower, upper } = self.bounds(index);
                // Optimizers approach a bound without reaching it.
                let near = 1e-3 * (upper - lower);
                let at_bound = if factors[index] <= lower + near {
                    Some(BoundHit::Lower)
                } else if factors[index] >= upper - near {
                    Some(BoundHit::Upper)
                } else {
                    None
                };
                let estimate = estimates.next();
                out.push(FittedParameter {
                    muscle: self.muscles[m].clone(),
                    property,
                    before,
                    after: estimate.as_ref().map_or(before * factors[index], |e| e.value),
                    lower: estimate.as_ref().map_or(before * lower, |e| e.bounds[0]),
                    upper: estimate.as_ref().map_or(before * upper, |e| e.bounds[1]),
                    at_bound,
                    estimate,
                });
            }
        }
        out
    }
}
