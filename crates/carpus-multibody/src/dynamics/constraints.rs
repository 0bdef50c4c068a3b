//! Constraints: how far they are violated, their Jacobian, and what they ask of accelerations.
//!
//! Every constraint gives rows in the space of coordinate rates q̇ or of speeds u; rows of q̇ are turned into rows of u
//! by N(q), which is the identity for all joints but ball and free joints.

use super::error::ConstraintError;
use super::reduction::Reduction;
use crate::multibody::{BaseIndex, Cache, Coupler, Model};
use carpus_numerics::spatial::{SpatialForce, SpatialVelocity, Transform};
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{ConstraintKind, CoordinateIndex, FrameIndex, ModelSpec};
use nalgebra::{DMatrix, DVector, Vector3};

/// A point fixed in a base.
#[derive(Clone, Copy, Debug)]
#[allow(non_snake_case)]
struct Station {
    base: BaseIndex,
    p_BS: Vector3<f64>,
}

#[derive(Clone, Debug)]
#[allow(non_snake_case)]
enum Kind {
    /// dependent − f(independent) = 0.
    Coupler(Box<Coupler>),
    /// A coordinate that keeps a value.
    Locked { coordinate: CoordinateIndex, value: f64 },
    /// A coordinate that follows a function of time.
    Prescribed { coordinate: CoordinateIndex, function: Box<Function> },
    /// Two frames that coincide.
    Weld { first: (BaseIndex, Transform), second: (BaseIndex, Transform) },
    /// Two points that coincide.
    Point { first: Station, second: Station },
    /// Two points at a distance.
    Distance { first: Station, second: Station, distance: f64 },
    /// A point on a line: `across` are two directions in the line's base, at right angles to it.
    OnLine { line: Station, across: [Vector3<f64>; 2], follower: Station },
}

impl Kind {
    fn joins_bodies(&self) -> bool {
        !matches!(self, Kind::Coupler(_) | Kind::Locked { .. } | Kind::Prescribed { .. })
    }

    /// Whether speeds follow from it in another way than one from one other.
    fn ties_several(&self) -> bool {
        match self {
            Kind::Coupler(coupler) => coupler.only_argument().is_none(),
            kind => kind.joins_bodies(),
        }
    }

    /// Whether a reduction to free coordinates satisfies it.
    fn is_satisfied_by(&self, reduction: &Reduction) -> bool {
        match self {
            Kind::Coupler(coupler) => reduction.follows(coupler),
            Kind::Locked { coordinate, .. } | Kind::Prescribed { coordinate, .. } => reduction.holds(*coordinate),
            _ => false,
        }
    }

    fn rows(&self) -> usize {
        match self {
            Kind::Coupler(_) | Kind::Locked { .. } | Kind::Prescribed { .. } | Kind::Distance { .. } => 1,
            Kind::OnLine { .. } => 2,
            Kind::Point { .. } => 3,
            Kind::Weld { .. } => 6,
        }
    }
}

/// All constraints that are enforced, locked and prescribed coordinates among them. Immutable.
#[derive(Clone, Debug)]
pub struct Constraints {
    kinds: Vec<Kind>,
    /// Position of every kind among the constraints of the specification; `None`: a locked or prescribed coordinate, or
    /// a loop of joints.
    origins: Vec<Option<usize>>,
    rows: usize,
}

/// What one constraint does at a state.
#[derive(Clone, Debug, PartialEq)]
pub struct ConstraintForce {
    /// Position among the constraints of the specification; `None`: a locked or prescribed coordinate, or a loop of
    /// joints.
    pub constraint: Option<usize>,
    /// Forces on the two bodies that it joins at their origins, expressed in ground; empty for constraints of
    /// coordinates.
    pub bodies: Vec<(BaseIndex, SpatialForce)>,
    /// Forces along coordinates [N·m or N]; empty for constraints between bodies.
    pub mobilities: Vec<(CoordinateIndex, f64)>,
}

/// What constraints ask for at one state.
#[derive(Clone, Debug)]
#[allow(non_snake_case)]
pub(super) struct Rows {
    /// Jacobian by the speeds.
    pub G: DMatrix<f64>,
    /// Right side of `G u = v`.
    pub v: DVector<f64>,
    /// Right side of `G u̇ = b`.
    pub b: DVector<f64>,
    /// Violation of positions.
    pub error: DVector<f64>,
}

