//! The typed specification against what OpenSim 4.6 itself loads, for every shared lab model.
//!
//! Runs where `opensim` can be imported by `CARPUS_PYTHON` (default `python3`); skips visibly elsewhere.

use std::ffi::OsStr;
use std::path::PathBuf;

use carpus::osim::spec::*;
use carpus::osim::{OsimFile, Severity};
use serde_json::{Value, json};

use crate::reference::{lab_models, opensim_python, run_script, stem};
use crate::validation;

/// Numbers are compared exactly, but for the last bit that decimal conversions in OpenSim's own upgrade may lose.
const RELATIVE_TOLERANCE: f64 = 4.0 * f64::EPSILON;

/// What OpenSim makes of the files.
pub fn opensim_dump(models: &[PathBuf]) -> Vec<Value> {
    let python = opensim_python();
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("models.json");
    let arguments: Vec<&OsStr> = std::iter::once(&out).chain(models).map(|path| path.as_os_str()).collect();
    run_script(&python, "scripts/dump_model.py", &arguments);
    let text = std::fs::read_to_string(out).expect("output of dump_model.py");
    // Python writes NaN and Infinity, which JSON does not have.
    let text = text.replace("-Infinity", "\"-inf\"").replace("Infinity", "\"inf\"").replace("NaN", "\"nan\"");
    let value: Value = serde_json::from_str(&text).expect("JSON");
    value["models"].as_array().expect("models").clone()
}

/// Every file that OpenSim loads is read, and every value that is read is OpenSim's. A file that OpenSim refuses may be
/// read or refused.
#[test]
#[cfg_attr(
    not(all(has_opensim, has_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and models (CARPUS_MODELS or CARPUS_SHARED)"
)]
fn val_opensim_loads_the_same_model() {
    let models = lab_models();
    let theirs = opensim_dump(&models);
    let (mut rows, mut refused, mut loaded) = (Vec::new(), Vec::new(), 0);
    for (path, theirs) in models.iter().zip(&theirs) {
        let name = stem(path);
        if let Some(error) = theirs.get("error") {
            eprintln!("OpenSim refuses {name}: {error}");
            continue;
        }
        loaded += 1;
        match OsimFile::read(path) {
            Ok(file) => {
                let theirs = in_our_order(theirs.clone(), &file.spec);
                let (mut differences, mut compared) = (Vec::new(), 0);
                compare(&summary(&file.spec), &theirs, &name, &mut differences, &mut compared);
                rows.push(validation::counted("reading", &name, "values of the specification", compared, &differences));
            }
            Err(error) => refused.push(format!("{name}: {error}")),
        }
    }
    rows.push(validation::counted("reading", "all models", "files that OpenSim loads, refused", loaded, &refused));
    validation::write("reading", &rows);
    validation::assert_passed(&rows);
}

/// Sorts what OpenSim lists in the order of its tree, and writes quadrants in one way. Frames that OpenSim makes for
/// geometry of old files, and those of forces and constraints that are not supported, are left out.
fn in_our_order(mut theirs: Value, ours: &ModelSpec) -> Value {
    let known = |frame: &Value| ours.frames.iter().any(|known| frame["path"] == known.at.path.as_str());
    let foreign = |frame: &Value| {
        let path = frame["path"].as_str().unwrap_or_default();
        path.contains("_geom_frame_") || path.starts_with("/forceset/") || path.starts_with("/constraintset/")
    };
    if let Some(frames) = theirs["frames"].as_array_mut() {
        frames.retain(|frame| known(frame) || !foreign(frame));
    }
    for key in ["frames", "joints", "wraps"] {
        let values = theirs[key].as_array().cloned().unwrap_or_default();
        theirs[key] = sorted_by_path(values).into();
    }
    for wrap in theirs["wraps"].as_array_mut().into_iter().flatten() {
        let quadrant = wrap["quadrant"].as_str().unwrap_or_default().to_lowercase();
        let half = match quadrant.as_str() {
            "all" => "all".to_owned(),
            signed if signed.starts_with(['-', '+']) => signed.to_owned(),
            unsigned => format!("+{unsigned}"),
        };
        wrap["quadrant_half"] = half.into();
    }
    for wrap in theirs["muscles"].as_array_mut().into_iter().flatten().flat_map(wraps_of) {
        let method = wrap["method"].as_str().unwrap_or_default().to_lowercase();
        wrap["method"] = method.into();
    }
    theirs
}

