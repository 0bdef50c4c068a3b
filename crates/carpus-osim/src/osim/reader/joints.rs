//! Joints, their coordinates and spatial transforms.

use nalgebra::Vector3;

use super::functions::is_function;
use super::object::{FreeComponents, Names, Object};
use super::pending::{PendingJoint, UnresolvedOffset};
use super::properties::Bound;
use super::state::Reader;
use super::upgrade::six_significant_digits;
use crate::osim::diagnostics::{Diagnostic, Severity};
use crate::osim::document::ElementId;
use crate::osim::error::ProblemKind;
use crate::osim::spec::{
    CoordinateIndex, CoordinateSpec, FrameIndex, FrameKind, FunctionSpec, JointIndex, JointKind, JointSpec, Location,
    MotionType, TransformAxisSpec,
};
use MotionType::{Rotational, Translational};

/// Axes of a `SpatialTransform` and their directions if the file does not give them.
const AXES: [(&str, [f64; 3]); 6] = [
    ("rotation1", [1.0, 0.0, 0.0]),
    ("rotation2", [0.0, 1.0, 0.0]),
    ("rotation3", [0.0, 0.0, 1.0]),
    ("translation1", [1.0, 0.0, 0.0]),
    ("translation2", [0.0, 1.0, 0.0]),
    ("translation3", [0.0, 0.0, 1.0]),
];

/// An axis before coordinate names are resolved.
struct RawAxis {
    axis: Vector3<f64>,
    coordinates: Vec<String>,
    function: FunctionSpec,
}

pub(super) fn is_joint(tag: &str) -> bool {
    tag.ends_with("Joint")
}

