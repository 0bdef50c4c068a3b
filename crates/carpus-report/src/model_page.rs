//! The page of a model: drawn in three dimensions, in any posture, by the program itself compiled to WebAssembly.

use askama::Template;

use super::live::{Embedded, is_base64};
use super::page::finished;
use super::policy::{SCRIPT, STYLE};
use super::results::{Provenance, WarningResult};
use super::warnings::{self, WarningGroup};

/// What the page shows.
#[derive(Clone, Debug)]
pub struct ModelPage {
    /// Name of the model.
    pub name: String,
    /// Its file.
    pub file: String,
    /// The model file as [`packed`](super::live::packed).
    pub model: String,
    /// Bone geometry as packed; of nothing where there is none.
    pub geometry: String,
    /// All coordinates at the start [rad or m].
    pub start: Vec<f64>,
    /// Units in which people read the coordinates: `deg`, `m` or `rad or m`.
    pub units: Vec<&'static str>,
    /// What a person should know.
    pub warnings: Vec<WarningResult>,
    /// Program, command and inputs.
    pub provenance: Provenance,
}

/// What the partial template of warnings reads.
struct Warnings {
    warnings: Vec<WarningGroup>,
}

#[derive(Template)]
#[template(path = "model.html")]
struct Page<'a> {
    policy: String,
    style: &'a str,
    script: &'a str,
    page: &'a ModelPage,
    start: String,
    units: String,
    live: Embedded,
    view: Warnings,
}

/// One self-contained HTML page.
///
/// # Panics
/// If `model` or `geometry` is not base64.
pub fn render_model(page: &ModelPage) -> String {
    assert!(is_base64(&page.model) && is_base64(&page.geometry), "packed by `live::packed`");
    let live = Embedded::for_model();
    finished(&Page {
        policy: live.content_security_policy(),
        style: STYLE,
        script: SCRIPT,
        start: page.start.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(" "),
        units: page.units.join("|"),
        page,
        live,
        view: Warnings { warnings: warnings::groups(&page.warnings) },
    })
}
