//! A recorder's file as it is: a time column and other columns of numbers.

use std::path::Path;

use crate::study::columns::Conversion;
use crate::study::dialect::is_time_name;
use crate::study::fault::Fault;
use crate::study::limits::MIN_SAMPLES;
use crate::study::problem::{Problem, StudyErrors};
use crate::study::recording_file::{Recording, Source};
use crate::study::table::{is_of_a_study, missing_column};
use crate::study::times::{implausible_time, median};
use carpus_numerics::plausible::{Measured, unit_in_name};

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

/// Where a column stands, and the column of its times.
struct Place {
    column: usize,
    time: usize,
}

/// Samples of a column of times and the lines they are on.
type Times = (Vec<f64>, usize);

impl Recorded {
    /// Reads columns of a file of any format; those of `required` have to be there. All have the same times.
    ///
    /// - `table`: which of the file's tables, by title or number; `None`: the one that has the required columns
    /// - `time`: the column of times; `None`: the one at or before each column that is read, in the unit that its name
    ///   states
    ///
    /// # Errors
    /// The file, missing columns, cells that are no numbers, time that does not increase, columns of different times.
    pub fn read(
        path: &Path,
        table: Option<&str>,
        named_at: Option<&str>,
        time: Option<&str>,
        required: &[&str],
        optional: &[&str],
    ) -> Result<Recorded, StudyErrors> {
        let mut problems = Vec::new();
        let found = Self::read_parts(path, table, named_at, time, required, optional, &mut problems);
        Problem::set_table(&mut problems, path, table);
        StudyErrors::settle(problems)?;
        // Nothing read and no error cannot be.
        found.ok_or_else(StudyErrors::default)
    }

    fn read_parts(
        path: &Path,
        table: Option<&str>,
        named_at: Option<&str>,
        time: Option<&str>,
        required: &[&str],
        optional: &[&str],
        problems: &mut Vec<Problem>,
    ) -> Option<Recorded> {
        let wanted: Vec<&str> = time.iter().chain(required).copied().collect();
        let source = Source { path, table, columns: &wanted, what: "recording", named_at, key: "emg_table" };
        let mut recording = Recording::open(&source, problems)?;
        let header = recording.names.clone();
        let (names, places) = places(path, &header, time, required, optional, problems)?;
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
        // Each clock once: position of its column, times.
        let mut clocks: Vec<(usize, Times)> = Vec::new();
        for place in &places {
            if !clocks.iter().any(|(column, _)| *column == place.time) {
                clocks.push((place.time, (Vec::new(), 0)));
            }
        }
        let before = problems.len();
        while recording.next(path, problems)? {
            let line = recording.place();
            if recording.cells() != header.len() {
                let fault = Fault::FieldCount { expected: header.len(), found: recording.cells(), more: 0 };
                problems.push(Problem::error(path, line, fault));
                return None;
            }
            for (column, (times, last_line)) in &mut clocks {
                // Channels of several rates stand beside each other; the slow ones end first.
                let is_over = |place: &&Place| recording.is_empty(place.column);
                let ended = recording.is_empty(*column)
                    && time.is_none()
                    && places.iter().filter(|place| place.time == *column).all(|place| is_over(&place));
                if ended {
                    continue;
                }
                if times.len() == MAX_RECORDED_SAMPLES {
                    let fault = Fault::TooManySamples { limit: MAX_RECORDED_SAMPLES };
                    problems.push(Problem::error(path, line, fault));
                    return None;
                }
                let mut number = |column: usize| {
                    let value = recording.number(column).filter(|v| is_of_a_study(*v));
                    if value.is_none() {
                        let found = recording.text_of(column).into_owned();
                        let column = header[column].clone();
                        let fault = Fault::BadNumber { column, expected: "a number", found, more: 0 };
                        problems.push(Problem::error(path, line, fault));
                    }
                    value.unwrap_or(f64::NAN)
                };
                let t = number(*column);
                for (place, samples) in places.iter().zip(&mut columns).filter(|(place, _)| place.time == *column) {
                    samples.push(number(place.column));
                }
                if let Some(last) = times.last().filter(|last| t <= **last) {
                    let fault = Fault::TimeNotIncreasing { time_s: t, before_s: *last, more: 0 };
                    problems.push(Problem::error(path, line, fault));
                    return None;
                }
                times.push(t);
                *last_line = line;
            }
            if problems.len() > before + 20 {
                return None;
            }
        }
        let mut clocks = clocks.into_iter();
        let (first, (mut times, _)) = clocks.next()?;
        for (other, (others, line)) in clocks {
            if others != times {
                let column = places.iter().position(|place| place.time == other).unwrap_or(0);
                let fault = Fault::OtherTimes { column: names[column].to_owned(), first: names[0].to_owned() };
                problems.push(Problem::error(path, line, fault));
                return None;
            }
        }
        if times.len() < MIN_SAMPLES {
            let fault = Fault::TooFewSamples { found: times.len(), expected: MIN_SAMPLES };
            problems.push(Problem::error(path, None, fault));
            return None;
        }
        if time.is_none() {
            let factor = stated_factor(&header[first], recording.dialect.units.get(first));
            times.iter_mut().for_each(|t| *t *= factor);
        }
        let columns = names.into_iter().map(str::to_owned).zip(columns).collect();
        Some(Recorded { time: times, columns })
    }

