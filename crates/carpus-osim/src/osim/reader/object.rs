//! Objects of a file, and the names of components.

use std::collections::HashSet;

use crate::osim::document::ElementId;

/// An OpenSim object in the file, with the place where its class' default values stand.
#[derive(Clone, Debug)]
pub(super) struct Object {
    /// Its element; `None` if the object is only implied.
    pub(super) element: Option<ElementId>,
    /// The element of the same class in the model's `<defaults>`.
    pub(super) default: Option<ElementId>,
    /// Absolute component path.
    pub(super) path: String,
    /// Line for messages.
    pub(super) line: usize,
}

/// Path of the model's `<ComponentSet>`.
pub(super) const COMPONENT_SET: &str = "/componentset";

/// Components of the model that stand in none of its sets of bodies, joints, forces and so on; they act like those.
pub(super) struct FreeComponents {
    /// In its `<components>`.
    pub(super) own: Vec<ElementId>,
    /// In its `<ComponentSet>`.
    pub(super) of_set: Vec<ElementId>,
}

/// Names given so far to the components of one owner.
#[derive(Default)]
pub(super) struct Names(pub(super) HashSet<String>);

impl Names {
    /// `name`, or `name_0`, `name_1`, … whichever is free, as in `Component::finalizeFromProperties`.
    pub(super) fn unique(&mut self, name: &str) -> String {
        let mut unique = name.to_owned();
        let mut count = 0;
        while !self.0.insert(unique.clone()) {
            unique = format!("{name}_{count}");
            count += 1;
        }
        unique
    }
}
