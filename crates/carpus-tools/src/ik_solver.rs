//! Coordinates that bring markers to where they were seen: weighted least squares under constraints.
//!
//! ```text
//! min ½ Σ wᵢ |pᵢ(q) − mᵢ|² / Σ wᵢ + ½ Σ wⱼ (qⱼ − cⱼ)²     with constraints φ(q) = 0 and clamped ranges
//! ```
//! as Simbody's `Assembler` weighs OpenSim's goals. Gauss–Newton with Levenberg's damping on exact Jacobians; steps
//! solve the constraints' linearization, and a coordinate that reaches its range stays there while it is pushed
//! outward.
//!
//! Constraints hold whatever `constraint_weight` a setup gives: the constructor of OpenSim 4.6's
//! `InverseKinematicsSolver` that its tool calls sets the weight to infinity, so that locked coordinates and couplers
//! are exact there, too.
//!
//! Searches end at the minimum. OpenSim's ends where its `accuracy` allows (1e-5 in inverse kinematics; 1e-4, which no
//! setup can change, in the static pose of a `ScaleTool`), with lumbar and arm angles up to some degrees from the
//! minimum on gait models; asked for 1e-9 it arrives here within 1e-7 rad.

use nalgebra::{DMatrix, DVector, Vector3};

use super::system::System;
use carpus_multibody::dynamics::Dynamics;
use carpus_multibody::multibody::BaseIndex;
use carpus_numerics::numerics::symmetric_eigen;
use carpus_osim::osim::spec::CoordinateIndex;

/// Most iterations of one frame.
const ITERATIONS: usize = 200;
/// Steps smaller than this end the search [rad or m].
const CONVERGED: f64 = 1e-9;
/// A step that is predicted to lower the cost by less than this share of it ends the search: near a minimum it is some
/// 1e-9 rad long, except along directions that no marker determines, where steps never become small.
const NO_GAIN: f64 = 1e-14;
/// Least damping over the largest curvature: along directions that no marker determines rounding of the gradient (some
/// 1e-17 of it) moves coordinates by no more than 1e-8 rad.
const LEAST_DAMPING: f64 = 1e-9;
/// Of two fits whose costs differ by less than this share the one that is nearer to where the search began is taken.
const EQUAL_FIT: f64 = 1e-6;
/// First dampings of a search from afar.
const BOLDNESS: [f64; 4] = [1.0, 1e-1, 1e-2, LEAST_DAMPING];
/// Iterations of the way back onto the constraints, each of which squares a small violation.
const PROJECTIONS: usize = 20;
/// Violation of constraints that counts as none [rad or m].
const SATISFIED: f64 = 1e-12;
/// Step of differences [rad or m].
const DIFFERENCE: f64 = 1e-6;

/// A marker to be brought somewhere.
#[derive(Clone, Debug)]
pub struct MarkerGoal {
    /// What it is fixed to.
    pub base: BaseIndex,
    /// Where in that [m].
    pub station: Vector3<f64>,
    /// Weight.
    pub weight: f64,
}

/// A coordinate to be brought to a value.
#[derive(Clone, Copy, Debug)]
pub struct CoordinateGoal {
    /// The coordinate.
    pub coordinate: CoordinateIndex,
    /// Weight.
    pub weight: f64,
}

/// Brings a model to observed markers and coordinates, frame after frame.
pub struct InverseKinematics<'a> {
    system: &'a System,
    dynamics: Dynamics<'a>,
    /// Markers.
    pub markers: Vec<MarkerGoal>,
    /// Coordinates.
    pub coordinates: Vec<CoordinateGoal>,
}

/// How far a [`Linearization`] goes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Order {
    Gradient,
    Hessian,
}

/// Residuals and their derivatives at one place; without `hessian` where only the gradient was asked for.
struct Linearization {
    cost: f64,
    gradient: DVector<f64>,
    hessian: DMatrix<f64>,
    violation: DVector<f64>,
    jacobian: DMatrix<f64>,
}

