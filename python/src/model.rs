//! Models: read, looked at, edited without loss, scaled, upgraded, written.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use carpus::osim::spec::{Location, ModelSpec, MotionType, MuscleKind, MuscleSpec};
use carpus::osim::{EditError, ElementId, OsimFile};
use carpus::scaling::{ScaleRequest, scale};
use carpus::session::bundled;
use carpus::session::diagnostic::{Diagnostic, Failure};
use carpus::session::info::Info;
use carpus::session::model::osim_failure;
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::compiled::Compiled;
use crate::failure::OrRaise;
use crate::job::warn;

/// A model file in memory.
#[pyclass(module = "carpus._carpus")]
pub struct Model {
    /// The file and its specification.
    pub file: OsimFile,
    /// What messages call it.
    pub path: PathBuf,
    /// The compiled skeleton, until the next edit.
    compiled: Option<Arc<Compiled>>,
}

impl Model {
    /// A file under a name.
    pub fn of(file: OsimFile, path: impl Into<PathBuf>) -> Model {
        Model { file, path: path.into(), compiled: None }
    }

    /// The compiled skeleton. Warns, once between edits, of components that are not supported.
    ///
    /// # Errors
    /// A model that cannot be computed with.
    pub fn compiled(&mut self, py: Python<'_>) -> PyResult<Arc<Compiled>> {
        if let Some(compiled) = &self.compiled {
            return Ok(Arc::clone(compiled));
        }
        let compiled = Arc::new(Compiled::of(&self.path, &self.file).or_raise(py)?);
        self.compiled = Some(Arc::clone(&compiled));
        warn(py, &compiled.warnings)?;
        Ok(compiled)
    }

    fn edited(&mut self, result: Result<(), EditError>) -> Result<(), Failure> {
        self.compiled = None;
        result.map_err(|e| edit_failure(&e, &self.path))
    }
}

/// Why a model was not edited.
fn edit_failure(error: &EditError, path: &Path) -> Failure {
    // The error names the file and perhaps the line before the text.
    let said = error.to_string();
    let (place, text) = match said.split_once(": ") {
        Some((place, text)) if place.starts_with(&*path.to_string_lossy()) => (place, text),
        _ => ("", said.as_str()),
    };
    let message = Diagnostic::error(text).in_file(path);
    let line: Option<usize> = place.rsplit_once(':').and_then(|(_, line)| line.parse().ok());
    let message = line.into_iter().fold(message, Diagnostic::at_line);
    error.hint().into_iter().fold(message, Diagnostic::hint).into()
}

