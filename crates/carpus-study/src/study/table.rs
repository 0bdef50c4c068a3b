//! CSV tables with a header, with the line of every row.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};

use super::dialect::{Dialect, is_time_name, unique_names};
use super::fault::Fault;
use super::lines::{Lines, text_of};
use super::nearest::nearest;
use super::problem::Problem;
use carpus_numerics::plausible::Plausible;
use carpus_numerics::printable::{cell_text, deceptive_in};

/// A streaming reader of CSV whose records know their line.
pub(crate) type CsvReader = csv::Reader<Lines<BufReader<File>>>;

/// Largest number in a study: what exceeds it is a code for a missing value or a damaged file, and its powers overflow.
const LARGEST_NUMBER: f64 = 1e12;

/// Whether a file of a study can hold this number.
pub fn is_of_a_study(number: f64) -> bool {
    number.abs() <= LARGEST_NUMBER
}

/// The file that a study names, relative to the study's folder. Backslashes separate folders as they do on Windows,
/// except where there is a file whose very name has them.
pub fn named_file(folder: &Path, written: &str) -> PathBuf {
    let literal = folder.join(written);
    if !written.contains('\\') || literal.exists() { literal } else { folder.join(written.replace('\\', "/")) }
}

/// Bytes at the beginning of a recording that its layout is found in.
const HEAD: u64 = 1 << 18;

/// The layout of a file that can be read; `None` where it has no table of numbers.
///
/// - `expected`: a column that a CSV file with its header on the first line has
pub(crate) fn layout_of(path: &Path, expected: Option<&str>) -> Option<Dialect> {
    if !std::fs::metadata(path).ok()?.is_file() {
        return None;
    }
    let mut bytes = Vec::new();
    File::open(path).ok()?.take(HEAD).read_to_end(&mut bytes).ok()?;
    let text = text_of(&bytes[..bytes.iter().rposition(|b| *b == b'\n').map_or(bytes.len(), |last| last + 1)]);
    let first = text.trim_start_matches('\u{feff}').lines().find(|line| !line.trim().is_empty())?;
    let names = |name: &str| first.split(',').any(|cell| cell_text(cell.trim().trim_matches('"')) == name);
    if expected.is_some_and(names) { None } else { Dialect::of(&text) }
}

/// Opens a CSV file and reads its header; problems with either are reported.
pub(crate) fn open(
    path: &Path,
    what: &'static str,
    named_at: Option<&str>,
    problems: &mut Vec<Problem>,
) -> Option<(CsvReader, Vec<String>)> {
    open_as(path, what, named_at, &Dialect::plain(), false, problems)
}

/// Opens a text file of this layout and reads its header; problems with either are reported. Columns of time may have
/// one name, as those of Delsys' channels: all but the first get a number.
///
/// - `is_export`: whether the layout is a recorder's
pub(crate) fn open_as(
    path: &Path,
    what: &'static str,
    named_at: Option<&str>,
    dialect: &Dialect,
    is_export: bool,
    problems: &mut Vec<Problem>,
) -> Option<(CsvReader, Vec<String>)> {
    // Opening a pipe waits for its writer, and a device never ends: the kind is looked at before.
    let regular = std::fs::metadata(path).map(|found| found.is_file() || found.is_dir());
    if matches!(regular, Ok(false)) {
        problems.push(Problem::error(path, None, Fault::NotRegular { what }));
        return None;
    }
    let file = match File::open(path)
        .and_then(|file| if file.metadata()?.is_dir() { Err(ErrorKind::IsADirectory.into()) } else { Ok(file) })
    {
        Ok(file) => file,
        Err(error) => {
            problems.push(Problem::error(path, None, file_fault(&error, what, named_at)));
            return None;
        }
    };
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(dialect.separator.byte())
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(Lines::of_dialect(BufReader::new(file), dialect.clone()));
    let mut header = match reader.headers() {
        Ok(header) => {
            let name = |name: &str| cell_text(name.trim_start_matches('\u{feff}')).to_owned();
            header.iter().map(name).collect::<Vec<_>>()
        }
        Err(error) => {
            problems.push(csv_problem(path, &error));
            return None;
        }
    };
    if is_export {
        number_times(&mut header);
    }
    let before = problems.len();
    if header.iter().all(String::is_empty) {
        problems.push(Problem::error(path, None, Fault::Empty { what }));
    } else if let Some(found) = other_than_a_table(&header) {
        problems.push(Problem::error(path, 1, Fault::NotATable { found, what }));
    } else if let [only] = header.as_slice() {
        let separator = [(';', "semicolons"), ('\t', "tabs")].into_iter().find(|(c, _)| only.contains(*c));
        if let Some((_, found)) = separator {
            problems.push(Problem::error(path, 1, Fault::Separator { found }));
        }
    }
    if problems.len() == before {
        report_deceptive(&header, path, problems);
    }
    report_repeated(&header, path, problems);
    (problems.len() == before).then_some((reader, header))
}

