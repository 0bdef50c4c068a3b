//! Characters that must not reach a terminal, a file's name, a table or a page as they are.
//!
//! A control character moves the cursor or recolours what follows, a line break makes two lines of one message, a
//! direction mark shows text in an order in which it does not stand, a byte order mark is not seen at all. Names in a
//! study must have none of them; names in a model, which OpenSim takes, are shown with them written out. A spreadsheet
//! executes a cell that begins as a formula does; such a cell is marked as text.

use std::borrow::Cow;

/// Whether a character changes how text around it is shown, or is not shown itself.
pub fn is_deceptive(c: char) -> bool {
    c.is_control()
        || matches!(
            c,
            '\u{ad}' | '\u{34f}' | '\u{115f}' | '\u{1160}' | '\u{180e}' | '\u{3164}' | '\u{ffa0}' // shown as nothing
            | '\u{61c}' | '\u{200b}' | '\u{200e}' | '\u{200f}' // Arabic letter mark, zero-width space, direction marks
            | '\u{2028}'..='\u{202e}' // line and paragraph separators, embeddings and overrides of direction
            | '\u{2060}'..='\u{206f}' // word joiner, unseen operators, isolates of direction
            | '\u{feff}' | '\u{fff9}'..='\u{fffb}' // byte order mark, marks of annotation
            | '\u{e0000}'..='\u{e007f}' // tags
        )
}

/// A number as it is written, but a power of ten where it would be a long row of zeros.
pub fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && size.is_finite() && !(1e-7..1e15).contains(&size) {
        format!("{value:e}")
    } else {
        value.to_string()
    }
}

/// The first such character of a text.
pub fn deceptive_in(text: &str) -> Option<char> {
    text.chars().find(|c| is_deceptive(*c))
}

/// A character as its number: `U+202E`.
pub fn number_of(c: char) -> String {
    format!("U+{:04X}", u32::from(c))
}

/// A text of one line with such characters written out: `\u{202e}`.
pub fn visible(text: &str) -> Cow<'_, str> {
    written_out(text, |_| false, |c| format!("\\u{{{:x}}}", u32::from(c)))
}

/// As [`visible`], of a text of several lines.
pub fn visible_lines(text: &str) -> Cow<'_, str> {
    written_out(text, |c| matches!(c, '\n' | '\t'), |c| format!("\\u{{{:x}}}", u32::from(c)))
}

/// As [`visible_lines`], of JSON: the same value, as these characters stand in strings only.
pub fn visible_json(json: &str) -> Cow<'_, str> {
    // JSON's own escapes hold UTF-16 units.
    let escape = |c: char| c.encode_utf16(&mut [0; 2]).iter().map(|unit| format!("\\u{unit:04x}")).collect();
    written_out(json, |c| matches!(c, '\n' | '\t' | '\r'), escape)
}

fn written_out(text: &str, allowed: fn(char) -> bool, escape: fn(char) -> String) -> Cow<'_, str> {
    let is_bad = |c: char| is_deceptive(c) && !allowed(c);
    if !text.contains(is_bad) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_bad(c) { out.push_str(&escape(c)) } else { out.push(c) }
    }
    Cow::Owned(out)
}

/// Whether a spreadsheet takes a cell for a formula: it begins as one and is no number.
fn is_formula(cell: &str) -> bool {
    let mut rest = cell.chars();
    matches!(rest.next(), Some('=' | '+' | '-' | '@')) && !rest.as_str().is_empty() && cell.parse::<f64>().is_err()
}

/// A cell of a CSV table: deceptive characters written out, and what a spreadsheet would execute marked as text by an
/// apostrophe. [`cell_text`] takes the apostrophe off.
pub fn cell(text: &str) -> Cow<'_, str> {
    let shown = visible(text);
    if is_formula(&shown) { Cow::Owned(format!("'{shown}")) } else { shown }
}

/// The text of a cell that [`cell`] wrote.
pub fn cell_text(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|rest| is_formula(rest)).unwrap_or(cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_deceptive_characters_are_written_out() {
        assert_eq!(visible("\u{1b}[31mred"), "\\u{1b}[31mred");
        assert_eq!(visible("a\u{202e}b\u{feff}\nc"), "a\\u{202e}b\\u{feff}\\u{a}c");
        assert_eq!(visible_lines("a\n\tb\u{7}"), "a\n\tb\\u{7}");
        for unseen in ['\u{ad}', '\u{2063}', '\u{206a}', '\u{3164}', '\u{e0041}'] {
            assert_eq!(deceptive_in(&format!("FC{unseen}U")), Some(unseen));
        }
        assert!(matches!(visible("Müller 手首 −3 µV 5\u{202f}%"), Cow::Borrowed(_)));
        let json = serde_json::json!({ "name": "a\u{202e}\u{1b}\u{e0041}" }).to_string();
        let shown = visible_json(&json);
        assert_eq!(deceptive_in(&shown), None);
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).unwrap()["name"], "a\u{202e}\u{1b}\u{e0041}");
    }

    #[test]
    fn verif_numbers_are_no_rows_of_zeros() {
        let shown = [1e308, -1e308, 1e-320, 0.0, -0.25, 1e7, f64::INFINITY].map(number);
        assert_eq!(shown, ["1e308", "-1e308", "1e-320", "0", "-0.25", "10000000", "inf"]);
    }

    #[test]
    fn verif_formulas_become_text_and_come_back() {
        for formula in ["=1+1", "@SUM(A1)", "+cmd|' /C calc'!A0", "-2+3", "=HYPERLINK(\"http://x\")"] {
            assert_eq!(cell(formula), format!("'{formula}"));
            assert_eq!(cell_text(&cell(formula)), formula);
        }
        for plain in ["-1.5", "+3e-4", "-", "P01", "", "'quoted", "a=b", "-inf"] {
            assert_eq!(cell(plain), plain);
            assert_eq!(cell_text(plain), plain);
        }
    }
}
