//! The force equilibrium of a muscle, in normalized quantities, with all its first derivatives.

use std::sync::Arc;

use super::curve_table::CurveTable;

/// Muscle parameters that derivatives are taken for, in the order of every derivative array of this module:
/// optimal fibre length, tendon slack length, sine of the pennation angle at optimal fibre length.
pub(crate) const PARAMETERS: usize = 3;

/// The tabulated curves of a muscle; shared by all candidate parameter sets.
#[derive(Clone, Debug)]
pub(crate) struct FiberCurves {
    /// Active force–length.
    pub(crate) active: Arc<CurveTable>,
    /// Passive fibre force–length.
    pub(crate) passive: Arc<CurveTable>,
    /// Force–velocity.
    pub(crate) force_velocity: Arc<CurveTable>,
    /// Tendon force–length.
    pub(crate) tendon: Arc<CurveTable>,
    /// Velocity as a function of the force multiplier: only for a muscle without fibre damping.
    pub(crate) velocity_of_force: Option<Arc<CurveTable>>,
    /// Fibre damping β; 0 for the undamped model.
    pub(crate) damping: f64,
    /// Maximum contraction velocity [optimal fibre lengths/s].
    pub(crate) max_velocity: f64,
    /// Shortest normalized fibre length of the active force–length curve.
    pub(crate) min_active_length: f64,
    /// Sine of the maximum pennation angle.
    pub(crate) sine_max_pennation: f64,
    /// λ: the active force–length curve is read at x/(1 + λ (1 − a)).
    pub(crate) length_by_activation: f64,
}

impl FiberCurves {
    /// Whether the two give the same numbers, because they share their tables.
    pub(crate) fn are_same(&self, other: &FiberCurves) -> bool {
        let tables = |c: &FiberCurves| [&c.active, &c.passive, &c.force_velocity, &c.tendon].map(Arc::as_ptr);
        let inverse = |c: &FiberCurves| c.velocity_of_force.as_ref().map(Arc::as_ptr);
        let numbers = |c: &FiberCurves| {
            [c.damping, c.max_velocity, c.min_active_length, c.sine_max_pennation, c.length_by_activation]
        };
        tables(self) == tables(other) && inverse(self) == inverse(other) && numbers(self) == numbers(other)
    }

    /// Active force multiplier at a normalized fibre length and activation, and its slope by the length.
    #[inline(always)]
    pub(crate) fn active_at(&self, x: f64, activation: f64) -> (f64, f64) {
        if self.length_by_activation == 0.0 {
            return self.active.value_and_slope(x);
        }
        let optimum = 1.0 + self.length_by_activation * (1.0 - activation);
        let (value, slope) = self.active.value_and_slope(x / optimum);
        (value, slope / optimum)
    }
}

/// One muscle with one set of parameters.
#[derive(Clone, Debug)]
pub(crate) struct Fiber {
    pub(crate) curves: Arc<FiberCurves>,
    /// Optimal fibre length [m].
    pub(crate) optimal: f64,
    /// Tendon slack length [m].
    pub(crate) slack: f64,
    /// Its reciprocal [1/m].
    inverse_slack: f64,
    /// Sine s of the pennation angle at optimal fibre length.
    pub(crate) sine: f64,
    /// Shortest normalized fibre length x_min.
    pub(crate) shortest: f64,
    /// dx_min/ds.
    shortest_by_sine: f64,
}

/// What drives a fibre at one instant.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Drive {
    /// Activation.
    pub(crate) activation: f64,
    /// Path length [m].
    pub(crate) length: f64,
}

/// Residual of the equilibrium and its derivatives by state and rate.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Residual {
    /// R.
    pub(crate) r: f64,
    /// ∂R/∂x.
    pub(crate) by_x: f64,
    /// ∂R/∂u, positive.
    pub(crate) by_u: f64,
}

/// What of the equilibrium a fibre's length and velocity decide, whatever drives it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Undriven {
    /// Normalized fibre length, at least the shortest.
    x: f64,
    /// Fibre velocity over maximum contraction velocity.
    u: f64,
    /// Length along the tendon, over optimal fibre length.
    y: f64,
    /// Active force multiplier; that of full activation where it depends on activation.
    active: f64,
    passive: f64,
    /// Force–velocity multiplier; 1 for the muscle without damping, which inverts the curve.
    velocity: f64,
}

