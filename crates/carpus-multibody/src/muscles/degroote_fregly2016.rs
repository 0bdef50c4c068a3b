//! OpenSim's `DeGrooteFregly2016Muscle`: smooth curves, the normalized tendon force as a state.

use super::dynamics::MuscleDynamics;
use super::error::MuscleError;
use super::law::{Balance, Contraction, MuscleLaw, Start, ValueAndSlope, balance_of_forces, force_of_fiber};
use carpus_osim::osim::spec::{DeGrooteFregly2016Spec, MuscleSpec};

/// Gaussians of the active force-length curve: height, centre, width, change of width.
const GAUSSIANS: [[f64; 4]; 3] = [
    [0.8150671134243542, 1.055033428970575, 0.162384573599574, 0.063303448465465],
    [0.433004984392647, 0.716775413397760, -0.029947116970696, 0.200356847296188],
    [0.1, 1.0, 0.353553390593274, 0.0],
];
/// Shape of the passive curve, and the length where it starts.
const K_PE: f64 = 4.0;
const SHORTEST: f64 = 0.2;
/// Tendon curve: c₁ exp(k (l − c₂)) − c₃.
const C: [f64; 3] = [0.2, 1.0, 0.2];
/// Force-velocity curve: d₁ asinh(d₂ v + d₃) + d₄.
const D: [f64; 4] = [-0.3211346127989808, -8.149, -0.374, 0.8825327733249912];
/// Greatest normalized tendon force.
const STRONGEST: f64 = 5.0;

/// A fibre and tendon with exponential and Gaussian curves, pennate at fixed width. Activation and normalized tendon
/// force are its states. Units as [`Millard2012`](super::Millard2012).
///
/// In implicit mode the rate of the tendon force is an input, which OpenSim's solvers give (Moco) and its tools leave
/// at 0.
///
/// OpenSim 4.6 takes the time constants and the smoothing of whichever such muscle a process evaluates first for all of
/// them (`static` locals of `computeStateVariableDerivatives`); here every muscle has its own.
///
/// # References
/// De Groote et al. (2016), doi:10.1007/s10439-016-1591-9; OpenSim `DeGrooteFregly2016Muscle`.
#[derive(Clone, Debug)]
pub struct DeGrooteFregly2016 {
    /// Name.
    pub name: String,
    /// Properties of the class.
    pub properties: DeGrooteFregly2016Spec,
    /// Maximum isometric force [N].
    pub max_isometric_force: f64,
    /// Optimal fibre length [m].
    pub optimal_fiber_length: f64,
    /// Tendon slack length [m].
    pub tendon_slack_length: f64,
    /// Maximum contraction velocity [optimal fibre lengths/s].
    pub max_contraction_velocity: f64,
    /// Rigid tendon: the tendon force is no state.
    pub ignore_tendon_compliance: bool,
    /// The activation is the control, no state.
    pub ignore_activation_dynamics: bool,
    width: f64,
    /// k of the tendon curve.
    tendon_stiffness: f64,
}

/// Lengths for a tendon force.
struct Lengths {
    tendon: f64,
    fiber: f64,
    norm: f64,
    cos: f64,
    active: f64,
    passive: f64,
}

