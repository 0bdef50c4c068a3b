//! The positive properties of muscles that data may determine and that effects change, under one name for all classes.

use super::muscles::{MuscleKind, MuscleSpec, OtherMuscleSpec};

/// A positive property of a muscle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum MuscleProperty {
    /// Force of the fibres at optimal length, full activation and zero velocity [N].
    MaxIsometricForce,
    /// Fibre length of greatest active force [m].
    OptimalFiberLength,
    /// Tendon length above which the tendon pulls [m].
    TendonSlackLength,
    /// Angle between fibre and tendon at optimal fibre length [rad].
    PennationAngle,
    /// β of Millard's muscle.
    FiberDamping,
    /// Tendon strain at maximum isometric force.
    TendonStrain,
    /// Fastest shortening [optimal fibre lengths/s].
    MaxContractionVelocity,
    /// Time constant of activation [s].
    ActivationTimeConstant,
    /// Time constant of deactivation [s].
    DeactivationTimeConstant,
    /// Fibre strain at which the passive force is the maximum isometric force, from the strain where it begins.
    PassiveFiberStrain,
    /// Width of the active force–length curve about its optimum, over that of the class's usual curve.
    ActiveForceWidth,
}

impl MuscleProperty {
    /// All.
    pub const ALL: [MuscleProperty; 11] = [
        MuscleProperty::OptimalFiberLength,
        MuscleProperty::TendonSlackLength,
        MuscleProperty::MaxIsometricForce,
        MuscleProperty::PennationAngle,
        MuscleProperty::FiberDamping,
        MuscleProperty::TendonStrain,
        MuscleProperty::MaxContractionVelocity,
        MuscleProperty::ActivationTimeConstant,
        MuscleProperty::DeactivationTimeConstant,
        MuscleProperty::PassiveFiberStrain,
        MuscleProperty::ActiveForceWidth,
    ];
    /// Those that personalization fits.
    pub const USUAL: [MuscleProperty; 3] =
        [MuscleProperty::OptimalFiberLength, MuscleProperty::TendonSlackLength, MuscleProperty::MaxIsometricForce];