/// Tendon force over maximum isometric force, and its derivatives.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TendonForce {
    /// Normalized tendon force.
    pub(crate) value: f64,
    /// By normalized fibre length.
    pub(crate) by_x: f64,
    /// By the parameters, at fixed normalized fibre length.
    pub(crate) by_parameters: [f64; PARAMETERS],
}

impl Fiber {
    /// A muscle with the given parameters.
    ///
    /// - `optimal`, `slack`: optimal fibre length and tendon slack length [m]
    /// - `pennation`: pennation angle at optimal fibre length [rad]
    pub(crate) fn new(curves: Arc<FiberCurves>, optimal: f64, slack: f64, pennation: f64) -> Fiber {
        let sine = if pennation > f64::EPSILON { pennation.sin() } else { 0.0 };
        // As OpenSim: the parallelogram's height at the maximum pennation angle, or 1 % of the optimal length.
        let significant = f64::EPSILON.powf(0.875);
        let (pennate, pennate_by_sine) = if curves.sine_max_pennation > significant {
            (sine / curves.sine_max_pennation, 1.0 / curves.sine_max_pennation)
        } else {
            (0.01, 0.0)
        };
        let active = curves.min_active_length.max(significant / optimal);
        let (shortest, shortest_by_sine) = if pennate > active { (pennate, pennate_by_sine) } else { (active, 0.0) };
        Fiber { curves, optimal, slack, inverse_slack: 1.0 / slack, sine, shortest, shortest_by_sine }
    }

    /// Whether the two give the same numbers.
    pub(crate) fn is_same(&self, other: &Fiber) -> bool {
        self.curves.are_same(&other.curves)
            && [self.optimal, self.slack, self.sine] == [other.optimal, other.slack, other.sine]
    }

    /// dx_min/dp.
    pub(crate) fn shortest_by_parameters(&self) -> [f64; PARAMETERS] {
        [0.0, 0.0, self.shortest_by_sine]
    }

    /// y = x·cos φ: normalized fibre length along the tendon, of a fibre that keeps its height.
    #[inline]
    pub(crate) fn along_tendon(&self, x: f64) -> f64 {
        if self.sine == 0.0 { x } else { (x * x - self.sine * self.sine).sqrt() }
    }

    /// R(x, u), the difference between fibre and tendon force along the tendon over maximum isometric force:
    ///
    /// ```text
    /// R = (a·f_L(x)·f_V(u) + f_PE(x) + β u) cos φ − f_T((l_MT − l_opt x cos φ)/l_slack)          damped
    /// R = u − f_V⁻¹((f_T/cos φ − f_PE(x)) / (a f_L(x)))                                        undamped
    /// ```
    /// - `x`: fibre length over optimal length; below x_min the fibre is taken at x_min, as OpenSim clamps it
    /// - `u`: fibre velocity over maximum contraction velocity
    ///
    /// # References
    /// Millard et al. (2013), equations 6 and 8, doi:10.1115/1.4023390.
    pub(crate) fn residual(&self, x: f64, u: f64, drive: Drive) -> Residual {
        self.residual_inline(x, u, drive)
    }

