//! A model in a posture, for drawing and for reading numbers off: poses of bodies, paths of muscles, their lengths and
//! moment arms, computed as `carpus paths` computes them.

use carpus_multibody::multibody::{BaseIndex, Cache, CompileError, Model};
use carpus_multibody::paths::{Path, PathError, PathGeometry};
use carpus_numerics::spatial::Transform;
use carpus_osim::osim::OsimFile;
use carpus_osim::osim::spec::{CoordinateIndex, ModelSpec};
use nalgebra::Vector3;

/// A model with the paths of its muscles.
pub struct Scene {
    /// What the file states.
    pub spec: ModelSpec,
    /// The skeleton.
    pub model: Model,
    muscles: Vec<(Path, PathGeometry)>,
    cache: Cache,
}

/// Why a model cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The skeleton.
    #[error(transparent)]
    Skeleton(#[from] CompileError),
    /// The path of a muscle.
    #[error("{muscle}: {error}")]
    Path {
        /// Its name.
        muscle: String,
        /// What is wrong with it.
        error: PathError,
    },
}

/// A model in a posture.
#[derive(Clone, Debug, PartialEq)]
#[allow(non_snake_case)]
pub struct Posture {
    /// All coordinates [rad or m], couplers satisfied.
    pub q: Vec<f64>,
    /// Poses of ground and all bodies in ground.
    pub X_GB: Vec<Transform>,
    /// Of every muscle.
    pub muscles: Vec<DrawnMuscle>,
}

/// A muscle's path in a posture.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnMuscle {
    /// Length of the path [m].
    pub length: f64,
    /// Points to be joined by straight lines, in ground [m].
    pub points: Vec<Vector3<f64>>,
}

/// A muscle's path over values of a coordinate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SweptMuscle {
    /// Length of the path [m].
    pub length: Vec<f64>,
    /// Moment arm about the coordinate [m; dimensionless about a translation].
    pub moment_arm: Vec<f64>,
}

/// A moment arm as it can be drawn: from the axis about which the coordinate turns the two bodies between which the
/// muscle pulls most, to the line along which it pulls. In ground [m].
///
/// Where the muscle turns the coordinate through this one piece about this one axis, the distance between the two
/// points times the sine between axis and line is the moment arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lever {
    /// A unit vector along the axis.
    pub axis: Vector3<f64>,
    /// The axis' point nearest to the line.
    pub on_axis: Vector3<f64>,
    /// The line's point nearest to the axis.
    pub on_line: Vector3<f64>,
    /// The piece of the path that pulls.
    pub piece: [Vector3<f64>; 2],
}

/// Below this relative angular speed a coordinate does not turn one body against another [1].
const NO_TURN: f64 = 1e-9;

