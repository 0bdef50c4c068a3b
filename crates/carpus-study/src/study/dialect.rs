//! How a text file of numbers is laid out: separator, decimal sign, lines above the header, a line of units.
//!
//! In: the first lines of a file as a recorder's program exported it. Out: a [`Dialect`], by which the file is read as
//! any other table. Nothing here knows a maker's format: Biodex, HUMAC, Delsys, Noraxon and spreadsheets differ in just
//! these points.

use std::collections::HashSet;

use carpus_numerics::plausible::{Measured, unit_in_name};

/// Rows of numbers that a table has to begin with.
pub(super) const ROWS_OF_A_TABLE: usize = 4;
/// Lines that may stand above a table: Delsys writes one for each of up to some hundred channels.
const MOST_LINES_ABOVE: usize = 2000;

/// What separates the cells of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Separator {
    /// `,`
    #[default]
    Comma,
    /// `;`
    Semicolon,
    /// A tab.
    Tab,
    /// Any number of spaces and tabs, as in tables with columns of equal width.
    Spaces,
}

impl Separator {
    const ALL: [Separator; 4] = [Separator::Comma, Separator::Semicolon, Separator::Tab, Separator::Spaces];

    /// The byte that separates cells after [`Separator::joined`].
    pub(crate) fn byte(self) -> u8 {
        match self {
            Separator::Comma => b',',
            Separator::Semicolon => b';',
            Separator::Tab | Separator::Spaces => b'\t',
        }
    }

    /// In words.
    pub fn word(self) -> &'static str {
        match self {
            Separator::Comma => "commas",
            Separator::Semicolon => "semicolons",
            Separator::Tab => "tabs",
            Separator::Spaces => "spaces",
        }
    }

    /// The cells of a line, without quotes.
    pub(super) fn cells(self, line: &str) -> Vec<String> {
        let line = if self == Separator::Spaces { joined(line) } else { line.to_owned() };
        // Without quotes no reader is needed, which takes longer to make than a line to read.
        if !line.contains(['"', '\r', '\n']) {
            let cells = line.split(char::from(self.byte())).map(|cell| cell.trim().to_owned());
            return if line.is_empty() { Vec::new() } else { cells.collect() };
        }
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(self.byte())
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(line.as_bytes());
        let record = reader.records().next().and_then(Result::ok);
        record.map(|record| record.iter().map(str::to_owned).collect()).unwrap_or_default()
    }
}

/// A line of columns of equal width with a tab between cells. A bracket belongs to the word before it: `POS (ANAT)`.
pub(crate) fn joined(line: &str) -> String {
    let mut out = String::with_capacity(line.len());
    for word in line.split_whitespace() {
        if !out.is_empty() {
            out.push(if word.starts_with(['(', '[']) && !word.ends_with(char::is_numeric) { ' ' } else { '\t' });
        }
        out.push_str(word);
    }
    out
}

/// The layout of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dialect {
    /// Between cells.
    pub separator: Separator,
    /// Whether `1,5` is a number.
    pub decimal_comma: bool,
    /// Line of the column names, from 1; what stands above is about the recording.
    pub header_line: usize,
    /// Line of units below the names.
    pub units_line: Option<usize>,
    /// Last line of the table, where another one follows in the file.
    pub last_line: Option<usize>,
    /// The lines above the header.
    pub above: Vec<String>,
    /// Units of the columns: of the line of units, else empty.
    pub units: Vec<String>,
}

impl Dialect {
    /// A CSV file with its header on the first line.
    pub fn plain() -> Dialect {
        Dialect { header_line: 1, ..Dialect::default() }
    }

    /// Whether a file is a CSV file with its header on the first line that is not blank.
    pub fn is_plain(&self) -> bool {
        self.separator == Separator::Comma
            && self.units_line.is_none()
            && self.above.iter().all(|line| line.trim().is_empty())
    }

    /// A cell as a number.
    pub fn number(&self, text: &str) -> Option<f64> {
        match self.decimal_comma {
            true => number_of(&text.replace(',', ".")),
            false => number_of(text),
        }
    }

