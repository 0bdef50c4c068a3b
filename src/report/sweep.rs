//! The page of a path sweep: lengths and moment arms of muscles over a coordinate.

use askama::Template;

use super::page::{SCRIPT, STYLE, content_security_policy, finished};
use super::plot::{self, Curve, CurveFigure};
use super::results::Provenance;

/// Lengths and moment arms of muscles over a coordinate.
#[derive(Clone, Debug)]
pub struct SweepFigure {
    /// Model name.
    pub model: String,
    /// The coordinate that moves, and about which moment arms are taken.
    pub coordinate: String,
    /// `deg` or `m`: unit of `values`.
    pub unit: &'static str,
    /// Values of the coordinate.
    pub values: Vec<f64>,
    /// Other coordinates that were set, in words: `elbow_flexion = 90 deg`.
    pub held: Vec<String>,
    /// One per muscle.
    pub muscles: Vec<SweepMuscle>,
    /// Program, command and inputs.
    pub provenance: Provenance,
}

/// A muscle in a sweep.
#[derive(Clone, Debug)]
pub struct SweepMuscle {
    /// Muscle name.
    pub name: String,
    /// Length of the muscle–tendon unit [m].
    pub length_m: Vec<f64>,
    /// Moment arm about the coordinate [m] (for a translation: dimensionless).
    pub moment_arm_m: Vec<f64>,
}

struct MusclePanel {
    name: String,
    length_svg: String,
    arm_svg: String,
    arms: String,
    lengths: String,
}

#[derive(Template)]
#[template(path = "sweep.html")]
struct Page<'a> {
    policy: String,
    style: &'a str,
    script: &'a str,
    figure: &'a SweepFigure,
    unit: &'a str,
    first: String,
    last: String,
    muscles: Vec<MusclePanel>,
}

/// The page of a sweep: one self-contained HTML page.
pub fn render_sweep(figure: &SweepFigure) -> String {
    let arm_range = plot::extent(figure.muscles.iter().flat_map(|m| m.moment_arm_m.iter().map(|v| 1e3 * v)));
    let arm_range = plot::padded(arm_range.unwrap_or([0.0, 1.0]), 0.06);
    let arm_range = [arm_range[0].min(0.0), arm_range[1].max(0.0)];
    let page = Page {
        policy: content_security_policy(),
        style: STYLE,
        script: SCRIPT,
        figure,
        unit: if figure.unit == "deg" { "°" } else { figure.unit },
        first: figure.values.first().map(|v| super::plain(*v)).unwrap_or_default(),
        last: figure.values.last().map(|v| super::plain(*v)).unwrap_or_default(),
        muscles: figure.muscles.iter().map(|m| panel(figure, m, arm_range)).collect(),
    };
    finished(&page)
}

fn panel(figure: &SweepFigure, muscle: &SweepMuscle, arm_range: [f64; 2]) -> MusclePanel {
    let x_range = plot::extent(figure.values.iter().copied()).unwrap_or([0.0, 1.0]);
    let draw = |values_mm: &[f64], y_range: [f64; 2], class: &str, what: &str, height: f64| {
        CurveFigure {
            description: format!("{what} of {} over {}", muscle.name, figure.coordinate),
            x: &figure.values,
            x_name: ("at", if figure.unit == "deg" { "°" } else { "m" }),
            unit: "mm",
            curves: vec![Curve { class: class.to_string(), name: what.to_string(), values: values_mm }],
            x_range,
            y_range,
            strip: None,
            size: [320.0, height],
            ticks: [5, 4],
        }
        .svg()
    };
    let mm = |values: &[f64]| values.iter().map(|v| 1e3 * v).collect::<Vec<_>>();
    let (length, arm) = (mm(&muscle.length_m), mm(&muscle.moment_arm_m));
    let words = |values: &[f64]| match plot::extent(values.iter().copied()) {
        Some([a, b]) => format!("{} to {}\u{202f}mm", super::significant(a, 3), super::significant(b, 3)),
        None => String::new(),
    };
    let length_range = plot::padded(plot::extent(length.iter().copied()).unwrap_or([0.0, 1.0]), 0.08);
    MusclePanel {
        name: muscle.name.clone(),
        arm_svg: draw(&arm, arm_range, "after", "moment arm", 170.0),
        length_svg: draw(&length, length_range, "measured", "length", 110.0),
        arms: words(&arm),
        lengths: words(&length),
    }
}
