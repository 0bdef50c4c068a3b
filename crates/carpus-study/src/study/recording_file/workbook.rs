//! Workbooks of Excel, `.xlsx`: the tables of numbers on their sheets.
//!
//! In: bytes of a workbook. Out: a table for every block of rows of numbers below a row of names. Lines above it, a row
//! of units and decimal commas are treated as in a text file; formulas are what they were when the file was saved.

use std::io::Cursor;

use calamine::{Data, DataRef, Reader, Xlsx};

use super::blocks::{Block, Row, RowKind, blocks};
use super::error::RecordingFileError;
use super::format::Format;
use super::recorded_table::RecordedTable;
use crate::study::dialect::number_of;
use crate::study::limits::MIN_SAMPLES;

/// Most cells of a workbook that are read: sixteen columns of a million samples.
const MOST_CELLS: usize = 1 << 24;
/// Most columns of a sheet, as Excel has them.
const MOST_COLUMNS: usize = 1 << 14;
/// Most bytes of a workbook once unpacked.
const MOST_BYTES: u64 = 1 << 30;
/// Seconds of a day: times of day are parts of one.
const DAY: f64 = 86_400.0;

/// A cell that is not empty.
enum Cell {
    Number(f64),
    Word(String),
}

/// The tables of a file.
///
/// # Errors
/// Bytes that are no workbook; no table; too much.
pub fn tables(bytes: &[u8]) -> Result<Vec<RecordedTable>, RecordingFileError> {
    check_size(bytes)?;
    let mut workbook: Xlsx<_> = Xlsx::new(Cursor::new(bytes)).map_err(|e| broken("workbook", "an .xlsx file", e))?;
    let sheets: Vec<String> = workbook.sheet_names();
    let mut tables = Vec::new();
    let mut count = 0;
    for sheet in &sheets {
        let rows = rows(&mut workbook, sheet, &mut count)?;
        let kinds: Vec<Row> = rows.iter().map(|(place, cells)| kind(*place, cells)).collect();
        let found = blocks(&kinds);
        let is_alone = found.len() == 1;
        for (i, block) in found.iter().enumerate() {
            let title = if is_alone { sheet.clone() } else { format!("{sheet}, table {}", i + 1) };
            tables.push(table(title, &rows, block));
        }
    }
    if tables.is_empty() {
        let found = format!("the sheets {}", sheets.iter().take(12).cloned().collect::<Vec<_>>().join(", "));
        return Err(RecordingFileError::NoTable { format: Format::Workbook, rows: MIN_SAMPLES, found });
    }
    Ok(tables)
}

/// Rows of a sheet that have cells: number of the row, from 1, and cells by column.
type Rows = Vec<(usize, Vec<Option<Cell>>)>;

fn rows(workbook: &mut Xlsx<Cursor<&[u8]>>, sheet: &str, count: &mut usize) -> Result<Rows, RecordingFileError> {
    let mut rows: Rows = Vec::new();
    // Sheets of diagrams have no cells.
    let Ok(mut reader) = workbook.worksheet_cells_reader(sheet) else { return Ok(rows) };
    loop {
        let place = || match rows.last() {
            Some((row, _)) => format!("sheet `{sheet}`, after row {row}"),
            None => format!("sheet `{sheet}`"),
        };
        let Some(cell) = reader.next_cell().map_err(|e| broken(&place(), "a cell", e))? else { break };
        let (row, column) = cell.get_position();
        let (row, column) = (row as usize + 1, column as usize);
        let value = match cell.get_value() {
            DataRef::Int(v) => Cell::Number(*v as f64),
            DataRef::Float(v) => Cell::Number(*v),
            DataRef::DateTime(v) => Cell::Number(v.as_f64() * DAY),
            DataRef::String(text) => Cell::Word(text.trim().to_owned()),
            DataRef::SharedString(text) => Cell::Word(text.trim().to_owned()),
            DataRef::DateTimeIso(text) | DataRef::DurationIso(text) => Cell::Word(text.clone()),
            DataRef::Bool(v) => Cell::Number(f64::from(u8::from(*v))),
            other @ DataRef::Error(_) => Cell::Word(Data::from(other.clone()).to_string()),
            DataRef::Empty => continue,
        };
        if matches!(&value, Cell::Word(text) if text.is_empty()) {
            continue;
        }
        *count += 1;
        if *count > MOST_CELLS {
            return Err(RecordingFileError::TooLarge { format: Format::Workbook, what: "cells", limit: MOST_CELLS });
        }
        if column >= MOST_COLUMNS {
            return Err(broken(&place(), "at most 16,384 columns", column + 1));
        }
        if rows.last().is_some_and(|(last, _)| row < *last) {
            return Err(broken(&place(), "rows in their order", format!("row {row}")));
        }
        if rows.last().is_none_or(|(last, _)| *last != row) {
            rows.push((row, Vec::new()));
        }
        let Some((_, cells)) = rows.last_mut() else { continue };
        while cells.len() <= column {
            cells.push(None);
        }
        cells[column] = Some(value);
    }
    Ok(rows)
}