impl Scene {
    /// Compiles the model of a file.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn of(file: &OsimFile) -> Result<Scene, SceneError> {
        let spec = file.spec.clone();
        let model = Model::compile(&spec)?;
        let compile = |muscle: &carpus_osim::osim::spec::MuscleSpec| {
            let path = Path::compile(&muscle.path, &spec, &model)
                .map_err(|error| SceneError::Path { muscle: muscle.name.clone(), error })?;
            let geometry = path.new_geometry();
            Ok((path, geometry))
        };
        let muscles = spec.muscles.iter().map(compile).collect::<Result<_, SceneError>>()?;
        let cache = model.new_cache();
        Ok(Scene { muscles, cache, spec, model })
    }

    /// The path of every muscle.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.muscles.iter().map(|(path, _)| path)
    }

    /// The model with these coordinates; those that follow others are set by their couplers.
    ///
    /// - `q`: all coordinates [rad or m]; those that are missing are as the model gives them
    pub fn posture(&mut self, q: &[f64]) -> Posture {
        let q = self.place(q);
        let cache = &self.cache;
        let drawn = |(path, geometry): &mut (Path, PathGeometry)| {
            path.update(&q, cache, geometry);
            let mut points = Vec::new();
            path.drawn_points(geometry, &mut points);
            DrawnMuscle { length: geometry.length(), points }
        };
        let muscles = self.muscles.iter_mut().map(drawn).collect();
        Posture { X_GB: (0..self.model.n_bases()).map(|b| *cache.X_GB(BaseIndex(b))).collect(), muscles, q }
    }

    /// Moment arm of every muscle about a coordinate [m; dimensionless about a translation].
    pub fn moment_arms(&mut self, q: &[f64], about: CoordinateIndex) -> Vec<f64> {
        let q = self.place(q);
        self.model.update_unit_motion(&q, about, &mut self.cache);
        let cache = &self.cache;
        let arm = |(path, geometry): &mut (Path, PathGeometry)| {
            path.update(&q, cache, geometry);
            path.moment_arm(&q, cache, geometry)
        };
        self.muscles.iter_mut().map(arm).collect()
    }

    /// Lengths and moment arms of some muscles over values of a coordinate.
    ///
    /// - `values`: of the coordinate [rad or m]
    /// - `muscles`: by their place in the model; those that it does not have are left out
    pub fn sweep(&mut self, q: &[f64], about: CoordinateIndex, values: &[f64], muscles: &[usize]) -> Vec<SweptMuscle> {
        let muscles: Vec<usize> = muscles.iter().copied().filter(|m| *m < self.muscles.len()).collect();
        let mut swept = vec![SweptMuscle::default(); muscles.len()];
        let mut q = self.place(q);
        for value in values {
            q[about.0] = *value;
            let q = self.place(&q);
            self.model.update_unit_motion(&q, about, &mut self.cache);
            for (m, swept) in muscles.iter().zip(&mut swept) {
                let (path, geometry) = &mut self.muscles[*m];
                path.update(&q, &self.cache, geometry);
                swept.length.push(geometry.length());
                swept.moment_arm.push(path.moment_arm(&q, &self.cache, geometry));
            }
        }
        swept
    }

    /// The moment arm of a muscle as it can be drawn; `None` where the coordinate turns nothing that it pulls on.
    #[allow(non_snake_case)]
    pub fn lever(&mut self, q: &[f64], about: CoordinateIndex, muscle: usize) -> Option<Lever> {
        let q = self.place(q);
        self.model.update_unit_motion(&q, about, &mut self.cache);
        let cache = &self.cache;
        let (path, geometry) = self.muscles.get_mut(muscle)?;
        path.update(&q, cache, geometry);
        let velocity =
            |base: BaseIndex, at: &Vector3<f64>| cache.partial_velocity(base).velocity_at(&(at - cache.X_GB(base).p));
        let mut best: Option<(f64, Lever)> = None;
        for pair in geometry.points().windows(2) {
            let (from, to) = (&pair[0], &pair[1]);
            let Some(along) = (to.p_GS - from.p_GS).try_normalize(0.0) else { continue };
            let w = cache.partial_velocity(to.base).w - cache.partial_velocity(from.base).w;
            let speed = w.norm();
            if from.base == to.base || speed < NO_TURN {
                continue;
            }
            let share = along.dot(&(velocity(from.base, &from.p_GS) - velocity(to.base, &to.p_GS))).abs();
            // Where the one body moves against the other along the axis only.
            let v = velocity(to.base, &from.p_GS) - velocity(from.base, &from.p_GS);
            let axis = w / speed;
            let lever = nearest(from.p_GS + w.cross(&v) / (speed * speed), axis, [from.p_GS, to.p_GS], along);
            if best.is_none_or(|(most, _)| share > most) {
                best = Some((share, lever));
            }
        }
        best.map(|(_, lever)| lever)
    }

    /// Puts the bodies where coordinates say; all of them, couplers satisfied.
    fn place(&mut self, given: &[f64]) -> Vec<f64> {
        let mut q: Vec<f64> = self.model.coordinates.iter().map(|c| c.default_value).collect();
        q.iter_mut().zip(given).for_each(|(q, given)| *q = *given);
        self.model.satisfy_couplers(&mut q);
        self.model.update_positions(&q, &mut self.cache);
        q
    }
}

/// The shortest way between an axis and a line; from the first end of the piece where they are parallel.
fn nearest(at: Vector3<f64>, axis: Vector3<f64>, piece: [Vector3<f64>; 2], along: Vector3<f64>) -> Lever {
    /// Square of the sine below which two lines are parallel.
    const PARALLEL: f64 = 1e-9;
    let between = piece[0] - at;
    let cosine = axis.dot(&along);
    let sine_squared = 1.0 - cosine * cosine;
    let on_line = if sine_squared < PARALLEL {
        piece[0]
    } else {
        piece[0] + along * ((cosine * between.dot(&axis) - between.dot(&along)) / sine_squared)
    };
    let on_axis = at + axis * (on_line - at).dot(&axis);
    Lever { axis, on_axis, on_line, piece }
}
