//! A table of a file of recordings and what its columns are.

use std::path::PathBuf;

use super::columns::{Column, Role};
use super::piece::Piece;
use carpus_study::study::Exported;

/// A table of a file and what its columns are.
pub struct Read {
    /// The file.
    pub path: PathBuf,
    pub(super) exported: Exported,
    pub(super) columns: Vec<Column>,
}

impl Read {
    /// The table, where the file has several.
    pub fn table(&self) -> Option<&str> {
        self.exported.table.as_deref()
    }

    pub(super) fn has(&self, role: &Role) -> bool {
        self.columns.iter().any(|column| column.role == *role)
    }

    pub(super) fn has_emg(&self) -> bool {
        self.columns.iter().any(|column| matches!(column.role, Role::Emg(_)))
    }

    pub(super) fn piece(&self, role: &Role) -> Option<Piece> {
        self.columns.iter().find(|column| column.role == *role).map(Piece::of)
    }

    /// Numbers of the column of a role.
    pub fn samples(&self, role: &Role) -> Vec<f64> {
        let place = self.columns.iter().position(|column| column.role == *role);
        let samples = place.map(|i| self.exported.columns[i].as_slice()).unwrap_or_default();
        samples.iter().copied().filter(|x| x.is_finite()).collect()
    }

    /// Samples a second of a column [Hz].
    pub(super) fn rate_hz(&self, column: usize) -> f64 {
        let Some(clock) = self.exported.clock_of(column) else { return f64::NAN };
        let times: Vec<f64> = self.exported.columns[clock].iter().copied().filter(|t| t.is_finite()).collect();
        let factor = self.columns[clock].unit.map_or(1.0, |unit| unit.factor);
        let span = times.last().zip(times.first()).map_or(f64::NAN, |(last, first)| last - first);
        (times.len() as f64 - 1.0) / (factor * span)
    }

    pub(super) fn layout(&self) -> Vec<(&str, bool)> {
        let is_used = |column: &Column| !matches!(column.role, Role::Other | Role::OtherEmg);
        self.columns.iter().map(|column| (column.name.as_str(), is_used(column))).collect()
    }
}
