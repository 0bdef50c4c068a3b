//! What is to be determined: properties of muscles, alone or tied together, as logarithms of factors of the model's
//! values.

use super::error::IdentifiabilityError;
pub use carpus_osim::osim::spec::MuscleProperty;
use carpus_osim::osim::spec::MuscleSpec;
use carpus_simulation::simulation::{MuscleParameters, Property};
use carpus_study::study::{ParameterBounds, RelativeBounds};

/// Bounds as fractions of the model's value, where the study gives none: Jadelis (2025), tables 2.1 and 3.2; tendon
/// strain 2–10 % about 4.9 % (Maganaris & Paul 2000, doi:10.1016/S0021-9290(00)00117-3, measured 2.5 % at
/// submaximal force); velocity 5–15 lengths/s about 10; time constants half to twice; shapes of curves half to twice.
pub fn usual_bounds(property: MuscleProperty, lengths_and_force: &ParameterBounds) -> RelativeBounds {
    let [lower, upper] = match property {
        MuscleProperty::MaxIsometricForce => return lengths_and_force.max_isometric_force,
        MuscleProperty::OptimalFiberLength => return lengths_and_force.optimal_fiber_length,
        MuscleProperty::TendonSlackLength => return lengths_and_force.tendon_slack_length,
        MuscleProperty::PennationAngle => [0.4, 2.16],
        MuscleProperty::FiberDamping => [0.25, 4.0],
        MuscleProperty::TendonStrain => [0.4, 2.04],
        MuscleProperty::MaxContractionVelocity => [0.5, 1.5],
        MuscleProperty::ActivationTimeConstant
        | MuscleProperty::DeactivationTimeConstant
        | MuscleProperty::PassiveFiberStrain
        | MuscleProperty::ActiveForceWidth => [0.5, 2.0],
    };
    RelativeBounds { lower, upper }
}

/// Standard deviations between the middle and a bound: lengths of the literature's bounds are three, the rest two.
fn deviations_to_bound(property: MuscleProperty) -> f64 {
    match property {
        MuscleProperty::OptimalFiberLength | MuscleProperty::TendonSlackLength => 3.0,
        _ => 2.0,
    }
}

/// Whether there are parameters, and values within the bounds of each.
///
/// # Errors
/// What is wrong with them.
pub(super) fn check(parameters: &[FreeParameter]) -> Result<(), IdentifiabilityError> {
    if parameters.is_empty() {
        return Err(IdentifiabilityError::NoParameters);
    }
    for p in parameters {
        if !(p.lower > 0.0 && p.upper > p.lower && p.upper.is_finite()) {
            return Err(IdentifiabilityError::Bounds { name: p.name(), lower: p.lower, upper: p.upper });
        }
    }
    Ok(())
}

/// The property among those that every fit estimates.
pub fn fitted(property: MuscleProperty) -> Option<Property> {
    Property::ALL.into_iter().find(|p| p.name() == property.name())
}

/// Whether a simulation's exact derivatives cover it.
pub(super) fn is_parameter(property: MuscleProperty) -> bool {
    matches!(
        property,
        MuscleProperty::MaxIsometricForce
            | MuscleProperty::OptimalFiberLength
            | MuscleProperty::TendonSlackLength
            | MuscleProperty::PennationAngle
    )
}

/// What is known of a parameter before the data are seen: its logarithm is normally distributed.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// Most probable factor of the model's value.
    pub factor: f64,
    /// Standard deviation of the logarithm.
    pub log_sd: f64,
    /// Where it is from: a source or a file; `None`: the bounds.
    pub source: Option<String>,
}

/// A parameter: one factor of one property of one muscle, or of several that are tied together.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeParameter {
    /// The muscle, or the name of the group of tied ones.
    pub owner: String,
    /// The property.
    pub property: MuscleProperty,
    /// Positions of the muscles among the active ones.
    pub muscles: Vec<usize>,
    /// The first muscle's value in the model.
    pub nominal: f64,
    /// Least factor.
    pub lower: f64,
    /// Greatest factor.
    pub upper: f64,
    /// Prior knowledge.
    pub prior: Prior,
}

impl FreeParameter {
    /// A parameter with the prior that its bounds stand for.
    pub fn new(
        owner: &str,
        property: MuscleProperty,
        muscles: Vec<usize>,
        nominal: f64,
        bounds: RelativeBounds,
    ) -> FreeParameter {
        let log_sd = (bounds.upper / bounds.lower).ln() / (2.0 * deviations_to_bound(property));
        FreeParameter {
            owner: owner.to_string(),
            property,
            muscles,
            nominal,
            lower: bounds.lower,
            upper: bounds.upper,
            prior: Prior { factor: 1.0, log_sd: log_sd.max(1e-3), source: None },
        }
    }

    /// Muscle (or group) and property.
    pub fn name(&self) -> String {
        format!("{}.{}", self.owner, self.property.name())
    }

    /// Muscle (or group) and property in words.
    pub fn words(&self) -> String {
        format!("{} {}", self.owner, self.property.words())
    }

    /// Bounds of the logarithm.
    pub fn log_bounds(&self) -> [f64; 2] {
        [self.lower.ln(), self.upper.ln()]
    }
}

/// The parameters of a problem and which muscle each belongs to.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) free: Vec<FreeParameter>,
    /// Per muscle: parameters other than strength, by position.
    pub(super) shapes: Vec<Vec<usize>>,
    /// Per muscle: parameters of strength (none, one, or several where groups overlap).
    pub(super) strengths: Vec<Vec<usize>>,
}

impl Layout {
    pub(super) fn new(free: Vec<FreeParameter>, muscles: usize) -> Layout {
        let mut shapes = vec![Vec::new(); muscles];
        let mut strengths = vec![Vec::new(); muscles];
        for (i, parameter) in free.iter().enumerate() {
            for m in &parameter.muscles {
                let list =
                    if parameter.property == MuscleProperty::MaxIsometricForce { &mut strengths } else { &mut shapes };
                list[*m].push(i);
            }
        }
        Layout { free, shapes, strengths }
    }

    pub(super) fn len(&self) -> usize {
        self.free.len()
    }

    /// A muscle's parameters where `value` gives the logarithm of every parameter's factor.
    pub(super) fn parameters(
        &self,
        muscle: usize,
        nominal: &MuscleParameters,
        value: &dyn Fn(usize) -> f64,
    ) -> MuscleParameters {
        let mut out = *nominal;
        for i in self.strengths[muscle].iter().chain(&self.shapes[muscle]) {
            let factor = value(*i).exp();
            match self.free[*i].property {
                MuscleProperty::MaxIsometricForce => out.max_isometric_force *= factor,
                MuscleProperty::OptimalFiberLength => out.optimal_fiber_length *= factor,
                MuscleProperty::TendonSlackLength => out.tendon_slack_length *= factor,
                MuscleProperty::PennationAngle => out.pennation_angle_at_optimal *= factor,
                _ => {}
            }
        }
        out
    }

    /// Whether any parameter changes curves, damping or activation, for which trials must be prepared anew.
    pub(super) fn changes_model(&self) -> bool {
        self.free.iter().any(|p| !is_parameter(p.property))
    }

    /// Applies to a muscle's specification what is not in [`MuscleParameters`].
    pub(super) fn change(&self, muscle: usize, spec: &mut MuscleSpec, value: &dyn Fn(usize) -> f64) {
        for i in &self.shapes[muscle] {
            let property = self.free[*i].property;
            if !is_parameter(property) {
                property.scale(spec, value(*i).exp());
            }
        }
    }
}