/// Reports a name of a column that does not show as what it is.
pub(crate) fn report_deceptive(header: &[String], path: &Path, problems: &mut Vec<Problem>) {
    if let Some(character) = header.iter().find_map(|name| deceptive_in(name)) {
        let place = "a name in the header".to_owned();
        problems.push(Problem::error(path, 1, Fault::DeceptiveCharacter { place, character }));
    }
}

/// Reports columns of one name.
pub(crate) fn report_repeated(header: &[String], path: &Path, problems: &mut Vec<Problem>) {
    for (i, column) in header.iter().enumerate() {
        if header[..i].contains(column) {
            problems.push(Problem::error(path, 1, Fault::DuplicateColumn { column: column.clone() }));
        }
    }
}

/// Gives columns of time that share a name numbers.
pub(crate) fn number_times(header: &mut [String]) {
    let repeated: Vec<usize> = (0..header.len()).filter(|i| is_time_name(&header[*i])).collect();
    let mut names: Vec<String> = repeated.iter().map(|i| header[*i].clone()).collect();
    unique_names(&mut names);
    repeated.into_iter().zip(names).for_each(|(i, name)| header[i] = name);
}

/// What a file is whose first line is no header of a table.
fn other_than_a_table(header: &[String]) -> Option<&'static str> {
    let first = header.first()?;
    let starts = |with: &[&str]| with.iter().any(|text| first.starts_with(text));
    match header {
        _ if starts(&["<?xml", "<OpenSimDocument", "<!--"]) => Some("this is XML, as a model or a setup"),
        _ if starts(&["<!DOCTYPE", "<html"]) => Some("this is a page"),
        [_] if starts(&["[", "{"]) => Some("this is a file of settings"),
        _ => None,
    }
}

/// The fault for a file that could not be read.
pub fn file_fault(error: &std::io::Error, what: &'static str, named_at: Option<&str>) -> Fault {
    match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => {
            Fault::MissingFile { what, named_at: named_at.map(str::to_owned) }
        }
        _ => Fault::Unreadable { what, reason: error.to_string() },
    }
}

/// Reads the next row; rows of separators alone, as spreadsheets leave them at the end, are passed over. `false` behind
/// the last one; `None` where it cannot be read.
pub(crate) fn next_row<R: std::io::Read>(
    reader: &mut csv::Reader<R>,
    record: &mut csv::StringRecord,
    file: &Path,
    problems: &mut Vec<Problem>,
) -> Option<bool> {
    loop {
        match reader.read_record(record) {
            Ok(true) if record.iter().all(str::is_empty) => {}
            Ok(is_row) => return Some(is_row),
            Err(error) => {
                problems.push(csv_problem(file, &error));
                return None;
            }
        }
    }
}

/// The problem for a record that could not be read.
pub(crate) fn csv_problem(path: &Path, error: &csv::Error) -> Problem {
    let line = error.position().map(|p| p.line() as usize);
    let fault = match error.kind() {
        csv::ErrorKind::Utf8 { .. } => Fault::NotText,
        csv::ErrorKind::Io(error) => Fault::Unreadable { what: "file", reason: error.to_string() },
        other => Fault::CsvSyntax { message: format!("{other:?}") },
    };
    Problem::error(path, line, fault)
}

/// A small table held in memory.
pub(crate) struct Table {
    /// The file.
    pub file: PathBuf,
    /// Column names.
    pub header: Vec<String>,
    rows: Vec<(usize, csv::StringRecord)>,
}

impl Table {
    /// Reads a table whole.
    pub fn read(path: &Path, what: &'static str, named_at: Option<&str>, problems: &mut Vec<Problem>) -> Option<Table> {
        let (mut reader, header) = open(path, what, named_at, problems)?;
        let before = problems.len();
        let mut rows = Vec::new();
        for record in reader.records() {
            match record {
                Ok(record) if record.iter().all(str::is_empty) => {} // a row of separators, as spreadsheets leave
                Ok(record) => {
                    let line = record.position().map_or(0, |p| p.line() as usize);
                    if record.len() == header.len() {
                        let found = header.iter().zip(&record).find_map(|(c, text)| Some((c, deceptive_in(text)?)));
                        if let Some((column, character)) = found {
                            let place = format!("column `{column}`");
                            problems.push(Problem::error(path, line, Fault::DeceptiveCharacter { place, character }));
                        } else {
                            rows.push((line, record));
                        }
                    } else {
                        let fault = Fault::FieldCount { expected: header.len(), found: record.len(), more: 0 };
                        problems.push(Problem::error(path, line, fault));
                    }
                }
                Err(error) => {
                    problems.push(csv_problem(path, &error));
                    break;
                }
            }
        }
        if rows.is_empty() && problems.len() == before {
            problems.push(Problem::error(path, None, Fault::Empty { what }));
        }
        Some(Table { file: path.to_owned(), header, rows })
    }

