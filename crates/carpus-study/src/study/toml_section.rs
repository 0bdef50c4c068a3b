//! Reading TOML tables with the line of everything, collecting all problems instead of stopping at the first.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::fault::Fault;
use super::nearest::nearest;
use super::problem::Problem;
use super::table::is_of_a_study;
use carpus_numerics::printable::{deceptive_in, visible};

/// The top-level tables of a TOML document.
pub struct Sections<'i> {
    file: PathBuf,
    text: &'i str,
    table: DeTable<'i>,
    asked: RefCell<BTreeSet<&'static str>>,
}

/// One table, with the keys that were asked for.
pub struct TomlSection<'a> {
    file: &'a Path,
    text: &'a str,
    name: &'static str,
    /// Line of the table's header; 1 if the table is absent.
    line: usize,
    /// The table is there but is not a table, or is absent: keys are not reported as missing twice.
    entries: Vec<Entry<'a>>,
    known: BTreeSet<String>,
    problems: Vec<Problem>,
}

struct Entry<'a> {
    key: &'a str,
    line: usize,
    value: &'a DeValue<'a>,
}

/// What a text is that is not TOML, if its beginning says so.
fn other_kind(text: &str) -> Option<Fault> {
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let first_line = text.lines().next().unwrap_or_default();
    let (found, hint) = if text.starts_with('<') && text.contains("<Model") {
        ("a model", "give the study that names the model; `carpus info` shows what is in a model")
    } else if text.starts_with('<') {
        ("an XML file", "setup files of OpenSim's tools are run by `carpus run-tool`")
    } else if text.starts_with('{') {
        ("a JSON file", "give the study that it was made of")
    } else if first_line.contains([',', ';', '\t']) && !first_line.contains('=') && !first_line.starts_with(['[', '#'])
    {
        ("a table", "give the study that names the table")
    } else {
        return None;
    };
    Some(Fault::NotAStudy { found, hint })
}

/// Line of a byte offset, counted from 1.
fn line_at(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|b| **b == b'\n').count()
}

impl<'i> Sections<'i> {
    /// Parses a document; every syntax error is reported. `None` if there was one.
    pub fn parse(text: &'i str, file: &Path, problems: &mut Vec<Problem>) -> Option<Self> {
        let (table, errors) = DeTable::parse_recoverable(text);
        if let Some(fault) = other_kind(text).filter(|_| !errors.is_empty()) {
            problems.push(Problem::error(file, None, fault));
            return None;
        }
        for error in &errors {
            let line = error.span().map(|span| line_at(text, span.start));
            problems.push(Problem::error(file, line, Fault::TomlSyntax { message: error.message().to_owned() }));
        }
        if !errors.is_empty() {
            return None;
        }
        let table = table.into_inner();
        report_deceptive(&table, text, file, problems);
        Some(Sections { file: file.to_owned(), text, table, asked: RefCell::default() })
    }

    /// A table by name; an absent one is as an empty one.
    pub fn section(&self, name: &'static str) -> TomlSection<'_> {
        self.asked.borrow_mut().insert(name);
        let mut section = TomlSection {
            file: &self.file,
            text: self.text,
            name,
            line: 1,
            entries: Vec::new(),
            known: BTreeSet::new(),
            problems: Vec::new(),
        };
        let Some((key, value)) = self.table.get_key_value(name) else { return section };
        section.line = line_at(self.text, key.span().start);
        match value.get_ref() {
            DeValue::Table(table) => section.entries = entries(table, self.text),
            other => section.bad_value_at(section.line, name, "a table", describe(other)),
        }
        section
    }

    /// Reports every table that was never asked for.
    pub fn report_unknown(&self, problems: &mut Vec<Problem>) {
        let asked = self.asked.borrow();
        for key in self.table.keys() {
            let name: &str = key.get_ref();
            if !asked.contains(name) {
                let fault = Fault::UnknownSection {
                    section: name.to_owned(),
                    known: asked.iter().map(|s| (*s).to_owned()).collect(),
                    nearest: nearest(name, asked.iter().copied()),
                };
                problems.push(Problem::error(&self.file, line_at(self.text, key.span().start), fault));
            }
        }
    }
}

/// Reports keys and strings with characters that do not show as they are, in all tables below.
fn report_deceptive(table: &DeTable<'_>, text: &str, file: &Path, problems: &mut Vec<Problem>) {
    for (key, value) in table {
        let name: &str = key.get_ref();
        let report = |place: String, character: char, offset: usize| {
            Problem::error(file, line_at(text, offset), Fault::DeceptiveCharacter { place, character })
        };
        if let Some(character) = deceptive_in(name) {
            problems.push(report("a key".to_owned(), character, key.span().start));
        }
        let inside: Vec<&Spanned<DeValue<'_>>> = match value.get_ref() {
            DeValue::Array(items) => items.iter().collect(),
            _ => vec![value],
        };
        for item in inside {
            match item.get_ref() {
                DeValue::String(string) => {
                    if let Some(character) = deceptive_in(string) {
                        problems.push(report(format!("`{}`", visible(name)), character, item.span().start));
                    }
                }
                DeValue::Table(inner) => report_deceptive(inner, text, file, problems),
                _ => {}
            }
        }
    }
}

