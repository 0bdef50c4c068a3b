//! Moment over angle, a figure per condition: what was measured, and what models make of it.

use std::ops::Range;

use super::plot::{self, Curve, CurveFigure};
use super::results::TrialResult;

/// Parts of the range of a movement; the moment is averaged over each.
const PARTS: usize = 12;
/// Trials whose joint is held at angles that differ by less are of one angle [deg].
const SAME_ANGLE_DEG: f64 = 3.0;
/// A held contraction is judged where the measured moment has at least this share of its largest.
const PLATEAU: f64 = 0.8;
/// Share of the range from which on a joint has left an angle.
const REST_SHARE: f64 = 0.02;
/// A joint that turns less than this is held [deg].
const HELD_DEG: f64 = 4.0;

/// A figure and what stands above it.
pub struct AnglePanel {
    pub title: String,
    pub note: String,
    pub svg: String,
}

/// Samples around one angle.
#[derive(Default)]
struct Part {
    angle: Vec<f64>,
    /// Of every trial that has samples here: measured moments.
    measured: Vec<Vec<f64>>,
    before: Vec<f64>,
    after: Vec<f64>,
}

/// The figures of all conditions that were recorded at several angles.
///
/// - `before`, `after`: ids of the models
/// - `title`: of the trials that are drawn together: those with one title
pub fn panels(
    trials: &[TrialResult],
    before: Option<&str>,
    after: &str,
    title: impl Fn(&TrialResult) -> String,
) -> Vec<AnglePanel> {
    let mut titles: Vec<String> = Vec::new();
    for title in trials.iter().filter(|t| t.condition.contraction != "mvc").map(&title) {
        if !titles.contains(&title) {
            titles.push(title);
        }
    }
    let of = |name: String| {
        let own: Vec<&TrialResult> = trials.iter().filter(|t| title(t) == name).collect();
        panel(name, &own, before, after)
    };
    titles.into_iter().filter_map(of).collect()
}

fn panel(title: String, trials: &[&TrialResult], before: Option<&str>, after: &str) -> Option<AnglePanel> {
    let spans = trials.iter().map(|t| plot::extent(t.series.angle_deg.iter().copied()));
    let is_held = spans.clone().flatten().all(|[low, high]| high - low < HELD_DEG);
    let whole = plot::extent(spans.flatten().flatten())?;
    let mut parts: Vec<Part> = if is_held { Vec::new() } else { (0..PARTS).map(|_| Part::default()).collect() };
    for trial in trials {
        let s = &trial.series;
        let largest = s.measured_n_m.iter().fold(0.0_f64, |most, m| most.max(m.abs()));
        let simulated = |id: &str| s.simulated_n_m.get(id).map_or(&[][..], Vec::as_slice);
        let (old, new) = (before.map(simulated).unwrap_or_default(), simulated(after));
        let held_at = s.angle_deg.iter().sum::<f64>() / s.angle_deg.len().max(1) as f64;
        let of_angle = |angle: f64, parts: &mut Vec<Part>| {
            if !is_held {
                return (((angle - whole[0]) / (whole[1] - whole[0]) * PARTS as f64) as usize).min(PARTS - 1);
            }
            let near = |p: &Part| p.angle.first().is_some_and(|a| (a - held_at).abs() < SAME_ANGLE_DEG);
            parts.iter().position(near).unwrap_or_else(|| {
                parts.push(Part::default());
                parts.len() - 1
            })
        };
        let mut measured: Vec<(usize, f64)> = Vec::new();
        let count = s.angle_deg.len().min(s.measured_n_m.len());
        let drawn = if is_held { 0..count } else { moving(&s.angle_deg[..count], REST_SHARE * (whole[1] - whole[0])) };
        for k in drawn {
            if is_held && s.measured_n_m[k].abs() < PLATEAU * largest {
                continue;
            }
            let at = of_angle(s.angle_deg[k], &mut parts);
            parts[at].angle.push(s.angle_deg[k]);
            parts[at].before.extend(old.get(k));
            parts[at].after.extend(new.get(k));
            measured.push((at, s.measured_n_m[k]));
        }
        for (at, part) in parts.iter_mut().enumerate() {
            let own: Vec<f64> = measured.iter().filter(|(i, _)| *i == at).map(|(_, m)| *m).collect();
            part.measured.extend((!own.is_empty()).then_some(own));
        }
    }
    parts.retain(|p| !p.angle.is_empty() && !p.after.is_empty());
    parts.sort_by(|a, b| mean(&a.angle).total_cmp(&mean(&b.angle)));
    if parts.len() < 2 {
        return None;
    }
    let note = match is_held {
        true => "held contractions, mean of the plateau".to_owned(),
        false => format!("{} {}", trials.len(), if trials.len() == 1 { "trial" } else { "trials" }),
    };
    Some(AnglePanel { svg: figure(&title, &parts, before.is_some())?, title, note })
}

/// Samples between the first departure from the first angle and the last arrival at the last one: before and after, the
/// effort rises and falls at rest.
fn moving(angle: &[f64], far: f64) -> Range<usize> {
    let (Some(first), Some(last)) = (angle.first(), angle.last()) else { return 0..0 };
    let begin = angle.iter().position(|a| (a - first).abs() > far).unwrap_or(0);
    let end = angle.iter().rposition(|a| (a - last).abs() > far).map_or(angle.len(), |i| i + 1);
    if begin < end { begin..end } else { 0..angle.len() }
}

fn figure(title: &str, parts: &[Part], has_before: bool) -> Option<String> {
    let x: Vec<f64> = parts.iter().map(|p| mean(&p.angle)).collect();
    let of_trials = |p: &Part| p.measured.iter().map(|own| mean(own)).collect::<Vec<f64>>();
    let measured: Vec<f64> = parts.iter().map(|p| mean(&of_trials(p))).collect();
    let points: Vec<[f64; 2]> =
        parts.iter().zip(&x).flat_map(|(p, x)| of_trials(p).into_iter().map(|m| [*x, m])).collect();
    let (old, new): (Vec<f64>, Vec<f64>) = parts.iter().map(|p| (mean(&p.before), mean(&p.after))).unzip();
    let band: Vec<[f64; 2]> = parts.iter().filter_map(|p| plot::extent(p.after.iter().copied())).collect();
    let mut curves = vec![Curve { class: "measured thin".to_owned(), name: "measured".to_owned(), values: &measured }];
    if has_before {
        curves.push(Curve { class: "before".to_owned(), name: "before".to_owned(), values: &old });
    }
    curves.push(Curve { class: "after".to_owned(), name: "model".to_owned(), values: &new });
    let drawn = points.iter().map(|p| p[1]).chain(band.iter().flatten().copied());
    let drawn = drawn.chain(old.iter().copied().filter(|_| has_before));
    let figure = CurveFigure {
        description: format!("Measured and simulated moment over angle, {title}"),
        x: &x,
        x_name: ("at", "°"),
        unit: "N·m",
        curves,
        x_range: plot::padded(plot::extent(x.iter().copied())?, 0.04),
        y_range: plot::padded(plot::extent(drawn)?, 0.08),
        strip: None,
        size: [320.0, 190.0],
        ticks: [5, 4],
    };
    Some(figure.svg_with_points(&[("after", band)], &points))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
