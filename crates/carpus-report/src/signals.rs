//! The page of processed signals: constants, findings, tables, and panels of curves over time.

use askama::Template;

use super::page::finished;
use super::plot::{self, Curve, CurveFigure};
use super::policy::{SCRIPT, STYLE, content_security_policy};
use super::results::Provenance;

/// What a page of processed signals shows.
#[derive(Clone, Debug)]
pub struct SignalReport {
    /// Small line above the title.
    pub kicker: String,
    /// Title.
    pub title: String,
    /// What was done, in a sentence or two.
    pub lead: String,
    /// Constants and results: name and value.
    pub facts: Vec<(String, String)>,
    /// What a person should look at: place and text.
    pub findings: Vec<(String, String)>,
    /// Tables.
    pub tables: Vec<SignalTable>,
    /// Classes of curves and what they are.
    pub legend: Vec<(&'static str, String)>,
    /// Sections of panels.
    pub sections: Vec<SignalSection>,
    /// Program, command and inputs.
    pub provenance: Provenance,
}

/// A table.
#[derive(Clone, Debug)]
pub struct SignalTable {
    /// Title.
    pub title: String,
    /// Names of columns.
    pub header: Vec<String>,
    /// Rows.
    pub rows: Vec<Vec<String>>,
}

/// A section of panels, e.g. a trial.
#[derive(Clone, Debug)]
pub struct SignalSection {
    /// Title.
    pub title: String,
    /// Its panels.
    pub panels: Vec<SignalPanel>,
}

/// One panel: figures one below the other.
#[derive(Clone, Debug)]
pub struct SignalPanel {
    /// Title, e.g. a channel.
    pub title: String,
    /// A few words beside it.
    pub note: String,
    /// What a person should look at.
    pub findings: Vec<String>,
    /// The figures.
    pub figures: Vec<SignalFigure>,
}

/// Curves over a common abscissa.
#[derive(Clone, Debug)]
pub struct SignalFigure {
    /// What a screen reader says.
    pub description: String,
    /// Name and unit of the abscissa.
    pub x_name: (&'static str, &'static str),
    /// Abscissae.
    pub x: Vec<f64>,
    /// Unit of the curves.
    pub unit: &'static str,
    /// Class, name and values of each curve.
    pub curves: Vec<(&'static str, String, Vec<f64>)>,
    /// Values that the ordinate has to include.
    pub include: Vec<f64>,
    /// Height of the drawing.
    pub height: f64,
}

struct PanelView {
    title: String,
    note: String,
    findings: Vec<String>,
    figures: Vec<String>,
}

struct SectionView {
    title: String,
    panels: Vec<PanelView>,
}

#[derive(Template)]
#[template(path = "signals.html")]
struct Page<'a> {
    policy: String,
    style: &'a str,
    script: &'a str,
    report: &'a SignalReport,
    sections: Vec<SectionView>,
}

/// The page: one self-contained HTML page.
pub fn render_signals(report: &SignalReport) -> String {
    let panel = |panel: &SignalPanel| PanelView {
        title: panel.title.clone(),
        note: panel.note.clone(),
        findings: panel.findings.clone(),
        figures: svgs(&panel.figures),
    };
    let section = |section: &SignalSection| SectionView {
        title: section.title.clone(),
        panels: section.panels.iter().map(panel).collect(),
    };
    let page = Page {
        policy: content_security_policy(),
        style: STYLE,
        script: SCRIPT,
        report,
        sections: report.sections.iter().map(section).collect(),
    };
    finished(&page)
}

/// The figures of a panel, with their axes of time below each other.
fn svgs(figures: &[SignalFigure]) -> Vec<String> {
    let drawn: Vec<CurveFigure> = figures.iter().map(drawing).collect();
    let left = drawn.iter().map(CurveFigure::left).fold(0.0, f64::max);
    drawn.iter().map(|figure| figure.svg_from(left)).collect()
}

fn drawing(figure: &SignalFigure) -> CurveFigure<'_> {
    let values = figure.curves.iter().flat_map(|(_, _, values)| values.iter().copied());
    let range = plot::extent(values.chain(figure.include.iter().copied())).unwrap_or([0.0, 1.0]);
    CurveFigure {
        description: figure.description.clone(),
        x: &figure.x,
        x_name: figure.x_name,
        unit: figure.unit,
        curves: (figure.curves.iter())
            .map(|(class, name, values)| Curve { class: class.to_string(), name: name.clone(), values })
            .collect(),
        x_range: plot::extent(figure.x.iter().copied()).unwrap_or([0.0, 1.0]),
        y_range: plot::padded(range, 0.06),
        strip: None,
        size: [320.0, figure.height],
        ticks: [5, 4],
    }
}

/// A signal with few points for drawing: of every stretch its least and its greatest sample, in their order, so that
/// spikes and bursts stay visible. Abscissae and values.
pub fn thinned_signal(x: &[f64], y: &[f64], most: usize) -> (Vec<f64>, Vec<f64>) {
    let n = x.len().min(y.len());
    if n <= most.max(2) {
        return (x[..n].to_vec(), y[..n].to_vec());
    }
    let stretch = n.div_ceil((most / 2).max(1));
    let mut kept = Vec::with_capacity(most + 2);
    for start in (0..n).step_by(stretch) {
        let range = start..(start + stretch).min(n);
        let least = range.clone().min_by(|a, b| y[*a].total_cmp(&y[*b])).unwrap_or(start);
        let greatest = range.max_by(|a, b| y[*a].total_cmp(&y[*b])).unwrap_or(start);
        kept.push(least.min(greatest));
        if least != greatest {
            kept.push(least.max(greatest));
        }
    }
    (kept.iter().map(|i| x[*i]).collect(), kept.iter().map(|i| y[*i]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_thinning_keeps_extremes_in_order() {
        let x: Vec<f64> = (0..1000).map(f64::from).collect();
        let mut y = vec![0.0; 1000];
        y[501] = 9.0;
        y[737] = -4.0;
        let (kept_x, kept_y) = thinned_signal(&x, &y, 50);
        assert!(kept_x.len() <= 52 && kept_x.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(kept_y.contains(&9.0) && kept_y.contains(&-4.0));
        assert_eq!(thinned_signal(&x[..10], &y[..10], 50).0.len(), 10);
    }
}
