//! Residuals along axes as small figures, before and after.

use super::diagnosis::AxisTest;
use super::number::significant;
use super::plot::{self, Curve, CurveFigure};
use super::residuals::{AxisCurve, ResidualResult};

/// The residual along one axis.
pub struct AxisPanel {
    pub title: String,
    pub unit: String,
    pub svg: String,
    pub share_before: String,
    pub share: String,
    /// p-value of the score test along this axis, if there was one.
    pub p_value: String,
}

/// The name of an axis as people read it.
pub fn axis_name(axis: &str) -> String {
    match axis {
        "angle" => "Angle".to_owned(),
        "velocity" => "Velocity".to_owned(),
        "acceleration" => "Acceleration".to_owned(),
        "time_in_trial" => "Time in the trial".to_owned(),
        "session" => "Time in the session".to_owned(),
        "effort" => "Effort".to_owned(),
        "flexor_activation" => "Activation, flexors".to_owned(),
        "extensor_activation" => "Activation, extensors".to_owned(),
        "history" => "Movement just before".to_owned(),
        other => match other.strip_prefix("muscle:") {
            Some(muscle) => format!("Activation, {muscle}"),
            None => other.replace('_', " "),
        },
    }
}

/// A p-value in words.
pub fn p_words(p: f64) -> String {
    match p {
        p if !p.is_finite() => "–".to_owned(),
        p if p < 0.001 => "p < 0.001".to_owned(),
        p => format!("p = {p:.3}"),
    }
}

fn share_words(share: f64) -> String {
    if share < 0.005 { "< 1\u{202f}%".to_owned() } else { format!("{:.0}\u{202f}%", 100.0 * share) }
}

/// One panel per axis; all share the axis of the residual.
pub fn axis_panels(
    before: Option<&ResidualResult>,
    after: Option<&ResidualResult>,
    tests: &[AxisTest],
) -> Vec<AxisPanel> {
    let Some(after) = after else { return Vec::new() };
    let values = |r: &ResidualResult| {
        r.axes
            .iter()
            .flat_map(|a| a.curve.iter())
            .flat_map(|(_, mean, band)| {
                std::iter::once(*mean).chain(band.iter().flatten().copied()).collect::<Vec<_>>()
            })
            .collect::<Vec<_>>()
    };
    let mut all: Vec<f64> = values(after);
    all.extend(before.iter().flat_map(|r| values(r)));
    // One wild band must not flatten all others.
    all.sort_by(f64::total_cmp);
    let Some(last) = all.len().checked_sub(1) else { return Vec::new() };
    let cut = all.len() / 50;
    let [low, high] = [all[cut].min(0.0), all[last - cut].max(0.0)];
    let range = plot::padded([low, high], 0.08);
    after.axes.iter().map(|a| panel(before.and_then(|b| b.axis(&a.axis)), a, range, tests)).collect()
}

fn panel(before: Option<&AxisCurve>, after: &AxisCurve, y_range: [f64; 2], tests: &[AxisTest]) -> AxisPanel {
    // Effects on the angle move the bins a little: both are drawn over those of the model in question.
    let before = before.filter(|b| b.curve.len() == after.curve.len());
    let clipped = |v: f64| v.clamp(y_range[0], y_range[1]);
    let means = |a: &AxisCurve| a.curve.iter().map(|c| clipped(c.1)).collect::<Vec<f64>>();
    let band = |a: &AxisCurve| {
        a.curve.iter().map(|(_, mean, band)| band.unwrap_or([*mean, *mean]).map(clipped)).collect::<Vec<_>>()
    };
    let x: Vec<f64> = after.curve.iter().map(|c| c.0).collect();
    let (old, new) = (before.map(means), means(after));
    let mut curves = Vec::new();
    let mut bands = Vec::new();
    if let (Some(old), Some(b)) = (&old, before) {
        bands.push(("before", band(b)));
        curves.push(Curve { class: "before".to_owned(), name: "before".to_owned(), values: old });
    }
    bands.push(("after", band(after)));
    let name = if old.is_some() { "after" } else { "mean" };
    curves.push(Curve { class: "after".to_owned(), name: name.to_owned(), values: &new });
    let x_range = plot::extent(x.iter().copied()).unwrap_or([0.0, 1.0]);
    let svg = CurveFigure {
        description: format!("Residual moment against {}", axis_name(&after.axis).to_lowercase()),
        x: &x,
        x_name: ("at", unit_sign(&after.unit)),
        unit: "N·m",
        curves,
        x_range,
        y_range,
        strip: None,
        size: [320.0, 160.0],
        ticks: [5, 4],
    }
    .svg_over(&bands);
    let test = tests.iter().find(|t| t.axis == after.axis).and_then(|t| t.p_value);
    AxisPanel {
        title: axis_name(&after.axis),
        unit: unit_words(&after.unit),
        svg,
        share_before: before.map(|b| share_words(b.share_of_error)).unwrap_or_default(),
        share: share_words(after.share_of_error),
        p_value: test.map(p_words).unwrap_or_default(),
    }
}

fn unit_sign(unit: &str) -> &'static str {
    match unit {
        "deg" => "°",
        "deg/s" => "°/s",
        "deg/s²" => "°/s²",
        "s" => "s",
        "min" => "min",
        "% MVC" => "%",
        _ => "",
    }
}

fn unit_words(unit: &str) -> String {
    match unit {
        "deg" => "°".to_owned(),
        "deg/s" => "°/s".to_owned(),
        "deg/s²" => "°/s²".to_owned(),
        "1" => "0 to 1".to_owned(),
        "trial" => "order of trials".to_owned(),
        other => other.to_owned(),
    }
}

/// What repetitions say of the noise.
pub fn repetition_words(residual: Option<&ResidualResult>) -> String {
    match residual.and_then(|r| Some((r.repetition_noise_n_m?, r.repetition_pairs, r.rms_n_m))) {
        Some((noise, pairs, rms)) => format!(
            "Repetitions of the same condition differ by {} N·m ({pairs} pairs): the noise floor under an error of {} \
             N·m.",
            significant(noise, 2),
            significant(rms, 2)
        ),
        None => "No condition was repeated, so repetitions say nothing about the noise.".to_owned(),
    }
}