    /// [`Fiber::residual`], for the innermost loop.
    #[inline(always)]
    pub(crate) fn residual_inline(&self, x: f64, u: f64, drive: Drive) -> Residual {
        let clamped = x < self.shortest;
        let x = if clamped { self.shortest } else { x };
        let c = &*self.curves;
        let (active, active_slope) = c.active_at(x, drive.activation);
        let (passive, passive_slope) = c.passive.value_and_slope(x);
        let y = self.along_tendon(x);
        let (inverse_x, inverse_y) = (1.0 / x, 1.0 / y);
        let (cosine, y_by_x) = (y * inverse_x, x * inverse_y);
        let inverse_slack = self.inverse_slack;
        let (tendon, tendon_slope) = c.tendon.value_and_slope((drive.length - self.optimal * y) * inverse_slack);
        let tendon_by_x = -tendon_slope * self.optimal * inverse_slack * y_by_x;
        let cosine_by_x = self.sine * self.sine * inverse_x * inverse_x * inverse_y;
        let a = drive.activation;
        let mut residual = match &c.velocity_of_force {
            None => {
                let (velocity, velocity_slope) = c.force_velocity.value_and_slope(u);
                let fiber = a * active * velocity + passive + c.damping * u;
                Residual {
                    r: fiber * cosine - tendon,
                    by_x: (a * active_slope * velocity + passive_slope) * cosine + fiber * cosine_by_x - tendon_by_x,
                    by_u: (a * active * velocity_slope + c.damping) * cosine,
                }
            }
            Some(inverse) => {
                let available = 1.0 / (a * active);
                let multiplier = (tendon * y_by_x - passive) * available;
                let (velocity, slope) = inverse.value_and_slope(multiplier);
                let multiplier_by_x = (tendon_by_x * y_by_x
                    - tendon * cosine_by_x * y_by_x * y_by_x
                    - passive_slope
                    - multiplier * a * active_slope)
                    * available;
                Residual { r: u - velocity, by_x: -slope * multiplier_by_x, by_u: 1.0 }
            }
        };
        if clamped {
            residual.by_x = 0.0;
        }
        residual
    }

    /// What R(x, u) needs before it is known what drives the fibre.
    ///
    /// - `x`, `u`: as for [`Fiber::residual`]
    pub(crate) fn undriven(&self, x: f64, u: f64) -> Undriven {
        let x = if x < self.shortest { self.shortest } else { x };
        let c = &*self.curves;
        let velocity = if c.velocity_of_force.is_none() { c.force_velocity.value_and_slope(u).0 } else { 1.0 };
        let passive = c.passive.value_and_slope(x).0;
        Undriven { x, u, y: self.along_tendon(x), active: c.active_at(x, 1.0).0, passive, velocity }
    }

    /// Normalized tendon force, as R takes it.
    ///
    /// - `length`: of the path [m]
    #[inline]
    pub(crate) fn pull(&self, known: &Undriven, length: f64) -> f64 {
        self.curves.tendon.value_and_slope((length - self.optimal * known.y) * self.inverse_slack).0
    }

    /// R without its derivatives: the same number, to the last bit, as [`Fiber::residual`] gives.
    ///
    /// - `pull`: of the tendon, from [`Fiber::pull`]
    #[inline]
    pub(crate) fn imbalance(&self, known: &Undriven, activation: f64, pull: f64) -> f64 {
        let Undriven { x, u, y, active, passive, velocity } = *known;
        let c = &*self.curves;
        let active = if c.length_by_activation == 0.0 { active } else { c.active_at(x, activation).0 };
        match &c.velocity_of_force {
            None => (activation * active * velocity + passive + c.damping * u) * (y * (1.0 / x)) - pull,
            Some(inverse) => {
                let available = 1.0 / (activation * active);
                u - inverse.value_and_slope((pull * (x * (1.0 / y)) - passive) * available).0
            }
        }
    }

    /// ∂R/∂p at fixed x, u, activation and path length.
    #[inline]
    pub(crate) fn residual_by_parameters(&self, x: f64, u: f64, drive: Drive) -> [f64; PARAMETERS] {
        let clamped = x < self.shortest;
        let x = if clamped { self.shortest } else { x };
        let c = &*self.curves;
        let y = self.along_tendon(x);
        let cosine = y / x;
        let cosine_by_sine = -self.sine / (x * y);
        let tendon = self.tendon_force(x, drive.length);
        let (active, _) = c.active_at(x, drive.activation);
        let (passive, _) = c.passive.value_and_slope(x);
        let a = drive.activation;
        let mut by = match &c.velocity_of_force {
            None => {
                let (velocity, _) = c.force_velocity.value_and_slope(u);
                let fiber = a * active * velocity + passive + c.damping * u;
                let mut by = tendon.by_parameters.map(|d| -d);
                by[2] += fiber * cosine_by_sine;
                by
            }
            Some(inverse) => {
                let available = 1.0 / (a * active);
                let (_, slope) = inverse.value_and_slope((tendon.value / cosine - passive) * available);
                let mut by = tendon.by_parameters.map(|d| d / cosine);
                by[2] -= tendon.value * cosine_by_sine / (cosine * cosine);
                by.map(|d| -slope * available * d)
            }
        };
        if clamped {
            let at_limit = self.residual(self.shortest, u, drive);
            by[2] += at_limit.by_x * self.shortest_by_sine;
        }
        by
    }