fn wraps_of(muscle: &mut Value) -> impl Iterator<Item = &mut Value> {
    muscle["path"]["wraps"].as_array_mut().into_iter().flatten()
}

/// Compares everything that `ours` has with the same key of `theirs`.
fn compare(ours: &Value, theirs: &Value, at: &str, differences: &mut Vec<String>, compared: &mut usize) {
    match (ours, theirs) {
        (Value::Object(ours), Value::Object(_)) => {
            for (key, value) in ours {
                compare(value, &theirs[key], &format!("{at}/{key}"), differences, compared);
            }
        }
        (Value::Array(ours), Value::Array(theirs)) => {
            if ours.len() != theirs.len() {
                differences.push(format!("{at}: ours has {} entries, OpenSim {}", ours.len(), theirs.len()));
            }
            for (i, (ours, theirs)) in ours.iter().zip(theirs).enumerate() {
                let name = ours["path"].as_str().or(ours["name"].as_str()).map_or(i.to_string(), str::to_owned);
                compare(ours, theirs, &format!("{at}/{name}"), differences, compared);
            }
        }
        (Value::Number(ours_number), Value::Number(theirs_number)) => {
            *compared += 1;
            let (a, b) = (ours_number.as_f64().unwrap_or(0.0), theirs_number.as_f64().unwrap_or(0.0));
            if (a - b).abs() > RELATIVE_TOLERANCE * a.abs().max(b.abs()) {
                differences.push(format!("{at}: ours {a:e}, OpenSim {b:e}"));
            }
        }
        (ours, theirs) => {
            *compared += 1;
            if ours != theirs {
                differences.push(format!("{at}: ours {ours}, OpenSim {theirs}"));
            }
        }
    }
}

fn number(value: f64) -> Value {
    if value.is_infinite() { json!(if value > 0.0 { "inf" } else { "-inf" }) } else { json!(value) }
}

fn sorted_by_path(mut values: Vec<Value>) -> Vec<Value> {
    values.sort_by_key(|value| value["path"].as_str().unwrap_or_default().to_owned());
    values
}

/// The specification in the form of `dump_model.py`.
fn summary(spec: &ModelSpec) -> Value {
    let frame = |index: FrameIndex| spec.frames[index.0].at.path.as_str();
    let coordinate_name = |index: CoordinateIndex| spec.coordinates[index.0].name.as_str();
    let bodies = spec.bodies.iter().map(|body| {
        let i = &body.inertia;
        json!({
            "path": body.at.path, "mass": body.mass, "mass_center": body.mass_center.as_slice(),
            "inertia": [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]],
        })
    });
    let offsets = spec.frames.iter().filter_map(|offset| match &offset.kind {
        FrameKind::Offset { parent, translation, orientation } => Some(json!({
            "path": offset.at.path, "parent": frame(*parent),
            "translation": translation.as_slice(), "orientation": orientation.as_slice(),
        })),
        _ => None,
    });
    let couplers = spec.constraints.iter().filter_map(|constraint| match &constraint.kind {
        ConstraintKind::CoordinateCoupler {
            independent_coordinates,
            dependent_coordinate,
            function: coupling,
            scale_factor,
        } => Some(json!({
            "name": constraint.name, "dependent": coordinate_name(*dependent_coordinate),
            "independent": independent_coordinates.iter().map(|&c| coordinate_name(c)).collect::<Vec<_>>(),
            "scale_factor": scale_factor, "is_enforced": constraint.is_enforced, "function": function(coupling),
        })),
        _ => None,
    });
    let wraps = spec.wrap_objects.iter().map(|wrap| wrap_summary(wrap, frame(wrap.frame)));
    let markers = spec.markers.iter().map(
        |marker| json!({ "name": marker.name, "frame": frame(marker.frame), "location": marker.location.as_slice() }),
    );
    json!({
        "gravity": spec.gravity.as_slice(),
        "bodies": bodies.collect::<Vec<_>>(),
        "frames": sorted_by_path(offsets.collect()),
        "joints": sorted_by_path(spec.joints.iter().map(|joint| joint_summary(spec, joint)).collect()),
        "couplers": couplers.collect::<Vec<_>>(),
        "wraps": sorted_by_path(wraps.collect()),
        "muscles": spec.muscles.iter().map(|muscle| muscle_summary(spec, muscle)).collect::<Vec<_>>(),
        "forces": spec.forces.iter().map(|force| force_summary(force, &frame, &coordinate_name)).collect::<Vec<_>>(),
        "markers": markers.collect::<Vec<_>>(),
    })
}

