//! What quantities can be: one table of ranges with their sources, and the slips that explain a value outside.
//!
//! In: a number in the unit of its row. Out: nothing, or a [`Doubt`] that names the range and, where a usual slip of
//! unit explains the value, that slip. Nothing is refused here: who asks decides whether a doubt is a warning or an
//! error.
//!
//! Ranges are wide on purpose. They hold for people of any age and for the animals whose models are published; a value
//! outside is a slip far more often than a finding.

mod units;

use std::fmt;

pub use units::{Measured, NAMED_UNITS, NamedUnit, moment_unit_of_ratio, unit_in_name};

/// A quantity and the values that it can have.
#[derive(Debug, PartialEq)]
pub struct Plausible {
    /// What it is, in the field's words.
    pub quantity: &'static str,
    /// Unit of `range`; empty for a number without unit.
    pub unit: &'static str,
    /// Least and greatest plausible value.
    pub range: [f64; 2],
    /// Where the range is from.
    pub source: &'static str,
    /// What is usually wrong with a value outside, the likeliest first.
    pub slips: &'static [Slip],
}

/// A usual mistake: the number is in another unit.
#[derive(Debug, PartialEq)]
pub struct Slip {
    /// The unit that the number may be in.
    pub unit: &'static str,
    /// How many of the expected unit one of `unit` is.
    pub factor: f64,
}

/// A value outside its plausible range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Doubt {
    /// The row of the table.
    pub of: &'static Plausible,
    /// The value, in the unit of the row.
    pub value: f64,
}

impl Plausible {
    /// A doubt, if the value is outside the range.
    pub fn doubt(&'static self, value: f64) -> Option<Doubt> {
        let [lower, upper] = self.range;
        (!(lower..=upper).contains(&value)).then_some(Doubt { of: self, value })
    }
}

impl Doubt {
    /// The slip that makes a plausible value of this one.
    pub fn slip(&self) -> Option<&'static Slip> {
        let [lower, upper] = self.of.range;
        self.of.slips.iter().find(|slip| (lower..=upper).contains(&(self.value * slip.factor)))
    }

    /// What may be wrong, as a question; without a slip, where the range is from.
    pub fn hint(&self) -> String {
        match self.slip() {
            Some(slip) => {
                let (value, unit) = (Number(self.value), self.of.unit);
                let meant = Number(self.value * slip.factor);
                let space = if unit.is_empty() { "" } else { " " };
                format!("check the unit: is it in {}? {value} {0} are {meant}{space}{unit}", slip.unit)
            }
            None => format!("check the unit; the range is that of {}", self.of.source),
        }
    }
}

impl fmt::Display for Doubt {
    /// `1e-9 is not plausible in m (expected 0.001 to 0.6)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [lower, upper] = self.of.range.map(Number);
        let unit = if self.of.unit.is_empty() { String::new() } else { format!(" in {}", self.of.unit) };
        write!(f, "{} is not plausible{unit} (expected {lower} to {upper})", Number(self.value))
    }
}

/// A number with at most four significant digits.
struct Number(f64);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.0.abs();
        if size != 0.0 && !(1e-4..1e7).contains(&size) {
            return write!(f, "{:e}", format!("{:.3e}", self.0).parse::<f64>().unwrap_or(self.0));
        }
        let decimals = if size == 0.0 { 0 } else { (3 - size.log10().floor() as i32).max(0) as usize };
        write!(f, "{}", format!("{:.decimals$}", self.0).parse::<f64>().unwrap_or(self.0))
    }
}

const MILLIMETRES: Slip = Slip { unit: "mm", factor: 1e-3 };
const CENTIMETRES: Slip = Slip { unit: "cm", factor: 1e-2 };
const INCHES: Slip = Slip { unit: "inches", factor: 0.0254 };
const DEGREES: Slip = Slip { unit: "degrees", factor: std::f64::consts::PI / 180.0 };
const MILLISECONDS: Slip = Slip { unit: "ms", factor: 1e-3 };
const GRAMS: Slip = Slip { unit: "g", factor: 1e-3 };

