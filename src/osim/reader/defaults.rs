//! `<defaults>` that hold beyond their own file.
//!
//! OpenSim registers the objects of `<defaults>` for good (`Object::updateDefaultObjectsFromXMLNode`): a file that is read
//! later has them too, and its own default of the same class only changes the properties that it gives.

use std::collections::BTreeMap;

use super::force_sets::force_set_element;
use super::model_element;
use super::upgrade::present_class;
use crate::osim::document::{Document, ElementId};
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
    known.learn(model, model_element(model)?.0);
    let mut completed = Vec::with_capacity(force_sets.len());
    for document in force_sets {
        let set = force_set_element(document)?.0;
        completed.push(known.complete(document, set)?);
        known.learn(document, set);
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
    let mut known = Defaults::default();
    known.learn(earlier, owner);
    Ok(known.complete(model, model_element(model)?.0)?)
}

impl Defaults {
    /// Takes over what a document states below `owner`.
    fn learn(&mut self, document: &Document, owner: ElementId) {
        let Some(defaults) = document.child(owner, "defaults") else { return };
        for (class, element) in first_of_each_tag(document, defaults).filter(|(tag, _)| present_class(tag) == *tag) {
            let known = self.0.entry(class.to_owned()).or_default();
            for (property, element) in first_of_each_tag(document, element) {
                let text = String::from_utf8_lossy(&document.bytes()[document.range(element)]);
                known.insert(property.to_owned(), text.replace(['\r', '\n'], " "));
            }
        }
    }

    /// The document with what it lacks.
    fn complete(&self, document: &Document, owner: ElementId) -> Result<Document, DocumentError> {
        let defaults = document.child(owner, "defaults");
        let (mut edits, mut classes) = (Vec::new(), String::new());
        for (class, properties) in &self.0 {
            let own = defaults.and_then(|defaults| document.child(defaults, class));
            let lacks = |property: &str| own.is_none_or(|own| document.child(own, property).is_none());
            let missing: String =
                properties.iter().filter(|(property, _)| lacks(property)).map(|(_, text)| text.as_str()).collect();
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

/// Children of an element, of each tag the first, which is the one that counts.
fn first_of_each_tag(document: &Document, parent: ElementId) -> impl Iterator<Item = (&str, ElementId)> {
    let children = document.children(parent).iter().map(|&child| (document.tag(child), child));
    children.filter(move |(tag, child)| document.child(parent, tag) == Some(*child))
}
