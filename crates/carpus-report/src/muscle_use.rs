//! What muscles did in the trials: where they work on their curves, and EMG over moment.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::plot::{self, Curve, CurveFigure};

/// What the active muscles did in the trials, maximal contractions included.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MuscleUse {
    /// Measured moment at samples of the trials [N·m].
    pub moment_n_m: Vec<f64>,
    /// The active muscles.
    pub muscles: Vec<MuscleOperation>,
}

/// What an active muscle did in the trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MuscleOperation {
    /// Muscle.
    pub muscle: String,
    /// Recorded excitation at the samples of [`MuscleUse::moment_n_m`].
    pub excitation: Vec<f64>,
    /// Where the fibre works, by model id.
    pub ranges: BTreeMap<String, OperatingRange>,
    /// Fibre lengths over optimal length at which the curves are given.
    pub length: Vec<f64>,
    /// Active force–length curve.
    pub active: Vec<f64>,
    /// Passive force–length curve.
    pub passive: Vec<f64>,
    /// Fibre velocities over maximum contraction velocity at which the curve is given, positive when lengthening; empty
    /// for a class that has no such curve.
    pub velocity: Vec<f64>,
    /// Force of the fully active fibre at optimal length, less the passive force, over that at rest; with damping. A
    /// `Schutte1993Muscle_Deprecated` has none.
    pub force: Vec<f64>,
}

/// Where a fibre works: 1st and 99th percentile over the samples of all trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OperatingRange {
    /// Fibre length over optimal length.
    pub length: [f64; 2],
    /// Fibre velocity over maximum contraction velocity, positive when lengthening.
    pub velocity: [f64; 2],
}

