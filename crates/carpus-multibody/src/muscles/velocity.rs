//! The fibre's velocity: the state derivative of the equilibrium model.

use super::kinematics::LengthState;
use super::parameters::Millard2012;
use super::pennation::significant_real;
use carpus_numerics::numerics::{Scalar, ValueAndDerivative};

/// Fibre velocity and the forces that decide it.
#[derive(Clone, Copy, Debug)]
pub struct FiberVelocity<S = f64> {
    /// Lengthening speed of the fibre [m/s]: the derivative of the state `fiber_length`.
    pub fiber_velocity: S,
    /// The same divided by `max_contraction_velocity`·`optimal_fiber_length`.
    pub norm_fiber_velocity: S,
    /// Force–velocity multiplier.
    pub force_velocity_multiplier: S,
    /// Normalized tendon force; with a rigid tendon, the fibre force along the tendon.
    pub norm_tendon_force: S,
    /// Whether the fibre rests at its minimum length.
    pub is_clamped: bool,
}

/// How a quantity changes with state and path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateGradient<S = f64> {
    /// ∂/∂ fibre length [1/m]; 0 with a rigid tendon.
    pub fiber_length: S,
    /// ∂/∂ activation.
    pub activation: S,
    /// ∂/∂ path length [1/m].
    pub path_length: S,
    /// ∂/∂ lengthening speed of the path [s/m].
    pub path_speed: S,
}

impl<S: Scalar> StateGradient<S> {
    fn zero() -> StateGradient<S> {
        let zero = S::constant(0.0);
        StateGradient { fiber_length: zero, activation: zero, path_length: zero, path_speed: zero }
    }
}

/// State derivative and tendon force with their partial derivatives, for implicit integration.
#[derive(Clone, Copy, Debug)]
pub struct Linearization<S = f64> {
    /// Fibre velocity [m/s].
    pub fiber_velocity: S,
    /// Tendon force [N].
    pub tendon_force: S,
    /// Partial derivatives of the fibre velocity.
    pub fiber_velocity_by: StateGradient<S>,
    /// Partial derivatives of the tendon force.
    pub tendon_force_by: StateGradient<S>,
}

/// Velocity-level result together with what its derivatives need.
#[derive(Clone, Copy, Debug)]
pub(super) struct VelocityState<S> {
    pub length: LengthState<S>,
    /// Activation, clamped.
    pub activation: S,
    pub norm_velocity: S,
    /// Force–velocity multiplier.
    pub multiplier: S,
    /// Slope of the force–velocity curve (its inverse's reciprocal, undamped) at the value.
    pub multiplier_slope: f64,
    /// Tendon curve at the value; zero with a rigid tendon.
    pub tendon: ValueAndDerivative,
    pub is_clamped: bool,
    pub is_buckled: bool,
}

impl<S: Scalar> VelocityState<S> {
    pub fn norm_tendon_force(&self) -> S {
        self.length.norm_tendon_length.chain(self.tendon.value, self.tendon.derivative)
    }
}

impl<S: Scalar> Millard2012<S> {
    /// Fibre velocity at a state, as OpenSim's state derivative, but for any state: OpenSim's own Newton iteration may
    /// fail, the damped equation solved here always has exactly one solution.
    ///
    /// - `fiber_length`: state [m], clamped to the minimum length; not used with a rigid tendon
    /// - `activation`: state, clamped to `minimum_activation` and 1
    /// - `path_length` [m], `path_speed` [m/s]: the path's length and lengthening speed
    ///
    /// # References
    /// OpenSim `Millard2012EquilibriumMuscle::calcFiberVelocityInfo`; Millard et al. (2013), equations 6 to 8.
    pub fn fiber_velocity(&self, fiber_length: S, activation: S, path_length: S, path_speed: S) -> FiberVelocity<S> {
        let state = self.velocity_state(fiber_length, activation, path_length, path_speed);
        let norm_tendon_force = if self.structure.ignore_tendon_compliance {
            self.norm_fiber_force(&state).max(S::constant(0.0)) * state.length.cos
        } else {
            state.norm_tendon_force()
        };
        FiberVelocity {
            fiber_velocity: state.norm_velocity / self.inverse_max_velocity,
            norm_fiber_velocity: state.norm_velocity,
            force_velocity_multiplier: state.multiplier,
            norm_tendon_force,
            is_clamped: state.is_clamped,
        }
    }

    /// Force of the fibre over `max_isometric_force`, 0 where the fibre is clamped; not saturated.
    pub(super) fn norm_fiber_force(&self, state: &VelocityState<S>) -> S {
        if state.is_clamped {
            return S::constant(0.0);
        }
        state.activation * state.length.active_multiplier() * state.multiplier
            + state.length.passive_multiplier()
            + self.parameters.fiber_damping * state.norm_velocity
    }

