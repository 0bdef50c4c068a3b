//! Everything in the file that was not read, sorted into ignored, unsupported and unknown.

use std::collections::HashMap;

use super::state::Reader;
use crate::osim::diagnostics::{Diagnostic, Severity};
use crate::osim::document::ElementId;
use crate::osim::error::nearest;

/// Elements that have no influence on motion, forces or moments, with the reason.
fn ignored(tag: &str) -> Option<&'static str> {
    Some(match tag {
        "FrameGeometry"
        | "attached_geometry"
        | "Appearance"
        | "VisibleObject"
        | "ModelVisualPreferences"
        | "display_preference"
        | "color"
        | "default_color"
        | "geometry"
        | "GeometrySet"
        | "WrapDisplay"
        | "moment_visual_scale"
        | "force_visual_scale"
        | "visual_aspect_ratio"
        | "Mesh"
        | "geometry_files"
        | "frame_geometry"
        | "display_geometry" => "appearance only",
        "Sphere" | "Cylinder" | "Brick" | "Ellipsoid" | "Cone" | "Torus" | "Arrow" | "LineGeometry" => {
            "appearance only"
        }
        "Station" | "Marker" | "IMU" | "ExperimentalSensor" => "a point that no force uses",
        "credits" | "publications" => "documentation only",
        "groups" => "groups are names for sets of components",
        "ProbeSet" => "probes only report",
        "ContactGeometrySet" => "contact geometry acts only through contact forces",
        "assembly_accuracy" => "couplers are satisfied exactly",
        "defaults" => "no component takes a value from it",
        "optimal_force" => "not used by muscles",
        "fixed" => "used only by marker placement",
        "initial_conditions_for_integration" | "initial_value" => "not used by OpenSim 4.6 either",
        _ => return None,
    })
}

/// Components that only record.
fn only_reports(tag: &str) -> bool {
    tag.ends_with("Reporter") || tag.ends_with("Probe") || tag.starts_with("TableSource")
}