    /// Name for all classes, that of Millard's muscle.
    pub fn name(self) -> &'static str {
        match self {
            MuscleProperty::MaxIsometricForce => "max_isometric_force",
            MuscleProperty::OptimalFiberLength => "optimal_fiber_length",
            MuscleProperty::TendonSlackLength => "tendon_slack_length",
            MuscleProperty::PennationAngle => "pennation_angle_at_optimal",
            MuscleProperty::FiberDamping => "fiber_damping",
            MuscleProperty::TendonStrain => "strain_at_one_norm_force",
            MuscleProperty::MaxContractionVelocity => "max_contraction_velocity",
            MuscleProperty::ActivationTimeConstant => "activation_time_constant",
            MuscleProperty::DeactivationTimeConstant => "deactivation_time_constant",
            MuscleProperty::PassiveFiberStrain => "passive_fiber_strain_at_one_norm_force",
            MuscleProperty::ActiveForceWidth => "active_force_width",
        }
    }

    /// How people call it.
    pub fn words(self) -> &'static str {
        match self {
            MuscleProperty::MaxIsometricForce => "strength",
            MuscleProperty::OptimalFiberLength => "optimal fibre length",
            MuscleProperty::TendonSlackLength => "tendon slack length",
            MuscleProperty::PennationAngle => "pennation",
            MuscleProperty::FiberDamping => "fibre damping",
            MuscleProperty::TendonStrain => "tendon strain",
            MuscleProperty::MaxContractionVelocity => "maximum velocity",
            MuscleProperty::ActivationTimeConstant => "activation time",
            MuscleProperty::DeactivationTimeConstant => "deactivation time",
            MuscleProperty::PassiveFiberStrain => "passive fibre strain",
            MuscleProperty::ActiveForceWidth => "width of the active force–length curve",
        }
    }

    /// Unit in the file.
    pub fn unit(self) -> &'static str {
        match self {
            MuscleProperty::MaxIsometricForce => "N",
            MuscleProperty::OptimalFiberLength | MuscleProperty::TendonSlackLength => "m",
            MuscleProperty::PennationAngle => "rad",
            MuscleProperty::FiberDamping
            | MuscleProperty::TendonStrain
            | MuscleProperty::PassiveFiberStrain
            | MuscleProperty::ActiveForceWidth => "",
            MuscleProperty::MaxContractionVelocity => "1/s",
            MuscleProperty::ActivationTimeConstant | MuscleProperty::DeactivationTimeConstant => "s",
        }
    }

    /// Property of that name.
    pub fn from_name(name: &str) -> Option<MuscleProperty> {
        Self::ALL.into_iter().find(|p| p.name() == name)
    }

    /// Its value in a muscle; `None` where the force of the muscle's class, as the muscle uses it, does not depend on
    /// such a property.
    pub fn of(self, muscle: &MuscleSpec) -> Option<f64> {
        let law = match &muscle.kind {
            MuscleKind::Millard2012Equilibrium(_) => None,
            MuscleKind::OtherClass { law, .. } => Some(law.as_deref()?),
        };
        let rigid = muscle.ignore_tendon_compliance || matches!(law, Some(OtherMuscleSpec::RigidTendon(_)));
        let deprecated = matches!(law, Some(OtherMuscleSpec::Deprecated(_)));
        match self {
            MuscleProperty::MaxIsometricForce => return Some(muscle.max_isometric_force),
            MuscleProperty::OptimalFiberLength => return Some(muscle.optimal_fiber_length),
            MuscleProperty::TendonSlackLength => return Some(muscle.tendon_slack_length),
            MuscleProperty::PennationAngle => return Some(muscle.pennation_angle_at_optimal),
            MuscleProperty::MaxContractionVelocity => return (!deprecated).then_some(muscle.max_contraction_velocity),
            MuscleProperty::TendonStrain if rigid => return None,
            MuscleProperty::ActivationTimeConstant | MuscleProperty::DeactivationTimeConstant
                if muscle.ignore_activation_dynamics =>
            {
                return None;
            }
            _ => {}
        }
        match (&muscle.kind, law) {
            (MuscleKind::Millard2012Equilibrium(own), _) => match self {
                MuscleProperty::FiberDamping => Some(own.fiber_damping),
                MuscleProperty::TendonStrain => Some(own.tendon_force_length.strain_at_one_norm_force),
                MuscleProperty::ActivationTimeConstant => Some(own.activation_time_constant),
                MuscleProperty::DeactivationTimeConstant => Some(own.deactivation_time_constant),
                MuscleProperty::PassiveFiberStrain => {
                    let curve = &own.fiber_force_length;
                    Some(curve.strain_at_one_norm_force - curve.strain_at_zero_force)
                }
                MuscleProperty::ActiveForceWidth => Some(1.0),
                _ => None,
            },
            (_, Some(OtherMuscleSpec::Thelen2003(own))) => match self {
                MuscleProperty::TendonStrain => Some(own.fmax_tendon_strain),
                MuscleProperty::ActivationTimeConstant => Some(own.activation_time_constant),
                MuscleProperty::DeactivationTimeConstant => Some(own.deactivation_time_constant),
                MuscleProperty::PassiveFiberStrain => Some(own.fmax_muscle_strain),
                // Lengths enter by their square over it.
                MuscleProperty::ActiveForceWidth => Some((own.kshape_active / USUAL_KSHAPE_ACTIVE).sqrt()),
                _ => None,
            },
            (_, Some(OtherMuscleSpec::DeGrooteFregly2016(own))) => match self {
                MuscleProperty::TendonStrain => Some(own.tendon_strain_at_one_norm_force),
                MuscleProperty::ActivationTimeConstant => Some(own.activation_time_constant),
                MuscleProperty::DeactivationTimeConstant => Some(own.deactivation_time_constant),
                MuscleProperty::PassiveFiberStrain if own.ignore_passive_fiber_force => None,
                MuscleProperty::PassiveFiberStrain => Some(own.passive_fiber_strain_at_one_norm_force),
                // OpenSim refuses a curve narrower than the usual one, so that its width is not free.
                _ => None,
            },
            _ => None,
        }
    }

    /// Multiplies it in a muscle; nothing where [`MuscleProperty::of`] finds none.
    pub fn scale(self, muscle: &mut MuscleSpec, factor: f64) {
        if self.of(muscle).is_none() {
            return;
        }
        match self {
            MuscleProperty::MaxIsometricForce => muscle.max_isometric_force *= factor,
            MuscleProperty::OptimalFiberLength => muscle.optimal_fiber_length *= factor,
            MuscleProperty::TendonSlackLength => muscle.tendon_slack_length *= factor,
            MuscleProperty::PennationAngle => muscle.pennation_angle_at_optimal *= factor,
            MuscleProperty::MaxContractionVelocity => muscle.max_contraction_velocity *= factor,
            _ => self.scale_own(&mut muscle.kind, factor),
        }
    }

    /// Of properties that not all classes have.
    fn scale_own(self, kind: &mut MuscleKind, factor: f64) {
        let law = match kind {
            MuscleKind::Millard2012Equilibrium(own) => {
                match self {
                    MuscleProperty::FiberDamping => own.fiber_damping *= factor,
                    MuscleProperty::TendonStrain => {
                        // Stiffness falls with the strain, as OpenSim's default curve has it: 1.375 over the strain.
                        own.tendon_force_length.strain_at_one_norm_force *= factor;
                        own.tendon_force_length.stiffness_at_one_norm_force.iter_mut().for_each(|k| *k /= factor);
                    }
                    MuscleProperty::ActivationTimeConstant => own.activation_time_constant *= factor,
                    MuscleProperty::DeactivationTimeConstant => own.deactivation_time_constant *= factor,
                    MuscleProperty::PassiveFiberStrain => {
                        let curve = &mut own.fiber_force_length;
                        let range = curve.strain_at_one_norm_force - curve.strain_at_zero_force;
                        curve.strain_at_one_norm_force = curve.strain_at_zero_force + range * factor;
                        curve.stiffness_at_low_force.iter_mut().for_each(|stiffness| *stiffness /= factor);
                        curve.stiffness_at_one_norm_force.iter_mut().for_each(|stiffness| *stiffness /= factor);
                    }
                    MuscleProperty::ActiveForceWidth => {
                        let curve = &mut own.active_force_length;
                        let stretch = |length: &mut f64| *length = 1.0 + (*length - 1.0) * factor;
                        stretch(&mut curve.min_norm_active_fiber_length);
                        stretch(&mut curve.transition_norm_fiber_length);
                        stretch(&mut curve.max_norm_active_fiber_length);
                        curve.shallow_ascending_slope /= factor;
                    }
                    _ => {}
                }
                return;
            }
            MuscleKind::OtherClass { law, .. } => law.as_deref_mut(),
        };
        match law {
            Some(OtherMuscleSpec::Thelen2003(own)) => match self {
                MuscleProperty::TendonStrain => own.fmax_tendon_strain *= factor,
                MuscleProperty::ActivationTimeConstant => own.activation_time_constant *= factor,
                MuscleProperty::DeactivationTimeConstant => own.deactivation_time_constant *= factor,
                MuscleProperty::PassiveFiberStrain => own.fmax_muscle_strain *= factor,
                MuscleProperty::ActiveForceWidth => own.kshape_active *= factor * factor,
                _ => {}
            },
            Some(OtherMuscleSpec::DeGrooteFregly2016(own)) => match self {
                MuscleProperty::TendonStrain => own.tendon_strain_at_one_norm_force *= factor,
                MuscleProperty::ActivationTimeConstant => own.activation_time_constant *= factor,
                MuscleProperty::DeactivationTimeConstant => own.deactivation_time_constant *= factor,
                MuscleProperty::PassiveFiberStrain => own.passive_fiber_strain_at_one_norm_force *= factor,
                _ => {}
            },
            _ => {}
        }
    }
}