#[pymethods]
impl Model {
    /// Reads a model file.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Model> {
        let read = py.detach(|| OsimFile::read(&path).map_err(|e| osim_failure(&path, &e)));
        Ok(Model::of(read.or_raise(py)?, path))
    }

    /// Reads a model from bytes.
    #[staticmethod]
    fn parse(py: Python<'_>, bytes: Vec<u8>, name: String) -> PyResult<Model> {
        let parsed = OsimFile::parse(bytes, &name).map_err(|e| osim_failure(Path::new(&name), &e));
        Ok(Model::of(parsed.or_raise(py)?, name))
    }

    /// The wrist that comes with Carpus.
    #[staticmethod]
    fn bundled(py: Python<'_>) -> PyResult<Model> {
        Ok(Model::of(bundled::model().or_raise(py)?, "wrist.osim"))
    }

    /// A copy that can be edited by itself.
    fn copy(&self) -> Model {
        Model { file: self.file.clone(), path: self.path.clone(), compiled: self.compiled.clone() }
    }

    /// The bytes of the file.
    fn bytes(&self) -> &[u8] {
        self.file.document.bytes()
    }

    /// Its name in messages.
    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// Writes the file.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let written = self.file.write(&path).map_err(|e| {
            let message = Diagnostic::error(e.to_string()).in_file(&path);
            Failure::from(e.hint().into_iter().fold(message, Diagnostic::hint))
        });
        written.or_raise(py)
    }

    /// What `carpus info --json` says, as JSON.
    fn info(&self, py: Python<'_>) -> PyResult<String> {
        let (info, _) = Info::of(self.file.clone(), &self.path);
        let text = serde_json::to_string(&info).map_err(|e| Failure::Internal(e.to_string()));
        text.or_raise(py)
    }

    /// Components of a kind, as JSON: OpenSim's property names, SI units.
    ///
    /// - `kind`: bodies, coordinates, joints, muscles, forces, constraints or markers
    fn components(&self, kind: &str) -> Option<String> {
        let spec = &self.file.spec;
        let list: Vec<Value> = match kind {
            "bodies" => spec
                .bodies
                .iter()
                .map(|b| {
                    let i = &b.inertia;
                    json!({
                        "name": b.name, "path": b.at.path, "line": b.at.line, "mass": b.mass,
                        "mass_center": b.mass_center.as_slice(),
                        "inertia": [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]],
                    })
                })
                .collect(),
            "coordinates" => spec
                .coordinates
                .iter()
                .map(|c| {
                    let motion_type = match c.motion_type {
                        MotionType::Rotational => "rotational",
                        MotionType::Translational => "translational",
                        MotionType::Coupled => "coupled",
                    };
                    json!({
                        "name": c.name, "path": c.at.path, "line": c.at.line, "motion_type": motion_type,
                        "default_value": c.default_value, "default_speed_value": c.default_speed_value,
                        "range": c.range, "clamped": c.clamped, "locked": c.locked, "prescribed": c.prescribed,
                        "joint": spec.joints[c.joint.0].name,
                    })
                })
                .collect(),
            "joints" => {
                spec.joints.iter().map(|j| json!({ "name": j.name, "path": j.at.path, "line": j.at.line })).collect()
            }
            "muscles" => spec.muscles.iter().map(muscle).collect(),
            "forces" => spec.forces.iter().map(|f| named(&f.name, &f.at)).collect(),
            "constraints" => spec.constraints.iter().map(|c| named(&c.name, &c.at)).collect(),
            "markers" => spec
                .markers
                .iter()
                .map(|m| {
                    let frame = &spec.frames[m.frame.0].at.path;
                    json!({
                        "name": m.name, "path": m.at.path, "line": m.at.line, "frame": frame,
                        "location": m.location.as_slice(), "fixed": m.fixed,
                    })
                })
                .collect(),
            _ => return None,
        };
        Some(Value::Array(list).to_string())
    }

    /// The text of a property of the component at a path, as the file has it; a nested object's is written
    /// `Class/property`. `None`: the file does not give it.
    fn property(&self, path: &str, property: &str) -> Option<String> {
        let document = &self.file.document;
        let mut element = ElementId(element_of(&self.file.spec, path)?);
        for tag in property.split('/') {
            element = document.child(element, tag)?;
        }
        document.children(element).is_empty().then(|| document.text(element).trim().to_owned())
    }

    /// Sets the text of a property of the component at a path.
    fn set_property(&mut self, py: Python<'_>, path: &str, property: &str, text: &str) -> PyResult<()> {
        let result = self.file.set_property(path, property, text);
        self.edited(result).or_raise(py)
    }

    /// Sets properties of muscles, all or none: muscle, property, value.
    fn set_muscle_properties(&mut self, py: Python<'_>, changes: Vec<(String, String, f64)>) -> PyResult<()> {
        let changes: Vec<(&str, &str, f64)> = changes.iter().map(|(m, p, v)| (m.as_str(), p.as_str(), *v)).collect();
        let result = self.file.set_muscle_properties(&changes);
        self.edited(result).or_raise(py)
    }

    /// Adds a force, given as one element of XML.
    fn add_force(&mut self, py: Python<'_>, fragment: &str) -> PyResult<()> {
        let result = self.file.add_force(fragment);
        self.edited(result).or_raise(py)
    }

    /// Removes the components at paths.
    fn remove_components(&mut self, py: Python<'_>, paths: Vec<String>) -> PyResult<()> {
        let result = self.file.remove_components(&paths.iter().map(String::as_str).collect::<Vec<_>>());
        self.edited(result).or_raise(py)
    }

    /// The model scaled by factors of bodies, and what was done, as JSON.
    #[pyo3(signature = (factors, mass, preserve_mass_distribution))]
    fn scaled(
        &self,
        py: Python<'_>,
        factors: Vec<(String, [f64; 3])>,
        mass: Option<f64>,
        preserve_mass_distribution: bool,
    ) -> PyResult<(Model, String)> {
        let request = ScaleRequest { factors, preserve_mass_distribution, final_mass: mass };
        let mut file = self.file.clone();
        let scaled = py.detach(|| scale(&mut file, &request));
        let scaling = scaled.map_err(|e| {
            let message = Diagnostic::error(e.to_string()).in_file(&self.path);
            Failure::from(e.hint().into_iter().fold(message, Diagnostic::hint))
        });
        let scaling = scaling.or_raise(py)?;
        let length = |l: &carpus::scaling::ScaledLength| {
            json!({
                "name": l.name, "before_m": l.before, "after_m": l.after, "ratio": l.ratio(),
            })
        };
        let said = json!({
            "mass_before_kg": scaling.mass[0],
            "mass_kg": scaling.mass[1],
            "lengths": scaling.lengths.iter().map(length).collect::<Vec<_>>(),
            "not_scaled": scaling.left,
        });
        Ok((Model::of(file, &self.path), said.to_string()))
    }

    /// The model in the current format, and what was left out: line and component.
    fn upgraded(&self, py: Python<'_>) -> PyResult<(Model, Vec<(usize, String)>)> {
        let upgraded = py.detach(|| self.file.upgraded().map_err(|e| osim_failure(&self.path, &e))).or_raise(py)?;
        Ok((Model::of(upgraded.file, &self.path), upgraded.left_out))
    }
}