fn function(spec: &FunctionSpec) -> Value {
    match spec {
        FunctionSpec::Constant { value } => json!({ "class": "Constant", "value": value }),
        FunctionSpec::Linear { slope, intercept } => {
            json!({ "class": "LinearFunction", "slope": slope, "intercept": intercept })
        }
        FunctionSpec::SimmSpline { x, y } => json!({ "class": "SimmSpline", "x": x, "y": y }),
        FunctionSpec::PiecewiseLinear { x, y } => json!({ "class": "PiecewiseLinearFunction", "x": x, "y": y }),
        FunctionSpec::Multiplier { scale, function: inner } => {
            json!({ "class": "MultiplierFunction", "scale": scale, "function": function(inner) })
        }
        FunctionSpec::Polynomial { coefficients } => {
            json!({ "class": "PolynomialFunction", "coefficients": coefficients })
        }
        FunctionSpec::MultivariatePolynomial { .. } => json!({ "class": "MultivariatePolynomialFunction" }),
        FunctionSpec::PiecewiseConstant { .. } => json!({ "class": "PiecewiseConstantFunction" }),
        FunctionSpec::Step { .. } => json!({ "class": "StepFunction" }),
        FunctionSpec::GcvSpline { .. } => json!({ "class": "GCVSpline" }),
        FunctionSpec::Sine { .. } => json!({ "class": "Sine" }),
        FunctionSpec::ExpressionBased { .. } => json!({ "class": "ExpressionBasedFunction" }),
    }
}

fn joint_summary(spec: &ModelSpec, joint: &JointSpec) -> Value {
    let coordinates = joint.coordinates.iter().map(|&index| {
        let coordinate = &spec.coordinates[index.0];
        let motion_type = match coordinate.motion_type {
            MotionType::Rotational => "rotational",
            MotionType::Translational => "translational",
            MotionType::Coupled => "coupled",
        };
        json!({
            "name": coordinate.name, "path": coordinate.at.path, "default_value": coordinate.default_value,
            "default_speed_value": coordinate.default_speed_value, "range": coordinate.range.map(number),
            "clamped": coordinate.clamped, "locked": coordinate.locked, "prescribed": coordinate.prescribed,
            "motion_type": motion_type,
        })
    });
    let mut value = json!({
        "path": joint.at.path,
        "parent": spec.frames[joint.parent_frame.0].at.path,
        "child": spec.frames[joint.child_frame.0].at.path,
        "coordinates": coordinates.collect::<Vec<_>>(),
    });
    if let JointKind::Custom(axes) = &joint.kind {
        let axes = axes.iter().map(|axis| {
            let names = axis.coordinates.iter().map(|&index| spec.coordinates[index.0].name.as_str());
            json!({
                "axis": axis.axis.as_slice(), "coordinates": names.collect::<Vec<_>>(),
                "function": function(&axis.function),
            })
        });
        value["axes"] = axes.collect();
    }
    value
}

fn wrap_summary(wrap: &WrapObjectSpec, frame: &str) -> Value {
    let mut value = json!({
        "path": wrap.at.path, "frame": frame, "active": wrap.active, "translation": wrap.translation.as_slice(),
        "rotation": wrap.xyz_body_rotation.as_slice(),
    });
    value["class"] = match wrap.shape {
        WrapShape::Sphere { radius } => {
            value["radius"] = json!(radius);
            "WrapSphere"
        }
        WrapShape::Cylinder { radius, length } => {
            value["radius"] = json!(radius);
            value["length"] = json!(length);
            "WrapCylinder"
        }
        WrapShape::Ellipsoid { dimensions } => {
            value["dimensions"] = json!(dimensions);
            "WrapEllipsoid"
        }
        WrapShape::Torus { inner_radius, outer_radius } => {
            value["inner_radius"] = json!(inner_radius);
            value["outer_radius"] = json!(outer_radius);
            "WrapTorus"
        }
    }
    .into();
    value["quadrant_half"] = match wrap.quadrant {
        Quadrant::All => "all".to_owned(),
        Quadrant::Half { axis, sign } => format!("{}{}", if sign < 0 { "-" } else { "+" }, ["x", "y", "z"][axis]),
    }
    .into();
    value
}