impl Constraints {
    /// Builds the enforced constraints of a model.
    ///
    /// - `spec`, `model`: the specification and what was compiled from it
    /// - `locked`, `prescribed`: whether coordinates that the file locks or prescribes are held so (at the default
    ///   value, along the function)
    ///
    /// # Errors
    /// A constraint of a class that is not enforced, or a line without direction.
    pub fn compile(
        spec: &ModelSpec,
        model: &Model,
        locked: bool,
        prescribed: bool,
    ) -> Result<Constraints, ConstraintError> {
        let mut kinds: Vec<Kind> =
            model.couplers.iter().map(|coupler| Kind::Coupler(Box::new(coupler.clone()))).collect();
        let of_coupler = |coupler: &Coupler| {
            spec.constraints.iter().position(|c| {
                c.is_enforced
                    && matches!(&c.kind, ConstraintKind::CoordinateCoupler { dependent_coordinate, .. }
                        if *dependent_coordinate == coupler.dependent)
            })
        };
        let mut origins: Vec<Option<usize>> = model.couplers.iter().map(of_coupler).collect();
        for (i, coordinate) in model.coordinates.iter().enumerate() {
            let index = CoordinateIndex(i);
            match &coordinate.prescribed {
                Some(function) if prescribed => {
                    kinds.push(Kind::Prescribed { coordinate: index, function: Box::new(function.clone()) });
                }
                _ if locked && coordinate.locked => {
                    kinds.push(Kind::Locked { coordinate: index, value: coordinate.default_value });
                }
                _ => {}
            }
        }
        origins.resize(kinds.len(), None);
        let station = |frame: &FrameIndex, p: &Vector3<f64>| Station { base: model.frame(*frame).base, p_BS: *p };
        for (index, constraint) in spec.constraints.iter().enumerate().filter(|(_, c)| c.is_enforced) {
            kinds.push(match &constraint.kind {
                ConstraintKind::CoordinateCoupler { .. } => continue,
                ConstraintKind::Weld { frame1, frame2 } => {
                    let place = |frame: &FrameIndex| (model.frame(*frame).base, model.frame(*frame).X_BF);
                    Kind::Weld { first: place(frame1), second: place(frame2) }
                }
                ConstraintKind::Point { body_1, body_2, location_body_1, location_body_2 } => {
                    Kind::Point { first: station(body_1, location_body_1), second: station(body_2, location_body_2) }
                }
                ConstraintKind::ConstantDistance {
                    body_1,
                    body_2,
                    location_body_1,
                    location_body_2,
                    constant_distance,
                } => Kind::Distance {
                    first: station(body_1, location_body_1),
                    second: station(body_2, location_body_2),
                    distance: *constant_distance,
                },
                ConstraintKind::PointOnLine {
                    line_body,
                    follower_body,
                    line_direction_vec,
                    point_on_line,
                    point_on_follower,
                } => {
                    let direction = line_direction_vec
                        .try_normalize(0.0)
                        .ok_or_else(|| ConstraintError::NoDirection { at: constraint.at.clone() })?;
                    let across = direction.cross(&Vector3::ith(direction.iamin(), 1.0)).normalize();
                    Kind::OnLine {
                        line: station(line_body, point_on_line),
                        across: [across, direction.cross(&across)],
                        follower: station(follower_body, point_on_follower),
                    }
                }
                ConstraintKind::Unsupported { class } => {
                    return Err(ConstraintError::Unsupported { at: constraint.at.clone(), class: class.clone() });
                }
            });
            origins.push(Some(index));
        }
        for weld in &model.loop_welds {
            let [first, second] = weld.bases.map(|base| (base, Transform::identity()));
            kinds.push(Kind::Weld { first, second });
            origins.push(None);
        }
        let rows = kinds.iter().map(Kind::rows).sum();
        Ok(Constraints { kinds, origins, rows })
    }

    /// No constraint at all.
    pub fn none() -> Constraints {
        Constraints { kinds: Vec::new(), origins: Vec::new(), rows: 0 }
    }

    /// Those that a reduction to free coordinates does not satisfy.
    pub fn beyond(mut self, reduction: &Reduction) -> Constraints {
        let keep: Vec<bool> = self.kinds.iter().map(|kind| !kind.is_satisfied_by(reduction)).collect();
        let mut kept = keep.iter();
        self.kinds.retain(|_| kept.next().copied().unwrap_or(false));
        let mut kept = keep.iter();
        self.origins.retain(|_| kept.next().copied().unwrap_or(false));
        self.rows = self.kinds.iter().map(Kind::rows).sum();
        self
    }

