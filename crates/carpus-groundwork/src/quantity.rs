//! Values with units as they are typed: `flexion=30deg`, `flexion=-70:70:1deg`.

use std::fmt;
use std::str::FromStr;

use carpus_osim::osim::spec::MotionType;

/// Unit of a typed value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// `deg`, `°`
    Degree,
    /// `rad`
    Radian,
    /// `m`
    Metre,
    /// `mm`
    Millimetre,
}

impl Unit {
    /// SI units or radians in one of this.
    fn factor(self) -> f64 {
        match self {
            Unit::Degree => std::f64::consts::PI / 180.0,
            Unit::Radian | Unit::Metre => 1.0,
            Unit::Millimetre => 1e-3,
        }
    }

    fn is_angle(self) -> bool {
        matches!(self, Unit::Degree | Unit::Radian)
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Unit::Degree => "deg",
            Unit::Radian => "rad",
            Unit::Metre => "m",
            Unit::Millimetre => "mm",
        })
    }
}

/// A value and its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// The number as typed.
    pub value: f64,
    /// Its unit.
    pub unit: Unit,
}

impl Quantity {
    /// The value [rad or m].
    pub fn si(self) -> f64 {
        self.value * self.unit.factor()
    }

    /// Whether a coordinate of this kind can be given in this unit.
    pub fn suits(self, motion: MotionType) -> bool {
        match motion {
            MotionType::Rotational => self.unit.is_angle(),
            MotionType::Translational => !self.unit.is_angle(),
            MotionType::Coupled => true,
        }
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.value, self.unit)
    }
}

/// A coordinate set to a value: `elbow_flexion=90deg`.
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// Coordinate name.
    pub coordinate: String,
    /// The value.
    pub value: Quantity,
}

impl fmt::Display for Assignment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {}", self.coordinate, self.value)
    }
}

/// A coordinate moved from one value to another: `flexion=-70:70:1deg`.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// Coordinate name.
    pub coordinate: String,
    /// First value.
    pub from: f64,
    /// Last value (reached if the step divides the interval).
    pub to: f64,
    /// Distance between values.
    pub step: f64,
    /// Unit of the three.
    pub unit: Unit,
}

/// Most values in one sweep.
const MAX_SWEEP: f64 = 100_000.0;

impl Sweep {
    /// The values as typed, first to last.
    pub fn values(&self) -> Vec<f64> {
        let count = ((self.to - self.from) / self.step + 1e-9).floor() as usize;
        (0..=count).map(|i| self.from + i as f64 * self.step).collect()
    }

    /// The first value as a quantity.
    pub fn first(&self) -> Quantity {
        Quantity { value: self.from, unit: self.unit }
    }

    /// A value of the sweep [rad or m].
    pub fn si(&self, value: f64) -> f64 {
        Quantity { value, unit: self.unit }.si()
    }
}

impl FromStr for Assignment {
    type Err = String;

    fn from_str(text: &str) -> Result<Assignment, String> {
        let (coordinate, value) = split(text, "elbow_flexion=90deg")?;
        Ok(Assignment { coordinate, value: with_unit(value, None)? })
    }
}

impl FromStr for Sweep {
    type Err = String;

    fn from_str(text: &str) -> Result<Sweep, String> {
        let (coordinate, range) = split(text, "flexion=-70:70:1deg")?;
        let parts: Vec<&str> = range.split(':').collect();
        let [from, to, step] = parts[..] else {
            return Err(format!("expected FROM:TO:STEP and a unit, such as -70:70:1deg, found `{range}`"));
        };
        let step = with_unit(step, None)?;
        let unit = step.unit;
        let same = |part: &str| {
            let quantity = with_unit(part, Some(unit))?;
            if quantity.unit == unit {
                Ok(quantity.value)
            } else {
                Err(format!("`{part}` is in {}, the step in {unit}: use one unit", quantity.unit))
            }
        };
        let sweep = Sweep { coordinate, from: same(from)?, to: same(to)?, step: step.value, unit };
        let steps = (sweep.to - sweep.from) / sweep.step;
        if sweep.step == 0.0 || !steps.is_finite() {
            return Err("the step is zero".to_string());
        }
        if steps < 0.0 {
            return Err(format!("a step of {} leads away from {}: change its sign", sweep.step, sweep.to));
        }
        if steps > MAX_SWEEP {
            let steps = if steps < 1e9 { format!("{steps:.0}") } else { format!("{steps:.0e}") };
            return Err(format!("{steps} values, expected at most {MAX_SWEEP}: use a larger step"));
        }
        Ok(sweep)
    }
}