/// The figures of one muscle.
pub struct MusclePanels {
    /// Muscle.
    pub muscle: String,
    /// What a figure shows, and the figure.
    pub figures: Vec<(&'static str, String)>,
}

/// Drawing size.
const SIZE: [f64; 2] = [320.0, 170.0];

/// The figures of every muscle: force–length, force–velocity, EMG over moment.
///
/// - `before`, `after`: ids of the models
pub fn panels(used: &MuscleUse, before: Option<&str>, after: &str) -> Vec<MusclePanels> {
    let of = |m: &MuscleOperation| {
        let lengths = |id: &str| m.ranges.get(id).map(|range| range.length);
        let velocities = |id: &str| m.ranges.get(id).map(|range| range.velocity);
        let figures = [
            (
                "Force over fibre length",
                over_curve(
                    &format!("Force–length curve of {} and where its fibre works", m.muscle),
                    ("length", ""),
                    &m.length,
                    &[("after", "active", &m.active), ("measured thin", "passive", &m.passive)],
                    [before.and_then(lengths), lengths(after)],
                ),
            ),
            (
                "Force over fibre velocity",
                over_curve(
                    &format!("Force–velocity curve of {} and where its fibre works", m.muscle),
                    ("velocity", ""),
                    &m.velocity,
                    &[("after", "force", &m.force)],
                    [before.and_then(velocities), velocities(after)],
                ),
            ),
            ("EMG over measured moment", scatter(&m.muscle, &used.moment_n_m, &m.excitation)),
        ];
        let figures = figures.into_iter().filter_map(|(title, svg)| Some((title, svg?))).collect();
        MusclePanels { muscle: m.muscle.clone(), figures }
    };
    used.muscles.iter().map(of).collect()
}

/// Curves, and below the first of them bands over the ranges of the model before and of the model that the page is
/// about.
fn over_curve(
    description: &str,
    x_name: (&'static str, &'static str),
    x: &[f64],
    curves: &[(&str, &str, &[f64])],
    [before, after]: [Option<[f64; 2]>; 2],
) -> Option<String> {
    let (_, _, first) = curves.first()?;
    // The ends of the ranges are abscissae of their own, so that bands end where fibres do.
    let whole = plot::extent(x.iter().copied())?;
    let mut all: Vec<f64> = x.to_vec();
    all.extend(before.into_iter().chain(after).flatten().map(|end| end.clamp(whole[0], whole[1])));
    all.sort_by(f64::total_cmp);
    let at = |values: &[f64]| all.iter().map(|q| between(x, values, *q)).collect::<Vec<f64>>();
    let drawn: Vec<(&str, &str, Vec<f64>)> = curves.iter().map(|(class, name, v)| (*class, *name, at(v))).collect();
    let heights = at(first);
    let band = |[low, high]: [f64; 2]| {
        let edge = |(q, height): (&f64, &f64)| {
            if (low..=high).contains(q) { [0.0, *height] } else { [f64::NAN; 2] }
        };
        all.iter().zip(&heights).map(edge).collect::<Vec<_>>()
    };
    let bands: Vec<(&'static str, Vec<[f64; 2]>)> =
        [("before", before), ("after", after)].into_iter().filter_map(|(class, r)| Some((class, band(r?)))).collect();
    // Of other curves only what is near the first: passive forces rise without end.
    let most = 1.5 * plot::extent(heights.iter().copied())?[1];
    let [low, high] = plot::extent(drawn.iter().flat_map(|(_, _, v)| v.iter().map(|v| v.min(most))))?;
    let drawn: Vec<(&str, &str, Vec<f64>)> = drawn
        .into_iter()
        .map(|(class, name, v)| (class, name, v.into_iter().map(|v| if v > most { f64::NAN } else { v }).collect()))
        .collect();
    let curves = drawn.iter().map(|(class, name, values)| Curve {
        class: (*class).to_owned(),
        name: (*name).to_owned(),
        values,
    });
    let figure = CurveFigure {
        description: description.to_owned(),
        x: &all,
        x_name,
        unit: "",
        curves: curves.collect(),
        x_range: whole,
        y_range: [1.05 * low.min(0.0), 1.05 * high],
        strip: None,
        size: SIZE,
        ticks: [5, 4],
    };
    Some(figure.svg_over(&bands))
}

fn scatter(muscle: &str, moment: &[f64], excitation: &[f64]) -> Option<String> {
    let high = plot::extent(excitation.iter().copied())?[1];
    let figure = CurveFigure {
        description: format!("EMG of {muscle} over the measured moment"),
        x: &[],
        x_name: ("moment", "N·m"),
        unit: "",
        curves: Vec::new(),
        x_range: plot::padded(plot::extent(moment.iter().copied())?, 0.04),
        y_range: [0.0, 1.05 * high.max(0.05)],
        strip: None,
        size: SIZE,
        ticks: [5, 4],
    };
    let points: Vec<[f64; 2]> = moment.iter().zip(excitation).map(|(m, e)| [*m, *e]).collect();
    Some(figure.svg_with_points(&[], &points))
}

/// Value at `at` of a curve through points with ascending abscissae.
fn between(x: &[f64], values: &[f64], at: f64) -> f64 {
    let i = x.partition_point(|q| *q < at).clamp(1, x.len() - 1);
    let part = ((at - x[i - 1]) / (x[i] - x[i - 1])).clamp(0.0, 1.0);
    values[i - 1] + part * (values[i] - values[i - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn used() -> MuscleUse {
        let range = |low: f64, high: f64| OperatingRange { length: [low, high], velocity: [-0.1, 0.2] };
        let muscle = MuscleOperation {
            muscle: "A & B".to_owned(),
            excitation: vec![0.1, 0.5, 0.9],
            ranges: [("old".to_owned(), range(0.7, 0.9)), ("new".to_owned(), range(0.95, 1.25))].into(),
            length: vec![0.5, 1.0, 1.5],
            active: vec![0.0, 1.0, 0.0],
            passive: vec![0.0, 0.0, 0.5],
            velocity: Vec::new(),
            force: Vec::new(),
        };
        MuscleUse { moment_n_m: vec![-1.0, 0.0, 2.0], muscles: vec![muscle] }
    }

    /// A class without a force–velocity curve has two figures; bands end where fibres do.
    #[test]
    fn verif_bands_are_where_fibres_work() {
        let found = panels(&used(), Some("old"), "new");
        let titles: Vec<&str> = found[0].figures.iter().map(|f| f.0).collect();
        assert_eq!(titles, ["Force over fibre length", "EMG over measured moment"]);
        let svg = &found[0].figures[0].1;
        assert!(svg.contains("A &amp; B") && !svg.contains("A & B"));
        let bands: Vec<&str> = svg.split("<polygon class=\"band ").skip(1).collect();
        assert_eq!(bands.len(), 2);
        assert!(bands[0].starts_with("before") && bands[1].starts_with("after"));
        // Abscissae of the drawing of 0.95 and 1.25 between 36 (0.5) and 312 (1.5).
        for end in ["160.2,", "243.0,"] {
            assert!(bands[1].contains(end), "{}", bands[1]);
        }
        assert_eq!(found[0].figures[1].1.matches("<circle").count(), 3);
    }
}
