//! Muscles other than Millard's: properties and default curves, which are those of the constructors in OpenSim 4.6.

use super::functions::is_function;
use super::muscles::FRACTION;
use super::object::Object;
use super::properties::Bound;
use super::state::Reader;
use super::upgrade::present_class;
use crate::osim::diagnostics::Severity;
use crate::osim::document::ElementId;
use crate::osim::error::ProblemKind;
use crate::osim::spec::{
    DeGrooteFregly2016Spec, DeprecatedMuscleKind, DeprecatedMuscleSpec, FunctionSpec, OtherMuscleSpec, RigidTendonSpec,
};

/// Abscissae and ordinates of a curve.
type Curve = (&'static [f64], &'static [f64]);

const TENDON: Curve = (
    &[
        -10.0, -0.002, -0.001, 0.0, 0.00131, 0.00281, 0.00431, 0.00581, 0.00731, 0.00881, 0.0103, 0.0118, 0.0123, 9.2,
        9.201, 9.202, 20.0,
    ],
    &[
        0.0, 0.0, 0.0, 0.0, 0.0108, 0.0257, 0.0435, 0.0652, 0.0915, 0.123, 0.161, 0.208, 0.227, 345.0, 345.0, 345.0,
        345.0,
    ],
);
const ACTIVE: Curve = (
    &[
        -5.307692, -4.307692, -1.923077, -0.884615, -0.269231, 0.230769, 0.461538, 0.52725, 0.62875, 0.71875, 0.86125,
        1.045, 1.2175, 1.43875, 1.5, 1.615385, 2.0, 2.961538, 3.692308, 5.461538, 9.901902,
    ],
    &[
        0.012188, 0.021899, 0.036466, 0.052493, 0.075312, 0.114158, 0.157859, 0.226667, 0.636667, 0.856667, 0.95,
        0.993333, 0.77, 0.246667, 0.193821, 0.133252, 0.072683, 0.044417, 0.036341, 0.021899, 0.007332,
    ],
);
const PASSIVE: Curve = (
    &[-5.0, 0.998, 0.999, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.601, 1.602, 5.0],
    &[0.0, 0.0, 0.0, 0.0, 0.035, 0.12, 0.26, 0.55, 1.17, 2.0, 2.0, 2.0, 2.0],
);
const FORCE_VELOCITY: Curve = (
    &[
        -1.001, -1.0, -0.95, -0.9, -0.85, -0.8, -0.75, -0.7, -0.65, -0.6, -0.55, -0.5, -0.45, -0.4, -0.35, -0.3, -0.25,
        -0.2, -0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7,
        0.75, 0.8, 0.85, 0.9, 0.95, 1.0,
    ],
    &[
        0.0, 0.0, 0.010417, 0.021739, 0.034091, 0.047619, 0.0625, 0.078947, 0.097222, 0.117647, 0.140625, 0.166667,
        0.196429, 0.230769, 0.270833, 0.318182, 0.375, 0.444444, 0.53125, 0.642857, 0.791667, 1.0, 1.482014, 1.601571,
        1.655791, 1.686739, 1.706751, 1.720753, 1.731099, 1.739055, 1.745365, 1.75049, 1.754736, 1.758312, 1.761364,
        1.763999, 1.766298, 1.768321, 1.770115, 1.771717, 1.773155, 1.774455,
    ],
);