fn split<'t>(text: &'t str, example: &str) -> Result<(String, &'t str), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
            Ok((name.trim().to_string(), value.trim()))
        }
        _ => Err(format!("expected COORDINATE=VALUE, such as {example}")),
    }
}

/// A number followed by a unit; `default` is the unit of a bare number. A bare 0 is 0 in any unit.
fn with_unit(text: &str, default: Option<Unit>) -> Result<Quantity, String> {
    let text = text.trim();
    let end = text.trim_end_matches(|c: char| c.is_alphabetic() || c == '°').len();
    // `1e` would end in a letter that belongs to no unit; numbers such as 1e3 end in a digit.
    let (number, unit) = text.split_at(end);
    let value: f64 =
        number.trim().parse().map_err(|_| format!("`{text}` is not a number with a unit (deg, rad, m, mm)"))?;
    if !value.is_finite() {
        return Err(format!("`{text}` is not finite"));
    }
    let unit = match (unit, default) {
        ("deg" | "°" | "degrees", _) => Unit::Degree,
        ("rad", _) => Unit::Radian,
        ("m", _) => Unit::Metre,
        ("mm", _) => Unit::Millimetre,
        ("", Some(unit)) => unit,
        ("", None) => return Err(format!("`{text}` has no unit: write {text}deg, {text}rad or {text}m")),
        (other, _) => return Err(format!("unknown unit `{other}`: use deg, rad, m or mm")),
    };
    Ok(Quantity { value, unit })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_assignments() {
        let parsed = |text: &str| text.parse::<Assignment>().map(|a| (a.coordinate.clone(), a.value.si()));
        assert_eq!(parsed("elbow_flexion=90deg"), Ok(("elbow_flexion".into(), std::f64::consts::FRAC_PI_2)));
        assert_eq!(parsed("flexion = -0.5 rad"), Ok(("flexion".into(), -0.5)));
        assert_eq!(parsed("slide=2.5mm"), Ok(("slide".into(), 0.0025)));
        assert_eq!(parsed("a=1e-2m"), Ok(("a".into(), 0.01)));
        for (text, says) in [
            ("flexion", "COORDINATE=VALUE"),
            ("flexion=", "COORDINATE=VALUE"),
            ("flexion=30", "30deg"),
            ("flexion=30grad", "unknown unit `grad`"),
            ("flexion=deg", "not a number"),
            ("flexion=nandeg", "not a number"),
            ("flexion=inf", "not a number"),
        ] {
            let error = text.parse::<Assignment>().unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
    }

    #[test]
    fn verif_sweeps() {
        let sweep: Sweep = "flexion=-70:70:1deg".parse().unwrap();
        let values = sweep.values();
        assert_eq!((values.len(), values[0], values[140]), (141, -70.0, 70.0));
        assert_eq!("a=1:0:-0.25rad".parse::<Sweep>().unwrap().values(), [1.0, 0.75, 0.5, 0.25, 0.0]);
        assert_eq!("a=0:0:1deg".parse::<Sweep>().unwrap().values(), [0.0]);
        assert_eq!("a=0:1:0.3deg".parse::<Sweep>().unwrap().values().len(), 4);
        for (text, says) in [
            ("a=0:1", "FROM:TO:STEP"),
            ("a=0:1:0deg", "step is zero"),
            ("a=0:1:-1deg", "change its sign"),
            ("a=0:1:1e-9deg", "larger step"),
            ("a=0:1rad:1deg", "use one unit"),
            ("a=0:1:1", "no unit"),
        ] {
            let error = text.parse::<Sweep>().unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
    }
}