    /// The same for a simulation over time, whose accelerations must keep what positions and velocities satisfy;
    /// OpenSim brings those back onto the constraints after each step.
    pub fn kept_in_motion(mut self) -> Constraints {
        for kind in &mut self.kinds {
            if let Kind::Coupler(coupler) = kind {
                **coupler = (**coupler).clone().with_own_second_rates();
            }
        }
        self
    }

    /// Whether by any of them speeds depend on one another in other ways than one on one other.
    pub fn tie_several(&self) -> bool {
        self.kinds.iter().any(Kind::ties_several)
    }

    /// The two bases that each constraint between bodies joins.
    pub fn joined_bases(&self) -> impl Iterator<Item = [BaseIndex; 2]> + '_ {
        self.kinds.iter().filter_map(|kind| match kind {
            Kind::Coupler(_) | Kind::Locked { .. } | Kind::Prescribed { .. } => None,
            Kind::Weld { first, second } => Some([first.0, second.0]),
            Kind::Point { first, second } | Kind::Distance { first, second, .. } => Some([first.base, second.base]),
            Kind::OnLine { line, follower, .. } => Some([line.base, follower.base]),
        })
    }

    /// Number of scalar equations.
    pub fn n_rows(&self) -> usize {
        self.rows
    }

    /// Forces of every constraint for given multipliers (`M u̇ + Gᵀ λ = f`).
    ///
    /// - `cache`: positions
    /// - `q`: coordinates
    pub fn forces(&self, cache: &Cache, q: &[f64], multipliers: &DVector<f64>) -> Vec<ConstraintForce> {
        let mut at = 0;
        let one = |(kind, constraint): (&Kind, &Option<usize>)| {
            let rows = &multipliers.as_slice()[at..at + kind.rows()];
            at += kind.rows();
            let (bodies, mobilities) = kind.forces(cache, q, rows);
            ConstraintForce { constraint: *constraint, bodies, mobilities }
        };
        self.kinds.iter().zip(&self.origins).map(one).collect()
    }

    /// Jacobian, right sides and violations.
    ///
    /// - `cache`: positions, joint axes, velocities of `u`, and accelerations of `u` with u̇ = `udot`
    /// - `qdot`: rates of the coordinates that belong to `u`
    /// - `udot`: rates of speeds beyond which the right sides of accelerations are wanted; `None`: 0
    #[allow(non_snake_case)]
    pub(super) fn rows(
        &self,
        model: &Model,
        time: f64,
        (q, qdot): (&[f64], &[f64]),
        udot: Option<&[f64]>,
        cache: &Cache,
    ) -> Rows {
        let n = model.n_coordinates();
        let mut rows = Rows {
            G: DMatrix::zeros(self.rows, n),
            v: DVector::zeros(self.rows),
            b: DVector::zeros(self.rows),
            error: DVector::zeros(self.rows),
        };
        let mut at = 0;
        for kind in &self.kinds {
            kind.fill(model, time, q, qdot, cache, at, &mut rows);
            if let Some(udot) = udot.filter(|_| !kind.joins_bodies()) {
                // Accelerations of bodies are in the cache, those of coordinates are not.
                rows.b[at] -= udot.iter().enumerate().map(|(c, udot)| rows.G[(at, c)] * udot).sum::<f64>();
            }
            at += kind.rows();
        }
        rows
    }
}