impl Reader<'_> {
    /// Joints with their coordinates and inner frames; the frames they connect are resolved later.
    pub(super) fn read_joints(&mut self, model: &Object, components: &FreeComponents) {
        let mut names = Names::default();
        let mut pending = Vec::new();
        for (element, owner, child) in self.joint_elements(model, components) {
            let name = self.component_name(element, &mut names, owner);
            let object = self.object(element, owner, &name);
            if !self.read_joint(element, &object, name) {
                let class = self.document.tag(element).to_owned();
                self.problem(object.line, &object.path, ProblemKind::UnsupportedClass { class });
                continue;
            }
            self.read_joint_frames(&object, child.as_deref());
            pending.push(PendingJoint { object, child });
        }
        self.pending_joints = pending;
        self.report_equal_names();
    }

    /// Coordinates of one name: wherever a name stands for a coordinate, OpenSim takes the first.
    fn report_equal_names(&mut self) {
        for i in 0..self.spec.coordinates.len() {
            let at = |k: usize| &self.spec.coordinates[k].at;
            let name = &self.spec.coordinates[i].name;
            let Some(first) = (0..i).find(|k| self.spec.coordinates[*k].name == *name) else { continue };
            let Some(element) = at(i).element.map(ElementId) else { continue };
            let message =
                format!("{} has this name already: `{name}` means that coordinate, as in OpenSim", at(first).path);
            let path = at(i).path.clone();
            let hint = "give each coordinate a name of its own".to_owned();
            self.diagnose(Severity::Warning, element, &path, message, Some(hint));
        }
    }

    /// Element, path of the owner and, in old formats, the child body of every joint.
    fn joint_elements(
        &mut self,
        model: &Object,
        components: &FreeComponents,
    ) -> Vec<(ElementId, &'static str, Option<String>)> {
        if !self.version.has_joints_in_bodies() {
            let joints = self.set_and_components(model, &["JointSet"], "/jointset", components, is_joint);
            return joints.into_iter().map(|(element, owner)| (element, owner, None)).collect();
        }
        let bodies: Vec<(ElementId, String)> =
            self.spec.bodies.iter().filter_map(|body| Some((ElementId(body.at.element?), body.name.clone()))).collect();
        let mut joints = Vec::new();
        for (body, name) in bodies {
            let Some(holder) = self.document.child(body, "Joint") else { continue };
            self.mark(holder);
            if let Some(&joint) = self.document.children(holder).first() {
                joints.push((joint, "/jointset", Some(name)));
            }
        }
        joints
    }

    /// Reads everything but the connections; `false` if the class is not supported.
    fn read_joint(&mut self, element: ElementId, object: &Object, name: String) -> bool {
        let joint = JointIndex(self.spec.joints.len());
        let tag = self.document.tag(element).to_owned();
        let fixed = |kind: JointKind, types: &'static [MotionType]| Some((kind, types));
        let simple = match tag.as_str() {
            "WeldJoint" => fixed(JointKind::Weld, &[]),
            "PinJoint" => fixed(JointKind::Pin, &[Rotational]),
            "SliderJoint" => fixed(JointKind::Slider, &[Translational]),
            "UniversalJoint" => fixed(JointKind::Universal, &[Rotational; 2]),
            "BallJoint" => fixed(JointKind::Ball, &[Rotational; 3]),
            "GimbalJoint" => fixed(JointKind::Gimbal, &[Rotational; 3]),
            "PlanarJoint" => fixed(JointKind::Planar, &[Rotational, Translational, Translational]),
            "FreeJoint" => fixed(
                JointKind::Free,
                &[Rotational, Rotational, Rotational, Translational, Translational, Translational],
            ),
            "EllipsoidJoint" => {
                let radii_x_y_z = self.radii(object, "radii_x_y_z");
                fixed(JointKind::Ellipsoid { radii_x_y_z }, &[Rotational; 3])
            }
            "ScapulothoracicJoint" => fixed(self.scapulothoracic(object), &[Rotational; 4]),
            "ConstantCurvatureJoint" => {
                let kind = JointKind::ConstantCurvature {
                    neutral_angle_x_z_y: self.vector3(object, &["neutral_angle_x_z_y"], Vector3::zeros()),
                    length: self.number(object, &["length"], 1.0, Bound::Finite),
                };
                fixed(kind, &[Rotational; 3])
            }
            "CustomJoint" => None,
            _ => return false,
        };
        self.diagnostics.understood(&tag);
        let elements = self.coordinate_elements(object);
        let (kind, coordinates) = match simple {
            Some((kind, types)) => (kind, self.read_fixed_coordinates(object, joint, elements, types, "")),
            None => self.read_custom(object, joint, elements),
        };
        let at = self.location(object);
        let unresolved = FrameIndex(0);
        self.spec.joints.push(JointSpec {
            name,
            at,
            parent_frame: unresolved,
            child_frame: unresolved,
            coordinates,
            kind,
        });
        true
    }

    fn scapulothoracic(&mut self, object: &Object) -> JointKind {
        JointKind::Scapulothoracic {
            thoracic_ellipsoid_radii_x_y_z: self.radii(object, "thoracic_ellipsoid_radii_x_y_z"),
            scapula_winging_axis_origin: self.numbers(
                object,
                &["scapula_winging_axis_origin"],
                [0.0; 2],
                Bound::Finite,
            ),
            scapula_winging_axis_direction: self.number(
                object,
                &["scapula_winging_axis_direction"],
                0.0,
                Bound::Finite,
            ),
        }
    }

    /// Semi-axes of an ellipsoid, which have no default. Negative ones turn it inside out: OpenSim takes them, and
    /// models that were mirrored have them.
    fn radii(&mut self, object: &Object, property: &'static str) -> Vector3<f64> {
        if self.property(object, &[property]).is_none() {
            let kind = ProblemKind::Missing { property: property.to_owned(), expected: "three lengths in m" };
            self.problem(object.line, &object.path, kind);
        }
        Vector3::from(self.numbers(object, &[property], [1.0; 3], Bound::Finite))
    }

    /// `<coordinates>`, or `<CoordinateSet><objects>` in old files.
    fn coordinate_elements(&mut self, object: &Object) -> Vec<ElementId> {
        let list = match self.own_property(object, &["coordinates", "CoordinateSet"]) {
            Some(set) if self.document.tag(set) == "CoordinateSet" => {
                let objects = self.document.child(set, "objects");
                if let Some(objects) = objects {
                    self.mark(objects);
                }
                objects
            }
            found => found,
        };
        let children = list.map_or(&[][..], |list| self.document.children(list));
        children.iter().copied().filter(|&child| self.document.tag(child) == "Coordinate").collect()
    }

    fn read_fixed_coordinates(
        &mut self,
        object: &Object,
        joint: JointIndex,
        elements: Vec<ElementId>,
        types: &[MotionType],
        of_joint: &str,
    ) -> Vec<CoordinateIndex> {
        if elements.len() != types.len() && !elements.is_empty() {
            let kind = ProblemKind::WrongCoordinateCount { expected: types.len(), found: elements.len() };
            self.problem(object.line, &object.path, kind);
            return Vec::new();
        }
        let mut names = Names::default();
        let mut coordinates = Vec::new();
        for (i, &motion_type) in types.iter().enumerate() {
            let element = elements.get(i).copied();
            // The constructor names coordinates; joints of files have no name then.
            let name = match element {
                Some(element) => self.component_name(element, &mut names, &object.path),
                None => format!("{of_joint}_coord_{i}"),
            };
            coordinates.push(self.read_coordinate(element, object, name, joint, motion_type));
        }
        coordinates
    }

    fn read_custom(
        &mut self,
        object: &Object,
        joint: JointIndex,
        elements: Vec<ElementId>,
    ) -> (JointKind, Vec<CoordinateIndex>) {
        let axes = self.read_spatial_transform(object);
        // OpenSim's order: that of first mention in the SpatialTransform.
        let mut order: Vec<&String> = Vec::new();
        for name in axes.iter().flat_map(|axis| &axis.coordinates) {
            if !order.contains(&name) {
                order.push(name);
            }
        }
        let mut names = Names::default();
        let mut named: Vec<(String, ElementId)> = Vec::new();
        for element in elements {
            named.push((self.component_name(element, &mut names, &object.path), element));
        }
        // OpenSim stops at coordinates that no axis uses, unless they come last and the others stand in the order of
        // the axes.
        let unused: Vec<&(String, ElementId)> = named.iter().filter(|(name, _)| !order.contains(&name)).collect();
        let in_order = named.len() == order.len() + unused.len() && named.iter().zip(&order).all(|((a, _), &b)| a == b);
        for (name, element) in &unused {
            if in_order {
                let message = format!("coordinate \"{name}\" is not used by any axis of the joint: it moves nothing");
                self.diagnose(Severity::Warning, *element, &object.path, message, None);
            } else {
                let kind = ProblemKind::UnusedCoordinate { name: name.clone() };
                self.problem(self.document.line(*element), &object.path, kind);
            }
        }
        let idle = unused.iter().map(|(name, _)| name);
        let coordinates: Vec<CoordinateIndex> = order
            .iter()
            .copied()
            .chain(idle)
            .map(|name| {
                let element = named.iter().find(|(known, _)| known == name).map(|&(_, element)| element);
                self.read_coordinate(element, object, name.clone(), joint, motion_type(name, &axes))
            })
            .collect();
        let position = |name: &String| order.iter().position(|&known| known == name);
        let indices: Vec<Vec<CoordinateIndex>> = axes
            .iter()
            .map(|axis| axis.coordinates.iter().filter_map(|name| Some(coordinates[position(name)?])).collect())
            .collect();
        let mut indices = indices.into_iter();
        let axes = axes.map(|axis| TransformAxisSpec {
            axis: axis.axis,
            coordinates: indices.next().unwrap_or_default(),
            function: axis.function,
        });
        (JointKind::Custom(Box::new(axes)), coordinates)
    }

    fn read_spatial_transform(&mut self, object: &Object) -> [RawAxis; 6] {
        let transform = self.nested(object, "SpatialTransform");
        AXES.map(|(name, direction)| self.read_axis(&transform, name, Vector3::from(direction)))
    }

    fn read_axis(&mut self, transform: &Object, name: &'static str, direction: Vector3<f64>) -> RawAxis {
        let zero = FunctionSpec::Constant { value: 0.0 };
        let element = self.one_object(transform, name, |tag| tag == "TransformAxis").flatten();
        let Some(element) = element else {
            return RawAxis { axis: direction, coordinates: Vec::new(), function: zero };
        };
        self.mark(element);
        let default = self.defaults.get("TransformAxis").copied();
        let object = Object {
            element: Some(element),
            default,
            path: format!("{}/{name}", transform.path),
            line: self.document.line(element),
        };
        let coordinates: Vec<String> = self.words(&object, &["coordinates"]);
        let axis = self.vector3(&object, &["axis"], Vector3::new(1.0, 0.0, 0.0));
        if axis.norm() == 0.0 {
            let kind =
                ProblemKind::OutOfRange { property: "axis".to_owned(), expected: "a direction", found: axis.norm() };
            self.problem(object.line, &object.path, kind);
        }
        let function = match self.one_object(&object, "function", is_function) {
            // Absent: the constructor's Constant(0). Empty: OpenSim makes it linear if there is one coordinate.
            None => zero,
            Some(None) if coordinates.len() == 1 => FunctionSpec::Linear { slope: 1.0, intercept: 0.0 },
            Some(None) => zero,
            Some(Some(element)) => self.function(element, &object).unwrap_or_else(|| {
                let class = self.document.tag(element).to_owned();
                self.problem(self.document.line(element), &object.path, ProblemKind::UnsupportedClass { class });
                zero
            }),
        };
        RawAxis { axis, coordinates, function }
    }

    fn read_coordinate(
        &mut self,
        element: Option<ElementId>,
        joint_object: &Object,
        name: String,
        joint: JointIndex,
        motion_type: MotionType,
    ) -> CoordinateIndex {
        let object = match element {
            Some(element) => self.object(element, &joint_object.path, &name),
            None => Object {
                element: None,
                default: None,
                path: format!("{}/{name}", joint_object.path),
                line: joint_object.line,
            },
        };
        self.diagnostics.understood("Coordinate");
        // Known and without influence: it follows from the joint.
        let _ = self.own_property(&object, &["motion_type"]);
        let prescribed_function = self.prescribed_function(&object);
        let spec = CoordinateSpec {
            at: self.location(&object),
            joint,
            default_value: self.number(&object, &["default_value"], 0.0, Bound::Finite),
            default_speed_value: self.number(&object, &["default_speed_value"], 0.0, Bound::Finite),
            range: self.numbers(&object, &["range"], [-10.0, 10.0], Bound::Any),
            clamped: self.boolean(&object, &["clamped"], false),
            locked: self.boolean(&object, &["locked"], false),
            prescribed: self.boolean(&object, &["prescribed"], false) && prescribed_function.is_some(),
            prescribed_function,
            is_free_to_satisfy_constraints: self.boolean(&object, &["is_free_to_satisfy_constraints"], false),
            motion_type,
            name,
        };
        if let Some(element) = element {
            self.check_range(element, &object, &spec);
        }
        let index = CoordinateIndex(self.spec.coordinates.len());
        self.coordinates_by_path.entry(object.path).or_insert(index);
        self.spec.coordinates.push(spec);
        index
    }

    fn prescribed_function(&mut self, object: &Object) -> Option<FunctionSpec> {
        let property = self.property(object, &["prescribed_function"])?;
        let element = self.document.children(property).first().copied()?;
        let function = self.function(element, object);
        if function.is_none() {
            let message = format!("prescribed function of class {} is not used", self.document.tag(element));
            self.diagnose(Severity::Unsupported, element, &object.path, message, None);
        }
        function
    }

    fn check_range(&mut self, element: ElementId, object: &Object, spec: &CoordinateSpec) {
        let [lowest, highest] = spec.range;
        let tolerance = f64::EPSILON.sqrt();
        let message = if lowest > highest {
            format!("range {lowest} to {highest} is reversed")
        } else if spec.clamped && !(lowest - tolerance..=highest + tolerance).contains(&spec.default_value) {
            format!("default value {} lies outside the range {lowest} to {highest}", spec.default_value)
        } else {
            return;
        };
        self.diagnose(Severity::Warning, element, &object.path, message, None);
    }

    /// Frames owned by a joint: `<frames>`, `<components>`, or those that OpenSim makes from `location_in_parent` and
    /// its like in old files.
    fn read_joint_frames(&mut self, object: &Object, child: Option<&str>) {
        let mut names = Names::default();
        for list in ["components", "frames"] {
            if let Some(list) = self.own_property(object, &[list]) {
                let children = self.document.children(list).to_vec();
                self.read_offset_frames(&children, &object.path, &mut names);
            }
        }
        if !self.version.has_locations_in_bodies() {
            return;
        }
        let (parent, child) = self.connected_bodies(object, child);
        let sides = [
            (parent, ["location_in_parent", "location_in_parent"], ["orientation_in_parent", "orientation_in_parent"]),
            (child, ["location_in_child", "location"], ["orientation_in_child", "orientation"]),
        ];
        for (body, location, orientation) in sides {
            let translation = self.vector3(object, &location, Vector3::zeros()).map(six_significant_digits);
            let orientation = self.vector3(object, &orientation, Vector3::zeros()).map(six_significant_digits);
            let Some((element, body)) = body else { continue };
            let name = format!("{}_offset", self.reference(&body));
            let path = format!("{}/{name}", object.path);
            let at = Location { path, ..self.location(object) };
            let kind = FrameKind::Offset { parent: FrameIndex(0), translation, orientation };
            let frame = self.add_frame(&name, at, kind);
            self.search_order.push(frame);
            let body = self.body_path(&body);
            let parent = Some((element, body));
            self.unresolved.push(UnresolvedOffset { frame, object: object.clone(), parent });
        }
    }

    /// Names of parent and child body in formats before 30505.
    fn connected_bodies(
        &mut self,
        object: &Object,
        child: Option<&str>,
    ) -> (Option<(Option<ElementId>, String)>, Option<(Option<ElementId>, String)>) {
        let last = |(element, path): (Option<ElementId>, String)| {
            let name = path.rsplit('/').next().unwrap_or(&path).to_owned();
            (element, name)
        };
        match child {
            Some(child) => {
                let parent = self.string(object, &["parent_body"]);
                let parent = parent.map_or((None, "ground".to_owned()), |(element, name)| (Some(element), name));
                (Some(parent), Some((None, child.to_owned())))
            }
            None => (self.socket(object, "parent_frame").map(last), self.socket(object, "child_frame").map(last)),
        }
    }

    /// Resolves the frames that joints connect, once all frames are known.
    pub(super) fn read_joint_connections(&mut self) {
        for (index, PendingJoint { object, child }) in std::mem::take(&mut self.pending_joints).into_iter().enumerate()
        {
            let frames = if self.version.has_locations_in_bodies() {
                let (parent, child) = self.connected_bodies(&object, child.as_deref());
                let frame = |reader: &Self, body: Option<(Option<ElementId>, String)>| {
                    let path = format!("{}/{}_offset", object.path, reader.reference(&body?.1));
                    reader.frames_by_path.get(&path).copied()
                };
                (frame(self, parent), frame(self, child))
            } else {
                (self.frame_socket(&object, "parent_frame"), self.frame_socket(&object, "child_frame"))
            };
            let (Some(mut parent), Some(mut child)) = frames else { continue };
            if self.version.has_reverse() && self.boolean(&object, &["reverse"], false) {
                std::mem::swap(&mut parent, &mut child);
            }
            let joint = &mut self.spec.joints[index];
            joint.parent_frame = parent;
            joint.child_frame = child;
        }
        self.free_unconnected_bodies();
        self.report_loops();
    }

    /// Says which joints close loops.
    fn report_loops(&mut self) {
        for joint in self.spec.loop_joints() {
            let at = self.spec.joints[joint.0].at.clone();
            let Some(element) = at.element.map(ElementId) else { continue };
            let message = "the joint closes a loop of joints: its child is cut in two there, as in OpenSim, and \
                           held together in the trials and images of studies and in run-tool; other commands take \
                           all coordinates as given";
            self.diagnose(Severity::Unsupported, element, &at.path, message.to_owned(), None);
        }
    }

    /// A body without joint is free in OpenSim (`Model::extendConnectToModel`).
    fn free_unconnected_bodies(&mut self) {
        let connected: Vec<FrameIndex> = self
            .spec
            .joints
            .iter()
            .flat_map(|joint| [joint.parent_frame, joint.child_frame])
            .map(|frame| self.base_frame(frame))
            .collect();
        for i in 0..self.spec.bodies.len() {
            let (frame, at) = (self.spec.bodies[i].frame, self.spec.bodies[i].at.clone());
            if connected.contains(&frame) {
                continue;
            }
            let name = format!("free_{}", self.spec.bodies[i].name);
            let path = format!("/jointset/{name}");
            self.diagnostics.items.push(Diagnostic {
                severity: Severity::Warning,
                line: at.line,
                path: at.path,
                message: "body has no joint: it gets a free joint to ground, as in OpenSim".to_owned(),
                hint: None,
                also_at: Vec::new(),
            });
            let object = Object { element: None, default: None, path: path.clone(), line: at.line };
            let joint = JointIndex(self.spec.joints.len());
            let types = [Rotational, Rotational, Rotational, Translational, Translational, Translational];
            let coordinates = self.read_fixed_coordinates(&object, joint, Vec::new(), &types, &name);
            self.spec.joints.push(JointSpec {
                name,
                at: Location { path, element: None, ..at },
                parent_frame: FrameIndex(0),
                child_frame: frame,
                coordinates,
                kind: JointKind::Free,
            });
        }
    }

    pub(super) fn base_frame(&self, mut frame: FrameIndex) -> FrameIndex {
        while let FrameKind::Offset { parent, .. } = self.spec.frames[frame.0].kind {
            frame = parent;
        }
        frame
    }
}

