//! The muscles of SIMM's time: Schutte 1993 and Delp 1990, as OpenSim has them.

use super::dynamics::MuscleDynamics;
use super::error::MuscleError;
use super::law::{Balance, Contraction, MuscleLaw, ValueAndSlope, balance_of_forces, force_of_fiber};
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{DeprecatedMuscleKind, DeprecatedMuscleSpec, MuscleSpec};

/// Constants of OpenSim's search for the equilibrium.
const EQUILIBRIUM_ITERATIONS: usize = 100;
const EQUILIBRIUM_ERROR: f64 = 0.01;
const TENDON_ELASTIC_MODULUS: f64 = 1200.0;
const TENDON_MAX_STRESS: f64 = 32.0;
/// Shortest fibre over optimal length that a simulation follows; OpenSim's classes have no bound.
const SHORTEST_FIBER: f64 = 0.05;
/// OpenSim's `ROUNDOFF_ERROR`.
const ROUNDOFF: f64 = 2e-13;
/// Damping over maximum isometric force that takes the place of the mass of Delp's muscle: with neither a mass nor
/// activation nothing would say how fast a fibre is. At a tenth of the maximum contraction velocity it bears 2e-6 F_max.
const DAMPING_WITHOUT_MASS: f64 = 2e-5;
/// Force-velocity curve of Schutte's muscle: shape, slope ratio, greatest eccentric force.
const KV: f64 = 0.15;
const SLOPE_K: f64 = 0.13;
const ECCENTRIC: f64 = 1.4;

/// What sets the fibre's velocity.
#[derive(Clone, Debug)]
enum Contracting {
    /// Schutte: force balance solved for the velocity, with damping.
    Schutte { damping: f64 },
    /// Delp: a mass between fibre and tendon, so that the velocity is a state.
    Delp { mass: f64, force_velocity: Function },
}

/// A Schutte 1993 or Delp 1990 muscle. Activation, fibre length and, of Delp's, fibre velocity are its states. Units as
/// [`Millard2012`](super::Millard2012).
///
/// # References
/// Schutte et al. (1993); Delp (1990); OpenSim `Schutte1993Muscle_Deprecated`, `Delp1990Muscle_Deprecated`.
#[derive(Clone, Debug)]
pub struct DeprecatedMuscle {
    /// Name.
    pub name: String,
    /// Maximum isometric force [N].
    pub max_isometric_force: f64,
    /// Optimal fibre length [m].
    pub optimal_fiber_length: f64,
    /// Tendon slack length [m].
    pub tendon_slack_length: f64,
    /// Pennation angle at optimal fibre length [rad].
    pub pennation_angle_at_optimal: f64,
    /// Maximum contraction velocity [optimal fibre lengths/s], used by static optimization only.
    pub max_contraction_velocity: f64,
    time_scale: f64,
    activation: [f64; 2],
    tendon: Function,
    active: Function,
    /// `None`: Schutte's exponential.
    passive: Option<Function>,
    contraction: Contracting,
    /// Curves as the file has them.
    curves: DeprecatedMuscleSpec,
}

impl DeprecatedMuscle {
    pub(super) fn build(spec: &MuscleSpec, own: &DeprecatedMuscleSpec) -> Result<DeprecatedMuscle, MuscleError> {
        let curve = MuscleError::function;
        let require = MuscleError::require;
        require(spec.optimal_fiber_length > 0.0, "optimal_fiber_length", "above 0 m", spec.optimal_fiber_length)?;
        for (ignored, property) in [
            (spec.ignore_tendon_compliance, "ignore_tendon_compliance"),
            (spec.ignore_activation_dynamics, "ignore_activation_dynamics"),
        ] {
            require(!ignored, property, "false, as in OpenSim", 1.0)?;
        }
        let contraction = match &own.kind {
            DeprecatedMuscleKind::Schutte1993 { damping } => {
                require(*damping > 0.0, "damping", "a number above 0", *damping)?;
                Contracting::Schutte { damping: *damping }
            }
            DeprecatedMuscleKind::Delp1990 { mass, force_velocity_curve } => {
                require(*mass > 0.0, "mass", "a number above 0", *mass)?;
                let force_velocity = curve("force_velocity_curve", force_velocity_curve)?;
                Contracting::Delp { mass: *mass, force_velocity }
            }
        };
        Ok(DeprecatedMuscle {
            name: spec.name.clone(),
            max_isometric_force: spec.max_isometric_force,
            optimal_fiber_length: spec.optimal_fiber_length,
            tendon_slack_length: spec.tendon_slack_length,
            pennation_angle_at_optimal: spec.pennation_angle_at_optimal,
            max_contraction_velocity: spec.max_contraction_velocity,
            time_scale: own.time_scale,
            activation: [own.activation1, own.activation2],
            tendon: curve("tendon_force_length_curve", &own.tendon_force_length_curve)?,
            active: curve("active_force_length_curve", &own.active_force_length_curve)?,
            passive: own
                .passive_force_length_curve
                .as_ref()
                .map(|function| curve("passive_force_length_curve", function))
                .transpose()?,
            contraction,
            curves: own.clone(),
        })
    }

