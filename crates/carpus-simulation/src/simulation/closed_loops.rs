//! Loops that constraints and joints close: what follows the coordinate that a dynamometer moves.
//!
//! In: a skeleton without its constraints between bodies, the moving coordinate and the coordinates that the study
//! holds. Out: the same skeleton, in which the coordinates of the loops follow the moving one by functions through
//! poses that satisfy all constraints. Forces along them then act about the moving coordinate as ideal constraints let
//! them.

use super::error::SimulationError;
use carpus_multibody::dynamics::{Constraints, Dynamics};
use carpus_multibody::multibody::Model;
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{CoordinateIndex, FunctionSpec, ModelSpec};

/// Largest distance between poses that a function goes through [rad or m].
const STEP: f64 = 0.01;
/// Fewest and most poses over the range of the moving coordinate.
const POSES: [f64; 2] = [64.0, 1500.0];
/// Poses beyond each end of the range where a function may be used: at its last poses a spline is less accurate.
const BEYOND: usize = 10;
/// How far beyond the coordinate's range loops are closed, where they can be [rad or m]: recorded angles, which may be
/// a little outside of it, and what varies them reach there.
const MARGIN: f64 = 0.25;
/// A coordinate that moves farther between two poses jumps to another way of closing the loop [rad or m].
const JUMP: f64 = 0.5;
/// Largest way from the posture of the study that a range leads [rad or m]: a whole turn.
const FARTHEST: f64 = std::f64::consts::TAU;
/// Values of a coordinate that differ by less are the same [rad or m].
const SAME: f64 = 1e-9;

/// Loops of a model, as far as a study can close them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ClosedLoops {
    /// Name and class of each constraint.
    constraints: Vec<(String, String)>,
    /// Values of the moving coordinate at which they hold [rad or m].
    range: [f64; 2],
    /// All coordinates of the loops but the moving one: how the loops close depends on their values.
    coordinates: Vec<CoordinateIndex>,
}

impl ClosedLoops {
    /// Values of the moving coordinate at which they hold [rad or m].
    pub(crate) fn range(&self) -> [f64; 2] {
        self.range
    }

    /// Checks that a posture of a trial leaves the loops as they are in the posture of the study.
    ///
    /// - `posture`: of the study, all coordinates
    /// - `held`: coordinates that the trial gives a value, with it
    ///
    /// # Errors
    /// [`SimulationError::LoopPosture`].
    pub(crate) fn check_posture(
        &self,
        skeleton: &Model,
        posture: &[f64],
        held: impl IntoIterator<Item = (CoordinateIndex, f64)>,
    ) -> Result<(), SimulationError> {
        let differs = |(c, value): &(CoordinateIndex, f64)| {
            // A coordinate that follows the moving one has no value of its own.
            let is_same = !skeleton.is_dependent(*c) && (value - posture[c.0]).abs() <= SAME;
            self.coordinates.contains(c) && !is_same
        };
        match held.into_iter().find(differs) {
            None => Ok(()),
            Some((c, _)) => Err(SimulationError::LoopPosture {
                constraints: self.constraints.clone(),
                coordinate: skeleton.coordinates[c.0].name.clone(),
            }),
        }
    }

    /// Checks that a coordinate can move while the moving one is at rest: loops are closed for the latter alone.
    ///
    /// # Errors
    /// [`SimulationError::LoopMomentArms`].
    pub(crate) fn check_alone(&self, skeleton: &Model, c: CoordinateIndex) -> Result<(), SimulationError> {
        match self.coordinates.contains(&c) {
            false => Ok(()),
            true => Err(SimulationError::LoopMomentArms {
                constraints: self.constraints.clone(),
                coordinate: skeleton.coordinates[c.0].name.clone(),
            }),
        }
    }

    /// # Errors
    /// [`SimulationError::LoopOpen`]: somewhere in the range of the trials they cannot be closed.
    pub(crate) fn check(&self, coordinate: &str, range: [f64; 2]) -> Result<(), SimulationError> {
        match range[0] >= self.range[0] && range[1] <= self.range[1] {
            true => Ok(()),
            false => Err(SimulationError::LoopOpen {
                constraints: self.constraints.clone(),
                coordinate: coordinate.to_owned(),
                closed: self.range,
                found: range,
            }),
        }
    }
}

