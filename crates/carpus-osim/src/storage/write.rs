//! Writing storages as OpenSim prints them.

use std::fmt::Write;

use super::table::Storage;
use carpus_numerics::printable::visible;

/// A number as OpenSim prints it with its tools' `output_precision`: fixed point, padded.
pub fn printed(value: f64, precision: usize) -> String {
    let width = precision + 8;
    if value.is_nan() {
        format!("{:>width$}", "nan")
    } else if value.is_infinite() {
        format!("{:>width$}", if value > 0.0 { "inf" } else { "-inf" })
    } else {
        format!("{value:width$.precision$}")
    }
}

impl Storage {
    /// The text of a `.sto` or `.mot` file as OpenSim's `Storage::print` writes it.
    ///
    /// - `precision`: digits behind the point, 8 unless a tool says otherwise
    pub fn text(&self, precision: usize) -> String {
        let mut text = String::new();
        let degrees = if self.in_degrees { "yes" } else { "no" };
        let (rows, columns) = (self.len(), self.labels.len() + 1);
        let _ = write!(text, "{}\nversion=1\nnRows={rows}\nnColumns={columns}\ninDegrees={degrees}\n", self.name);
        text.push_str(&self.description);
        if !self.description.is_empty() && !self.description.ends_with('\n') {
            text.push('\n');
        }
        text.push_str("endheader\ntime");
        for label in &self.labels {
            let _ = write!(text, "\t{}", visible(label));
        }
        text.push('\n');
        for (time, row) in self.time.iter().zip(&self.rows) {
            text.push_str(&printed(*time, precision));
            for value in row {
                text.push('\t');
                text.push_str(&printed(*value, precision));
            }
            text.push('\n');
        }
        text
    }
}