    /// As [`MuscleModel::require_rates`](super::MuscleModel::require_rates).
    pub(super) fn require_rates(&self) -> Result<(), MuscleError> {
        MuscleError::require(self.time_scale > 0.0, "time_scale", "a number above 0", self.time_scale)
    }

    /// Whether the fibre's velocity is a state.
    pub fn has_velocity_state(&self) -> bool {
        matches!(self.contraction, Contracting::Delp { .. })
    }

    /// Rate of the activation [1/s].
    pub fn activation_rate(&self, activation: f64, excitation: f64) -> f64 {
        (excitation - activation) * self.activation_speed(activation, excitation)
    }

    /// Its derivative by the activation.
    pub fn activation_rate_slope(&self, activation: f64, excitation: f64) -> f64 {
        -self.activation_speed(activation, excitation)
    }

    fn activation_speed(&self, activation: f64, excitation: f64) -> f64 {
        let [first, second] = self.activation;
        let rising = if excitation >= activation { first * excitation } else { 0.0 };
        (rising + second) / self.time_scale
    }

    /// Pennation angle for a fibre length over the optimal one [rad].
    fn pennation(&self, norm_length: f64) -> f64 {
        if norm_length < f64::EPSILON {
            return 0.0;
        }
        let sine = self.pennation_angle_at_optimal.sin() / norm_length;
        if sine.is_nan() || sine <= 0.0 {
            0.0
        } else if sine >= 1.0 {
            std::f64::consts::FRAC_PI_2
        } else {
            sine.asin()
        }
    }

    fn tendon_multiplier(&self, strain: f64) -> f64 {
        if strain < 0.0 { 0.0 } else { self.tendon.value(strain) }
    }

    fn passive_multiplier(&self, norm_length: f64) -> f64 {
        match &self.passive {
            Some(curve) => curve.value(norm_length),
            None => (8.0 * (norm_length - 1.0)).exp() / 4.0_f64.exp(),
        }
    }

    /// Fibre velocity [m/s] (of Delp's muscle the state's rate), its acceleration [m/s²] (0 where it is no state) and
    /// tendon force [N].
    pub fn rates(
        &self,
        fiber_length: f64,
        fiber_velocity: f64,
        activation: f64,
        path_length: f64,
        path_speed: f64,
    ) -> (f64, f64, f64) {
        let l = self.optimal_fiber_length;
        let norm_length = fiber_length / l;
        let angle = self.pennation(norm_length);
        let cos = angle.cos();
        let slack = self.tendon_slack_length / l;
        let tendon = self.tendon_multiplier((path_length / l - norm_length * cos - slack) / slack);
        let force = tendon * self.max_isometric_force;
        match &self.contraction {
            Contracting::Schutte { damping } => {
                let active = self.active.value(norm_length).max(0.0);
                let velocity = if cos.abs() <= ROUNDOFF {
                    if tendon.abs() <= ROUNDOFF {
                        0.0
                    } else {
                        // A stiff tendon, with OpenSim's mixture of lengths and ratios.
                        let h = path_length / l - self.tendon_slack_length;
                        let w = l * self.pennation_angle_at_optimal.sin();
                        let cos = self.pennation((h * h + w * w).sqrt() / l).cos();
                        path_speed * self.time_scale / l * cos
                    }
                } else {
                    let left = (tendon / cos - self.passive_multiplier(norm_length)).max(0.0);
                    schutte_velocity(*damping, activation * active, left)
                };
                (velocity * l / self.time_scale, 0.0, force)
            }
            Contracting::Delp { mass, force_velocity } => {
                let v = fiber_velocity * self.time_scale / l;
                let fiber = activation * self.active.value(norm_length) * force_velocity.value(v)
                    + self.passive_multiplier(norm_length);
                let mass = mass * (l / self.time_scale).powi(2);
                let tan = angle.tan();
                let by_force = (tendon * cos - fiber * cos * cos) / mass;
                let acceleration = by_force + v * v * tan * tan / norm_length;
                (fiber_velocity, acceleration * l / (self.time_scale * self.time_scale), force)
            }
        }
    }

