//! Sizes of effects in proportion to a joint's strength: the catalogue's are those of a wrist.

use super::effect::Parameter;
use crate::study::{Contraction, Trial, TrialUse};

/// Largest moments that trials of wrists show, of weak efforts and of strong people [N·m].
const WRIST: [f64; 2] = [1.0, 20.0];

/// How many times as strong as a wrist a joint is: 1 within what wrists reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strength(pub f64);

impl Strength {
    /// By the largest moment of the trials that are not held out; moments at rest do not tell a weak joint.
    pub fn of(trials: &[Trial]) -> Strength {
        let seen = || trials.iter().filter(|t| t.info.usage != TrialUse::Test);
        let largest = seen().flat_map(|t| &t.moment).fold(0.0_f64, |most, m| most.max(m.abs()));
        let strength = if largest > 0.0 { largest / largest.clamp(WRIST[0], WRIST[1]) } else { 1.0 };
        Strength(if seen().all(|t| t.info.contraction == Contraction::Passive) { strength.max(1.0) } else { strength })
    }

    /// Scale of an effect's parameter.
    pub fn scale(&self, parameter: &Parameter) -> f64 {
        parameter.scale * self.proportion(parameter)
    }

    /// Plausible range of an effect's parameter, as reported.
    pub fn plausible(&self, parameter: &Parameter) -> [f64; 2] {
        parameter.plausible.map(|end| end * self.proportion(parameter))
    }

    /// Moments, stiffness, drag and inertia go with strength, compliance against it.
    fn proportion(&self, parameter: &Parameter) -> f64 {
        match parameter.unit {
            "kg·m²" => self.0,
            "rad/(N·m)" => 1.0 / self.0,
            unit if unit.starts_with("N·m") => self.0,
            _ => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::catalogue::CATALOGUE;

    #[test]
    fn verif_every_parameter_with_moment_in_its_unit_is_in_proportion() {
        let strength = Strength(3.0);
        for parameter in CATALOGUE.iter().flat_map(|e| e.description().parameters) {
            let expected = match parameter.unit {
                "rad/(N·m)" => 1.0 / 3.0,
                unit if unit.contains("N·m") || unit.contains("kg") => 3.0,
                _ => 1.0,
            };
            assert_eq!(strength.scale(parameter), parameter.scale * expected, "{}", parameter.name);
        }
    }
}
