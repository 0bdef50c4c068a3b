//! Recordings in files of any format: one way in for all that reads samples.
//!
//! In: a file, and which of its tables is meant. Out: a [`Recording`], whose rows are read one after the other. Text is
//! streamed; every other format has a file here that makes [`RecordedTable`]s of bytes. A file with several tables
//! (sheets of a workbook, structs of a `.mat` file, sampling rates, blocks of a text) has one chosen by its title or
//! number, or else by the columns that are looked for.
//!
//! Without the feature `recordings` text alone is read.

mod blocks;
#[cfg(feature = "recordings")]
mod c3d;
#[cfg(feature = "recordings")]
mod edf;
pub(super) mod error;
mod format;
#[cfg(feature = "recordings")]
mod matlab;
mod recognize;
mod recorded_table;
mod text;
#[cfg(feature = "recordings")]
mod workbook;

use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::dialect::Dialect;
use super::fault::Fault;
use super::nearest::nearest;
use super::problem::Problem;
use super::table::{CsvReader, layout_of, next_row, number_times, open_as, report_deceptive, report_repeated};
pub use error::RecordingFileError;
pub use format::Format;
use recognize::{HEAD, format_of};
use recorded_table::RecordedTable;
use text::TextTable;

/// Most bytes of a file that is no text: two gigabytes.
#[cfg(feature = "recordings")]
const MOST_BYTES: u64 = 1 << 31;

/// A file, and what it is read for.
#[derive(Clone, Copy)]
pub(crate) struct Source<'s> {
    /// The file.
    pub path: &'s Path,
    /// The table, by title or number; `None`: the one that has the columns that are looked for.
    pub table: Option<&'s str>,
    /// Columns that are looked for.
    pub columns: &'s [&'s str],
    /// What the file is, for messages.
    pub what: &'static str,
    /// `file:line` that names it.
    pub named_at: Option<&'s str>,
    /// The column of trials.csv that says which table is meant.
    pub key: &'static str,
}

/// A recording that is being read, row by row.
pub(crate) struct Recording {
    /// Names of the columns; of several columns of time with one name, all but the first have a number.
    pub names: Vec<String>,
    /// The format of the file.
    pub format: Format,
    /// How a text is laid out; of other formats, their units.
    pub dialect: Dialect,
    rows: Rows,
}

enum Rows {
    Text { reader: Box<CsvReader>, record: csv::StringRecord },
    Table { table: RecordedTable, next: usize },
}

impl Recording {
    /// Opens a file and finds the table; problems with either are reported.
    pub fn open(source: &Source<'_>, problems: &mut Vec<Problem>) -> Option<Recording> {
        match format_of(source.path, &head(source.path)) {
            Ok(Format::Text) => Self::text(source, problems),
            Ok(format) => {
                let of = |wanted: Option<&str>| {
                    let mut tables = tables(source.path, format, wanted)?;
                    let titles: Vec<String> = tables.iter().map(|table| table.title.clone()).collect();
                    let names: Vec<&[String]> = tables.iter().map(|table| table.names.as_slice()).collect();
                    choose(source, &titles, &names).map(|chosen| tables.swap_remove(chosen))
                };
                // A table that is named is read without the others; a number counts all of them.
                let alone = source.table.map(str::trim).filter(|title| title.parse::<usize>().is_err());
                let found = alone.and_then(|title| of(Some(title)).ok()).map_or_else(|| of(None), Ok);
                Self::of_table(source.path, format, failed(source.path, found, problems)?, problems)
            }
            Err(error) => failed(source.path, Err(error), problems),
        }
    }

    /// Every table of a file, with its title; `None` for that of a file with one table.
    pub fn all(path: &Path, problems: &mut Vec<Problem>) -> Vec<(Option<String>, Recording)> {
        let source = Source { path, table: None, columns: &[], what: "recording", named_at: None, key: "table" };
        let format = match format_of(path, &head(path)) {
            Ok(format) => format,
            Err(error) => {
                failed::<()>(path, Err(error), problems);
                return Vec::new();
            }
        };
        if format == Format::Text {
            let several = layout_of(path, None).and_then(|first| text::several(path, &first));
            let Some(tables) = several else {
                return Self::text(&source, problems).map(|recording| (None, recording)).into_iter().collect();
            };
            let titles = titles(&tables);
            let open = |(title, table): (String, TextTable)| {
                Some((Some(title), Self::of_text(&source, table.dialect, true, problems)?))
            };
            return titles.into_iter().zip(tables).filter_map(open).collect();
        }
        let tables = failed(path, tables(path, format, None), problems).unwrap_or_default();
        let is_alone = tables.len() == 1;
        let open = |table: RecordedTable| {
            let title = (!is_alone).then(|| table.title.clone());
            Some((title, Self::of_table(path, format, table, problems)?))
        };
        tables.into_iter().filter_map(open).collect()
    }

