//! Ground, bodies, wrap objects, markers, and the meshes of old bodies.

use super::Writer;
use super::xml::numbers;
use crate::osim::document::ElementId;
use crate::osim::meshes::{MeshSpec, of_visible_object};
use crate::osim::spec::{FrameIndex, Quadrant, WrapShape};

impl Writer<'_> {
    pub(super) fn bodies(&mut self) {
        let spec = self.spec;
        self.owned_frames("/", "components");
        self.xml.open("Ground", &[("name", "ground")]);
        self.owned_frames("/ground", "components");
        self.wrap_objects(FrameIndex(0));
        self.meshes(spec.frames[0].at.element.map(ElementId), "/ground");
        self.xml.close();
        self.xml.open("BodySet", &[("name", "bodyset")]);
        self.xml.open("objects", &[]);
        for body in &spec.bodies {
            self.xml.open("Body", &[("name", &body.name)]);
            self.owned_frames(&body.at.path, "components");
            self.wrap_objects(body.frame);
            self.meshes(body.at.element.map(ElementId), &body.at.path);
            self.xml.number("mass", body.mass);
            self.xml.vector("mass_center", &body.mass_center);
            let i = &body.inertia;
            let values = [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]];
            self.xml.text("inertia", &numbers(&values));
            self.xml.close();
        }
        self.xml.close();
        self.xml.close();
    }

    pub(super) fn wrap_objects(&mut self, frame: FrameIndex) {
        let own: Vec<_> = self.spec.wrap_objects.iter().filter(|wrap| wrap.frame == frame).collect();
        if own.is_empty() {
            return;
        }
        self.xml.open("WrapObjectSet", &[("name", "wrapobjectset")]);
        self.xml.open("objects", &[]);
        for wrap in own {
            let class = match wrap.shape {
                WrapShape::Sphere { .. } => "WrapSphere",
                WrapShape::Cylinder { .. } => "WrapCylinder",
                WrapShape::Ellipsoid { .. } => "WrapEllipsoid",
                WrapShape::Torus { .. } => "WrapTorus",
            };
            self.xml.open(class, &[("name", &wrap.name)]);
            self.xml.boolean("active", wrap.active);
            self.xml.vector("xyz_body_rotation", &wrap.xyz_body_rotation);
            self.xml.vector("translation", &wrap.translation);
            let quadrant = match wrap.quadrant {
                Quadrant::All => "all".to_owned(),
                Quadrant::Half { axis, sign } => {
                    format!("{}{}", if sign < 0 { "-" } else { "" }, ["x", "y", "z"][axis.min(2)])
                }
            };
            self.xml.text("quadrant", &quadrant);
            match wrap.shape {
                WrapShape::Sphere { radius } => self.xml.number("radius", radius),
                WrapShape::Cylinder { radius, length } => {
                    self.xml.number("radius", radius);
                    self.xml.number("length", length);
                }
                WrapShape::Ellipsoid { dimensions } => self.xml.text("dimensions", &numbers(&dimensions)),
                WrapShape::Torus { inner_radius, outer_radius } => {
                    self.xml.number("inner_radius", inner_radius);
                    self.xml.number("outer_radius", outer_radius);
                }
            }
            self.xml.close();
        }
        self.xml.close();
        self.xml.close();
    }

    pub(super) fn markers(&mut self) {
        let spec = self.spec;
        if spec.markers.is_empty() {
            return;
        }
        self.xml.open("MarkerSet", &[("name", "markerset")]);
        self.xml.open("objects", &[]);
        for marker in &spec.markers {
            self.xml.open("Marker", &[("name", &marker.name)]);
            let frame = self.frame(marker.frame);
            self.xml.text("socket_parent_frame", &frame);
            self.xml.vector("location", &marker.location);
            self.xml.boolean("fixed", marker.fixed);
            self.xml.close();
        }
        self.xml.close();
        self.xml.close();
    }

    /// Meshes of a body of an old file that stand where the body does; others are listed.
    fn meshes(&mut self, body: Option<ElementId>, path: &str) {
        let document = &self.file.document;
        let Some(body) = body else { return };
        let (meshes, moved): (Vec<_>, Vec<_>) = of_visible_object(document, body, FrameIndex(0))
            .into_iter()
            .partition(|mesh| mesh.transform.iter().all(|x| *x == 0.0));
        let text = |mesh: MeshSpec| format!("{path}: geometry {}, which has a transform of its own", mesh.file);
        self.left_out.extend(moved.into_iter().map(|mesh| (mesh.line, text(mesh))));
        if meshes.is_empty() {
            return;
        }
        self.xml.open("attached_geometry", &[]);
        for (i, mesh) in meshes.iter().enumerate() {
            self.xml.open("Mesh", &[("name", &format!("geometry_{}", i + 1))]);
            self.xml.text("socket_frame", "..");
            self.xml.text("scale_factors", &numbers(mesh.scale_factors.as_slice()));
            self.xml.open("Appearance", &[]);
            self.xml.text("color", &numbers(&mesh.color));
            self.xml.close();
            self.xml.text("mesh_file", &mesh.file);
            self.xml.close();
        }
        self.xml.close();
    }
}