    /// Whether a line above the first row of numbers is not the header.
    pub(crate) fn is_skipped(&self, line: usize) -> bool {
        line < self.header_line || Some(line) == self.units_line
    }

    /// Finds the layout of a text; `None` where it has no table of numbers with a line of names above.
    ///
    /// - `text`: the beginning of a file, long enough to hold the first rows of numbers
    pub fn of(text: &str) -> Option<Dialect> {
        let lines: Vec<&str> = text.trim_start_matches('\u{feff}').lines().take(MOST_LINES_ABOVE).collect();
        let found = Separator::ALL.into_iter().filter_map(|separator| Self::with(separator, &lines));
        // Of layouts that are possible, the one with more columns splits what the other leaves together.
        found.max_by_key(|(columns, _)| *columns).map(|(_, dialect)| dialect)
    }

    fn with(separator: Separator, lines: &[&str]) -> Option<(usize, Dialect)> {
        let cells: Vec<Vec<String>> = lines.iter().map(|line| separator.cells(line)).collect();
        [false, true].into_iter().filter(|comma| !(*comma && separator == Separator::Comma)).find_map(|decimal_comma| {
            let is_number = |cell: &String| match decimal_comma {
                true => number_of(&cell.replace(',', ".")).is_some(),
                false => number_of(cell).is_some(),
            };
            let is_row = |cells: &Vec<String>| {
                cells.iter().filter(|cell| is_number(cell)).count() >= 2
                    && cells.iter().all(|cell| cell.is_empty() || is_number(cell))
            };
            let rows: Vec<bool> = cells.iter().map(is_row).collect();
            let begins = |i: usize| {
                let next: Vec<usize> =
                    (i..lines.len()).filter(|k| !lines[*k].trim().is_empty()).take(ROWS_OF_A_TABLE).collect();
                next.len() == ROWS_OF_A_TABLE && next.iter().all(|k| rows[*k] && cells[*k].len() == cells[i].len())
            };
            let first = (1..lines.len()).find(|i| begins(*i))?;
            let columns = cells[first].len();
            let above: Vec<usize> = (0..first).rev().filter(|i| !lines[*i].trim().is_empty()).take(2).collect();
            let named = |i: usize| cells[i].len() == columns && !rows[i] && cells[i].iter().any(|c| !c.is_empty());
            let last = *above.first().filter(|i| named(**i))?;
            let before = above.get(1).copied().filter(|i| named(*i) && is_of_units(&cells[last]));
            let header = before.unwrap_or(last);
            let dialect = Dialect {
                separator,
                decimal_comma,
                header_line: header + 1,
                units_line: before.map(|_| last + 1),
                last_line: None,
                above: lines[..header].iter().map(|line| (*line).to_owned()).collect(),
                units: if before.is_some() { cells[last].clone() } else { Vec::new() },
            };
            Some((columns, dialect))
        })
    }
}

/// Whether all cells of a line are units or empty, and one at least is a unit.
pub(super) fn is_of_units(cells: &[String]) -> bool {
    let is_unit = |cell: &String| unit_of(cell).is_some();
    cells.iter().any(is_unit) && cells.iter().all(|cell| cell.is_empty() || is_unit(cell))
}

/// The unit that a cell of a line of units names.
fn unit_of(cell: &str) -> Option<&'static carpus_numerics::plausible::NamedUnit> {
    let plain = cell.trim_matches(['(', ')', '[', ']', ' ']);
    unit_in_name(&format!("[{plain}]"), Measured::Moment)
}

/// A finite number; words such as `inf` and `nan` are none.
pub(super) fn number_of(text: &str) -> Option<f64> {
    let begins = text.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '+' | '-' | '.'));
    begins.then(|| text.parse().ok()).flatten().filter(|v: &f64| v.is_finite())
}

/// Whether a column's name says that it holds times: `time_s`, `X[s]`, `Zeit`, `Time (Seconds)`, `mSec`.
pub fn is_time_name(name: &str) -> bool {
    let plain = name.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches([' ', '#']).to_lowercase();
    let words: Vec<&str> = plain.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    let states_time = || unit_in_name(&plain, Measured::Time).is_some_and(|unit| unit.of == Measured::Time);
    match words[..] {
        [] => false,
        ["t" | "time" | "timestamp" | "zeit" | "temps" | "tiempo" | "tempo" | "tijd" | "msec" | "sec", ..] => true,
        ["x", ..] => states_time(),
        _ => false,
    }
}

