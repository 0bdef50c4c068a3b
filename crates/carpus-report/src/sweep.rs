//! The page of a path sweep: lengths and moment arms of muscles over a coordinate.

use askama::Template;

use super::number::{plain, significant};
use super::page::finished;
use super::plot::{self, Curve, CurveFigure};
use super::policy::{SCRIPT, STYLE, content_security_policy};
use super::results::{Provenance, WarningResult};
use super::warnings::{self, WarningGroup};

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
    /// What a person should know of these paths.
    pub warnings: Vec<WarningResult>,
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

/// A moment arm that never exceeds this is none: the muscle does not cross the joint \[m\].
const NO_ARM: f64 = 1e-5;

/// What the partial template of warnings reads.
struct Warnings {
    warnings: Vec<WarningGroup>,
}

struct MusclePanel {
    name: String,
    own_axis: bool,
    length_svg: String,
    arm_svg: String,
    arms: String,
    lengths: String,
}

/// Moment arms of several muscles on one pair of axes.
struct Together {
    svg: String,
    /// Class and name of every curve.
    legend: Vec<(String, String)>,
}

/// Strokes that the style sheet has for curves of muscles.
const STROKES: usize = 24;

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
    view: Warnings,
    /// Muscles that turn the coordinate, in the order of the model.
    muscles: Vec<MusclePanel>,
    /// All moment arms on the axes that they share; none for one muscle.
    together: Option<Together>,
    /// How many of them have an axis of their own.
    own_axis: usize,
    /// Name and lengths of the others.
    without_arm: Vec<(String, String)>,
}

/// The page of a sweep: one self-contained HTML page.
pub fn render_sweep(figure: &SweepFigure) -> String {
    let acts = |m: &&SweepMuscle| m.moment_arm_m.iter().any(|arm| arm.abs() > NO_ARM);
    let (acting, others): (Vec<&SweepMuscle>, Vec<&SweepMuscle>) = figure.muscles.iter().partition(acts);
    let (shared, own) = shared_arm_range(&acting);
    let sharing: Vec<&SweepMuscle> = acting.iter().zip(&own).filter(|(_, own)| !**own).map(|(m, _)| *m).collect();
    let page = Page {
        together: (sharing.len() > 1).then(|| together(figure, &sharing, shared)),
        policy: content_security_policy(),
        style: STYLE,
        script: SCRIPT,
        figure,
        unit: if figure.unit == "deg" { "°" } else { figure.unit },
        first: figure.values.first().map(|v| plain(*v)).unwrap_or_default(),
        last: figure.values.last().map(|v| plain(*v)).unwrap_or_default(),
        view: Warnings { warnings: warnings::groups(&figure.warnings) },
        muscles: (acting.iter().zip(&own))
            .map(|(m, own)| panel(figure, m, if *own { arm_range(&[m]) } else { shared }, *own))
            .collect(),
        own_axis: own.iter().filter(|own| **own).count(),
        without_arm: others.iter().map(|m| (m.name.clone(), words(&mm(&m.length_m)))).collect(),
    };
    finished(&page)
}

/// Times the middle one of the muscles' largest moment arms from which a muscle has an axis of its own.
const FAR_OUT: f64 = 4.0;

/// The axis of moment arms [mm] that the muscles share, and which of them do not: those whose largest moment arm is so
/// far beyond the others', as where a path jumps, that the others would be flat lines beside it.
fn shared_arm_range(muscles: &[&SweepMuscle]) -> ([f64; 2], Vec<bool>) {
    let largest =
        |m: &&SweepMuscle| m.moment_arm_m.iter().map(|v| v.abs()).filter(|v| v.is_finite()).fold(0.0, f64::max);
    let each: Vec<f64> = muscles.iter().map(largest).collect();
    let mut sorted = each.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let own: Vec<bool> = each.iter().map(|v| *v > FAR_OUT * middle).collect();
    let sharing: Vec<&SweepMuscle> = muscles.iter().zip(&own).filter(|(_, own)| !**own).map(|(m, _)| *m).collect();
    (arm_range(&sharing), own)
}

/// The axis of some muscles' moment arms [mm], zero in it.
fn arm_range(muscles: &[&SweepMuscle]) -> [f64; 2] {
    let range = plot::extent(muscles.iter().flat_map(|m| m.moment_arm_m.iter().map(|v| 1e3 * v)));
    let [low, high] = plot::padded(range.unwrap_or([0.0, 1.0]), 0.06);
    [low.min(0.0), high.max(0.0)]
}

