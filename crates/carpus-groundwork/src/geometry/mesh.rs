//! Triangles in space.

use std::collections::HashMap;
use std::io::Cursor;

/// A surface of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Mesh {
    /// Corners [m].
    pub points: Vec<[f32; 3]>,
    /// Places of three corners each.
    pub triangles: Vec<[u32; 3]>,
}

/// A mesh's points as whole numbers.
pub(super) struct Grid {
    /// The lowest coordinates [m].
    pub low: [f32; 3],
    /// What one unit is along x, y, z [m].
    pub step: [f32; 3],
    pub points: Vec<[u16; 3]>,
}

impl Mesh {
    /// The mesh, if it is one.
    pub fn checked(self) -> Result<Mesh, String> {
        let count = self.points.len();
        if self.triangles.is_empty() {
            return Err("it has no surface".to_owned());
        }
        if let Some(point) = self.points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(format!("point {} of {count} is not finite", point + 1));
        }
        match self.triangles.iter().flatten().find(|i| **i as usize >= count) {
            Some(wrong) => Err(format!("a polygon has the point {wrong}, but there are {count}, counted from 0")),
            None => Ok(self),
        }
    }

    fn ends(&self) -> [[f32; 3]; 2] {
        let mut ends = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for p in &self.points {
            for k in 0..3 {
                ends[0][k] = ends[0][k].min(p[k]);
                ends[1][k] = ends[1][k].max(p[k]);
            }
        }
        ends
    }

    pub fn on_grid(&self) -> Grid {
        let [low, high] = self.ends();
        let step: [f32; 3] = std::array::from_fn(|k| ((high[k] - low[k]) / f32::from(u16::MAX)).max(f32::MIN_POSITIVE));
        let point = |p: &[f32; 3]| std::array::from_fn(|k| ((p[k] - low[k]) / step[k]).round() as u16);
        Grid { low, step, points: self.points.iter().map(point).collect() }
    }

    /// The mesh with at most so many triangles: points in one cell of a grid become one, until few enough are left.
    pub fn coarsened(self, most: usize) -> Mesh {
        let mut cells = 256.0;
        let mut coarse = self.clone();
        while coarse.triangles.len() > most && cells >= 4.0 {
            coarse = self.clustered(cells);
            cells *= 0.75;
        }
        coarse
    }

    /// - `cells`: along the longest side
    fn clustered(&self, cells: f32) -> Mesh {
        let [low, high] = self.ends();
        let size = (0..3).map(|k| high[k] - low[k]).fold(f32::MIN_POSITIVE, f32::max) / cells;
        let mut places: HashMap<[i32; 3], u32> = HashMap::new();
        let (mut sums, mut of_point): (Vec<([f64; 3], f64)>, Vec<u32>) = (Vec::new(), Vec::new());
        for p in &self.points {
            let cell = std::array::from_fn(|k| ((p[k] - low[k]) / size) as i32);
            let place = *places.entry(cell).or_insert(sums.len() as u32);
            if place as usize == sums.len() {
                sums.push(([0.0; 3], 0.0));
            }
            let (sum, count) = &mut sums[place as usize];
            (0..3).for_each(|k| sum[k] += f64::from(p[k]));
            *count += 1.0;
            of_point.push(place);
        }
        let points = sums.iter().map(|(sum, count)| sum.map(|x| (x / count) as f32)).collect();
        let moved = self.triangles.iter().map(|t| t.map(|i| of_point[i as usize]));
        Mesh { points, triangles: moved.filter(|[a, b, c]| a != b && b != c && c != a).collect() }
    }

    /// Adds a polygon as triangles from its first corner.
    pub fn add_polygon(&mut self, corners: &[u32]) {
        self.triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
    }
}

