//! What depends on the moving coordinate alone, tabulated once for all trials of a posture.

use super::error::SimulationError;
use super::model::MusculoskeletalModel;
use super::path_table::{PathTable, TableAccuracy};
use carpus_multibody::forces::{Force, gravity_force, inertia_force};
use carpus_multibody::multibody::{BodySubset, Cache};
use carpus_multibody::paths::{Path, PathGeometry};
use carpus_osim::osim::spec::CoordinateIndex;
use carpus_study::study::MomentPart;

/// Length, moment arm, lengthening speed for unit speed of the coordinate.
pub(crate) const LENGTH: usize = 0;
pub(crate) const MOMENT_ARM: usize = 1;
pub(crate) const UNIT_SPEED: usize = 2;

/// Lengths: an error moves a force by less than about 1e-5 of its maximum (tendons strain by 3 % of 0.2 m at maximum
/// force). Moment arms: reached only within about 0.1° of an angle where wrapping starts and the arm has a kink.
const PATH_ACCURACY: TableAccuracy<3> =
    TableAccuracy { tolerance: [5e-8, 5e-6, 5e-6], start_width: 0.4, min_width: 1e-4 };
/// Length from which on a path is refused [m]: no muscle of any animal is as long, a model whose lengths are
/// millimetres is, and a point or surface that far away makes rounding as large as what is tabulated.
const LONGEST_PATH: f64 = 20.0;
/// Of moments [N·m], viscosity [N·m·s], and inertia [kg·m²].
const FORCE_ACCURACY: TableAccuracy<5> =
    TableAccuracy { tolerance: [1e-5, 1e-5, 1e-6, 1e-8, 1e-8], start_width: 0.2, min_width: 2e-4 };

/// Generalized forces about the moving coordinate that are not along paths, for speed q̇ and acceleration q̈:
///
/// ```text
/// passive = elastic + viscous·q̇      gravity      inertia = by_acceleration·q̈ + by_speed_squared·q̇²
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CoordinateForces {
    pub(crate) elastic: f64,
    pub(crate) viscous: f64,
    pub(crate) gravity: f64,
    pub(crate) by_acceleration: f64,
    pub(crate) by_speed_squared: f64,
}

/// Tables over the range of the moving coordinate.
#[derive(Clone, Debug)]
pub(crate) struct CoordinateTables {
    /// Per active muscle.
    pub(crate) muscles: Vec<PathTable<3>>,
    /// Per passive force along a path.
    pub(crate) passive_paths: Vec<PathTable<3>>,
    /// Per force given by a formula: value of its coordinate, force about the moving coordinate by force on that one,
    /// and speed of that one for unit rate of the moving one; `None` if it does not follow the moving coordinate.
    pub(crate) expressions: Vec<Option<PathTable<3>>>,
    /// Everything else; `None` if none of it is part of the moment.
    forces: Option<PathTable<5>>,
}

impl CoordinateTables {
    /// Tabulates paths and forces of `model` on `range` of its moving coordinate.
    ///
    /// - `posture`: all coordinates, of which the moving one varies
    /// - `beyond`: how far tables go beyond the range [rad or m]. Where loops of constraints do not close that far, the
    ///   tables continue straight on.
    ///
    /// # Errors
    /// [`SimulationError::PathLength`]; [`SimulationError::LoopOpen`] within the range.
    pub(crate) fn build(
        model: &MusculoskeletalModel,
        posture: &[f64],
        range: [f64; 2],
        beyond: f64,
    ) -> Result<CoordinateTables, SimulationError> {
        model.check_loops(range)?;
        let range = [range[0] - beyond, range[1] + beyond];
        // A held joint still needs a table that is wide enough to be well conditioned.
        let margin = 1e-3_f64.max(0.002 * (range[1] - range[0]));
        let range = [range[0] - margin, range[1] + margin];
        let mut muscles = Vec::with_capacity(model.muscles.len());
        for muscle in &model.muscles {
            muscles.push(path_table(model, posture, &muscle.path, &muscle.name, range)?);
        }
        let mut passive_paths = Vec::with_capacity(model.passive_paths.len());
        for force in &model.passive_paths {
            passive_paths.push(path_table(model, posture, &force.path, &force.name, range)?);
        }
        let expressions = model
            .forces
            .expressions()
            .map(|force| follower_table(model, posture, force.coordinate, range))
            .collect::<Result<_, SimulationError>>()?;
        let forces = force_table(model, posture, range)?;
        Ok(CoordinateTables { muscles, passive_paths, expressions, forces })
    }

