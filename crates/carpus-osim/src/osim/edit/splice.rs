//! Splices of values and components into the text, with the file's own indentation and line ends.

use std::ops::Range;

use super::error::EditError;
use crate::osim::document::{Document, ElementId, escape};

/// A range of the text, and what takes its place.
pub(in crate::osim) type Splice = (Range<usize>, String);

/// The splice that gives a property another value.
pub(in crate::osim) fn value_edit(
    document: &Document,
    element: ElementId,
    property: &str,
    text: &str,
) -> Result<Splice, EditError> {
    if !document.children(element).is_empty() {
        let owner = document.parent(element);
        return Err(EditError::NotAValue {
            file: document.file().to_owned(),
            line: document.line(element),
            path: owner.and_then(|owner| document.attribute(owner, "name")).unwrap_or_default(),
            property: property.to_owned(),
        });
    }
    let text = escape(text);
    if !document.is_self_closing(element) {
        return Ok((document.value_range(element), text));
    }
    Ok(document.appended(element, &text))
}

/// A number in its shortest form that reads back the same; infinities as OpenSim writes them.
pub fn format_number(value: f64) -> String {
    if value.is_infinite() {
        return if value > 0.0 { "Inf" } else { "-Inf" }.to_owned();
    }
    let text = format!("{value:?}");
    text.strip_suffix(".0").map_or_else(|| text.clone(), str::to_owned)
}

pub(super) fn lines(parts: &[&str]) -> String {
    let mut text = String::new();
    for (i, part) in parts.iter().enumerate() {
        // What stands between the first and last line is one level deeper.
        let inner = i > 0 && i + 1 < parts.len();
        for line in reindented(part, if inner { "\t" } else { "" }, "\t", "\n").lines() {
            if !text.is_empty() {
                text.push('\n');
            }
            text.push_str(line);
        }
    }
    text
}

/// Splices that make `fragment` the last child of `parent`.
pub(in crate::osim) fn insertion(document: &Document, parent: ElementId, fragment: &str) -> Vec<Splice> {
    let newline = document.newline();
    let unit = indentation_unit(document);
    if let Some(&last) = document.children(parent).last() {
        let end = document.range(last).end;
        let text = match document.indentation(last) {
            Some(indentation) => format!("{newline}{}", reindented(fragment, indentation, &unit, newline)),
            None => fragment.trim().to_owned(),
        };
        return vec![(end..end, text)];
    }
    let base = document.indentation(parent).unwrap_or_default().to_owned();
    let text = reindented(fragment, &format!("{base}{unit}"), &unit, newline);
    if document.is_self_closing(parent) {
        return vec![document.appended(parent, &format!("{newline}{text}{newline}{base}"))];
    }
    // Comments may stand inside; the new child comes behind them, in place of the white space before the end tag.
    let inner = document.inner(parent);
    let bytes = &document.bytes()[inner.clone()];
    let kept = bytes.trim_ascii_end().len();
    vec![(inner.start + kept..inner.end, format!("{newline}{text}{newline}{base}"))]
}

/// One level of indentation: that of the model below the root.
pub(in crate::osim) fn indentation_unit(document: &Document) -> String {
    let model = document.children(document.root()).first();
    let of_model = model.and_then(|&model| document.indentation(model)).filter(|text| !text.is_empty());
    of_model.unwrap_or("\t").to_owned()
}

/// The fragment with the indentation of its lines (relative to its last line) expressed in `unit`.
fn reindented(fragment: &str, indentation: &str, unit: &str, newline: &str) -> String {
    let fragment = fragment.trim();
    let leading = |line: &str| line.len() - line.trim_ascii_start().len();
    let filled = || fragment.lines().skip(1).filter(|line| !line.trim_ascii().is_empty());
    let least = filled().map(leading).min().unwrap_or(0);
    let step = filled().map(|line| leading(line) - least).filter(|&extra| extra > 0).min().unwrap_or(1);
    let mut text = String::new();
    for (i, line) in fragment.lines().enumerate() {
        if i > 0 {
            text.push_str(newline);
        }
        let depth = if i == 0 { 0 } else { leading(line).saturating_sub(least) / step };
        text.push_str(indentation);
        text.push_str(&unit.repeat(depth));
        text.push_str(line.trim_ascii());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_numbers_are_written_in_their_shortest_form() {
        for (value, text) in
            [(0.1, "0.1"), (5.0, "5"), (-0.0, "-0"), (1e-7, "1e-7"), (1e22, "1e22"), (f64::INFINITY, "Inf")]
        {
            assert_eq!(format_number(value), text);
        }
        let value = 0.1 + 0.2;
        assert_eq!(format_number(value).parse::<f64>(), Ok(value));
    }

    #[test]
    fn verif_fragments_take_the_indentation_of_the_file() {
        let fragment = "<a>\n  <b>\n    <c/>\n  </b>\n</a>";
        assert_eq!(
            reindented(fragment, "\t\t", "\t", "\r\n"),
            "\t\t<a>\r\n\t\t\t<b>\r\n\t\t\t\t<c/>\r\n\t\t\t</b>\r\n\t\t</a>"
        );
    }
}
