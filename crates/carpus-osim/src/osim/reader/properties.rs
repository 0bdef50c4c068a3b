//! Property lookup and the reading of values.
//!
//! A property's value is that of the first child element with its name, else that of the class' element in the
//! model's `<defaults>`, else the value that the class' constructor gives it. An element without text leaves a required
//! property at its default and makes an optional one empty (`SimpleProperty::readFromXMLElement`). OpenSim keeps the
//! default also where the text cannot be read; here that is a problem.

use std::str::FromStr;

use nalgebra::Vector3;

use super::object::Object;
use super::state::Reader;
use crate::osim::diagnostics::Severity;
use crate::osim::document::ElementId;
use crate::osim::error::ProblemKind;

/// What a number has to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Bound {
    /// Any number but NaN.
    Any,
    /// Finite.
    Finite,
    /// Finite and not negative.
    NotNegative(&'static str),
    /// Finite and greater than zero.
    Positive(&'static str),
}

impl Bound {
    fn violated(self, value: f64) -> Option<&'static str> {
        match self {
            Bound::Any => None,
            Bound::Finite => (!value.is_finite()).then_some("a finite number"),
            Bound::NotNegative(expected) => (!(value.is_finite() && value >= 0.0)).then_some(expected),
            Bound::Positive(expected) => (!(value.is_finite() && value > 0.0)).then_some(expected),
        }
    }
}

/// What OpenSim takes for true where an old file says it (`SimTK::String::tryConvertToBool`).
pub(super) fn is_true(text: &str) -> bool {
    matches!(text.to_ascii_lowercase().as_str(), "true" | "1")
}