/// Length of a fibre at which it is strongest.
pub static OPTIMAL_FIBER_LENGTH: Plausible = Plausible {
    quantity: "optimal fibre length",
    unit: "m",
    range: [1e-3, 0.6],
    source: "Ward et al. 2009 (sartorius, 0.40 m) and small animals (rat hindlimb from 0.003 m, Johnson et al. 2008)",
    slips: &[MILLIMETRES, CENTIMETRES],
};

/// Length of an unloaded tendon; a muscle may have none.
pub static TENDON_SLACK_LENGTH: Plausible = Plausible {
    quantity: "tendon slack length",
    unit: "m",
    range: [0.0, 1.0],
    source: "Rajagopal et al. 2016 (gracilis and the long toe flexors stay below 0.5 m)",
    slips: &[MILLIMETRES, CENTIMETRES],
};

/// Largest isometric force of a muscle. Zero is a muscle that is switched off.
pub static MAX_ISOMETRIC_FORCE: Plausible = Plausible {
    quantity: "maximum isometric force",
    unit: "N",
    range: [0.01, 3e4],
    source: "Rajagopal et al. 2016 (soleus, 6195 N), muscles lumped into one above it, small animals below",
    slips: &[],
};

/// Pennation angle at optimal fibre length.
pub static PENNATION_ANGLE: Plausible = Plausible {
    quantity: "pennation angle at optimal fibre length",
    unit: "rad",
    range: [0.0, 1.05],
    source: "Ward et al. 2009 (30° at rest) and Maganaris et al. 1998 (up to 60° under load)",
    slips: &[DEGREES],
};

/// Largest shortening velocity.
pub static MAX_CONTRACTION_VELOCITY: Plausible = Plausible {
    quantity: "maximum contraction velocity",
    unit: "optimal fibre lengths/s",
    range: [0.5, 50.0],
    source: "Zajac 1989 (10), slow and fast fibres of man and animals beside it",
    slips: &[],
};

/// Activation that a muscle starts from, or does not fall below.
pub static ACTIVATION: Plausible = Plausible {
    quantity: "activation",
    unit: "parts of 1",
    range: [0.0, 1.0],
    source: "Zajac 1989 (1: all fibres of the muscle are fully active)",
    slips: &[Slip { unit: "%", factor: 0.01 }],
};

/// Activation that a muscle does not fall below.
pub static MINIMUM_ACTIVATION: Plausible = Plausible {
    quantity: "minimum activation",
    unit: "parts of 1",
    range: [0.0, 0.3],
    source: "Millard et al. 2013 (0.01; at rest a muscle is hardly active)",
    slips: &[Slip { unit: "%", factor: 0.01 }],
};

/// Time constants of activation and deactivation.
pub static ACTIVATION_TIME: Plausible = Plausible {
    quantity: "time constant of activation",
    unit: "s",
    range: [5e-4, 0.5],
    source: "Winters 1995 (0.01 to 0.05 s), slow muscles up to ten times as slow",
    slips: &[MILLISECONDS],
};

/// Damping of a muscle's fibre.
pub static FIBER_DAMPING: Plausible = Plausible {
    quantity: "damping of the fibre",
    unit: "",
    range: [0.0, 10.0],
    source: "Millard et al. 2013 (0.1; a fibre that shortens at full speed resists with a tenth of its force)",
    slips: &[],
};

/// Viscous drag of a dynamometer's arm.
pub static DYNAMOMETER_DAMPING: Plausible = Plausible {
    quantity: "drag of the dynamometer",
    unit: "N·m·s/deg",
    range: [0.0, 1.0],
    source: "machines that a person can move: 1 is 100 N·m of drag at 100 deg/s, as much as a strong knee gives",
    slips: &[Slip { unit: "N·m·s/rad", factor: std::f64::consts::PI / 180.0 }],
};

