//! Effects as components and properties of stock OpenSim.

use nalgebra::Matrix3;

use super::error::ExportError;
use crate::effect::NativeForm;
use crate::forward_model::Setting;
use crate::joint_traits::neutral_angle;
use carpus_multibody::multibody::Model;
use carpus_osim::osim::edit::format_number;
use carpus_osim::osim::spec::{BodyIndex, CoordinateIndex, ModelSpec, MotionType, MuscleSpec};
use carpus_osim::osim::{EditError, OsimFile};
use carpus_simulation::simulation::Setup;
use carpus_study::study::MomentPart;

/// First file format whose bodies have an `inertia` of six numbers.
const VERSION_WITH_INERTIA: u32 = 30500;
/// How far the body's angular velocity per unit of the coordinate's may be from 1.
const UNIT_MOTION_TOLERANCE: f64 = 1e-9;

/// The coordinate that the dynamometer moves.
pub(super) struct MovingCoordinate {
    name: String,
    motion_type: MotionType,
    /// Angle about which the joint's passive properties lie [rad].
    neutral_angle: f64,
    /// The body that turns with the coordinate one to one, if there is one.
    body: Option<BodyIndex>,
}

impl MovingCoordinate {
    pub(super) fn find(spec: &ModelSpec, setup: &Setup) -> Result<MovingCoordinate, ExportError> {
        let found = spec.coordinates.iter().position(|c| c.name == setup.coordinate);
        let index = found.ok_or_else(|| ExportError::UnknownCoordinate { name: setup.coordinate.clone() })?;
        let coordinate = &spec.coordinates[index];
        Ok(MovingCoordinate {
            name: coordinate.name.clone(),
            motion_type: coordinate.motion_type,
            neutral_angle: neutral_angle(coordinate.range),
            body: turning_body(spec, CoordinateIndex(index)),
        })
    }
}

/// The child body of the coordinate's joint, if its angular velocity is that of the coordinate over the whole range.
fn turning_body(spec: &ModelSpec, coordinate: CoordinateIndex) -> Option<BodyIndex> {
    let model = Model::compile(spec).ok()?;
    let joint = spec.joints.iter().find(|joint| joint.coordinates.contains(&coordinate))?;
    let body = model.frame(joint.child_frame).base.body()?;
    let [low, high] = spec.coordinates[coordinate.0].range;
    let mut cache = model.new_cache();
    let mut q = model.default_coordinates();
    for step in 0..5 {
        q[coordinate.0] = low + (high - low) * f64::from(step) / 4.0;
        model.satisfy_couplers(&mut q);
        model.update_positions(&q, &mut cache);
        model.update_unit_motion(&q, coordinate, &mut cache);
        if (cache.partial_velocity(body).w.norm() - 1.0).abs() > UNIT_MOTION_TOLERANCE {
            return None;
        }
    }
    (spec.bodies[body.0].mass > 0.0).then_some(body)
}

/// What was changed; or why nothing can be (`None`: the effect has no form of stock OpenSim).
type Written = Result<Vec<String>, Option<String>>;

pub(super) fn write(
    file: &mut OsimFile,
    setup: &Setup,
    coordinate: &MovingCoordinate,
    item: &Setting,
) -> Result<Written, EditError> {
    let muscles = write_muscles(file, setup, item)?;
    if !muscles.is_empty() {
        return Ok(Ok(muscles));
    }
    let Some(form) = item.effect.native_form(&item.values, coordinate.neutral_angle) else { return Ok(Err(None)) };
    let (part, name) = match form {
        NativeForm::Inertia(_) => (MomentPart::Inertia, "inertia"),
        _ => (MomentPart::Passive, "passive"),
    };
    if !setup.parts.contains(&part) {
        let reason = format!("the study's moment leaves out \"{name}\", which would carry it");
        return Ok(Err(Some(reason)));
    }
    let id = item.effect.description().id;
    match form {
        NativeForm::Inertia(inertia) => write_inertia(file, coordinate, inertia),
        form => write_force(file, coordinate, id, &form).map(|name| Ok(vec![format!("/forceset/{name}")])),
    }
}

fn write_muscles(file: &mut OsimFile, setup: &Setup, item: &Setting) -> Result<Vec<String>, EditError> {
    let active = |m: &&MuscleSpec| setup.active_muscles.contains(&m.name);
    let before: Vec<MuscleSpec> = file.spec.muscles.iter().filter(active).cloned().collect();
    let mut after = before.clone();
    if !item.effect.change_muscles(&item.values, &mut after) {
        return Ok(Vec::new());
    }
    let mut changes = Vec::new();
    for (before, after) in before.iter().zip(&after) {
        let values = before.changeable_properties().into_iter().zip(after.changeable_properties());
        for ((property, old), (_, new)) in values {
            if old != new {
                changes.push((before.name.as_str(), property, new));
            }
        }
    }
    file.set_muscle_properties(&changes)?;
    Ok(changes.iter().map(|(muscle, property, _)| format!("/forceset/{muscle}: {property}")).collect())
}

