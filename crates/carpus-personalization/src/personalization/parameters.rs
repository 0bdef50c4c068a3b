//! The parameters that are fitted, as factors of the model's own values.

use super::{FitProblem, PersonalizationError};
use carpus_simulation::simulation::MuscleParameters;
use carpus_study::study::RelativeBounds;

/// A fitted property of a muscle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Property {
    /// `optimal_fiber_length`.
    OptimalFiberLength,
    /// `tendon_slack_length`.
    TendonSlackLength,
    /// `max_isometric_force`.
    MaxIsometricForce,
}

impl Property {
    /// All, in the order of parameter vectors.
    pub const ALL: [Property; 3] =
        [Property::OptimalFiberLength, Property::TendonSlackLength, Property::MaxIsometricForce];

    /// OpenSim's property name.
    pub fn name(self) -> &'static str {
        match self {
            Property::OptimalFiberLength => "optimal_fiber_length",
            Property::TendonSlackLength => "tendon_slack_length",
            Property::MaxIsometricForce => "max_isometric_force",
        }
    }

    /// Unit in the file.
    pub fn unit(self) -> &'static str {
        match self {
            Property::OptimalFiberLength | Property::TendonSlackLength => "m",
            Property::MaxIsometricForce => "N",
        }
    }

    /// Its value among a muscle's parameters.
    pub fn of(self, parameters: &MuscleParameters) -> f64 {
        match self {
            Property::OptimalFiberLength => parameters.optimal_fiber_length,
            Property::TendonSlackLength => parameters.tendon_slack_length,
            Property::MaxIsometricForce => parameters.max_isometric_force,
        }
    }

    fn of_mut(self, parameters: &mut MuscleParameters) -> &mut f64 {
        match self {
            Property::OptimalFiberLength => &mut parameters.optimal_fiber_length,
            Property::TendonSlackLength => &mut parameters.tendon_slack_length,
            Property::MaxIsometricForce => &mut parameters.max_isometric_force,
        }
    }
}

/// A bound that a fitted value lies at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoundHit {
    /// The lower bound.
    Lower,
    /// The upper bound.
    Upper,
}

/// How far the training data determine a parameter, to first order about the fitted values.
///
/// The fit's prior knowledge of a parameter is that it lies within its bounds, which are three standard deviations from
/// the model's value; the data narrow that down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Determination {
    /// Standard deviation after the fit over the model's value.
    pub relative_deviation: f64,
    /// Share of the prior variance that the data removed: 0, the data say nothing; 1, they say all.
    pub share_from_data: f64,
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
    /// How far the data determine it; only after [`Method::Joint`](super::Method::Joint).
    pub determination: Option<Determination>,
}

/// All fitted parameters as one vector of factors: optimal fibre lengths of all muscles, then tendon slack lengths, then
/// maximum isometric forces.
#[derive(Clone, Debug)]
pub(super) struct ParameterSpace {
    muscles: Vec<String>,
    nominal: Vec<MuscleParameters>,
    bounds: [RelativeBounds; 3],
}

impl ParameterSpace {
    pub(super) fn new(problem: &FitProblem) -> Result<ParameterSpace, PersonalizationError> {
        let expected = problem.nominal.len();
        if expected == 0 {
            return Err(PersonalizationError::NoMuscles);
        }
        if problem.muscles.len() != expected {
            let found = problem.muscles.len();
            return Err(PersonalizationError::Count { what: "names of muscles", found, expected });
        }
        let b = &problem.bounds;
        let bounds = [b.optimal_fiber_length, b.tendon_slack_length, b.max_isometric_force];
        for (property, RelativeBounds { lower, upper }) in Property::ALL.into_iter().zip(bounds) {
            if !(lower > 0.0 && lower <= 1.0 && upper >= 1.0 && upper > lower && upper.is_finite()) {
                return Err(PersonalizationError::Bounds { property: property.name(), lower, upper });
            }
        }
        Ok(ParameterSpace { muscles: problem.muscles.clone(), nominal: problem.nominal.clone(), bounds })
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

    pub(super) fn fitted(&self, factors: &[f64], known: Option<&[Determination]>) -> Vec<FittedParameter> {
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
                out.push(FittedParameter {
                    muscle: self.muscles[m].clone(),
                    property,
                    before,
                    after: before * factors[index],
                    lower: before * lower,
                    upper: before * upper,
                    at_bound,
                    determination: known.map(|known| known[index]),
                });
            }
        }
        out
    }
}