impl Reader<'_> {
    /// Reports what was not read below `owner`, the component at `path` (empty for the model).
    pub(super) fn report_leftovers(&mut self, owner: ElementId, path: &str) {
        let mut once: HashMap<String, usize> = HashMap::new();
        let mut stack: Vec<(ElementId, String)> = vec![(owner, path.to_owned())];
        while let Some((element, path)) = stack.pop() {
            for &child in self.document.children(element).iter().rev() {
                let tag = self.document.tag(child).to_owned();
                let path = match self.document.attribute(child, "name") {
                    Some(name) if !name.is_empty() => format!("{path}/{name}"),
                    _ if tag == "objects" || tag == "components" => path.clone(),
                    _ => format!("{path}/{}", tag.to_lowercase()),
                };
                if let Some(reason) = ignored(&tag) {
                    let shown = !(tag == "groups" || self.is_empty(child));
                    if shown && !self.used[child.0] {
                        self.ignore_once(&mut once, child, path, &tag, reason);
                    }
                } else if tag == "ControllerSet" {
                    self.unsupported_members(child, &path);
                } else if !self.used[child.0] {
                    self.report_unread(element, child, path, &tag);
                } else {
                    self.refuse_external_file(child, &path, &tag);
                    stack.push((child, path));
                }
            }
        }
    }

    fn is_empty(&self, element: ElementId) -> bool {
        let no_objects = self.document.children(element).iter().all(|&child| {
            let tag = self.document.tag(child);
            (tag == "objects" || tag == "groups") && self.document.children(child).is_empty()
        });
        no_objects && self.document.text(element).is_empty() || self.has_only_empty_sets(element)
    }

    fn has_only_empty_sets(&self, element: ElementId) -> bool {
        let children = self.document.children(element);
        !children.is_empty()
            && children.iter().all(|&child| {
                matches!(self.document.tag(child), "objects" | "groups") && self.document.children(child).is_empty()
            })
    }

    /// One entry per tag, with all its lines.
    fn ignore_once(&mut self, once: &mut HashMap<String, usize>, at: ElementId, path: String, tag: &str, why: &str) {
        let line = self.document.line(at);
        if let Some(&index) = once.get(tag) {
            let item = &mut self.diagnostics.items[index];
            // The walk visits siblings from last to first.
            item.also_at.push(line.max(item.line));
            if line < item.line {
                item.line = line;
                item.path = path;
            }
            item.also_at.sort_unstable();
            return;
        }
        once.insert(tag.to_owned(), self.diagnostics.items.len());
        let message = format!("<{tag}>: {why}");
        let severity = Severity::Ignored;
        self.diagnostics.items.push(Diagnostic { severity, line, path, message, hint: None, also_at: Vec::new() });
    }

    fn unsupported_members(&mut self, set: ElementId, path: &str) {
        let Some(objects) = self.document.child(set, "objects") else { return };
        for &member in self.document.children(objects) {
            let tag = self.document.tag(member).to_owned();
            let name = self.document.attribute(member, "name").unwrap_or_else(|| tag.to_lowercase());
            let path = format!("{path}/{name}");
            self.report_unsupported(member, &path, &tag);
        }
    }

    fn report_unsupported(&mut self, element: ElementId, path: &str, tag: &str) {
        let (severity, message) = if only_reports(tag) {
            (Severity::Ignored, format!("{tag} only reports"))
        } else if tag.ends_with("Controller") {
            (Severity::Unsupported, format!("{tag} is not used: excitations come from the study"))
        } else {
            (Severity::Unsupported, format!("{tag} is not supported"))
        };
        self.diagnose(severity, element, path, message, None);
    }

    fn report_unread(&mut self, parent: ElementId, element: ElementId, path: String, tag: &str) {
        let owner = self.document.tag(parent).to_owned();
        if self.is_reported_as_a_whole(&owner) {
            return;
        }
        if owner == "components" || owner == "objects" || tag.chars().next().is_some_and(char::is_uppercase) {
            if !(self.is_empty(element) && tag.ends_with("Set")) {
                self.report_unsupported(element, &path, tag);
            }
            return;
        }
        let first = self.document.child(parent, tag);
        if first.is_some_and(|first| first != element && self.used[first.0]) {
            let message = format!("<{tag}> is given twice: the first one counts, as in OpenSim");
            self.diagnose(Severity::Warning, element, &path, message, None);
            return;
        }
        let known = self.known.get(&owner).into_iter().flatten().copied();
        let hint = nearest(tag, known).map(|nearest| format!("did you mean <{nearest}>?"));
        let message = format!("<{tag}> is not a property that is used in {owner}");
        let severity = if hint.is_some() { Severity::Warning } else { Severity::Ignored };
        self.diagnose(severity, element, &path, message, hint);
    }

    /// Muscles, forces and constraints that are not computed: one entry for each, none for their properties.
    fn is_reported_as_a_whole(&self, class: &str) -> bool {
        const COMPUTED: [&str; 26] = [
            "ExpressionBasedCoordinateForce",
            "Millard2012EquilibriumMuscle",
            "BushingForce",
            "ExpressionBasedBushingForce",
            "PointToPointSpring",
            "PrescribedForce",
            "Blankevoort1991Ligament",
            "CoordinateActuator",
            "ActivationCoordinateActuator",
            "TorqueActuator",
            "PointToPointActuator",
            "PointActuator",
            "PathActuator",
            "Thelen2003Muscle",
            "DeGrooteFregly2016Muscle",
            "RigidTendonMuscle",
            "CoordinateLimitForce",
            "SpringGeneralizedForce",
            "FunctionBasedBushingForce",
            "Ligament",
            "PathSpring",
            "CoordinateCouplerConstraint",
            "WeldConstraint",
            "PointConstraint",
            "ConstantDistanceConstraint",
            "PointOnLineConstraint",
        ];
        let acts = super::muscles::is_muscle(class)
            || ["Force", "Actuator", "Constraint", "Spring", "Ligament"].iter().any(|end| class.ends_with(end));
        acts && !COMPUTED.contains(&class)
    }

    fn refuse_external_file(&mut self, element: ElementId, path: &str, tag: &str) {
        if let Some(file) = self.document.attribute(element, "file").filter(|file| !file.is_empty()) {
            let message =
                format!("<{tag}> stands in another file ({file}), which is not here or of another format version");
            let hint = "paste its contents into this file".to_owned();
            self.diagnose(Severity::Unsupported, element, path, message, Some(hint));
        }
    }
}