    #[inline]
    pub(super) fn velocity_state(
        &self,
        fiber_length: S,
        activation: S,
        path_length: S,
        path_speed: S,
    ) -> VelocityState<S> {
        let mut state = VelocityState {
            length: self.length_state(fiber_length, path_length),
            activation: self.clamp_activation(activation),
            norm_velocity: S::constant(0.0),
            multiplier: S::constant(1.0),
            multiplier_slope: 0.0,
            tendon: ValueAndDerivative { value: 0.0, derivative: 0.0 },
            is_clamped: false,
            is_buckled: false,
        };
        if self.structure.ignore_tendon_compliance {
            self.solve_rigid(&mut state, path_speed);
        } else {
            let tendon_length = state.length.norm_tendon_length.value();
            state.tendon = self.structure.curves.tendon_force_length.value_and_derivative(tendon_length);
            if self.structure.damped {
                self.solve_damped(&mut state);
            } else {
                self.solve_undamped(&mut state);
            }
        }
        let at_minimum = state.length.fiber_length.value() <= self.minimum_fiber_length.value();
        if at_minimum && state.norm_velocity.value() <= 0.0 {
            state.is_clamped = true;
            state.norm_velocity = S::constant(0.0);
            state.multiplier = S::constant(1.0);
        }
        state
    }

    /// The fibre takes all of the path's speed, unless the tendon buckles.
    fn solve_rigid(&self, state: &mut VelocityState<S>, path_speed: S) {
        let slack = self.parameters.tendon_slack_length.value();
        if state.length.tendon_length.value() < slack - significant_real() {
            state.is_buckled = true;
            return;
        }
        state.norm_velocity = path_speed * state.length.cos * self.inverse_max_velocity;
        let at = self.structure.curves.force_velocity.value_and_derivative(state.norm_velocity.value());
        state.multiplier = state.norm_velocity.chain(at.value, at.derivative);
        state.multiplier_slope = at.derivative;
    }

    /// a f_L f_V(ṽ) + β ṽ = f_T / cos φ − f_PE, strictly rising in ṽ.
    #[inline]
    fn solve_damped(&self, state: &mut VelocityState<S>) {
        let damping = self.parameters.fiber_damping;
        let gain = state.activation * state.length.active_multiplier();
        let target = state.norm_tendon_force() / state.length.cos - state.length.passive_multiplier();
        let (velocity, at) =
            self.structure.curves.force_velocity.solve_weighted_sum(gain.value(), damping.value(), target.value());
        // One Newton step with derivatives from the solved value: implicit differentiation.
        let residual = gain * at.value + damping * velocity - target;
        let slope = gain.value() * at.derivative + damping.value();
        state.norm_velocity = S::constant(velocity) - (residual - residual.value()) * (1.0 / slope);
        state.multiplier = state.norm_velocity.chain(at.value, at.derivative);
        state.multiplier_slope = at.derivative;
    }

    /// ṽ = f_V⁻¹((f_T / cos φ − f_PE) / (a f_L)).
    fn solve_undamped(&self, state: &mut VelocityState<S>) {
        let gain = state.activation * state.length.active_multiplier();
        let target = state.norm_tendon_force() / state.length.cos - state.length.passive_multiplier();
        state.multiplier = target / gain;
        let inverse = &self.structure.curves.force_velocity_inverse;
        let at = inverse.value_and_derivative(state.multiplier.value());
        state.norm_velocity = state.multiplier.chain(at.value, at.derivative);
        state.multiplier_slope = 1.0 / at.derivative;
    }

    /// Fibre velocity and tendon force with analytic partial derivatives (arguments as
    /// [`fiber_velocity`](Self::fiber_velocity)).
    ///
    /// Where a value is clamped (activation, fibre length), the derivative with respect to it is 0.
    pub fn linearize(&self, fiber_length: S, activation: S, path_length: S, path_speed: S) -> Linearization<S> {
        let state = self.velocity_state(fiber_length, activation, path_length, path_speed);
        let activation_is_free = state.activation.value() == activation.value();
        if self.structure.ignore_tendon_compliance {
            self.linearize_rigid(&state, path_speed, activation_is_free)
        } else {
            self.linearize_elastic(&state, activation_is_free)
        }
    }