fn entries<'a>(table: &'a DeTable<'a>, text: &str) -> Vec<Entry<'a>> {
    let mut entries: Vec<(usize, Entry<'a>)> = table
        .iter()
        .map(|(key, value)| {
            let start = key.span().start;
            (start, Entry { key: key.get_ref(), line: line_at(text, start), value: value.get_ref() })
        })
        .collect();
    entries.sort_by_key(|(start, _)| *start); // the parser sorts by name; people read by line
    entries.into_iter().map(|(_, entry)| entry).collect()
}

impl<'a> TomlSection<'a> {
    /// Hands the findings over; keys never asked for are errors.
    pub fn finish(mut self, problems: &mut Vec<Problem>) {
        for entry in std::mem::take(&mut self.entries) {
            if !self.known.contains(entry.key) {
                let fault = Fault::UnknownKey {
                    key: entry.key.to_owned(),
                    section: self.name.to_owned(),
                    known: self.known.iter().cloned().collect(),
                    nearest: nearest(entry.key, self.known.iter().map(String::as_str)),
                };
                self.problems.push(Problem::error(self.file, entry.line, fault));
            }
        }
        problems.append(&mut self.problems);
    }

    /// Line of a key; the table's line if it is absent.
    pub fn line_of(&self, key: &str) -> usize {
        self.entries.iter().find(|e| e.key == key).map_or(self.line, |e| e.line)
    }

    /// Reports a value.
    pub fn bad_value(&mut self, key: &str, expected: &str, found: &str) {
        self.bad_value_at(self.line_of(key), key, expected, found.to_owned());
    }

    fn bad_value_at(&mut self, line: usize, key: &str, expected: &str, found: String) {
        let fault = Fault::BadValue { key: key.to_owned(), expected: expected.to_owned(), found };
        self.problems.push(Problem::error(self.file, line, fault));
    }

    fn missing(&mut self, key: &str, expected: &str) {
        let fault =
            Fault::MissingKey { section: self.name.to_owned(), key: key.to_owned(), expected: expected.to_owned() };
        self.problems.push(Problem::error(self.file, self.line, fault));
    }

    fn value(&mut self, key: &str) -> Option<&'a DeValue<'a>> {
        self.known.insert(key.to_owned());
        self.entries.iter().find(|e| e.key == key).map(|e| e.value)
    }

    /// A non-empty string, if the key is there.
    pub fn optional_string(&mut self, key: &str) -> Option<String> {
        let value = self.value(key)?;
        match value {
            DeValue::String(s) if !s.trim().is_empty() => Some(s.to_string()),
            other => {
                self.bad_value(key, "a non-empty string", &describe(other));
                None
            }
        }
    }

    /// A non-empty string; its absence is an error.
    pub fn required_string(&mut self, key: &str, expected: &str) -> Option<String> {
        if self.value(key).is_none() {
            self.missing(key, expected);
        }
        self.optional_string(key)
    }

    /// A list of different strings, if the key is there.
    pub fn optional_strings(&mut self, key: &str, expected: &str) -> Option<Vec<String>> {
        let value = self.value(key)?;
        let DeValue::Array(array) = value else {
            self.bad_value(key, expected, &describe(value));
            return None;
        };
        let mut found: Vec<(String, usize)> = Vec::new();
        for item in array.iter() {
            let line = line_at(self.text, item.span().start);
            match item.get_ref() {
                DeValue::String(s) if !s.trim().is_empty() => {
                    if let Some((_, first_line)) = found.iter().find(|(text, _)| text == s) {
                        let fault =
                            Fault::Duplicate { what: "list entry", value: s.to_string(), first_line: *first_line };
                        self.problems.push(Problem::error(self.file, line, fault));
                    } else {
                        found.push((s.to_string(), line));
                    }
                }
                other => self.bad_value_at(line, key, "non-empty strings", describe(other)),
            }
        }
        Some(found.into_iter().map(|(text, _)| text).collect())
    }

    /// A list of at least one string; its absence is an error.
    pub fn required_strings(&mut self, key: &str, expected: &str) -> Option<Vec<String>> {
        if self.value(key).is_none() {
            self.missing(key, expected);
        }
        let list = self.optional_strings(key, expected)?;
        if list.is_empty() {
            self.bad_value(key, "at least one entry", "an empty list");
            return None;
        }
        Some(list)
    }

    /// A word of a closed list, if the key is there.
    pub fn optional_word<T: Copy>(&mut self, key: &str, what: &'static str, words: &[(&str, T)]) -> Option<T> {
        let text = self.optional_string(key)?;
        self.word(key, what, &text, self.line_of(key), words)
    }

    /// A list of at least one word of a closed list, if the key is there.
    pub fn optional_words<T: Copy>(&mut self, key: &str, what: &'static str, words: &[(&str, T)]) -> Option<Vec<T>> {
        self.value(key)?;
        let list = self.required_strings(key, "list of words")?;
        let line = self.line_of(key);
        Some(list.iter().filter_map(|text| self.word(key, what, text, line, words)).collect())
    }

    fn word<T: Copy>(
        &mut self,
        key: &str,
        what: &'static str,
        text: &str,
        line: usize,
        words: &[(&str, T)],
    ) -> Option<T> {
        let found = words.iter().find(|(word, _)| *word == text).map(|(_, value)| *value);
        if found.is_none() {
            let fault = Fault::UnknownWord {
                key: key.to_owned(),
                what,
                found: text.to_owned(),
                known: words.iter().map(|(word, _)| (*word).to_owned()).collect(),
                nearest: nearest(text, words.iter().map(|(word, _)| *word)),
            };
            self.problems.push(Problem::error(self.file, line, fault));
        }
        found
    }

    /// A finite number that passes `valid`, if the key is there.
    pub fn optional_number(&mut self, key: &str, expected: &str, valid: impl Fn(f64) -> bool) -> Option<f64> {
        let value = self.value(key)?;
        let number = number(value).filter(|v| valid(*v));
        if number.is_none() {
            self.bad_value(key, expected, &describe(value));
        }
        number
    }

    /// `true` or `false`, if the key is there.
    pub fn optional_bool(&mut self, key: &str) -> Option<bool> {
        let value = self.value(key)?;
        let DeValue::Boolean(flag) = value else {
            self.bad_value(key, "true or false", &describe(value));
            return None;
        };
        Some(*flag)
    }

    /// Whether the table is absent or has no keys.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Two numbers that pass `valid`, if the key is there.
    pub fn optional_pair(&mut self, key: &str, expected: &str, valid: impl Fn([f64; 2]) -> bool) -> Option<[f64; 2]> {
        let value = self.value(key)?;
        let pair = match value {
            DeValue::Array(array) => {
                let numbers: Vec<f64> = array.iter().filter_map(|item| number(item.get_ref())).collect();
                (numbers.len() == 2 && array.len() == 2).then(|| [numbers[0], numbers[1]]).filter(|p| valid(*p))
            }
            _ => None,
        };
        if pair.is_none() {
            self.bad_value(key, expected, &describe(value));
        }
        pair
    }

    /// A list of numbers that pass `valid`, if the key is there.
    pub fn optional_numbers(&mut self, key: &str, expected: &str, valid: impl Fn(f64) -> bool) -> Option<Vec<f64>> {
        let value = self.value(key)?;
        let numbers = match value {
            DeValue::Array(array) => {
                array.iter().map(|item| number(item.get_ref()).filter(|v| valid(*v))).collect::<Option<Vec<f64>>>()
            }
            _ => None,
        };
        if numbers.is_none() {
            self.bad_value(key, expected, &describe(value));
        }
        numbers
    }

    /// Every key of the table with its number and line: keys are free.
    pub fn all_numbers(&mut self, expected: &str) -> Vec<(String, f64, usize)> {
        let mut found = Vec::new();
        let entries: Vec<_> = self.entries.iter().map(|e| (e.key, e.line, e.value)).collect();
        for (key, line, value) in entries {
            self.known.insert(key.to_owned());
            match number(value) {
                Some(v) => found.push((key.to_owned(), v, line)),
                None => self.bad_value_at(line, key, expected, describe(value)),
            }
        }
        found
    }

    /// Whether the key holds a table.
    pub fn is_table(&self, key: &str) -> bool {
        self.entries.iter().any(|e| e.key == key && e.value.is_table())
    }

    /// Whether the key holds a table that has a key.
    pub fn has_inner(&self, key: &str, inner: &str) -> bool {
        let table = self.entries.iter().find(|e| e.key == key).and_then(|e| e.value.as_table());
        table.is_some_and(|table| table.keys().any(|name| name.get_ref() == inner))
    }

    /// A table, if the key is there: `read` asks for its keys, others are reported.
    pub fn optional_table<T>(
        &mut self,
        key: &'static str,
        expected: &str,
        read: impl FnOnce(&mut TomlSection<'a>) -> T,
    ) -> Option<T> {
        self.inner_table(key, key, expected, read)
    }

    /// Keys in the order of the file.
    pub fn keys(&self) -> Vec<String> {
        self.entries.iter().map(|e| e.key.to_owned()).collect()
    }

    /// As [`TomlSection::optional_table`] where the key is not known beforehand; `name`: for messages.
    pub fn inner_table<T>(
        &mut self,
        key: &str,
        name: &'static str,
        expected: &str,
        read: impl FnOnce(&mut TomlSection<'a>) -> T,
    ) -> Option<T> {
        let value = self.value(key)?;
        let DeValue::Table(table) = value else {
            self.bad_value(key, expected, &describe(value));
            return None;
        };
        let mut inner = TomlSection {
            file: self.file,
            text: self.text,
            name,
            line: self.line_of(key),
            entries: entries(table, self.text),
            known: BTreeSet::new(),
            problems: Vec::new(),
        };
        let result = read(&mut inner);
        inner.finish(&mut self.problems);
        Some(result)
    }

    /// Every key of the table, each a table that `read` asks for its keys: keys are free.
    pub fn all_tables<T>(
        &mut self,
        expected: &str,
        mut read: impl FnMut(&str, usize, &mut TomlSection<'a>) -> T,
    ) -> Vec<T> {
        let mut found = Vec::new();
        let all: Vec<_> = self.entries.iter().map(|e| (e.key, e.line, e.value)).collect();
        for (key, line, value) in all {
            self.known.insert(key.to_owned());
            let DeValue::Table(table) = value else {
                self.bad_value_at(line, key, expected, describe(value));
                continue;
            };
            let mut inner = TomlSection {
                file: self.file,
                text: self.text,
                name: self.name,
                line,
                entries: entries(table, self.text),
                known: BTreeSet::new(),
                problems: Vec::new(),
            };
            found.push(read(key, line, &mut inner));
            inner.finish(&mut self.problems);
        }
        found
    }
}

/// A number of a size that a study can hold, integer or not.
fn number(value: &DeValue<'_>) -> Option<f64> {
    let number = match value {
        DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok()? as f64,
        DeValue::Float(f) => f.as_str().parse().ok()?,
        _ => return None,
    };
    is_of_a_study(number).then_some(number)
}

/// A value as a message shows it.
fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(s) if s.trim().is_empty() => "an empty string".to_owned(),
        DeValue::String(s) => format!("the text \"{}\"", s.chars().take(40).collect::<String>()),
        DeValue::Integer(i) => i.to_string(),
        DeValue::Float(f) => f.to_string(),
        DeValue::Boolean(b) => b.to_string(),
        DeValue::Datetime(d) => format!("the date {d}"),
        DeValue::Array(items) => {
            let items: Vec<String> = items.iter().take(6).map(|item| describe(Spanned::get_ref(item))).collect();
            format!("[{}]", items.join(", "))
        }
        DeValue::Table(_) => "a table".to_owned(),
    }
}
