//! Paths and muscles.

use super::Writer;
use super::xml::numbers;
use crate::osim::spec::{
    DeprecatedMuscleKind, Millard2012Spec, MuscleKind, MuscleSpec, OtherMuscleSpec, PathFunctionsSpec, PathPointKind,
    PathSpec, WrapMethod,
};

impl Writer<'_> {
    fn function_path(&mut self, path: &PathFunctionsSpec) {
        self.xml.open("FunctionBasedPath", &[("name", "path")]);
        let coordinates: Vec<String> = path.coordinates.iter().map(|c| self.coordinate(*c)).collect();
        self.xml.text("coordinate_paths", &coordinates.join(" "));
        self.xml.function("length_function", &path.length);
        if !path.moment_arms.is_empty() {
            self.xml.open("moment_arm_functions", &[]);
            path.moment_arms.iter().for_each(|function| self.xml.bare_function(function));
            self.xml.close();
        }
        if let Some(speed) = &path.lengthening_speed {
            self.xml.function("lengthening_speed_function", speed);
        }
        self.xml.close();
    }

    pub(super) fn path(&mut self, path: &PathSpec) {
        if let Some(functions) = &path.functions {
            return self.function_path(functions);
        }
        self.xml.open("GeometryPath", &[("name", "path")]);
        self.xml.open("PathPointSet", &[]);
        self.xml.open("objects", &[]);
        for point in &path.points {
            let class = match point.kind {
                PathPointKind::Fixed { .. } => "PathPoint",
                PathPointKind::Conditional { .. } => "ConditionalPathPoint",
                PathPointKind::Moving { .. } => "MovingPathPoint",
            };
            self.xml.open(class, &[("name", &point.name)]);
            let frame = self.frame(point.frame);
            self.xml.text("socket_parent_frame", &frame);
            match &point.kind {
                PathPointKind::Fixed { location } => self.xml.vector("location", location),
                PathPointKind::Conditional { location, coordinate, range } => {
                    let coordinate = self.coordinate(*coordinate);
                    self.xml.text("socket_coordinate", &coordinate);
                    self.xml.vector("location", location);
                    self.xml.text("range", &numbers(range));
                }
                PathPointKind::Moving { location } => {
                    // A component without coordinate is constant; OpenSim wants a connected socket all the same.
                    let any = location.iter().find_map(|(_, c)| *c);
                    for ((function, coordinate), axis) in location.iter().zip(["x", "y", "z"]) {
                        if let Some(coordinate) = coordinate.or(any) {
                            let path = self.coordinate(coordinate);
                            self.xml.text(&format!("socket_{axis}_coordinate"), &path);
                        }
                        self.xml.function(&format!("{axis}_location"), function);
                    }
                }
            }
            self.xml.close();
        }
        self.xml.close();
        self.xml.close();
        if !path.wraps.is_empty() {
            self.xml.open("PathWrapSet", &[]);
            self.xml.open("objects", &[]);
            for wrap in &path.wraps {
                self.xml.open("PathWrap", &[("name", &wrap.name)]);
                let object = &self.spec.wrap_objects[wrap.wrap_object.0].name;
                self.xml.text("wrap_object", object);
                let method = match wrap.method {
                    WrapMethod::Hybrid => "hybrid",
                    WrapMethod::Midpoint => "midpoint",
                    WrapMethod::Axial => "axial",
                };
                self.xml.text("method", method);
                self.xml.text("range", &format!("{} {}", wrap.range[0], wrap.range[1]));
                self.xml.close();
            }
            self.xml.close();
            self.xml.close();
        }
        self.xml.close();
    }

    pub(super) fn muscle(&mut self, muscle: &MuscleSpec) {
        let class = match &muscle.kind {
            MuscleKind::Millard2012Equilibrium(_) => "Millard2012EquilibriumMuscle",
            MuscleKind::OtherClass { class, law } => {
                if law.is_none() {
                    let text = format!("{}: properties that only a {class} has", muscle.at.path);
                    self.left_out.push((muscle.at.line, text));
                }
                match class.as_str() {
                    "Schutte1993Muscle" => "Schutte1993Muscle_Deprecated",
                    "Delp1990Muscle" => "Delp1990Muscle_Deprecated",
                    class => class,
                }
            }
        };
        self.xml.open(class, &[("name", &muscle.name)]);
        self.xml.boolean("appliesForce", muscle.applies_force);
        self.xml.number("min_control", muscle.min_control);
        self.xml.number("max_control", muscle.max_control);
        self.path(&muscle.path);
        self.xml.number("max_isometric_force", muscle.max_isometric_force);
        self.xml.number("optimal_fiber_length", muscle.optimal_fiber_length);
        self.xml.number("tendon_slack_length", muscle.tendon_slack_length);
        self.xml.number("pennation_angle_at_optimal", muscle.pennation_angle_at_optimal);
        self.xml.number("max_contraction_velocity", muscle.max_contraction_velocity);
        self.xml.boolean("ignore_tendon_compliance", muscle.ignore_tendon_compliance);
        self.xml.boolean("ignore_activation_dynamics", muscle.ignore_activation_dynamics);
        match &muscle.kind {
            MuscleKind::Millard2012Equilibrium(own) => self.millard(own),
            MuscleKind::OtherClass { law: Some(law), .. } => self.other_muscle(law),
            MuscleKind::OtherClass { law: None, .. } => {}
        }
        self.xml.close();
    }

    fn millard(&mut self, own: &Millard2012Spec) {
        let xml = &mut self.xml;
        xml.number("fiber_damping", own.fiber_damping);
        xml.number("default_fiber_length", own.default_fiber_length);
        xml.number("default_activation", own.default_activation);
        xml.number("minimum_activation", own.minimum_activation);
        xml.number("activation_time_constant", own.activation_time_constant);
        xml.number("deactivation_time_constant", own.deactivation_time_constant);
        xml.number("maximum_pennation_angle", own.maximum_pennation_angle);
        let active = &own.active_force_length;
        xml.open("ActiveForceLengthCurve", &[]);
        xml.number("min_norm_active_fiber_length", active.min_norm_active_fiber_length);
        xml.number("transition_norm_fiber_length", active.transition_norm_fiber_length);
        xml.number("max_norm_active_fiber_length", active.max_norm_active_fiber_length);
        xml.number("shallow_ascending_slope", active.shallow_ascending_slope);
        xml.number("minimum_value", active.minimum_value);
        xml.close();
        let velocity = &own.force_velocity;
        xml.open("ForceVelocityCurve", &[]);
        xml.number("concentric_slope_at_vmax", velocity.concentric_slope_at_vmax);
        xml.number("concentric_slope_near_vmax", velocity.concentric_slope_near_vmax);
        xml.number("isometric_slope", velocity.isometric_slope);
        xml.number("eccentric_slope_at_vmax", velocity.eccentric_slope_at_vmax);
        xml.number("eccentric_slope_near_vmax", velocity.eccentric_slope_near_vmax);
        xml.number("max_eccentric_velocity_force_multiplier", velocity.max_eccentric_velocity_force_multiplier);
        xml.number("concentric_curviness", velocity.concentric_curviness);
        xml.number("eccentric_curviness", velocity.eccentric_curviness);
        xml.close();
        let fiber = &own.fiber_force_length;
        xml.open("FiberForceLengthCurve", &[]);
        xml.number("strain_at_zero_force", fiber.strain_at_zero_force);
        xml.number("strain_at_one_norm_force", fiber.strain_at_one_norm_force);
        xml.optional("stiffness_at_low_force", fiber.stiffness_at_low_force);
        xml.optional("stiffness_at_one_norm_force", fiber.stiffness_at_one_norm_force);
        xml.optional("curviness", fiber.curviness);
        xml.close();
        let tendon = &own.tendon_force_length;
        xml.open("TendonForceLengthCurve", &[]);
        xml.number("strain_at_one_norm_force", tendon.strain_at_one_norm_force);
        xml.optional("stiffness_at_one_norm_force", tendon.stiffness_at_one_norm_force);
        xml.optional("norm_force_at_toe_end", tendon.norm_force_at_toe_end);
        xml.optional("curviness", tendon.curviness);
        xml.close();
    }

    fn other_muscle(&mut self, law: &OtherMuscleSpec) {
        let xml = &mut self.xml;
        match law {
            OtherMuscleSpec::Thelen2003(own) => {
                for (property, value) in [
                    ("FmaxTendonStrain", own.fmax_tendon_strain),
                    ("FmaxMuscleStrain", own.fmax_muscle_strain),
                    ("KshapeActive", own.kshape_active),
                    ("KshapePassive", own.kshape_passive),
                    ("Af", own.af),
                    ("Flen", own.flen),
                    ("fv_linear_extrap_threshold", own.fv_linear_extrap_threshold),
                    ("maximum_pennation_angle", own.maximum_pennation_angle),
                    ("activation_time_constant", own.activation_time_constant),
                    ("deactivation_time_constant", own.deactivation_time_constant),
                    ("minimum_activation", own.minimum_activation),
                    ("default_activation", own.default_activation),
                    ("default_fiber_length", own.default_fiber_length),
                ] {
                    xml.number(property, value);
                }
            }
            OtherMuscleSpec::DeGrooteFregly2016(own) => {
                for (property, value) in [
                    ("activation_time_constant", own.activation_time_constant),
                    ("deactivation_time_constant", own.deactivation_time_constant),
                    ("default_activation", own.default_activation),
                    ("default_normalized_tendon_force", own.default_normalized_tendon_force),
                    ("active_force_width_scale", own.active_force_width_scale),
                    ("fiber_damping", own.fiber_damping),
                    ("passive_fiber_strain_at_one_norm_force", own.passive_fiber_strain_at_one_norm_force),
                    ("tendon_strain_at_one_norm_force", own.tendon_strain_at_one_norm_force),
                    ("activation_dynamics_smoothing", own.activation_dynamics_smoothing),
                ] {
                    xml.number(property, value);
                }
                xml.boolean("ignore_passive_fiber_force", own.ignore_passive_fiber_force);
                if own.implicit_tendon_compliance {
                    xml.text("tendon_compliance_dynamics_mode", "implicit");
                }
            }
            OtherMuscleSpec::RigidTendon(own) => {
                xml.function("active_force_length_curve", &own.active_force_length_curve);
                xml.function("passive_force_length_curve", &own.passive_force_length_curve);
                xml.function("force_velocity_curve", &own.force_velocity_curve);
            }
            OtherMuscleSpec::Deprecated(own) => {
                xml.number("time_scale", own.time_scale);
                xml.number("activation1", own.activation1);
                xml.number("activation2", own.activation2);
                match &own.kind {
                    DeprecatedMuscleKind::Schutte1993 { damping } => xml.number("damping", *damping),
                    DeprecatedMuscleKind::Delp1990 { mass, .. } => xml.number("mass", *mass),
                }
                xml.function("tendon_force_length_curve", &own.tendon_force_length_curve);
                xml.function("active_force_length_curve", &own.active_force_length_curve);
                if let Some(passive) = &own.passive_force_length_curve {
                    xml.function("passive_force_length_curve", passive);
                }
                if let DeprecatedMuscleKind::Delp1990 { force_velocity_curve, .. } = &own.kind {
                    xml.function("force_velocity_curve", force_velocity_curve);
                }
            }
        }
    }
}