    /// Normalized tendon force of a fibre of normalized length `x` (taken at x_min if shorter) in a muscle of the given
    /// path length.
    #[inline]
    pub(crate) fn tendon_force(&self, x: f64, length: f64) -> TendonForce {
        let x = x.max(self.shortest);
        let y = self.along_tendon(x);
        let inverse_slack = self.inverse_slack;
        let stretch = (length - self.optimal * y) * inverse_slack;
        let (value, slope) = self.curves.tendon.value_and_slope(stretch);
        let scale = slope * inverse_slack;
        TendonForce {
            value,
            by_x: -scale * self.optimal * x / y,
            by_parameters: [-scale * y, -scale * stretch, scale * self.optimal * self.sine / y],
        }
    }

    /// Normalized fibre velocity u at which fibre and tendon force agree: the state's rate is `max_velocity`·u.
    ///
    /// Newton's method within a bracket; R increases with u, so the solution is unique.
    pub(crate) fn velocity(&self, x: f64, drive: Drive, guess: f64) -> f64 {
        if self.curves.velocity_of_force.is_some() {
            return -self.residual(x, 0.0, drive).r;
        }
        let mut u = guess.clamp(-1.0, 1.0);
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for _ in 0..100 {
            let residual = self.residual(x, u, drive);
            if residual.r > 0.0 {
                high = u
            } else {
                low = u
            }
            let newton = u - residual.r / residual.by_u;
            let middle = 0.5 * (low + high);
            // Before both ends of the bracket are known, only Newton's step is there.
            let next = if newton >= low && newton <= high || !middle.is_finite() { newton } else { middle };
            let change = (next - u).abs();
            u = next;
            if change < 1e-14 * (1.0 + u.abs()) {
                break;
            }
        }
        u
    }

    /// Normalized fibre length in static equilibrium, and whether the fibre rests at its shortest length.
    ///
    /// Starts, like `Millard2012EquilibriumMuscle::computeFiberEquilibrium`, from a tendon stretched by 1 % and follows
    /// Newton's method with step halving; where that stagnates, bisection between the shortest fibre and the longest
    /// one that leaves the tendon slack finds the equilibrium.
    pub(crate) fn static_equilibrium(&self, drive: Drive) -> (f64, bool) {
        let along = (drive.length - 1.01 * self.slack) / self.optimal;
        let start = (along.max(0.0).powi(2) + self.sine * self.sine).sqrt().max(self.shortest);
        let at = |x: f64| self.static_residual(x, drive);
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

    /// Static force difference (both models: f_V = 1, no damping force) and its derivative by x.
    pub(crate) fn static_residual(&self, x: f64, drive: Drive) -> [f64; 2] {
        let c = &*self.curves;
        let (active, active_slope) = c.active_at(x, drive.activation);
        let (passive, passive_slope) = c.passive.value_and_slope(x);
        let y = self.along_tendon(x);
        let fiber = drive.activation * active + passive;
        let tendon = self.tendon_force(x, drive.length);
        let by_x = (drive.activation * active_slope + passive_slope) * y / x
            + fiber * self.sine * self.sine / (x * x * y)
            - tendon.by_x;
        [fiber * y / x - tendon.value, by_x]
    }

    /// ∂(static residual)/∂p at fixed x.
    pub(crate) fn static_residual_by_parameters(&self, x: f64, drive: Drive) -> [f64; PARAMETERS] {
        let c = &*self.curves;
        let fiber = drive.activation * c.active_at(x, drive.activation).0 + c.passive.value_and_slope(x).0;
        let mut by = self.tendon_force(x, drive.length).by_parameters.map(|d| -d);
        by[2] -= fiber * self.sine / (x * self.along_tendon(x));
        by
    }
}