/// `.stl`, of text or of bytes.
pub(super) fn read_stl(bytes: &[u8]) -> Result<Mesh, String> {
    // The count of a binary file is believed by what reads it: it has to be that of the bytes.
    const BEFORE: usize = 84;
    const EACH: usize = 50;
    let is_text = bytes.starts_with(b"solid") && bytes.windows(5).take(1 << 16).any(|w| w == b"facet");
    if !is_text {
        let count = bytes.get(80..BEFORE).ok_or("it ends early")?;
        let count = count.iter().rev().fold(0usize, |n, b| n << 8 | usize::from(*b));
        if bytes.len() != BEFORE + EACH * count {
            return Err(format!(
                "it says {count} triangles, which are {} bytes, but has {}",
                EACH * count,
                bytes.len()
            ));
        }
    }
    let read = stl_io::read_stl(&mut Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let points = read.vertices.iter().map(|v| [v[0], v[1], v[2]]).collect();
    let triangles = read.faces.iter().map(|f| f.vertices.map(|i| i as u32)).collect();
    Ok(Mesh { points, triangles })
}

/// `.obj`, without its materials.
pub(super) fn read_obj(bytes: &[u8]) -> Result<Mesh, String> {
    let options =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    let none = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, none).map_err(|e| e.to_string())?;
    let mut mesh = Mesh::default();
    for model in models {
        let first = mesh.points.len() as u32;
        mesh.points.extend(model.mesh.positions.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
        mesh.triangles.extend(model.mesh.indices.chunks_exact(3).map(|t| [first + t[0], first + t[1], first + t[2]]));
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: &str = "solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
                            endloop\nendfacet\nendsolid t\n";

    #[test]
    fn verif_text_and_bytes_of_stl_are_the_same_triangle() {
        let text = read_stl(TRIANGLE.as_bytes()).unwrap().checked().unwrap();
        let mut bytes = vec![0; 80];
        bytes.extend(1u32.to_le_bytes());
        for v in [0.0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
            bytes.extend(v.to_le_bytes());
        }
        bytes.extend([0, 0]);
        assert_eq!(read_stl(&bytes).unwrap(), text);
        assert_eq!(text.triangles.len(), 1);
        bytes[80] = 200;
        assert!(read_stl(&bytes).unwrap_err().contains("200 triangles"));
        assert!(read_stl(b"").is_err());
    }

    #[test]
    fn verif_a_square_of_obj_is_two_triangles() {
        let mesh = read_obj(b"mtllib away.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").unwrap();
        assert_eq!((mesh.points.len(), mesh.triangles.len()), (4, 2));
        assert!(read_obj(b"v 0 0\nf 1 2 9\n").is_err());
    }

    #[test]
    fn verif_a_coarse_sphere_is_still_a_sphere() {
        let (n, m) = (200, 400);
        let mut sphere = Mesh::default();
        for i in 0..=n {
            for j in 0..m {
                let (a, b) = (std::f32::consts::PI * i as f32 / n as f32, std::f32::consts::TAU * j as f32 / m as f32);
                sphere.points.push([a.sin() * b.cos(), a.sin() * b.sin(), a.cos()]);
            }
        }
        for i in 0..n {
            for j in 0..m {
                let at = |i: u32, j: u32| i * m + j % m;
                sphere.add_polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        let coarse = sphere.coarsened(20_000).checked().unwrap();
        assert!(coarse.triangles.len() <= 20_000 && coarse.triangles.len() > 5_000, "{}", coarse.triangles.len());
        let off = coarse.points.iter().map(|p| (p.iter().map(|x| x * x).sum::<f32>().sqrt() - 1.0).abs());
        assert!(off.fold(0.0, f32::max) < 0.01);
        let grid = coarse.on_grid();
        for (p, whole) in coarse.points.iter().zip(&grid.points) {
            assert!((0..3).all(|k| (grid.low[k] + grid.step[k] * f32::from(whole[k]) - p[k]).abs() < 2e-5));
        }
    }

    #[test]
    fn verif_a_mesh_that_points_nowhere_is_refused() {
        let mesh = |triangle| Mesh { points: vec![[0.0; 3]; 3], triangles: vec![triangle] };
        assert!(mesh([0, 1, 2]).checked().is_ok());
        assert!(mesh([0, 1, 3]).checked().unwrap_err().contains("point 3"));
        let far = Mesh { points: vec![[f32::NAN; 3]; 3], triangles: vec![[0, 1, 2]] };
        assert!(far.checked().is_err() && Mesh::default().checked().is_err());
    }
}