/// Lets the coordinates of loops follow the moving one.
///
/// - `held`: coordinates that the study gives a value, with it
///
/// # Errors
/// Constraints that cannot be satisfied in the posture, or that leave open how.
pub(crate) fn close(
    spec: &ModelSpec,
    skeleton: Model,
    moving: CoordinateIndex,
    held: &[(CoordinateIndex, f64)],
) -> Result<(Model, Option<ClosedLoops>), SimulationError> {
    let named = skeleton.unsupported_constraints.clone();
    if named.is_empty() {
        return Ok((skeleton, None));
    }
    // A class that is not enforced at all is for the caller to judge.
    let Ok(all) = Constraints::compile(spec, &skeleton, false, false) else { return Ok((skeleton, None)) };
    let loops: Vec<_> = all.joined_bases().collect();
    let moves_a_loop =
        |c: CoordinateIndex| loops.iter().any(|[first, second]| skeleton.moves_between(*first, *second, c));
    let is_free = |c: CoordinateIndex| {
        let coordinate = &skeleton.coordinates[c.0];
        let is_held = c == moving || held.iter().any(|(held, _)| *held == c);
        !is_held && !coordinate.locked && !skeleton.is_dependent(c) && moves_a_loop(c)
    };
    let followers: Vec<CoordinateIndex> =
        (0..skeleton.n_coordinates()).map(CoordinateIndex).filter(|c| is_free(*c)).collect();
    let is_of_loop = |c: &CoordinateIndex| *c != moving && !skeleton.is_dependent(*c) && moves_a_loop(*c);
    let coordinates = (0..skeleton.n_coordinates()).map(CoordinateIndex).filter(is_of_loop).collect();
    let mut q = skeleton.default_coordinates();
    held.iter().for_each(|(c, value)| q[c.0] = *value);
    let range = skeleton.coordinates[moving.0].range;
    if moves_a_loop(moving) && !(range[0] <= range[1]) {
        let coordinate = skeleton.coordinates[moving.0].name.clone();
        return Err(SimulationError::LoopRange { constraints: named, coordinate, range });
    }
    // A default may be outside of the range.
    let start = if range[0] <= range[1] { q[moving.0].clamp(range[0], range[1]) } else { q[moving.0] };
    q[moving.0] = start;
    // All but the followers are prescribed: the moving coordinate is time.
    let mut driven = skeleton.clone();
    for (i, coordinate) in driven.coordinates.iter_mut().enumerate() {
        let c = CoordinateIndex(i);
        coordinate.prescribed = match () {
            () if c == moving => Some(Function::linear(1.0, 0.0)),
            () if followers.contains(&c) || skeleton.is_dependent(c) => None,
            () => Some(Function::constant(q[i])),
        };
    }
    let constraints = Constraints::compile(spec, &driven, false, true)
        .map_err(|e| SimulationError::Constraint { constraints: named.clone(), reason: e.to_string() })?;
    let mut dynamics = Dynamics::new(&driven, &constraints);
    dynamics
        .assemble(start, &mut q)
        .map_err(|e| SimulationError::Constraint { constraints: named.clone(), reason: e.to_string() })?;
    if !dynamics.is_determined(start, &q) {
        let free = followers.iter().map(|c| skeleton.coordinates[c.0].name.clone()).collect();
        return Err(SimulationError::LoopUndetermined { constraints: named, free });
    }
    let mut functions: Vec<(CoordinateIndex, Function)> = Vec::new();
    let mut closed = [f64::NEG_INFINITY, f64::INFINITY];
    if moves_a_loop(moving) {
        let range = [range[0].max(start - FARTHEST), range[1].min(start + FARTHEST)];
        // Also of a range that is a single value.
        let width = (range[1] - range[0]).max(STEP);
        let step = width / (width / STEP).ceil().clamp(POSES[0], POSES[1]);
        let mut walk = |direction: f64, end: f64| {
            let steps = ((((end - start) * direction).max(0.0) + MARGIN) / step).ceil() as usize + BEYOND;
            let (mut q, mut poses) = (q.clone(), Vec::new());
            for k in 1..=steps {
                let at = start + direction * step * k as f64;
                let before = q.clone();
                let is_closed = dynamics.assemble(at, &mut q).is_ok();
                if !is_closed || followers.iter().any(|c| (q[c.0] - before[c.0]).abs() > JUMP) {
                    break;
                }
                poses.push((at, q.clone()));
            }
            poses
        };
        let (down, up) = (walk(-1.0, range[0]), walk(1.0, range[1]));
        let poses: Vec<(f64, Vec<f64>)> = down.into_iter().rev().chain([(start, q.clone())]).chain(up).collect();
        let last = poses.len() - 1;
        if last < 2 * BEYOND {
            let reason = format!("it holds only near {} = {start} rad or m", skeleton.coordinates[moving.0].name);
            return Err(SimulationError::Constraint { constraints: named, reason });
        }
        closed = [poses[BEYOND].0, poses[last - BEYOND].0];
        let x: Vec<f64> = poses.iter().map(|(at, _)| *at).collect();
        for c in &followers {
            let y: Vec<f64> = poses.iter().map(|(_, q)| q[c.0]).collect();
            let weights = vec![1.0; x.len()];
            let spline = FunctionSpec::GcvSpline { half_order: 3, error_variance: 0.0, x: x.clone(), y, weights };
            let function = Function::compile(&spline)
                .map_err(|e| SimulationError::Constraint { constraints: named.clone(), reason: e.to_string() })?;
            functions.push((*c, function));
        }
    } else {
        functions.extend(followers.iter().map(|c| (*c, Function::constant(q[c.0]))));
    }
    let mut closed_skeleton = skeleton.clone().with_followers(moving, functions);
    closed_skeleton.unsupported_constraints.clear();
    Ok((closed_skeleton, Some(ClosedLoops { constraints: named, range: closed, coordinates })))
}
