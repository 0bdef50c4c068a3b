//! Values that OpenSim computes with and no person has: millimetres in place of metres, degrees in place of radians.
//!
//! Each is a warning; the number is used as it stands. What is doubtful in the same way at several places is one
//! warning.

use super::state::Reader;
use crate::osim::diagnostics::{Diagnostic, Severity};
use crate::osim::document::ElementId;
use crate::osim::spec::{
    FrameKind, Location, MotionType, MuscleKind, MuscleSpec, OtherMuscleSpec, PathPointKind, WrapObjectSpec, WrapShape,
};
use carpus_numerics::plausible::{self, Doubt, Plausible};

/// Least mass of a body whose inertia is looked at [kg].
const LEAST_MASS: f64 = 0.01;

/// Limits of a coordinate beyond this are no limits (OpenSim's default is 99999.9) [rad, or deg by mistake].
const LARGEST_LIMIT: f64 = 720.0;

/// A value and where it stands.
struct Found<'s> {
    property: &'static str,
    at: &'s Location,
    value: f64,
    plausible: &'static Plausible,
}

impl Reader<'_> {
    /// Warns of values outside their plausible ranges.
    pub(super) fn report_implausible(&mut self) {
        let spec = std::mem::take(&mut self.spec);
        let mut found: Vec<Found<'_>> = Vec::new();
        let mut look = |property, at, value, plausible| found.push(Found { property, at, value, plausible });
        spec.muscles.iter().for_each(|muscle| look_at_muscle(muscle, &mut look));
        for body in &spec.bodies {
            look("mass", &body.at, body.mass, &plausible::SEGMENT_MASS);
            look("mass_center", &body.at, body.mass_center.norm(), &plausible::POINT_DISTANCE);
            // A body without weight is given any inertia that keeps equations regular.
            if body.mass >= LEAST_MASS {
                let radius = (body.inertia.diagonal().amax() / body.mass).sqrt();
                look("inertia (radius of gyration)", &body.at, radius, &plausible::GYRATION_RADIUS);
            }
        }
        for frame in &spec.frames {
            if let FrameKind::Offset { translation, orientation, .. } = &frame.kind {
                look("translation", &frame.at, translation.norm(), &plausible::POINT_DISTANCE);
                look("orientation", &frame.at, orientation.amax(), &plausible::JOINT_ANGLE);
            }
        }
        for coordinate in spec.coordinates.iter().filter(|c| c.motion_type == MotionType::Rotational) {
            look("default_value", &coordinate.at, coordinate.default_value, &plausible::JOINT_ANGLE);
            let limit = coordinate.range.iter().fold(0.0, |largest: f64, limit| largest.max(limit.abs()));
            if limit <= LARGEST_LIMIT {
                look("range", &coordinate.at, limit, &plausible::JOINT_ANGLE);
            }
        }
        spec.wrap_objects.iter().for_each(|wrap| look_at_wrap(wrap, &mut look));
        for marker in &spec.markers {
            look("location", &marker.at, marker.location.norm(), &plausible::POINT_DISTANCE);
        }
        let mut reported: Vec<(&'static Plausible, &'static str, Diagnostic)> = Vec::new();
        for (found, doubt) in found.iter().filter_map(|f| Some((f, f.plausible.doubt(f.value)?))) {
            let line = self.line_of_property(found.at, found.property);
            let same =
                |r: &&mut (&Plausible, &str, Diagnostic)| std::ptr::eq(r.0, found.plausible) && r.1 == found.property;
            match reported.iter_mut().find(same) {
                Some((.., first)) => first.also_at.push(line),
                None => {
                    let path = found.at.path.clone();
                    reported.push((found.plausible, found.property, diagnostic(line, path, found.property, &doubt)));
                }
            }
        }
        self.diagnostics.items.extend(reported.into_iter().map(|(.., diagnostic)| diagnostic));
        if let Some(doubt) = plausible::GRAVITY.doubt(spec.gravity.norm()) {
            self.diagnostics.items.push(diagnostic(1, "/".to_owned(), "gravity", &doubt));
        }
        self.spec = spec;
    }

    /// Line of a component's property; that of the component where the property is not written.
    ///
    /// - `property`: its name, before anything in parentheses
    fn line_of_property(&self, at: &Location, property: &str) -> usize {
        let property = property.split(" (").next().unwrap_or(property);
        let written = at.element.and_then(|element| self.document.child(ElementId(element), property));
        written.map_or(at.line, |element| self.document.line(element))
    }
}

