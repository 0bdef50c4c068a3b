//! Rows of analyses of variance: for people, and for CSV.

use super::account::{digits, fixed};
use carpus_numerics::statistics::Effect;
use carpus_report::article::p_text;

/// Header of [`effect_cells`].
pub const EFFECT_HEADER: [&str; 6] = ["F", "df", "p", "p (Mauchly)", "ε (Greenhouse–Geisser)", "p corrected"];
/// Header of [`effect_columns`].
pub const EFFECT_COLUMNS: [&str; 9] = [
    "f",
    "df_effect",
    "df_error",
    "p",
    "mauchly_w",
    "p_mauchly",
    "greenhouse_geisser_epsilon",
    "p_greenhouse_geisser",
    "partial_eta_squared",
];

/// An effect as people read it.
///
/// - `decimals`: of F
pub fn effect_cells(e: &Effect, decimals: usize) -> [String; 6] {
    [
        fixed(e.f, decimals),
        format!("{}, {}", e.df_effect, e.df_error),
        p_text(e.p_value),
        e.sphericity.p_value.map_or("–".to_string(), p_text),
        fixed(e.sphericity.greenhouse_geisser, 3),
        p_text(e.p_greenhouse_geisser),
    ]
}

/// An effect with all digits.
pub fn effect_columns(e: &Effect) -> Vec<String> {
    let mut row = vec![digits(e.f), e.df_effect.to_string(), e.df_error.to_string(), digits(e.p_value)];
    row.push(e.sphericity.mauchly_w.map(digits).unwrap_or_default());
    row.push(e.sphericity.p_value.map(digits).unwrap_or_default());
    row.extend([e.sphericity.greenhouse_geisser, e.p_greenhouse_geisser, e.partial_eta_squared].map(digits));
    row
}
