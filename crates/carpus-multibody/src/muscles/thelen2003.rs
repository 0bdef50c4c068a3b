//! The Thelen 2003 muscle as OpenSim has it.

use super::activation::FirstOrderActivation;
use super::dynamics::MuscleDynamics;
use super::error::MuscleError;
use super::law::{Balance, Contraction, MuscleLaw, Start, ValueAndSlope, balance_of_velocities, force_of_fiber};
use super::pennation::{FixedWidthPennation, significant_real};
use carpus_osim::osim::spec::{MuscleSpec, Thelen2003Spec};

/// Shape and force of the tendon's toe region.
const K_TOE: f64 = 3.0;
const F_TOE: f64 = 0.33;
/// Iterations of the equilibrium, as in OpenSim.
const EQUILIBRIUM_ITERATIONS: usize = 20;

/// A fibre with a Gaussian force-length and a Hill-type force-velocity curve, pennate at fixed width, in series with a
/// tendon. Activation and fibre length are its states. Units as [`Millard2012`](super::Millard2012).
///
/// # References
/// Thelen (2003), doi:10.1115/1.1531112; OpenSim `Thelen2003Muscle`, whose deviations from the paper are kept.
#[derive(Clone, Debug)]
pub struct Thelen2003 {
    /// Name.
    pub name: String,
    /// Properties of the class.
    pub properties: Thelen2003Spec,
    /// Maximum isometric force [N].
    pub max_isometric_force: f64,
    /// Optimal fibre length [m].
    pub optimal_fiber_length: f64,
    /// Tendon slack length [m].
    pub tendon_slack_length: f64,
    /// Maximum contraction velocity [optimal fibre lengths/s].
    pub max_contraction_velocity: f64,
    pennation: FixedWidthPennation<f64>,
    /// Strain at the end of the toe region, and slope beyond.
    e_toe: f64,
    k_lin: f64,
}

/// Forces and velocity at a state.
struct Velocity {
    fiber_length: f64,
    sin: f64,
    cos: f64,
    tendon_length: f64,
    activation: f64,
    tendon: f64,
    active_length: f64,
    passive: f64,
    multiplier: f64,
    norm_velocity: f64,
    clamped: bool,
}

impl Thelen2003 {
    pub(super) fn build(spec: &MuscleSpec, properties: &Thelen2003Spec) -> Result<Thelen2003, MuscleError> {
        let p = *properties;
        let require = MuscleError::require;
        require(p.flen > 1.0, "Flen", "a number above 1", p.flen)?;
        let threshold = p.fv_linear_extrap_threshold;
        require(threshold > 1.0 / p.flen, "fv_linear_extrap_threshold", "a number above 1/Flen", threshold)?;
        require(p.minimum_activation >= 0.01, "minimum_activation", "at least 0.01", p.minimum_activation)?;
        let slack = spec.tendon_slack_length;
        // Of 0 OpenSim computes infinite forces, and all of the muscle that does not depend on them.
        require(slack >= 0.0 && slack.is_finite(), "tendon_slack_length", "a number of 0 or more", slack)?;
        let velocity = spec.max_contraction_velocity;
        require(velocity > 0.0, "max_contraction_velocity", "a number above 0", velocity)?;
        let pennation = FixedWidthPennation::new(
            spec.optimal_fiber_length,
            spec.pennation_angle_at_optimal,
            p.maximum_pennation_angle,
        )?;
        let e3 = 3.0_f64.exp();
        let e_toe = 99.0 * p.fmax_tendon_strain * e3 / (166.0 * e3 - 67.0);
        Ok(Thelen2003 {
            name: spec.name.clone(),
            properties: p,
            max_isometric_force: spec.max_isometric_force,
            optimal_fiber_length: spec.optimal_fiber_length,
            tendon_slack_length: slack,
            max_contraction_velocity: velocity,
            pennation,
            e_toe,
            k_lin: 0.67 / (p.fmax_tendon_strain - e_toe),
        })
    }