fn path_summary(spec: &ModelSpec, path: &PathSpec) -> Value {
    let frame = |index: FrameIndex| spec.frames[index.0].at.path.as_str();
    let coordinate = |index: CoordinateIndex| spec.coordinates[index.0].at.path.as_str();
    let points = path.points.iter().map(|point| {
        let mut value = json!({ "name": point.name, "frame": frame(point.frame) });
        match &point.kind {
            PathPointKind::Fixed { location } => {
                value["class"] = "PathPoint".into();
                value["location"] = json!(location.as_slice());
            }
            PathPointKind::Conditional { location, coordinate: decider, range } => {
                value["class"] = "ConditionalPathPoint".into();
                value["location"] = json!(location.as_slice());
                value["coordinate"] = coordinate(*decider).into();
                value["range"] = json!(range.map(number));
            }
            PathPointKind::Moving { location } => {
                value["class"] = "MovingPathPoint".into();
                value["functions"] = location.iter().map(|(component, _)| function(component)).collect();
                value["coordinates"] = location.iter().map(|(_, argument)| argument.map(coordinate)).collect();
            }
        }
        value
    });
    let wraps = path.wraps.iter().map(|wrap| {
        let object = &spec.wrap_objects[wrap.wrap_object.0];
        let method = match wrap.method {
            WrapMethod::Hybrid => "hybrid",
            WrapMethod::Midpoint => "midpoint",
            WrapMethod::Axial => "axial",
        };
        json!({
            "name": wrap.name, "object": object.name, "frame": frame(object.frame), "method": method,
            "range": wrap.range,
        })
    });
    json!({ "points": points.collect::<Vec<_>>(), "wraps": wraps.collect::<Vec<_>>() })
}

fn muscle_summary(spec: &ModelSpec, muscle: &MuscleSpec) -> Value {
    let mut value = json!({
        "name": muscle.name, "applies_force": muscle.applies_force, "path": path_summary(spec, &muscle.path),
        "ignore_tendon_compliance": muscle.ignore_tendon_compliance,
        "ignore_activation_dynamics": muscle.ignore_activation_dynamics,
        "max_isometric_force": muscle.max_isometric_force, "optimal_fiber_length": muscle.optimal_fiber_length,
        "tendon_slack_length": muscle.tendon_slack_length,
        "pennation_angle_at_optimal": muscle.pennation_angle_at_optimal,
        "max_contraction_velocity": muscle.max_contraction_velocity, "min_control": number(muscle.min_control),
        "max_control": number(muscle.max_control),
    });
    let MuscleKind::Millard2012Equilibrium(millard) = &muscle.kind else { return value };
    let millard = adjusted_as_by_opensim(millard, muscle.ignore_tendon_compliance);
    let (active, velocity) = (&millard.active_force_length, &millard.force_velocity);
    let (passive, tendon) = (&millard.fiber_force_length, &millard.tendon_force_length);
    let own = json!({
        "fiber_damping": millard.fiber_damping, "default_fiber_length": millard.default_fiber_length,
        "default_activation": millard.default_activation, "minimum_activation": millard.minimum_activation,
        "activation_time_constant": millard.activation_time_constant,
        "deactivation_time_constant": millard.deactivation_time_constant,
        "maximum_pennation_angle": millard.maximum_pennation_angle,
        "ActiveForceLengthCurve": {
            "min_norm_active_fiber_length": active.min_norm_active_fiber_length,
            "transition_norm_fiber_length": active.transition_norm_fiber_length,
            "max_norm_active_fiber_length": active.max_norm_active_fiber_length,
            "shallow_ascending_slope": active.shallow_ascending_slope, "minimum_value": active.minimum_value,
        },
        "ForceVelocityCurve": {
            "concentric_slope_at_vmax": velocity.concentric_slope_at_vmax,
            "concentric_slope_near_vmax": velocity.concentric_slope_near_vmax,
            "isometric_slope": velocity.isometric_slope,
            "eccentric_slope_at_vmax": velocity.eccentric_slope_at_vmax,
            "eccentric_slope_near_vmax": velocity.eccentric_slope_near_vmax,
            "max_eccentric_velocity_force_multiplier": velocity.max_eccentric_velocity_force_multiplier,
            "concentric_curviness": velocity.concentric_curviness,
            "eccentric_curviness": velocity.eccentric_curviness,
        },
        "FiberForceLengthCurve": {
            "strain_at_zero_force": passive.strain_at_zero_force,
            "strain_at_one_norm_force": passive.strain_at_one_norm_force,
            "stiffness_at_low_force": passive.stiffness_at_low_force,
            "stiffness_at_one_norm_force": passive.stiffness_at_one_norm_force, "curviness": passive.curviness,
        },
        "TendonForceLengthCurve": {
            "strain_at_one_norm_force": tendon.strain_at_one_norm_force,
            "stiffness_at_one_norm_force": tendon.stiffness_at_one_norm_force,
            "norm_force_at_toe_end": tendon.norm_force_at_toe_end, "curviness": tendon.curviness,
        },
    });
    for (key, own) in own.as_object().expect("object") {
        value[key] = own.clone();
    }
    value
}

