//! What OpenSim's format versions mean, as its `updateFromXMLNode` methods upgrade them.

/// `OpenSimDocument` version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Version(pub u32);

impl Version {
    /// Before 30501 a joint stands inside its child body, and ground is a body (`Model::updateFromXMLNode`).
    pub fn has_joints_in_bodies(self) -> bool {
        self.0 < 30501
    }

    /// Before 30505 joints, bushings and points name bodies and give locations instead of connecting to frames
    /// (`Joint`, `TwoFrameLinker`, `AbstractPathPoint::updateFromXMLNode`).
    pub fn has_locations_in_bodies(self) -> bool {
        self.0 < 30505
    }

    /// Before 30500 the inertia is given by six properties (`Body::updateFromXMLNode`).
    pub fn has_inertia_components(self) -> bool {
        self.0 < 30500
    }

    /// Before 30514 joints can be reversed (`Joint::updateFromXMLNode`).
    pub fn has_reverse(self) -> bool {
        self.0 < 30514
    }

    /// Before 30509 forces and constraints have `isDisabled` (`Force`, `Constraint::updateFromXMLNode`).
    pub fn has_is_disabled(self) -> bool {
        self.0 < 30509
    }

    /// Before 30513 a muscle's `min_control` of 0 and `max_control` of 1 give way to the class' own defaults
    /// (`Muscle::updateFromXMLNode`).
    pub fn ignores_control(self, property: &str, value: f64) -> bool {
        let trivial = match property {
            "min_control" => 0.0,
            "max_control" => 1.0,
            _ => return false,
        };
        self.0 < 30513 && (value - trivial).abs() <= f64::EPSILON.powf(0.875)
    }

    /// Today's name of a property of a force, a muscle or a constraint, if it had another one.
    pub fn present_property(self, class: &str, property: &str) -> Option<&'static str> {
        let names = self.pennation_angle_names();
        match property {
            "isDisabled" if self.has_is_disabled() && class.ends_with("Constraint") => Some("isEnforced"),
            "isDisabled" if self.has_is_disabled() => Some("appliesForce"),
            _ => names[1..].contains(&property).then_some(names[0]),
        }
    }

    /// Before 30500 white space is removed from names (`Component::updateFromXMLNode`).
    pub fn strips_white_space_from_names(self) -> bool {
        self.0 < 30500
    }

    /// Up to 20301 the pennation angle has another name; later files that use it have none in OpenSim
    /// (`Muscle::updateFromXMLNode`).
    pub fn pennation_angle_names(self) -> &'static [&'static str] {
        if self.0 <= 20301 {
            &["pennation_angle_at_optimal", "pennation_angle"]
        } else {
            &["pennation_angle_at_optimal"]
        }
    }

    /// Before 10905 point and torque actuators act on the second of two bodies (`PointActuator`,
    /// `TorqueActuator::updateFromXMLNode`).
    pub fn has_forces_on_body_b(self) -> bool {
        self.0 < 10905
    }

    /// Before 40000 sockets may be connected by bare names.
    pub fn has_bare_names(self) -> bool {
        self.0 < 40000
    }
}

/// Today's name of a class (`Object::renameType` in OpenSim's type registrations).
pub(super) fn present_class(tag: &str) -> &str {
    match tag {
        "MusclePoint" => "PathPoint",
        "MuscleViaPoint" => "ConditionalPathPoint",
        "MovingMusclePoint" => "MovingPathPoint",
        "MuscleWrap" => "PathWrap",
        "Schutte1993Muscle" => "Schutte1993Muscle_Deprecated",
        "Delp1990Muscle" => "Delp1990Muscle_Deprecated",
        "GeneralizedForce" => "CoordinateActuator",
        "Force" => "PointActuator",
        "Torque" => "TorqueActuator",
        present => present,
    }
}

/// A number as it survives OpenSim's upgrade of old files, which writes it with C++'s default of six significant
/// digits and reads it again (`Body`, `XMLDocument::addPhysicalOffsetFrame30505_30517`).
pub(super) fn six_significant_digits(value: f64) -> f64 {
    if !value.is_finite() {
        return value;
    }
    format!("{value:.5e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::six_significant_digits;

    #[test]
    fn verif_six_digits_as_printed_by_a_c_plus_plus_stream() {
        assert_eq!(six_significant_digits(0.123456789), 0.123457);
        assert_eq!(six_significant_digits(-0.017545), -0.017545);
        assert_eq!(six_significant_digits(1.23456789e-9), 1.23457e-9);
        assert_eq!(six_significant_digits(0.0), 0.0);
    }
}