/// Mass of one body of a model.
pub static SEGMENT_MASS: Plausible = Plausible {
    quantity: "mass of a body",
    unit: "kg",
    range: [0.0, 300.0],
    source: "de Leva 1996 (trunk, 43 % of the body) and people of up to 400 kg with a load",
    slips: &[GRAMS],
};

/// How far a point of a body lies from the body's origin: path points, joints, mass centres.
pub static POINT_DISTANCE: Plausible = Plausible {
    quantity: "distance from the origin of its frame",
    unit: "m",
    range: [0.0, 10.0],
    source: "the height of a person, which no body exceeds, and what stands in a laboratory beside it",
    slips: &[MILLIMETRES, CENTIMETRES],
};

/// Radius, semi-axis or length of a surface that paths wrap around.
pub static WRAP_SIZE: Plausible = Plausible {
    quantity: "size of a wrapping surface",
    unit: "m",
    range: [0.0, 2.0],
    source: "Seth et al. 2019 (ellipsoid of the rib cage, 0.25 m) and cylinders that are longer than the body they lie \
             in",
    slips: &[MILLIMETRES, CENTIMETRES],
};

/// Angle of a joint or between two frames.
pub static JOINT_ANGLE: Plausible = Plausible {
    quantity: "angle",
    unit: "rad",
    range: [-12.6, 12.6],
    source: "two whole turns either way",
    slips: &[DEGREES],
};

/// Radius of gyration of a body: the square root of its moment of inertia over its mass.
pub static GYRATION_RADIUS: Plausible = Plausible {
    quantity: "radius of gyration",
    unit: "m",
    range: [0.0, 5.0],
    source: "the height of a person, which no body exceeds, and what stands in a laboratory beside it",
    slips: &[MILLIMETRES, CENTIMETRES],
};

/// Size of the acceleration due to gravity.
pub static GRAVITY: Plausible = Plausible {
    quantity: "gravity",
    unit: "m/s²",
    range: [0.0, 30.0],
    source: "the Earth (9.81), with none and with a centrifuge's beside it",
    slips: &[Slip { unit: "mm/s²", factor: 1e-3 }, Slip { unit: "cm/s²", factor: 1e-2 }],
};

/// Mass of a person.
pub static BODY_MASS: Plausible = Plausible {
    quantity: "body mass",
    unit: "kg",
    range: [10.0, 400.0],
    source: "children of two years to the heaviest adults",
    slips: &[Slip { unit: "pounds", factor: 0.453_592_37 }, GRAMS, Slip { unit: "stones", factor: 6.350_293_18 }],
};

/// Mass of a person whose height is not known. Heavier people are measured, but pounds are written more often.
pub static USUAL_BODY_MASS: Plausible = Plausible {
    quantity: "body mass",
    unit: "kg",
    range: [15.0, 140.0],
    source: "Fryar et al. 2021 (NHANES: 95 of 100 adults weigh less than 127 kg)",
    slips: BODY_MASS.slips,
};

/// Mass over height squared.
pub static BODY_MASS_INDEX: Plausible = Plausible {
    quantity: "mass over height²",
    unit: "kg/m²",
    range: [12.0, 46.0],
    source: "Fryar et al. 2021 (NHANES: 95 of 100 adults have less than 44 kg/m²) and the thinnest who live",
    slips: BODY_MASS.slips,
};

/// Height of a person.
pub static BODY_HEIGHT: Plausible = Plausible {
    quantity: "body height",
    unit: "m",
    range: [0.5, 2.6],
    source: "newborns to the tallest adults",
    slips: &[CENTIMETRES, Slip { unit: "feet", factor: 0.3048 }, INCHES, MILLIMETRES],
};

/// Size of a person's segment over that of the model's.
pub static SCALE_FACTOR: Plausible = Plausible {
    quantity: "scale factor",
    unit: "",
    range: [0.25, 3.0],
    source: "a newborn's hand beside an adult's (0.06 m of 0.19 m, Snyder et al. 1977)",
    slips: &[Slip { unit: "%", factor: 0.01 }],
};

