//! Splices that scale values, collected and applied at once.

use nalgebra::Vector3;

use crate::osim::document::{Document, ElementId};
use crate::osim::edit::EditError;
use crate::osim::edit::splice::{Splice, format_number, indentation_unit, insertion, value_edit};
use crate::osim::file::OsimFile;
use crate::osim::spec::{FunctionSpec, Location};

/// Collected edits of one file. Values that do not change are not touched.
pub(super) struct Edits {
    document: Document,
    splices: Vec<Splice>,
    /// Properties that the file does not give and that are no longer at their default: component, property, text.
    absent: Vec<(String, String, String)>,
    failed: Option<EditError>,
}

impl Edits {
    pub fn new(file: &OsimFile) -> Edits {
        Edits { document: file.document.clone(), splices: Vec::new(), absent: Vec::new(), failed: None }
    }

    /// Multiplies the components of a vector property.
    pub fn scale_vector(&mut self, at: &Location, names: &[&str], value: Vector3<f64>, factors: Vector3<f64>) {
        let after: [f64; 3] = value.component_mul(&factors).into();
        self.set_numbers(at, names, value.as_slice(), &after);
    }

    /// Multiplies a number property.
    pub fn scale_number(&mut self, at: &Location, names: &[&str], value: f64, factor: f64) {
        self.set_numbers(at, names, &[value], &[value * factor]);
    }

    /// Sets a property of numbers, under whichever of its names the file uses; the first where it has none.
    pub fn set_numbers(&mut self, at: &Location, names: &[&str], before: &[f64], after: &[f64]) {
        if before == after {
            return;
        }
        let Some(element) = at.element.map(ElementId) else { return };
        let text = after.iter().map(|v| format_number(*v)).collect::<Vec<_>>().join(" ");
        match names.iter().find_map(|name| self.document.child(element, name)) {
            Some(property) => self.set_text(property, names[0], &text),
            None => self.absent.push((at.path.clone(), names[0].to_owned(), text)),
        }
    }

    /// Sets the numbers of a property to zero where the file has others, whatever the specification makes of them.
    pub fn set_zero(&mut self, at: &Location, name: &str) {
        let Some(property) = at.element.and_then(|element| self.document.child(ElementId(element), name)) else {
            return;
        };
        let text = self.document.text(property);
        let numbers: Vec<f64> = text.split_ascii_whitespace().filter_map(|word| word.parse().ok()).collect();
        if numbers.iter().any(|v| *v != 0.0) {
            self.set_text(property, name, &vec!["0"; numbers.len()].join(" "));
        }
    }

    /// Multiplies the scale factors of the geometry attached to a frame.
    pub fn scale_geometry(&mut self, at: &Location, factors: Vector3<f64>) {
        let Some(frame) = at.element.map(ElementId).filter(|_| factors != Vector3::repeat(1.0)) else { return };
        let document = &self.document;
        let mut geometry: Vec<ElementId> = Vec::new();
        if let Some(attached) = document.child(frame, "attached_geometry") {
            geometry.extend(document.children(attached));
        }
        // Before 30502 factors of the whole stand beside the list of meshes.
        if let Some(visible) = document.child(frame, "VisibleObject") {
            let meshes = document.child(visible, "GeometrySet").and_then(|set| document.child(set, "objects"));
            match (document.child(visible, "scale_factors"), meshes) {
                (Some(_), _) => geometry.push(visible),
                (None, Some(meshes)) => geometry.extend(document.children(meshes)),
                (None, None) => {}
            }
        }
        for mesh in geometry {
            self.scale_mesh(mesh, factors);
        }
    }

    fn scale_mesh(&mut self, mesh: ElementId, factors: Vector3<f64>) {
        let Some(property) = self.document.child(mesh, "scale_factors") else {
            let text = factors.iter().map(|v| format_number(*v)).collect::<Vec<_>>().join(" ");
            let splices = insertion(&self.document, mesh, &format!("<scale_factors>{text}</scale_factors>"));
            self.splices.extend(splices);
            return;
        };
        let numbers: Vec<f64> =
            self.document.text(property).split_ascii_whitespace().filter_map(|word| word.parse().ok()).collect();
        let before = if numbers.len() == 3 { Vector3::from_column_slice(&numbers) } else { Vector3::repeat(1.0) };
        let after = before.component_mul(&factors);
        let text = after.iter().map(|v| format_number(*v)).collect::<Vec<_>>().join(" ");
        self.set_text(property, "scale_factors", &text);
    }

