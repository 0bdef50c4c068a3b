//! Setup files of tools: properties by name, with the defaults of OpenSim's classes, relative paths, and what of the
//! file was not understood.

use std::cell::RefCell;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use nalgebra::Vector3;

use super::error::{ToolError, ToolProblem};
use super::upgrade::upgraded;
use carpus_osim::osim::{Document, ElementId, IncludeError, OsimError, include_files};

/// A setup file.
#[derive(Debug)]
pub struct Setup {
    document: Document,
    path: PathBuf,
    used: RefCell<Vec<bool>>,
}

/// An object in a setup file.
#[derive(Clone, Copy, Debug)]
pub struct Properties<'a> {
    setup: &'a Setup,
    element: ElementId,
}

impl Setup {
    /// Reads a file.
    ///
    /// # Errors
    /// The disk, or no XML.
    pub fn read(path: &Path) -> Result<Setup, ToolError> {
        let document = Document::read(path).map_err(|error| match error {
            OsimError::Read { source, .. } => ToolError::new(path, ToolProblem::Read(source)),
            OsimError::Document(error) => {
                let line = error.line;
                ToolError::at(path, line, ToolProblem::Document(error))
            }
            other => ToolError::new(path, other),
        })?;
        let document = included(document, path)?;
        let document =
            upgraded(document).map_err(|error| ToolError::at(path, error.line, ToolProblem::Document(error)))?;
        let used = RefCell::new(vec![false; document.n_elements()]);
        Ok(Setup { document, path: path.to_owned(), used })
    }

    /// A document that was read elsewhere, such as a model.
    pub fn of_document(path: &Path, document: Document) -> Setup {
        let used = RefCell::new(vec![false; document.n_elements()]);
        Setup { document, path: path.to_owned(), used }
    }

    /// The text, with the files that its objects name in their place.
    pub fn into_document(self) -> Document {
        self.document
    }

    /// The object at an element.
    pub fn at_element(&self, element: usize) -> Properties<'_> {
        Properties { setup: self, element: ElementId(element) }
    }

    fn at(&self, element: ElementId) -> Properties<'_> {
        self.mark(element);
        Properties { setup: self, element }
    }

    /// Where it was read from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A file or folder that the setup names: relative to the setup's own folder.
    pub fn resolve(&self, name: &str) -> PathBuf {
        let name = name.replace('\\', "/");
        match self.path.parent() {
            Some(folder) => folder.join(name),
            None => PathBuf::from(name),
        }
    }

    /// The object of the file: the child of `<OpenSimDocument>`, or in files of old the root itself.
    pub fn object(&self) -> Properties<'_> {
        let (root, element) = (self.document.root(), self.document.object());
        self.mark(root);
        self.mark(element);
        Properties { setup: self, element }
    }

    /// The text, and what in it has the file's `<defaults>`, if anything.
    pub fn with_defaults(&self) -> Option<(&Document, ElementId)> {
        let root = self.document.root();
        let has_them = |e: &ElementId| self.document.child(*e, "defaults").is_some();
        let owner = Some(root).filter(has_them);
        let owner = owner.or_else(|| self.document.children(root).first().copied().filter(has_them))?;
        let defaults = self.document.child(owner, "defaults")?;
        if !self.used.borrow()[defaults.0] {
            Properties { setup: self, element: defaults }.ignore();
        }
        Some((&self.document, owner))
    }

    /// What objects of a class have in place of properties that they lack: the object of that class in `<defaults>` of
    /// the file's object, as in `Object::updateDefaultObjectsFromXMLNode`.
    fn default_of(&self, class: &str) -> Option<ElementId> {
        let (document, owner) = self.with_defaults()?;
        document.child(document.child(owner, "defaults")?, class)
    }

    fn mark(&self, element: ElementId) {
        self.used.borrow_mut()[element.0] = true;
    }

    /// Properties that nothing asked for: line, tag, and whether it is one more of a property that was read (the first
    /// counts, as in OpenSim). Children of such are not listed again.
    pub fn unread(&self) -> Vec<(usize, String, bool)> {
        let used = self.used.borrow();
        let is_first = |e: &ElementId| !used[e.0] && self.document.parent(*e).is_none_or(|parent| used[parent.0]);
        let empty = |e: &ElementId| self.document.children(*e).is_empty() && self.document.text(*e).is_empty();
        let unread = self.document.elements().filter(is_first).filter(|e| !empty(e));
        let tag = |e: ElementId| self.document.tag(e);
        let one_more = |e: ElementId| {
            let beside = self.document.parent(e).map(|parent| self.document.children(parent)).unwrap_or_default();
            beside.iter().any(|other| used[other.0] && tag(*other) == tag(e))
        };
        unread.map(|e| (self.document.line(e), tag(e).to_owned(), one_more(e))).collect()
    }
}

