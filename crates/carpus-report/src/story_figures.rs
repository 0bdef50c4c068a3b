//! Figures of the story page: the fall of the error, intervals within plausible ranges, separability.

use std::fmt::Write;

use super::number::percent;
use super::plot::{Scale, escape, tick_label, ticks};

/// A step of the waterfall.
#[derive(Clone)]
pub struct WaterfallStep {
    pub label: String,
    pub train: f64,
    pub held_out: Option<f64>,
    pub current: bool,
}

const WIDTH: f64 = 860.0;
const LABEL: f64 = 230.0;
const RIGHT: f64 = 70.0;
const ROW: f64 = 50.0;
/// Height of a line of a label, and letters that fit into one.
const LINE: f64 = 16.0;
const LETTERS: usize = 28;

/// The error after every step, training above held out, with the noise floor as a line.
pub fn waterfall(steps: &[WaterfallStep], floor: Option<f64>) -> String {
    let errors = steps.iter().flat_map(|s| std::iter::once(s.train).chain(s.held_out));
    let max = errors.chain(floor).fold(1e-6, f64::max) * 1.02;
    let x = Scale { data: [0.0, max], drawn: [LABEL, WIDTH - RIGHT] };
    let height = 30.0 + ROW * steps.len() as f64 + 26.0;
    let bottom = height - 26.0;
    let mut w = format!(
        r#"<svg class="waterfall" viewBox="0 0 {WIDTH} {height}" role="img" aria-label="Error after every step">"#
    );
    let marks = ticks(0.0, max, 5);
    let step = marks.windows(2).map(|t| t[1] - t[0]).next().unwrap_or(1.0);
    for value in &marks {
        let at = x.at(*value);
        let label = tick_label(100.0 * value, 100.0 * step);
        let _ = write!(w, r#"<line class="grid" x1="{at:.1}" x2="{at:.1}" y1="22" y2="{bottom}"/>"#);
        let _ = write!(
            w,
            r#"<text class="tick" text-anchor="middle" x="{at:.1}" y="{}">{label}{}</text>"#,
            bottom + 16.0,
            "\u{202f}%"
        );
    }
    for (i, one) in steps.iter().enumerate() {
        let top = 30.0 + ROW * i as f64;
        let class = if one.current { "step current" } else { "step" };
        let lines = lines(&one.label);
        let first = top + 22.0 - 0.5 * LINE * (lines.len() - 1) as f64;
        for (k, line) in lines.iter().enumerate() {
            let y = first + LINE * k as f64;
            let _ = write!(w, r#"<text class="{class}" x="0" y="{y}">{}</text>"#, escape(line));
        }
        let mut bar = |value: f64, before: Option<f64>, y: f64, class: &str| {
            // What fell since the step before stays visible as a ghost.
            if let Some(before) = before.filter(|b| *b > value) {
                let (from, to) = (x.at(value), x.at(before));
                let _ = write!(
                    w,
                    r#"<rect class="ghost {class}" x="{from:.1}" y="{y}" width="{:.1}" height="15"/>"#,
                    to - from
                );
            }
            let _ = write!(
                w,
                r#"<rect class="fill {class}" x="{:.1}" y="{y}" width="{:.1}" height="15" rx="2"/>"#,
                x.at(0.0),
                (x.at(value) - x.at(0.0)).max(0.5)
            );
            let at = x.at(before.map_or(value, |b| b.max(value))) + 6.0;
            let _ = write!(w, r#"<text class="value" x="{at:.1}" y="{}">{}</text>"#, y + 12.0, percent(value));
        };
        let before = i.checked_sub(1).map(|i| &steps[i]);
        bar(one.train, before.map(|b| b.train), top + 1.0, "train");
        if let Some(held_out) = one.held_out {
            bar(held_out, before.and_then(|b| b.held_out), top + 19.0, "held");
        }
    }
    if let Some(floor) = floor {
        let at = x.at(floor);
        let _ = write!(w, r#"<line class="floor" x1="{at:.1}" x2="{at:.1}" y1="18" y2="{bottom}"/>"#);
        let _ = write!(
            w,
            r#"<text class="floor-text" text-anchor="middle" x="{at:.1}" y="12">noise floor {}</text>"#,
            percent(floor)
        );
    }
    w.push_str("</svg>");
    w
}

/// A step's label in lines that fit: every effect of several on its own, long names at blanks.
fn lines(label: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for (i, part) in label.trim_start_matches("+ ").split(" + ").enumerate() {
        let lead = if i > 0 || label.starts_with("+ ") { "+ " } else { "" };
        lines.push(lead.to_string());
        for (k, word) in part.split(' ').enumerate() {
            let last = lines.len() - 1;
            if k > 0 && lines[last].chars().count() + 1 + word.chars().count() > LETTERS {
                lines.push(word.to_string());
                continue;
            }
            if k > 0 {
                lines[last].push(' ');
            }
            lines[last].push_str(word);
        }
    }
    lines
}

/// Styles of a figure that stands alone, in light and dark.
const ALONE: &str = "text{font:13px system-ui,sans-serif;fill:#1b1f24}.tick,.value{font-size:12px;fill:#5c6670}\
                     .current{font-weight:650}.grid{stroke:#e2e5e8}.train{fill:#8a949e}.held{fill:#6b4fb3}\
                     .ghost{opacity:.18}.floor{stroke:#1a7f4b;stroke-width:1.5;stroke-dasharray:4 3}\
                     .floor-text{fill:#1a7f4b;font-size:12px}\
                     @media(prefers-color-scheme:dark){text{fill:#e8ebee}.tick,.value{fill:#a5aeb7}\
                     .grid{stroke:#2e343a}.train{fill:#78828c}.held{fill:#b9a5f2}.floor{stroke:#58c48d}\
                     .floor-text{fill:#58c48d}}";

/// A figure of a page as a file of its own, with what its bars mean.
pub fn standing_alone(svg: &str) -> String {
    let legend = concat!(
        r#"<rect class="train" x="0" y="4" width="14" height="10"/>"#,
        r#"<text class="tick" x="19" y="13">training trials</text>"#,
        r#"<rect class="held" x="112" y="4" width="14" height="10"/>"#,
        r#"<text class="tick" x="131" y="13">held-out trials</text>"#
    );
    let styled = svg.replacen("<svg ", r#"<svg xmlns="http://www.w3.org/2000/svg" "#, 1);
    match styled.split_once('>') {
        Some((open, rest)) => format!("{open}><style>{ALONE}</style>{legend}{rest}\n"),
        None => styled,
    }
}

/// An estimate and its interval over the plausible range.
pub fn interval(value: f64, ci: [f64; 2], plausible: [f64; 2]) -> String {
    let (width, height) = (280.0, 22.0);
    let low = plausible[0].min(ci[0]).min(value);
    let high = plausible[1].max(ci[1]).max(value);
    let margin = 0.04 * (high - low).max(1e-12);
    let x = Scale { data: [low - margin, high + margin], drawn: [4.0, width - 4.0] };
    let inside = ci[1] >= plausible[0] && ci[0] <= plausible[1];
    let class = if inside { "" } else { " bound" };
    format!(
        concat!(
            r#"<svg class="row" viewBox="0 0 {w} {h}" aria-hidden="true">"#,
            r#"<rect class="plausible" x="{a:.1}" y="4" width="{pw:.1}" height="14" rx="3"/>"#,
            r#"<line class="link fell" x1="{c:.1}" x2="{d:.1}" y1="11" y2="11"/>"#,
            r#"<circle class="dot after{class}" cx="{v:.1}" cy="11" r="5"/></svg>"#
        ),
        w = width,
        h = height,
        a = x.at(plausible[0]),
        pw = x.at(plausible[1]) - x.at(plausible[0]),
        c = x.at(ci[0]),
        d = x.at(ci[1]),
        v = x.at(value),
        class = class
    )
}

/// A share of the error with its interval.
///
/// - `share`: value, ends of the interval; `most`: end of the axis
pub fn share_bar([value, low, high]: [f64; 3], most: f64) -> String {
    let (width, height) = (280.0, 22.0);
    let x = Scale { data: [0.0, most.max(1e-6)], drawn: [4.0, width - 4.0] };
    let at = |v: f64| x.at(v.clamp(0.0, most));
    format!(
        concat!(
            r#"<svg class="row" viewBox="0 0 {w} {h}" aria-hidden="true">"#,
            r#"<rect class="plausible" x="{o:.1}" y="4" width="{pw:.1}" height="14" rx="3"/>"#,
            r#"<line class="link fell" x1="{c:.1}" x2="{d:.1}" y1="11" y2="11"/>"#,
            r#"<circle class="dot after" cx="{v:.1}" cy="11" r="5"/></svg>"#
        ),
        w = width,
        h = height,
        o = at(0.0),
        pw = at(most) - at(0.0),
        c = at(low),
        d = at(high),
        v = at(value)
    )
}

/// How far apart two explanations are, now and with an experiment; the line is where they count as told apart.
pub fn separation(now: f64, then: Option<f64>, enough: f64, most: f64) -> String {
    let (width, height) = (280.0, 22.0);
    // A logarithmic axis: from 0.3 to the largest z.
    let place = |z: f64| (z.max(0.3) / 0.3).ln();
    let x = Scale { data: [0.0, place(most.max(2.0 * enough))], drawn: [6.0, width - 6.0] };
    let line = x.at(place(enough));
    let mut w = format!(r#"<svg class="row" viewBox="0 0 {width} {height}" aria-hidden="true">"#);
    let _ = write!(w, r#"<line class="track" x1="6" x2="{}" y1="11" y2="11"/>"#, width - 6.0);
    let _ = write!(w, r#"<line class="enough" x1="{line:.1}" x2="{line:.1}" y1="1" y2="21"/>"#);
    let a = x.at(place(now));
    if let Some(then) = then {
        let b = x.at(place(then));
        let _ = write!(w, r#"<line class="link fell" x1="{a:.1}" x2="{b:.1}" y1="11" y2="11"/>"#);
        let _ = write!(w, r#"<circle class="dot after" cx="{b:.1}" cy="11" r="5"/>"#);
    }
    let _ = write!(w, r#"<circle class="dot before" cx="{a:.1}" cy="11" r="4.5"/></svg>"#);
    w
}

/// A probability on a logarithmic axis from 0.0001 to 1, with the level below which effects are ruled out; filled where
/// one is named.
pub fn probability_bar(p: f64, level: f64, survives: bool) -> String {
    let (width, height) = (160.0, 22.0);
    let place = |p: f64| (p.clamp(1e-4, 1.0).ln() - 1e-4_f64.ln()) / -1e-4_f64.ln();
    let x = Scale { data: [0.0, 1.0], drawn: [6.0, width - 6.0] };
    let (at, line) = (x.at(place(p)), x.at(place(level)));
    let class = if survives { "dot after" } else { "dot gone" };
    format!(
        concat!(
            r#"<svg class="row narrow" viewBox="0 0 {w} {h}" aria-hidden="true">"#,
            r#"<line class="track" x1="6" x2="{r}" y1="11" y2="11"/>"#,
            r#"<line class="enough" x1="{line:.1}" x2="{line:.1}" y1="1" y2="21"/>"#,
            r#"<circle class="{class}" cx="{at:.1}" cy="11" r="5"/></svg>"#
        ),
        w = width,
        h = height,
        r = width - 6.0,
        line = line,
        class = class,
        at = at
    )
}

#[cfg(test)]
mod tests {
    use super::lines;

    #[test]
    fn verif_labels_are_broken_where_they_would_run_into_the_bars() {
        assert_eq!(lines("Muscles refitted"), ["Muscles refitted"]);
        assert_eq!(lines("+ Nonlinear EMG + Weight of the hand"), ["+ Nonlinear EMG", "+ Weight of the hand"]);
        let long = lines("+ Optimal fibre length that depends on activation");
        assert_eq!(long, ["+ Optimal fibre length that", "depends on activation"]);
    }
}
