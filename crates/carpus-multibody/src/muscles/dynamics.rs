//! Everything OpenSim reports about a muscle at a state.

use super::parameters::Millard2012;
use carpus_numerics::numerics::Scalar;

/// A muscle's quantities at a state, under OpenSim's output names where OpenSim has one.
///
/// Lengths [m], velocities [m/s] positive when lengthening, forces [N] positive in tension, stiffnesses [N/m].
#[derive(Clone, Copy, Debug)]
pub struct MuscleDynamics<S = f64> {
    /// Activation, clamped.
    pub activation: S,
    /// Fibre length, clamped.
    pub fiber_length: S,
    /// Fibre length over optimal fibre length.
    pub normalized_fiber_length: S,
    /// Fibre length projected on the tendon.
    pub fiber_length_along_tendon: S,
    /// Pennation angle [rad].
    pub pennation_angle: S,
    /// Its cosine.
    pub cos_pennation_angle: S,
    /// Tendon length.
    pub tendon_length: S,
    /// Tendon length over slack length, minus 1.
    pub tendon_strain: S,
    /// Active force–length multiplier.
    pub active_force_length_multiplier: S,
    /// Passive force multiplier.
    pub passive_force_multiplier: S,
    /// Force–velocity multiplier.
    pub force_velocity_multiplier: S,
    /// Fibre velocity.
    pub fiber_velocity: S,
    /// Fibre velocity over maximum velocity.
    pub normalized_fiber_velocity: S,
    /// Fibre velocity projected on the tendon.
    pub fiber_velocity_along_tendon: S,
    /// Rate of the pennation angle [rad/s].
    pub pennation_angular_velocity: S,
    /// Tendon velocity.
    pub tendon_velocity: S,
    /// Total force of the fibre.
    pub fiber_force: S,
    /// The same along the tendon.
    pub fiber_force_along_tendon: S,
    /// Force of the contractile element.
    pub active_fiber_force: S,
    /// The same along the tendon.
    pub active_fiber_force_along_tendon: S,
    /// Elastic and damping force of the fibre.
    pub passive_fiber_force: S,
    /// The same along the tendon.
    pub passive_fiber_force_along_tendon: S,
    /// Elastic part of the passive force.
    pub passive_fiber_elastic_force: S,
    /// Damping part of the passive force.
    pub passive_fiber_damping_force: S,
    /// Force on the bones.
    pub tendon_force: S,
    /// Stiffness of the fibre.
    pub fiber_stiffness: S,
    /// Stiffness of the fibre along the tendon.
    pub fiber_stiffness_along_tendon: S,
    /// Stiffness of the tendon; infinite if rigid, 0 where the fibre is clamped.
    pub tendon_stiffness: S,
    /// Whether the fibre rests at its minimum length; OpenSim then reports fibre forces of 0.
    pub is_clamped: bool,
}

