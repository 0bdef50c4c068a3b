//! What is in a model, in words.

use super::info::{CoordinateInfo, Info, MuscleInfo, understood};
use super::model;
use carpus_osim::osim::Severity;
use carpus_report::article::TextTable;

/// How many findings of one severity are listed before the rest is only counted.
const LISTED: usize = 12;

impl Info {
    /// The file, and how many of what there are.
    pub fn counts(&self) -> String {
        format!(
            "{} (format {}, {})\n{} bodies, {} joints, {} coordinates, {} muscles, {} other forces, {} wrap objects, {} \
             constraints, {} markers",
            self.model,
            self.document_version,
            self.file,
            self.bodies,
            self.joints,
            self.coordinates.len(),
            self.muscles.len(),
            self.forces,
            self.wrap_objects,
            self.constraints,
            self.markers
        )
    }

    /// Coordinates, and muscles if there are any.
    pub fn tables(&self) -> Vec<TextTable> {
        let header = ["coordinate", "motion", "notes", "default", "range", "unit"];
        let mut tables = vec![TextTable::titled("", &header, 3, self.coordinates.iter().map(CoordinateInfo::row))];
        if !self.muscles.is_empty() {
            let header = ["muscle", "notes", "Fmax N", "l_opt mm", "l_slack mm", "pennation °", "points", "wraps"];
            tables.push(TextTable::titled("", &header, 2, self.muscles.iter().map(MuscleInfo::row)));
        }
        tables
    }

    /// What was not understood as it is written, by severity.
    ///
    /// - `all`: however much it is
    pub fn findings(&self, all: bool) -> String {
        let mut text = format!("understood: {}\n", understood(&self.diagnostics));
        let severities = [
            (Severity::Unsupported, "unsupported (would change the result in OpenSim)"),
            (Severity::Approximated, "approximated"),
            (Severity::Warning, "warnings"),
            (Severity::Ignored, "ignored (no influence on motion or forces)"),
        ];
        for (severity, title) in severities {
            let found: Vec<_> = self.diagnostics.of(severity).collect();
            let count = if found.is_empty() { "none".to_string() } else { found.len().to_string() };
            text.push_str(&format!("{title}: {count}\n"));
            let shown = if all { found.len() } else { LISTED.min(found.len()) };
            for d in &found[..shown] {
                let more = model::elsewhere(d);
                text.push_str(&format!("  {}:{}: {}: {}{more}\n", self.file, d.line, d.path, d.message));
                if let Some(hint) = &d.hint {
                    text.push_str(&format!("    hint: {hint}\n"));
                }
            }
            if shown < found.len() {
                text.push_str(&format!("  … and {} more (--all lists them)\n", found.len() - shown));
            }
        }
        text
    }
}

impl CoordinateInfo {
    fn row(&self) -> Vec<String> {
        let number = |v: f64| carpus_report::plain(v).replace('−', "-");
        let range = match self.is_unlimited() {
            true => "unlimited".to_string(),
            false => format!("{} to {}", number(self.range[0]), number(self.range[1])),
        };
        let (motion, unit) = (self.motion_type.to_string(), self.unit.to_string());
        vec![self.name.clone(), motion, self.notes(), number(self.default_value), range, unit]
    }
}

impl MuscleInfo {
    fn row(&self) -> Vec<String> {
        vec![
            self.name.clone(),
            self.notes(),
            format!("{:.1}", self.max_isometric_force_n),
            format!("{:.2}", 1e3 * self.optimal_fiber_length_m),
            format!("{:.2}", 1e3 * self.tendon_slack_length_m),
            format!("{:.1}", self.pennation_angle_at_optimal_deg),
            self.path_points.to_string(),
            self.wraps.to_string(),
        ]
    }
}
