//! Models beside imaging: the results file and its page (tables 4.2, 4.3 and figure 4.3 of Jadelis 2025).

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use super::article::{Article, Block, Section, TextTable, p_text, render_article};
use super::number::significant;
use super::plot::{Scale, escape, extent, padded, tick_label, ticks};
use super::results::{Provenance, WarningResult};

/// Name and version of the schema.
pub const ULTRASOUND_SCHEMA: &str = "carpus.ultrasound/1";

/// Every model case beside the images of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UltrasoundResult {
    /// [`ULTRASOUND_SCHEMA`].
    pub schema: String,
    /// Program, command, seed and inputs.
    pub provenance: Provenance,
    /// The study.
    pub study: String,
    /// Activation of the resting muscles.
    pub activation: f64,
    /// Force per area [N/cm²].
    pub specific_tension_n_per_cm2: f64,
    /// Where ratios and tension are from, as the study says it.
    pub source: Option<String>,
    /// Model cases, in the order of the command.
    pub cases: Vec<CaseResult>,
    /// What the reader must know.
    pub warnings: Vec<WarningResult>,
}

/// One model case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseResult {
    /// Its name.
    pub case: String,
    /// What was compared.
    pub quantities: Vec<QuantityResult>,
}

/// One quantity of one model case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuantityResult {
    /// `belly_length`, `tendon_length`, `force`, `fascicle_length`, `pennation`.
    pub quantity: String,
    /// In words.
    pub words: String,
    /// Measurements.
    pub n: usize,
    /// Participants that they are from.
    pub participants: usize,
    /// Pearson's r; absent where it is not defined.
    pub r: Option<f64>,
    /// Its two-sided p-value.
    pub p: Option<f64>,
    /// Slope of the model's value over the measured one, in `model_unit` per `measured_unit`.
    pub slope: Option<f64>,
    /// The line's value at 0.
    pub intercept: Option<f64>,
    /// Unit of the measured values.
    pub measured_unit: String,
    /// Unit of the model's values, of bias and limits.
    pub model_unit: String,
    /// Model minus measurement after conversion, mean.
    pub bias: Option<f64>,
    /// 1.96 standard deviations of it.
    pub limit: Option<f64>,
    /// Measurements without the ratio that conversion takes.
    pub unconverted: usize,
    /// Why a number is absent.
    pub note: Option<String>,
    /// Measured and modelled values, for the figure.
    pub points: Vec<Point>,
}

/// One measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// The participant.
    pub participant: String,
    /// The muscle.
    pub muscle: String,
    /// Posture [deg].
    pub posture_deg: f64,
    /// Measured.
    pub measured: f64,
    /// Of the model.
    pub model: f64,
    /// Model and measurement after conversion, in `model_unit`.
    pub converted: Option<[f64; 2]>,
}

/// The page: one self-contained HTML page.
pub fn render_ultrasound(result: &UltrasoundResult) -> String {
    let first = result.cases.first().map(|c| c.quantities.as_slice()).unwrap_or_default();
    let n = first.iter().map(|q| q.n).max().unwrap_or(0);
    let people = first.iter().map(|q| q.participants).max().unwrap_or(0);
    let blocks = ultrasound_blocks(&result.cases, result.specific_tension_n_per_cm2, result.source.as_deref());
    let [correlation, agreement, figures] = blocks;
    let section = |id: &str, title: &str, blocks: Vec<Block>| Section { id: id.into(), title: title.into(), blocks };
    render_article(&Article {
        title: "Models beside imaging".to_string(),
        kicker: result.study.clone(),
        lead: format!(
            "{} model case{}, {n} images of {people} participant{}. Muscles of the models are at rest (activation {}) \
             in the \
             posture of each image.",
            result.cases.len(),
            if result.cases.len() == 1 { "" } else { "s" },
            if people == 1 { "" } else { "s" },
            result.activation
        ),
        facts: Vec::new(),
        warnings: result.warnings.iter().map(|w| w.message.clone()).collect(),
        sections: vec![
            section("correlation", "Correlation", correlation),
            section("agreement", "Agreement", agreement),
            section("figures", "Model over measurement", figures),
        ],
        provenance: result.provenance.clone(),
    })
}