/// `KshapeActive` of OpenSim's Thelen2003Muscle by default.
const USUAL_KSHAPE_ACTIVE: f64 = 0.45;

impl MuscleSpec {
    /// OpenSim's name of the class.
    pub fn class(&self) -> &str {
        match &self.kind {
            MuscleKind::Millard2012Equilibrium(_) => "Millard2012EquilibriumMuscle",
            MuscleKind::OtherClass { class, .. } => class,
        }
    }

    /// Whether its force is computed.
    pub fn is_computed(&self) -> bool {
        !matches!(self.kind, MuscleKind::OtherClass { law: None, .. })
    }

    /// The properties of its class that effects change, as
    /// [`OsimFile::set_muscle_properties`](crate::osim::OsimFile::set_muscle_properties) names them, with their values.
    /// Properties that OpenSim computes itself where the file gives none are left out then.
    pub fn changeable_properties(&self) -> Vec<(&'static str, f64)> {
        let mut all = vec![("max_contraction_velocity", self.max_contraction_velocity)];
        match &self.kind {
            MuscleKind::Millard2012Equilibrium(p) => {
                let (active, passive, tendon) = (&p.active_force_length, &p.fiber_force_length, &p.tendon_force_length);
                all.extend([
                    ("activation_time_constant", p.activation_time_constant),
                    ("deactivation_time_constant", p.deactivation_time_constant),
                    ("ActiveForceLengthCurve/min_norm_active_fiber_length", active.min_norm_active_fiber_length),
                    ("ActiveForceLengthCurve/transition_norm_fiber_length", active.transition_norm_fiber_length),
                    ("ActiveForceLengthCurve/max_norm_active_fiber_length", active.max_norm_active_fiber_length),
                    ("ActiveForceLengthCurve/shallow_ascending_slope", active.shallow_ascending_slope),
                    ("FiberForceLengthCurve/strain_at_one_norm_force", passive.strain_at_one_norm_force),
                    ("TendonForceLengthCurve/strain_at_one_norm_force", tendon.strain_at_one_norm_force),
                ]);
                let optional = [
                    ("FiberForceLengthCurve/stiffness_at_low_force", passive.stiffness_at_low_force),
                    ("FiberForceLengthCurve/stiffness_at_one_norm_force", passive.stiffness_at_one_norm_force),
                    ("TendonForceLengthCurve/stiffness_at_one_norm_force", tendon.stiffness_at_one_norm_force),
                ];
                all.extend(optional.into_iter().filter_map(|(name, value)| value.map(|value| (name, value))));
            }
            MuscleKind::OtherClass { law, .. } => match law.as_deref() {
                Some(OtherMuscleSpec::Thelen2003(p)) => all.extend([
                    ("activation_time_constant", p.activation_time_constant),
                    ("deactivation_time_constant", p.deactivation_time_constant),
                    ("FmaxTendonStrain", p.fmax_tendon_strain),
                    ("FmaxMuscleStrain", p.fmax_muscle_strain),
                    ("KshapeActive", p.kshape_active),
                ]),
                Some(OtherMuscleSpec::DeGrooteFregly2016(p)) => all.extend([
                    ("activation_time_constant", p.activation_time_constant),
                    ("deactivation_time_constant", p.deactivation_time_constant),
                    ("tendon_strain_at_one_norm_force", p.tendon_strain_at_one_norm_force),
                    ("passive_fiber_strain_at_one_norm_force", p.passive_fiber_strain_at_one_norm_force),
                    ("active_force_width_scale", p.active_force_width_scale),
                ]),
                Some(OtherMuscleSpec::RigidTendon(_) | OtherMuscleSpec::Deprecated(_)) | None => {}
            },
        }
        all
    }
}