impl DeGrooteFregly2016 {
    pub(super) fn build(spec: &MuscleSpec, own: &DeGrooteFregly2016Spec) -> Result<Self, MuscleError> {
        let require = MuscleError::require;
        let angle = spec.pennation_angle_at_optimal;
        let steepest = std::f64::consts::FRAC_PI_2 - f64::EPSILON.powf(0.875);
        require(
            (0.0..=steepest).contains(&angle),
            "pennation_angle_at_optimal",
            "at least 0 and below π/2 rad",
            angle,
        )?;
        let (name, width) = ("active_force_width_scale", own.active_force_width_scale);
        require(width >= 1.0, name, "at least 1", width)?;
        let start = own.default_normalized_tendon_force;
        require((0.0..=STRONGEST).contains(&start), "default_normalized_tendon_force", "0 to 5", start)?;
        for (property, value) in [
            ("max_contraction_velocity", spec.max_contraction_velocity),
            ("tendon_slack_length", spec.tendon_slack_length),
        ] {
            require(value > 0.0, property, "a number above 0", value)?;
        }
        Ok(DeGrooteFregly2016 {
            name: spec.name.clone(),
            properties: *own,
            max_isometric_force: spec.max_isometric_force,
            optimal_fiber_length: spec.optimal_fiber_length,
            tendon_slack_length: spec.tendon_slack_length,
            max_contraction_velocity: spec.max_contraction_velocity,
            ignore_tendon_compliance: spec.ignore_tendon_compliance,
            ignore_activation_dynamics: spec.ignore_activation_dynamics,
            width: spec.optimal_fiber_length * angle.sin(),
            tendon_stiffness: ((1.0 + C[2]) / C[0]).ln() / (1.0 + own.tendon_strain_at_one_norm_force - C[1]),
        })
    }

    /// Rate of the activation [1/s].
    pub fn activation_rate(&self, activation: f64, excitation: f64) -> f64 {
        let p = &self.properties;
        let factor = 0.5 + 1.5 * activation;
        let f = 0.5 * (p.activation_dynamics_smoothing * (excitation - activation)).tanh();
        let rising = (f + 0.5) / (p.activation_time_constant * factor);
        let falling = (0.5 - f) * factor / p.deactivation_time_constant;
        (rising + falling) * (excitation - activation)
    }

    /// Its derivative by the activation.
    pub fn activation_rate_slope(&self, activation: f64, excitation: f64) -> f64 {
        let step = 1e-6;
        let rate = |a: f64| self.activation_rate(a, excitation);
        (rate(activation + step) - rate(activation - step)) / (2.0 * step)
    }

    fn active(&self, norm_length: f64) -> (f64, f64) {
        let scale = self.properties.active_force_width_scale;
        let x = (norm_length - 1.0) / scale + 1.0;
        GAUSSIANS.iter().fold((0.0, 0.0), |(value, slope), &[height, center, width, change]| {
            let w = width + change * x;
            let bell = height * (-0.5 * (x - center).powi(2) / (w * w)).exp();
            let by_x = bell * (center - x) * (width + center * change) / (w * w * w);
            (value + bell, slope + by_x / scale)
        })
    }

    fn passive(&self, norm_length: f64) -> (f64, f64) {
        if self.properties.ignore_passive_fiber_force {
            return (0.0, 0.0);
        }
        let strain = self.properties.passive_fiber_strain_at_one_norm_force;
        let start = (K_PE * (SHORTEST - 1.0) / strain).exp();
        let scale = 1.0 / (K_PE.exp() - start);
        let rise = (K_PE * (norm_length - 1.0) / strain).exp();
        ((rise - start) * scale, K_PE / strain * rise * scale)
    }

    /// Slope of the tendon curve by normalized length.
    fn tendon_slope(&self, norm_length: f64) -> f64 {
        C[0] * self.tendon_stiffness * (self.tendon_stiffness * (norm_length - C[1])).exp()
    }

    fn lengths(&self, norm_tendon_force: f64, path_length: f64) -> Lengths {
        let norm = if self.ignore_tendon_compliance {
            1.0
        } else {
            ((norm_tendon_force + C[2]) / C[0]).ln() / self.tendon_stiffness + C[1]
        };
        let tendon = self.tendon_slack_length * norm;
        let along = path_length - tendon;
        let fiber = along.hypot(self.width);
        let norm = fiber / self.optimal_fiber_length;
        let (active, passive) = (self.active(norm).0, self.passive(norm).0);
        Lengths { tendon, fiber, norm, cos: along / fiber, active, passive }
    }

    /// Whether the tendon keeps its length: it is rigid, or nobody says how its force changes.
    fn holds_tendon(&self) -> bool {
        self.ignore_tendon_compliance || self.properties.implicit_tendon_compliance
    }