    /// Every quantity at a state.
    pub fn dynamics(
        &self,
        fiber_length: f64,
        fiber_velocity: f64,
        activation: f64,
        path_length: f64,
        path_speed: f64,
    ) -> MuscleDynamics {
        let (velocity, _, tendon_force) = self.rates(fiber_length, fiber_velocity, activation, path_length, path_speed);
        let norm_length = fiber_length / self.optimal_fiber_length;
        let angle = self.pennation(norm_length);
        let cos = angle.cos();
        let tendon_length = path_length - fiber_length * cos;
        let passive_multiplier = self.passive_multiplier(norm_length);
        let passive = passive_multiplier * self.max_isometric_force;
        let fiber_force = tendon_force / cos;
        let active = fiber_force - passive;
        let along = velocity / cos;
        let active_multiplier = self.active.value(norm_length);
        MuscleDynamics {
            activation,
            fiber_length,
            normalized_fiber_length: norm_length,
            fiber_length_along_tendon: fiber_length * cos,
            pennation_angle: angle,
            cos_pennation_angle: cos,
            tendon_length,
            tendon_strain: tendon_length / self.tendon_slack_length - 1.0,
            active_force_length_multiplier: active_multiplier,
            passive_force_multiplier: passive_multiplier,
            force_velocity_multiplier: active / (self.max_isometric_force * activation * active_multiplier),
            fiber_velocity: velocity,
            normalized_fiber_velocity: velocity / (self.optimal_fiber_length * self.max_contraction_velocity),
            fiber_velocity_along_tendon: along,
            pennation_angular_velocity: -velocity / fiber_length * angle.tan(),
            tendon_velocity: path_speed - along,
            fiber_force,
            fiber_force_along_tendon: tendon_force,
            active_fiber_force: active,
            active_fiber_force_along_tendon: active * cos,
            passive_fiber_force: passive,
            passive_fiber_force_along_tendon: passive * cos,
            passive_fiber_elastic_force: passive,
            passive_fiber_damping_force: 0.0,
            tendon_force,
            // OpenSim has no stiffnesses of these classes.
            fiber_stiffness: f64::NAN,
            fiber_stiffness_along_tendon: f64::NAN,
            tendon_stiffness: f64::NAN,
            is_clamped: false,
        }
    }

