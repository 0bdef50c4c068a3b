//! Ground, bodies, offset frames and the wrap objects fixed to them.

use nalgebra::{Matrix3, Vector3};

use super::object::{COMPONENT_SET, FreeComponents, Names, Object};
use super::pending::UnresolvedOffset;
use super::properties::Bound;
use super::state::Reader;
use super::upgrade::six_significant_digits;
use crate::osim::diagnostics::Severity;
use crate::osim::document::ElementId;
use crate::osim::error::ProblemKind;
use crate::osim::spec::{
    BodyIndex, BodySpec, FrameIndex, FrameKind, FrameSpec, Location, Quadrant, WrapObjectSpec, WrapShape,
    negative_principal_moment,
};

/// The inertia's properties before format 30500.
const INERTIA_COMPONENTS: [&str; 6] =
    ["inertia_xx", "inertia_yy", "inertia_zz", "inertia_xy", "inertia_xz", "inertia_yz"];

/// Whether OpenSim takes a mass as zero: up to `SimTK::SignificantReal`, ε^(7/8).
fn is_negligible(mass: f64) -> bool {
    mass.abs() <= f64::EPSILON.powf(0.875)
}

impl Reader<'_> {
    pub(super) fn read_ground_and_bodies(&mut self, model: &Object, components: &FreeComponents) {
        let is_body = |tag: &str| tag == "Body";
        let mut elements = self.set_and_components(model, &["BodySet"], "/bodyset", components, is_body);
        let ground = self.ground_element(model, &mut elements);
        let ground_object = match ground {
            Some(element) => self.object(element, "/", "ground"),
            None => Object { element: None, default: None, path: "/ground".to_owned(), line: model.line },
        };
        self.skip_mass_of_ground(&ground_object);
        let at = self.location(&ground_object);
        self.add_frame("ground", at, FrameKind::Ground);
        let mut names = Names::default();
        let mut bodies = Vec::new();
        for (element, owner) in elements {
            if self.document.tag(element) != "Body" {
                continue; // reported with the leftovers
            }
            let name = self.component_name(element, &mut names, owner);
            let object = self.object(element, owner, &name);
            let frame = self.add_frame(&name, self.location(&object), FrameKind::Body(BodyIndex(bodies.len())));
            self.read_body(&object, name, frame);
            bodies.push((object, frame));
        }
        // OpenSim visits the model's own components first, then ground, then the bodies.
        self.read_offset_frames(&components.own, "", &mut names);
        self.read_station_frames(&components.own, "/", &mut names);
        self.search_order.push(FrameIndex(0));
        self.read_frame_contents(&ground_object, FrameIndex(0));
        for (object, frame) in bodies {
            self.search_order.push(frame);
            self.read_frame_contents(&object, frame);
        }
        let mut names = Names::default();
        self.read_offset_frames(&components.of_set, COMPONENT_SET, &mut names);
        self.read_station_frames(&components.of_set, COMPONENT_SET, &mut names);
    }

    /// `<Ground>`, or the body called ground in old files, which is taken out of `bodies`.
    fn ground_element(&mut self, model: &Object, bodies: &mut Vec<(ElementId, &'static str)>) -> Option<ElementId> {
        if self.version.has_joints_in_bodies() {
            let at = bodies
                .iter()
                .position(|&(body, _)| self.document.attribute(body, "name").as_deref() == Some("ground"))?;
            return Some(bodies.remove(at).0);
        }
        self.property(model, &["Ground"])
    }

    /// In old files ground is written as a body: its mass means nothing and its joint is empty.
    fn skip_mass_of_ground(&mut self, ground: &Object) {
        if !self.version.has_joints_in_bodies() {
            return;
        }
        for property in ["mass", "mass_center"].into_iter().chain(INERTIA_COMPONENTS) {
            let _ = self.own_property(ground, &[property]);
        }
        let joint = ground.element.and_then(|ground| self.document.child(ground, "Joint"));
        if let Some(joint) = joint.filter(|&joint| self.document.children(joint).is_empty()) {
            self.mark(joint);
        }
    }

    pub(super) fn add_frame(&mut self, name: &str, at: Location, kind: FrameKind) -> FrameIndex {
        let index = FrameIndex(self.spec.frames.len());
        self.frames_by_path.entry(at.path.clone()).or_insert(index);
        self.spec.frames.push(FrameSpec { name: name.to_owned(), at, kind });
        index
    }

    fn read_body(&mut self, object: &Object, name: String, frame: FrameIndex) {
        self.diagnostics.understood("Body");
        let mass = match self.optional_number(object, &["mass"], Bound::NotNegative("a mass of 0 kg or more")) {
            Some(mass) => mass,
            None => {
                // An unreadable mass is reported already.
                if self.property(object, &["mass"]).is_none() {
                    let kind = ProblemKind::Missing { property: "mass".to_owned(), expected: "a mass in kg" };
                    self.problem(object.line, &object.path, kind);
                }
                0.0
            }
        };
        let mass_center = self.vector3(object, &["mass_center"], Vector3::zeros());
        let [xx, yy, zz, xy, xz, yz] = self.inertia_values(object);
        let mut inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        if is_negligible(mass) && inertia.norm() > 0.0 {
            inertia = Matrix3::zeros();
            if let Some(element) = object.element {
                let message = "massless body with an inertia: the inertia is taken as zero, as in OpenSim".to_owned();
                self.diagnose(Severity::Approximated, element, &object.path, message, None);
            }
        }
        if let (Some(element), Some(smallest)) = (object.element, negative_principal_moment(&inertia)) {
            let message = format!(
                "inertia has a principal moment of {smallest:.3e} kg·m², which no body has: it is taken as it is, as \
                 in OpenSim"
            );
            let hint = "check the inertia's signs and products".to_owned();
            self.diagnose(Severity::Warning, element, &object.path, message, Some(hint));
        }
        let at = self.location(object);
        self.spec.bodies.push(BodySpec { name, at, mass, mass_center, inertia, frame });
    }

    /// Ixx Iyy Izz Ixy Ixz Iyz.
    fn inertia_values(&mut self, object: &Object) -> [f64; 6] {
        if !self.version.has_inertia_components() {
            return self.numbers(object, &["inertia"], [0.0; 6], Bound::Finite);
        }
        let mut values = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0];
        for (value, name) in values.iter_mut().zip(INERTIA_COMPONENTS) {
            *value = six_significant_digits(self.number(object, &[name], *value, Bound::Finite));
        }
        values
    }

    /// Offset frames and wrap objects of a frame, depth first, as OpenSim visits them.
    pub(super) fn read_frame_contents(&mut self, object: &Object, frame: FrameIndex) {
        let mut names = Names::default();
        if let Some(list) = self.own_property(object, &["components"]) {
            let children = self.document.children(list).to_vec();
            self.read_offset_frames(&children, &object.path, &mut names);
            self.read_station_frames(&children, &object.path, &mut names);
        }
        self.read_wrap_objects(object, frame);
    }

    /// The offset frames among `elements`, which belong to the component at `owner`.
    pub(super) fn read_offset_frames(&mut self, elements: &[ElementId], owner: &str, names: &mut Names) {
        for &element in elements {
            if self.document.tag(element) == "PhysicalOffsetFrame" {
                let name = self.component_name(element, names, owner);
                let object = self.object(element, owner, &name);
                self.read_offset_frame(&object, &name);
            }
        }
    }

    fn read_offset_frame(&mut self, object: &Object, name: &str) {
        self.diagnostics.understood("PhysicalOffsetFrame");
        let translation = self.vector3(object, &["translation"], Vector3::zeros());
        let orientation = self.vector3(object, &["orientation"], Vector3::zeros());
        let parent = self.socket(object, "parent");
        let kind = FrameKind::Offset { parent: FrameIndex(0), translation, orientation };
        let frame = self.add_frame(name, self.location(object), kind);
        self.search_order.push(frame);
        self.unresolved.push(UnresolvedOffset { frame, object: object.clone(), parent });
        self.read_frame_contents(object, frame);
    }

    fn read_wrap_objects(&mut self, object: &Object, frame: FrameIndex) {
        let Some(set) = self.property(object, &["WrapObjectSet"]) else { return };
        let Some(objects) = self.document.child(set, "objects") else { return };
        self.mark(objects);
        let owner = format!("{}/wrapobjectset", object.path);
        let mut names = Names::default();
        for element in self.document.children(objects).to_vec() {
            if !matches!(self.document.tag(element), "WrapSphere" | "WrapCylinder" | "WrapEllipsoid" | "WrapTorus") {
                continue; // reported with the leftovers
            }
            let name = self.component_name(element, &mut names, &owner);
            let object = self.object(element, &owner, &name);
            self.read_wrap_object(element, &object, name, frame);
        }
    }

    fn read_wrap_object(&mut self, element: ElementId, object: &Object, name: String, frame: FrameIndex) {
        const LENGTH: Bound = Bound::Positive("a length greater than 0 m");
        let shape = match self.document.tag(element) {
            "WrapSphere" => WrapShape::Sphere { radius: self.number(object, &["radius"], 0.05, LENGTH) },
            "WrapCylinder" => WrapShape::Cylinder {
                radius: self.number(object, &["radius"], 1.0, LENGTH),
                length: self.number(object, &["length"], 1.0, Bound::Finite),
            },
            "WrapEllipsoid" => {
                WrapShape::Ellipsoid { dimensions: self.numbers(object, &["dimensions"], [0.05; 3], LENGTH) }
            }
            _ => WrapShape::Torus {
                inner_radius: self.number(object, &["inner_radius"], 0.01, LENGTH),
                outer_radius: self.number(object, &["outer_radius"], 0.05, LENGTH),
            },
        };
        self.diagnostics.understood(self.document.tag(element));
        let spec = WrapObjectSpec {
            name,
            at: self.location(object),
            frame,
            active: self.boolean(object, &["active"], true),
            translation: self.vector3(object, &["translation"], Vector3::zeros()),
            xyz_body_rotation: self.vector3(object, &["xyz_body_rotation"], Vector3::zeros()),
            quadrant: self.quadrant(object),
            shape,
        };
        self.spec.wrap_objects.push(spec);
    }

    fn quadrant(&mut self, object: &Object) -> Quadrant {
        let Some((element, text)) = self.string(object, &["quadrant"]) else { return Quadrant::All };
        let half = |axis, sign| Quadrant::Half { axis, sign };
        match text.as_str() {
            "all" | "ALL" | "All" | "Unassigned" => Quadrant::All,
            "x" | "+x" | "X" | "+X" => half(0, 1),
            "-x" | "-X" => half(0, -1),
            "y" | "+y" | "Y" | "+Y" => half(1, 1),
            "-y" | "-Y" => half(1, -1),
            "z" | "+z" | "Z" | "+Z" => half(2, 1),
            "-z" | "-Z" => half(2, -1),
            _ => {
                self.not_readable(element, object, "quadrant", "all, x, -x, y, -y, z or -z", &text);
                Quadrant::All
            }
        }
    }
}
