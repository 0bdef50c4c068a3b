//! Numbers as people read them: significant digits, units, a true minus sign.

/// A thin space that does not break, between a number and its unit.
const THIN_SPACE: char = '\u{202f}';

/// The value with `digits` significant digits, without exponent where it stays readable.
pub fn significant(value: f64, digits: i32) -> String {
    if !value.is_finite() {
        return "–".to_string();
    }
    if value == 0.0 {
        return "0".to_string();
    }
    let rounded = super::results::rounded(value, digits);
    let magnitude = rounded.abs().log10().floor() as i32;
    let text = if (-4..=6).contains(&magnitude) {
        format!("{rounded:.*}", (digits - 1 - magnitude).max(0) as usize)
    } else {
        format!("{rounded:.*e}", (digits - 1).max(0) as usize)
    };
    text.replace('-', "−")
}

/// The value as a label: at most three significant digits, without trailing zeros.
pub fn plain(value: f64) -> String {
    let text = significant(value, 3);
    if text.contains('.') && !text.contains('e') {
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    } else {
        text
    }
}

/// A fraction in percent with one decimal.
pub fn percent(fraction: f64) -> String {
    if !fraction.is_finite() {
        return "–".to_string();
    }
    format!("{:.1}{THIN_SPACE}%", 100.0 * fraction).replace('-', "−")
}

/// The value with three significant digits and its unit; lengths in millimetres, angles in degrees.
pub fn quantity(value: f64, unit: &str) -> String {
    let (value, unit) = for_display(value, unit);
    if unit.is_empty() { significant(value, 3) } else { format!("{}{THIN_SPACE}{unit}", significant(value, 3)) }
}

/// A value in SI units in the unit that people use for it.
fn for_display(value: f64, unit: &str) -> (f64, &str) {
    match unit {
        "m" => (1e3 * value, "mm"),
        "rad" => (value.to_degrees(), "°"),
        other => (value, other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_significant_digits() {
        assert_eq!(significant(0.0, 3), "0");
        assert_eq!(significant(1234.5, 3), "1230");
        assert_eq!(significant(12.345, 3), "12.3");
        assert_eq!(significant(-0.012345, 3), "−0.0123");
        assert_eq!(significant(0.99996, 3), "1.00");
        assert_eq!(significant(1.5e-9, 2), "1.5e−9");
        assert_eq!(significant(f64::NAN, 3), "–");
        assert_eq!([plain(25.0), plain(12.5), plain(-30.0), plain(0.25)], ["25", "12.5", "−30", "0.25"]);
    }

    #[test]
    fn verif_units_for_people() {
        assert_eq!(quantity(0.0624, "m"), "62.4\u{202f}mm");
        assert_eq!(quantity(std::f64::consts::FRAC_PI_6, "rad"), "30.0\u{202f}°");
        assert_eq!(quantity(407.4, "N"), "407\u{202f}N");
        assert_eq!(percent(0.0786), "7.9\u{202f}%");
    }
}