    /// Whether its states have finite rates.
    pub(super) fn require_rates(&self) -> Result<(), MuscleError> {
        let slack = self.tendon_slack_length;
        MuscleError::require(slack > 0.0, "tendon_slack_length", "a number above 0", slack)
    }

    /// Activation dynamics.
    pub fn activation_dynamics(&self) -> FirstOrderActivation {
        FirstOrderActivation {
            activation_time_constant: self.properties.activation_time_constant,
            deactivation_time_constant: self.properties.deactivation_time_constant,
            minimum_activation: self.properties.minimum_activation,
        }
    }

    /// Shortest fibre [m].
    pub fn minimum_fiber_length(&self) -> f64 {
        self.pennation.minimum_fiber_length
    }

    /// Tendon force multiplier and its slope by normalized tendon length.
    fn tendon(&self, norm_length: f64) -> (f64, f64) {
        let x = norm_length - 1.0;
        if x > self.e_toe {
            (self.k_lin * (x - self.e_toe) + F_TOE, self.k_lin)
        } else if x > 0.0 {
            let factor = F_TOE / K_TOE.exp_m1();
            let exponent = K_TOE * x / self.e_toe;
            (factor * (exponent.exp() - 1.0), factor * K_TOE / self.e_toe * exponent.exp())
        } else {
            (0.0, 0.0)
        }
    }

    /// Active force-length multiplier and its slope.
    fn active(&self, norm_length: f64) -> (f64, f64) {
        let x = norm_length - 1.0;
        let value = (-x * x / self.properties.kshape_active).exp();
        (value, -2.0 * x / self.properties.kshape_active * value)
    }

    /// Passive force-length multiplier and its slope.
    fn passive(&self, norm_length: f64) -> (f64, f64) {
        if norm_length <= 1.0 {
            return (0.0, 0.0);
        }
        let (shape, strain) = (self.properties.kshape_passive, self.properties.fmax_muscle_strain);
        let rise = (shape * (norm_length - 1.0) / strain).exp();
        ((rise - 1.0) / (shape.exp() - 1.0), shape / strain * rise / (shape.exp() - 1.0))
    }

    /// Normalized fibre velocity for an active force a·f_l·f_v, and its slope by that force.
    fn velocity_of(&self, a: f64, active: f64, force: f64) -> (f64, f64) {
        let Thelen2003Spec { af, flen, fv_linear_extrap_threshold: threshold, .. } = self.properties;
        let isometric = a * active;
        let greatest = isometric * flen;
        let at = |force: f64, concentric: bool| {
            let (b, db) = if concentric {
                (isometric + force / af, 1.0 / af)
            } else {
                let k = (2.0 + 2.0 / af) / (flen - 1.0);
                (k * (greatest - force), -k)
            };
            let scale = 0.25 + 0.75 * a;
            let value = scale * (force - isometric) / b;
            (value, scale / b - scale * (force - isometric) / (b * b) * db)
        };
        if force > 0.0 && force < greatest * threshold {
            return at(force, force <= isometric);
        }
        // A line beyond.
        let (from, concentric) = if force <= 0.0 { (0.0, true) } else { (threshold * greatest, false) };
        let (value, slope) = at(from, concentric);
        (value + slope * (force - from), slope)
    }

    /// Force-velocity multiplier of a normalized fibre velocity: the inverse of the above.
    fn multiplier_of(&self, a: f64, active: f64, norm_velocity: f64, tolerance: f64) -> f64 {
        let mut force = a * active;
        for _ in 0..100 {
            let (velocity, slope) = self.velocity_of(a, active, force);
            let error = velocity - norm_velocity;
            if slope.abs() > significant_real() {
                force -= error / slope;
            }
            if error.abs() < tolerance {
                break;
            }
        }
        (force / (a * active)).max(0.0)
    }

