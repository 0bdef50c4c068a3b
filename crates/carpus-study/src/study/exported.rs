//! A file as a recorder exports it, all of it: for those who have to find out what is in it.

use std::path::Path;

use super::dialect::{Dialect, is_time_name};
use super::fault::Fault;
use super::limits::MIN_SAMPLES;
use super::problem::{Problem, StudyErrors};
use super::recording_file::{Format, Recording};

/// The columns of a table of a file, in the file's units.
#[derive(Clone, Debug, PartialEq)]
pub struct Exported {
    /// The format of the file.
    pub format: Format,
    /// What tells the table from others of the file; `None` where it is the only one.
    pub table: Option<String>,
    /// How the file is laid out, if it is text.
    pub dialect: Dialect,
    /// Names of the columns; of several columns of time with one name, all but the first have a number.
    pub names: Vec<String>,
    /// Units of a line below the names, or as the format has them; empty where there are none.
    pub units: Vec<String>,
    /// Samples of every column; NaN where a cell is empty or no number.
    pub columns: Vec<Vec<f64>>,
}

impl Exported {
    /// Reads every table of a file that has samples enough.
    ///
    /// # Errors
    /// The file cannot be read, or has no table of numbers below a line of names.
    pub fn read(path: &Path) -> Result<Vec<Exported>, StudyErrors> {
        let mut problems = Vec::new();
        let mut found = Vec::new();
        let mut most = 0;
        for (table, recording) in Recording::all(path, &mut problems) {
            let Some(exported) = Self::of(table, recording, path, &mut problems) else { continue };
            let numbers = |samples: &Vec<f64>| samples.iter().filter(|x| x.is_finite()).count();
            let samples = exported.columns.iter().map(numbers).max().unwrap_or(0);
            most = most.max(samples);
            if samples >= MIN_SAMPLES {
                found.push(exported);
            }
        }
        if found.is_empty() && problems.is_empty() {
            problems.push(Problem::error(path, None, Fault::TooFewSamples { found: most, expected: MIN_SAMPLES }));
        }
        if found.is_empty() {
            StudyErrors::settle(problems)?;
        }
        Ok(found)
    }

    fn of(
        table: Option<String>,
        mut recording: Recording,
        path: &Path,
        problems: &mut Vec<Problem>,
    ) -> Option<Exported> {
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); recording.names.len()];
        while recording.next(path, problems)? {
            for (i, samples) in columns.iter_mut().enumerate() {
                samples.push(recording.number(i).unwrap_or(f64::NAN));
            }
        }
        let Recording { names, format, dialect, .. } = recording;
        let units = dialect.units.clone();
        Some(Exported { format, table, dialect, names, units, columns })
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
