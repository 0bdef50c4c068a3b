//! What every class of muscle states: its curves, and how fibre and tendon balance, in normalized quantities.
//!
//! ```text
//! fibre length x = l/l_opt, fibre velocity u = l̇/(l_opt v_max), tendon length λ = l_T/l_slack, forces over F_max
//! ```
//! A class is its curves f_T(λ), f_L(x), f_P(x) and a relation R(u, a, f_L, f_P, cos φ, f_T) = 0 between them. The
//! geometry (a fibre of constant height, a tendon in series with it) is the same for all.

use std::fmt::Debug;

/// A curve's value and its slope.
pub type ValueAndSlope = (f64, f64);

/// What a class's relation between fibre and tendon is stated in.
#[derive(Clone, Copy, Debug, Default)]
pub struct Contraction {
    /// Fibre velocity over maximum contraction velocity, positive when lengthening.
    pub u: f64,
    /// Activation.
    pub activation: f64,
    /// Active force–length multiplier and its slope by x.
    pub active: ValueAndSlope,
    /// Passive force–length multiplier and its slope by x.
    pub passive: ValueAndSlope,
    /// cos φ of the pennation angle, above 0.
    pub cosine: f64,
    /// 1/cos φ.
    pub secant: f64,
    /// Tendon force over maximum isometric force.
    pub tendon: f64,
}

/// R and its derivatives; R increases with u.
#[derive(Clone, Copy, Debug, Default)]
pub struct Balance {
    /// R: zero where fibre and tendon bear the same force.
    pub r: f64,
    /// By x through the curves of the fibre alone, cos φ and f_T held.
    pub by_x: f64,
    /// By u, above 0.
    pub by_u: f64,
    /// By cos φ.
    pub by_cosine: f64,
    /// By f_T.
    pub by_tendon: f64,
}

/// How fast the fibre is taken to be where a simulation starts in equilibrium, as OpenSim's class has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// At rest.
    AtRest,
    /// It shares the path's speed with the tendon as their stiffnesses do.
    SharesSpeed,
    /// It takes the whole speed of the path.
    TakesSpeed,
}

/// How a fibre behaves in a muscle whose tendon keeps its slack length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RigidTendonRule {
    /// A fibre shorter than allowed, or one that would push, bears no force.
    Unilateral,
    /// Every length is taken as it is.
    Unbounded,
    /// As [`RigidTendonRule::Unbounded`], but the fibre is as fast as the path whatever its pennation, and never
    /// shorter than its height.
    FollowsPath,
}

/// A class of muscle.
///
/// # References
/// The OpenSim class of the implementing type.
pub trait MuscleLaw: Debug + Send + Sync {
    /// f_T, by tendon length over slack length.
    fn tendon(&self, norm_length: f64) -> ValueAndSlope;

    /// f_L, by fibre length over optimal length.
    fn active(&self, norm_length: f64) -> ValueAndSlope;

    /// f_P, by fibre length over optimal length.
    fn passive(&self, norm_length: f64) -> ValueAndSlope;

    /// R.
    fn balance(&self, at: &Contraction) -> Balance;

    /// Whether R = u − V: the velocity is stated, not the force.
    fn states_velocity(&self) -> bool;

    /// v_max, what u is over [optimal fibre lengths/s].
    fn max_velocity(&self) -> f64;

    /// Force of the fibre over maximum isometric force, and its slopes by x (φ held) and by u.
    fn fiber_force(&self, at: &Contraction) -> [f64; 3];

    /// Shortest fibre over optimal length that the class's curves allow; pennation may allow less.
    fn shortest(&self) -> f64 {
        0.0
    }

    /// Sine of the greatest pennation angle: that of cos φ = 0.1, where the class has none of its own.
    fn sine_of_greatest_pennation(&self) -> f64 {
        0.99_f64.sqrt()
    }

    /// How a simulation starts.
    fn start(&self) -> Start {
        Start::AtRest
    }

    /// What a rigid tendon makes of the fibre.
    fn rigid_tendon_rule(&self) -> RigidTendonRule {
        RigidTendonRule::Unbounded
    }
}

/// (a f_L f_V(u) + f_P + β u), and its slopes by x and by u.
///
/// - `velocity`: f_V and its slope at u; `damping`: β
#[inline(always)]
pub fn force_of_fiber(at: &Contraction, (velocity, slope): ValueAndSlope, damping: f64) -> [f64; 3] {
    let a = at.activation;
    let ((active, active_slope), (passive, passive_slope)) = (at.active, at.passive);
    let force = a * active * velocity + passive + damping * at.u;
    [force, a * active_slope * velocity + passive_slope, a * active * slope + damping]
}

/// R of a class that states the fibre's force:
///
/// ```text
/// R = (a f_L f_V(u) + f_P + β u) cos φ − f_T
/// ```
/// - `velocity`: f_V and its slope at u; `damping`: β
#[inline(always)]
pub fn balance_of_forces(at: &Contraction, velocity: ValueAndSlope, damping: f64) -> Balance {
    let [fiber, by_x, by_u] = force_of_fiber(at, velocity, damping);
    Balance {
        r: fiber * at.cosine - at.tendon,
        by_x: by_x * at.cosine,
        by_u: by_u * at.cosine,
        by_cosine: fiber,
        by_tendon: -1.0,
    }
}

/// R of a class that states the fibre's velocity by the force–velocity multiplier that the tendon asks for:
///
/// ```text
/// R = u − V(m),   m = (f_T / cos φ − f_P) / (a f_L)
/// ```
/// - `velocity_of`: V and its slope
#[inline(always)]
pub fn balance_of_velocities(at: &Contraction, velocity_of: impl FnOnce(f64) -> ValueAndSlope) -> Balance {
    let a = at.activation;
    let ((active, active_slope), (passive, passive_slope)) = (at.active, at.passive);
    let available = 1.0 / (a * active);
    let multiplier = (at.tendon * at.secant - passive) * available;
    let (velocity, slope) = velocity_of(multiplier);
    let by_force = slope * available;
    Balance {
        r: at.u - velocity,
        by_x: by_force * (passive_slope + multiplier * a * active_slope),
        by_u: 1.0,
        by_cosine: by_force * at.tendon * at.secant * at.secant,
        by_tendon: -by_force * at.secant,
    }
}
