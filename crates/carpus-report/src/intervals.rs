//! Intervals one below the other, as SVG text.

use std::fmt::Write;

use super::plot::{Scale, escape, extent, tick_label, ticks};

/// Said of an interval that does not hold its own estimate: the two come of fits that disagree, so that the interval
/// does not say how far off the estimate may be.
pub const NOT_VALID: &str = "not valid: does not hold the estimate";

/// Whether an interval holds its estimate. Files round both, to seven digits or more.
pub fn holds(interval: [f64; 2], estimate: f64) -> bool {
    /// A unit of the seventh digit.
    const ROUNDING: f64 = 1e-6;
    let [low, high] = interval;
    let slack = ROUNDING * estimate.abs();
    low - slack <= estimate && estimate <= high + slack
}

/// The text of an interval, and that it is not valid where it does not hold its estimate.
pub fn with_validity(text: String, interval: [f64; 2], estimate: f64) -> String {
    if holds(interval, estimate) { text } else { format!("{text} ({NOT_VALID})") }
}

/// A value with its interval.
#[derive(Clone, Debug)]
pub struct IntervalRow {
    /// Whose it is.
    pub label: String,
    /// The value.
    pub value: f64,
    /// Its interval.
    pub interval: [f64; 2],
    /// Whether each end is set by data; the others end at a bound and are drawn open.
    pub ends: [bool; 2],
}

/// Intervals of one quantity, a row each, with a line at 1: factors of a model's value.
pub fn intervals(description: &str, rows: &[IntervalRow]) -> String {
    intervals_about(1.0, description, rows)
}

/// Intervals of one quantity, a row each.
///
/// - `line`: value at which a line is drawn
pub fn intervals_about(line: f64, description: &str, rows: &[IntervalRow]) -> String {
    const ROW: f64 = 15.0;
    // Width of a letter, of what is drawn beside the labels, of the labels at least.
    const LETTER: f64 = 6.0;
    const DRAWN: f64 = 256.0;
    const LABELS: f64 = 44.0;
    let longest = rows.iter().map(|r| r.label.chars().count()).max().unwrap_or(0);
    let left = LABELS.max(LETTER * longest as f64 + 4.0);
    let (width, right, top) = (left + DRAWN, 8.0, 6.0);
    let bottom = top + ROW * rows.len() as f64;
    let height = bottom + 20.0;
    let all = rows.iter().flat_map(|r| [r.interval[0], r.interval[1], r.value]).chain([line]);
    let x = Scale { data: extent(all).unwrap_or([0.0, 2.0]), drawn: [left + 4.0, width - right] };
    let mut w = format!(
        r#"<svg class="figure" viewBox="0 0 {width} {height}" role="img" aria-label="{}">"#,
        escape(description)
    );
    let marks = ticks(x.data[0], x.data[1], 4);
    let step = marks.windows(2).map(|t| t[1] - t[0]).next().unwrap_or(1.0);
    for value in marks {
        let at = x.at(value);
        let _ = write!(w, r#"<line class="grid" x1="{at:.1}" x2="{at:.1}" y1="{top}" y2="{bottom}"/>"#);
        let text = tick_label(value, step);
        let _ =
            write!(w, r#"<text class="tick" text-anchor="middle" x="{at:.1}" y="{:.1}">{text}</text>"#, bottom + 14.0);
    }
    let one = x.at(line);
    let _ = write!(w, r#"<line class="zero" x1="{one:.1}" x2="{one:.1}" y1="{top}" y2="{bottom}"/>"#);
    for (i, row) in rows.iter().enumerate() {
        let y = top + ROW * (i as f64 + 0.5);
        let [a, b] = row.interval.map(|v| x.at(v));
        let label = escape(&row.label);
        let _ = write!(w, r#"<text class="tick y" x="{:.1}" y="{:.1}">{label}</text>"#, left - 4.0, y + 3.5);
        let class = if row.ends == [true, true] && holds(row.interval, row.value) { "link fell" } else { "link rose" };
        let text = format!("{:.3} to {:.3}", row.interval[0], row.interval[1]);
        let title = format!("{label}: {:.3} ({})", row.value, with_validity(text, row.interval, row.value));
        let _ = write!(
            w,
            r#"<line class="{class}" x1="{a:.1}" x2="{b:.1}" y1="{y:.1}" y2="{y:.1}"><title>{title}</title></line>"#
        );
        let _ = write!(w, r#"<circle class="dot after" cx="{:.1}" cy="{y:.1}" r="3"/>"#, x.at(row.value));
    }
    w.push_str("</svg>");
    w
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_an_interval_that_does_not_hold_its_estimate_is_said_to_be_not_valid() {
        assert!(holds([517.0, 722.0], 517.0) && holds([517.0, 722.0], 722.000_01) && !holds([517.0, 722.0], 412.0));
        assert!(holds([-2.0, -1.0], -1.0) && !holds([-2.0, -1.0], 0.0) && !holds([0.1, 0.2], f64::NAN));
        assert_eq!(with_validity("1 to 2".into(), [1.0, 2.0], 1.5), "1 to 2");
        assert!(with_validity("1 to 2".into(), [1.0, 2.0], 3.0).contains(NOT_VALID));
        let row = IntervalRow { label: "a".into(), value: 0.8, interval: [0.9, 1.1], ends: [true, true] };
        let svg = intervals("d", &[row]);
        assert!(svg.contains("link rose") && svg.contains(NOT_VALID), "{svg}");
    }

    #[test]
    fn verif_every_interval_is_drawn_where_it_is() {
        let row = |ends| IntervalRow { label: "P<1".into(), value: 1.0, interval: [0.9, 1.1], ends };
        let svg = intervals("d", &[row([true, true]), row([true, false])]);
        assert_eq!(svg.matches("<circle").count(), 2);
        assert_eq!((svg.matches("link fell").count(), svg.matches("link rose").count()), (1, 1));
        assert!(svg.contains(r#"x1="48.0" x2="292.0""#), "{svg}");
        assert!(svg.contains("P&lt;1") && !svg.contains("P<1"));
        let long =
            IntervalRow { label: "FCU max_isometric_force".into(), value: 1.0, interval: [0.9, 1.1], ends: [true; 2] };
        let svg = intervals("d", &[long]);
        assert!(svg.contains(r#"viewBox="0 0 398 "#) && svg.contains(r#"x="138.0""#), "{svg}");
    }
}