fn diagnostic(line: usize, path: String, property: &str, doubt: &Doubt) -> Diagnostic {
    let message = format!("{property}: {doubt}");
    Diagnostic { severity: Severity::Warning, line, path, message, hint: Some(doubt.hint()), also_at: Vec::new() }
}

fn look_at_muscle<'s>(
    muscle: &'s MuscleSpec,
    look: &mut impl FnMut(&'static str, &'s Location, f64, &'static Plausible),
) {
    let at = &muscle.at;
    // A muscle of no force is one that is switched off.
    if muscle.max_isometric_force != 0.0 {
        look("max_isometric_force", at, muscle.max_isometric_force, &plausible::MAX_ISOMETRIC_FORCE);
    }
    look("optimal_fiber_length", at, muscle.optimal_fiber_length, &plausible::OPTIMAL_FIBER_LENGTH);
    look("tendon_slack_length", at, muscle.tendon_slack_length, &plausible::TENDON_SLACK_LENGTH);
    let pennation = muscle.pennation_angle_at_optimal;
    look("pennation_angle_at_optimal", at, pennation, &plausible::PENNATION_ANGLE);
    look("max_contraction_velocity", at, muscle.max_contraction_velocity, &plausible::MAX_CONTRACTION_VELOCITY);
    let damping = match &muscle.kind {
        MuscleKind::Millard2012Equilibrium(m) => Some(m.fiber_damping),
        MuscleKind::OtherClass { law, .. } => match law.as_deref() {
            Some(OtherMuscleSpec::DeGrooteFregly2016(m)) => Some(m.fiber_damping),
            _ => None,
        },
    };
    if let Some(damping) = damping {
        look("fiber_damping", at, damping, &plausible::FIBER_DAMPING);
    }
    let activations = match &muscle.kind {
        MuscleKind::Millard2012Equilibrium(m) => [Some(m.default_activation), Some(m.minimum_activation)],
        MuscleKind::OtherClass { law, .. } => match law.as_deref() {
            Some(OtherMuscleSpec::Thelen2003(m)) => [Some(m.default_activation), Some(m.minimum_activation)],
            Some(OtherMuscleSpec::DeGrooteFregly2016(m)) => [Some(m.default_activation), None],
            _ => [None; 2],
        },
    };
    let ranges = [&plausible::ACTIVATION, &plausible::MINIMUM_ACTIVATION];
    for ((property, range), activation) in
        ["default_activation", "minimum_activation"].into_iter().zip(ranges).zip(activations)
    {
        if let Some(activation) = activation {
            look(property, at, activation, range);
        }
    }
    let times = match &muscle.kind {
        MuscleKind::Millard2012Equilibrium(m) => Some([m.activation_time_constant, m.deactivation_time_constant]),
        MuscleKind::OtherClass { law, .. } => match law.as_deref() {
            Some(OtherMuscleSpec::Thelen2003(m)) => Some([m.activation_time_constant, m.deactivation_time_constant]),
            Some(OtherMuscleSpec::DeGrooteFregly2016(m)) => {
                Some([m.activation_time_constant, m.deactivation_time_constant])
            }
            _ => None,
        },
    };
    for (property, time) in
        ["activation_time_constant", "deactivation_time_constant"].into_iter().zip(times.into_iter().flatten())
    {
        look(property, at, time, &plausible::ACTIVATION_TIME);
    }
    for point in &muscle.path.points {
        if let PathPointKind::Fixed { location } | PathPointKind::Conditional { location, .. } = &point.kind {
            look("location", &point.at, location.norm(), &plausible::POINT_DISTANCE);
        }
    }
}

fn look_at_wrap<'s>(
    wrap: &'s WrapObjectSpec,
    look: &mut impl FnMut(&'static str, &'s Location, f64, &'static Plausible),
) {
    look("translation", &wrap.at, wrap.translation.norm(), &plausible::POINT_DISTANCE);
    look("xyz_body_rotation", &wrap.at, wrap.xyz_body_rotation.amax(), &plausible::JOINT_ANGLE);
    let mut size = |property, value: f64| look(property, &wrap.at, value, &plausible::WRAP_SIZE);
    match &wrap.shape {
        WrapShape::Sphere { radius } => size("radius", *radius),
        WrapShape::Cylinder { radius, length } => {
            size("radius", *radius);
            size("length", *length);
        }
        WrapShape::Ellipsoid { dimensions } => {
            size("dimensions", dimensions.iter().fold(0.0, |largest: f64, d| largest.max(*d)));
        }
        WrapShape::Torus { inner_radius, outer_radius } => {
            size("inner_radius", *inner_radius);
            size("outer_radius", *outer_radius);
        }
    }
}