/// OpenSim overwrites some properties when it prepares the muscle
/// (`Millard2012EquilibriumMuscle::extendFinalizeFromProperties`); the specification keeps what the file says.
fn adjusted_as_by_opensim(millard: &Millard2012Spec, rigid_tendon: bool) -> Millard2012Spec {
    let mut millard = millard.clone();
    if millard.fiber_damping < 0.001 {
        millard.fiber_damping = 0.0;
    }
    let velocity = &mut millard.force_velocity;
    if !rigid_tendon && millard.fiber_damping == 0.0 {
        millard.active_force_length.minimum_value = millard.active_force_length.minimum_value.max(0.1);
        let floor = |at: f64, near: f64| at.max(0.5 * near);
        velocity.concentric_slope_at_vmax =
            floor(velocity.concentric_slope_at_vmax, velocity.concentric_slope_near_vmax);
        velocity.eccentric_slope_at_vmax = floor(velocity.eccentric_slope_at_vmax, velocity.eccentric_slope_near_vmax);
    } else {
        millard.minimum_activation = millard.minimum_activation.clamp(0.0, 1.0);
        millard.active_force_length.minimum_value = 0.0;
        velocity.concentric_slope_at_vmax = 0.0;
        velocity.eccentric_slope_at_vmax = 0.0;
    }
    millard
}

fn force_summary<'a>(
    force: &ForceSpec,
    frame: &dyn Fn(FrameIndex) -> &'a str,
    coordinate_name: &dyn Fn(CoordinateIndex) -> &'a str,
) -> Value {
    let mut value = json!({ "name": force.name, "applies_force": force.applies_force });
    match &force.kind {
        ForceKind::CoordinateLimit {
            coordinate,
            upper_stiffness,
            upper_limit,
            lower_stiffness,
            lower_limit,
            damping,
            transition,
            computes_dissipation: _,
        } => {
            let own = json!({
                "class": "CoordinateLimitForce", "coordinate": coordinate_name(*coordinate),
                "upper_stiffness": upper_stiffness, "upper_limit": upper_limit, "lower_stiffness": lower_stiffness,
                "lower_limit": lower_limit, "damping": damping, "transition": transition,
            });
            for (key, own) in own.as_object().expect("object") {
                value[key] = own.clone();
            }
        }
        ForceKind::FunctionBasedBushing { frame1, frame2, functions, rotational_damping, translational_damping } => {
            value["class"] = "FunctionBasedBushingForce".into();
            value["frames"] = json!([frame(*frame1), frame(*frame2)]);
            value["functions"] = functions.iter().map(function).collect();
            value["rotational_damping"] = json!(rotational_damping.as_slice());
            value["translational_damping"] = json!(translational_damping.as_slice());
        }
        ForceKind::Unsupported { class } => value["class"] = class.as_str().into(),
        _ => {}
    }
    value
}

#[test]
#[cfg_attr(not(has_models), ignore = "needs models (CARPUS_MODELS or CARPUS_SHARED)")]
fn val_opensim_unsupported_is_reported_for_every_force_that_is_not_computed() {
    for path in lab_models() {
        let file = OsimFile::read(&path).unwrap_or_else(|error| panic!("{error}"));
        let reported: Vec<&str> = file.diagnostics.of(Severity::Unsupported).map(|item| item.path.as_str()).collect();
        for muscle in &file.spec.muscles {
            let computed = !matches!(muscle.kind, MuscleKind::OtherClass { law: None, .. });
            assert_eq!(computed, !reported.contains(&muscle.at.path.as_str()), "{}", muscle.at.path);
        }
    }
}