impl<S: Scalar> Millard2012<S> {
    /// Every quantity at a state (arguments as [`fiber_velocity`](Self::fiber_velocity)).
    ///
    /// # References
    /// OpenSim `Millard2012EquilibriumMuscle::calcMuscleLengthInfo`, `calcFiberVelocityInfo`,
    /// `calcMuscleDynamicsInfo`.
    pub fn dynamics(&self, fiber_length: S, activation: S, path_length: S, path_speed: S) -> MuscleDynamics<S> {
        let state = self.velocity_state(fiber_length, activation, path_length, path_speed);
        let length = &state.length;
        let zero = S::constant(0.0);
        let rigid = self.structure.ignore_tendon_compliance;
        let fiber_velocity = state.norm_velocity / self.inverse_max_velocity;
        // v_AT = v cos φ − l sin φ φ̇ with φ̇ = −(v/l) tan φ.
        let pennation_angular_velocity = -fiber_velocity / length.fiber_length * length.sin / length.cos;
        let along_tendon = fiber_velocity / length.cos;
        let tendon_velocity = if state.is_clamped {
            path_speed
        } else if rigid {
            zero
        } else {
            path_speed - along_tendon
        };

        let unclamped = S::constant(if state.is_clamped { 0.0 } else { 1.0 });
        let force = self.parameters.max_isometric_force;
        let active = force * state.activation * length.active_multiplier() * state.multiplier * unclamped;
        let elastic = force * length.passive_multiplier() * unclamped;
        let mut damping = force * self.parameters.fiber_damping * state.norm_velocity;
        let mut fiber_force = active + elastic + damping;
        // With a rigid tendon nothing else keeps the fibre from pushing.
        if rigid && fiber_force.value() < 0.0 {
            fiber_force = zero;
            damping = -active - elastic;
        }
        let passive = elastic + damping;
        let fiber_force_along_tendon = fiber_force * length.cos;

        let curves = &self.structure.curves;
        let active_slope = curves.active_force_length.evaluate_derivative(length.norm_fiber_length);
        let passive_slope = curves.fiber_force_length.evaluate_derivative(length.norm_fiber_length);
        let fiber_stiffness = force * (state.activation * active_slope * state.multiplier + passive_slope)
            / self.parameters.optimal_fiber_length
            * unclamped;
        let angle_slope = self.pennation.angle_slope(length.fiber_length);
        let by_fiber_length = fiber_stiffness * length.cos - fiber_force * length.sin * angle_slope;
        let along_by_fiber_length = length.cos - length.fiber_length * length.sin * angle_slope;
        let (tendon_force, tendon_stiffness) = if rigid {
            (fiber_force_along_tendon, S::constant(if state.is_clamped { 0.0 } else { f64::INFINITY }))
        } else {
            let slope = curves.tendon_force_length.evaluate_derivative(length.norm_tendon_length);
            let stiffness = slope * force / self.parameters.tendon_slack_length * unclamped;
            (force * state.norm_tendon_force(), stiffness)
        };
        MuscleDynamics {
            activation: state.activation,
            fiber_length: length.fiber_length,
            normalized_fiber_length: length.norm_fiber_length,
            fiber_length_along_tendon: length.fiber_length * length.cos,
            pennation_angle: if length.sin.value() == 0.0 { zero } else { length.sin.asin() },
            cos_pennation_angle: length.cos,
            tendon_length: length.tendon_length,
            tendon_strain: length.norm_tendon_length - 1.0,
            active_force_length_multiplier: length.active_multiplier(),
            passive_force_multiplier: length.passive_multiplier(),
            force_velocity_multiplier: state.multiplier,
            fiber_velocity,
            normalized_fiber_velocity: state.norm_velocity,
            fiber_velocity_along_tendon: along_tendon,
            pennation_angular_velocity,
            tendon_velocity,
            fiber_force,
            fiber_force_along_tendon,
            active_fiber_force: active,
            active_fiber_force_along_tendon: active * length.cos,
            passive_fiber_force: passive,
            passive_fiber_force_along_tendon: passive * length.cos,
            passive_fiber_elastic_force: elastic,
            passive_fiber_damping_force: damping,
            tendon_force,
            fiber_stiffness,
            fiber_stiffness_along_tendon: by_fiber_length / along_by_fiber_length * unclamped,
            tendon_stiffness,
            is_clamped: state.is_clamped,
        }
    }
}

impl Millard2012<f64> {
    /// Active force along the tendon that the fibre would have if the tendon were rigid [N]; what static optimization
    /// takes for the force of a muscle at full activation.
    ///
    /// - `path_length` [m], `path_speed` [m/s]
    ///
    /// # References
    /// OpenSim `Millard2012EquilibriumMuscle::calcInextensibleTendonActiveFiberForce`, its pennation angle included,
    /// which is taken at the normalized fibre length.
    pub fn inextensible_tendon_active_fiber_force(&self, path_length: f64, path_speed: f64, activation: f64) -> f64 {
        let parameters = self.parameters();
        let pennation = self.pennation();
        let length = pennation.fiber_length(path_length, parameters.tendon_slack_length);
        if length <= self.minimum_fiber_length() {
            return 0.0;
        }
        let velocity = path_speed * pennation.pennation(length).cos;
        let norm_length = length / parameters.optimal_fiber_length;
        let norm_velocity = velocity / (parameters.optimal_fiber_length * parameters.max_contraction_velocity);
        let curves = self.curves();
        parameters.max_isometric_force
            * self.clamp_activation(activation)
            * curves.active_force_length.value(norm_length)
            * curves.force_velocity.value(norm_velocity)
            * pennation.pennation(norm_length).cos
    }
}
