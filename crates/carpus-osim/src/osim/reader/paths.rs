//! Geometry paths: points and wraps.

use nalgebra::Vector3;

use super::functions::is_function;
use super::object::{Names, Object};
use super::properties::Bound;
use super::state::Reader;
use crate::osim::diagnostics::Severity;
use crate::osim::document::ElementId;
use crate::osim::error::{ProblemKind, nearest};
use crate::osim::spec::{
    CoordinateIndex, FrameIndex, FunctionSpec, PathPointKind, PathPointSpec, PathSpec, PathWrapSpec, WrapMethod,
    WrapObjectIndex,
};

const POINT_SETS: [&str; 2] = ["PathPointSet", "MusclePointSet"];
const WRAP_SETS: [&str; 2] = ["PathWrapSet", "MuscleWrapSet"];

impl Reader<'_> {
    /// The path of a muscle, ligament or spring; `None` if it is of a class that is not supported (class name given
    /// back as the error).
    pub(super) fn read_path(&mut self, owner: &Object) -> Result<PathSpec, String> {
        let element = self
            .property(owner, &["GeometryPath"])
            .or_else(|| self.one_object(owner, "path", |tag| tag.ends_with("Path")).flatten());
        let object = match element {
            Some(element) => match self.document.tag(element) {
                "GeometryPath" => self.object(element, &owner.path, "path"),
                "FunctionBasedPath" => return self.read_function_path(element, owner),
                "Scholz2015GeometryPath" => return self.read_scholz_path(element, owner),
                class => return Err(class.to_owned()),
            },
            // Formats of OpenSim 1: the sets stand in the muscle itself.
            None => Object { path: format!("{}/path", owner.path), ..owner.clone() },
        };
        let mut names = Names::default();
        let points = self.read_points(&object, &mut names);
        let wraps = self.read_wraps(&object, &mut names);
        if points.1 < 2 {
            self.problem(object.line, &object.path, ProblemKind::TooFewPathPoints { found: points.1 });
        }
        Ok(PathSpec { at: self.location(&object), points: points.0, wraps, functions: None })
    }

    fn path_objects(&mut self, path: &Object, sets: &[&'static str]) -> Vec<ElementId> {
        let Some(set) = self.property(path, sets) else { return Vec::new() };
        let Some(objects) = self.document.child(set, "objects") else { return Vec::new() };
        self.mark(objects);
        self.document.children(objects).to_vec()
    }

    /// The points that could be read and the number of points in the file.
    fn read_points(&mut self, path: &Object, names: &mut Names) -> (Vec<PathPointSpec>, usize) {
        let elements = self.path_objects(path, &POINT_SETS);
        let count = elements.len();
        let points = elements.into_iter().filter_map(|element| {
            let name = self.component_name(element, names, &path.path);
            let object = self.object(element, &path.path, &name);
            self.read_point(element, &object, name)
        });
        (points.collect(), count)
    }

    fn read_point(&mut self, element: ElementId, object: &Object, name: String) -> Option<PathPointSpec> {
        let tag = self.document.tag(element).to_owned();
        let kind = match tag.as_str() {
            "PathPoint" | "MusclePoint" => PathPointKind::Fixed { location: self.point_location(object) },
            "ConditionalPathPoint" | "MuscleViaPoint" => {
                let location = self.point_location(object);
                let range = self.numbers(object, &["range"], [0.0, 0.0], Bound::Any);
                let coordinate = self.point_coordinate(object, "coordinate", &["coordinate", "coordinates"]);
                let Some(coordinate) = coordinate else {
                    let property = "coordinate".to_owned();
                    self.problem(
                        object.line,
                        &object.path,
                        ProblemKind::Missing { property, expected: "a coordinate" },
                    );
                    return None;
                };
                PathPointKind::Conditional { location, coordinate: coordinate?, range }
            }
            "MovingPathPoint" | "MovingMusclePoint" => self.read_moving(element, object)?,
            _ => {
                self.problem(object.line, &object.path, ProblemKind::UnsupportedClass { class: tag });
                return None;
            }
        };
        self.diagnostics.understood(&tag);
        let frame = self.point_frame(object)?;
        Some(PathPointSpec { name, at: self.location(object), frame, kind })
    }

    fn point_location(&mut self, object: &Object) -> Vector3<f64> {
        self.vector3(object, &["location"], Vector3::zeros())
    }

    pub(super) fn point_frame(&mut self, object: &Object) -> Option<FrameIndex> {
        if self.version.has_locations_in_bodies()
            && let Some((element, name)) = self.string(object, &["body"])
        {
            return self.body_at(object, element, "body", &name);
        }
        self.frame_socket(object, "parent_frame")
    }

    /// The coordinate of a point: `None` if not given, `Some(None)` if unknown (reported).
    fn point_coordinate(
        &mut self,
        object: &Object,
        socket: &'static str,
        old: &[&'static str],
    ) -> Option<Option<CoordinateIndex>> {
        if self.version.has_locations_in_bodies()
            && let Some((element, name)) = self.string(object, old)
        {
            return Some(self.coordinate_named(object, Some(element), socket, &name));
        }
        let (element, text) = self.socket(object, socket)?;
        Some(self.coordinate_at(object, element, &format!("socket_{socket}"), &text))
    }

    fn read_moving(&mut self, element: ElementId, object: &Object) -> Option<PathPointKind> {
        const COMPONENTS: [(&str, &str, &str); 3] = [
            ("x_location", "XAttachment", "x_coordinate"),
            ("y_location", "YAttachment", "y_coordinate"),
            ("z_location", "ZAttachment", "z_coordinate"),
        ];
        let mut components = Vec::with_capacity(3);
        for (location, old, coordinate) in COMPONENTS {
            let function = self.moving_component(object, location, old);
            let coordinate = match self.point_coordinate(object, coordinate, &[coordinate]) {
                None => None,
                Some(Some(coordinate)) => Some(coordinate),
                Some(None) => return None,
            };
            components.push((function, coordinate));
        }
        if components.windows(2).any(|pair| pair[0].1 != pair[1].1) {
            let message = "x, y and z follow different coordinates: OpenSim 4.6 refuses such a model".to_owned();
            self.diagnose(Severity::Warning, element, &object.path, message, None);
        }
        let location: [(FunctionSpec, Option<CoordinateIndex>); 3] = components.try_into().ok()?;
        Some(PathPointKind::Moving { location: Box::new(location) })
    }

    fn moving_component(&mut self, object: &Object, name: &'static str, old: &'static str) -> FunctionSpec {
        let zero = FunctionSpec::Constant { value: 0.0 };
        let Some(property) = self.property(object, &[name, old]) else { return zero };
        let children = self.document.children(property);
        let Some(element) = children.iter().copied().find(|&child| is_function(self.document.tag(child))) else {
            let kind = ProblemKind::Missing { property: name.to_owned(), expected: "a function" };
            self.problem(self.document.line(property), &object.path, kind);
            return zero;
        };
        self.function(element, object).unwrap_or_else(|| {
            let class = self.document.tag(element).to_owned();
            self.problem(self.document.line(element), &object.path, ProblemKind::UnsupportedClass { class });
            zero
        })
    }

    fn read_wraps(&mut self, path: &Object, names: &mut Names) -> Vec<PathWrapSpec> {
        let elements = self.path_objects(path, &WRAP_SETS);
        elements
            .into_iter()
            .filter(|&element| matches!(self.document.tag(element), "PathWrap" | "MuscleWrap"))
            .collect::<Vec<_>>()
            .into_iter()
            .filter_map(|element| {
                let name = self.component_name(element, names, &path.path);
                let object = self.object(element, &path.path, &name);
                self.read_wrap(&object, name)
            })
            .collect()
    }

    fn read_wrap(&mut self, object: &Object, name: String) -> Option<PathWrapSpec> {
        self.diagnostics.understood("PathWrap");
        let Some((element, wanted)) = self.string(object, &["wrap_object"]) else {
            let property = "wrap_object".to_owned();
            self.problem(object.line, &object.path, ProblemKind::Missing { property, expected: "a wrap object" });
            return None;
        };
        let method = self.wrap_method(object);
        let range = self.wrap_range(object);
        let Some(wrap_object) = self.wrap_object_named(&wanted) else {
            let names = self.spec.wrap_objects.iter().map(|wrap| wrap.name.as_str());
            let nearest = nearest(&wanted, names);
            let property = "wrap_object".to_owned();
            let kind = ProblemKind::UnknownReference { property, what: "wrap object", name: wanted, nearest };
            self.problem(self.document.line(element), &object.path, kind);
            return None;
        };
        Some(PathWrapSpec { name, at: self.location(object), wrap_object, method, range })
    }

    /// The first wrap object of that name in the order in which OpenSim visits frames.
    fn wrap_object_named(&self, name: &str) -> Option<WrapObjectIndex> {
        let wanted = self.reference(name);
        let candidates = self.spec.wrap_objects.iter().enumerate().filter(|(_, wrap)| wrap.name == wanted);
        candidates
            .min_by_key(|(_, wrap)| self.search_order.iter().position(|&frame| frame == wrap.frame))
            .map(|(index, _)| WrapObjectIndex(index))
    }

    fn wrap_method(&mut self, object: &Object) -> WrapMethod {
        let Some((element, text)) = self.string(object, &["method"]) else { return WrapMethod::Hybrid };
        match text.as_str() {
            "hybrid" | "Hybrid" | "HYBRID" | "Unassigned" => WrapMethod::Hybrid,
            "midpoint" | "Midpoint" | "MIDPOINT" => WrapMethod::Midpoint,
            "axial" | "Axial" | "AXIAL" => WrapMethod::Axial,
            _ => {
                self.not_readable(element, object, "method", "hybrid, midpoint or axial", &text);
                WrapMethod::Hybrid
            }
        }
    }

    fn wrap_range(&mut self, object: &Object) -> [i32; 2] {
        let values = self.numbers(object, &["range"], [-1.0, -1.0], Bound::Finite);
        for value in values {
            if value.fract() != 0.0 || value.abs() > 1e6 {
                let expected = "numbers of path points";
                let kind = ProblemKind::OutOfRange { property: "range".to_owned(), expected, found: value };
                self.problem(object.line, &object.path, kind);
                return [-1, -1];
            }
        }
        values.map(|value| value as i32)
    }
}