/// Moment arms of muscles on one pair of axes.
fn together(figure: &SweepFigure, muscles: &[&SweepMuscle], y_range: [f64; 2]) -> Together {
    let class = |i: usize| format!("muscle m{}", i % STROKES);
    let curve = |(i, m): (usize, &&SweepMuscle)| (class(i), m.name.clone(), mm(&m.moment_arm_m));
    let drawn: Vec<(String, String, Vec<f64>)> = muscles.iter().enumerate().map(curve).collect();
    let svg = CurveFigure {
        description: format!("Moment arms over {}", figure.coordinate),
        x: &figure.values,
        x_name: ("at", if figure.unit == "deg" { "°" } else { "m" }),
        unit: "mm",
        curves: (drawn.iter())
            .map(|(class, name, values)| Curve { class: class.clone(), name: name.clone(), values })
            .collect(),
        x_range: plot::extent(figure.values.iter().copied()).unwrap_or([0.0, 1.0]),
        y_range,
        strip: None,
        size: [1240.0, 380.0],
        ticks: [12, 8],
    }
    .svg();
    Together { svg, legend: drawn.into_iter().map(|(class, name, _)| (class, name)).collect() }
}

fn mm(values: &[f64]) -> Vec<f64> {
    values.iter().map(|v| 1e3 * v).collect()
}

/// Least and greatest of some values in millimetres; one where they are the same.
fn words(values: &[f64]) -> String {
    match plot::extent(values.iter().copied()).map(|ends| ends.map(|v| significant(v, 3))) {
        Some([a, b]) if a == b => format!("{a}\u{202f}mm"),
        Some([a, b]) => format!("{a} to {b}\u{202f}mm"),
        None => String::new(),
    }
}

fn panel(figure: &SweepFigure, muscle: &SweepMuscle, arm_range: [f64; 2], own_axis: bool) -> MusclePanel {
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
    let (length, arm) = (mm(&muscle.length_m), mm(&muscle.moment_arm_m));
    let length_range = plot::padded(plot::extent(length.iter().copied()).unwrap_or([0.0, 1.0]), 0.08);
    MusclePanel {
        name: muscle.name.clone(),
        own_axis,
        arm_svg: draw(&arm, arm_range, "after", "moment arm", 170.0),
        length_svg: draw(&length, length_range, "measured", "length", 110.0),
        arms: words(&arm),
        lengths: words(&length),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_muscle_whose_path_jumps_does_not_flatten_the_others() {
        let muscle = |largest: f64| SweepMuscle {
            name: "m".to_owned(),
            length_m: vec![0.2, 0.21],
            moment_arm_m: vec![0.005, largest],
        };
        let muscles = [muscle(0.012), muscle(-0.137), muscle(-0.018), muscle(0.02)];
        let (shared, own) = shared_arm_range(&muscles.iter().collect::<Vec<_>>());
        assert_eq!(own, [false, true, false, false]);
        assert!(shared[0] > -21.0 && shared[0] < -18.0 && shared[1] > 20.0 && shared[1] < 23.0, "{shared:?}");
        let one = muscle(0.3);
        assert_eq!(shared_arm_range(&[&one]).1, [false], "one muscle is not far from itself");
    }

    #[test]
    fn verif_muscles_without_a_moment_arm_and_warnings_stand_where_they_are_seen() {
        let muscle = |name: &str, arm: f64| SweepMuscle {
            name: name.to_owned(),
            length_m: vec![0.2, 0.21],
            moment_arm_m: vec![arm, 0.5 * arm],
        };
        let figure = SweepFigure {
            model: "arm".to_owned(),
            coordinate: "flexion".to_owned(),
            unit: "deg",
            values: vec![0.0, 10.0],
            held: Vec::new(),
            muscles: vec![muscle("DELT1", 0.0), muscle("ECR\u{202e}L<", -0.01)],
            warnings: vec![WarningResult { at: None, message: "the path of ECRL jumps".to_owned(), hint: None }],
            provenance: Provenance::default(),
        };
        let page = render_sweep(&figure);
        assert_eq!(page.matches("<svg class=\"figure\"").count(), 2, "an arm and a length of the one muscle that acts");
        assert!(
            page.contains("1 muscle has no moment arm about flexion") && page.contains("DELT1 (200 to 210\u{202f}mm)")
        );
        assert!(page.find("the path of ECRL jumps") < page.find("id=\"muscles\""), "before the figures");
        assert!(page.contains("ECR\\u{202e}L") && !page.contains('\u{202e}') && !page.contains("L<<"));
    }
}