    /// Converts times and reports those that cannot be seconds.
    pub(crate) fn in_seconds(mut self, time: Conversion, path: &Path) -> Result<Recorded, StudyErrors> {
        self.time.iter_mut().for_each(|t| *t = time.of(*t));
        let steps: Vec<f64> = self.time.windows(2).map(|w| w[1] - w[0]).collect();
        let fault = implausible_time(&self.time, median(&steps));
        StudyErrors::settle(fault.map(|fault| Problem::error(path, None, fault)).into_iter().collect())?;
        Ok(self)
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

/// Names of the columns that are read and where they stand; `None` after reporting at least one that is missing.
fn places<'n>(
    path: &Path,
    header: &[String],
    time: Option<&str>,
    required: &[&'n str],
    optional: &[&'n str],
    problems: &mut Vec<Problem>,
) -> Option<(Vec<&'n str>, Vec<Place>)> {
    let before = problems.len();
    let at = |name: &str| header.iter().position(|column| column == name);
    let mut missing = |name: &str, meaning: &str| {
        problems.push(Problem::error(path, 1, missing_column(name, meaning, header)));
    };
    for name in time.iter().chain(required).filter(|name| at(name).is_none()) {
        missing(name, "a recorded quantity");
    }
    let mut names: Vec<&str> = Vec::new();
    for name in required.iter().chain(optional) {
        if !names.contains(name) && at(name).is_some() {
            names.push(name);
        }
    }
    let mut found = Vec::new();
    for column in names.iter().filter_map(|name| at(name)) {
        let own = || (0..=column).rev().find(|i| is_time_name(&header[*i]));
        let clock = time.map_or_else(own, at).or_else(|| header.iter().position(|name| is_time_name(name)));
        match clock {
            Some(time) => found.push(Place { column, time }),
            None if time.is_none() => {
                missing("time", "the times of the samples");
                break;
            }
            None => {}
        }
    }
    (problems.len() == before).then_some((names, found))
}

/// What one of the unit that a column of times states is in seconds.
fn stated_factor(name: &str, unit: Option<&String>) -> f64 {
    let of_unit = unit.filter(|unit| !unit.is_empty()).map(|unit| format!("[{unit}]"));
    let stated = unit_in_name(of_unit.as_deref().unwrap_or(name), Measured::Time);
    stated.filter(|unit| unit.of == Measured::Time).map_or(1.0, |unit| unit.factor)
}