    /// Multiplies the function of an axis of a custom joint, except one that is the coordinate itself.
    pub fn scale_axis_function(&mut self, joint: &Location, axis: &str, function: &FunctionSpec, factor: f64) {
        if matches!(function, FunctionSpec::Linear { slope: 1.0, intercept: 0.0 }) {
            return;
        }
        let Some(joint) = joint.element.map(ElementId) else { return };
        let document = &self.document;
        let Some(transform) = document.child(joint, "SpatialTransform") else { return };
        let named = |parent: ElementId, name: &str| {
            let children = document.children(parent).iter().copied();
            children.into_iter().find(|child| {
                document.tag(*child) == name || document.attribute(*child, "name").as_deref() == Some(name)
            })
        };
        let Some(mut holder) = named(transform, axis) else { return };
        if document.tag(holder) == axis {
            // <translation1><TransformAxis>…
            match document.child(holder, "TransformAxis") {
                Some(inner) => holder = inner,
                None => return,
            }
        }
        let Some(found) = named(holder, "function") else { return };
        let element = match document.tag(found) {
            "function" => document.children(found).first().copied(),
            _ => Some(found),
        };
        if let Some(element) = element {
            self.scale_function(element, function, factor);
        }
    }

    /// Multiplies a function of a moving path point.
    pub fn scale_point_function(&mut self, at: &Location, names: &[&str], function: &FunctionSpec, factor: f64) {
        let document = &self.document;
        let Some(point) = at.element.map(ElementId) else { return };
        let holder = names.iter().find_map(|name| document.child(point, name));
        if let Some(element) = holder.and_then(|holder| document.children(holder).first().copied()) {
            self.scale_function(element, function, factor);
        }
    }

    /// A `MultiplierFunction` gets another scale, a `Constant` another value, any other function a `MultiplierFunction`
    /// around it.
    fn scale_function(&mut self, element: ElementId, function: &FunctionSpec, factor: f64) {
        if factor == 1.0 {
            return;
        }
        let at = |element: ElementId| Location { element: Some(element.0), ..Location::default() };
        match function {
            FunctionSpec::Constant { value } if self.document.child(element, "value").is_some() => {
                self.scale_number(&at(element), &["value"], *value, factor);
            }
            FunctionSpec::Constant { value: 0.0 } => {}
            FunctionSpec::Multiplier { scale, .. } if self.document.child(element, "scale").is_some() => {
                self.scale_number(&at(element), &["scale"], *scale, factor);
            }
            _ => self.wrap_function(element, factor),
        }
    }

    fn wrap_function(&mut self, element: ElementId, factor: f64) {
        let document = &self.document;
        let range = document.range(element);
        let newline = document.newline();
        let outer = document.indentation(element).unwrap_or_default().to_owned();
        let unit = indentation_unit(document);
        // A function that is named for the property it fills hands that name to what now fills it.
        let name = document.attribute(element, "name").filter(|name| name == "function");
        let name = name.map(|name| format!(" name=\"{name}\"")).unwrap_or_default();
        let open = format!("<MultiplierFunction{name}>{newline}{outer}{unit}<function>{newline}{outer}{unit}{unit}");
        let close = format!(
            "{newline}{outer}{unit}</function>\
             {newline}{outer}{unit}<scale>{}</scale>{newline}{outer}</MultiplierFunction>",
            format_number(factor)
        );
        self.splices.push((range.start..range.start, open));
        self.splices.push((range.end..range.end, close));
    }

    fn set_text(&mut self, property: ElementId, name: &str, text: &str) {
        match value_edit(&self.document, property, name, text) {
            Ok(splice) => self.splices.push(splice),
            Err(error) => self.failed = self.failed.take().or(Some(error)),
        }
    }

    /// Applies the edits: all or none.
    pub fn finish(self, file: &mut OsimFile) -> Result<(), EditError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        let before = file.clone();
        let apply = || {
            file.apply(self.splices)?;
            for (path, property, text) in &self.absent {
                file.set_property(path, property, text)?;
            }
            Ok(())
        };
        let result = apply();
        if result.is_err() {
            *file = before;
        }
        result
    }
}