    /// Normalized fibre velocity and force-velocity multiplier.
    fn velocity(&self, at: &Lengths, norm_tendon_force: f64, activation: f64, path_speed: f64) -> (f64, f64) {
        if self.holds_tendon() {
            return self.multiplier_of(path_speed * at.cos);
        }
        let multiplier = (norm_tendon_force / at.cos - at.passive) / (activation * at.active);
        ((((multiplier - D[3]) / D[0]).sinh() - D[2]) / D[1], multiplier)
    }

    fn multiplier_of(&self, fiber_velocity: f64) -> (f64, f64) {
        let norm = fiber_velocity / (self.max_contraction_velocity * self.optimal_fiber_length);
        (norm, D[0] * (D[1] * norm + D[2]).asinh() + D[3])
    }

    /// Rate of the normalized tendon force [1/s] (0 for a rigid tendon and in implicit mode) and tendon force [N].
    pub fn rates(&self, norm_tendon_force: f64, activation: f64, path_length: f64, path_speed: f64) -> (f64, f64) {
        if self.holds_tendon() {
            return (0.0, self.dynamics(norm_tendon_force, activation, path_length, path_speed).tendon_force);
        }
        let at = self.lengths(norm_tendon_force, path_length);
        let (norm_velocity, _) = self.velocity(&at, norm_tendon_force, activation, path_speed);
        let along = norm_velocity * self.max_contraction_velocity * self.optimal_fiber_length / at.cos;
        let tendon_velocity = (path_speed - along) / self.tendon_slack_length;
        let slope = self.tendon_slope(at.tendon / self.tendon_slack_length);
        (tendon_velocity * slope, self.max_isometric_force * norm_tendon_force)
    }

    /// Every quantity at a state.
    pub fn dynamics(
        &self,
        norm_tendon_force: f64,
        activation: f64,
        path_length: f64,
        path_speed: f64,
    ) -> MuscleDynamics {
        let at = self.lengths(norm_tendon_force, path_length);
        let (norm_velocity, multiplier) = self.velocity(&at, norm_tendon_force, activation, path_speed);
        let force = self.max_isometric_force;
        let l = self.optimal_fiber_length;
        let fiber_velocity = norm_velocity * self.max_contraction_velocity * l;
        let along = fiber_velocity / at.cos;
        let active = force * activation * at.active * multiplier;
        let elastic = force * at.passive;
        let damping = force * self.properties.fiber_damping * norm_velocity;
        let fiber_force = active + elastic + damping;
        let rigid = self.ignore_tendon_compliance;
        let stiffness = force / l * (activation * self.active(at.norm).1 * multiplier + self.passive(at.norm).1);
        let sin = self.width / at.fiber;
        let angle_slope = -self.width / (at.fiber * at.fiber) / (1.0 - sin * sin).sqrt();
        let by_length = stiffness * at.cos - fiber_force * sin * angle_slope;
        let norm_tendon_length = at.tendon / self.tendon_slack_length;
        let passive = elastic + damping;
        MuscleDynamics {
            activation,
            fiber_length: at.fiber,
            normalized_fiber_length: at.norm,
            fiber_length_along_tendon: at.fiber * at.cos,
            pennation_angle: sin.asin(),
            cos_pennation_angle: at.cos,
            tendon_length: at.tendon,
            tendon_strain: norm_tendon_length - 1.0,
            active_force_length_multiplier: at.active,
            passive_force_multiplier: at.passive,
            force_velocity_multiplier: multiplier,
            fiber_velocity,
            normalized_fiber_velocity: norm_velocity,
            fiber_velocity_along_tendon: along,
            pennation_angular_velocity: -fiber_velocity / at.fiber * sin / at.cos,
            tendon_velocity: if self.holds_tendon() { 0.0 } else { path_speed - along },
            fiber_force,
            fiber_force_along_tendon: fiber_force * at.cos,
            active_fiber_force: active,
            active_fiber_force_along_tendon: active * at.cos,
            passive_fiber_force: passive,
            passive_fiber_force_along_tendon: passive * at.cos,
            passive_fiber_elastic_force: elastic,
            passive_fiber_damping_force: damping,
            tendon_force: if rigid { fiber_force * at.cos } else { force * norm_tendon_force },
            fiber_stiffness: stiffness,
            fiber_stiffness_along_tendon: by_length / (at.cos - at.fiber * sin * angle_slope),
            tendon_stiffness: if rigid {
                f64::INFINITY
            } else {
                force / self.tendon_slack_length * self.tendon_slope(norm_tendon_length)
            },
            is_clamped: false,
        }
    }

