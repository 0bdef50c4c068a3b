//! Measured and simulated moments over time, as SVG text.

use super::plot::{Curve, CurveFigure, extent, padded};

/// Moments of one trial over the largest measured one.
///
/// - `simulated`: names and values, at most three
pub fn moment_figure(description: &str, time_s: &[f64], measured: &[f64], simulated: &[(String, &[f64])]) -> String {
    let curve = |class: &str, name: &str, values| Curve { class: class.to_string(), name: name.to_string(), values };
    let mut curves = vec![curve("measured", "measured", measured)];
    for ((name, values), class) in simulated.iter().zip(["after", "before", "third"]) {
        curves.push(curve(class, name, values));
    }
    let all = curves.iter().flat_map(|c| c.values.iter().copied()).chain([0.0]);
    let y_range = padded(extent(all).unwrap_or([0.0, 1.0]), 0.05);
    let x_range = extent(time_s.iter().copied()).unwrap_or([0.0, 1.0]);
    CurveFigure {
        description: description.to_string(),
        x: time_s,
        x_name: ("t", "s"),
        unit: "",
        curves,
        x_range,
        y_range,
        strip: None,
        size: [430.0, 170.0],
        ticks: [5, 4],
    }
    .svg()
}
