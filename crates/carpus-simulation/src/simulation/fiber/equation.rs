//! The force equilibrium of a muscle, in normalized quantities, with all its first derivatives.

use std::sync::Arc;

use super::law::{FiberLaw, of_law};
use carpus_multibody::muscles::{Contraction, MuscleLaw};

/// Muscle parameters that derivatives are taken for, in the order of every derivative array of this module:
/// optimal fibre length, tendon slack length, sine of the pennation angle at optimal fibre length.
pub(crate) const PARAMETERS: usize = 3;

/// What a muscle's class and its properties decide; shared by all candidate parameter sets.
#[derive(Clone, Debug)]
pub(crate) struct FiberCurves {
    /// Curves, and how fibre and tendon balance.
    pub(crate) law: FiberLaw,
    /// Maximum contraction velocity [optimal fibre lengths/s].
    pub(crate) max_velocity: f64,
    /// λ: the active force–length curve is read at x/(1 + λ (1 − a)).
    pub(crate) length_by_activation: f64,
}

impl FiberCurves {
    /// The curves of a class.
    pub(crate) fn new(law: FiberLaw) -> FiberCurves {
        FiberCurves { max_velocity: law.max_velocity(), law, length_by_activation: 0.0 }
    }

    /// Whether the two give the same numbers.
    pub(crate) fn are_same(&self, other: &FiberCurves) -> bool {
        self.length_by_activation == other.length_by_activation && self.law.is_same(&other.law)
    }

    /// Active force multiplier at a normalized fibre length and activation, and its slope by the length.
    #[inline(always)]
    pub(super) fn active_at(&self, law: &impl MuscleLaw, x: f64, activation: f64) -> (f64, f64) {
        if self.length_by_activation == 0.0 {
            return law.active(x);
        }
        let optimum = 1.0 + self.length_by_activation * (1.0 - activation);
        let (value, slope) = law.active(x / optimum);
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
        let greatest = curves.law.sine_of_greatest_pennation();
        let (pennate, pennate_by_sine) =
            if greatest > significant { (sine / greatest, 1.0 / greatest) } else { (0.01, 0.0) };
        let active = curves.law.shortest().max(significant / optimal);
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

    /// R(x, u), the balance of fibre and tendon, which each class states in its own way ([`MuscleLaw`]):
    ///
    /// ```text
    /// R = (a·f_L(x)·f_V(u) + f_PE(x) + β u) cos φ − f_T((l_MT − l_opt x cos φ)/l_slack)          Millard, damped
    /// R = u − f_V⁻¹((f_T/cos φ − f_PE(x)) / (a f_L(x)))                                          Millard, undamped
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
        match &self.curves.law {
            FiberLaw::Millard2012(law) => self.residual_of(law, x, u, drive),
            _ => self.residual_of_others(x, u, drive),
        }
    }

    /// [`Fiber::residual`] of a class other than Millard's.
    #[inline(never)]
    fn residual_of_others(&self, x: f64, u: f64, drive: Drive) -> Residual {
        of_law!(&self.curves.law, law => self.residual_of(law, x, u, drive))
    }

    #[inline(always)]
    fn residual_of(&self, law: &impl MuscleLaw, x: f64, u: f64, drive: Drive) -> Residual {
        let clamped = x < self.shortest;
        let x = if clamped { self.shortest } else { x };
        let active = self.curves.active_at(law, x, drive.activation);
        let passive = law.passive(x);
        let y = self.along_tendon(x);
        let (inverse_x, inverse_y) = (1.0 / x, 1.0 / y);
        let (cosine, y_by_x) = (y * inverse_x, x * inverse_y);
        let inverse_slack = self.inverse_slack;
        let (tendon, tendon_slope) = law.tendon((drive.length - self.optimal * y) * inverse_slack);
        let tendon_by_x = -tendon_slope * self.optimal * inverse_slack * y_by_x;
        let cosine_by_x = self.sine * self.sine * inverse_x * inverse_x * inverse_y;
        let at = Contraction { u, activation: drive.activation, active, passive, cosine, secant: y_by_x, tendon };
        let balance = law.balance(&at);
        let by_x = balance.by_x + balance.by_cosine * cosine_by_x + balance.by_tendon * tendon_by_x;
        Residual { r: balance.r, by_x: if clamped { 0.0 } else { by_x }, by_u: balance.by_u }
    }

