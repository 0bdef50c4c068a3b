//! A file as a recorder exports it, all of it: for those who have to find out what is in it.

use std::path::Path;

use super::dialect::{Dialect, is_time_name};
use super::fault::Fault;
use super::limits::MIN_SAMPLES;
use super::problem::{Problem, StudyErrors};
use super::table::{next_row, open_recording};

/// The columns of a file, in the file's units.
#[derive(Clone, Debug, PartialEq)]
pub struct Exported {
    /// How the file is laid out.
    pub dialect: Dialect,
    /// Names of the columns; of several columns of time with one name, all but the first have a number.
    pub names: Vec<String>,
    /// Units of a line below the names; empty where there is none.
    pub units: Vec<String>,
    /// Samples of every column; NaN where a cell is empty or no number.
    pub columns: Vec<Vec<f64>>,
}

impl Exported {
    /// Reads a file.
    ///
    /// # Errors
    /// The file cannot be read, or is no table of numbers below a line of names.
    pub fn read(path: &Path) -> Result<Exported, StudyErrors> {
        let mut problems = Vec::new();
        let found = Self::parts(path, &mut problems);
        StudyErrors::settle(problems)?;
        found.ok_or_else(StudyErrors::default)
    }

    fn parts(path: &Path, problems: &mut Vec<Problem>) -> Option<Exported> {
        let (mut reader, names, dialect) = open_recording(path, "recording", None, None, problems)?;
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
        let mut record = csv::StringRecord::new();
        while next_row(&mut reader, &mut record, path, problems)? {
            for (i, samples) in columns.iter_mut().enumerate() {
                samples.push(record.get(i).and_then(|text| dialect.number(text)).unwrap_or(f64::NAN));
            }
        }
        let numbers = |samples: &Vec<f64>| samples.iter().filter(|x| x.is_finite()).count();
        let most = columns.iter().map(numbers).max().unwrap_or(0);
        if most < MIN_SAMPLES {
            problems.push(Problem::error(path, None, Fault::TooFewSamples { found: most, expected: MIN_SAMPLES }));
            return None;
        }
        let units = dialect.units.clone();
        Some(Exported { dialect, names, units, columns })
    }

    /// The column of times of a column: the one at or before it, or else the first.
    pub fn clock_of(&self, column: usize) -> Option<usize> {
        let is_time = |i: &usize| is_time_name(&self.names[*i]) || self.states_time(*i);
        (0..=column).rev().find(is_time).or_else(|| (0..self.names.len()).find(is_time))
    }

    fn states_time(&self, column: usize) -> bool {
        self.units.get(column).is_some_and(|unit| matches!(unit.as_str(), "s" | "ms" | "sec" | "msec" | "mSec"))
    }
}