fn named(name: &str, at: &Location) -> Value {
    json!({ "name": name, "path": at.path, "line": at.line })
}

fn muscle(m: &MuscleSpec) -> Value {
    let class = match &m.kind {
        MuscleKind::Millard2012Equilibrium(_) => "Millard2012EquilibriumMuscle",
        MuscleKind::OtherClass { class, .. } => class,
    };
    json!({
        "name": m.name, "path": m.at.path, "line": m.at.line, "class": class, "appliesForce": m.applies_force,
        "max_isometric_force": m.max_isometric_force, "optimal_fiber_length": m.optimal_fiber_length,
        "tendon_slack_length": m.tendon_slack_length, "pennation_angle_at_optimal": m.pennation_angle_at_optimal,
        "max_contraction_velocity": m.max_contraction_velocity, "min_control": m.min_control,
        "max_control": m.max_control, "ignore_tendon_compliance": m.ignore_tendon_compliance,
        "ignore_activation_dynamics": m.ignore_activation_dynamics,
    })
}

/// The document's element of the component at a path.
fn element_of(spec: &ModelSpec, path: &str) -> Option<usize> {
    let all = spec.bodies.iter().map(|b| &b.at);
    let all = all.chain(spec.coordinates.iter().map(|c| &c.at)).chain(spec.joints.iter().map(|j| &j.at));
    let all = all.chain(spec.muscles.iter().map(|m| &m.at)).chain(spec.forces.iter().map(|f| &f.at));
    let all = all.chain(spec.constraints.iter().map(|c| &c.at)).chain(spec.markers.iter().map(|m| &m.at));
    let mut all = all.chain(spec.frames.iter().map(|f| &f.at)).chain(spec.wrap_objects.iter().map(|w| &w.at));
    all.find(|at| at.path == path)?.element
}