impl Kind {
    /// Forces on bodies and coordinates, −Gᵀ λ, for this constraint's multipliers.
    #[allow(non_snake_case)]
    fn forces(
        &self,
        cache: &Cache,
        q: &[f64],
        multipliers: &[f64],
    ) -> (Vec<(BaseIndex, SpatialForce)>, Vec<(CoordinateIndex, f64)>) {
        let place = |station: &Station| {
            let offset = cache.X_GB(station.base).R * station.p_BS;
            (offset, cache.X_GB(station.base).p + offset)
        };
        let between = |first: &Station, second: &Station, force: Vector3<f64>| {
            let on = |station: &Station, force: &Vector3<f64>| {
                (station.base, SpatialForce::from_force_at(&place(station).0, force))
            };
            vec![on(first, &force), on(second, &-force)]
        };
        // Both forces act where the second point is.
        let at_second = |first: &Station, second: &Station, force: Vector3<f64>| {
            let (offset, at) = place(second);
            let from_first = at - cache.X_GB(first.base).p;
            vec![
                (first.base, SpatialForce::from_force_at(&from_first, &force)),
                (second.base, SpatialForce::from_force_at(&offset, &-force)),
            ]
        };
        let vector = |from: usize| Vector3::new(multipliers[from], multipliers[from + 1], multipliers[from + 2]);
        match self {
            Kind::Coupler(coupler) => {
                let force = multipliers[0];
                let on_arguments = coupler.derivatives(q).map(|(argument, slope)| (argument, slope * force));
                (Vec::new(), on_arguments.chain([(coupler.dependent, -force)]).collect())
            }
            Kind::Locked { coordinate, .. } | Kind::Prescribed { coordinate, .. } => {
                (Vec::new(), vec![(*coordinate, -multipliers[0])])
            }
            Kind::Weld { first, second } => {
                let station = |(base, X): &(BaseIndex, Transform)| Station { base: *base, p_BS: X.p };
                let mut bodies = at_second(&station(first), &station(second), vector(3));
                let axes = weld_axes(cache, first, second);
                let moment = axes.iter().zip(multipliers).map(|(axis, m)| *m * axis.normal).sum::<Vector3<f64>>();
                bodies[0].1 += SpatialForce { moment, force: Vector3::zeros() };
                bodies[1].1 += SpatialForce { moment: -moment, force: Vector3::zeros() };
                (bodies, Vec::new())
            }
            Kind::Point { first, second } => (at_second(first, second, vector(0)), Vec::new()),
            Kind::Distance { first, second, .. } => {
                let along = place(second).1 - place(first).1;
                (between(first, second, multipliers[0] * along), Vec::new())
            }
            Kind::OnLine { line, across, follower } => {
                let R = cache.X_GB(line.base).R;
                let force = R * (multipliers[0] * across[0] + multipliers[1] * across[1]);
                let bodies = at_second(line, follower, force);
                (bodies, Vec::new())
            }
        }
    }

    #[allow(non_snake_case)]
    fn fill(&self, model: &Model, time: f64, q: &[f64], qdot: &[f64], cache: &Cache, at: usize, rows: &mut Rows) {
        match self {
            Kind::Coupler(coupler) => {
                let d = coupler.dependent;
                rows.error[at] = q[d.0] - coupler.value(q);
                rows.b[at] = coupler.second_rate_at_constant_rates(q, qdot);
                for (c, factor) in [(d, 1.0)].into_iter().chain(coupler.derivatives(q).map(|(i, slope)| (i, -slope))) {
                    model.add_rate_row(cache, c, factor, qdot, |c, g| rows.G[(at, c)] += g, |b| rows.b[at] -= b);
                }
            }
            Kind::Locked { coordinate, value } => {
                rows.error[at] = q[coordinate.0] - value;
                model.add_rate_row(cache, *coordinate, 1.0, qdot, |c, g| rows.G[(at, c)] += g, |b| rows.b[at] -= b);
            }
            Kind::Prescribed { coordinate, function } => {
                rows.error[at] = q[coordinate.0] - function.value(time);
                rows.v[at] = function.derivative(time);
                rows.b[at] = function.second_derivative(time);
                model.add_rate_row(cache, *coordinate, 1.0, qdot, |c, g| rows.G[(at, c)] += g, |b| rows.b[at] -= b);
            }
            Kind::Weld { first, second } => {
                let [w_first, w_second] = [first.0, second.0].map(|base| cache.V_GB(base).w);
                let w = w_second - w_first;
                let alpha = cache.A_GB(second.0).alpha - cache.A_GB(first.0).alpha;
                for (k, axis) in weld_axes(cache, first, second).iter().enumerate() {
                    rows.error[at + k] = axis.of_second.dot(&axis.of_first);
                    let turned = w_second.cross(&axis.of_second).cross(&axis.of_first)
                        - w_first.cross(&axis.of_first).cross(&axis.of_second);
                    rows.b[at + k] = -alpha.dot(&axis.normal) - w.dot(&turned);
                    for (base, sign) in [(second.0, 1.0), (first.0, -1.0)] {
                        model.for_each_partial_velocity(cache, base, |c, velocity| {
                            rows.G[(at + k, c)] += sign * velocity.w.dot(&axis.normal);
                        });
                    }
                }
                let (one, two) =
                    (Station { base: first.0, p_BS: first.1.p }, Station { base: second.0, p_BS: second.1.p });
                fill_point(model, cache, &one, &two, at + 3, rows);
            }
            Kind::Point { first, second } => fill_point(model, cache, first, second, at, rows),
            Kind::Distance { first, second, distance } => {
                let (one, two) = (first.motion(cache), second.motion(cache));
                let between = two.p - one.p;
                let relative = two.v - one.v;
                // ½ (d² − L²) and its derivative, then d d̈: where speeds lengthen the rod, OpenSim asks that they go
                // on to.
                rows.error[at] = 0.5 * (between.norm_squared() - distance * distance);
                let lengthening = between.dot(&relative).powi(2) / between.norm_squared().max(f64::MIN_POSITIVE);
                rows.b[at] = lengthening - between.dot(&(two.a - one.a)) - relative.norm_squared();
                for (station, sign) in [(second, 1.0), (first, -1.0)] {
                    station.for_each_velocity(model, cache, |c, v| rows.G[(at, c)] += sign * between.dot(&v));
                }
            }
            Kind::OnLine { line, across, follower } => {
                let R = cache.X_GB(line.base).R;
                let (from, to) = (line.motion(cache), follower.motion(cache));
                let w = cache.V_GB(line.base).w;
                let between = to.p - from.p;
                // Velocity and acceleration of the follower in the line's base.
                let carried = |velocity: &SpatialVelocity| velocity.v + velocity.w.cross(&between);
                let v = to.v - from.v - w.cross(&between);
                let A = cache.A_GB(line.base);
                let a = to.a - from.a - A.alpha.cross(&between) - w.cross(&w.cross(&between)) - 2.0 * w.cross(&v);
                for (k, direction) in across.iter().enumerate() {
                    let direction = R * direction;
                    rows.error[at + k] = direction.dot(&between);
                    rows.b[at + k] = -direction.dot(&a);
                    follower.for_each_velocity(model, cache, |c, v| rows.G[(at + k, c)] += direction.dot(&v));
                    let shift = from.p - cache.X_GB(line.base).p;
                    model.for_each_partial_velocity(cache, line.base, |c, velocity| {
                        rows.G[(at + k, c)] -= direction.dot(&carried(&velocity.shift(&shift)));
                    });
                }
            }
        }
    }
}

