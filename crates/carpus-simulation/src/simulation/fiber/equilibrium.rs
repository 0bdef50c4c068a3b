//! Where a fibre starts: the equilibrium of fibre and tendon, at rest or with a share of the path's speed.

use super::equation::{Drive, Fiber, FiberCurves, PARAMETERS};
use super::law::of_law;
use carpus_multibody::muscles::{Contraction, MuscleLaw, Start};
use std::sync::Arc;

/// Most iterations of a starting velocity that depends on the length it leads to, and where they end.
const MOST_ITERATIONS: usize = 60;
const START_TOLERANCE: f64 = 1e-14;
/// Relative step of differences of the start, which is solved to rounding.
const STEP: f64 = 1e-5;

impl Fiber {
    /// Normalized fibre length from which OpenSim's `equilibrateMuscles` lets the class start, and whether the fibre
    /// rests at its shortest length.
    ///
    /// - `speed`: of the path [m/s]; classes that start at rest do not look at it
    ///
    /// # References
    /// OpenSim `Thelen2003Muscle::initMuscleState`, `DeGrooteFregly2016Muscle::computeInitialFiberEquilibrium`.
    pub(crate) fn start(&self, drive: Drive, speed: f64) -> (f64, bool) {
        if self.starts_at_rest(speed) {
            return self.static_equilibrium(drive);
        }
        // What the fibre's velocity adds to its force, at the length before.
        let mut moving = 0.0;
        let mut found = self.equilibrium_with(drive, moving);
        for _ in 0..MOST_ITERATIONS {
            let before = found.0;
            moving = self.force_of_moving(before, drive, speed, moving);
            found = self.equilibrium_with(drive, moving);
            if (found.0 - before).abs() < START_TOLERANCE {
                break;
            }
        }
        found
    }

    /// Whether it starts at rest.
    ///
    /// - `speed`: of the path [m/s]
    pub(crate) fn starts_at_rest(&self, speed: f64) -> bool {
        speed == 0.0 || self.curves.law.start() == Start::AtRest
    }

    /// Derivatives of [`Fiber::start`] by the parameters.
    ///
    /// - `x`, `at_limit`: what it found
    pub(crate) fn start_by_parameters(&self, x: f64, at_limit: bool, drive: Drive, speed: f64) -> [f64; PARAMETERS] {
        if at_limit {
            return self.shortest_by_parameters();
        }
        if self.starts_at_rest(speed) {
            let by_x = self.static_residual(x, drive)[1];
            return self.static_residual_by_parameters(x, drive).map(|by_p| -by_p / by_x);
        }
        let own = [self.optimal, self.slack, self.sine];
        [0, 1, 2].map(|p| {
            if own[p] == 0.0 {
                // Only its square matters.
                return 0.0;
            }
            let moved = |sign: f64| {
                let mut to = own;
                to[p] *= 1.0 + sign * STEP;
                Fiber::new(Arc::clone(&self.curves), to[0], to[1], to[2].asin()).start(drive, speed).0
            };
            (moved(1.0) - moved(-1.0)) / (2.0 * STEP * own[p])
        })
    }

    /// What a fibre that moves with the path bears more than one at rest, over maximum isometric force.
    ///
    /// - `moving`: the same at the length before, from which stiffnesses are taken
    fn force_of_moving(&self, x: f64, drive: Drive, speed: f64, moving: f64) -> f64 {
        let c = &*self.curves;
        of_law!(&c.law, law => {
            let y = self.along_tendon(x);
            let (active, passive) = (c.active_at(law, x, drive.activation), law.passive(x));
            let norm_tendon = (drive.length - self.optimal * y) / self.slack;
            let (tendon, tendon_slope) = law.tendon(norm_tendon);
            let (cosine, secant) = (y / x, x / y);
            let isometric = drive.activation * active.0;
            let share = match law.start() {
                Start::AtRest => 0.0,
                Start::TakesSpeed => 1.0,
                Start::SharesSpeed => {
                    let multiplier = 1.0 + moving / isometric;
                    let fiber = isometric + passive.0 + moving;
                    let by_x = (drive.activation * multiplier * active.1 + passive.1) * cosine
                        + fiber * self.sine * self.sine / (x * x * y);
                    let (of_fiber, of_tendon) = (by_x * cosine / self.optimal, tendon_slope / self.slack);
                    let of_both = of_fiber + of_tendon;
                    if norm_tendon > 1.0 && of_both != 0.0 { of_tendon / of_both } else { 0.0 }
                }
            };
            let u = share * speed * cosine / (self.optimal * c.max_velocity);
            let at = Contraction { u, activation: drive.activation, active, passive, cosine, secant, tendon };
            law.fiber_force(&at)[0] - isometric - passive.0
        })
    }