/// The number that a cell holds, be it as a text with a decimal comma.
fn number(cell: &Cell) -> Option<f64> {
    match cell {
        Cell::Number(v) => Some(*v),
        Cell::Word(text) => number_of(text).or_else(|| number_of(&text.replace(',', "."))),
    }
}

fn kind(place: usize, cells: &[Option<Cell>]) -> Row {
    let numbers = cells.iter().flatten().filter(|cell| number(cell).is_some()).count();
    let words = cells.iter().flatten().count() - numbers;
    let kind = match (numbers, words) {
        (2.., 0) => RowKind::Numbers,
        _ => RowKind::Words(
            cells
                .iter()
                .map(|cell| match cell {
                    Some(Cell::Word(text)) => text.clone(),
                    Some(Cell::Number(v)) => v.to_string(),
                    None => String::new(),
                })
                .collect(),
        ),
    };
    // Columns are those of the sheet: rows of one table may end early.
    Row { place, count: 1, kind, cells: None }
}

fn table(title: String, rows: &Rows, block: &Block) -> RecordedTable {
    let mut table = RecordedTable::new(&title);
    let width = rows[block.rows.clone()].iter().map(|(_, cells)| cells.len()).max().unwrap_or(0);
    let width = width.max(block.names.len());
    for column in 0..width {
        let name = block.names.get(column).map_or("", String::as_str);
        let unit = block.units.get(column).map_or("", String::as_str);
        let of = |row: &(usize, Vec<Option<Cell>>)| -> Option<f64> {
            row.1.get(column).and_then(Option::as_ref).and_then(number)
        };
        let samples: Vec<f64> = rows[block.rows.clone()].iter().map(|row| of(row).unwrap_or(f64::NAN)).collect();
        let is_empty = samples.iter().all(|v| v.is_nan());
        let position = table.names.len();
        let mut words = Vec::new();
        for (i, (_, cells)) in rows[block.rows.clone()].iter().enumerate() {
            if let (Some(Some(Cell::Word(text))), true) = (cells.get(column), samples[i].is_nan()) {
                words.push(((i, position), text.clone()));
            }
        }
        if name.is_empty() && is_empty && words.is_empty() {
            continue;
        }
        table.words.extend(words);
        let name = if name.is_empty() { format!("column {}", letters(column)) } else { name.to_owned() };
        table.push(&name, unit, samples);
    }
    table.places = rows[block.rows.clone()].iter().map(|(place, _)| *place).collect();
    table.finished()
}

/// A column as Excel names it.
fn letters(column: usize) -> String {
    let mut left = column + 1;
    let mut letters = String::new();
    while left > 0 {
        let digit = (left - 1) % 26;
        letters.insert(0, char::from(b'A' + digit as u8));
        left = (left - 1) / 26;
    }
    letters
}

/// Refuses archives that unpack to more than a recording is.
fn check_size(bytes: &[u8]) -> Result<(), RecordingFileError> {
    let mut total = 0u64;
    let mut from = 0;
    // Entries of the archive's directory: signature, and at 24 the size once unpacked.
    while let Some(at) = find(&bytes[from..], b"PK\x01\x02") {
        let entry = &bytes[from + at..];
        let size = entry.get(24..28).and_then(|b| b.first_chunk::<4>()).map_or(0, |b| u32::from_le_bytes(*b));
        total = total.saturating_add(u64::from(size));
        from += at + 4;
    }
    if total > MOST_BYTES {
        let limit = MOST_BYTES as usize;
        return Err(RecordingFileError::TooLarge { format: Format::Workbook, what: "bytes once unpacked", limit });
    }
    Ok(())
}

fn find(bytes: &[u8], wanted: &[u8; 4]) -> Option<usize> {
    bytes.windows(4).position(|window| window == wanted)
}

fn broken(place: &str, expected: &str, found: impl std::fmt::Display) -> RecordingFileError {
    RecordingFileError::Broken {
        format: Format::Workbook,
        place: place.to_owned(),
        expected: expected.to_owned(),
        found: found.to_string(),
    }
}