/// Two axes of welded frames that stand at right angles: one of each frame.
struct WeldAxes {
    of_first: Vector3<f64>,
    of_second: Vector3<f64>,
    /// Their product: turning the second frame about it changes the angle between them.
    normal: Vector3<f64>,
}

/// The three pairs of Simbody's `Weld`, expressed in ground.
fn weld_axes(cache: &Cache, first: &(BaseIndex, Transform), second: &(BaseIndex, Transform)) -> [WeldAxes; 3] {
    let axis = |(base, frame): &(BaseIndex, Transform), i: usize| cache.X_GB(*base).R * frame.R.column(i);
    [0, 1, 2].map(|k| {
        let (of_second, of_first) = (axis(second, k), axis(first, (k + 1) % 3));
        WeldAxes { of_first, of_second, normal: of_second.cross(&of_first) }
    })
}

/// Two points that coincide. As in Simbody, velocities and accelerations are those of the second point and of the point
/// of the first body that is in the same place, also where the first point is elsewhere.
fn fill_point(model: &Model, cache: &Cache, first: &Station, second: &Station, at: usize, rows: &mut Rows) {
    let between = second.motion(cache).p - first.motion(cache).p;
    let touched = Station { base: first.base, p_BS: first.p_BS + cache.X_GB(first.base).R.tr_mul(&between) };
    let (one, two) = (touched.motion(cache), second.motion(cache));
    for k in 0..3 {
        rows.error[at + k] = between[k];
        rows.b[at + k] = one.a[k] - two.a[k];
    }
    for (station, sign) in [(second, 1.0), (&touched, -1.0)] {
        station.for_each_velocity(model, cache, |c, v| (0..3).for_each(|k| rows.G[(at + k, c)] += sign * v[k]));
    }
}

/// Position, velocity and acceleration of a point in ground.
struct PointMotion {
    p: Vector3<f64>,
    v: Vector3<f64>,
    a: Vector3<f64>,
}

impl Station {
    fn motion(&self, cache: &Cache) -> PointMotion {
        let pose = cache.X_GB(self.base);
        let offset = pose.R * self.p_BS;
        let velocity = cache.V_GB(self.base);
        PointMotion {
            p: pose.p + offset,
            v: velocity.velocity_at(&offset),
            a: cache.A_GB(self.base).acceleration_at(&offset, &velocity.w),
        }
    }

    fn for_each_velocity(&self, model: &Model, cache: &Cache, mut visit: impl FnMut(usize, Vector3<f64>)) {
        let offset = cache.X_GB(self.base).R * self.p_BS;
        model.for_each_partial_velocity(cache, self.base, |c, velocity| visit(c, velocity.velocity_at(&offset)));
    }
}
