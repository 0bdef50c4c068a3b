//! Bone geometry: files that a model shows (`.vtp`, `.stl`, `.obj`), found, read, and packed for a page.
//!
//! In: a model and folders to look in. Out: triangles, as whole numbers on a grid over each mesh: positions are within
//! 1/65535 of its size. Meshes of very many triangles are coarsened. Paths and forces depend on none of it.

mod mesh;
mod vtp;

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use serde_json::json;

use super::diagnostic::Diagnostic;
use super::model::LoadedModel;
use carpus_numerics::regular_file;
use carpus_numerics::spatial::Transform;
use carpus_osim::osim::MeshSpec;
use mesh::Mesh;
use nalgebra::Vector3;

/// Bytes of a file of geometry that is read at most.
const LARGEST_FILE: u64 = 256 << 20;

/// Folders beside a model in which geometry is looked for, besides its own.
const FOLDERS: [&str; 2] = ["Geometry", "geometry"];

/// Geometry for a page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackedGeometry {
    /// Length of the header (four bytes, the lowest first), the header (JSON), then of every mesh its points (three
    /// numbers of two bytes each) and its triangles (three numbers of four bytes each). Empty where no file was found.
    pub bytes: Vec<u8>,
    /// Files that are shown.
    pub found: Vec<String>,
    /// Files that the model names and that are nowhere.
    pub missing: Vec<String>,
}

impl LoadedModel {
    /// Geometry of a model, from these folders, from that of the model, and from `Geometry` beside it.
    ///
    /// - `most_triangles`: of a mesh
    ///
    /// What is wrong with a file is a warning; the body is then shown as a plain shape.
    pub fn geometry(
        &self,
        folders: &[PathBuf],
        most_triangles: usize,
        messages: &mut Vec<Diagnostic>,
    ) -> PackedGeometry {
        let own = self.path.parent().map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
        let beside = own
            .into_iter()
            .flat_map(|own| std::iter::once(own.to_owned()).chain(FOLDERS.iter().map(|name| own.join(name))));
        let folders: Vec<PathBuf> = folders.iter().cloned().chain(beside).collect();
        let (mut meshes, mut shown): (Vec<Mesh>, Vec<_>) = (Vec::new(), Vec::new());
        let mut places: BTreeMap<String, Option<usize>> = BTreeMap::new();
        let mut packed = PackedGeometry::default();
        for spec in self.file.meshes() {
            let place = *places.entry(spec.file.clone()).or_insert_with(|| match find(&spec.file, &folders) {
                Some(path) => match read(&path) {
                    Ok(mesh) => {
                        packed.found.push(spec.file.clone());
                        meshes.push(mesh.coarsened(most_triangles));
                        Some(meshes.len() - 1)
                    }
                    Err(problem) => {
                        messages.push(Diagnostic::warning(format!("is not shown: {problem}")).in_file(&path));
                        None
                    }
                },
                None => {
                    packed.missing.push(spec.file.clone());
                    None
                }
            });
            shown.extend(place.map(|place| self.placed(&spec, place)));
        }
        if !shown.is_empty() {
            packed.bytes = pack(&meshes, &shown);
        }
        packed
    }

    /// Where a mesh is shown: its place among the meshes, the body, the pose in it by rows, factors, colour.
    fn placed(&self, spec: &MeshSpec, mesh: usize) -> serde_json::Value {
        let frame = self.model.frame(spec.frame);
        let [a, b, c, x, y, z] = spec.transform;
        let own = Transform::from_translation_body_xyz(Vector3::new(x, y, z), Vector3::new(a, b, c));
        let pose = frame.X_BF * own;
        json!({
            "mesh": mesh, "name": spec.file, "base": frame.base.0, "pose": pose.numbers(),
            "scale": spec.scale_factors.as_slice(), "color": spec.color, "opacity": spec.opacity,
        })
    }
}

/// The file of that name in the first folder that has it. Names lead nowhere else: of a path from a root or upwards
/// only the last part counts.
fn find(name: &str, folders: &[PathBuf]) -> Option<PathBuf> {
    let name = name.replace('\\', "/");
    let path = Path::new(&name);
    let is_within = path.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    let name = if is_within { path } else { Path::new(path.file_name()?) };
    folders.iter().map(|folder| folder.join(name)).find(|path| path.is_file())
}

/// Reads a mesh; what is wrong with it, in words.
fn read(path: &Path) -> Result<Mesh, String> {
    let size = path.metadata().map_err(|e| format!("it cannot be read: {e}"))?.len();
    if size > LARGEST_FILE {
        return Err(format!("it has {} MB, more than {}", size >> 20, LARGEST_FILE >> 20));
    }
    let bytes = regular_file::read(path).map_err(|e| format!("it cannot be read: {e}"))?;
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let mesh = match extension.as_str() {
        "vtp" => vtp::read(bytes),
        "stl" => mesh::read_stl(&bytes),
        "obj" => mesh::read_obj(&bytes),
        _ => Err(format!("expected .vtp, .stl or .obj, found .{extension}")),
    }?;
    mesh.checked()
}

fn pack(meshes: &[Mesh], shown: &[serde_json::Value]) -> Vec<u8> {
    let grids: Vec<_> = meshes.iter().map(Mesh::on_grid).collect();
    let of = |(mesh, grid): (&Mesh, &mesh::Grid)| {
        json!({
            "points": mesh.points.len(),
            "triangles": mesh.triangles.len(),
            "low": grid.low,
            "step": grid.step,
        })
    };
    let header = json!({
        "meshes": meshes.iter().zip(&grids).map(of).collect::<Vec<_>>(),
        "shown": shown,
    })
    .to_string();
    let mut out = (header.len() as u32).to_le_bytes().to_vec();
    out.extend(header.as_bytes());
    for (mesh, grid) in meshes.iter().zip(&grids) {
        out.extend(grid.points.iter().flatten().flat_map(|v| v.to_le_bytes()));
        out.extend(mesh.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()));
    }
    out
}
