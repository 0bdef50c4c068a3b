//! The laws that fibres of trials follow: those of [`MuscleLaw`], Millard's with tabulated curves.

use std::sync::Arc;

use super::curve_table::CurveTable;
use carpus_multibody::muscles::{
    Balance, Contraction, DeGrooteFregly2016, DeprecatedMuscle, MuscleLaw, RigidTendon, RigidTendonRule, Start,
    Thelen2003, ValueAndSlope, balance_of_forces, balance_of_velocities, force_of_fiber,
};

/// A class of muscle. Everything in here is called in the innermost loop, so that classes are told apart by a match.
#[derive(Clone, Debug)]
pub(crate) enum FiberLaw {
    /// `Millard2012EquilibriumMuscle`.
    Millard2012(TabulatedMillard2012),
    /// `Thelen2003Muscle`.
    Thelen2003(Arc<Thelen2003>),
    /// `DeGrooteFregly2016Muscle`.
    DeGrooteFregly2016(Arc<DeGrooteFregly2016>),
    /// `Schutte1993Muscle_Deprecated`, `Delp1990Muscle_Deprecated` without its mass.
    Deprecated(Arc<DeprecatedMuscle>),
    /// `RigidTendonMuscle`.
    RigidTendon(Arc<RigidTendon>),
}

/// The curves of a Millard 2012 muscle, tabulated.
#[derive(Clone, Debug)]
pub(crate) struct TabulatedMillard2012 {
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
}

/// Evaluates an expression with the law of whatever class.
macro_rules! of_law {
    ($of:expr, $law:ident => $call:expr) => {
        match $of {
            $crate::simulation::fiber::law::FiberLaw::Millard2012($law) => $call,
            $crate::simulation::fiber::law::FiberLaw::Thelen2003(shared) => {
                let $law = &**shared;
                $call
            }
            $crate::simulation::fiber::law::FiberLaw::DeGrooteFregly2016(shared) => {
                let $law = &**shared;
                $call
            }
            $crate::simulation::fiber::law::FiberLaw::Deprecated(shared) => {
                let $law = &**shared;
                $call
            }
            $crate::simulation::fiber::law::FiberLaw::RigidTendon(shared) => {
                let $law = &**shared;
                $call
            }
        }
    };
}
pub(super) use of_law;

impl FiberLaw {
    /// Whether the two give the same numbers.
    pub(crate) fn is_same(&self, other: &FiberLaw) -> bool {
        match (self, other) {
            (FiberLaw::Millard2012(a), FiberLaw::Millard2012(b)) => a.has_curves_of(b),
            (FiberLaw::Thelen2003(a), FiberLaw::Thelen2003(b)) => Arc::ptr_eq(a, b) || a.has_curves_of(b),
            (FiberLaw::DeGrooteFregly2016(a), FiberLaw::DeGrooteFregly2016(b)) => {
                Arc::ptr_eq(a, b) || a.has_curves_of(b)
            }
            (FiberLaw::Deprecated(a), FiberLaw::Deprecated(b)) => Arc::ptr_eq(a, b) || a.has_curves_of(b),
            (FiberLaw::RigidTendon(a), FiberLaw::RigidTendon(b)) => Arc::ptr_eq(a, b) || a.has_curves_of(b),
            _ => false,
        }
    }

    /// Largest deviation of a tabulated curve from the exact one; 0 for classes whose curves are not tabulated.
    pub(crate) fn deviation(&self) -> f64 {
        let FiberLaw::Millard2012(own) = self else { return 0.0 };
        let curves = [&own.active, &own.passive, &own.force_velocity, &own.tendon];
        curves.into_iter().chain(&own.velocity_of_force).map(|table| table.deviation()).fold(0.0, f64::max)
    }
}

impl TabulatedMillard2012 {
    /// Whether the two share their tables.
    fn has_curves_of(&self, other: &Self) -> bool {
        let tables = |c: &Self| [&c.active, &c.passive, &c.force_velocity, &c.tendon].map(Arc::as_ptr);
        let inverse = |c: &Self| c.velocity_of_force.as_ref().map(Arc::as_ptr);
        let numbers = |c: &Self| [c.damping, c.max_velocity, c.min_active_length, c.sine_max_pennation];
        tables(self) == tables(other) && inverse(self) == inverse(other) && numbers(self) == numbers(other)
    }
}

impl MuscleLaw for TabulatedMillard2012 {
    #[inline(always)]
    fn tendon(&self, norm_length: f64) -> ValueAndSlope {
        self.tendon.value_and_slope(norm_length)
    }

    #[inline(always)]
    fn active(&self, norm_length: f64) -> ValueAndSlope {
        self.active.value_and_slope(norm_length)
    }

    #[inline(always)]
    fn passive(&self, norm_length: f64) -> ValueAndSlope {
        self.passive.value_and_slope(norm_length)
    }

    #[inline(always)]
    fn balance(&self, at: &Contraction) -> Balance {
        match &self.velocity_of_force {
            None => balance_of_forces(at, self.force_velocity.value_and_slope(at.u), self.damping),
            Some(inverse) => balance_of_velocities(at, |multiplier| inverse.value_and_slope(multiplier)),
        }
    }

    fn states_velocity(&self) -> bool {
        self.velocity_of_force.is_some()
    }

    #[inline(always)]
    fn max_velocity(&self) -> f64 {
        self.max_velocity
    }

    #[inline]
    fn fiber_force(&self, at: &Contraction) -> [f64; 3] {
        force_of_fiber(at, self.force_velocity.value_and_slope(at.u), self.damping)
    }

    fn shortest(&self) -> f64 {
        self.min_active_length
    }

    fn sine_of_greatest_pennation(&self) -> f64 {
        self.sine_max_pennation
    }

    fn rigid_tendon_rule(&self) -> RigidTendonRule {
        RigidTendonRule::Unilateral
    }
}

impl FiberLaw {
    /// As [`MuscleLaw::start`].
    pub(crate) fn start(&self) -> Start {
        of_law!(self, law => law.start())
    }

    /// As [`MuscleLaw::rigid_tendon_rule`].
    pub(crate) fn rigid_tendon_rule(&self) -> RigidTendonRule {
        of_law!(self, law => law.rigid_tendon_rule())
    }

    /// As [`MuscleLaw::max_velocity`].
    pub(crate) fn max_velocity(&self) -> f64 {
        of_law!(self, law => law.max_velocity())
    }

    /// As [`MuscleLaw::shortest`].
    pub(crate) fn shortest(&self) -> f64 {
        of_law!(self, law => law.shortest())
    }

    /// As [`MuscleLaw::sine_of_greatest_pennation`].
    pub(crate) fn sine_of_greatest_pennation(&self) -> f64 {
        of_law!(self, law => law.sine_of_greatest_pennation())
    }
}
