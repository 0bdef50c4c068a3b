//! Postures, paths, poses and muscles at rest of a model: arrays in, arrays out.

use std::path::PathBuf;

use carpus::osim::spec::MotionType;
use carpus::session::diagnostic::Failure;
use carpus::session::equilibrium::Equilibrium;
use carpus::session::model::LoadedModel;
use carpus::session::quantity::Assignment;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray4, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::failure::{OrRaise, refused};
use crate::job::{warn, watched};
use crate::model::Model;

/// The samples of an array whose last axis has a length; without a copy where it is contiguous.
pub fn rows<'a>(
    array: &'a PyReadonlyArray2<'_, f64>,
    columns: usize,
    what: &str,
) -> Result<std::borrow::Cow<'a, [f64]>, Failure> {
    let [_, found] = array.shape() else { return Err(refused(format!("{what}: expected two axes"))) };
    if *found != columns {
        return Err(refused(format!("{what}: expected shape (n, {columns}), found (n, {found})")));
    }
    Ok(match array.as_slice() {
        Ok(slice) => slice.into(),
        Err(_) => array.as_array().iter().copied().collect::<Vec<_>>().into(),
    })
}

#[pymethods]
impl Model {
    /// Names of the coordinates, in the order of every posture.
    fn coordinate_names(&self) -> Vec<String> {
        self.file.spec.coordinates.iter().map(|c| c.name.clone()).collect()
    }

    /// Names of the muscles, in the order of the file.
    fn muscle_names(&self) -> Vec<String> {
        self.file.spec.muscles.iter().map(|m| m.name.clone()).collect()
    }

    /// The default posture with some coordinates set [rad or m].
    fn posture<'py>(&mut self, py: Python<'py>, set: Vec<(String, f64)>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let compiled = self.compiled(py)?;
        let mut messages = Vec::new();
        let set = assignments(&compiled.loaded, &set).or_raise(py)?;
        let q = compiled.loaded.posture(&set, &mut messages).or_raise(py)?;
        warn(py, &messages)?;
        Ok(q.into_pyarray(py))
    }

    /// Path lengths [m] of all muscles in postures (n, coordinates), and moment arms about a coordinate.
    #[pyo3(signature = (q, about))]
    fn paths<'py>(
        this: &Bound<'py, Self>,
        py: Python<'py>,
        q: PyReadonlyArray2<'py, f64>,
        about: Option<&str>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray2<f64>>>)> {
        let compiled = this.borrow_mut().compiled(py)?;
        let about = about.map(|name| compiled.loaded.coordinate(name)).transpose().or_raise(py)?;
        let samples = rows(&q, compiled.n_coordinates(), "q").or_raise(py)?;
        let [lengths, arms] =
            watched(py, "muscle paths", q.shape()[0], |watch| compiled.paths(&samples, about, watch))?;
        let shape = [q.shape()[0], compiled.paths.len()];
        let arms = about.map(|_| arms.into_pyarray(py).reshape(shape)).transpose()?;
        Ok((lengths.into_pyarray(py).reshape(shape)?, arms))
    }

    /// Poses of all bodies in ground: (n, bodies, 4, 4).
    fn poses<'py>(
        this: &Bound<'py, Self>,
        py: Python<'py>,
        q: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray4<f64>>> {
        let compiled = this.borrow_mut().compiled(py)?;
        let samples = rows(&q, compiled.n_coordinates(), "q").or_raise(py)?;
        let bodies = compiled.loaded.file.spec.bodies.len();
        let n = q.shape()[0];
        let poses = watched(py, "poses", n, |watch| {
            let mut buffers = compiled.buffers();
            let mut poses = Vec::with_capacity(n * bodies * 16);
            for q in samples.chunks(compiled.n_coordinates().max(1)) {
                watch.go_on()?;
                compiled.pose(q, &mut buffers);
                for body in 0..bodies {
                    let X_GB = buffers.cache.X_GB(carpus::osim::spec::BodyIndex(body));
                    for i in 0..3 {
                        poses.extend([0, 1, 2].map(|j| X_GB.R[(i, j)]));
                        poses.push(X_GB.p[i]);
                    }
                    poses.extend([0.0, 0.0, 0.0, 1.0]);
                }
            }
            Ok(poses)
        })?;
        poses.into_pyarray(py).reshape([n, bodies, 4, 4])
    }

    /// Muscles at rest in a posture, as JSON: what `carpus equilibrium --json` prints.
    #[pyo3(signature = (activation, set, about, muscles, allow_unsupported))]
    fn equilibrium(
        this: &Bound<'_, Self>,
        py: Python<'_>,
        activation: f64,
        set: Vec<(String, f64)>,
        about: Vec<String>,
        muscles: Vec<String>,
        allow_unsupported: bool,
    ) -> PyResult<String> {
        if !(0.0..=1.0).contains(&activation) {
            return Err(refused(format!("activation: expected 0 to 1, found {activation}"))).or_raise(py);
        }
        let compiled = this.borrow_mut().compiled(py)?;
        let set = assignments(&compiled.loaded, &set).or_raise(py)?;
        let path: PathBuf = this.borrow().path.clone();
        let asked = Equilibrium { model: path, set, activation, moment_about: about, muscles, allow_unsupported };
        let found = py.detach(|| asked.of_loaded(&compiled.loaded, Vec::new())).or_raise(py)?;
        warn(py, &found.warnings)?;
        Ok(found.value().to_string())
    }
}

/// Coordinates and their values, in the unit that suits each of them.
pub fn assignments(loaded: &LoadedModel, set: &[(String, f64)]) -> Result<Vec<Assignment>, Failure> {
    let one = |(name, value): &(String, f64)| {
        let index = loaded.coordinate(name)?;
        let is_translation = loaded.model.coordinates[index.0].motion_type == MotionType::Translational;
        let unit = if is_translation { "m" } else { "rad" };
        let text = format!("{name}={value}{unit}");
        text.parse::<Assignment>().map_err(refused)
    };
    set.iter().map(one).collect()
}