    fn velocity(&self, fiber_length: f64, activation: f64, path_length: f64) -> Velocity {
        let length = fiber_length.max(self.minimum_fiber_length());
        let direction = self.pennation.pennation(length);
        let tendon_length = path_length - length * direction.cos;
        let norm_length = length / self.optimal_fiber_length;
        let a = self.activation_dynamics().clamp(activation);
        let (tendon, _) = self.tendon(tendon_length / self.tendon_slack_length);
        let (active, _) = self.active(norm_length);
        let (passive, _) = self.passive(norm_length);
        let force = tendon / direction.cos - passive;
        let (norm_velocity, _) = self.velocity_of(a, active, force);
        let shortest = self.minimum_fiber_length();
        let clamped = fiber_length <= shortest && norm_velocity <= 0.0;
        Velocity {
            fiber_length: length,
            sin: direction.sin,
            cos: direction.cos,
            tendon_length,
            activation: a,
            tendon,
            active_length: active,
            passive,
            multiplier: if clamped { 1.0 } else { force / (a * active) },
            norm_velocity: if clamped { 0.0 } else { norm_velocity },
            clamped,
        }
    }

    /// Fibre velocity [m/s] and tendon force [N].
    pub fn rates(&self, fiber_length: f64, activation: f64, path_length: f64) -> (f64, f64) {
        let at = self.velocity(fiber_length, activation, path_length);
        let velocity = at.norm_velocity * self.max_contraction_velocity * self.optimal_fiber_length;
        (velocity, at.tendon * self.max_isometric_force)
    }

    /// Every quantity at a state (arguments as [`Millard2012::dynamics`](super::Millard2012::dynamics)).
    pub fn dynamics(&self, fiber_length: f64, activation: f64, path_length: f64, path_speed: f64) -> MuscleDynamics {
        let at = self.velocity(fiber_length, activation, path_length);
        let force = self.max_isometric_force;
        let length = at.fiber_length;
        let fiber_velocity = at.norm_velocity * self.max_contraction_velocity * self.optimal_fiber_length;
        // As in OpenSim a fibre along the tendon does not turn, however fast it is.
        let angular = if at.sin == 0.0 { 0.0 } else { -(fiber_velocity / length) * (at.sin / at.cos) };
        let along = fiber_velocity * at.cos - length * at.sin * angular;
        let (along, angular, tendon_velocity) =
            if at.clamped { (0.0, 0.0, path_speed) } else { (along, angular, path_speed - along) };
        let acts = if at.clamped { 0.0 } else { 1.0 };
        let active = acts * at.activation * at.active_length * at.multiplier * force;
        let fiber_force = active + acts * at.passive * force;
        let passive = at.passive * force;
        let norm_length = length / self.optimal_fiber_length;
        let by_length = at.activation * at.multiplier * self.active(norm_length).1 + self.passive(norm_length).1;
        let stiffness = acts * by_length * force / self.optimal_fiber_length;
        let turn = if at.sin == 0.0 { 0.0 } else { self.pennation.angle_slope(length) };
        let tendon_slope = self.tendon(at.tendon_length / self.tendon_slack_length).1;
        MuscleDynamics {
            activation: at.activation,
            fiber_length: length,
            normalized_fiber_length: norm_length,
            fiber_length_along_tendon: length * at.cos,
            pennation_angle: at.sin.asin(),
            cos_pennation_angle: at.cos,
            tendon_length: at.tendon_length,
            tendon_strain: at.tendon_length / self.tendon_slack_length - 1.0,
            active_force_length_multiplier: at.active_length,
            passive_force_multiplier: at.passive,
            force_velocity_multiplier: at.multiplier,
            fiber_velocity,
            normalized_fiber_velocity: at.norm_velocity,
            fiber_velocity_along_tendon: along,
            pennation_angular_velocity: angular,
            tendon_velocity,
            fiber_force,
            fiber_force_along_tendon: fiber_force * at.cos,
            active_fiber_force: active,
            active_fiber_force_along_tendon: active * at.cos,
            passive_fiber_force: passive,
            passive_fiber_force_along_tendon: passive * at.cos,
            passive_fiber_elastic_force: passive,
            passive_fiber_damping_force: 0.0,
            tendon_force: at.tendon * force,
            fiber_stiffness: stiffness,
            fiber_stiffness_along_tendon: (stiffness * at.cos - fiber_force * at.sin * turn) * at.cos,
            tendon_stiffness: acts * tendon_slope * force / self.tendon_slack_length,
            is_clamped: at.clamped,
        }
    }

