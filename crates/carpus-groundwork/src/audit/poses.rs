//! Paths of all muscles over the ranges of the coordinates.

use rayon::prelude::*;

use super::super::diagnostic::Failure;
use super::super::model::LoadedModel;
use super::super::path_check::{self, PathSample};
use super::super::progress::{Progress, go_on};
use super::finding::{Check, Finding, Level};
use carpus_osim::osim::spec::{CoordinateIndex, MotionType, MuscleIndex};

/// Values of a coordinate over its range.
const VALUES: usize = 121;
/// A rotation of a wider range turns a whole body, not a joint [rad].
const WIDEST: f64 = std::f64::consts::TAU - 1e-6;

/// The posture and the coordinates that are moved from it.
pub(super) struct Poses {
    /// All coordinates [rad or m].
    pub posture: Vec<f64>,
    /// Those that are moved, one at a time.
    pub moved: Vec<CoordinateIndex>,
}

/// One muscle over the range of one coordinate.
pub(super) struct Swept {
    /// The muscle.
    pub muscle: MuscleIndex,
    /// The coordinate.
    pub coordinate: CoordinateIndex,
    /// Its path at every value.
    pub samples: Vec<PathSample>,
}

impl Poses {
    /// - `names`: of coordinates; none: all that have a range and follow no other
    ///
    /// # Errors
    /// A coordinate that the model does not have, or that follows another.
    pub fn of(loaded: &LoadedModel, names: &[String], posture: Vec<f64>) -> Result<Poses, Failure> {
        let has_range = |c: &CoordinateIndex| {
            let coordinate = &loaded.model.coordinates[c.0];
            let width = coordinate.range[1] - coordinate.range[0];
            let is_limited = coordinate.motion_type == MotionType::Translational || width < WIDEST;
            is_limited && width > 0.0 && !coordinate.locked && !loaded.model.is_dependent(*c)
        };
        let mut moved = Vec::new();
        for name in names {
            let index = loaded.coordinate(name)?;
            if loaded.model.is_dependent(index) {
                let drivers = loaded.model.names_of_roots(index, "`");
                let text = format!("coordinate `{name}` follows {drivers} through a coupler");
                return Err(loaded.message(text).hint(format!("name {drivers} instead")).into());
            }
            moved.push(index);
        }
        if names.is_empty() {
            moved.extend((0..loaded.model.n_coordinates()).map(CoordinateIndex).filter(has_range));
        }
        Ok(Poses { posture, moved })
    }

    /// Every muscle over the range of every coordinate that it depends on.
    ///
    /// # Errors
    /// A path that cannot be compiled; a request to stop. A path that is not finite somewhere is a finding.
    pub fn sweep(
        &self,
        loaded: &LoadedModel,
        progress: &dyn Progress,
        findings: &mut Vec<Finding>,
    ) -> Result<Vec<Swept>, Failure> {
        let all: Vec<MuscleIndex> = (0..loaded.file.spec.muscles.len()).map(MuscleIndex).collect();
        let paths = loaded.muscle_paths(&all)?;
        let over = |c: &CoordinateIndex| -> Result<(Vec<Swept>, Vec<MuscleIndex>), Failure> {
            go_on(progress)?;
            let moved = |m: &MuscleIndex| paths[m.0].0.depends_on(&loaded.model, *c);
            let muscles: Vec<MuscleIndex> = all.iter().copied().filter(moved).collect();
            let values = self.values(loaded, *c);
            let swept = |muscle: &MuscleIndex, samples| Swept { muscle: *muscle, coordinate: *c, samples };
            if let Ok(samples) = path_check::samples(loaded, &muscles, *c, &self.posture, &values) {
                return Ok((muscles.iter().zip(samples).map(|(m, s)| swept(m, s)).collect(), Vec::new()));
            }
            let (mut finite, mut broken) = (Vec::new(), Vec::new());
            for muscle in &muscles {
                match path_check::samples(loaded, &[*muscle], *c, &self.posture, &values) {
                    Ok(mut samples) => finite.push(swept(muscle, samples.swap_remove(0))),
                    Err(_) => broken.push(*muscle),
                }
            }
            Ok((finite, broken))
        };
        let found: Vec<_> = self.moved.par_iter().map(over).collect::<Result<_, _>>()?;
        let mut swept = Vec::new();
        for ((finite, broken), c) in found.into_iter().zip(&self.moved) {
            swept.extend(finite);
            findings.extend(broken.into_iter().map(|muscle| {
                let spec = &loaded.file.spec.muscles[muscle.0];
                let name = &loaded.model.coordinates[c.0].name;
                let text = format!("the length or moment arm of {} is not a number somewhere over {name}", spec.name);
                let hint = "one of its points or wrapping surfaces lies where numbers end, or a coordinate does";
                Finding::new(Level::Error, Check::PathJump, &spec.path.at, text, hint).over(loaded, *c)
            }));
        }
        Ok(swept)
    }

    /// Values of a coordinate over its range [rad or m].
    fn values(&self, loaded: &LoadedModel, c: CoordinateIndex) -> Vec<f64> {
        let [lower, upper] = loaded.model.coordinates[c.0].range;
        (0..VALUES).map(|i| lower + (upper - lower) * i as f64 / (VALUES - 1) as f64).collect()
    }
}

/// What was swept of one muscle.
pub(super) fn of_muscle(swept: &[Swept], muscle: usize) -> impl Iterator<Item = &Swept> + Clone {
    swept.iter().filter(move |s| s.muscle.0 == muscle)
}