    /// Fibre length [m] and tendon force [N] at which fibre and tendon balance at rest, to within 0.01 N: OpenSim's
    /// iteration, followed step by step.
    ///
    /// # References
    /// OpenSim `computeIsometricForce` of both classes.
    pub fn isometric(&self, path_length: f64, activation: f64) -> (f64, f64) {
        let (l, slack, force) = (self.optimal_fiber_length, self.tendon_slack_length, self.max_isometric_force);
        let width = l * self.pennation_angle_at_optimal.sin();
        let cos_of = |length: f64| self.pennation(length / l).cos();
        let cos_beside = |along: f64| (width / along).atan().cos();
        let is_delp = self.has_velocity_state();
        let passive = |length: f64| self.passive_multiplier(length / l);
        if slack < ROUNDOFF {
            let cos = cos_beside(path_length);
            let length = path_length / cos;
            let active = (self.active.value(length / l) * activation).max(0.0);
            if !is_delp {
                return (length, (active + passive(length)) * force * cos);
            }
            return (length, (active + passive(length).max(0.0)) * force * cos);
        }
        if path_length < slack {
            return (width, 0.0);
        }
        let mut length = if is_delp { path_length - slack } else { l };
        let mut cos = cos_of(length);
        let mut tendon_length = path_length - length * cos;
        if tendon_length < slack {
            tendon_length = slack;
            cos = cos_beside(path_length - tendon_length);
            length = ((path_length - tendon_length) / cos).max(width);
        }
        let (mut error, mut before, mut tendon_force) = (0.0_f64, f64::NAN, 0.0);
        for i in 0..EQUILIBRIUM_ITERATIONS {
            let active = (self.active.value(length / l) * activation).max(0.0);
            let elastic = passive(length).max(0.0);
            let strain = tendon_length / slack - 1.0;
            tendon_force = self.tendon_multiplier(strain) * force;
            let last_error = error;
            error = tendon_force - (active + elastic) * force * cos;
            if error.abs() <= EQUILIBRIUM_ERROR {
                break;
            }
            let last_error = if i == 0 { error } else { last_error };
            if (error >= 0.0) != (last_error >= 0.0) {
                let share = error.abs() / (error.abs() + last_error.abs());
                let other = before;
                before = length;
                length += share * (other - length);
            } else {
                let least = (active + elastic) * TENDON_ELASTIC_MODULUS * force / (TENDON_MAX_STRESS * slack);
                // OpenSim takes the force, not its slope, for the stiffness; below no strain it asks the curve all the
                // same.
                let tendon_stiffness = (self.tendon.value(strain) * force / slack).max(least);
                let fiber_stiffness = force / l * (self.active.value(length / l) + passive(length));
                let mut change = (error / (fiber_stiffness / cos + tendon_stiffness)).abs();
                if change / l > 0.5 {
                    change = 0.5 * l;
                }
                before = length;
                length += if error > 0.0 { change } else { -change };
            }
            cos = cos_of(length);
            tendon_length = path_length - length * cos;
            if tendon_length < slack {
                tendon_length = slack;
                cos = cos_beside(path_length - tendon_length);
                length = (path_length - tendon_length) / cos;
            }
        }
        (length, tendon_force)
    }

    /// Isometric force times a force-velocity factor [N]; what static optimization takes for the force of a muscle.
    ///
    /// # References
    /// OpenSim `ActivationFiberLengthMuscle_Deprecated::calcInextensibleTendonActiveFiberForce`.
    pub fn inextensible_tendon_active_fiber_force(&self, path_length: f64, path_speed: f64, activation: f64) -> f64 {
        let (_, force) = self.isometric(path_length, activation);
        let scale = self.max_contraction_velocity * self.optimal_fiber_length;
        let velocity = -self.pennation_angle_at_optimal.cos() * path_speed / scale;
        force * (1.8 - 1.8 / (1.0 + ((0.04 - velocity) / 0.18).exp()))
    }
}

/// Force–velocity curve of Delp's muscle and its slope; below the maximum contraction velocity, where curves are
/// extrapolated and may rise again, the value there.
fn delp_force_velocity(curve: &Function, u: f64) -> ValueAndSlope {
    if u < -1.0 { (curve.value(-1.0), 0.0) } else { (curve.value(u), curve.derivative(u)) }
}

/// Velocity over optimal fibre length and time scale at which a damped fibre bears a force.
///
/// - `isometric`: active force at rest
/// - `force`: what the tendon leaves after the passive force
fn schutte_velocity(damping: f64, isometric: f64, force: f64) -> f64 {
    schutte_velocity_and_slopes(damping, isometric, force)[0]
}

