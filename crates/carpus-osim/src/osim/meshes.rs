//! Which files of bone geometry a model shows, where: nothing here reads them.

use nalgebra::Vector3;

use super::document::{Document, ElementId};
use super::file::OsimFile;
use super::spec::{FrameIndex, FrameKind};

/// A file of geometry that is fixed to a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshSpec {
    /// Frame that it is fixed to.
    pub frame: FrameIndex,
    /// Name of the file, as the model gives it.
    pub file: String,
    /// Line of the element's start tag, counted from 1.
    pub line: usize,
    /// Factors along x, y, z.
    pub scale_factors: Vector3<f64>,
    /// Body-fixed x-y-z rotation [rad] and translation [m] in the frame; zero but for files before 4.0.
    pub transform: [f64; 6],
    /// Red, green, blue from 0 to 1.
    pub color: [f64; 3],
    /// 0: invisible, 1: opaque.
    pub opacity: f64,
}

impl OsimFile {
    /// Files of geometry that ground, bodies and offset frames show (`Mesh` in `attached_geometry`, `DisplayGeometry`
    /// in `VisibleObject`), in the order of frames; those that the model hides are left out.
    pub fn meshes(&self) -> Vec<MeshSpec> {
        let of = |(i, frame): (usize, &super::spec::FrameSpec)| {
            let at = match frame.kind {
                FrameKind::Body(body) => &self.spec.bodies[body.0].at,
                FrameKind::Ground | FrameKind::Offset { .. } => &frame.at,
            };
            let element = at.element.map(ElementId);
            element.map_or_else(Vec::new, |element| {
                let mut found = attached(&self.document, element, FrameIndex(i));
                found.extend(of_visible_object(&self.document, element, FrameIndex(i)));
                found
            })
        };
        self.spec.frames.iter().enumerate().flat_map(of).filter(|mesh| mesh.opacity > 0.0).collect()
    }
}

/// Numbers of a property; the default where it is absent or has another count of them.
fn numbers<const N: usize>(document: &Document, element: ElementId, tag: &str, default: [f64; N]) -> [f64; N] {
    let text = document.child(element, tag).map(|child| document.text(child)).unwrap_or_default();
    let values: Vec<f64> = text.split_ascii_whitespace().filter_map(|word| word.parse().ok()).collect();
    <[f64; N]>::try_from(values).ok().filter(|v| v.iter().all(|x| x.is_finite())).unwrap_or(default)
}

fn attached(document: &Document, element: ElementId, frame: FrameIndex) -> Vec<MeshSpec> {
    let Some(list) = document.child(element, "attached_geometry") else { return Vec::new() };
    let meshes = document.children(list).iter().copied().filter(|child| document.tag(*child) == "Mesh");
    meshes
        .filter_map(|mesh| {
            let file = document.text(document.child(mesh, "mesh_file")?).trim().to_owned();
            let looks = document.child(mesh, "Appearance");
            let hidden = looks.and_then(|a| document.child(a, "visible")).is_some_and(|v| document.text(v) == "false");
            let opacity = looks.map_or(1.0, |a| numbers(document, a, "opacity", [1.0])[0]);
            (!file.is_empty()).then(|| MeshSpec {
                frame,
                file,
                line: document.line(mesh),
                scale_factors: Vector3::from(numbers(document, mesh, "scale_factors", [1.0; 3])),
                transform: [0.0; 6],
                color: looks.map_or([1.0; 3], |a| numbers(document, a, "color", [1.0; 3])),
                opacity: if hidden { 0.0 } else { opacity },
            })
        })
        .collect()
}

/// Of a body of a file before 4.0. The factors of the whole apply to every mesh; a transform of the whole is added to
/// its own where that is zero.
pub(in crate::osim) fn of_visible_object(document: &Document, element: ElementId, frame: FrameIndex) -> Vec<MeshSpec> {
    let Some(visible) = document.child(element, "VisibleObject") else { return Vec::new() };
    let outer = Vector3::from(numbers(document, visible, "scale_factors", [1.0; 3]));
    let outer_transform = numbers(document, visible, "transform", [0.0; 6]);
    let mesh = |file: String, line: usize| MeshSpec {
        frame,
        file,
        line,
        scale_factors: outer,
        transform: outer_transform,
        color: [1.0; 3],
        opacity: 1.0,
    };
    let mut found = Vec::new();
    let set = document.child(visible, "GeometrySet").and_then(|set| document.child(set, "objects"));
    for &geometry in set.map_or(&[][..], |set| document.children(set)) {
        let Some(file) = document.child(geometry, "geometry_file").map(|file| document.text(file)) else { continue };
        let own = Vector3::from(numbers(document, geometry, "scale_factors", [1.0; 3]));
        let own_transform = numbers(document, geometry, "transform", [0.0; 6]);
        let is_placed = own_transform.iter().any(|x| *x != 0.0);
        found.push(MeshSpec {
            scale_factors: own.component_mul(&outer),
            transform: if is_placed { own_transform } else { outer_transform },
            color: numbers(document, geometry, "color", [1.0; 3]),
            opacity: numbers(document, geometry, "opacity", [1.0])[0],
            ..mesh(file.trim().to_owned(), document.line(geometry))
        });
    }
    if let Some(files) = document.child(visible, "geometry_files") {
        let text = document.text(files);
        found.extend(text.split_ascii_whitespace().map(|file| mesh(file.to_owned(), document.line(files))));
    }
    found.retain(|mesh| !mesh.file.is_empty());
    found
}
