//! What of a joint the catalogue's sizes and angles go with: they are those of a wrist.

use super::effect::{Effect, Parameter, StrengthScaling};
use super::setting::Setting;
use carpus_study::study::{Contraction, Trial, TrialUse};

/// Largest moments that trials of wrists show, of weak efforts and of strong people [N·m].
const WRIST: [f64; 2] = [1.0, 20.0];

/// Weights of hands about the wrist [N·m]: the lightest.
const LIGHT_HAND: f64 = 0.2;
/// Bodies that weigh less about a joint have no masses of their own: a gram at a centimetre [N·m].
const NO_WEIGHT: f64 = 1e-4;

/// A large size of an effect, as a share of the largest plausible one.
const LARGE_SIZE: f64 = 0.75;

/// A joint beside a wrist.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointTraits {
    /// How many times as strong as a wrist it is: 1 within what wrists reach.
    pub strength: f64,
    /// How many times as heavy as a hand what it moves is: in proportion to its strength, unless the model's bodies are
    /// lighter than a hand, as those of a finger are.
    pub weight: f64,
    /// Angle about which its passive properties lie [rad].
    pub neutral_angle: f64,
}

/// Where a joint's passive properties are taken to lie about [rad]: the coordinate's zero, as at a wrist, if it is in
/// the middle half of the range; else the middle of the range, as at an elbow or a knee, whose zero is full extension.
///
/// - `range`: of the coordinate [rad]
pub fn neutral_angle(range: [f64; 2]) -> f64 {
    let [low, high] = range;
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low).abs());
    // A range without an end is none.
    if middle.abs() <= 0.5 * half || !(middle.is_finite() && half <= std::f64::consts::TAU) { 0.0 } else { middle }
}

impl JointTraits {
    /// Strength by the largest moment of the trials that are not held out; moments at rest do not tell a weak joint.
    ///
    /// - `range`: of the coordinate [rad]
    /// - `weight_moment`: of the model's bodies about the coordinate [N·m]
    pub fn of(trials: &[Trial], range: [f64; 2], weight_moment: f64) -> JointTraits {
        let seen = || trials.iter().filter(|t| t.info.usage != TrialUse::Test);
        let largest = seen().flat_map(|t| &t.moment).fold(0.0_f64, |most, m| most.max(m.abs()));
        let strength = if largest > 0.0 { largest / largest.clamp(WRIST[0], WRIST[1]) } else { 1.0 };
        let at_rest = seen().all(|t| t.info.contraction == Contraction::Passive);
        let strength = if at_rest { strength.max(1.0) } else { strength };
        let is_light = (NO_WEIGHT..LIGHT_HAND).contains(&weight_moment);
        JointTraits {
            strength,
            weight: if is_light { strength.min(weight_moment / LIGHT_HAND) } else { strength },
            neutral_angle: neutral_angle(range),
        }
    }

    /// Scale of an effect's parameter.
    pub fn scale(&self, parameter: &Parameter) -> f64 {
        parameter.scale * self.proportion(parameter)
    }

    /// Value of a parameter without the effect, or of the usual shape.
    pub fn start(&self, parameter: &Parameter) -> f64 {
        parameter.start + parameter.neutral.sign() * self.neutral_angle
    }

    /// Plausible range of an effect's parameter, as reported.
    pub fn plausible(&self, parameter: &Parameter) -> [f64; 2] {
        let shift = parameter.neutral.sign() * self.neutral_angle;
        parameter.plausible.map(|end| end * self.proportion(parameter) + shift)
    }

    /// An effect, absent; of the usual shape at this joint.
    pub fn absent(&self, effect: &'static dyn Effect) -> Setting {
        self.at_neutral_angle(effect, &effect.description().absent())
    }

    /// An effect whose angles are given as at a joint whose neutral angle is 0.
    pub fn at_neutral_angle(&self, effect: &'static dyn Effect, values: &[f64]) -> Setting {
        let parameters = effect.description().parameters;
        let moved = |(value, p): (&f64, &Parameter)| value + p.neutral.sign() * self.neutral_angle;
        Setting { effect, values: values.iter().zip(parameters).map(moved).collect() }
    }