    /// What R(x, u) needs before it is known what drives the fibre.
    ///
    /// - `x`, `u`: as for [`Fiber::residual`]
    pub(crate) fn undriven(&self, x: f64, u: f64) -> Undriven {
        let x = if x < self.shortest { self.shortest } else { x };
        let c = &*self.curves;
        let (active, passive) = of_law!(&c.law, law => (c.active_at(law, x, 1.0).0, law.passive(x).0));
        let velocity = match &c.law {
            FiberLaw::Millard2012(law) if law.velocity_of_force.is_none() => law.force_velocity.value_and_slope(u).0,
            _ => 1.0,
        };
        Undriven { x, u, y: self.along_tendon(x), active, passive, velocity }
    }

    /// Normalized tendon force, as R takes it.
    ///
    /// - `length`: of the path [m]
    #[inline]
    pub(crate) fn pull(&self, known: &Undriven, length: f64) -> f64 {
        self.tendon_at((length - self.optimal * known.y) * self.inverse_slack).0
    }

    /// Normalized tendon force and its slope by tendon length over slack length.
    #[inline]
    fn tendon_at(&self, norm_length: f64) -> (f64, f64) {
        match &self.curves.law {
            FiberLaw::Millard2012(law) => law.tendon.value_and_slope(norm_length),
            other => of_law!(other, law => law.tendon(norm_length)),
        }
    }

    /// R without its derivatives: the same number, to the last bit, as [`Fiber::residual`] gives.
    ///
    /// - `pull`: of the tendon, from [`Fiber::pull`]
    #[inline]
    pub(crate) fn imbalance(&self, known: &Undriven, activation: f64, pull: f64) -> f64 {
        let Undriven { x, u, y, active, passive, velocity } = *known;
        let c = &*self.curves;
        let active = match c.length_by_activation == 0.0 {
            true => active,
            false => of_law!(&c.law, law => c.active_at(law, x, activation).0),
        };
        let (cosine, secant) = (y * (1.0 / x), x * (1.0 / y));
        let at = || Contraction {
            u,
            activation,
            active: (active, 0.0),
            passive: (passive, 0.0),
            cosine,
            secant,
            tendon: pull,
        };
        match &c.law {
            FiberLaw::Millard2012(law) => match &law.velocity_of_force {
                // The force–velocity curve is read already.
                None => (activation * active * velocity + passive + law.damping * u) * cosine - pull,
                Some(_) => law.balance(&at()).r,
            },
            other => of_law!(other, law => law.balance(&at()).r),
        }
    }

    /// ∂R/∂p at fixed x, u, activation and path length.
    #[inline]
    pub(crate) fn residual_by_parameters(&self, x: f64, u: f64, drive: Drive) -> [f64; PARAMETERS] {
        let clamped = x < self.shortest;
        let x = if clamped { self.shortest } else { x };
        let c = &*self.curves;
        let y = self.along_tendon(x);
        let tendon = self.tendon_force(x, drive.length);
        let balance = of_law!(&c.law, law => law.balance(&Contraction {
            u,
            activation: drive.activation,
            active: c.active_at(law, x, drive.activation),
            passive: law.passive(x),
            cosine: y / x,
            secant: x / y,
            tendon: tendon.value,
        }));
        let mut by = tendon.by_parameters.map(|d| balance.by_tendon * d);
        by[2] += balance.by_cosine * (-self.sine / (x * y));
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
        let (value, slope) = self.tendon_at(stretch);
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
        if of_law!(&self.curves.law, law => law.states_velocity()) {
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
}