/// Length of a segment of the arm or leg.
pub static SEGMENT_LENGTH: Plausible = Plausible {
    quantity: "segment length",
    unit: "m",
    range: [0.005, 1.0],
    source: "Winter 2009, from a phalanx to a whole leg",
    slips: &[CENTIMETRES, MILLIMETRES, INCHES],
};

/// Moment of a maximum voluntary contraction, as `participants.csv` states it.
pub static MVC_MOMENT: Plausible = Plausible {
    quantity: "maximum voluntary moment",
    unit: "N·m",
    range: [0.2, 500.0],
    source: "Delp et al. 1996 (wrist, 3 to 20 N·m) with fingers below and the knee above",
    slips: &[Slip { unit: "N·cm", factor: 1e-2 }, Slip { unit: "N·mm", factor: 1e-3 }],
};

/// Effort that was asked for; zero is none.
pub static EFFORT_PERCENT: Plausible = Plausible {
    quantity: "effort",
    unit: "%",
    range: [1.0, 100.0],
    source: "protocols: 1 % of the maximum is rest to any dynamometer",
    slips: &[Slip { unit: "parts of 1", factor: 100.0 }],
};

/// Time from the first to the last sample of a trial.
pub static TRIAL_DURATION: Plausible = Plausible {
    quantity: "duration",
    unit: "s",
    range: [0.05, 3600.0],
    source: "the rise of a voluntary contraction (0.1 to 0.3 s) and the longest measurement without a pause",
    slips: &[],
};

/// Time between two samples of a trial.
pub static TIME_STEP: Plausible = Plausible {
    quantity: "time step",
    unit: "s",
    range: [1e-5, 0.02],
    source: "recorders (100 kHz at most) and activation dynamics (time constants of 10 to 40 ms)",
    slips: &[
        MILLISECONDS,
        Slip { unit: "µs", factor: 1e-6 },
        Slip { unit: "minutes", factor: 60.0 },
        Slip { unit: "hours", factor: 3600.0 },
        Slip { unit: "days", factor: 86_400.0 },
    ],
};

/// Optimal fibre length and tendon slack length relative to a scaled model.
pub static LENGTH_BOUND: Plausible = Plausible {
    quantity: "bound of a length",
    unit: "%",
    range: [50.0, 200.0],
    source: "Lieber et al. 1990, Loren & Lieber 1995 (standard deviations of 4 to 6 %), eight of them and more",
    slips: &[Slip { unit: "parts of 1", factor: 100.0 }],
};

/// Maximum isometric force relative to a scaled model.
pub static FORCE_BOUND: Plausible = Plausible {
    quantity: "bound of the force",
    unit: "%",
    range: [5.0, 1000.0],
    source: "Holzbaur et al. 2007 (the strongest wrist has six times the moment of the weakest)",
    slips: &[Slip { unit: "parts of 1", factor: 100.0 }],
};

/// Length of a muscle's belly in an image.
pub static BELLY_LENGTH: Plausible = Plausible {
    quantity: "length of the muscle belly",
    unit: "m",
    range: [0.005, 1.0],
    source: "Ward et al. 2009, and lumbricals below",
    slips: &[MILLIMETRES, CENTIMETRES],
};

/// Length of a tendon outside the belly.
pub static EXTERNAL_TENDON_LENGTH: Plausible = Plausible {
    quantity: "length of the external tendon",
    unit: "m",
    range: [0.001, 1.0],
    source: "Loren & Lieber 1995 (wrist, 0.2 m), short and long ones beside them",
    slips: &[MILLIMETRES, CENTIMETRES],
};

/// Cross-section of a muscle's belly.
pub static CROSS_SECTIONAL_AREA: Plausible = Plausible {
    quantity: "cross-sectional area",
    unit: "m²",
    range: [1e-6, 0.05],
    source: "Holzbaur et al. 2007 (arm) and the vasti above",
    slips: &[Slip { unit: "cm²", factor: 1e-4 }, Slip { unit: "mm²", factor: 1e-6 }],
};

