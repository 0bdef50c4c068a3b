//! Lengths, and the multipliers that depend on them alone.

use super::parameters::Millard2012;
use carpus_numerics::numerics::{Scalar, ValueAndDerivative};

/// Position-level quantities of a muscle (OpenSim's `MuscleLengthInfo`).
#[derive(Clone, Copy, Debug)]
pub(super) struct LengthState<S> {
    /// Fibre length, clamped [m].
    pub fiber_length: S,
    /// Whether the given fibre length was below the minimum.
    pub was_clamped: bool,
    pub norm_fiber_length: S,
    pub sin: S,
    pub cos: S,
    pub tendon_length: S,
    pub norm_tendon_length: S,
    /// Active force–length multiplier and its slope at the value.
    pub active: ValueAndDerivative,
    /// Passive force–length multiplier and its slope at the value.
    pub passive: ValueAndDerivative,
}

impl<S: Scalar> Millard2012<S> {
    /// `fiber_length` is not used with a rigid tendon.
    #[inline]
    pub(super) fn length_state(&self, fiber_length: S, path_length: S) -> LengthState<S> {
        let raw = if self.structure.ignore_tendon_compliance {
            self.pennation.fiber_length(path_length, self.parameters.tendon_slack_length)
        } else {
            fiber_length
        };
        let fiber_length = self.clamp_fiber_length(raw);
        let norm_fiber_length = fiber_length / self.parameters.optimal_fiber_length;
        let direction = self.pennation.pennation(fiber_length);
        let tendon_length = path_length - fiber_length * direction.cos;
        let curves = &self.structure.curves;
        LengthState {
            fiber_length,
            was_clamped: raw.value() < self.minimum_fiber_length.value(),
            norm_fiber_length,
            sin: direction.sin,
            cos: direction.cos,
            tendon_length,
            norm_tendon_length: tendon_length / self.parameters.tendon_slack_length,
            active: curves.active_force_length.value_and_derivative(norm_fiber_length.value()),
            passive: curves.fiber_force_length.value_and_derivative(norm_fiber_length.value()),
        }
    }
}

impl<S: Scalar> LengthState<S> {
    /// Active force–length multiplier.
    #[inline]
    pub fn active_multiplier(&self) -> S {
        self.norm_fiber_length.chain(self.active.value, self.active.derivative)
    }
    /// Passive force–length multiplier.
    #[inline]
    pub fn passive_multiplier(&self) -> S {
        self.norm_fiber_length.chain(self.passive.value, self.passive.derivative)
    }
}
