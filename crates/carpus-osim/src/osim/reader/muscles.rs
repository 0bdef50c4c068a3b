//! Muscles and their curves. Default values are those of the constructors in OpenSim 4.6.

use super::object::Object;
use super::properties::Bound;
use super::state::Reader;
use crate::osim::diagnostics::Severity;
use crate::osim::document::ElementId;
use crate::osim::spec::{
    ActiveForceLengthSpec, FiberForceLengthSpec, ForceKind, ForceSpec, ForceVelocitySpec, Millard2012Spec, MuscleKind,
    MuscleSpec, TendonForceLengthSpec, Thelen2003Spec,
};

/// Muscle classes of OpenSim.
pub(super) fn is_muscle(tag: &str) -> bool {
    matches!(
        tag,
        "Millard2012EquilibriumMuscle"
            | "Millard2012AccelerationMuscle"
            | "Thelen2003Muscle"
            | "Thelen2003Muscle_Deprecated"
            | "Schutte1993Muscle"
            | "Schutte1993Muscle_Deprecated"
            | "Delp1990Muscle"
            | "Delp1990Muscle_Deprecated"
            | "RigidTendonMuscle"
            | "DeGrooteFregly2016Muscle"
            | "MeyerFregly2016Muscle"
    )
}

const LENGTH: Bound = Bound::Positive("a length greater than 0 m");
const FORCE: Bound = Bound::NotNegative("a force of 0 N or more");
pub(super) const FRACTION: Bound = Bound::NotNegative("a number of 0 or more");
const TIME: Bound = Bound::Positive("a time greater than 0 s");

