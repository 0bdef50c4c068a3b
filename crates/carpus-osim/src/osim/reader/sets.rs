//! Sets of a model's components.

use super::object::{COMPONENT_SET, FreeComponents, Object};
use super::state::Reader;
use crate::osim::diagnostics::Severity;
use crate::osim::document::ElementId;

impl Reader<'_> {
    pub(super) fn check_units(&mut self, model: &Object) {
        for (property, expected) in [("length_units", "meters"), ("force_units", "N")] {
            let Some(element) = self.property(model, &[property]) else { continue };
            let found = self.document.text(element);
            let same = found.eq_ignore_ascii_case(expected)
                || (property == "length_units" && ["m", "meter", "metres"].contains(&found.to_lowercase().as_str()))
                || (property == "force_units" && found.eq_ignore_ascii_case("newtons"))
                || found.is_empty();
            if !same {
                let message = format!("{property} is \"{found}\"; numbers are taken as {expected}, as in OpenSim");
                self.diagnose(Severity::Warning, element, "/", message, None);
            }
        }
    }

    /// Elements of the model's own `<components>` list and of its `<ComponentSet>`.
    pub(super) fn model_components(&mut self, model: &Object) -> FreeComponents {
        let own = model.element.and_then(|element| self.document.child(element, "components"));
        if let Some(list) = own {
            self.mark(list);
        }
        let own = own.map_or_else(Vec::new, |list| self.document.children(list).to_vec());
        FreeComponents { own, of_set: self.set_objects(model, &["ComponentSet"]) }
    }

    /// Elements of a set (`<BodySet><objects>…`) that is a child of the model.
    pub(super) fn set_objects(&mut self, model: &Object, tags: &[&'static str]) -> Vec<ElementId> {
        let Some(set) = self.property(model, tags) else { return Vec::new() };
        self.mark(set);
        let Some(objects) = self.document.child(set, "objects") else { return Vec::new() };
        self.mark(objects);
        self.document.children(objects).to_vec()
    }

    /// Objects of a set, those of the model's `<components>` with one of the classes before and those of its
    /// `<ComponentSet>` behind, each with the path of its owner.
    pub(super) fn set_and_components(
        &mut self,
        model: &Object,
        tags: &[&'static str],
        owner: &'static str,
        components: &FreeComponents,
        belongs: fn(&str) -> bool,
    ) -> Vec<(ElementId, &'static str)> {
        let objects = self.set_objects(model, tags);
        let belongs = |element: &&ElementId| belongs(self.document.tag(**element));
        let before = components.own.iter().filter(belongs).map(|&element| (element, ""));
        let behind = components.of_set.iter().filter(belongs).map(|&element| (element, COMPONENT_SET));
        before.chain(objects.into_iter().map(|element| (element, owner))).chain(behind).collect()
    }
}