/// A document with the files that its objects name in their place.
fn included(document: Document, path: &Path) -> Result<Document, ToolError> {
    let (document, failure) = include_files(document, path, true);
    let Some(failure) = failure else { return Ok(document) };
    let IncludeError { line, tag, file, path: other, source } = failure;
    Err(match source {
        Some(OsimError::Document(error)) => ToolError::at(&other, error.line, ToolProblem::Document(error)),
        Some(OsimError::Read { source, .. }) => {
            let expected = format!("a file that can be read ({source})");
            let property = format!("attribute file of <{tag}>");
            ToolError::at(path, line, ToolProblem::Value { property, expected, found: file })
        }
        Some(error) => ToolError::at(path, line, error),
        None => return Ok(document),
    })
}

impl<'a> Properties<'a> {
    /// The setup.
    pub fn setup(&self) -> &'a Setup {
        self.setup
    }

    /// Class: the tag.
    pub fn class(&self) -> &'a str {
        self.setup.document.tag(self.element)
    }

    /// Line of its start tag.
    pub fn line(&self) -> usize {
        self.setup.document.line(self.element)
    }

    /// Attribute `name`; empty if absent.
    pub fn name(&self) -> String {
        self.setup.document.attribute(self.element, "name").unwrap_or_default()
    }

    fn element(&self, property: &str) -> Option<ElementId> {
        let document = &self.setup.document;
        let default = || document.child(self.setup.default_of(self.class())?, property);
        let found = document.child(self.element, property).or_else(default)?;
        self.setup.mark(found);
        Some(found)
    }

    /// The object below this tag.
    pub fn child(&self, property: &str) -> Option<Properties<'a>> {
        self.element(property).map(|element| Properties { setup: self.setup, element })
    }

    /// Objects of a set; of the set that this is, for an empty name.
    pub fn objects(&self, set: &str) -> Vec<Properties<'a>> {
        let found = if set.is_empty() { Some(*self) } else { self.child(set).or_else(|| self.named(set)) };
        let Some(set) = found else { return Vec::new() };
        if let Some(groups) = set.child("groups") {
            groups.ignore();
        }
        let Some(objects) = set.child("objects") else { return Vec::new() };
        let children = self.setup.document.children(objects.element).iter();
        children.map(|&element| self.setup.at(element)).collect()
    }

    /// Objects of a list: those of a set, or the list's own children.
    pub fn members(&self, list: &str) -> Vec<Properties<'a>> {
        let Some(list) = self.child(list) else { return Vec::new() };
        let parent = list.child("objects").unwrap_or(list);
        let children = self.setup.document.children(parent.element).iter();
        children.map(|&element| self.setup.at(element)).collect()
    }

    /// The object that is a property by its name: `<FunctionSet name="ControlFunctions">`.
    fn named(&self, property: &str) -> Option<Properties<'a>> {
        let document = &self.setup.document;
        let is_named = |child: &&ElementId| document.attribute(**child, "name").as_deref() == Some(property);
        let element = *document.children(self.element).iter().find(is_named)?;
        self.setup.mark(element);
        Some(Properties { setup: self.setup, element })
    }

    /// Takes everything below as read.
    pub fn ignore(&self) {
        self.setup.mark(self.element);
        for &child in self.setup.document.children(self.element) {
            Properties { setup: self.setup, element: child }.ignore();
        }
    }

    /// Takes properties as read that change nothing of what is computed.
    pub fn ignore_all(&self, properties: &[&str]) {
        properties.iter().filter_map(|p| self.child(p)).for_each(|p| p.ignore());
    }

    /// Text of a property; `None` if absent.
    pub fn text(&self, property: &str) -> Option<String> {
        self.element(property).map(|e| self.setup.document.text(e))
    }

    /// Text of a property, empty if absent or "Unassigned".
    pub fn string(&self, property: &str) -> String {
        self.text(property).filter(|text| text != "Unassigned").unwrap_or_default()
    }

    /// The file that a property names; `None` if none.
    pub fn file(&self, property: &str) -> Option<PathBuf> {
        let text = self.string(property);
        (!text.is_empty()).then(|| self.setup.resolve(&text))
    }

    /// Words of a property; `None` if absent.
    pub fn words(&self, property: &str) -> Option<Vec<String>> {
        let text = self.text(property)?;
        Some(text.split_ascii_whitespace().map(str::to_owned).collect())
    }

    fn value<T: FromStr>(&self, property: &str, default: T, expected: &str) -> Result<T, ToolError> {
        match self.text(property) {
            None => Ok(default),
            Some(text) if text.is_empty() => Ok(default),
            Some(text) => text.parse().map_err(|_| self.bad_value(property, expected, &text)),
        }
    }

    /// A finite number.
    ///
    /// # Errors
    /// Something else stands there.
    pub fn number(&self, property: &str, default: f64) -> Result<f64, ToolError> {
        self.number_that(property, default, "a number", f64::is_finite)
    }

    /// A number, infinite ones among them, that some rule allows; the default always.
    ///
    /// - `expected`: the rule in words
    ///
    /// # Errors
    /// Something else stands there.
    pub fn number_that(
        &self,
        property: &str,
        default: f64,
        expected: &str,
        is_allowed: impl Fn(f64) -> bool,
    ) -> Result<f64, ToolError> {
        let text = self.text(property).filter(|text| !text.is_empty());
        let Some(text) = text else { return Ok(default) };
        let found = text.parse().ok().filter(|value| is_allowed(*value));
        found.ok_or_else(|| self.bad_value(property, expected, &text))
    }

    /// A time [s], infinite ones among them.
    ///
    /// # Errors
    /// Something else stands there.
    pub fn time(&self, property: &str, default: f64) -> Result<f64, ToolError> {
        self.number_that(property, default, "a time", |time| !time.is_nan())
    }

    /// A whole number.
    ///
    /// # Errors
    /// Something else stands there.
    pub fn integer(&self, property: &str, default: i64) -> Result<i64, ToolError> {
        self.value(property, default, "a whole number")
    }

    /// A whole number within a range.
    ///
    /// # Errors
    /// Something else stands there.
    pub fn count(&self, property: &str, default: usize, range: RangeInclusive<usize>) -> Result<usize, ToolError> {
        let text = self.text(property).filter(|text| !text.is_empty());
        let Some(text) = text else { return Ok(default) };
        let expected = match (*range.start(), *range.end()) {
            (start, usize::MAX) => format!("a whole number from {start} on"),
            (start, end) => format!("a whole number from {start} to {end}"),
        };
        let found = text.parse().ok().filter(|count| range.contains(count));
        found.ok_or_else(|| self.bad_value(property, &expected, &text))
    }

    /// `true` or `false`.
    ///
    /// # Errors
    /// Something else stands there.
    pub fn boolean(&self, property: &str, default: bool) -> Result<bool, ToolError> {
        match self.text(property) {
            None => Ok(default),
            Some(text) => match text.to_lowercase().as_str() {
                "" => Ok(default),
                "true" | "1" => Ok(true),
                "false" | "0" => Ok(false),
                _ => Err(self.bad_value(property, "true or false", &text)),
            },
        }
    }

    /// Whether a controller acts (`enabled`, before 4.0 `isDisabled`).
    ///
    /// # Errors
    /// Something else than a truth value stands there.
    pub fn is_enabled(&self) -> Result<bool, ToolError> {
        match self.text("isDisabled") {
            Some(_) => Ok(!self.boolean("isDisabled", false)?),
            None => self.boolean("enabled", true),
        }
    }

    /// Finite numbers.
    ///
    /// # Errors
    /// Something else stands there, or another count.
    pub fn numbers<const N: usize>(&self, property: &str, default: [f64; N]) -> Result<[f64; N], ToolError> {
        self.numbers_that(property, default, &format!("{N} numbers"), |n| n.iter().all(|x| x.is_finite()))
    }

    /// First and last time [s], infinite ones among them.
    ///
    /// # Errors
    /// Something else stands there, or the last time lies before the first.
    pub fn time_range(&self, property: &str, default: [f64; 2]) -> Result<[f64; 2], ToolError> {
        self.numbers_that(property, default, "2 numbers, the first and the last time", |[first, last]| first <= last)
    }

    /// Numbers that some rule allows; the default always.
    ///
    /// - `expected`: the rule in words
    ///
    /// # Errors
    /// Something else stands there, or another count.
    pub fn numbers_that<const N: usize>(
        &self,
        property: &str,
        default: [f64; N],
        expected: &str,
        is_allowed: impl Fn(&[f64; N]) -> bool,
    ) -> Result<[f64; N], ToolError> {
        let Some(text) = self.text(property).filter(|t| !t.is_empty()) else { return Ok(default) };
        let numbers: Result<Vec<f64>, _> = text.split_ascii_whitespace().map(str::parse).collect();
        let found = numbers.ok().and_then(|n| <[f64; N]>::try_from(n).ok()).filter(is_allowed);
        found.ok_or_else(|| self.bad_value(property, expected, &text))
    }

    /// Three numbers.
    ///
    /// # Errors
    /// Something else stands there.
    pub fn vector(&self, property: &str) -> Result<Vector3<f64>, ToolError> {
        self.numbers::<3>(property, [0.0; 3]).map(Vector3::from)
    }

    /// An error at a property.
    pub fn bad_value(&self, property: &str, expected: &str, found: &str) -> ToolError {
        let problem = ToolProblem::Value {
            property: property.to_owned(),
            expected: expected.to_owned(),
            found: found.to_owned(),
        };
        self.error_at(property, problem)
    }

    /// A property or class that is not supported.
    pub fn unsupported(&self, what: &str, instead: &str) -> ToolError {
        let problem = ToolProblem::Unsupported { what: what.to_owned(), instead: instead.to_owned() };
        self.error_at(what, problem)
    }

    /// A property that has to be given.
    pub fn missing(&self, property: &str, expected: &str) -> ToolError {
        let problem = ToolProblem::Missing { property: property.to_owned(), expected: expected.to_owned() };
        self.error_at(property, problem)
    }

    /// An error at a property, or at the object where the property is absent.
    pub fn error_at(&self, property: &str, problem: impl Into<ToolProblem>) -> ToolError {
        let child = self.setup.document.child(self.element, property);
        let line = child.map_or_else(|| self.line(), |element| self.setup.document.line(element));
        ToolError::at(&self.setup.path, line, problem)
    }
}
