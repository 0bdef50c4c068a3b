//! The parts of a workbook: its sheets, texts that cells share, styles, cells.
//!
//! # References
//! ECMA-376, *Office Open XML File Formats*, part 1, 18 (SpreadsheetML).

use quick_xml::Reader;
use quick_xml::XmlVersion;
use quick_xml::escape::resolve_predefined_entity;
use quick_xml::events::{BytesStart, Event};

use crate::study::recording_file::error::RecordingFileError;
use crate::study::recording_file::format::Format;

/// Most cells of a workbook that are read: sixteen columns of a million samples.
pub const MOST_CELLS: usize = 1 << 24;
/// Rows and columns of a sheet, as Excel has them.
const MOST_ROWS: usize = 1 << 20;
const MOST_COLUMNS: usize = 1 << 14;
/// Seconds of a day: times of day are parts of one.
const DAY: f64 = 86_400.0;

/// A cell that is not empty.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// A number; of a date or a time of day, its seconds.
    Number(f64),
    /// Anything else.
    Word(String),
}

/// Rows of a sheet that have cells: number of the row, from 1, and cells by column.
pub type Rows = Vec<(usize, Vec<Option<Cell>>)>;

/// What a piece of XML is.
enum Piece<'p> {
    Begin(&'p str, &'p BytesStart<'p>),
    End(&'p str),
    Text(&'p str),
}

/// Goes through a part; elements without content begin and end.
fn pieces(
    text: &str,
    part: &str,
    mut each: impl FnMut(Piece<'_>) -> Result<(), RecordingFileError>,
) -> Result<(), RecordingFileError> {
    let mut reader = Reader::from_str(text);
    loop {
        let event = reader.read_event();
        match event.map_err(|e| broken(&format!("{part}, byte {}", reader.buffer_position()), "XML", e))? {
            Event::Start(start) => each(Piece::Begin(local(start.name().as_ref()), &start))?,
            Event::Empty(start) => {
                let name = start.name();
                each(Piece::Begin(local(name.as_ref()), &start))?;
                each(Piece::End(local(name.as_ref())))?;
            }
            Event::End(end) => each(Piece::End(local(end.name().as_ref())))?,
            Event::Text(text) => each(Piece::Text(&text.xml10_content()))?,
            Event::CData(text) => each(Piece::Text(&text.xml10_content()))?,
            Event::GeneralRef(entity) => {
                let character = entity.resolve_char_ref().map_err(|e| broken(part, "a character", e))?;
                let own = character.map(String::from);
                each(Piece::Text(own.as_deref().or_else(|| resolve_predefined_entity(&entity)).unwrap_or("")))?;
            }
            Event::Eof => return Ok(()),
            _ => {}
        }
    }
}

/// A name without the prefix of its namespace.
fn local(name: &str) -> &str {
    name.rsplit(':').next().unwrap_or(name)
}

/// An attribute; `name` without prefix.
fn attribute(start: &BytesStart<'_>, name: &str) -> Option<String> {
    let found = start.attributes().with_checks(false).flatten().find(|a| local(a.key.as_ref()) == name)?;
    found.normalized_value(XmlVersion::Implicit1_0).ok().map(|value| value.into_owned())
}

/// What a part refers to: id, kind and target of every relationship.
pub fn relations(text: &str, part: &str) -> Result<Vec<[String; 3]>, RecordingFileError> {
    let mut found = Vec::new();
    pieces(text, part, |piece| {
        if let Piece::Begin("Relationship", start) = piece {
            found.push(["Id", "Type", "Target"].map(|name| attribute(start, name).unwrap_or_default()));
        }
        Ok(())
    })?;
    Ok(found)
}

/// Names of the sheets and the ids of their parts.
pub fn sheets(text: &str, part: &str) -> Result<Vec<(String, String)>, RecordingFileError> {
    let mut found = Vec::new();
    pieces(text, part, |piece| {
        if let Piece::Begin("sheet", start) = piece {
            // Its own number is `sheetId`; what it is related by is `r:id`.
            found.push((attribute(start, "name").unwrap_or_default(), attribute(start, "id").unwrap_or_default()));
        }
        Ok(())
    })?;
    Ok(found)
}

/// Texts that cells share.
pub fn shared(text: &str, part: &str) -> Result<Vec<String>, RecordingFileError> {
    let mut found: Vec<String> = Vec::new();
    let (mut in_text, mut in_phonetic) = (false, false);
    pieces(text, part, |piece| {
        match piece {
            Piece::Begin("si", _) => found.push(String::new()),
            Piece::Begin("t", _) => in_text = true,
            Piece::End("t") => in_text = false,
            Piece::Begin("rPh", _) => in_phonetic = true,
            Piece::End("rPh") => in_phonetic = false,
            Piece::Text(text) if in_text && !in_phonetic => found.last_mut().into_iter().for_each(|s| s.push_str(text)),
            _ => {}
        }
        Ok(())
    })?;
    Ok(found)
}

/// Which styles of cells show numbers as dates or times.
pub fn times(text: &str, part: &str) -> Result<Vec<bool>, RecordingFileError> {
    let (mut own, mut styles, mut in_cells): (Vec<(String, bool)>, Vec<bool>, bool) = Default::default();
    pieces(text, part, |piece| {
        match piece {
            Piece::Begin("numFmt", start) => {
                let code = attribute(start, "formatCode").unwrap_or_default();
                own.push((attribute(start, "numFmtId").unwrap_or_default(), shows_time(&code)));
            }
            Piece::Begin("cellXfs", _) => in_cells = true,
            Piece::End("cellXfs") => in_cells = false,
            Piece::Begin("xf", start) if in_cells => {
                let id = attribute(start, "numFmtId").unwrap_or_default();
                let of_excel = || matches!(id.parse::<u32>(), Ok(14..=22 | 27..=36 | 45..=47 | 50..=58));
                styles.push(own.iter().find(|(known, _)| *known == id).map_or_else(of_excel, |(_, is_time)| *is_time));
            }
            _ => {}
        }
        Ok(())
    })?;
    Ok(styles)
}

/// Whether a format shows a number as a date or a time: letters of those outside quotes and of colours.
fn shows_time(code: &str) -> bool {
    let (mut in_quotes, mut bracket, mut escaped) = (false, None::<String>, false);
    for c in code.chars().map(|c| c.to_ascii_lowercase()) {
        match (&mut bracket, c) {
            _ if escaped => escaped = false,
            (_, '"') => in_quotes = !in_quotes,
            _ if in_quotes => {}
            (_, '\\' | '_' | '*') => escaped = true,
            (None, '[') => bracket = Some(String::new()),
            (Some(inner), ']') => {
                // Hours, minutes or seconds of more than a day.
                if !inner.is_empty() && (inner.chars().all(|c| c == 'h') || inner.chars().all(|c| "ms".contains(c))) {
                    return true;
                }
                bracket = None;
            }
            (Some(inner), c) => inner.push(c),
            (None, 'd' | 'h' | 'm' | 's' | 'y') => return true,
            (None, 'g' | ';') => return false,
            _ => {}
        }
    }
    false
}

/// What is being read of a cell.
#[derive(Default)]
struct Open {
    column: usize,
    kind: String,
    is_time: bool,
    text: String,
}

/// The cells of a sheet.
///
/// - `count`: cells of the workbook that were read
pub fn cells(
    text: &str,
    part: &str,
    shared: &[String],
    times: &[bool],
    count: &mut usize,
) -> Result<Rows, RecordingFileError> {
    let mut rows: Rows = Vec::new();
    let (mut row, mut next_column) = (0, 0);
    let mut open: Option<Open> = None;
    let mut in_text = false;
    pieces(text, part, |piece| {
        match piece {
            Piece::Begin("row", start) => {
                let stated = attribute(start, "r").map(|text| {
                    let found = text.parse::<usize>().ok().filter(|r| (1..=MOST_ROWS).contains(r) && *r > row);
                    found.ok_or_else(|| broken(part, &format!("a row after row {row}"), format!("`{text}`")))
                });
                row = stated.transpose()?.unwrap_or(row + 1);
                next_column = 0;
            }
            Piece::Begin("c", start) => {
                let column = match attribute(start, "r") {
                    Some(place) => column(&place).ok_or_else(|| broken(part, "a cell such as B7", place))?,
                    None => next_column,
                };
                if column < next_column {
                    return Err(broken(part, &format!("cells of row {row} in their order"), column + 1));
                }
                next_column = column + 1;
                let style = attribute(start, "s").and_then(|style| style.parse::<usize>().ok());
                let is_time = style.and_then(|style| times.get(style).copied()).unwrap_or(false);
                let kind = attribute(start, "t").unwrap_or_default();
                open = Some(Open { column, kind, is_time, text: String::new() });
            }
            Piece::Begin("v" | "t", _) => in_text = true,
            Piece::End("v" | "t") => in_text = false,
            Piece::Text(text) if in_text => open.iter_mut().for_each(|open| open.text.push_str(text)),
            Piece::End("c") => {
                let Some(open) = open.take().filter(|open| !open.text.trim().is_empty()) else { return Ok(()) };
                // Cells that are left out before this one take room, too.
                let before = rows.last().filter(|(last, _)| *last == row).map_or(0, |(_, cells)| cells.len());
                *count += (open.column + 1).saturating_sub(before);
                if *count > MOST_CELLS {
                    let (format, what) = (Format::Workbook, "cells");
                    return Err(RecordingFileError::TooLarge { format, what, limit: MOST_CELLS });
                }
                if rows.last().is_none_or(|(last, _)| *last != row) {
                    rows.push((row, Vec::new()));
                }
                let column = open.column;
                let value = value(open, shared, &format!("{part}, row {row}"))?;
                if let Some((_, cells)) = rows.last_mut() {
                    cells.resize_with(column, || None);
                    cells.push(Some(value));
                }
            }
            _ => {}
        }
        Ok(())
    })?;
    Ok(rows)
}

fn value(open: Open, shared: &[String], place: &str) -> Result<Cell, RecordingFileError> {
    let text = open.text.trim();
    let number = || text.parse::<f64>().ok().filter(|v| v.is_finite());
    Ok(match open.kind.as_str() {
        "" | "n" => {
            let number = number().ok_or_else(|| broken(place, "a number", format!("`{text}`")))?;
            Cell::Number(if open.is_time { DAY * number } else { number })
        }
        "b" => Cell::Number(number().unwrap_or(0.0)),
        "s" => {
            let found = text.parse::<usize>().ok().and_then(|i| shared.get(i));
            let found = found.ok_or_else(|| broken(place, &format!("one of {} texts", shared.len()), text))?;
            Cell::Word(found.trim().to_owned())
        }
        // Texts of formulas, texts in their cells, errors, dates.
        _ => Cell::Word(text.to_owned()),
    })
}

/// The column of a place such as `B7`, from 0.
fn column(place: &str) -> Option<usize> {
    let letters = place.trim_end_matches(|c: char| c.is_ascii_digit());
    let count = |n: usize, c: char| {
        let digit = c.is_ascii_alphabetic().then(|| c.to_ascii_uppercase() as usize - 'A' as usize + 1)?;
        Some(26 * n + digit).filter(|n| *n <= MOST_COLUMNS)
    };
    letters.chars().try_fold(0, count)?.checked_sub(1)
}

fn broken(place: &str, expected: &str, found: impl std::fmt::Display) -> RecordingFileError {
    RecordingFileError::Broken {
        format: Format::Workbook,
        place: place.to_owned(),
        expected: expected.to_owned(),
        found: found.to_string(),
    }
}