    /// Forces at an angle.
    pub(crate) fn forces(&self, angle: f64, cursor: &mut usize) -> CoordinateForces {
        let Some(table) = &self.forces else { return CoordinateForces::default() };
        let [elastic, viscous, gravity, by_acceleration, by_speed_squared] = table.values(angle, cursor);
        CoordinateForces { elastic, viscous, gravity, by_acceleration, by_speed_squared }
    }

    /// Evaluations of paths and forces that building took.
    pub(crate) fn evaluations(&self) -> usize {
        let paths = self.muscles.iter().chain(&self.passive_paths).map(PathTable::evaluations).sum::<usize>();
        paths + self.forces.as_ref().map_or(0, PathTable::evaluations)
    }
}

/// The moving coordinate at some value, and the kinematics that follow from it.
struct Posed<'a> {
    model: &'a MusculoskeletalModel,
    q: Vec<f64>,
    cache: Cache,
    moving: BodySubset,
}

impl<'a> Posed<'a> {
    /// - `bodies`: those whose poses matter
    fn new(model: &'a MusculoskeletalModel, posture: &[f64], bodies: BodySubset) -> Posed<'a> {
        let skeleton = &model.skeleton;
        let mut cache = skeleton.new_cache();
        let q = posture.to_vec();
        skeleton.update_positions_in(&bodies, &q, &mut cache);
        skeleton.update_unit_motion_in(&bodies, &q, model.coordinate, &mut cache);
        let moving = bodies.intersection(&skeleton.bodies_moved_by(&[model.coordinate]));
        Posed { model, q, cache, moving }
    }

    /// Takes the pose at an angle, or the nearest in which loops of constraints close. Returns how far the angle is
    /// from it [rad or m].
    fn set(&mut self, angle: f64) -> f64 {
        let (skeleton, c) = (&self.model.skeleton, self.model.coordinate);
        let taken = self.model.closed_range().map_or(angle, |[least, most]| angle.max(least).min(most));
        self.q[c.0] = taken;
        skeleton.satisfy_couplers(&mut self.q);
        skeleton.update_positions_in(&self.moving, &self.q, &mut self.cache);
        skeleton.update_unit_motion_in(&self.moving, &self.q, c, &mut self.cache);
        angle - taken
    }
}

fn path_table(
    model: &MusculoskeletalModel,
    posture: &[f64],
    path: &Path,
    owner: &str,
    range: [f64; 2],
) -> Result<PathTable<3>, SimulationError> {
    let skeleton = &model.skeleton;
    let mut posed = Posed::new(model, posture, skeleton.body_subset(&path.bodies()));
    let mut geometry: PathGeometry = path.new_geometry();
    // The bodies that do not move keep velocity zero.
    let mut evaluate = |angle: f64| {
        let farther = posed.set(angle);
        path.update(&posed.q, &posed.cache, &mut geometry);
        skeleton.update_velocities_of_unit_motion_in(&posed.moving, &posed.q, &mut posed.cache);
        let unit_speed = path.lengthening_speed(&posed.q, posed.cache.coupling(), &posed.cache, &geometry);
        let mut length = geometry.length();
        // Not where nothing is farther, as a speed may be no number.
        if farther != 0.0 {
            length += unit_speed * farther;
        }
        if !(length > 0.0 && length < LONGEST_PATH) {
            return Err(SimulationError::PathLength { muscle: owner.to_owned(), angle, length });
        }
        Ok([length, path.moment_arm(&posed.q, &posed.cache, &geometry), unit_speed])
    };
    PathTable::build(range, PATH_ACCURACY, &mut evaluate)
}

/// Value of a coordinate that the moving one may drive, force about that one by force on it, and speed for unit rate of
/// that one.
fn follower_table(
    model: &MusculoskeletalModel,
    posture: &[f64],
    coordinate: CoordinateIndex,
    range: [f64; 2],
) -> Result<Option<PathTable<3>>, SimulationError> {
    let skeleton = &model.skeleton;
    if !skeleton.are_coupled(coordinate, model.coordinate) {
        return Ok(None);
    }
    let mut posed = Posed::new(model, posture, skeleton.bodies_moved_by(&[model.coordinate]));
    let mut speeds = vec![0.0; skeleton.n_coordinates()];
    let mut evaluate = |angle: f64| {
        let farther = posed.set(angle);
        skeleton.speeds_of_rates(&posed.cache, posed.cache.coupling(), &mut speeds);
        let rate = posed.cache.coupling()[coordinate.0];
        Ok([posed.q[coordinate.0] + rate * farther, rate, speeds[coordinate.0]])
    };
    let accuracy = TableAccuracy { tolerance: [1e-9; 3], start_width: 0.2, min_width: 2e-4 };
    PathTable::build(range, accuracy, &mut evaluate).map(Some)
}

fn force_table(
    model: &MusculoskeletalModel,
    posture: &[f64],
    range: [f64; 2],
) -> Result<Option<PathTable<5>>, SimulationError> {
    let setup = &model.setup;
    let skeleton = &model.skeleton;
    let mut acting: Vec<&Force> = Vec::new();
    if setup.includes(MomentPart::Passive) {
        acting.extend(model.forces.affine_in_speed().filter(|f| f.can_act_about(skeleton, model.coordinate)));
    }
    let passive = !acting.is_empty();
    let gravity = setup.includes(MomentPart::Gravity);
    let inertia = setup.includes(MomentPart::Inertia);
    if !(passive || gravity || inertia) {
        return Ok(None);
    }
    // Speeds that are not rates follow from the poses of their joints.
    let bodies = if gravity || inertia || !skeleton.speeds_are_rates() {
        skeleton.all_bodies()
    } else {
        skeleton.body_subset(&acting.iter().flat_map(|f| f.bodies(skeleton)).collect::<Vec<_>>())
    };
    let mut posed = Posed::new(model, posture, bodies);
    let mut rates = vec![0.0; skeleton.n_coordinates()];
    let mut accelerations = vec![0.0; skeleton.n_coordinates()];
    let zero = vec![0.0; skeleton.n_coordinates()];
    let mut speeds = zero.clone();
    let mut evaluate = |angle: f64| {
        posed.set(angle);
        let Posed { q, cache, moving, .. } = &mut posed;
        let mut at = [0.0; 5];
        rates.copy_from_slice(cache.coupling());
        if passive {
            skeleton.update_velocities_in(moving, q, &zero, cache);
            at[0] = acting.iter().map(|f| f.generalized_force(skeleton, q, &zero, cache)).sum();
            skeleton.update_velocities_in(moving, q, &rates, cache);
            skeleton.speeds_of_rates(cache, &rates, &mut speeds);
            let at_speed: f64 = acting.iter().map(|f| f.generalized_force(skeleton, q, &speeds, cache)).sum();
            at[1] = at_speed - at[0];
        }
        if gravity {
            at[2] = gravity_force(skeleton, moving, cache);
        }
        if inertia {
            // Unit acceleration from rest, then unit speed without acceleration of the moving coordinate itself.
            skeleton.update_velocities_in(moving, q, &zero, cache);
            skeleton.update_accelerations_in(moving, q, &zero, &rates, cache);
            at[3] = inertia_force(skeleton, moving, cache);
            accelerations.fill(0.0);
            skeleton.follow_couplers_second(q, &rates, &mut accelerations);
            skeleton.update_velocities_in(moving, q, &rates, cache);
            skeleton.update_accelerations_in(moving, q, &rates, &accelerations, cache);
            at[4] = inertia_force(skeleton, moving, cache);
        }
        Ok(at)
    };
    PathTable::build(range, FORCE_ACCURACY, &mut evaluate).map(Some)
}