impl Reader<'_> {
    /// Properties of a muscle of a class that is simulated; `None` for other classes.
    pub(super) fn read_other_muscle(
        &mut self,
        element: ElementId,
        object: &Object,
        class: &str,
    ) -> Option<OtherMuscleSpec> {
        Some(match present_class(class) {
            "Thelen2003Muscle" => OtherMuscleSpec::Thelen2003(self.read_thelen(object)),
            "DeGrooteFregly2016Muscle" => OtherMuscleSpec::DeGrooteFregly2016(self.read_degroote(element, object)),
            "RigidTendonMuscle" => OtherMuscleSpec::RigidTendon(RigidTendonSpec {
                active_force_length_curve: self.curve(object, "active_force_length_curve", ACTIVE),
                passive_force_length_curve: self.curve(object, "passive_force_length_curve", PASSIVE),
                force_velocity_curve: self.curve(object, "force_velocity_curve", FORCE_VELOCITY),
            }),
            "Schutte1993Muscle_Deprecated" => {
                let damping = self.number(object, &["damping"], 0.1, Bound::Finite);
                let passive = self.given_curve(object, "passive_force_length_curve");
                let tendon = self.curve(object, "tendon_force_length_curve", TENDON);
                let active = self.curve(object, "active_force_length_curve", ACTIVE);
                self.read_deprecated(object, [tendon, active], passive, DeprecatedMuscleKind::Schutte1993 { damping })
            }
            "Delp1990Muscle_Deprecated" => {
                let kind = DeprecatedMuscleKind::Delp1990 {
                    mass: self.number(object, &["mass"], 0.00287, Bound::Finite),
                    force_velocity_curve: self.nested_curve(object, "force_velocity_curve", FORCE_VELOCITY),
                };
                let passive = Some(self.nested_curve(object, "passive_force_length_curve", PASSIVE));
                let tendon = self.nested_curve(object, "tendon_force_length_curve", TENDON);
                let active = self.nested_curve(object, "active_force_length_curve", ACTIVE);
                self.read_deprecated(object, [tendon, active], passive, kind)
            }
            _ => return None,
        })
    }

    fn read_deprecated(
        &mut self,
        object: &Object,
        [tendon_force_length_curve, active_force_length_curve]: [FunctionSpec; 2],
        passive_force_length_curve: Option<FunctionSpec>,
        kind: DeprecatedMuscleKind,
    ) -> OtherMuscleSpec {
        OtherMuscleSpec::Deprecated(DeprecatedMuscleSpec {
            time_scale: self.number(object, &["time_scale"], 0.1, Bound::Finite),
            activation1: self.number(object, &["activation1"], 7.667, FRACTION),
            activation2: self.number(object, &["activation2"], 1.459854, FRACTION),
            tendon_force_length_curve,
            active_force_length_curve,
            passive_force_length_curve,
            kind,
        })
    }

    fn read_degroote(&mut self, element: ElementId, object: &Object) -> DeGrooteFregly2016Spec {
        let mode = self.string(object, &["tendon_compliance_dynamics_mode"]);
        let implicit_tendon_compliance = mode.is_some_and(|(_, mode)| mode != "explicit");
        if implicit_tendon_compliance {
            let message =
                "tendon_compliance_dynamics_mode is implicit: run-tool holds the tendon force, as OpenSim's tools do";
            let hint = "set it to explicit to simulate the tendon".to_owned();
            self.diagnose(Severity::Warning, element, &object.path, message.to_owned(), Some(hint));
        }
        let mut positive = |name, default| self.number(object, &[name], default, Bound::Positive("a number above 0"));
        let activation_time_constant = positive("activation_time_constant", 0.015);
        let deactivation_time_constant = positive("deactivation_time_constant", 0.060);
        let default_activation = positive("default_activation", 0.5);
        let active_force_width_scale = positive("active_force_width_scale", 1.0);
        let passive_fiber_strain_at_one_norm_force = positive("passive_fiber_strain_at_one_norm_force", 0.6);
        let tendon_strain_at_one_norm_force = positive("tendon_strain_at_one_norm_force", 0.049);
        let activation_dynamics_smoothing = positive("activation_dynamics_smoothing", 0.1);
        DeGrooteFregly2016Spec {
            activation_time_constant,
            deactivation_time_constant,
            default_activation,
            default_normalized_tendon_force: self.number(object, &["default_normalized_tendon_force"], 0.5, FRACTION),
            implicit_tendon_compliance,
            active_force_width_scale,
            fiber_damping: self.number(object, &["fiber_damping"], 0.0, FRACTION),
            passive_fiber_strain_at_one_norm_force,
            tendon_strain_at_one_norm_force,
            ignore_passive_fiber_force: self.boolean(object, &["ignore_passive_fiber_force"], false),
            activation_dynamics_smoothing,
        }
    }

    /// A curve of the file, or the default one.
    fn curve(&mut self, object: &Object, name: &'static str, (x, y): Curve) -> FunctionSpec {
        self.given_curve(object, name).unwrap_or_else(|| FunctionSpec::SimmSpline { x: x.to_vec(), y: y.to_vec() })
    }

    /// A curve that OpenSim declares as an optional property, and therefore reads in the form `<name><Class>…` alone.
    fn nested_curve(&mut self, object: &Object, name: &'static str, default: Curve) -> FunctionSpec {
        let nested = self.property(object, &[name]).is_some();
        if let (false, Some(Some(element))) = (nested, self.one_object(object, name, is_function)) {
            let (x, y) = default;
            let own = FunctionSpec::SimmSpline { x: x.to_vec(), y: y.to_vec() };
            if self.document.attribute(element, "name").as_deref() != Some(name) {
                return own;
            }
            let class = self.document.tag(element);
            let message = format!("<{class} name=\"{name}\"> is not read, as in OpenSim: the class's own curve holds");
            let hint = format!("write <{name}><{class}>…</{class}></{name}>");
            self.diagnose(Severity::Warning, element, &object.path, message, Some(hint));
            return own;
        }
        self.curve(object, name, default)
    }

    fn given_curve(&mut self, object: &Object, name: &'static str) -> Option<FunctionSpec> {
        let element = self.one_object(object, name, is_function).flatten()?;
        let function = self.function(element, object);
        if function.is_none() {
            let class = self.document.tag(element).to_owned();
            self.problem(self.document.line(element), &object.path, ProblemKind::UnsupportedClass { class });
        }
        function
    }
}