    /// Normalized tendon force at which the tendon's length rests; `None` if there is none between 0 and 5.
    ///
    /// OpenSim bisects to 1e-10; here, to machine precision.
    ///
    /// # References
    /// OpenSim `DeGrooteFregly2016Muscle::computeInitialFiberEquilibrium`.
    pub fn equilibrium(&self, path_length: f64, path_speed: f64, activation: f64) -> Option<f64> {
        let residual = |tendon: f64| {
            let at = self.lengths(tendon, path_length);
            let (norm_velocity, multiplier) = self.multiplier_of(path_speed * at.cos);
            let damping = self.properties.fiber_damping * norm_velocity;
            tendon - (activation * at.active * multiplier + at.passive + damping) * at.cos
        };
        let (mut low, mut high) = (0.0, STRONGEST);
        let at_low = residual(low);
        if !(at_low * residual(high) < 0.0) {
            return None;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if residual(middle) * at_low > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(0.5 * (low + high))
    }

    /// Active force of the fibre if the tendon were rigid [N], not along the tendon, as in OpenSim.
    pub fn inextensible_tendon_active_fiber_force(&self, path_length: f64, path_speed: f64, activation: f64) -> f64 {
        let rigid = DeGrooteFregly2016 { ignore_tendon_compliance: true, ..self.clone() };
        rigid.dynamics(0.0, activation, path_length, path_speed).active_fiber_force
    }
}

/// Shortest fibre over optimal length that a simulation follows; OpenSim's class has no bound.
const SHORTEST_FIBER: f64 = 0.05;

impl DeGrooteFregly2016 {
    /// Whether the curves are those of another muscle.
    pub fn has_curves_of(&self, other: &DeGrooteFregly2016) -> bool {
        let curves = |m: &DeGrooteFregly2016| {
            let p = m.properties;
            let strains = [p.passive_fiber_strain_at_one_norm_force, p.tendon_strain_at_one_norm_force];
            let others = [p.active_force_width_scale, p.fiber_damping, m.max_contraction_velocity];
            (strains, others, p.ignore_passive_fiber_force)
        };
        curves(self) == curves(other)
    }

    /// f_V and its slope.
    fn force_velocity(norm_velocity: f64) -> ValueAndSlope {
        let argument = D[1] * norm_velocity + D[2];
        (D[0] * argument.asinh() + D[3], D[0] * D[1] / argument.hypot(1.0))
    }
}

/// In OpenSim the fibre's damping acts where the tendon is rigid and where a simulation starts, not on a fibre whose
/// tendon force is a state.
impl MuscleLaw for DeGrooteFregly2016 {
    fn tendon(&self, norm_length: f64) -> ValueAndSlope {
        let slope = self.tendon_slope(norm_length);
        (slope / self.tendon_stiffness - C[2], slope)
    }

    fn active(&self, norm_length: f64) -> ValueAndSlope {
        DeGrooteFregly2016::active(self, norm_length)
    }

    fn passive(&self, norm_length: f64) -> ValueAndSlope {
        DeGrooteFregly2016::passive(self, norm_length)
    }

    fn balance(&self, at: &Contraction) -> Balance {
        balance_of_forces(at, Self::force_velocity(at.u), 0.0)
    }

    fn states_velocity(&self) -> bool {
        false
    }

    fn max_velocity(&self) -> f64 {
        self.max_contraction_velocity
    }

    fn fiber_force(&self, at: &Contraction) -> [f64; 3] {
        force_of_fiber(at, Self::force_velocity(at.u), self.properties.fiber_damping)
    }

    fn shortest(&self) -> f64 {
        SHORTEST_FIBER
    }

    fn start(&self) -> Start {
        Start::TakesSpeed
    }
}