impl<'a> InverseKinematics<'a> {
    /// For a system, without goals.
    pub fn new(system: &'a System) -> Self {
        let dynamics = Dynamics::new(&system.model, &system.constraints);
        InverseKinematics { system, dynamics, markers: Vec::new(), coordinates: Vec::new() }
    }

    /// Where the markers are at coordinates.
    pub fn marker_places(&mut self, q: &[f64]) -> Vec<Vector3<f64>> {
        let zero = vec![0.0; q.len()];
        let cache = self.dynamics.update(q, &zero);
        self.markers.iter().map(|m| cache.X_GB(m.base) * m.station).collect()
    }

    fn linearize(
        &mut self,
        time: f64,
        q: &[f64],
        seen: &[Vector3<f64>],
        values: &[f64],
        order: Order,
    ) -> Linearization {
        let n = q.len();
        let (violation, jacobian) = self.dynamics.constraint_jacobian(time, q);
        let cache = self.dynamics.cache();
        let size = if order == Order::Hessian { n } else { 0 };
        let (mut gradient, mut hessian) = (DVector::zeros(n), DMatrix::zeros(size, size));
        let mut cost = 0.0;
        let is_seen = |p: &Vector3<f64>| p.iter().all(|x| x.is_finite());
        let total: f64 = self.markers.iter().zip(seen).filter(|(_, p)| is_seen(p)).map(|(m, _)| m.weight).sum();
        let mut columns: Vec<(usize, Vector3<f64>)> = Vec::with_capacity(n);
        for (marker, seen) in self.markers.iter().zip(seen).filter(|(m, p)| is_seen(p) && m.weight > 0.0) {
            let weight = marker.weight / total;
            let pose = cache.X_GB(marker.base);
            let offset = pose.R * marker.station;
            let residual = pose.p + offset - seen;
            cost += 0.5 * weight * residual.norm_squared();
            columns.clear();
            self.system.model.for_each_partial_velocity(cache, marker.base, |c, velocity| {
                columns.push((c, velocity.velocity_at(&offset)));
            });
            for (c, v) in &columns {
                gradient[*c] += weight * v.dot(&residual);
                if order == Order::Hessian {
                    for (d, w) in &columns {
                        hessian[(*c, *d)] += weight * v.dot(w);
                    }
                }
            }
        }
        for (goal, value) in self.coordinates.iter().zip(values) {
            let c = goal.coordinate.0;
            cost += 0.5 * goal.weight * (q[c] - value).powi(2);
            gradient[c] += goal.weight * (q[c] - value);
            if order == Order::Hessian {
                hessian[(c, c)] += goal.weight;
            }
        }
        Linearization { cost, gradient, hessian, violation, jacobian }
    }

    /// Cost at coordinates.
    fn cost(&mut self, q: &[f64], seen: &[Vector3<f64>], values: &[f64]) -> f64 {
        let cache = self.dynamics.update_positions(q);
        let seen_markers = || {
            let pairs = self.markers.iter().zip(seen);
            pairs.filter(|(_, p)| p.iter().all(|x| x.is_finite()))
        };
        let total: f64 = seen_markers().map(|(m, _)| m.weight).sum();
        let squared = |m: &MarkerGoal, p: &Vector3<f64>| (cache.X_GB(m.base) * m.station - p).norm_squared();
        let of_markers = seen_markers().filter(|(m, _)| m.weight > 0.0).map(|(m, p)| m.weight / total * squared(m, p));
        let of_coordinates = self
            .coordinates
            .iter()
            .zip(values)
            .map(|(goal, value)| goal.weight * (q[goal.coordinate.0] - value).powi(2));
        0.5 * (of_markers.sum::<f64>() + of_coordinates.sum::<f64>())
    }

