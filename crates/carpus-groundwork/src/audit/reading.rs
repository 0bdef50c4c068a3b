//! What reading the file warned of: values outside their plausible ranges, reversed ranges, inertias.

use super::super::model::{LoadedModel, elsewhere};
use super::finding::{Check, Finding, Level};
use carpus_osim::osim::Severity;

/// Warnings about components, and bodies of which a part was left out.
///
/// Warnings about elements that nobody reads and about names that are used twice are not among them: `carpus info` has
/// them, and they change no number.
pub(super) fn findings(loaded: &LoadedModel) -> Vec<Finding> {
    let spec = &loaded.file.spec;
    let bodies = || spec.bodies.iter().map(|c| c.at.path.as_str());
    let coordinates = || spec.coordinates.iter().map(|c| c.at.path.as_str());
    let others = || {
        let muscles = spec.muscles.iter().map(|m| m.at.path.as_str());
        let points = spec.muscles.iter().flat_map(|m| &m.path.points).map(|p| p.at.path.as_str());
        let wraps = spec.wrap_objects.iter().map(|w| w.at.path.as_str());
        let frames = spec.frames.iter().map(|f| f.at.path.as_str());
        let markers = spec.markers.iter().map(|m| m.at.path.as_str());
        muscles.chain(points).chain(wraps).chain(frames).chain(markers).chain(["/"])
    };
    let mut findings = Vec::new();
    for item in &loaded.file.diagnostics.items {
        let path = item.path.as_str();
        let (is_body, is_coordinate) = (bodies().any(|p| p == path), coordinates().any(|p| p == path));
        let check = match item.severity {
            Severity::Warning if is_body => Check::Inertia,
            Severity::Approximated if is_body => Check::Inertia,
            Severity::Warning if is_coordinate => Check::Range,
            Severity::Warning if others().any(|p| p == path) => Check::Value,
            _ => continue,
        };
        findings.push(Finding {
            level: Level::Warning,
            check,
            path: item.path.clone(),
            line: item.line,
            coordinate: None,
            value: None,
            unit: "",
            text: format!("{}{}", item.message, elsewhere(item)),
            hint: item.hint.clone().unwrap_or_else(|| "give it the value that was meant".to_owned()),
        });
    }
    findings
}