/// Length of a fascicle in an image.
pub static FASCICLE_LENGTH: Plausible = Plausible {
    quantity: "fascicle length",
    unit: "m",
    range: [0.002, 1.0],
    source: "Ward et al. 2009 (sartorius, 0.40 m) and muscles of the hand",
    slips: &[MILLIMETRES, CENTIMETRES],
};

/// The table: every range that anything is compared with.
pub static TABLE: [&Plausible; 32] = [
    &OPTIMAL_FIBER_LENGTH,
    &TENDON_SLACK_LENGTH,
    &MAX_ISOMETRIC_FORCE,
    &PENNATION_ANGLE,
    &MAX_CONTRACTION_VELOCITY,
    &ACTIVATION_TIME,
    &FIBER_DAMPING,
    &ACTIVATION,
    &MINIMUM_ACTIVATION,
    &DYNAMOMETER_DAMPING,
    &SEGMENT_MASS,
    &POINT_DISTANCE,
    &WRAP_SIZE,
    &JOINT_ANGLE,
    &GYRATION_RADIUS,
    &GRAVITY,
    &BODY_MASS,
    &USUAL_BODY_MASS,
    &BODY_MASS_INDEX,
    &BODY_HEIGHT,
    &SCALE_FACTOR,
    &SEGMENT_LENGTH,
    &MVC_MOMENT,
    &EFFORT_PERCENT,
    &TRIAL_DURATION,
    &TIME_STEP,
    &LENGTH_BOUND,
    &FORCE_BOUND,
    &BELLY_LENGTH,
    &EXTERNAL_TENDON_LENGTH,
    &CROSS_SECTIONAL_AREA,
    &FASCICLE_LENGTH,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_every_row_has_a_range_a_source_and_slips_that_lead_into_it() {
        for row in TABLE {
            let [lower, upper] = row.range;
            assert!(lower < upper && !row.quantity.is_empty() && row.source.len() > 10, "{row:?}");
            for slip in row.slips {
                assert!(slip.factor > 0.0 && slip.factor != 1.0, "{row:?}");
                // A value of the middle of the range, written in that unit, is found out unless it lies inside, too.
                let middle = 0.5 * (lower + upper);
                if let Some(doubt) = row.doubt(middle / slip.factor) {
                    assert!(doubt.slip().is_some(), "{row:?} {slip:?}");
                }
            }
        }
    }

    #[test]
    fn verif_doubts_name_the_likely_slip() {
        let hint = |row: &'static Plausible, value| row.doubt(value).map(|d| (d.to_string(), d.hint()));
        let (what, why) = hint(&OPTIMAL_FIBER_LENGTH, 62.0).unwrap();
        assert_eq!(what, "62 is not plausible in m (expected 0.001 to 0.6)");
        assert_eq!(why, "check the unit: is it in mm? 62 mm are 0.062 m");
        assert_eq!(hint(&OPTIMAL_FIBER_LENGTH, 0.062), None);
        let (what, why) = hint(&OPTIMAL_FIBER_LENGTH, 1e-9).unwrap();
        assert!(what.starts_with("1e-9 is") && why.contains("Ward"), "{what} {why}");
        assert!(hint(&MAX_ISOMETRIC_FORCE, 1e-300).unwrap().0.starts_with("1e-300 is"));
        assert!(hint(&PENNATION_ANGLE, 1.55).unwrap().1.contains("is it in degrees?"));
        assert!(hint(&BODY_MASS_INDEX, 150.0 / (1.75 * 1.75)).unwrap().1.contains("is it in pounds?"));
        assert!(hint(&USUAL_BODY_MASS, 150.0).unwrap().1.contains("150 pounds are 68.04 kg"));
        assert!(hint(&BODY_HEIGHT, 5.9).unwrap().1.contains("5.9 feet are 1.798 m"));
        assert!(hint(&EFFORT_PERCENT, 0.25).unwrap().1.contains("0.25 parts of 1 are 25 %"));
        assert!(hint(&TIME_STEP, 10.0).unwrap().1.contains("is it in ms?"));
        assert!(hint(&TIME_STEP, 1e-14).is_some());
    }
}