/// Adds the force under a name that no other force has; gives the name.
fn write_force(
    file: &mut OsimFile,
    coordinate: &MovingCoordinate,
    id: &str,
    form: &NativeForm,
) -> Result<String, EditError> {
    let taken = |name: &str| {
        file.spec.forces.iter().any(|f| f.name == name) || file.spec.muscles.iter().any(|m| m.name == name)
    };
    let numbered = (1..).map(|i| if i == 1 { format!("carpus_{id}") } else { format!("carpus_{id}_{i}") });
    let name = numbered.into_iter().find(|name| !taken(name)).unwrap_or_default();
    let (class, values) = force_properties(coordinate, form);
    let mut properties = vec![("coordinate", coordinate.name.clone())];
    properties.extend(values);
    file.add_force_of(class, &name, &properties)?;
    Ok(name)
}

fn force_properties(coordinate: &MovingCoordinate, form: &NativeForm) -> (&'static str, Vec<(&'static str, String)>) {
    match form {
        NativeForm::Spring { stiffness, rest_angle, viscosity } => {
            let values = [("stiffness", stiffness), ("rest_length", rest_angle), ("viscosity", viscosity)];
            ("SpringGeneralizedForce", values.map(|(name, value)| (name, format_number(*value))).to_vec())
        }
        NativeForm::Limit { stiffness, limit, transition } => {
            // OpenSim reads degrees, and stiffness per degree, for a rotational coordinate; SI units for a coupled one.
            let unit = match coordinate.motion_type {
                MotionType::Rotational => std::f64::consts::PI / 180.0,
                MotionType::Translational | MotionType::Coupled => 1.0,
            };
            let values = [
                ("upper_stiffness", stiffness * unit),
                ("upper_limit", limit[1] / unit),
                ("lower_stiffness", stiffness * unit),
                ("lower_limit", limit[0] / unit),
                ("damping", 0.0),
                ("transition", transition / unit),
            ];
            ("CoordinateLimitForce", values.map(|(name, value)| (name, format_number(value))).to_vec())
        }
        NativeForm::Formula(formula) => ("ExpressionBasedCoordinateForce", vec![("expression", formula.clone())]),
        NativeForm::Inertia(_) => unreachable!("inertia is a property of a body, not a force"),
    }
}

/// More inertia, the same about every axis, so that nothing but the coordinate's moment changes with its acceleration.
fn write_inertia(file: &mut OsimFile, coordinate: &MovingCoordinate, inertia: f64) -> Result<Written, EditError> {
    if file.spec.document_version < VERSION_WITH_INERTIA {
        return Ok(Err(Some("the file's format is too old for a body's inertia in one property".to_owned())));
    }
    let Some(body) = coordinate.body else {
        let reason = "no body with a mass turns with the coordinate one to one".to_owned();
        return Ok(Err(Some(reason)));
    };
    let body = &file.spec.bodies[body.0];
    let i = body.inertia + inertia * Matrix3::identity();
    if !(0..3).all(|k| i[(k, k)] >= 0.0) {
        return Ok(Err(Some("the body's inertia would be negative".to_owned())));
    }
    let values = [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]];
    let text = values.map(format_number).join(" ");
    let path = body.at.path.clone();
    file.set_property(&path, "inertia", &text)?;
    Ok(Ok(vec![format!("{path}: inertia")]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_limits_are_in_degrees_for_rotational_coordinates_only() {
        let coordinate =
            |motion_type| MovingCoordinate { name: "q".to_owned(), motion_type, neutral_angle: 0.0, body: None };
        let form = NativeForm::Limit { stiffness: 2.0, limit: [-0.5, 0.6], transition: 0.02 };
        let value = |motion_type, property: &str| {
            let (_, values) = force_properties(&coordinate(motion_type), &form);
            let text = values.into_iter().find(|(name, _)| *name == property).map(|(_, text)| text).unwrap();
            text.parse::<f64>().unwrap()
        };
        assert!((value(MotionType::Rotational, "upper_limit") - 0.6_f64.to_degrees()).abs() < 1e-12);
        assert!((value(MotionType::Rotational, "lower_stiffness") - 2.0_f64.to_radians()).abs() < 1e-12);
        assert_eq!(value(MotionType::Coupled, "lower_limit"), -0.5);
        assert_eq!(value(MotionType::Coupled, "upper_stiffness"), 2.0);
        assert_eq!(value(MotionType::Coupled, "transition"), 0.02);
    }
}