    /// Moves coordinates back onto the constraints, by as little as the linearization asks for; returns the violation
    /// that is left [rad or m].
    fn project(&mut self, time: f64, q: &mut [f64]) -> f64 {
        let mut left = 0.0;
        for _ in 0..PROJECTIONS {
            let (violation, jacobian) = self.dynamics.constraint_jacobian(time, q);
            left = if violation.is_empty() { 0.0 } else { violation.amax() };
            if !(left > SATISFIED) {
                return left;
            }
            let mut gram = &jacobian * jacobian.transpose();
            // Redundant constraints leave their multipliers open.
            let slack = 1e-13 * gram.diagonal().amax();
            (0..gram.nrows()).for_each(|k| gram[(k, k)] += slack);
            let Some(factors) = gram.cholesky() else { break };
            let step = -jacobian.tr_mul(&factors.solve(&violation));
            let shorten = 1.0 / (step.amax() / 0.5).max(1.0);
            let rates = self.along(q, &step);
            q.iter_mut().zip(&rates).for_each(|(q, rate)| *q += shorten * rate);
        }
        left
    }

    /// Second derivative of the Lagrangian by differences of its gradient along speeds, with the absolute values of its
    /// curvatures: steps lead down from saddles and maxima, to which they would lead else.
    ///
    /// - `at`: the gradient at `q`
    fn curvature(
        &mut self,
        time: f64,
        q: &[f64],
        seen: &[Vector3<f64>],
        values: &[f64],
        (at, multipliers): (&Linearization, &DVector<f64>),
    ) -> DMatrix<f64> {
        let n = q.len();
        let lagrangian = |at: &Linearization| match multipliers.is_empty() {
            true => at.gradient.clone(),
            false => &at.gradient + at.jacobian.tr_mul(multipliers),
        };
        let here = lagrangian(at);
        let mut matrix = DMatrix::zeros(n, n);
        let mut moved = q.to_vec();
        // What is locked does not move: its curvature plays no part.
        for j in (0..n).filter(|j| !self.system.model.coordinates[*j].locked) {
            moved[j] = q[j] + DIFFERENCE;
            let there = lagrangian(&self.linearize(time, &moved, seen, values, Order::Gradient));
            moved[j] = q[j];
            matrix.column_mut(j).copy_from(&((there - &here) / DIFFERENCE));
        }
        let eigen = symmetric_eigen(0.5 * (&matrix + matrix.transpose()));
        let scaled = &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.abs());
        scaled * eigen.eigenvectors.transpose()
    }

    /// Rates of coordinates for a step along speeds, at `q`.
    fn along(&mut self, q: &[f64], step: &DVector<f64>) -> Vec<f64> {
        if self.system.model.speeds_are_rates() {
            return step.iter().copied().collect();
        }
        let zero = vec![0.0; q.len()];
        self.dynamics.update(q, &zero);
        let mut rates = zero;
        self.system.model.rates_of_speeds(self.dynamics.cache(), step.as_slice(), &mut rates);
        rates
    }

    /// Changes `q` so that it fits best, from far away: searches with steps of different boldness, from `q` and from
    /// the middle of the ranges; the best fit is taken, without whole turns.
    ///
    /// Arguments and result as [`InverseKinematics::solve`].
    pub fn solve_from_afar(&mut self, time: f64, q: &mut [f64], seen: &[Vector3<f64>], values: &[f64]) -> bool {
        let mut middle = q.to_vec();
        for (q, c) in middle.iter_mut().zip(&self.system.model.coordinates) {
            let [low, high] = c.range;
            if c.clamped && !c.locked && high - low < 7.0 {
                *q = 0.5 * (low + high);
            }
        }
        self.system.model.satisfy_couplers(&mut middle);
        let mut best: Option<(f64, bool, Vec<f64>)> = None;
        let from = q.to_vec();
        let distance = |to: &[f64]| to.iter().zip(&from).map(|(to, from)| (to - from).powi(2)).sum::<f64>();
        for start in [q.to_vec(), middle] {
            for damping in BOLDNESS {
                let mut found = start.clone();
                let converged = self.search(time, &mut found, seen, values, damping);
                self.without_turns(time, &mut found, seen, values);
                let violation = self.project(time, &mut found.clone());
                let cost = self.cost(&found, seen, values);
                let better = best.as_ref().is_none_or(|(least, _, other)| {
                    let near = cost < least * (1.0 + EQUAL_FIT);
                    cost < least * (1.0 - EQUAL_FIT) || (near && distance(&found) < distance(other) - EQUAL_FIT)
                });
                if violation < 1e-8 && better {
                    best = Some((cost, converged, found));
                }
            }
        }
        let Some((_, converged, found)) = best else { return false };
        q.copy_from_slice(&found);
        // From near the minimum the search ends where it was only slow before.
        converged || self.search(time, q, seen, values, LEAST_DAMPING)
    }

    /// Takes whole turns off coordinates beyond half a turn, where the fit and the constraints stay what they are.
    fn without_turns(&mut self, time: f64, q: &mut [f64], seen: &[Vector3<f64>], values: &[f64]) {
        const TURN: f64 = std::f64::consts::TAU;
        let before = self.cost(q, seen, values);
        for i in 0..q.len() {
            let turns = (q[i] / TURN).round();
            if turns == 0.0 || !self.system.is_angle(i) {
                continue;
            }
            let with = q[i];
            q[i] -= turns * TURN;
            let same = (self.cost(q, seen, values) - before).abs() <= 1e-9 * before + 1e-15;
            let (violation, _) = self.dynamics.constraint_jacobian(time, q);
            if !same || violation.iter().any(|v| v.abs() > 1e-9) {
                q[i] = with;
            }
        }
    }

    /// Changes `q` so that it fits best.
    ///
    /// - `seen`: where each marker was seen [m]; NaN: not
    /// - `values`: wanted value of each coordinate goal
    ///
    /// Returns whether the search converged.
    pub fn solve(&mut self, time: f64, q: &mut [f64], seen: &[Vector3<f64>], values: &[f64]) -> bool {
        self.search(time, q, seen, values, LEAST_DAMPING)
    }

    fn search(&mut self, time: f64, q: &mut [f64], seen: &[Vector3<f64>], values: &[f64], mut damping: f64) -> bool {
        let n = q.len();
        let ranges: Vec<Option<[f64; 2]>> =
            self.system.model.coordinates.iter().map(|c| c.clamped.then_some(c.range)).collect();
        for (q, range) in q.iter_mut().zip(&ranges) {
            if let Some([low, high]) = range {
                *q = q.clamp(low.min(*high), high.max(*low));
            }
        }
        self.project(time, q);
        let mut multipliers = DVector::zeros(0);
        // Gauss-Newton first; where it gets slow, the true curvature.
        let (mut last_size, mut slow) = (f64::INFINITY, 0);
        for _ in 0..ITERATIONS {
            let mut at = self.linearize(time, q, seen, values, Order::Hessian);
            let violation = if at.violation.is_empty() { 0.0 } else { at.violation.amax() };
            let scale = at.hessian.diagonal().amax().max(1e-12);
            if slow >= 2 && violation < 1e-6 {
                at.hessian = self.curvature(time, q, seen, values, (&at, &multipliers));
            }
            // Coordinates at their range that the step would push outward are held; found by solving again.
            let mut held = vec![false; n];
            let (step, rates) = loop {
                let Some((step, forces)) = solve_step(&at, damping * scale, scale, &held) else { return false };
                multipliers = forces;
                let rates = self.along(q, &step);
                let outward = |i: usize| {
                    ranges[i].is_some_and(|[low, high]| {
                        (q[i] <= low && rates[i] < -1e-14) || (q[i] >= high && rates[i] > 1e-14)
                    })
                };
                let new: Vec<usize> = (0..n).filter(|&i| !held[i] && outward(i)).collect();
                if new.is_empty() {
                    break (step, rates);
                }
                new.into_iter().for_each(|i| held[i] = true);
            };
            let size = step.amax();
            if !size.is_finite() {
                return false;
            }
            let gain = -(at.gradient.dot(&step) + 0.5 * step.dot(&(&at.hessian * &step)));
            let is_least = size < CONVERGED || gain.abs() <= NO_GAIN * at.cost;
            if is_least && violation < 1e-10 {
                return true;
            }
            slow = if size > 0.3 * last_size { slow + 1 } else { slow };
            last_size = size;
            // No step turns a joint by more than half a radian; none leaves a range.
            let mut share = (0.5 / size).min(1.0);
            for i in 0..n {
                if let Some([low, high]) = ranges[i] {
                    let target = q[i] + share * rates[i];
                    if target < low && rates[i] < 0.0 {
                        share = share.min(((low - q[i]) / rates[i]).max(0.0));
                    } else if target > high && rates[i] > 0.0 {
                        share = share.min(((high - q[i]) / rates[i]).max(0.0));
                    }
                }
            }
            let mut moved: Vec<f64> = q.iter().zip(&rates).map(|(q, s)| q + share * s).collect();
            for (q, range) in moved.iter_mut().zip(&ranges) {
                if let Some([low, high]) = range {
                    *q = q.clamp(*low, *high);
                }
            }
            // Back onto the constraints, so that costs can be compared.
            let kept = moved.clone();
            let mut left = self.project(time, &mut moved);
            let out = |i: usize| ranges[i].is_some_and(|[low, high]| moved[i] < low - 1e-9 || moved[i] > high + 1e-9);
            if left > 1e-9 || (0..n).any(out) {
                let (violation, _) = self.dynamics.constraint_jacobian(time, &kept);
                left = if violation.is_empty() { 0.0 } else { violation.amax() };
                moved = kept;
            }
            let cost = self.cost(&moved, seen, values);
            // Far from the constraints only they count.
            let better = cost <= at.cost * (1.0 + 1e-13) + 1e-20 || (left < 0.5 * violation && violation > 1e-8);
            if better {
                q.copy_from_slice(&moved);
                damping = (damping * 0.1).max(LEAST_DAMPING);
            } else {
                damping *= 10.0;
                if damping > 1e4 {
                    return violation < 1e-8 && size < 1e-5;
                }
            }
        }
        false
    }
}

