//! Workbooks of Excel, `.xlsx`: the tables of numbers on their sheets.
//!
//! In: bytes of a workbook. Out: a table for every block of rows of numbers below a row of names. Lines above it, a row
//! of units and decimal commas are treated as in a text file; formulas are what they were when the file was saved.

mod archive;
mod sheets;

use archive::Archive;
use sheets::{Cell, Rows};

use super::blocks::{Block, Row, RowKind, blocks};
use super::error::RecordingFileError;
use super::format::Format;
use super::recorded_table::RecordedTable;
use crate::study::dialect::number_of;
use crate::study::limits::MIN_SAMPLES;

/// The tables of a file.
///
/// - `is_wanted`: which sheets are read
///
/// # Errors
/// Bytes that are no workbook; no table; too much.
pub fn tables(bytes: &[u8], is_wanted: &dyn Fn(&str) -> bool) -> Result<Vec<RecordedTable>, RecordingFileError> {
    let mut archive = Archive::of(bytes)?;
    let start = archive.text("_rels/.rels")?.unwrap_or_default();
    let start = sheets::relations(&start, "_rels/.rels")?;
    let book = start.iter().find(|[_, kind, _]| kind.ends_with("/officeDocument"));
    let book =
        book.map_or_else(|| "xl/workbook.xml".to_owned(), |[_, _, target]| target.trim_start_matches('/').into());
    let (folder, name) = book.rsplit_once('/').unwrap_or(("", &book));
    let text = archive.text(&book)?.ok_or_else(|| RecordingFileError::Broken {
        format: Format::Workbook,
        place: "archive".to_owned(),
        expected: format!("the file {book}"),
        found: "none of that name".to_owned(),
    })?;
    let names = sheets::sheets(&text, &book)?;
    let related = format!("{folder}/_rels/{name}.rels");
    let related = sheets::relations(&archive.text(&related)?.unwrap_or_default(), &related)?;
    let full = |target: &str| match target.strip_prefix('/') {
        Some(absolute) => absolute.to_owned(),
        None => format!("{folder}/{target}"),
    };
    let part = |kind: &str| related.iter().find(|[_, of, _]| of.ends_with(kind)).map(|[_, _, target]| full(target));
    let mut text_of = |part: Option<String>| match part {
        Some(part) => archive.text(&part).map(|text| (text.unwrap_or_default(), part)),
        None => Ok(Default::default()),
    };
    let (text, place) = text_of(part("/sharedStrings"))?;
    let shared = sheets::shared(&text, &place)?;
    let (text, place) = text_of(part("/styles"))?;
    let times = sheets::times(&text, &place)?;
    let mut tables = Vec::new();
    let mut count = 0;
    for (sheet, id) in names.iter().filter(|(sheet, _)| is_wanted(sheet)) {
        // Sheets of diagrams have no cells.
        let target = related.iter().find(|[of, kind, _]| of == id && kind.ends_with("/worksheet"));
        let Some([_, _, target]) = target else { continue };
        let (text, _) = text_of(Some(full(target)))?;
        let rows = sheets::cells(&text, &format!("sheet `{sheet}`"), &shared, &times, &mut count)?;
        let kinds: Vec<Row> = rows.iter().map(|(place, cells)| kind(*place, cells)).collect();
        let found = blocks(&kinds);
        let is_alone = found.len() == 1;
        for (i, block) in found.iter().enumerate() {
            let title = if is_alone { sheet.clone() } else { format!("{sheet}, table {}", i + 1) };
            tables.push(table(&title, &rows, block));
        }
    }
    if tables.is_empty() {
        let names: Vec<&str> = names.iter().map(|(name, _)| name.as_str()).take(12).collect();
        let found = if names.is_empty() { "no sheet".to_owned() } else { format!("the sheets {}", names.join(", ")) };
        return Err(RecordingFileError::NoTable { format: Format::Workbook, rows: MIN_SAMPLES, found });
    }
    Ok(tables)
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

fn table(title: &str, rows: &Rows, block: &Block) -> RecordedTable {
    let mut table = RecordedTable::new(title);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_times_of_day_are_seconds_and_formats_are_told_apart() {
        let styles = "<styleSheet><numFmts><numFmt numFmtId=\"164\" formatCode=\"[Red]0.00\"/><numFmt numFmtId=\"165\" \
                      formatCode=\"mm:ss.000\"/><numFmt numFmtId=\"166\" formatCode=\"0.0\\ &quot;days&quot;\"/>\
                      </numFmts><cellXfs><xf numFmtId=\"0\"/><xf numFmtId=\"164\"/><xf numFmtId=\"165\"/><xf numFmtId=\"166\"/>\
                      <xf numFmtId=\"46\"/></cellXfs></styleSheet>";
        let times = sheets::times(styles, "styles").unwrap();
        assert_eq!(times, [false, false, true, false, true]);
        let sheet = "<x:worksheet><x:sheetData><x:row r=\"3\"><x:c r=\"B3\" s=\"2\"><x:v>0.5</x:v></x:c><x:c \
                     t=\"inlineStr\"><x:is><x:t>a &amp; b</x:t></x:is></x:c><x:c r=\"F3\" t=\"s\"><x:v>0</x:v></x:c>\
                     </x:row></x:sheetData></x:worksheet>";
        let rows = sheets::cells(sheet, "sheet", &["Torque".to_owned()], &times, &mut 0).unwrap();
        let word = |text: &str| Some(Cell::Word(text.to_owned()));
        assert_eq!(rows, [(3, vec![None, Some(Cell::Number(43200.0)), word("a & b"), None, None, word("Torque")])]);
        let wrong = sheets::cells(&sheet.replace(">0<", ">7<"), "sheet", &[], &times, &mut 0).unwrap_err();
        assert!(wrong.to_string().contains("row 3"), "{wrong}");
        assert_eq!(letters(27), "AB");
    }

    #[test]
    fn verif_parts_that_are_cut_off_or_changed_do_no_harm() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/recordings/recording.xlsx");
        let bytes = std::fs::read(path).unwrap();
        let mut archive = Archive::of(&bytes).unwrap();
        for part in ["xl/worksheets/sheet2.xml", "xl/workbook.xml", "xl/styles.xml", "xl/sharedStrings.xml"] {
            let text = archive.text(part).unwrap().unwrap();
            for at in (0..text.len()).filter(|at| text.is_char_boundary(*at) && (*at < 1500 || at % 5 == 0)) {
                for with in ["<", "&", "\"", "-", "9999999999", ">"] {
                    for changed in [text[..at].to_owned(), format!("{}{with}{}", &text[..at], &text[at..])] {
                        let shared = sheets::shared(&changed, part).unwrap_or_default();
                        let times = sheets::times(&changed, part).unwrap_or_default();
                        // Either is right, as long as it comes to an end.
                        let _ = sheets::sheets(&changed, part);
                        let _ = sheets::cells(&changed, part, &shared, &times, &mut 0);
                    }
                }
            }
        }
    }
}