impl Reader<'_> {
    /// The element that holds a property, under its present or an older name.
    pub(super) fn property(&mut self, object: &Object, names: &[&'static str]) -> Option<ElementId> {
        self.ask(object, names);
        [object.element, object.default].into_iter().flatten().find_map(|source| {
            let found = names.iter().find_map(|name| self.document.child(source, name))?;
            self.used[found.0] = true;
            Some(found)
        })
    }

    /// As [`Reader::property`], in the object's own element only.
    pub(super) fn own_property(&mut self, object: &Object, names: &[&'static str]) -> Option<ElementId> {
        self.property(&Object { default: None, ..object.clone() }, names)
    }

    fn ask(&mut self, object: &Object, names: &[&'static str]) {
        if let Some(element) = object.element {
            match self.known.get_mut(self.document.tag(element)) {
                Some(known) => known.extend(names),
                None => {
                    self.known.insert(self.document.tag(element).to_owned(), names.iter().copied().collect());
                }
            }
        }
    }

    /// An object that is a property without name of its own (`ActiveForceLengthCurve` of a muscle).
    pub(super) fn nested(&mut self, parent: &Object, class: &'static str) -> Object {
        let element = self.property(parent, &[class]);
        let default = element.and_then(|_| self.defaults.get(class).copied());
        Object {
            element,
            default,
            path: parent.path.clone(),
            line: element.map_or(parent.line, |element| self.document.line(element)),
        }
    }

    /// The element of a property that holds exactly one object, in any of the forms that OpenSim accepts:
    /// `<name><Class>…`, `<Class name="name">`, `<Class>` (`AbstractProperty::readFromXMLParentElement`).
    /// `Some(None)` if the property is there but empty.
    pub(super) fn one_object(
        &mut self,
        object: &Object,
        name: &'static str,
        acceptable: fn(&str) -> bool,
    ) -> Option<Option<ElementId>> {
        if let Some(property) = self.property(object, &[name]) {
            let found =
                self.document.children(property).iter().copied().find(|&child| acceptable(self.document.tag(child)));
            return Some(found);
        }
        let document = self.document;
        [object.element, object.default].into_iter().flatten().find_map(|source| {
            let children = document.children(source);
            let named = children.iter().find(|&&child| document.attribute(child, "name").as_deref() == Some(name));
            let unnamed = children.iter().find(|&&child| {
                acceptable(document.tag(child)) && document.attribute(child, "name").unwrap_or_default().is_empty()
            });
            named.filter(|&&child| acceptable(document.tag(child))).or(unnamed).map(|&child| Some(child))
        })
    }

    /// A number, or `default` if the property is absent or empty.
    pub(super) fn number(&mut self, object: &Object, names: &[&'static str], default: f64, bound: Bound) -> f64 {
        let Some(element) = self.property(object, names) else { return default };
        self.warn_if_empty(element, object, names[0], &default.to_string());
        self.number_at(element, object, names[0], bound).unwrap_or(default)
    }

    /// Says that a property without text stands for the class' own value: whoever emptied it may have meant none.
    fn warn_if_empty(&mut self, element: ElementId, object: &Object, property: &str, default: &str) {
        if self.document.text(element).is_empty() {
            let message = format!("{property} is empty: taken as {default}, the default of the class, as OpenSim does");
            let hint = "write the number, or leave the property out".to_owned();
            self.diagnose(Severity::Warning, element, &object.path, message, Some(hint));
        }
    }

    /// A number that may be absent or empty.
    pub(super) fn optional_number(&mut self, object: &Object, names: &[&'static str], bound: Bound) -> Option<f64> {
        let element = self.property(object, names)?;
        self.number_at(element, object, names[0], bound)
    }

    fn number_at(&mut self, element: ElementId, object: &Object, property: &str, bound: Bound) -> Option<f64> {
        let values = self.numbers_at(element, object, property, "a number")?;
        self.warn_surplus(element, object, property, values.len(), 1);
        let value = *values.first()?;
        if let Some(expected) = bound.violated(value) {
            let property = property.to_owned();
            let kind = ProblemKind::OutOfRange { property, expected, found: value };
            self.problem(self.document.line(element), &object.path, kind);
            return None;
        }
        Some(value)
    }

    /// The numbers of an element; `None` (with a problem) if one of them is none.
    pub(super) fn numbers_at(
        &mut self,
        element: ElementId,
        object: &Object,
        property: &str,
        expected: &'static str,
    ) -> Option<Vec<f64>> {
        let text = self.document.text(element);
        let values: Option<Vec<f64>> = text
            .split_ascii_whitespace()
            .map(|word| f64::from_str(word).ok().filter(|value| !value.is_nan()))
            .collect();
        if values.is_none() {
            self.not_readable(element, object, property, expected, &text);
        }
        values
    }

    pub(super) fn not_readable(
        &mut self,
        element: ElementId,
        object: &Object,
        property: &str,
        expected: &'static str,
        text: &str,
    ) {
        let mut found: String = text.chars().take(50).collect();
        if found.len() < text.len() {
            found.push('…');
        }
        let kind = ProblemKind::NotReadable { property: property.to_owned(), expected, found };
        self.problem(self.document.line(element), &object.path, kind);
    }

    fn warn_surplus(&mut self, element: ElementId, object: &Object, property: &str, found: usize, expected: usize) {
        if found > expected {
            let message = format!("{property}: {found} values where {expected} is expected; the rest is ignored");
            self.diagnose(Severity::Warning, element, &object.path.clone(), message, None);
        }
    }

    /// A fixed number of finite numbers, or `default` if the property is absent or empty.
    pub(super) fn numbers<const N: usize>(
        &mut self,
        object: &Object,
        names: &[&'static str],
        default: [f64; N],
        bound: Bound,
    ) -> [f64; N] {
        let Some(element) = self.property(object, names) else { return default };
        let expected = match N {
            2 => "two numbers",
            3 => "three numbers",
            _ => "six numbers",
        };
        let Some(values) = self.numbers_at(element, object, names[0], expected) else { return default };
        if values.is_empty() {
            let written: Vec<String> = default.iter().map(f64::to_string).collect();
            self.warn_if_empty(element, object, names[0], &written.join(" "));
            return default;
        }
        self.warn_surplus(element, object, names[0], values.len(), N);
        let Some(&values) = values.first_chunk::<N>() else {
            let text = self.document.text(element);
            self.not_readable(element, object, names[0], expected, &text);
            return default;
        };
        for value in values {
            if let Some(expected) = bound.violated(value) {
                let kind = ProblemKind::OutOfRange { property: names[0].to_owned(), expected, found: value };
                self.problem(self.document.line(element), &object.path, kind);
                return default;
            }
        }
        values
    }

    /// Three finite numbers.
    pub(super) fn vector3(&mut self, object: &Object, names: &[&'static str], default: Vector3<f64>) -> Vector3<f64> {
        Vector3::from(self.numbers(object, names, default.into(), Bound::Finite))
    }

    /// A list of numbers; empty if absent.
    pub(super) fn list(&mut self, object: &Object, name: &'static str) -> Vec<f64> {
        self.property(object, &[name])
            .and_then(|element| self.numbers_at(element, object, name, "numbers"))
            .unwrap_or_default()
    }

    /// `true` or `false`, or `default` if the property is absent or empty.
    pub(super) fn boolean(&mut self, object: &Object, names: &[&'static str], default: bool) -> bool {
        let Some(element) = self.property(object, names) else { return default };
        let text = self.document.text(element);
        match text.to_ascii_lowercase().as_str() {
            "true" | "1" => true,
            "false" | "0" => false,
            "" => default,
            _ => {
                self.not_readable(element, object, names[0], "true or false", &text);
                default
            }
        }
    }

    /// `appliesForce`, `isEnforced`: the opposite of `isDisabled` in old files.
    pub(super) fn enabled(&mut self, object: &Object, name: &'static str) -> bool {
        if self.version.has_is_disabled()
            && let Some(element) = self.own_property(object, &["isDisabled"])
        {
            return !is_true(&self.document.text(element));
        }
        if self.version.has_is_disabled() && self.property(object, &["isDisabled"]).is_some() {
            return !self.boolean(object, &["isDisabled"], false);
        }
        self.boolean(object, &[name], true)
    }

    /// Text of a property; `None` if absent or empty.
    pub(super) fn string(&mut self, object: &Object, names: &[&'static str]) -> Option<(ElementId, String)> {
        let element = self.property(object, names)?;
        let text = self.document.text(element);
        (!text.is_empty()).then_some((element, text))
    }

    /// Words of a property; empty if absent.
    pub(super) fn words(&mut self, object: &Object, names: &[&'static str]) -> Vec<String> {
        match self.string(object, names) {
            Some((_, text)) => text.split_ascii_whitespace().map(str::to_owned).collect(),
            None => Vec::new(),
        }
    }
}
