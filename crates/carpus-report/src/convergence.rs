//! Indices over the size of the sample, as SVG text.

use super::bars::{COLOURS, legend_in};
use super::plot::{Curve, CurveFigure, extent, padded};

/// Every other colour: neighbours are shades of each other.
const STEP: usize = 2;

/// The legend of the curves.
pub fn convergence_legend(names: &[String]) -> String {
    legend_in(names, STEP)
}

/// Curves of indices over the number of starts.
pub fn convergence_figure(description: &str, starts: &[f64], curves: &[(String, Vec<f64>)]) -> String {
    let drawn = curves.iter().enumerate().map(|(i, (name, values))| Curve {
        class: format!("series c{}", STEP * i % COLOURS),
        name: name.clone(),
        values,
    });
    let all = curves.iter().flat_map(|(_, values)| values.iter().copied()).chain([0.0]);
    CurveFigure {
        description: description.to_string(),
        x: starts,
        x_name: ("r", ""),
        unit: "",
        curves: drawn.collect(),
        x_range: extent(starts.iter().copied()).unwrap_or([0.0, 1.0]),
        y_range: padded(extent(all).unwrap_or([0.0, 1.0]), 0.05),
        strip: None,
        size: [430.0, 170.0],
        ticks: [5, 4],
    }
    .svg()
}