    /// Reports required columns that are absent and columns that `is_known` does not know. False if a required one
    /// is absent, so that rows need not be read.
    pub fn check_columns(
        &self,
        required: &[(&str, &str)],
        known: &[&str],
        is_known: impl Fn(&str) -> bool,
        problems: &mut Vec<Problem>,
    ) -> bool {
        let mut complete = true;
        for (column, meaning) in required {
            if !self.header.iter().any(|c| c == column) {
                complete = false;
                problems.push(Problem::error(&self.file, 1, missing_column(column, meaning, &self.header)));
            }
        }
        for column in self.header.iter().filter(|c| !is_known(c)) {
            let fault = Fault::UnknownColumn {
                column: column.clone(),
                known: known.iter().map(|k| (*k).to_owned()).collect(),
                nearest: nearest(column, known.iter().copied()),
                in_trial: false,
            };
            problems.push(Problem::error(&self.file, 1, fault));
        }
        complete
    }

    /// The rows.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|(line, record)| Row { file: &self.file, header: &self.header, line: *line, record })
    }
}

/// The fault for a column that is not there.
pub(crate) fn missing_column(column: &str, meaning: &str, present: &[String]) -> Fault {
    Fault::MissingColumn {
        column: column.to_owned(),
        meaning: meaning.to_owned(),
        present: present.to_vec(),
        nearest: nearest(column, present.iter().map(String::as_str)),
    }
}

/// One row of a table.
pub(crate) struct Row<'t> {
    /// The file.
    pub file: &'t Path,
    /// Column names.
    pub header: &'t [String],
    /// Line, counted from 1.
    pub line: usize,
    /// The cells.
    pub record: &'t csv::StringRecord,
}

impl<'t> Row<'t> {
    /// Reports a fault of this row.
    pub fn error(&self, fault: Fault, problems: &mut Vec<Problem>) {
        problems.push(Problem::error(self.file, self.line, fault));
    }

    /// Reports something doubtful in this row.
    pub fn warning(&self, fault: Fault, problems: &mut Vec<Problem>) {
        problems.push(Problem::warning(self.file, self.line, fault));
    }

    /// Reports a value that is outside its plausible range.
    pub fn warn_of(&self, column: &str, value: f64, plausible: &'static Plausible, problems: &mut Vec<Problem>) {
        if let Some(doubt) = plausible.doubt(value) {
            self.warning(Fault::Implausible { name: format!("column `{column}`"), doubt }, problems);
        }
    }

    /// The text of a cell; `None` if the column is absent or the cell empty.
    pub fn text(&self, column: &str) -> Option<&'t str> {
        let index = self.header.iter().position(|c| c == column)?;
        self.record.get(index).map(cell_text).filter(|text| !text.is_empty())
    }

    /// The text of a cell that must not be empty.
    pub fn required(&self, column: &str, expected: &'static str, problems: &mut Vec<Problem>) -> Option<&'t str> {
        let text = self.text(column);
        if text.is_none() {
            self.bad(column, expected, "", problems);
        }
        text
    }

    /// A number of a size that a study can hold and that passes `valid`; `None` if empty or (reported) bad.
    pub fn number(
        &self,
        column: &str,
        expected: &'static str,
        valid: impl Fn(f64) -> bool,
        problems: &mut Vec<Problem>,
    ) -> Option<f64> {
        let text = self.text(column)?;
        let number = text.parse().ok().filter(|v| is_of_a_study(*v) && valid(*v));
        if number.is_none() {
            self.bad(column, expected, text, problems);
        }
        number
    }

    /// A word of a closed list (case does not count); `None` if empty or (reported) unknown.
    pub fn word<T: Copy>(
        &self,
        column: &str,
        what: &'static str,
        words: &[(&str, T)],
        problems: &mut Vec<Problem>,
    ) -> Option<T> {
        let text = self.text(column)?;
        let found = words.iter().find(|(word, _)| word.eq_ignore_ascii_case(text)).map(|(_, value)| *value);
        if found.is_none() {
            let fault = Fault::UnknownWord {
                key: column.to_owned(),
                what,
                found: text.chars().take(40).collect(),
                known: words.iter().map(|(word, _)| (*word).to_owned()).filter(|w| w.len() > 1).collect(),
                nearest: nearest(text, words.iter().map(|(word, _)| *word).filter(|w| w.len() > 1)),
            };
            self.error(fault, problems);
        }
        found
    }

    /// Reports a cell.
    pub fn bad(&self, column: &str, expected: &'static str, found: &str, problems: &mut Vec<Problem>) {
        let fault = Fault::BadNumber { column: column.to_owned(), expected, found: found.to_owned(), more: 0 };
        self.error(fault, problems);
    }
}