    fn text(source: &Source<'_>, problems: &mut Vec<Problem>) -> Option<Recording> {
        // The first column that is looked for tells a plain file.
        let found = layout_of(source.path, source.columns.first().copied());
        let plain = Dialect::plain();
        let several = text::several(source.path, found.as_ref().unwrap_or(&plain));
        if several.is_none() && source.table.is_none_or(|table| table.trim() == "1") {
            return Self::of_text(source, found.clone().unwrap_or(plain), found.is_some(), problems);
        }
        let tables = several.unwrap_or_default();
        let names: Vec<&[String]> = tables.iter().map(|table| table.names.as_slice()).collect();
        let chosen = failed(source.path, choose(source, &titles(&tables), &names), problems)?;
        Self::of_text(source, tables.into_iter().nth(chosen)?.dialect, true, problems)
    }

    fn of_text(
        source: &Source<'_>,
        dialect: Dialect,
        is_export: bool,
        problems: &mut Vec<Problem>,
    ) -> Option<Recording> {
        let (reader, names) = open_as(source.path, source.what, source.named_at, &dialect, is_export, problems)?;
        let rows = Rows::Text { reader: Box::new(reader), record: csv::StringRecord::new() };
        Some(Recording { names, format: Format::Text, dialect, rows })
    }

    fn of_table(path: &Path, format: Format, table: RecordedTable, problems: &mut Vec<Problem>) -> Option<Recording> {
        let mut names = table.names.clone();
        number_times(&mut names);
        let before = problems.len();
        report_deceptive(&names, path, problems);
        report_repeated(&names, path, problems);
        let has_units = table.units.iter().any(|unit| !unit.is_empty());
        let units = if has_units { table.units.clone() } else { Vec::new() };
        let dialect = Dialect { units, header_line: 1, ..Dialect::default() };
        (problems.len() == before).then_some(Recording { names, format, dialect, rows: Rows::Table { table, next: 0 } })
    }

    /// Goes on to the next row; `false` behind the last one, `None` where it cannot be read, which is reported.
    pub fn next(&mut self, path: &Path, problems: &mut Vec<Problem>) -> Option<bool> {
        match &mut self.rows {
            Rows::Text { reader, record } => next_row(reader, record, path, problems),
            Rows::Table { table, next } => {
                *next += 1;
                Some(*next <= table.rows())
            }
        }
    }

    /// Line of a text, row of a sheet, or number of the sample.
    pub fn place(&self) -> usize {
        match &self.rows {
            Rows::Text { record, .. } => record.position().map_or(0, |p| p.line() as usize),
            Rows::Table { table, next } => table.places.get(next.saturating_sub(1)).copied().unwrap_or(0),
        }
    }

    /// How many cells the row has.
    pub fn cells(&self) -> usize {
        match &self.rows {
            Rows::Text { record, .. } => record.len(),
            Rows::Table { table, .. } => table.columns.len(),
        }
    }

    /// The number in a cell of the row.
    pub fn number(&self, column: usize) -> Option<f64> {
        match &self.rows {
            Rows::Text { record, .. } => record.get(column).and_then(|text| self.dialect.number(text)),
            Rows::Table { table, next } => {
                let samples = table.columns.get(column)?;
                samples.get(next.checked_sub(1)?).copied().filter(|v| v.is_finite())
            }
        }
    }

    /// The text in a cell of the row.
    pub fn text_of(&self, column: usize) -> Cow<'_, str> {
        match &self.rows {
            Rows::Text { record, .. } => Cow::Borrowed(record.get(column).unwrap_or("")),
            Rows::Table { table, next } => {
                let row = next.saturating_sub(1);
                let word = table.words.get(&(row, column)).map(|word| Cow::Borrowed(word.as_str()));
                word.unwrap_or_else(|| self.number(column).map_or(Cow::Borrowed(""), |v| Cow::Owned(v.to_string())))
            }
        }
    }

    /// Whether a cell of the row is empty.
    pub fn is_empty(&self, column: usize) -> bool {
        self.text_of(column).is_empty()
    }
}

/// Titles of tables of a text: the lines above them where those differ, else numbers.
fn titles(tables: &[TextTable]) -> Vec<String> {
    let own = |i: usize| {
        let title = &tables[i].title;
        !title.is_empty() && tables.iter().filter(|other| other.title == *title).count() == 1
    };
    let is_told = (0..tables.len()).all(own);
    let title = |(i, table): (usize, &TextTable)| if is_told { table.title.clone() } else { (i + 1).to_string() };
    tables.iter().enumerate().map(title).collect()
}

