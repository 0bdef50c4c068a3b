//! Linear scaling of a model as OpenSim's Scale Tool does it.

use std::collections::HashMap;

use carpus_multibody::multibody::{CompileError, Model};
use carpus_multibody::paths::{Path, PathError};
use carpus_numerics::plausible;
use carpus_osim::osim::spec::{ModelSpec, PathSpec};
use carpus_osim::osim::{BodyFactors, OsimFile, ScaleError};

/// What to scale by how much.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScaleRequest {
    /// Factors of bodies (or `ground`) along their x, y, z; the last of several for the same body holds, as in
    /// OpenSim's `ScaleSet`.
    pub factors: Vec<(String, [f64; 3])>,
    /// Whether bodies keep their share of the model's mass.
    pub preserve_mass_distribution: bool,
    /// Mass of the scaled model \[kg\]; `None`: what the bodies add up to.
    pub final_mass: Option<f64>,
}

/// What linear scaling did.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearScaling {
    /// The factors of the bodies.
    pub factors: Vec<(String, [f64; 3])>,
    /// Mass of the model before and after \[kg\].
    pub mass: [f64; 2],
    /// Path lengths in the default pose, of all muscles, ligaments and springs.
    pub lengths: Vec<ScaledLength>,
    /// Components with lengths that were not scaled: component path, and why.
    pub left: Vec<(String, String)>,
}

impl LinearScaling {
    /// Factors and a mass that no person asks for: what is doubtful, and a hint.
    pub fn doubts(&self) -> Vec<(String, String)> {
        let mut doubts = Vec::new();
        for (body, factors) in &self.factors {
            if let Some(doubt) = factors.iter().find_map(|factor| plausible::SCALE_FACTOR.doubt(*factor)) {
                doubts.push((format!("scale factor of `{body}`: {doubt}"), doubt.hint()));
            }
        }
        // A model may be a part of a person.
        let heaviest = &plausible::BODY_MASS;
        if let Some(doubt) = heaviest.doubt(self.mass[1]).filter(|_| self.mass[1] > heaviest.range[1]) {
            doubts.push((format!("mass of the scaled model: {doubt}"), doubt.hint()));
        }
        doubts
    }
}

/// A path's length in the default pose, before and after.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaledLength {
    /// Component path of its muscle or force.
    pub path: String,
    /// Name of its muscle or force.
    pub name: String,
    /// Length before \[m\].
    pub before: f64,
    /// Length after \[m\].
    pub after: f64,
}

impl ScaledLength {
    /// What optimal fibre length, tendon slack length and resting length are multiplied by.
    pub fn ratio(&self) -> f64 {
        self.after / self.before
    }
}

/// Why a model could not be scaled.
#[derive(Debug, thiserror::Error)]
pub enum LinearScalingError {
    /// The factors or the edit.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// The skeleton.
    #[error(transparent)]
    Compile(#[from] CompileError),
    /// A path.
    #[error("{owner}: {source}")]
    Path {
        /// Muscle or force.
        owner: String,
        /// What is wrong.
        source: PathError,
    },
    /// A length that scaling made unusable.
    #[error("{owner}: its path is {before} m long before scaling and {after} m after")]
    Length {
        /// Muscle or force.
        owner: String,
        /// Before \[m\].
        before: f64,
        /// After \[m\].
        after: f64,
    },
}

impl LinearScalingError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            LinearScalingError::Scale(ScaleError::UnknownBody { nearest, .. }) => {
                nearest.as_ref().map(|nearest| format!("did you mean `{nearest}`?"))
            }
            LinearScalingError::Scale(ScaleError::Edit(error)) => error.hint(),
            LinearScalingError::Scale(ScaleError::UnevenCoupler { .. }) => {
                Some("scale that body by the same factor along x, y and z".to_owned())
            }
            _ => None,
        }
    }
}

/// Scales a model and writes the scaled values into the file: bodies, joints, paths, wrap objects and markers by the
/// factors of the bodies that they are fixed to, then the lengths of muscles, ligaments and springs by the ratio of
/// their path's length after to before, in the default pose.
///
/// # Errors
/// [`LinearScalingError`]; the file is then as it was.
///
/// # References
/// OpenSim 4.6 `ModelScaler::processModel`, `Model::scale`; what each component scales: [`carpus_osim::osim::scale`].
pub fn scale(file: &mut OsimFile, request: &ScaleRequest) -> Result<LinearScaling, LinearScalingError> {
    let mut factors: Vec<(String, [f64; 3])> = Vec::new();
    for (body, of_body) in &request.factors {
        factors.retain(|(known, _)| known != body);
        factors.push((body.clone(), *of_body));
    }
    let by_body = BodyFactors::new(&file.spec, &factors)?;
    let before = path_lengths(&file.spec)?;
    let mut scaled = file.clone();
    let bodies = scaled.scale_bodies(&by_body, request.preserve_mass_distribution, request.final_mass)?;
    let after = path_lengths(&scaled.spec)?;
    let mut lengths = Vec::with_capacity(before.len());
    let mut ratio = HashMap::new();
    for ((path, name, before), (_, _, after)) in before.into_iter().zip(after) {
        let length = ScaledLength { path: path.clone(), name, before, after };
        if !(before > 0.0 && length.ratio().is_finite() && after > 0.0) {
            return Err(LinearScalingError::Length { owner: path, before, after });
        }
        ratio.insert(path, length.ratio());
        lengths.push(length);
    }
    scaled.scale_path_lengths(&ratio).map_err(ScaleError::from)?;
    let mut left = bodies.left;
    left.extend(paths_by_functions(&scaled.spec));
    *file = scaled;
    Ok(LinearScaling { factors, mass: [bodies.mass_before, bodies.mass_after], lengths, left })
}

/// Muscles and forces whose paths are functions of coordinates, which no factor of a body changes.
fn paths_by_functions(spec: &ModelSpec) -> impl Iterator<Item = (String, String)> + '_ {
    let of_muscles = spec.muscles.iter().map(|muscle| (&muscle.at.path, Some(&muscle.path)));
    let of_forces = spec.forces.iter().map(|force| (&force.at.path, force.kind.path()));
    let by_functions =
        of_muscles.chain(of_forces).filter(|(_, path)| path.is_some_and(|path| path.functions.is_some()));
    by_functions.map(|(at, _)| {
        (at.clone(), "FunctionBasedPath: its functions stay, and the lengths that go with the path".to_owned())
    })
}

/// Component path, name and length in the default pose of everything that has a path.
fn path_lengths(spec: &ModelSpec) -> Result<Vec<(String, String, f64)>, LinearScalingError> {
    let skeleton = Model::compile(spec)?;
    let q = skeleton.default_coordinates();
    let mut cache = skeleton.new_cache();
    skeleton.update_positions(&q, &mut cache);
    let of_muscles = spec.muscles.iter().map(|muscle| (&muscle.at.path, &muscle.name, &muscle.path));
    let of_forces = spec.forces.iter().filter_map(|force| Some((&force.at.path, &force.name, force.kind.path()?)));
    let length = |(at, name, path): (&String, &String, &PathSpec)| {
        let path = Path::compile(path, spec, &skeleton)
            .map_err(|source| LinearScalingError::Path { owner: at.clone(), source })?;
        let mut geometry = path.new_geometry();
        path.update(&q, &cache, &mut geometry);
        Ok((at.clone(), name.clone(), geometry.length()))
    };
    of_muscles.chain(of_forces).map(length).collect()
}