    /// Fibre length [m] at which the tendon's force is that of the fibre, whose velocity shares that of the path as the
    /// stiffnesses of fibre and tendon do; `None` where OpenSim's iteration, followed here step by step, fails.
    ///
    /// # References
    /// OpenSim `Thelen2003Muscle::initMuscleState`.
    pub fn equilibrium(&self, path_length: f64, path_speed: f64, activation: f64) -> Option<f64> {
        if self.tendon_slack_length == 0.0 {
            return None;
        }
        let force = self.max_isometric_force;
        let tolerance = (1e-8 * force).max(10.0 * significant_real());
        let shortest = self.minimum_fiber_length();
        let mut length = self.pennation.fiber_length(path_length, 1.01 * self.tendon_slack_length);
        let mut multiplier = 1.0;
        // Imbalance, its slope, and the slopes of fibre and tendon force along the tendon.
        let balance = |length: f64, multiplier: f64| {
            let direction = self.pennation.pennation(length);
            let tendon_length = path_length - length * direction.cos;
            let norm = length / self.optimal_fiber_length;
            let (tendon, tendon_slope) = self.tendon(tendon_length / self.tendon_slack_length);
            let ((active, active_slope), (passive, passive_slope)) = (self.active(norm), self.passive(norm));
            let fiber = (activation * active * multiplier + passive) * force;
            let error = fiber * direction.cos - tendon * force;
            let slope = (activation * multiplier * active_slope + passive_slope) * force / self.optimal_fiber_length;
            let turn = if direction.sin == 0.0 { 0.0 } else { self.pennation.angle_slope(length) };
            let along = slope * direction.cos - fiber * direction.sin * turn;
            let tendon_slope = tendon_slope * force / self.tendon_slack_length;
            let tendon_by_length = tendon_slope * (-direction.cos + length * direction.sin * turn);
            (error, along, tendon_by_length, tendon_slope, direction.cos, tendon_length, active)
        };
        let share = |at: &(f64, f64, f64, f64, f64, f64, f64)| {
            let (_, along, _, tendon_slope, cos, tendon_length, active) = *at;
            let along = along * cos;
            let tendon_speed =
                if (along + tendon_slope).abs() > significant_real() && tendon_length > self.tendon_slack_length {
                    along / (along + tendon_slope) * path_speed
                } else {
                    path_speed
                };
            let velocity = (path_speed - tendon_speed) * cos;
            let norm = velocity / (self.max_contraction_velocity * self.optimal_fiber_length);
            self.multiplier_of(activation, active, norm, tolerance)
        };
        multiplier = share(&balance(length, multiplier));
        let mut at = balance(length, multiplier);
        let mut error = at.0;
        let (mut last_error, mut last_length) = (error, length);
        for _ in 0..EQUILIBRIUM_ITERATIONS {
            if error.abs() <= tolerance {
                break;
            }
            let slope = at.1 - at.2;
            let mut h = 1.0;
            while error.abs() >= last_error.abs() {
                let step = -h * last_error / slope;
                if step.abs() > significant_real() {
                    length = last_length + step;
                } else {
                    length = last_length - step.signum() * f64::EPSILON.sqrt();
                    h = 0.0;
                }
                length = length.max(shortest);
                error = balance(length, multiplier).0;
                if h <= f64::EPSILON.sqrt() {
                    break;
                }
                h *= 0.5;
            }
            (last_error, last_length) = (error, length);
            at = balance(length, multiplier);
            multiplier = share(&at);
        }
        let converged = error.abs() < tolerance;
        (converged || length <= shortest).then_some(length.max(shortest))
    }