/// The table that is meant.
///
/// - `names`: of the columns of every table
fn choose(source: &Source<'_>, titles: &[String], names: &[&[String]]) -> Result<usize, RecordingFileError> {
    if let Some(wanted) = source.table.map(str::trim) {
        let exact = titles.iter().position(|title| title.trim() == wanted);
        let near = || titles.iter().position(|title| title.trim().eq_ignore_ascii_case(wanted));
        let numbered = || wanted.parse::<usize>().ok().and_then(|n| n.checked_sub(1)).filter(|i| *i < titles.len());
        return exact.or_else(near).or_else(numbered).ok_or_else(|| RecordingFileError::NoSuchTable {
            wanted: wanted.to_owned(),
            present: if titles.is_empty() { vec!["1".to_owned()] } else { titles.to_vec() },
            nearest: nearest(wanted, titles.iter().map(String::as_str)),
        });
    }
    if titles.len() == 1 {
        return Ok(0);
    }
    let has_all = |i: &usize| source.columns.iter().all(|wanted| names[*i].iter().any(|name| name == wanted));
    let fitting: Vec<usize> = (0..titles.len()).filter(has_all).collect();
    match fitting[..] {
        [only] => Ok(only),
        [] => Err(RecordingFileError::NoTableWith {
            wanted: source.columns.iter().map(|name| (*name).to_owned()).collect(),
            present: titles.iter().zip(names).map(|(title, names)| format!("{title}: {}", names.join(", "))).collect(),
        }),
        _ => Err(RecordingFileError::SeveralTables {
            fitting: fitting.iter().map(|i| titles[*i].clone()).collect(),
            key: source.key,
        }),
    }
}

/// The first bytes of a file; none of what cannot be read, which is told when it is opened.
fn head(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    if std::fs::metadata(path).is_ok_and(|found| found.is_file())
        && let Ok(file) = File::open(path)
    {
        // What cannot be read is told when the file is opened.
        let _ = file.take(HEAD as u64 + 8).read_to_end(&mut bytes);
    }
    bytes
}

/// The tables of a file that is no text.
///
/// - `wanted`: title of the one that is needed; others may be left out
#[cfg(feature = "recordings")]
fn tables(path: &Path, format: Format, wanted: Option<&str>) -> Result<Vec<RecordedTable>, RecordingFileError> {
    let unreadable = |found: String| RecordingFileError::Broken {
        format,
        place: "file".to_owned(),
        expected: "a file that can be read".to_owned(),
        found,
    };
    let mut bytes = Vec::new();
    let file = carpus_numerics::regular_file::open(path).map_err(|e| unreadable(e.to_string()))?;
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(|e| unreadable(e.to_string()))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(RecordingFileError::TooLarge { format, what: "bytes", limit: MOST_BYTES as usize });
    }
    tables_of(&bytes, format, wanted)
}

/// The tables in bytes of a format.
#[cfg(feature = "recordings")]
fn tables_of(bytes: &[u8], format: Format, wanted: Option<&str>) -> Result<Vec<RecordedTable>, RecordingFileError> {
    // Titles begin with the name of the sheet or the variable.
    let is_wanted = |name: &str| {
        let begins = |title: &str| title.to_lowercase().starts_with(&name.to_lowercase());
        // Structs of one signal are columns among the variables that are in no struct.
        wanted.is_none_or(|title| begins(title) || title.to_lowercase().starts_with(matlab::TOP))
    };
    match format {
        Format::Text => Ok(Vec::new()),
        Format::Workbook => workbook::tables(bytes, &is_wanted),
        Format::Matlab => matlab::tables(bytes, &is_wanted),
        Format::Edf => edf::tables(bytes),
        Format::C3d => c3d::tables(bytes),
    }
}

/// No tables: only text is read.
#[cfg(not(feature = "recordings"))]
fn tables(_: &Path, format: Format, _: Option<&str>) -> Result<Vec<RecordedTable>, RecordingFileError> {
    let what = format!("a {}", format.words());
    Err(RecordingFileError::NotRead { what, hint: "this program was built without the feature `recordings`: give CSV" })
}

/// A result, or `None` after reporting why there is none.
fn failed<T>(path: &Path, result: Result<T, RecordingFileError>, problems: &mut Vec<Problem>) -> Option<T> {
    let report = |error| problems.push(Problem::error(path, None, Fault::Recording(error)));
    result.map_err(report).ok()
}

#[cfg(all(test, feature = "recordings"))]
mod tests;