    fn linearize_elastic(&self, state: &VelocityState<S>, activation_is_free: bool) -> Linearization<S> {
        let force = self.parameters.max_isometric_force;
        let length = &state.length;
        let curves = &self.structure.curves;
        let tendon_slope = curves.tendon_force_length.evaluate_derivative(length.norm_tendon_length)
            / self.parameters.tendon_slack_length;
        let tendon_force = state.norm_tendon_force();
        // Fixed width: ∂l_T/∂l = −1/cos φ.
        let by_length = if length.was_clamped { S::constant(0.0) } else { -tendon_slope / length.cos };
        let mut tendon_force_by = StateGradient::zero();
        tendon_force_by.fiber_length = force * by_length;
        tendon_force_by.path_length = force * tendon_slope;

        let mut fiber_velocity_by = StateGradient::zero();
        if !state.is_clamped {
            let max_velocity = self.inverse_max_velocity.recip();
            let l_opt = self.parameters.optimal_fiber_length;
            let active_slope = curves.active_force_length.evaluate_derivative(length.norm_fiber_length) / l_opt;
            let passive_slope = curves.fiber_force_length.evaluate_derivative(length.norm_fiber_length) / l_opt;
            let gain = state.activation * length.active_multiplier();
            let slope = gain * self.multiplier_slope(state) + self.parameters.fiber_damping;
            let scale = max_velocity / slope;
            if !length.was_clamped {
                let angle_slope = self.pennation.angle_slope(length.fiber_length);
                let target_slope = by_length / length.cos
                    + tendon_force * length.sin * angle_slope / (length.cos * length.cos)
                    - passive_slope;
                fiber_velocity_by.fiber_length =
                    scale * (target_slope - state.multiplier * state.activation * active_slope);
            }
            if activation_is_free {
                fiber_velocity_by.activation = -scale * state.multiplier * length.active_multiplier();
            }
            fiber_velocity_by.path_length = scale * tendon_slope / length.cos;
        }
        Linearization {
            fiber_velocity: state.norm_velocity / self.inverse_max_velocity,
            tendon_force: force * tendon_force,
            fiber_velocity_by,
            tendon_force_by,
        }
    }

    /// Slope of the force–velocity relation in use.
    fn multiplier_slope(&self, state: &VelocityState<S>) -> S {
        let curves = &self.structure.curves;
        if self.structure.damped {
            curves.force_velocity.evaluate_derivative(state.norm_velocity)
        } else {
            curves.force_velocity_inverse.evaluate_derivative(state.multiplier).recip()
        }
    }

    fn linearize_rigid(&self, state: &VelocityState<S>, path_speed: S, activation_is_free: bool) -> Linearization<S> {
        let length = &state.length;
        let curves = &self.structure.curves;
        let fiber_force = self.norm_fiber_force(state);
        let mut linearization = Linearization {
            fiber_velocity: state.norm_velocity / self.inverse_max_velocity,
            tendon_force: S::constant(0.0),
            fiber_velocity_by: StateGradient::zero(),
            tendon_force_by: StateGradient::zero(),
        };
        // The clamped fibre pulls nothing; negative forces are saturated.
        if state.is_clamped || fiber_force.value() < 0.0 {
            if !state.is_clamped && !state.is_buckled {
                linearization.fiber_velocity_by.path_speed = length.cos;
                let bend = length.sin * self.pennation.angle_slope(length.fiber_length);
                linearization.fiber_velocity_by.path_length = -path_speed * bend * length.cos;
            }
            return linearization;
        }
        let along_tendon = self.parameters.max_isometric_force * length.cos;
        linearization.tendon_force = along_tendon * fiber_force;
        if activation_is_free {
            linearization.tendon_force_by.activation = along_tendon * length.active_multiplier() * state.multiplier;
        }
        if state.is_buckled {
            return linearization;
        }
        let l_opt = self.parameters.optimal_fiber_length;
        let angle_slope = self.pennation.angle_slope(length.fiber_length);
        // l² = h² + (l_MT − l_T)²: ∂l/∂l_MT = cos φ.
        let velocity_by_length = -path_speed * length.sin * angle_slope * length.cos;
        let gain = state.activation * length.active_multiplier();
        let force_by_velocity = (gain * curves.force_velocity.evaluate_derivative(state.norm_velocity)
            + self.parameters.fiber_damping)
            * self.inverse_max_velocity;
        let active_slope = curves.active_force_length.evaluate_derivative(length.norm_fiber_length) / l_opt;
        let passive_slope = curves.fiber_force_length.evaluate_derivative(length.norm_fiber_length) / l_opt;
        let force_by_length = state.activation * active_slope * state.multiplier + passive_slope;
        let cos_by_length = -length.sin * angle_slope * length.cos;
        linearization.fiber_velocity_by.path_length = velocity_by_length;
        linearization.fiber_velocity_by.path_speed = length.cos;
        linearization.tendon_force_by.path_length = along_tendon
            * (force_by_length * length.cos + force_by_velocity * velocity_by_length)
            + self.parameters.max_isometric_force * fiber_force * cos_by_length;
        linearization.tendon_force_by.path_speed = along_tendon * force_by_velocity * length.cos;
        linearization
    }
}
