//! Ground, bodies, wrap objects, markers, and the meshes of old bodies.

use super::Writer;
use super::xml::numbers;
use crate::osim::document::ElementId;
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
        let Some(visible) = body.and_then(|body| document.child(body, "VisibleObject")) else { return };
        let read = |element: ElementId, tag: &str, default: &[f64]| -> Vec<f64> {
            let text = document.child(element, tag).map(|child| document.text(child)).unwrap_or_default();
            let values: Vec<f64> = text.split_ascii_whitespace().filter_map(|word| word.parse().ok()).collect();
            if values.len() == default.len() { values } else { default.to_vec() }
        };
        let outer = read(visible, "scale_factors", &[1.0; 3]);
        let moved = |element: ElementId| read(element, "transform", &[0.0; 6]).iter().any(|x| *x != 0.0);
        let set = document.child(visible, "GeometrySet").and_then(|set| document.child(set, "objects"));
        let mut meshes = Vec::new();
        for &geometry in set.map_or(&[][..], |set| document.children(set)) {
            let Some(file) = document.child(geometry, "geometry_file").map(|file| document.text(file)) else {
                continue;
            };
            if moved(geometry) || moved(visible) {
                let text = format!("{path}: geometry {file}, which has a transform of its own");
                self.left_out.push((document.line(geometry), text));
                continue;
            }
            let own = read(geometry, "scale_factors", &[1.0; 3]);
            let scale: Vec<f64> = own.iter().zip(&outer).map(|(a, b)| a * b).collect();
            meshes.push((file, scale, read(geometry, "color", &[1.0; 3])));
        }
        if let Some(files) = document.child(visible, "geometry_files") {
            let files = document.text(files);
            meshes.extend(files.split_ascii_whitespace().map(|file| (file.to_owned(), outer.clone(), vec![1.0; 3])));
        }
        if meshes.is_empty() {
            return;
        }
        self.xml.open("attached_geometry", &[]);
        for (i, (file, scale, color)) in meshes.iter().enumerate() {
            self.xml.open("Mesh", &[("name", &format!("geometry_{}", i + 1))]);
            self.xml.text("socket_frame", "..");
            self.xml.text("scale_factors", &numbers(scale));
            self.xml.open("Appearance", &[]);
            self.xml.text("color", &numbers(color));
            self.xml.close();
            self.xml.text("mesh_file", file);
            self.xml.close();
        }
        self.xml.close();
    }
}
