//! Where tables begin and end among lines or rows: one file may hold several recordings, one below the other.

use std::collections::HashSet;
use std::ops::Range;

use crate::study::dialect::{ROWS_OF_A_TABLE, is_of_units, is_time_name, number_of};

/// What a row holds.
pub(super) enum RowKind {
    /// Numbers, two at the least, and nothing else.
    Numbers,
    /// Anything else: its cells.
    Words(Vec<String>),
}

/// A row, or several rows of numbers one below the other.
pub(super) struct Row {
    /// Line of the text or row of the sheet, from 1; of several, the first.
    pub place: usize,
    /// How many there are.
    pub count: usize,
    /// What they hold.
    pub kind: RowKind,
    /// Cells of a row; `None` where rows of a table may end early.
    pub cells: Option<usize>,
}

/// A table among rows.
pub(super) struct Block {
    /// Position of the row of names.
    pub header: usize,
    /// Position of the row of units.
    pub units_row: Option<usize>,
    /// Names of the columns.
    pub names: Vec<String>,
    /// Units of the columns; empty where there is no row of them.
    pub units: Vec<String>,
    /// The words of the row above the names, where it is neither part of another table nor far from them.
    pub title: String,
    /// Positions of the rows from the first of numbers to the last of the table.
    pub rows: Range<usize>,
}

/// The tables among rows, in their order.
pub(super) fn blocks(rows: &[Row]) -> Vec<Block> {
    let begins = (1..rows.len()).filter(|i| has_numbers(rows, *i)).filter_map(|i| Some((i, header(rows, i)?)));
    let begins: Vec<(usize, (usize, Option<usize>))> = begins.collect();
    let mut found = Vec::new();
    for (k, (first, (header, units_row))) in begins.iter().enumerate() {
        let mut end = begins.get(k + 1).map_or(rows.len(), |(_, (header, _))| *header);
        let is_last = k + 1 == begins.len();
        // Words before the next table are its title; below the last one, what is apart from it is about the recording.
        let is_of_words = |i: &usize| matches!(&rows[*i].kind, RowKind::Words(cells) if !is_of_samples(cells));
        let words = (*first..end).rev().take_while(is_of_words);
        let is_apart = |i: &usize| rows[*i].place > rows[i - 1].place + rows[i - 1].count;
        end = words.filter(|i| !is_last || is_apart(i)).last().unwrap_or(end);
        let cells = |row: usize| match &rows[row].kind {
            RowKind::Words(cells) => cells.clone(),
            RowKind::Numbers => Vec::new(),
        };
        let title = header.checked_sub(1).map(cells).unwrap_or_default();
        let title: Vec<&str> = title.iter().map(|cell| cell.trim()).filter(|cell| !cell.is_empty()).collect();
        found.push(Block {
            header: *header,
            units_row: *units_row,
            names: cells(*header),
            units: units_row.map(cells).unwrap_or_default(),
            title: title.join(" ").chars().take(60).collect(),
            rows: *first..end,
        });
    }
    found
}

/// Whether rows of numbers begin here, as many as a table has at least.
fn has_numbers(rows: &[Row], from: usize) -> bool {
    let is_of_numbers = |row: &&Row| matches!(row.kind, RowKind::Numbers) && row.cells == rows[from].cells;
    !matches!(rows[from - 1].kind, RowKind::Numbers)
        && rows[from..].iter().take_while(is_of_numbers).take(ROWS_OF_A_TABLE).map(|row| row.count).sum::<usize>()
            >= ROWS_OF_A_TABLE
}

/// The rows of names and of units above rows of numbers.
fn header(rows: &[Row], first: usize) -> Option<(usize, Option<usize>)> {
    let names = |i: usize| match &rows[i].kind {
        RowKind::Words(cells) if rows[first].cells.is_none_or(|n| n == cells.len()) && are_names(cells) => Some(cells),
        _ => None,
    };
    let last = first - 1;
    let RowKind::Words(cells) = &rows[last].kind else { return None };
    if is_of_units(cells) && last > 0 && names(last - 1).is_some() {
        return Some((last - 1, Some(last)));
    }
    names(last).map(|_| (last, None))
}

/// Whether half of the cells or more are numbers: a row of samples of which some could not be recorded.
fn is_of_samples(cells: &[String]) -> bool {
    let filled = cells.iter().filter(|cell| !cell.trim().is_empty());
    let is_number = |cell: &&String| number_of(cell).or_else(|| number_of(&cell.replace(',', "."))).is_some();
    let numbers = cells.iter().filter(is_number).count();
    numbers > 0 && 2 * numbers >= filled.count()
}

/// Whether cells can be names of columns: two at the least, no two of the same but those of times, most not numbers.
fn are_names(cells: &[String]) -> bool {
    if is_of_samples(cells) {
        return false;
    }
    let names: Vec<&String> = cells.iter().filter(|cell| !cell.trim().is_empty()).collect();
    let mut known = HashSet::new();
    let are_distinct = names.iter().all(|name| known.insert(name.as_str()) || is_time_name(name));
    names.len() >= 2 && are_distinct
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_sample_that_was_not_recorded_begins_no_table() {
        let words = |place: usize, cells: &[&str]| Row {
            place,
            count: 1,
            kind: RowKind::Words(cells.iter().map(|cell| (*cell).to_owned()).collect()),
            cells: Some(cells.len()),
        };
        let numbers = |place: usize| Row { place, count: 9, kind: RowKind::Numbers, cells: Some(3) };
        for missing in [["0.58", "NaN", "2.8"], ["0,58", "#N/A", "2,8"], ["0.58", "-", ""], ["x", "1.5", "2.8"]] {
            let rows = [words(1, &["Time", "Angle", "Torque"]), numbers(2), words(11, &missing), numbers(12)];
            let found = blocks(&rows);
            assert_eq!(found.len(), 1, "{missing:?}");
            assert_eq!(found[0].rows, 1..4, "{missing:?}");
            // Nor is it the title of the next table.
            let next = [words(22, &["Time", "Angle", "Torque"]), numbers(23)];
            let rows: Vec<Row> = rows.into_iter().take(3).chain(next).collect();
            let found = blocks(&rows);
            assert_eq!((found.len(), found[0].rows.clone()), (2, 1..3), "{missing:?}");
        }
    }
}
