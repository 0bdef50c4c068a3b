//! Activation dynamics.

use carpus_numerics::numerics::Scalar;

/// First-order activation dynamics with faster activation than deactivation.
///
/// ```text
/// da/dt = (u − a) / τ(a, u),   τ = τ_act (1/2 + 3a/2)  if u > a,   τ_deact / (1/2 + 3a/2)  otherwise
/// ```
/// # References
/// Thelen (2003), equation 1, doi:10.1115/1.1531112; OpenSim `MuscleFirstOrderActivationDynamicModel`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstOrderActivation<S = f64> {
    /// Time constant of activation, `activation_time_constant` [s].
    pub activation_time_constant: S,
    /// Time constant of deactivation, `deactivation_time_constant` [s].
    pub deactivation_time_constant: S,
    /// Lowest activation, `minimum_activation`.
    pub minimum_activation: f64,
}

impl<S: Scalar> FirstOrderActivation<S> {
    /// Activation within [`minimum_activation`](Self::minimum_activation) and 1.
    pub fn clamp(&self, activation: S) -> S {
        if activation.value() < self.minimum_activation {
            S::constant(self.minimum_activation)
        } else if activation.value() > 1.0 {
            S::constant(1.0)
        } else {
            activation
        }
    }

    /// da/dt [1/s] for the state `activation` and the control `excitation`.
    ///
    /// The activation is clamped first, the excitation is not. As in OpenSim, an excitation below the minimum therefore
    /// drives the state below the minimum at a constant rate, without end; an excitation kept at or above the minimum
    /// (`min_control`) avoids that.
    pub fn derivative(&self, activation: S, excitation: S) -> S {
        let a = self.clamp(activation);
        let factor = a * 1.5 + 0.5;
        let tau = if excitation.value() > a.value() {
            self.activation_time_constant * factor
        } else {
            self.deactivation_time_constant / factor
        };
        (excitation - a) / tau
    }

    /// ∂(da/dt)/∂a [1/s], with the excitation fixed; 0 where the activation is clamped.
    pub fn derivative_slope(&self, activation: S, excitation: S) -> S {
        let a = self.clamp(activation);
        if a.value() != activation.value() {
            return S::constant(0.0);
        }
        let factor = a * 1.5 + 0.5;
        if excitation.value() > a.value() {
            -(factor + (excitation - a) * 1.5) / (self.activation_time_constant * factor * factor)
        } else {
            ((excitation - a) * 1.5 - factor) / self.deactivation_time_constant
        }
    }
}