    /// Active force along the tendon that the fibre would have if the tendon were rigid [N].
    ///
    /// # References
    /// OpenSim `Thelen2003Muscle::calcInextensibleTendonActiveFiberForce`.
    pub fn inextensible_tendon_active_fiber_force(&self, path_length: f64, path_speed: f64, activation: f64) -> f64 {
        let length = self.pennation.fiber_length(path_length, self.tendon_slack_length);
        if length <= self.minimum_fiber_length() {
            return 0.0;
        }
        let cos = self.pennation.pennation(length).cos;
        let velocity = path_speed * cos / (self.optimal_fiber_length * self.max_contraction_velocity);
        let (active, _) = self.active(length / self.optimal_fiber_length);
        let a = self.activation_dynamics().clamp(activation);
        self.max_isometric_force * a * active * self.multiplier_of(a, active, velocity, 1e-6) * cos
    }
}

impl Thelen2003 {
    /// Whether the curves are those of another muscle.
    pub fn has_curves_of(&self, other: &Thelen2003) -> bool {
        let curves = |m: &Thelen2003| {
            let p = m.properties;
            [
                [p.fmax_tendon_strain, p.fmax_muscle_strain, p.kshape_active, p.kshape_passive, p.af],
                [p.flen, p.fv_linear_extrap_threshold, p.maximum_pennation_angle, m.max_contraction_velocity, 0.0],
            ]
        };
        curves(self) == curves(other)
    }

    /// Velocity at full activation by the force–velocity multiplier, and its slope: [`Thelen2003::velocity_of`] depends
    /// on forces by their ratio alone.
    fn unit_velocity(&self, multiplier: f64) -> ValueAndSlope {
        self.velocity_of(1.0, 1.0, multiplier)
    }

    /// The force–velocity multiplier of a velocity at full activation, and its slope: the inverse of the above, not
    /// below 0.
    fn unit_multiplier(&self, velocity: f64) -> ValueAndSlope {
        let Thelen2003Spec { af, flen, fv_linear_extrap_threshold: threshold, .. } = self.properties;
        let line = |from: f64| {
            let (value, slope) = self.unit_velocity(from);
            (from + (velocity - value) / slope, 1.0 / slope)
        };
        if velocity <= self.unit_velocity(0.0).0 {
            return (0.0, 0.0);
        }
        if velocity >= self.unit_velocity(threshold * flen).0 {
            return line(threshold * flen);
        }
        let multiplier = if velocity <= 0.0 {
            (1.0 + velocity) / (1.0 - velocity / af)
        } else {
            let k = (2.0 + 2.0 / af) / (flen - 1.0);
            (1.0 + velocity * k * flen) / (1.0 + velocity * k)
        };
        (multiplier, 1.0 / self.unit_velocity(multiplier).1)
    }

    /// By how much activation scales velocities.
    fn scale_of_velocity(activation: f64) -> f64 {
        0.25 + 0.75 * activation
    }
}

impl MuscleLaw for Thelen2003 {
    fn tendon(&self, norm_length: f64) -> ValueAndSlope {
        Thelen2003::tendon(self, norm_length)
    }

    fn active(&self, norm_length: f64) -> ValueAndSlope {
        Thelen2003::active(self, norm_length)
    }

    fn passive(&self, norm_length: f64) -> ValueAndSlope {
        Thelen2003::passive(self, norm_length)
    }

    fn balance(&self, at: &Contraction) -> Balance {
        let scale = Self::scale_of_velocity(at.activation);
        balance_of_velocities(at, |multiplier| {
            let (velocity, slope) = self.unit_velocity(multiplier);
            (scale * velocity, scale * slope)
        })
    }

    fn states_velocity(&self) -> bool {
        true
    }

    fn max_velocity(&self) -> f64 {
        self.max_contraction_velocity
    }

    fn fiber_force(&self, at: &Contraction) -> [f64; 3] {
        let scale = Self::scale_of_velocity(at.activation);
        let (multiplier, slope) = self.unit_multiplier(at.u / scale);
        force_of_fiber(at, (multiplier, slope / scale), 0.0)
    }

    fn sine_of_greatest_pennation(&self) -> f64 {
        self.properties.maximum_pennation_angle.sin()
    }

    fn start(&self) -> Start {
        Start::SharesSpeed
    }
}