/// Names that no other column has: of columns with one name, as the times of Delsys' channels, all but the first get
/// their number.
pub(crate) fn unique_names(names: &mut [String]) {
    let mut known: HashSet<String> = HashSet::new();
    for name in names {
        if known.contains(name.as_str()) {
            let numbered = (2..).map(|k| format!("{name} #{k}")).find(|new| !known.contains(new));
            *name = numbered.unwrap_or_default();
        }
        known.insert(name.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dialect(text: &str) -> Dialect {
        Dialect::of(text).unwrap()
    }

    #[test]
    fn verif_a_plain_table_is_plain() {
        let found = dialect("time_s,angle_deg\n0,1\n0.1,2\n0.2,3\n0.3,4\n");
        assert!(found.is_plain() && found.header_line == 1, "{found:?}");
    }

    #[test]
    fn verif_lines_above_units_and_decimal_commas_are_found() {
        let found =
            dialect("Labor A;;\n\nZeit;Winkel;Moment\ns;Grad;Nm\n0,00;1,5;-2\n0,01;1,5;-2\n0,02;1,5;-2\n0,03;1;2\n");
        assert_eq!((found.separator, found.decimal_comma), (Separator::Semicolon, true));
        assert_eq!((found.header_line, found.units_line), (3, Some(4)));
        assert_eq!(found.units, ["s", "Grad", "Nm"]);
        assert_eq!(found.number("-1,5"), Some(-1.5));
    }

    #[test]
    fn verif_columns_of_equal_width_are_read_with_their_brackets() {
        let text = "Report\n\n  TIME  TORQUE  POSITION  POS (ANAT)  VELOCITY\n  mSec  N-M  DEGREES  DEGREES  \
                    DEG/SEC\n   0  1.5  20  20  0\n  10  1.6  20  20  0\n  20  1.7  20  20  0\n  30  -1.8  20  20  \
                    0\n";
        let found = dialect(text);
        assert_eq!((found.separator, found.header_line, found.units_line), (Separator::Spaces, 3, Some(4)));
        assert_eq!(joined("  TIME  POS (ANAT)  V"), "TIME\tPOS (ANAT)\tV");
        assert_eq!(joined(" 1 (2) "), "1 (2)");
    }

    #[test]
    fn verif_quoted_names_with_commas_and_many_time_columns() {
        let found = dialect("a,,\nb,,\n\"Time,s\",\"FCR,uV\",x\n0,1,2\n1,2,3\n2,3,4\n3,4,\n");
        assert_eq!((found.separator, found.header_line), (Separator::Comma, 3));
        let mut names = ["X[s]", "A", "X[s]", "B", "X[s]"].map(str::to_owned);
        unique_names(&mut names);
        assert_eq!(names, ["X[s]", "A", "X[s] #2", "B", "X[s] #3"]);
    }

    /// As the reader of quoted lines has them.
    #[test]
    fn verif_cells_of_lines_without_quotes_are_those_of_a_reader() {
        for line in ["", " ", "a", " a , b,,c ", ",", "1;2", "\t1\t 2", "  1  2 "] {
            for separator in Separator::ALL {
                let line = if separator == Separator::Spaces { joined(line) } else { line.to_owned() };
                let mut reader = csv::ReaderBuilder::new();
                let reader = reader.delimiter(separator.byte()).has_headers(false).flexible(true).trim(csv::Trim::All);
                let record = reader.from_reader(line.as_bytes()).records().next().and_then(Result::ok);
                let expected: Vec<String> = record.iter().flatten().map(str::to_owned).collect();
                assert_eq!(separator.cells(&line), expected, "{line:?} {separator:?}");
            }
        }
    }

    #[test]
    fn verif_prose_is_no_table() {
        assert_eq!(Dialect::of("a letter, of words\nand more, of them\n1,2\n"), None);
        assert_eq!(Dialect::of(""), None);
    }
}