/// [`schutte_velocity`], then its derivatives by `isometric` and by `force`.
fn schutte_velocity_and_slopes(damping: f64, isometric: f64, force: f64) -> [f64; 3] {
    if force < -damping {
        return [force / damping, 0.0, 1.0 / damping];
    }
    // v² + b v + c = 0, with b and c linear in both forces; of its two solutions the sign chooses one.
    let (sign, b, [b_by_isometric, b_by_force], c_by_force);
    if force < isometric {
        c_by_force = KV / damping;
        b = -KV * (force / KV + isometric + damping) / damping;
        [b_by_isometric, b_by_force] = [-KV / damping, -1.0 / damping];
        sign = -1.0;
    } else {
        let slope = SLOPE_K * KV / (KV + 1.0);
        c_by_force = -slope / damping;
        b = -(force / damping - ECCENTRIC * isometric / damping - slope);
        [b_by_isometric, b_by_force] = [ECCENTRIC / damping, -1.0 / damping];
        sign = 1.0;
    }
    let c = c_by_force * (force - isometric);
    let root = sign * (b * b - 4.0 * c).sqrt();
    let v = (root - b) / 2.0;
    let by = |b_by: f64, c_by: f64| if root == 0.0 { 0.0 } else { -(v * b_by + c_by) / root };
    [v, by(b_by_isometric, -c_by_force), by(b_by_force, c_by_force)]
}

impl DeprecatedMuscle {
    /// Whether the curves are those of another muscle.
    pub fn has_curves_of(&self, other: &DeprecatedMuscle) -> bool {
        self.curves == other.curves && self.time_scale == other.time_scale
    }

    /// Rates of the activation per second at no excitation, and what full excitation adds to it.
    pub fn activation_rates(&self) -> [f64; 2] {
        let [first, second] = self.activation;
        [second / self.time_scale, first / self.time_scale]
    }
}

/// Of Delp's muscle without the mass between fibre and tendon, for which the law has no place: its limit as the mass
/// goes to 0.
impl MuscleLaw for DeprecatedMuscle {
    fn tendon(&self, norm_length: f64) -> ValueAndSlope {
        let strain = norm_length - 1.0;
        if strain < 0.0 { (0.0, 0.0) } else { (self.tendon.value(strain), self.tendon.derivative(strain)) }
    }

    fn active(&self, norm_length: f64) -> ValueAndSlope {
        let value = self.active.value(norm_length);
        if value < 0.0 { (0.0, 0.0) } else { (value, self.active.derivative(norm_length)) }
    }

    fn passive(&self, norm_length: f64) -> ValueAndSlope {
        match &self.passive {
            Some(curve) => (curve.value(norm_length), curve.derivative(norm_length)),
            None => {
                let value = self.passive_multiplier(norm_length);
                (value, 8.0 * value)
            }
        }
    }

    fn balance(&self, at: &Contraction) -> Balance {
        let Contraction { u, activation, active: (active, active_slope), .. } = *at;
        let ((passive, passive_slope), secant) = (at.passive, at.secant);
        let damping = match &self.contraction {
            Contracting::Schutte { damping } => *damping,
            Contracting::Delp { force_velocity, .. } => {
                return balance_of_forces(at, delp_force_velocity(force_velocity, u), DAMPING_WITHOUT_MASS);
            }
        };
        let left = at.tendon * secant - passive;
        let [velocity, by_isometric, by_force] =
            schutte_velocity_and_slopes(damping, activation * active, left.max(0.0));
        let by_left = if left > 0.0 { by_force } else { 0.0 };
        Balance {
            r: u - velocity,
            by_x: by_left * passive_slope - by_isometric * activation * active_slope,
            by_u: 1.0,
            by_cosine: by_left * at.tendon * secant * secant,
            by_tendon: -by_left * secant,
        }
    }

    fn states_velocity(&self) -> bool {
        !self.has_velocity_state()
    }

    fn max_velocity(&self) -> f64 {
        1.0 / self.time_scale
    }

    fn fiber_force(&self, at: &Contraction) -> [f64; 3] {
        match &self.contraction {
            Contracting::Delp { force_velocity, .. } => {
                force_of_fiber(at, delp_force_velocity(force_velocity, at.u), DAMPING_WITHOUT_MASS)
            }
            // At rest: Schutte's law states the velocity.
            Contracting::Schutte { .. } => force_of_fiber(at, (1.0, 0.0), 0.0),
        }
    }

    fn shortest(&self) -> f64 {
        SHORTEST_FIBER
    }
}
