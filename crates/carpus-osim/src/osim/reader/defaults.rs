//! `<defaults>` that hold beyond their own file.
//!
//! OpenSim registers the objects of `<defaults>` for good (`Object::updateDefaultObjectsFromXMLNode`): a file that is
//! read later has them too, and its own default of the same class only changes the properties that it gives. What an
//! older file says is understood by its own format.

use std::collections::BTreeMap;

use super::force_sets::force_set_element;
use super::format::{OLDEST_FORCE_SET, format_version, model_element};
use super::muscles::is_muscle;
use super::properties::is_true;
use super::upgrade::{Version, present_class};
use crate::osim::document::{Document, ElementId, escape};
use crate::osim::error::{DocumentError, OsimError};

/// Texts of properties, by class and by property.
#[derive(Default)]
struct Defaults(BTreeMap<String, BTreeMap<String, String>>);

/// Files of forces, each with the defaults of the model and of the files before it; lines stay what they are.
///
/// # Errors
/// A document that has no model or no force set.
pub(in crate::osim) fn with_earlier_defaults(
    model: &Document,
    force_sets: &[Document],
) -> Result<Vec<Document>, OsimError> {
    let mut known = Defaults::default();
    let (element, version) = model_element(model)?;
    known.learn(model, element, version);
    let mut completed = Vec::with_capacity(force_sets.len());
    for document in force_sets {
        let (set, version) = force_set_element(document)?;
        completed.push(known.complete(document, set, version)?);
        known.learn(document, set, version);
    }
    Ok(completed)
}

/// A model with the defaults of a document that is read before it; lines stay what they are.
///
/// - `owner`: what has the `<defaults>` in the earlier document
///
/// # Errors
/// A document that has no model.
pub(in crate::osim) fn with_defaults_of(
    earlier: &Document,
    owner: ElementId,
    model: &Document,
) -> Result<Document, OsimError> {
    let (element, version) = model_element(model)?;
    let mut known = Defaults::default();
    known.learn(earlier, owner, format_version(earlier, 0).unwrap_or(Version(OLDEST_FORCE_SET)));
    Ok(known.complete(model, element, version)?)
}

impl Defaults {
    /// Takes over what a document states below `owner`, in today's words.
    fn learn(&mut self, document: &Document, owner: ElementId, version: Version) {
        let Some(defaults) = document.child(owner, "defaults") else { return };
        for (class, element) in first_of_each_tag(document, defaults).filter(|(tag, _)| present_class(tag) == *tag) {
            self.0.entry(class.to_owned()).or_default().extend(upgraded_properties(document, element, version));
        }
    }

    /// The document with what it lacks.
    fn complete(&self, document: &Document, owner: ElementId, version: Version) -> Result<Document, DocumentError> {
        let defaults = document.child(owner, "defaults");
        let (mut edits, mut classes) = (Vec::new(), String::new());
        for (class, properties) in &self.0 {
            let own = defaults.and_then(|defaults| document.child(defaults, class));
            let given = own.map(|own| upgraded_properties(document, own, version)).unwrap_or_default();
            let missing: String = properties
                .iter()
                .filter(|(property, _)| !given.contains_key(*property))
                .map(|(_, text)| text.as_str())
                .collect();
            match own {
                Some(own) => edits.push(document.appended(own, &missing)),
                None => classes.push_str(&format!("<{class}>{missing}</{class}>")),
            }
        }
        edits.push(match defaults {
            Some(defaults) => document.appended(defaults, &classes),
            None => document.appended(owner, &format!("<defaults>{classes}</defaults>")),
        });
        document.spliced(edits)
    }
}

/// What an object of `<defaults>` states: elements by the present names of their properties.
fn upgraded_properties(document: &Document, object: ElementId, version: Version) -> BTreeMap<String, String> {
    let class = document.tag(object);
    let mut properties = BTreeMap::new();
    for (tag, element) in first_of_each_tag(document, object) {
        let value = document.text(element);
        if is_muscle(class) && version.ignores_control(tag, value.parse().unwrap_or(f64::NAN)) {
            continue;
        }
        let (name, value) = match version.present_property(class, tag) {
            Some(name) if tag == "isDisabled" => {
                (name, Some(if is_true(&value) { "false" } else { "true" }.to_owned()))
            }
            Some(name) => (name, Some(value)),
            None => (tag, None),
        };
        let text = match value {
            Some(value) => format!("<{name}>{}</{name}>", escape(&value)),
            None => String::from_utf8_lossy(&document.bytes()[document.range(element)]).replace(['\r', '\n'], " "),
        };
        properties.insert(name.to_owned(), text);
    }
    properties
}

/// Children of an element, of each tag the first, which is the one that counts.
fn first_of_each_tag(document: &Document, parent: ElementId) -> impl Iterator<Item = (&str, ElementId)> {
    let children = document.children(parent).iter().map(|&child| (document.tag(child), child));
    children.filter(move |(tag, child)| document.child(parent, tag) == Some(*child))
}