impl Reader<'_> {
    pub(super) fn read_muscle(&mut self, element: ElementId, object: &Object, name: String) {
        let class = self.document.tag(element).to_owned();
        let path = match self.read_path(object) {
            Ok(path) => path,
            Err(path_class) => {
                let message = format!("muscle with a path of class {path_class}: neither path nor force is computed");
                self.diagnose(Severity::Unsupported, element, &object.path, message, None);
                self.mark_all(element);
                let applies_force = self.enabled(object, "appliesForce");
                let at = self.location(object);
                self.spec.forces.push(ForceSpec { name, at, applies_force, kind: ForceKind::Unsupported { class } });
                return;
            }
        };
        let ignore_tendon_compliance = self.boolean(object, &["ignore_tendon_compliance"], false);
        let is_millard = class == "Millard2012EquilibriumMuscle";
        // A tendon of no length can only be rigid.
        let slack = match is_millard && !ignore_tendon_compliance {
            true => LENGTH,
            false => Bound::NotNegative("a length of 0 m or more"),
        };
        let velocity = match is_millard {
            true => Bound::Positive("a velocity greater than 0 optimal fibre lengths per second"),
            false => Bound::Finite,
        };
        let minimum_control = if is_millard || class == "Thelen2003Muscle" { 0.01 } else { 0.0 };
        let spec = MuscleSpec {
            at: self.location(object),
            applies_force: self.enabled(object, "appliesForce"),
            max_isometric_force: self.number(object, &["max_isometric_force"], 1000.0, FORCE),
            optimal_fiber_length: self.number(object, &["optimal_fiber_length"], 0.1, LENGTH),
            tendon_slack_length: self.number(object, &["tendon_slack_length"], 0.2, slack),
            pennation_angle_at_optimal: self.number(object, self.version.pennation_angle_names(), 0.0, Bound::Finite),
            max_contraction_velocity: self.number(object, &["max_contraction_velocity"], 10.0, velocity),
            ignore_tendon_compliance,
            ignore_activation_dynamics: self.boolean(object, &["ignore_activation_dynamics"], false),
            min_control: self.control(object, "min_control", minimum_control),
            max_control: self.control(object, "max_control", 1.0),
            kind: if is_millard {
                MuscleKind::Millard2012Equilibrium(Box::new(self.read_millard(object)))
            } else {
                MuscleKind::OtherClass {
                    class: class.clone(),
                    law: self.read_other_muscle(element, object, &class).map(Box::new),
                }
            },
            path,
            name,
        };
        match spec.is_computed() {
            true => self.diagnostics.understood(&class),
            false => {
                let message = format!("{class}: its path is used, its force is not computed");
                let hint = "convert the muscle to Millard2012EquilibriumMuscle to simulate its force".to_owned();
                self.diagnose(Severity::Unsupported, element, &object.path, message, Some(hint));
            }
        }
        self.spec.muscles.push(spec);
    }

    /// `min_control`, `max_control`: in old files the trivial value gives way to the class' default.
    fn control(&mut self, object: &Object, property: &'static str, default: f64) -> f64 {
        let value = self.number(object, &[property], default, Bound::Any);
        if self.version.ignores_control(property, value) { default } else { value }
    }

    pub(super) fn read_thelen(&mut self, object: &Object) -> Thelen2003Spec {
        let mut positive = |name, default| self.number(object, &[name], default, Bound::Positive("a number above 0"));
        Thelen2003Spec {
            fmax_tendon_strain: positive("FmaxTendonStrain", 0.04),
            fmax_muscle_strain: positive("FmaxMuscleStrain", 0.6),
            kshape_active: positive("KshapeActive", 0.45),
            kshape_passive: positive("KshapePassive", 5.0),
            af: positive("Af", 0.25),
            flen: positive("Flen", 1.4),
            fv_linear_extrap_threshold: positive("fv_linear_extrap_threshold", 0.95),
            maximum_pennation_angle: positive("maximum_pennation_angle", 0.1_f64.acos()),
            activation_time_constant: positive("activation_time_constant", 0.015),
            deactivation_time_constant: positive("deactivation_time_constant", 0.050),
            minimum_activation: self.number(object, &["minimum_activation"], 0.01, FRACTION),
            default_activation: self.number(object, &["default_activation"], 0.05, FRACTION),
            default_fiber_length: self.number(object, &["default_fiber_length"], 0.1, LENGTH),
        }
    }

    fn read_millard(&mut self, object: &Object) -> Millard2012Spec {
        Millard2012Spec {
            fiber_damping: self.number(object, &["fiber_damping"], 0.1, FRACTION),
            // The constructor copies its own optimal fibre length, not that of the file.
            default_fiber_length: self.number(object, &["default_fiber_length"], 0.1, LENGTH),
            default_activation: self.number(object, &["default_activation"], 0.05, FRACTION),
            minimum_activation: self.number(object, &["minimum_activation"], 0.01, FRACTION),
            activation_time_constant: self.number(object, &["activation_time_constant"], 0.010, TIME),
            deactivation_time_constant: self.number(object, &["deactivation_time_constant"], 0.040, TIME),
            maximum_pennation_angle: self.number(object, &["maximum_pennation_angle"], 0.1_f64.acos(), Bound::Finite),
            active_force_length: self.read_active_force_length(object),
            force_velocity: self.read_force_velocity(object),
            fiber_force_length: self.read_fiber_force_length(object),
            tendon_force_length: self.read_tendon_force_length(object),
        }
    }

    fn read_active_force_length(&mut self, muscle: &Object) -> ActiveForceLengthSpec {
        let curve = self.nested(muscle, "ActiveForceLengthCurve");
        let mut value = |name, default| self.number(&curve, &[name], default, Bound::Finite);
        ActiveForceLengthSpec {
            min_norm_active_fiber_length: value("min_norm_active_fiber_length", 0.47 - 0.0259),
            transition_norm_fiber_length: value("transition_norm_fiber_length", 0.73),
            max_norm_active_fiber_length: value("max_norm_active_fiber_length", 1.8123),
            shallow_ascending_slope: value("shallow_ascending_slope", 0.8616),
            minimum_value: value("minimum_value", 0.1),
        }
    }

    fn read_force_velocity(&mut self, muscle: &Object) -> ForceVelocitySpec {
        let curve = self.nested(muscle, "ForceVelocityCurve");
        let mut value = |name, default| self.number(&curve, &[name], default, Bound::Finite);
        ForceVelocitySpec {
            concentric_slope_at_vmax: value("concentric_slope_at_vmax", 0.0),
            concentric_slope_near_vmax: value("concentric_slope_near_vmax", 0.25),
            isometric_slope: value("isometric_slope", 5.0),
            eccentric_slope_at_vmax: value("eccentric_slope_at_vmax", 0.0),
            eccentric_slope_near_vmax: value("eccentric_slope_near_vmax", 0.15),
            max_eccentric_velocity_force_multiplier: value("max_eccentric_velocity_force_multiplier", 1.4),
            concentric_curviness: value("concentric_curviness", 0.6),
            eccentric_curviness: value("eccentric_curviness", 0.9),
        }
    }

    fn read_fiber_force_length(&mut self, muscle: &Object) -> FiberForceLengthSpec {
        let curve = self.nested(muscle, "FiberForceLengthCurve");
        FiberForceLengthSpec {
            strain_at_zero_force: self.number(&curve, &["strain_at_zero_force"], 0.0, Bound::Finite),
            strain_at_one_norm_force: self.number(&curve, &["strain_at_one_norm_force"], 0.7, Bound::Finite),
            stiffness_at_low_force: self.optional_number(&curve, &["stiffness_at_low_force"], Bound::Finite),
            stiffness_at_one_norm_force: self.optional_number(&curve, &["stiffness_at_one_norm_force"], Bound::Finite),
            curviness: self.optional_number(&curve, &["curviness"], Bound::Finite),
        }
    }

    fn read_tendon_force_length(&mut self, muscle: &Object) -> TendonForceLengthSpec {
        let curve = self.nested(muscle, "TendonForceLengthCurve");
        TendonForceLengthSpec {
            strain_at_one_norm_force: self.number(&curve, &["strain_at_one_norm_force"], 0.049, Bound::Finite),
            stiffness_at_one_norm_force: self.optional_number(&curve, &["stiffness_at_one_norm_force"], Bound::Finite),
            norm_force_at_toe_end: self.optional_number(&curve, &["norm_force_at_toe_end"], Bound::Finite),
            curviness: self.optional_number(&curve, &["curviness"], Bound::Finite),
        }
    }
}
