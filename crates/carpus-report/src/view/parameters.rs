//! Fitted values, as the report page lists them.

use crate::intervals::with_validity;
use crate::number::{percent, quantity};
use crate::plot;
use crate::results::ParameterResult;

/// Fitted values of one property.
pub struct ParameterGroup {
    pub title: String,
    pub unit: String,
    pub rows: Vec<ParameterRow>,
}

/// A fitted value.
pub struct ParameterRow {
    pub muscle: String,
    pub before: String,
    pub after: String,
    pub change: String,
    pub lower: String,
    pub upper: String,
    pub svg: String,
    pub at_bound: bool,
    pub deviation: String,
    /// The data do not determine the value.
    pub open: bool,
    pub from_data: String,
    pub weak: bool,
}

/// Fitted values of which the data give less than this share are called weakly determined.
const WELL_DETERMINED: f64 = 0.5;

pub fn parameter_groups(parameters: &[ParameterResult]) -> Vec<ParameterGroup> {
    let mut groups: Vec<ParameterGroup> = Vec::new();
    for p in parameters {
        let title = property_title(&p.property);
        let row = ParameterRow {
            muscle: p.muscle.clone(),
            before: quantity(p.before, &p.unit),
            after: quantity(p.after, &p.unit),
            change: if p.before == 0.0 { "–".to_string() } else { signed_percent(p.after / p.before - 1.0) },
            lower: quantity(p.lower, &p.unit),
            upper: quantity(p.upper, &p.unit),
            svg: plot::bounds_bar(
                p.position(p.before),
                p.position(p.after),
                p.interval.as_ref().map(|i| [i.lower, i.upper].map(|end| p.position(end))),
                p.at_bound(),
            ),
            at_bound: p.at_bound(),
            deviation: uncertainty(p),
            open: p.interval.as_ref().is_some_and(|i| !i.is_determined()),
            from_data: p.share_from_data.map(|s| format!("{:.0}\u{202f}%", 100.0 * s)).unwrap_or_default(),
            weak: p.share_from_data.is_some_and(|s| s < WELL_DETERMINED),
        };
        match groups.iter_mut().find(|g| g.title == title) {
            Some(group) => group.rows.push(row),
            None => groups.push(ParameterGroup { title, unit: p.property.clone(), rows: vec![row] }),
        }
    }
    groups
}

/// The interval, ends that are bounds in brackets; else ± a standard deviation.
fn uncertainty(p: &ParameterResult) -> String {
    let Some(interval) = &p.interval else {
        return p.standard_deviation.map(|d| format!("± {}", quantity(d, &p.unit))).unwrap_or_default();
    };
    let end = |value: f64, by_data: bool| {
        let text = quantity(value, &p.unit);
        if by_data { text } else { format!("[{text}]") }
    };
    let [lower, upper] = interval.end_from_data;
    let text = format!("{} to {}", end(interval.lower, lower), end(interval.upper, upper));
    with_validity(text, [interval.lower, interval.upper], p.after)
}

fn signed_percent(fraction: f64) -> String {
    let text = percent(fraction);
    if fraction > 0.0 { format!("+{text}") } else { text }
}

/// `optimal_fiber_length` → `Optimal fiber length`.
fn property_title(property: &str) -> String {
    let words = property.replace('_', " ");
    match words.chars().next() {
        Some(first) => first.to_uppercase().collect::<String>() + &words[first.len_utf8()..],
        None => words,
    }
}
