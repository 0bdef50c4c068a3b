//! OpenSim's `RigidTendonMuscle`: no states, the activation is the control.

use super::dynamics::MuscleDynamics;
use super::error::MuscleError;
use super::law::{Balance, Contraction, MuscleLaw, RigidTendonRule, ValueAndSlope, balance_of_forces, force_of_fiber};
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{MuscleSpec, RigidTendonSpec};

/// A muscle whose tendon has its slack length always. Units as [`Millard2012`](super::Millard2012).
///
/// As in OpenSim, the fibre's velocity is that of the path, whatever the pennation angle.
#[derive(Clone, Debug)]
pub struct RigidTendon {
    /// Name.
    pub name: String,
    /// Maximum isometric force [N].
    pub max_isometric_force: f64,
    /// Optimal fibre length [m].
    pub optimal_fiber_length: f64,
    /// Tendon slack length [m].
    pub tendon_slack_length: f64,
    /// Maximum contraction velocity [optimal fibre lengths/s].
    pub max_contraction_velocity: f64,
    /// Height of the fibre over the tendon [m].
    width: f64,
    active: Function,
    passive: Function,
    force_velocity: Function,
    /// Curves as the file has them.
    curves: RigidTendonSpec,
}

impl RigidTendon {
    pub(super) fn build(spec: &MuscleSpec, own: &RigidTendonSpec) -> Result<RigidTendon, MuscleError> {
        let curve = MuscleError::function;
        let velocity = spec.max_contraction_velocity;
        MuscleError::require(velocity > 0.0, "max_contraction_velocity", "a number above 0", velocity)?;
        Ok(RigidTendon {
            name: spec.name.clone(),
            max_isometric_force: spec.max_isometric_force,
            optimal_fiber_length: spec.optimal_fiber_length,
            tendon_slack_length: spec.tendon_slack_length,
            max_contraction_velocity: velocity,
            width: spec.optimal_fiber_length * spec.pennation_angle_at_optimal.sin(),
            active: curve("active_force_length_curve", &own.active_force_length_curve)?,
            passive: curve("passive_force_length_curve", &own.passive_force_length_curve)?,
            force_velocity: curve("force_velocity_curve", &own.force_velocity_curve)?,
            curves: own.clone(),
        })
    }

    /// Fibre length [m] and cosine of the pennation angle for a path length.
    fn fiber(&self, path_length: f64) -> (f64, f64) {
        let along = (path_length - self.tendon_slack_length).max(0.0);
        if self.width > f64::EPSILON.sqrt() {
            let length = along.hypot(self.width);
            (length, along / length)
        } else {
            (along, 1.0)
        }
    }

    /// Fibre length [m] for a path length.
    pub fn fiber_length(&self, path_length: f64) -> f64 {
        self.fiber(path_length).0
    }

    /// Every quantity for a control, length and lengthening speed of the path.
    pub fn dynamics(&self, control: f64, path_length: f64, path_speed: f64) -> MuscleDynamics {
        let (length, cos) = self.fiber(path_length);
        let norm_length = length / self.optimal_fiber_length;
        let (active_multiplier, passive_multiplier) =
            (self.active.value(norm_length), self.passive.value(norm_length).clamp(0.0, STRONGEST_PASSIVE));
        let norm_velocity = path_speed / (self.optimal_fiber_length * self.max_contraction_velocity);
        let multiplier = self.force_velocity.value(norm_velocity);
        let force = self.max_isometric_force;
        let active = force * control * active_multiplier * multiplier;
        let passive = force * passive_multiplier;
        let total = active + passive;
        let slope = control * self.active.derivative(norm_length) * multiplier + self.passive.derivative(norm_length);
        let angle = cos.acos();
        MuscleDynamics {
            activation: control,
            fiber_length: length,
            normalized_fiber_length: norm_length,
            fiber_length_along_tendon: length * cos,
            pennation_angle: angle,
            cos_pennation_angle: cos,
            tendon_length: self.tendon_slack_length,
            tendon_strain: 0.0,
            active_force_length_multiplier: active_multiplier,
            passive_force_multiplier: passive_multiplier,
            force_velocity_multiplier: multiplier,
            fiber_velocity: path_speed,
            normalized_fiber_velocity: norm_velocity,
            fiber_velocity_along_tendon: path_speed,
            pennation_angular_velocity: if cos > 0.0 { -path_speed / length * angle.sin() } else { 0.0 },
            tendon_velocity: 0.0,
            fiber_force: total,
            fiber_force_along_tendon: total * cos,
            active_fiber_force: active,
            active_fiber_force_along_tendon: active * cos,
            passive_fiber_force: passive,
            passive_fiber_force_along_tendon: passive * cos,
            passive_fiber_elastic_force: passive,
            passive_fiber_damping_force: 0.0,
            tendon_force: total * cos,
            fiber_stiffness: slope * force / self.optimal_fiber_length,
            // OpenSim has no stiffness along the tendon of this class.
            fiber_stiffness_along_tendon: f64::NAN,
            tendon_stiffness: f64::INFINITY,
            is_clamped: false,
        }
    }
}

/// Greatest passive force over maximum isometric force.
const STRONGEST_PASSIVE: f64 = 10.0;

impl RigidTendon {
    /// Whether the curves are those of another muscle.
    pub fn has_curves_of(&self, other: &RigidTendon) -> bool {
        self.curves == other.curves && self.max_contraction_velocity == other.max_contraction_velocity
    }
}

/// A tendon that keeps its length bears whatever force the fibre has.
impl MuscleLaw for RigidTendon {
    fn tendon(&self, _norm_length: f64) -> ValueAndSlope {
        (f64::NAN, f64::INFINITY)
    }

    fn active(&self, norm_length: f64) -> ValueAndSlope {
        (self.active.value(norm_length), self.active.derivative(norm_length))
    }

    fn passive(&self, norm_length: f64) -> ValueAndSlope {
        let value = self.passive.value(norm_length);
        let bounded = value.clamp(0.0, STRONGEST_PASSIVE);
        (bounded, if bounded == value { self.passive.derivative(norm_length) } else { 0.0 })
    }

    fn balance(&self, at: &Contraction) -> Balance {
        balance_of_forces(at, (self.force_velocity.value(at.u), self.force_velocity.derivative(at.u)), 0.0)
    }

    fn states_velocity(&self) -> bool {
        false
    }

    fn max_velocity(&self) -> f64 {
        self.max_contraction_velocity
    }

    fn fiber_force(&self, at: &Contraction) -> [f64; 3] {
        force_of_fiber(at, (self.force_velocity.value(at.u), self.force_velocity.derivative(at.u)), 0.0)
    }

    fn rigid_tendon_rule(&self) -> RigidTendonRule {
        RigidTendonRule::FollowsPath
    }
}
