//! Words of the files: numbers, units of length, extensions of names.

use std::path::Path;

/// Lower-case extension of a file's name.
pub(super) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// A number as C and C++ write it, missing values among them.
pub(super) fn number(word: &str) -> Option<f64> {
    if let Ok(value) = word.parse() {
        return Some(value);
    }
    let lower = word.to_ascii_lowercase();
    match lower.trim_start_matches(['-', '+']) {
        text if text.starts_with("nan")
            || text.contains("#ind")
            || text.contains("#qnan")
            || text.contains("#snan") =>
        {
            Some(f64::NAN)
        }
        text if text.contains("#inf") => Some(if lower.starts_with('-') { f64::NEG_INFINITY } else { f64::INFINITY }),
        _ => None,
    }
}

/// Metres of a unit of length.
pub(super) fn metres(unit: &str) -> Option<f64> {
    match unit.trim().to_lowercase().as_str() {
        "m" | "meters" | "meter" | "metres" => Some(1.0),
        "cm" | "centimeters" => Some(0.01),
        "mm" | "millimeters" => Some(0.001),
        _ => None,
    }
}