/// The step of the linearized problem, and the constraints' multipliers.
fn solve_step(at: &Linearization, damping: f64, scale: f64, held: &[bool]) -> Option<(DVector<f64>, DVector<f64>)> {
    let (n, m) = (at.gradient.len(), at.violation.len());
    let mut matrix = DMatrix::zeros(n + m, n + m);
    let mut right = DVector::zeros(n + m);
    matrix.view_mut((0, 0), (n, n)).copy_from(&at.hessian);
    for i in 0..n {
        matrix[(i, i)] += damping;
        right[i] = -at.gradient[i];
    }
    for k in 0..m {
        for i in 0..n {
            matrix[(n + k, i)] = at.jacobian[(k, i)] * scale;
            matrix[(i, n + k)] = at.jacobian[(k, i)] * scale;
        }
        // Redundant constraints leave their multipliers open.
        matrix[(n + k, n + k)] = -1e-10 * scale;
        right[n + k] = -at.violation[k] * scale;
    }
    for i in (0..n).filter(|i| held[*i]) {
        matrix.row_mut(i).fill(0.0);
        matrix.column_mut(i).fill(0.0);
        matrix[(i, i)] = scale;
        right[i] = 0.0;
    }
    let solved = matrix.lu().solve(&right)?;
    Some((solved.rows(0, n).into_owned(), solved.rows(n, m) * scale))
}