/// OpenSim's motion type of a CustomJoint's coordinate (`CustomJoint::constructCoordinates`): decided by the last axis
/// that it drives through a linear function of slope ±1; coupled if there is none.
fn motion_type(coordinate: &str, axes: &[RawAxis; 6]) -> MotionType {
    let mut found = MotionType::Coupled;
    for (i, axis) in axes.iter().enumerate() {
        let driven = axis.coordinates.iter().any(|name| name == coordinate);
        if driven && matches!(axis.function, FunctionSpec::Linear { slope, .. } if slope.abs() == 1.0) {
            found = if i < 3 { Rotational } else { Translational };
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(coordinates: &[&str], function: FunctionSpec) -> RawAxis {
        RawAxis { axis: Vector3::x(), coordinates: coordinates.iter().map(|&name| name.to_owned()).collect(), function }
    }

    fn with_axes(pairs: [(usize, RawAxis); 2]) -> [RawAxis; 6] {
        let mut axes = AXES.map(|_| axis(&[], FunctionSpec::Constant { value: 0.0 }));
        for (i, new) in pairs {
            axes[i] = new;
        }
        axes
    }

    #[test]
    fn verif_motion_type_is_decided_by_slope_one() {
        let linear = |slope| FunctionSpec::Linear { slope, intercept: 0.3 };
        let axes = with_axes([(0, axis(&["q"], linear(-1.0))), (1, axis(&["p"], linear(0.5)))]);
        assert_eq!(motion_type("q", &axes), MotionType::Rotational);
        assert_eq!(motion_type("p", &axes), MotionType::Coupled);
        let axes = with_axes([(0, axis(&["q"], linear(0.5))), (4, axis(&["q"], linear(1.0)))]);
        assert_eq!(motion_type("q", &axes), MotionType::Translational);
    }
}