    /// Sizes and shapes of an effect that fits start from: none of the usual shape, and of others that the effect
    /// names; and where the moment acts back on itself a large one, too, because what is fitted from none may end in
    /// another valley.
    pub fn starts(&self, effect: &'static dyn Effect) -> Vec<Setting> {
        let mut sizes = vec![self.absent(effect)];
        sizes.extend(effect.further_starts().iter().map(|values| self.at_neutral_angle(effect, values)));
        if effect.description().feeds_back() {
            let mut large = self.absent(effect);
            let description = effect.description();
            for i in description.amplitudes() {
                large.values[i] = LARGE_SIZE * self.plausible(&description.parameters[i])[1];
            }
            sizes.push(large);
        }
        sizes
    }

    fn proportion(&self, parameter: &Parameter) -> f64 {
        match parameter.strength {
            StrengthScaling::None => 1.0,
            StrengthScaling::Proportional => self.strength,
            StrengthScaling::Weight => self.weight,
            StrengthScaling::Inverse => 1.0 / self.strength,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::CATALOGUE;

    #[test]
    fn verif_every_parameter_with_moment_in_its_unit_is_in_proportion() {
        let joint = JointTraits { strength: 3.0, weight: 3.0, neutral_angle: 0.0 };
        for parameter in CATALOGUE.iter().flat_map(|e| e.description().parameters) {
            let expected = match parameter.unit {
                "rad/(N·m)" => 1.0 / 3.0,
                unit if unit.contains("N·m") || unit.contains("kg") => 3.0,
                _ => 1.0,
            };
            assert_eq!(joint.scale(parameter), parameter.scale * expected, "{}", parameter.name);
        }
    }

    #[test]
    fn verif_what_is_lighter_than_a_hand_weighs_less_whatever_its_strength() {
        let weight = |moment: f64| JointTraits::of(&[], [-1.0, 1.0], moment).weight;
        assert_eq!([0.0, 0.25, 8.0].map(weight), [1.0; 3]);
        assert!((weight(0.02) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn verif_zero_is_neutral_unless_the_range_lies_to_one_side_of_it() {
        let degrees = |low: f64, high: f64| neutral_angle([low.to_radians(), high.to_radians()]).to_degrees();
        assert_eq!(degrees(-70.0, 70.0), 0.0);
        assert_eq!(degrees(-10.0, 25.0), 0.0);
        assert_eq!(degrees(-99999.9, 99999.9), 0.0);
        assert_eq!(degrees(0.0, 99999.9), 0.0);
        assert!((degrees(0.0, 130.0) - 65.0).abs() < 1e-12);
        assert!((degrees(-120.0, 10.0) + 55.0).abs() < 1e-12);
    }

    #[test]
    fn verif_angles_of_effects_move_with_the_neutral_angle() {
        let joint = JointTraits { strength: 2.0, weight: 2.0, neutral_angle: 1.0 };
        let of = |id: &str, name: &str| {
            let effect = CATALOGUE.iter().find(|e| e.description().id == id).unwrap();
            let i = effect.description().parameters.iter().position(|p| p.name == name).unwrap();
            let parameter = &effect.description().parameters[i];
            assert_eq!(joint.absent(*effect).values[i], joint.start(parameter), "{id}.{name}");
            (joint.start(parameter), joint.plausible(parameter))
        };
        assert_eq!(of("joint_stiffness", "rest_angle"), (1.0, [0.4, 1.6]));
        assert_eq!(of("ligament_stop", "flexion_limit"), (1.4, [1.1, 2.6]));
        assert_eq!(of("ligament_stop", "extension_limit"), (-0.6, [-0.9, 0.6000000000000001]));
        assert_eq!(of("end_range_spring", "flexion_steepness"), (4.0, [2.0, 10.0]));
    }
}