/// Tables 4.2 and 4.3, and figure 4.3.
pub fn ultrasound_blocks(
    cases: &[CaseResult],
    specific_tension_n_per_cm2: f64,
    source: Option<&str>,
) -> [Vec<Block>; 3] {
    let quantities = cases.first().map(|c| c.quantities.as_slice()).unwrap_or_default();
    let table = |title: &str, note: String, cell: &dyn Fn(&QuantityResult) -> String| {
        Block::Table(TextTable {
            title: title.to_string(),
            header: std::iter::once("model case".to_string())
                .chain(quantities.iter().map(|q| q.words.clone()))
                .collect(),
            left_columns: 1,
            rows: cases
                .iter()
                .map(|c| std::iter::once(c.case.clone()).chain(c.quantities.iter().map(cell)).collect())
                .collect(),
            note,
        })
    };
    let absent = |q: &QuantityResult| q.note.clone().unwrap_or_else(|| "–".to_string());
    let correlations = table(
        "Table 4.2: r, (p) of the model's value with the measured one",
        "Pearson's correlation over all muscles, postures and participants together. Images of one person are taken \
         for \
         independent, as in the dissertation, which makes p smaller than it should be."
            .to_string(),
        &|q| match (q.r, q.p) {
            (Some(r), Some(p)) if p < 0.05 => format!("{}, ({})*", fixed(r, 2), p_text(p).trim_end_matches('*')),
            (Some(r), Some(p)) => format!("{}, ({})", fixed(r, 2), p_text(p)),
            _ => absent(q),
        },
    );
    let source = source.map(|s| format!(" Source of ratios, as the study states it: {s}.")).unwrap_or_default();
    let agreements = table(
        "Table 4.3: mean difference, (limits of agreement)",
        format!(
            "Model minus measurement after conversion; the limits are 1.96 standard deviations of the differences \
             (Bland and \
             Altman 1986). Specific tension {specific_tension_n_per_cm2} N/cm².{source}"
        ),
        &|q| match (q.bias, q.limit) {
            (Some(bias), Some(limit)) => {
                format!("{}, (±{}) {}", significant(bias, 3), significant(limit, 3), q.model_unit)
            }
            _ => absent(q),
        },
    );
    let figures = cases.iter().map(|c| Block::Figures {
        title: format!("Figure 4.3: {}", c.case),
        note: String::new(),
        columns: 4,
        figures: c.quantities.iter().map(|q| (q.words.clone(), scatter(q))).collect(),
    });
    [vec![correlations], vec![agreements], figures.collect()]
}

fn fixed(value: f64, decimals: usize) -> String {
    format!("{value:.decimals$}").replace('-', "−")
}

/// Model over measurement, one mark per image, and the line of least squares.
fn scatter(q: &QuantityResult) -> String {
    let [width, height] = [300.0, 220.0];
    let range = |f: &dyn Fn(&Point) -> f64| padded(extent(q.points.iter().map(f)).unwrap_or([0.0, 1.0]), 0.08);
    let x = Scale { data: range(&|p| p.measured), drawn: [46.0, width - 8.0] };
    let y = Scale { data: range(&|p| p.model), drawn: [height - 34.0, 8.0] };
    let label = format!("{}: {} images, r {}", q.words, q.n, q.r.map_or("–".to_string(), |r| fixed(r, 2)));
    let mut w =
        format!(r#"<svg class="figure" viewBox="0 0 {width} {height}" role="img" aria-label="{}">"#, escape(&label));
    let y_ticks = ticks(y.data[0], y.data[1], 4);
    let step = y_ticks.windows(2).map(|t| t[1] - t[0]).next().unwrap_or(1.0);
    for v in y_ticks {
        let at = y.at(v);
        let _ = write!(w, r#"<line class="grid" x1="46" x2="{}" y1="{at:.1}" y2="{at:.1}"/>"#, width - 8.0);
        let _ = write!(w, r#"<text class="tick y" x="41" y="{:.1}">{}</text>"#, at + 3.5, tick_label(v, step));
    }
    let x_ticks = ticks(x.data[0], x.data[1], 4);
    let step = x_ticks.windows(2).map(|t| t[1] - t[0]).next().unwrap_or(1.0);
    let bottom = y.drawn[0];
    for v in x_ticks {
        let at = x.at(v);
        let text = tick_label(v, step);
        let _ =
            write!(w, r#"<text class="tick" text-anchor="middle" x="{at:.1}" y="{:.1}">{text}</text>"#, bottom + 14.0);
    }
    let _ = write!(w, r#"<line class="axis" x1="46" x2="{}" y1="{bottom}" y2="{bottom}"/>"#, width - 8.0);
    let caption = format!("measured [{}], model [{}]", q.measured_unit, q.model_unit);
    let _ = write!(
        w,
        r#"<text class="tick" text-anchor="end" x="{}" y="{:.1}">{}</text>"#,
        width - 8.0,
        bottom + 28.0,
        escape(&caption)
    );
    if let (Some(slope), Some(intercept)) = (q.slope, q.intercept) {
        let [a, b] = x.data;
        let at = |v: f64| y.at((intercept + slope * v).clamp(y.data[0], y.data[1]));
        let _ = write!(
            w,
            r#"<polyline class="curve after" points="{:.1},{:.1} {:.1},{:.1}"/>"#,
            x.at(a),
            at(a),
            x.at(b),
            at(b)
        );
    }
    for p in &q.points {
        let (cx, cy) = (x.at(p.measured), y.at(p.model));
        let title = escape(&format!("{} {} at {}°", p.participant, p.muscle, p.posture_deg));
        let _ = write!(
            w,
            r#"<circle class="dot before" cx="{cx:.1}" cy="{cy:.1}" r="3.5"><title>{title}</title></circle>"#
        );
    }
    w.push_str("</svg>");
    w
}
