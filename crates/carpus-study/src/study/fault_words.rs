//! Numbers, units and lists in the words of a fault.

use carpus_numerics::plausible::{Measured, NamedUnit};
use carpus_numerics::signals::Resampled;

/// Coordinate values beside the range that one of them leaves, as people read them: with as many decimals as tell the
/// value from the ends, at least two of degrees and four of metres.
///
/// - `value`, `range`: [rad or m]
pub(crate) fn value_and_range(value: f64, range: [f64; 2], is_translation: bool) -> (String, [String; 2]) {
    /// Decimals beyond which two numbers of this size do not differ.
    const MOST: usize = 13;
    /// Angles and lengths from here on are no row of digits [rad or m].
    const ABSURD: f64 = 1e9;
    let show = |v: f64, decimals: usize| {
        let (shown, unit) = if is_translation { (v, " m") } else { (v.to_degrees(), "°") };
        if v.abs() >= ABSURD { format!("{shown:.3e}{unit}") } else { format!("{shown:.decimals$}{unit}") }
    };
    let least = if is_translation { 4 } else { 2 };
    let differs =
        |decimals: &usize| range.iter().all(|end| *end == value || show(*end, *decimals) != show(value, *decimals));
    let decimals = (least..MOST).find(differs).unwrap_or(MOST);
    (show(value, decimals), range.map(|end| show(end, decimals)))
}

/// A value and the range that it leaves, in words.
///
/// - `value`, `range`: [rad or m]
pub fn outside_range(value: f64, range: [f64; 2], is_translation: bool) -> String {
    let (value, [lower, upper]) = value_and_range(value, range, is_translation);
    format!("{value}, outside its range of {lower} to {upper}")
}

/// The range of recorded angles or positions, and the farthest of them.
pub(super) fn farthest(extreme: f64, range: [f64; 2], is_translation: bool) -> String {
    let (extreme, [lower, upper]) = value_and_range(extreme, range, is_translation);
    format!("{lower} to {upper}; farthest: {extreme}")
}

pub(super) fn known_list(title: &str, known: &[String]) -> String {
    if known.is_empty() { String::new() } else { format!(" ({title}: {})", known.join(", ")) }
}

pub(super) fn list_or_none(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

pub(super) fn quoted(text: &str) -> String {
    if text.is_empty() {
        return "an empty cell".to_owned();
    }
    let short: String = text.chars().take(40).collect();
    if short.len() < text.len() { format!("`{short}…`") } else { format!("`{short}`") }
}

/// What was done to a signal before it stood at so many samples a second, and how many of them are its own.
pub(super) fn how_resampled(how: Resampled, own_rate_hz: f64, rate_hz: f64) -> String {
    let done = match how {
        Resampled::Held => "held",
        Resampled::Interpolated => "interpolated",
        Resampled::Smoothed => {
            // Independent samples are twice as many a second as the highest frequency.
            let cutoff_hz = own_rate_hz / 2.0;
            return format!(
                "has no noise above about {cutoff_hz:.0} Hz at {rate_hz:.0} Hz: it was low-passed, or interpolated by \
                 smooth curves; about {own_rate_hz:.0} of its samples a second are independent"
            );
        }
    };
    format!("was {done} to {rate_hz:.0} Hz: {own_rate_hz:.0} of its samples a second are its own")
}

/// What a unit measures, where that is not what the column holds.
pub(super) fn other_quantity(unit: &NamedUnit, holds: Measured) -> String {
    if unit.of == holds { String::new() } else { format!(", {}", unit.of.words()) }
}

/// A conversion factor with the digits that tables give; those of angles with fewer.
pub(super) fn seven_digits(number: f64) -> f64 {
    if number.fract() == 0.0 || number < 0.1 {
        four_digits(number)
    } else {
        format!("{number:.6}").parse().unwrap_or(number)
    }
}

/// A number to four significant digits.
pub(super) fn four_digits(number: f64) -> f64 {
    format!("{number:.3e}").parse().unwrap_or(number)
}

/// The unit of time in which a recorder's step of this size is usual, 10 µs to 100 ms; `None` if that is seconds, or no
/// unit.
///
/// - `step`: median step in that unit
pub(super) fn time_unit(step: f64) -> Option<&'static str> {
    let usual = 1e-5..=0.1;
    let units =
        [("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9), ("minutes", 60.0), ("hours", 3600.0)];
    let unit = units.into_iter().find(|(_, seconds)| usual.contains(&(step * seconds))).map(|(unit, _)| unit);
    unit.filter(|_| !usual.contains(&step))
}

pub(super) fn others(more: usize) -> String {
    match more {
        0 => String::new(),
        n => format!(" (and {n} more)"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_value_outside_a_range_shows_what_tells_it_from_the_ends() {
        let of_degrees = |value: f64| outside_range(value.to_radians(), [-90.0, 180.0].map(f64::to_radians), false);
        assert_eq!(of_degrees(200.0), "200.00°, outside its range of -90.00° to 180.00°");
        assert_eq!(of_degrees(1e308), "1.000e308°, outside its range of -90.00° to 180.00°");
        assert_eq!(of_degrees(180.0004), "180.0004°, outside its range of -90.0000° to 180.0000°");
        assert_eq!(outside_range(0.12001, [0.0, 0.12], true), "0.12001 m, outside its range of 0.00000 m to 0.12000 m");
    }
}
