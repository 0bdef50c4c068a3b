//! Paths that are no `GeometryPath`: by functions of coordinates, and by the shortest way over obstacles.

use super::functions::is_function;
use super::object::{Names, Object};
use super::state::Reader;
use crate::osim::document::ElementId;
use crate::osim::error::ProblemKind;
use crate::osim::spec::{CoordinateIndex, FunctionSpec, PathFunctionsSpec, PathPointKind, PathPointSpec, PathSpec};
use nalgebra::Vector3;

impl Reader<'_> {
    /// A `FunctionBasedPath`; the class of a function that is not supported as the error.
    pub(super) fn read_function_path(&mut self, element: ElementId, owner: &Object) -> Result<PathSpec, String> {
        let object = self.object(element, &owner.path, "path");
        let paths = self.property(&object, &["coordinate_paths"]);
        let names = self.words(&object, &["coordinate_paths"]);
        if names.is_empty() {
            let kind =
                ProblemKind::Missing { property: "coordinate_paths".to_owned(), expected: "the path of a coordinate" };
            self.problem(object.line, &object.path, kind);
        }
        let coordinates: Vec<CoordinateIndex> =
            names.iter().filter_map(|name| self.coordinate_at(&object, paths, "coordinate_paths", name)).collect();
        let length = match self.functions_in(&object, "length_function").first() {
            Some(&function) => self.path_function(function, &object)?,
            None => {
                let kind = ProblemKind::Missing { property: "length_function".to_owned(), expected: "a function" };
                self.problem(object.line, &object.path, kind);
                FunctionSpec::Constant { value: 0.0 }
            }
        };
        let arms = self.functions_in(&object, "moment_arm_functions");
        let moment_arms: Vec<FunctionSpec> =
            arms.into_iter().map(|function| self.path_function(function, &object)).collect::<Result<_, _>>()?;
        if !moment_arms.is_empty() && moment_arms.len() != names.len() {
            let kind = ProblemKind::NotReadable {
                property: "moment_arm_functions".to_owned(),
                expected: "one function for each coordinate, or none",
                found: format!("{} functions for {} coordinates", moment_arms.len(), names.len()),
            };
            self.problem(object.line, &object.path, kind);
        }
        let speed = self.functions_in(&object, "lengthening_speed_function");
        let lengthening_speed = speed.first().map(|&function| self.path_function(function, &object)).transpose()?;
        self.diagnostics.understood("FunctionBasedPath");
        let functions = PathFunctionsSpec { coordinates, length, moment_arms, lengthening_speed };
        let at = self.location(&object);
        Ok(PathSpec { at, points: Vec::new(), wraps: Vec::new(), functions: Some(Box::new(functions)) })
    }

    /// Functions that a property holds.
    fn functions_in(&mut self, object: &Object, property: &'static str) -> Vec<ElementId> {
        let Some(holder) = self.property(object, &[property]) else { return Vec::new() };
        let children = self.document.children(holder).iter().copied();
        children.filter(|&child| is_function(self.document.tag(child))).collect()
    }

    fn path_function(&mut self, element: ElementId, object: &Object) -> Result<FunctionSpec, String> {
        let function = self.function(element, object);
        function.ok_or_else(|| format!("FunctionBasedPath with a {}", self.document.tag(element)))
    }

    /// A `Scholz2015GeometryPath` through points alone, which is a path of straight lines; one over obstacles as the
    /// error.
    pub(super) fn read_scholz_path(&mut self, element: ElementId, owner: &Object) -> Result<PathSpec, String> {
        let object = self.object(element, &owner.path, "path");
        let elements = match self.property(&object, &["path_elements"]) {
            Some(elements) => self.document.children(elements).to_vec(),
            None => Vec::new(),
        };
        if elements.iter().any(|&element| self.document.tag(element) != "Scholz2015GeometryPathPoint") {
            return Err("Scholz2015GeometryPath over obstacles".to_owned());
        }
        let mut names = Names::default();
        let mut points = Vec::new();
        for &element in &elements {
            let name = self.component_name(element, &mut names, &object.path);
            let holder = self.object(element, &object.path, &name);
            let Some(inner) = self.property(&holder, &["PathPoint"]) else {
                let kind = ProblemKind::Missing { property: "PathPoint".to_owned(), expected: "a point" };
                self.problem(holder.line, &holder.path, kind);
                continue;
            };
            let inner_name = self.document.attribute(inner, "name").unwrap_or_else(|| "PathPoint".to_owned());
            let point = self.object(inner, &holder.path, &inner_name);
            let location = self.vector3(&point, &["location"], Vector3::zeros());
            let Some(frame) = self.point_frame(&point) else { continue };
            points.push(PathPointSpec {
                name,
                at: self.location(&point),
                frame,
                kind: PathPointKind::Fixed { location },
            });
        }
        if elements.len() < 2 {
            self.problem(object.line, &object.path, ProblemKind::TooFewPathPoints { found: elements.len() });
        }
        self.diagnostics.understood("Scholz2015GeometryPath");
        Ok(PathSpec { at: self.location(&object), points, wraps: Vec::new(), functions: None })
    }
}
