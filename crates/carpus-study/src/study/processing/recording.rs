//! A recorder's file as it is: a time column and other columns of numbers.

use std::path::Path;

use crate::study::fault::Fault;
use crate::study::problem::{Problem, StudyErrors};
use crate::study::table::{Row, csv_problem, missing_column, open};
use crate::study::trial_checks::{implausible_time, median};

/// Most samples of a recording as it is: an hour at 2 kHz. It is not simulated; a sample takes about 8 bytes a column
/// and file.
const MAX_RECORDED_SAMPLES: usize = 7_200_000;

/// Columns of a recording, in the file's units.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Recorded {
    /// Time \[s\], increasing.
    pub time: Vec<f64>,
    /// Name and samples of the columns asked for that are there.
    pub columns: Vec<(String, Vec<f64>)>,
}

impl Recorded {
    /// Reads columns of a CSV file; those of `required` have to be there.
    ///
    /// # Errors
    /// The file, missing columns, cells that are no numbers, time that does not increase.
    pub fn read(
        path: &Path,
        named_at: Option<&str>,
        time: &str,
        required: &[&str],
        optional: &[&str],
    ) -> Result<Recorded, StudyErrors> {
        let mut problems = Vec::new();
        let found = Self::read_parts(path, named_at, time, required, optional, &mut problems);
        StudyErrors::settle(problems)?;
        // Nothing read and no error cannot be.
        found.ok_or_else(StudyErrors::default)
    }

    fn read_parts(
        path: &Path,
        named_at: Option<&str>,
        time: &str,
        required: &[&str],
        optional: &[&str],
        problems: &mut Vec<Problem>,
    ) -> Option<Recorded> {
        let (mut reader, header) = open(path, "recording", named_at, problems)?;
        let before = problems.len();
        for name in std::iter::once(&time).chain(required) {
            if !header.iter().any(|column| column == name) {
                problems.push(Problem::error(path, 1, missing_column(name, "a recorded quantity", &header)));
            }
        }
        (problems.len() == before).then_some(())?;
        let mut names: Vec<&str> = Vec::new();
        for name in required.iter().chain(optional) {
            if !names.contains(name) && header.iter().any(|column| column == name) {
                names.push(name);
            }
        }
        let mut recorded =
            Recorded { time: Vec::new(), columns: names.iter().map(|name| ((*name).to_owned(), Vec::new())).collect() };
        let mut record = csv::StringRecord::new();
        loop {
            match reader.read_record(&mut record) {
                Ok(false) => break,
                Ok(true) => {}
                Err(error) => {
                    problems.push(csv_problem(path, &error));
                    return None;
                }
            }
            if record.iter().all(str::is_empty) {
                continue; // a row of separators, as spreadsheets leave at the end
            }
            let line = record.position().map_or(0, |p| p.line() as usize);
            let row = Row { file: path, header: &header, line, record: &record };
            if record.len() != header.len() {
                row.error(Fault::FieldCount { expected: header.len(), found: record.len(), more: 0 }, problems);
                return None;
            }
            if recorded.time.len() == MAX_RECORDED_SAMPLES {
                row.error(Fault::TooManySamples { limit: MAX_RECORDED_SAMPLES }, problems);
                return None;
            }
            let mut number = |column: &str| {
                row.required(column, "a number", problems);
                row.number(column, "a number", |_| true, problems).unwrap_or(f64::NAN)
            };
            let t = number(time);
            if let Some(last) = recorded.time.last().filter(|last| t <= **last) {
                row.error(Fault::TimeNotIncreasing { time_s: t, before_s: *last, more: 0 }, problems);
                return None;
            }
            recorded.time.push(t);
            for (name, samples) in &mut recorded.columns {
                samples.push(number(name));
            }
            if problems.len() > before + 20 {
                return None;
            }
        }
        if recorded.time.len() < crate::study::MIN_SAMPLES {
            let fault = Fault::TooFewSamples { found: recorded.time.len(), expected: crate::study::MIN_SAMPLES };
            problems.push(Problem::error(path, None, fault));
            return None;
        }
        if problems.len() == before {
            let steps: Vec<f64> = recorded.time.windows(2).map(|w| w[1] - w[0]).collect();
            let fault = implausible_time(&recorded.time, median(&steps));
            problems.extend(fault.map(|fault| Problem::error(path, None, fault)));
        }
        Some(recorded)
    }

    /// The samples of a column.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|(known, _)| known == name).map(|(_, samples)| samples.as_slice())
    }

    /// Samples per second over the whole recording \[Hz\].
    pub fn mean_rate_hz(&self) -> f64 {
        let span = self.time.last().zip(self.time.first()).map_or(0.0, |(last, first)| last - first);
        (self.time.len() as f64 - 1.0) / span
    }
}