    /// Normalized fibre length in static equilibrium, and whether the fibre rests at its shortest length.
    ///
    /// Starts, like `Millard2012EquilibriumMuscle::computeFiberEquilibrium`, from a tendon stretched by 1 % and follows
    /// Newton's method with step halving; where that stagnates, bisection between the shortest fibre and the longest
    /// one that leaves the tendon slack finds the equilibrium.
    pub(crate) fn static_equilibrium(&self, drive: Drive) -> (f64, bool) {
        self.equilibrium_with(drive, 0.0)
    }

    /// As [`Fiber::static_equilibrium`] of a fibre that bears `moving` more, over maximum isometric force.
    fn equilibrium_with(&self, drive: Drive, moving: f64) -> (f64, bool) {
        let along = (drive.length - 1.01 * self.slack) / self.optimal;
        let start = (along.max(0.0).powi(2) + self.sine * self.sine).sqrt().max(self.shortest);
        let at = |x: f64| self.residual_with(x, drive, moving);
        let (mut x, mut residual) = (start, at(start));
        for _ in 0..100 {
            if residual[0].abs() < 1e-14 {
                return (x, false);
            }
            let mut step = -residual[0] / residual[1];
            let mut improved = false;
            for _ in 0..30 {
                let next = (x + step).max(self.shortest);
                let trial = at(next);
                if trial[0].abs() < residual[0].abs() {
                    improved = next != x;
                    (x, residual) = (next, trial);
                    break;
                }
                step *= 0.5;
            }
            if !improved {
                break;
            }
        }
        if residual[0].abs() < 1e-11 {
            return (x, false);
        }
        if at(self.shortest)[0] >= 0.0 {
            return (self.shortest, true);
        }
        let (mut low, mut high) = (self.shortest, start.max(1.0));
        while at(high)[0] < 0.0 {
            high *= 2.0;
        }
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if at(middle)[0] < 0.0 { low = middle } else { high = middle }
        }
        (0.5 * (low + high), false)
    }

    /// Static force difference (f_V = 1, no damping force) and its derivative by x.
    pub(crate) fn static_residual(&self, x: f64, drive: Drive) -> [f64; 2] {
        self.residual_with(x, drive, 0.0)
    }

    fn residual_with(&self, x: f64, drive: Drive, moving: f64) -> [f64; 2] {
        let ((active, active_slope), (passive, passive_slope)) = self.fiber_at(x, drive.activation);
        let y = self.along_tendon(x);
        let fiber = drive.activation * active + passive + moving;
        let tendon = self.tendon_force(x, drive.length);
        let by_x = (drive.activation * active_slope + passive_slope) * y / x
            + fiber * self.sine * self.sine / (x * x * y)
            - tendon.by_x;
        [fiber * y / x - tendon.value, by_x]
    }

    /// Active and passive force multiplier with their slopes.
    fn fiber_at(&self, x: f64, activation: f64) -> ((f64, f64), (f64, f64)) {
        let c: &FiberCurves = &self.curves;
        of_law!(&c.law, law => (c.active_at(law, x, activation), law.passive(x)))
    }

    /// ∂(static residual)/∂p at fixed x.
    pub(crate) fn static_residual_by_parameters(&self, x: f64, drive: Drive) -> [f64; PARAMETERS] {
        let ((active, _), (passive, _)) = self.fiber_at(x, drive.activation);
        let fiber = drive.activation * active + passive;
        let mut by = self.tendon_force(x, drive.length).by_parameters.map(|d| -d);
        by[2] -= fiber * self.sine / (x * self.along_tendon(x));
        by
    }
}
