//! Indented XML.

use crate::osim::document::escape;
use crate::osim::edit::splice::format_number;
use nalgebra::Vector3;

/// A text that grows.
#[derive(Debug)]
pub(super) struct Xml {
    text: String,
    open: Vec<String>,
}

impl Default for Xml {
    fn default() -> Self {
        Xml { text: "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>\n".to_owned(), open: Vec::new() }
    }
}

/// Numbers separated by spaces.
pub(super) fn numbers(values: &[f64]) -> String {
    values.iter().map(|v| format_number(*v)).collect::<Vec<_>>().join(" ")
}

impl Xml {
    fn indent(&mut self) {
        self.text.extend(std::iter::repeat_n('\t', self.open.len()));
    }

    /// Start of an element.
    pub fn open(&mut self, tag: &str, attributes: &[(&str, &str)]) {
        self.indent();
        self.text.push_str(&format!("<{tag}"));
        for (name, value) in attributes {
            self.text.push_str(&format!(" {name}=\"{}\"", escape(value).replace('"', "&quot;")));
        }
        self.text.push_str(">\n");
        self.open.push(tag.to_owned());
    }

    /// End of the element opened last.
    pub fn close(&mut self) {
        if let Some(tag) = self.open.pop() {
            self.indent();
            self.text.push_str(&format!("</{tag}>\n"));
        }
    }

    /// An element with text.
    pub fn text(&mut self, tag: &str, text: &str) {
        self.indent();
        self.text.push_str(&format!("<{tag}>{}</{tag}>\n", escape(text)));
    }

    /// An element with a number.
    pub fn number(&mut self, tag: &str, value: f64) {
        self.text(tag, &format_number(value));
    }

    /// An element with a number, if there is one.
    pub fn optional(&mut self, tag: &str, value: Option<f64>) {
        if let Some(value) = value {
            self.number(tag, value);
        }
    }

    /// An element with three numbers.
    pub fn vector(&mut self, tag: &str, value: &Vector3<f64>) {
        self.text(tag, &numbers(value.as_slice()));
    }

    /// An element with `true` or `false`.
    pub fn boolean(&mut self, tag: &str, value: bool) {
        self.text(tag, if value { "true" } else { "false" });
    }

    /// The whole text.
    pub fn finish(mut self) -> String {
        while !self.open.is_empty() {
            self.close();
        }
        self.text
    }
}
