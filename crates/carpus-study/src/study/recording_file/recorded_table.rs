//! A table of numbers as a file holds it.

use std::collections::HashMap;

#[cfg(feature = "recordings")]
use crate::study::dialect::{is_time_name, unique_names};

/// Named columns of numbers, all of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RecordedTable {
    /// What tells it from other tables of the file: the sheet, the variable, the sampling rate.
    pub title: String,
    /// Names of the columns.
    pub names: Vec<String>,
    /// Units of the columns, as the file has them; empty where it has none.
    pub units: Vec<String>,
    /// Samples of every column; NaN where there is none.
    pub columns: Vec<Vec<f64>>,
    /// Cells that hold something else than a number, by row and column.
    pub words: HashMap<(usize, usize), String>,
    /// Place of every row in the file, counted from 1: the row of the sheet, the number of the sample.
    pub places: Vec<usize>,
}

impl RecordedTable {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.columns.iter().map(Vec::len).max().unwrap_or(0)
    }
}

/// How the formats make tables.
#[cfg(feature = "recordings")]
impl RecordedTable {
    /// A table without rows.
    pub fn new(title: &str) -> RecordedTable {
        RecordedTable { title: title.to_owned(), ..RecordedTable::default() }
    }

    /// Adds a column.
    pub fn push(&mut self, name: &str, unit: &str, samples: Vec<f64>) {
        self.names.push(name.trim().to_owned());
        self.units.push(unit.trim().to_owned());
        self.columns.push(samples);
    }

    /// Numbers rows by their samples, and tells columns of one name apart.
    pub fn finished(mut self) -> RecordedTable {
        let rows = self.rows();
        self.columns.iter_mut().for_each(|column| column.resize(rows, f64::NAN));
        if self.places.is_empty() {
            self.places = (1..=rows).collect();
        }
        unique_names(&mut self.names);
        self
    }

    /// Whether a column holds times.
    pub fn has_time(&self) -> bool {
        self.names.iter().any(|name| is_time_name(name))
    }

    /// Puts a column of times in front, of samples at equal steps from 0.
    ///
    /// - `rate`: samples per second [Hz]
    pub fn with_rate(mut self, rate: f64) -> RecordedTable {
        let times = (0..self.rows()).map(|i| i as f64 / rate).collect();
        self.names.insert(0, "time_s".to_owned());
        self.units.insert(0, "s".to_owned());
        self.columns.insert(0, times);
        self.words = self.words.into_iter().map(|((row, column), text)| ((row, column + 1), text)).collect();
        self
    }
}
