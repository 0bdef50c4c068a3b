//! Tables in a text file: one, or several one below the other, each with its own line of names.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use super::blocks::{Row, RowKind, blocks};
use crate::study::dialect::Dialect;
use crate::study::lines::text_of;

/// Lines of words from which on a file is not looked through: a table with a word in every row is one table.
const MOST_LINES_OF_WORDS: usize = 20_000;

/// A table of a text file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TextTable {
    /// The line above its names.
    pub title: String,
    /// Names of its columns.
    pub names: Vec<String>,
    /// Where it is and how it is laid out.
    pub dialect: Dialect,
}

/// The tables of a text file that has more than one.
///
/// - `first`: the layout of the first one
pub(super) fn several(path: &Path, first: &Dialect) -> Option<Vec<TextTable>> {
    let rows = rows(path, first)?;
    let found = blocks(&rows);
    if found.len() < 2 {
        return None;
    }
    let line_of = |row: usize| rows[row].place;
    let table = |block: &super::blocks::Block| {
        let last = &rows[block.rows.end - 1];
        let dialect = Dialect {
            header_line: line_of(block.header),
            units_line: block.units_row.map(line_of),
            last_line: Some(last.place + last.count - 1),
            above: vec![block.title.clone()],
            units: block.units.clone(),
            ..first.clone()
        };
        TextTable { title: block.title.clone(), names: block.names.clone(), dialect }
    };
    Some(found.iter().map(table).collect())
}

/// The lines of a file that are not blank, rows of numbers together.
fn rows(path: &Path, dialect: &Dialect) -> Option<Vec<Row>> {
    // Devices have no end, pipes are read once: what they are is told when the file is opened.
    if !std::fs::metadata(path).ok()?.is_file() {
        return None;
    }
    let mut source = BufReader::with_capacity(1 << 16, File::open(path).ok()?);
    let mut rows: Vec<Row> = Vec::new();
    let (mut line, mut place, mut words) = (Vec::new(), 0, 0);
    loop {
        line.clear();
        if source.read_until(b'\n', &mut line).ok()? == 0 {
            return Some(rows);
        }
        place += 1;
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        if line.iter().all(|byte| is_of_numbers(*byte)) {
            match rows.last_mut() {
                Some(Row { kind: RowKind::Numbers, count, place: first, .. }) if *first + *count == place => {
                    *count += 1
                }
                _ => {
                    let cells = dialect.separator.cells(&text_of(&line));
                    let n = cells.len();
                    // One number alone is about the recording: a rate, a date.
                    let kind = if n < 2 { RowKind::Words(cells) } else { RowKind::Numbers };
                    rows.push(Row { place, count: 1, kind, cells: Some(n) });
                }
            }
            continue;
        }
        words += 1;
        if words > MOST_LINES_OF_WORDS {
            return None;
        }
        let text = text_of(&line);
        let cells = dialect.separator.cells(text.trim_start_matches('\u{feff}').trim_end_matches(['\r', '\n']));
        rows.push(Row { place, count: 1, cells: Some(cells.len()), kind: RowKind::Words(cells) });
    }
}

/// Whether a line of numbers, between any separators, may have this byte.
fn is_of_numbers(byte: u8) -> bool {
    byte.is_ascii_digit()
        || byte.is_ascii_whitespace()
        || matches!(byte, b'+' | b'-' | b'.' | b',' | b';' | b'"' | b'e' | b'E')
}
