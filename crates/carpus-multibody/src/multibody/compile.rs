//! From specification to compiled model.

use super::beyond::Beyond;
use super::coordinate::Coordinate;
use super::coupler::compile_couplers;
use super::error::CompileError;
use super::index::{BaseIndex, coordinate_in};
use super::mobilizer::{Axis, AxisMotion, Mobilizer, Node, Speeds, turning_in_simbody};
use super::model::{Body, Frame, LoopWeld, Model, WrapPlacement};
use carpus_numerics::spatial::Transform;
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{
    BodyIndex, ConstraintKind, CoordinateIndex, FrameIndex, FrameKind, FunctionSpec, JointIndex, JointKind, JointSpec,
    Location, ModelSpec, TransformAxisSpec,
};
use nalgebra::{Matrix3, Vector3};

/// Two axes whose cross product is shorter than this are parallel (`CustomJoint::extendFinalizeFromProperties`).
const PARALLEL_AXES_TOLERANCE: f64 = 1e-5;

impl Model {
    /// Compiles a specification.
    ///
    /// # Errors
    /// Any [`CompileError`]: dangling references, frames or couplers that form cycles, joints that have parallel axes,
    /// functions that cannot be built, numbers that are not finite.
    pub fn compile(spec: &ModelSpec) -> Result<Model, CompileError> {
        let frames = compile_frames(spec)?;
        let loop_welds = cut_loops(spec);
        let (nodes, unattached_bodies) = compile_tree(spec, &frames, &loop_welds)?;
        let couplers = compile_couplers(spec)?;
        let mut driven_by = vec![None; spec.coordinates.len()];
        for (i, coupler) in couplers.iter().enumerate() {
            driven_by[coupler.dependent.0] = Some(i);
        }
        let mut node_of_base = vec![None; spec.bodies.len() + loop_welds.len() + 1];
        for (i, node) in nodes.iter().enumerate() {
            node_of_base[node.outboard.0] = Some(i);
        }
        Ok(Model {
            name: spec.name.clone(),
            gravity: spec.gravity,
            coordinates: compile_coordinates(spec)?,
            bodies: compile_bodies(spec, &loop_welds)?,
            wrap_objects: compile_wrap_objects(spec, &frames)?,
            frames,
            couplers,
            unsupported_constraints: unsupported_constraints(spec, &loop_welds),
            loop_welds,
            unattached_bodies,
            nodes,
            node_of_base,
            driven_by,
        })
    }
}

/// Takes a part of the child of every joint that closes a loop.
fn cut_loops(spec: &ModelSpec) -> Vec<LoopWeld> {
    let joints = spec.loop_joints().into_iter();
    let cut = |(k, joint): (usize, JointIndex)| {
        let whole = spec.base_of(spec.joints[joint.0].child_frame).map_or(BaseIndex::GROUND, BaseIndex::from);
        LoopWeld { joint, bases: [whole, BaseIndex(spec.bodies.len() + 1 + k)] }
    };
    joints.enumerate().map(cut).collect()
}

/// Bodies, then the parts that loops take of them; a body and its parts share its mass evenly.
fn compile_bodies(spec: &ModelSpec, loop_welds: &[LoopWeld]) -> Result<Vec<Body>, CompileError> {
    let mut bodies = spec
        .bodies
        .iter()
        .map(|body| {
            check_finite(&body.at, "mass", &[body.mass])?;
            check_finite(&body.at, "mass_center", body.mass_center.as_slice())?;
            check_finite(&body.at, "inertia", body.inertia.as_slice())?;
            let inertia = if body.mass == 0.0 { Matrix3::zeros() } else { body.inertia };
            Ok(Body { name: body.name.clone(), mass: body.mass, mass_center: body.mass_center, inertia })
        })
        .collect::<Result<Vec<_>, _>>()?;
    let parts_of = |whole: BaseIndex| loop_welds.iter().filter(move |weld| weld.bases[0] == whole).count();
    for (i, body) in bodies.iter_mut().enumerate() {
        let share = 1.0 / (1 + parts_of(BaseIndex::from(BodyIndex(i)))) as f64;
        body.mass *= share;
        body.inertia *= share;
    }
    for (k, weld) in loop_welds.iter().enumerate() {
        let number = loop_welds[..k].iter().filter(|other| other.bases[0] == weld.bases[0]).count();
        let part = match weld.bases[0].body() {
            Some(body) => Body { name: format!("{}_slave_{number}", bodies[body.0].name), ..bodies[body.0].clone() },
            // Ground has no mass.
            None => Body {
                name: format!("ground_slave_{number}"),
                mass: 0.0,
                mass_center: Vector3::zeros(),
                inertia: Matrix3::zeros(),
            },
        };
        bodies.push(part);
    }
    Ok(bodies)
}

fn compile_coordinates(spec: &ModelSpec) -> Result<Vec<Coordinate>, CompileError> {
    spec.coordinates
        .iter()
        .map(|c| {
            check_finite(&c.at, "default_value", &[c.default_value])?;
            check_finite(&c.at, "default_speed_value", &[c.default_speed_value])?;
            let prescribed = match (&c.prescribed_function, c.prescribed) {
                (Some(function), true) => Some(compile_function(&c.at, "prescribed_function", function)?),
                _ => None,
            };
            Ok(Coordinate {
                name: c.name.clone(),
                joint: c.joint,
                default_value: c.default_value,
                default_speed_value: c.default_speed_value,
                range: c.range,
                clamped: c.clamped,
                locked: c.locked,
                prescribed,
                is_free_to_satisfy_constraints: c.is_free_to_satisfy_constraints,
                motion_type: c.motion_type,
            })
        })
        .collect()
}

fn unsupported_constraints(spec: &ModelSpec, loop_welds: &[LoopWeld]) -> Vec<(String, String)> {
    let loops = loop_welds.iter();
    spec.constraints
        .iter()
        .filter(|c| c.is_enforced)
        .filter(|c| !matches!(c.kind, ConstraintKind::CoordinateCoupler { .. }))
        .map(|c| (c.name.clone(), c.kind.class().to_owned()))
        .chain(loops.map(|weld| (spec.joints[weld.joint.0].name.clone(), "joint that closes a loop".to_owned())))
        .collect()
}

/// Locates every frame in the body (or ground) that it is, through its parents, fixed to.
#[allow(non_snake_case)]
fn compile_frames(spec: &ModelSpec) -> Result<Vec<Frame>, CompileError> {
    let mut frames = Vec::with_capacity(spec.frames.len());
    for frame in &spec.frames {
        let mut X_BF = Transform::identity();
        let mut current = frame;
        let mut depth = 0;
        let base = loop {
            match &current.kind {
                FrameKind::Ground => break BaseIndex::GROUND,
                FrameKind::Body(body) => {
                    check_index(&current.at, "body", body.0, spec.bodies.len())?;
                    break BaseIndex::from(*body);
                }
                FrameKind::Offset { parent, translation, orientation } => {
                    check_finite(&current.at, "translation", translation.as_slice())?;
                    check_finite(&current.at, "orientation", orientation.as_slice())?;
                    X_BF = Transform::from_translation_body_xyz(*translation, *orientation) * X_BF;
                    check_index(&current.at, "frame", parent.0, spec.frames.len())?;
                    current = &spec.frames[parent.0];
                }
            }
            depth += 1;
            if depth > spec.frames.len() {
                return Err(CompileError::FrameCycle { at: frame.at.clone() });
            }
        };
        frames.push(Frame { name: frame.name.clone(), base, X_BF });
    }
    Ok(frames)
}

#[allow(non_snake_case)]
fn compile_wrap_objects(spec: &ModelSpec, frames: &[Frame]) -> Result<Vec<WrapPlacement>, CompileError> {
    spec.wrap_objects
        .iter()
        .map(|wrap| {
            check_finite(&wrap.at, "translation", wrap.translation.as_slice())?;
            check_finite(&wrap.at, "xyz_body_rotation", wrap.xyz_body_rotation.as_slice())?;
            let frame = frame_in(frames, wrap.frame, &wrap.at)?;
            let X_FW = Transform::from_translation_body_xyz(wrap.translation, wrap.xyz_body_rotation);
            Ok(WrapPlacement { base: frame.base, X_BW: frame.X_BF * X_FW })
        })
        .collect()
}

/// Sorts joints into a tree rooted at ground. Also returns the bodies that no joint connects to ground.
fn compile_tree(
    spec: &ModelSpec,
    frames: &[Frame],
    loop_welds: &[LoopWeld],
) -> Result<(Vec<Node>, Vec<BodyIndex>), CompileError> {
    let mut pending: Vec<usize> = (0..spec.joints.len()).collect();
    let mut nodes = Vec::with_capacity(spec.joints.len());
    let mut attached = vec![false; spec.bodies.len() + loop_welds.len() + 1];
    let mut unattached = Vec::new();
    attached[BaseIndex::GROUND.0] = true;
    loop {
        let mut progress = false;
        let mut left = Vec::new();
        for joint_number in pending {
            let joint = &spec.joints[joint_number];
            let parent = frame_in(frames, joint.parent_frame, &joint.at)?;
            let child = frame_in(frames, joint.child_frame, &joint.at)?;
            // A joint that closes a loop holds a part of its child.
            let weld = loop_welds.iter().find(|weld| weld.joint.0 == joint_number);
            let child = &Frame { base: weld.map_or(child.base, |weld| weld.bases[1]), ..child.clone() };
            if parent.base == child.base {
                return Err(CompileError::JointWithinBody { at: joint.at.clone(), body: base_name(spec, parent.base) });
            }
            match (attached[parent.base.0], attached[child.base.0]) {
                // Loops are cut, so that not both are attached.
                (true, true) | (false, false) => left.push(joint_number),
                (parent_attached, _) => {
                    let reversed = !parent_attached;
                    let (inboard, outboard) = if reversed { (child, parent) } else { (parent, child) };
                    attached[outboard.base.0] = true;
                    progress = true;
                    let mobilizer = compile_mobilizer(spec, joint)?;
                    let mut coordinates: Vec<usize> = mobilizer.coordinates().map(|c| c.0).collect();
                    coordinates.sort_unstable();
                    coordinates.dedup();
                    nodes.push(Node {
                        joint: JointIndex(joint_number),
                        inboard: inboard.base,
                        outboard: outboard.base,
                        reversed,
                        X_PF: inboard.X_BF,
                        X_MB: outboard.X_BF.inverse(),
                        mobilizer,
                        coordinates,
                    });
                }
            }
        }
        pending = left;
        if !progress {
            // Bodies that hang together without any connection to ground: OpenSim frees one of them.
            match loose_body(spec, frames, &attached) {
                Some(body) => {
                    attached[BaseIndex::from(body).0] = true;
                    unattached.push(body);
                }
                None => return Ok((nodes, unattached)),
            }
        }
    }
}

/// A body not yet attached, preferably one that is nobody's child.
fn loose_body(spec: &ModelSpec, frames: &[Frame], attached: &[bool]) -> Option<BodyIndex> {
    let is_child =
        |body: BodyIndex| spec.joints.iter().any(|joint| frames[joint.child_frame.0].base == BaseIndex::from(body));
    let loose = || (0..spec.bodies.len()).map(BodyIndex).filter(|&b| !attached[BaseIndex::from(b).0]);
    loose().find(|&body| !is_child(body)).or_else(|| loose().next())
}

fn base_name(spec: &ModelSpec, base: BaseIndex) -> String {
    base.body().map_or_else(|| "ground".into(), |body| spec.bodies[body.0].name.clone())
}

fn compile_mobilizer(spec: &ModelSpec, joint: &JointSpec) -> Result<Mobilizer, CompileError> {
    for &coordinate in &joint.coordinates {
        coordinate_in(spec, coordinate, &joint.at)?;
    }
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let (rotations, translations, speeds): (&[Vector3<f64>], &[Vector3<f64>], Speeds) = match &joint.kind {
        JointKind::Weld => (&[], &[], Speeds::CoordinateRates),
        JointKind::Pin => (&[z], &[], Speeds::CoordinateRates),
        JointKind::Slider => (&[], &[x], Speeds::CoordinateRates),
        JointKind::Universal => (&[x, y], &[], Speeds::CoordinateRates),
        JointKind::Ball => (&[x, y, z], &[], Speeds::AngularVelocity),
        JointKind::Gimbal => (&[x, y, z], &[], Speeds::CoordinateRates),
        JointKind::Planar => (&[z], &[x, y], Speeds::CoordinateRates),
        JointKind::Free => (&[x, y, z], &[x, y, z], Speeds::AngularVelocity),
        JointKind::Ellipsoid { .. } => (&[x, y, z], &[], Speeds::AngularVelocity),
        // The ellipsoid's own axes are turned by 90° about z.
        JointKind::Scapulothoracic { .. } => (&[y, -x, z], &[], Speeds::AngularVelocity),
        JointKind::ConstantCurvature { .. } => (&[x, z, y], &[], Speeds::CoordinateRates),
        JointKind::Custom(axes) => return compile_custom(spec, joint, axes),
    };
    let beyond = match &joint.kind {
        JointKind::Ellipsoid { radii_x_y_z: radii } => Some(Beyond::Ellipsoid { radii: *radii }),
        JointKind::Scapulothoracic {
            thoracic_ellipsoid_radii_x_y_z: radii,
            scapula_winging_axis_origin: [origin_x, origin_y],
            scapula_winging_axis_direction: direction,
        } => {
            let Some(&coordinate) = joint.coordinates.get(3) else {
                let found = joint.coordinates.len();
                return Err(CompileError::CoordinateCount { at: joint.at.clone(), expected: 4, found });
            };
            let axis = Vector3::new(-direction.sin(), direction.cos(), 0.0);
            let origin = Vector3::new(*origin_x, *origin_y, 0.0);
            Some(Beyond::EllipsoidAndPin { radii: *radii, axis, origin, coordinate })
        }
        JointKind::ConstantCurvature { length, .. } => Some(Beyond::Arc { length: *length }),
        _ => None,
    };
    if let Some(beyond) = &beyond {
        check_finite(&joint.at, "radii or length", &beyond.lengths())?;
    }
    let pinned = usize::from(matches!(beyond, Some(Beyond::EllipsoidAndPin { .. })));
    let expected = rotations.len() + translations.len() + pinned;
    if joint.coordinates.len() != expected {
        let found = joint.coordinates.len();
        return Err(CompileError::CoordinateCount { at: joint.at.clone(), expected, found });
    }
    let neutral = match &joint.kind {
        JointKind::ConstantCurvature { neutral_angle_x_z_y, .. } => *neutral_angle_x_z_y,
        _ => Vector3::zeros(),
    };
    check_finite(&joint.at, "neutral_angle_x_z_y", neutral.as_slice())?;
    let axis = |(&direction, &coordinate): (&Vector3<f64>, &CoordinateIndex)| {
        Axis::new(direction, AxisMotion::identity(coordinate))
    };
    let turned = |(k, (&direction, &coordinate)): (usize, (&Vector3<f64>, &CoordinateIndex))| {
        Axis::new(direction, AxisMotion::Linear { coordinate, slope: 1.0, intercept: neutral[k] })
    };
    let (angles, displacements) = joint.coordinates.split_at(rotations.len());
    Ok(Mobilizer {
        rotations: rotations.iter().zip(angles).enumerate().map(turned).collect(),
        translations: translations.iter().zip(displacements).map(axis).collect(),
        speeds,
        beyond,
        in_simbody: None,
        follows_simbody: false,
    })
}

/// A CustomJoint: rotations about three axes, each turned by those before it, then displacements along three axes
/// fixed in the parent frame. Axes are normalized; they need not be orthogonal. Mirrors Simbody's
/// `MobilizedBody::FunctionBased`, except where that one's velocities contradict its poses: it takes a rotation by a
/// nonzero `Constant` without coordinates for zero when it computes the axes of the rotations after it.
fn compile_custom(
    spec: &ModelSpec,
    joint: &JointSpec,
    axes: &[TransformAxisSpec; 6],
) -> Result<Mobilizer, CompileError> {
    for (i, axis) in axes.iter().enumerate() {
        let v = axis.axis;
        if !v.iter().all(|c| c.is_finite()) || v.norm() == 0.0 {
            return Err(CompileError::DegenerateAxis { at: joint.at.clone(), axis: i + 1, x: v.x, y: v.y, z: v.z });
        }
    }
    for (kind, start) in [("rotation", 0), ("translation", 3)] {
        for (first, second) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b) = (axes[start + first].axis, axes[start + second].axis);
            if a.cross(&b).norm() < PARALLEL_AXES_TOLERANCE {
                let at = joint.at.clone();
                return Err(CompileError::ParallelAxes { at, kind, first: first + 1, second: second + 1 });
            }
        }
    }
    let mut compiled = Vec::with_capacity(6);
    for (i, axis) in axes.iter().enumerate() {
        let motion = compile_axis_motion(spec, joint, i, axis)?;
        compiled.push(Axis::new(axis.axis.normalize(), motion));
    }
    let moves = |axis: &Axis| !matches!(axis.motion, AxisMotion::Fixed(value) if value == 0.0);
    let translations = compiled.split_off(3).into_iter().filter(moves).collect();
    let moving: Vec<(usize, &Axis)> = compiled.iter().enumerate().filter(|(_, axis)| moves(axis)).collect();
    let in_simbody = turning_in_simbody(&moving, &joint.coordinates);
    let rotations = compiled.into_iter().filter(moves).collect();
    let speeds = Speeds::CoordinateRates;
    Ok(Mobilizer { rotations, translations, speeds, beyond: None, in_simbody, follows_simbody: false })
}

fn compile_axis_motion(
    spec: &ModelSpec,
    joint: &JointSpec,
    number: usize,
    axis: &TransformAxisSpec,
) -> Result<AxisMotion, CompileError> {
    const AXES: [&str; 6] = ["rotation1", "rotation2", "rotation3", "translation1", "translation2", "translation3"];
    let several = || {
        let name = |c: &CoordinateIndex| spec.coordinates.get(c.0).map_or("?", |c| c.name.as_str());
        let coordinates = axis.coordinates.iter().map(name).collect::<Vec<_>>().join(", ");
        CompileError::SeveralCoordinates { at: joint.at.clone(), axis: AXES[number], coordinates }
    };
    let is_of_several = axis.coordinates.len() > 1;
    let function = compile_function(&joint.at, AXES[number], &axis.function);
    let function = if is_of_several { function.map_err(|_| several())? } else { function? };
    if let Some(value) = function.constant_value() {
        return Ok(AxisMotion::Fixed(value));
    }
    if is_of_several {
        return Err(several());
    }
    if let (true, Some(value)) = (axis.coordinates.is_empty(), function.value_of_nothing()) {
        return Ok(AxisMotion::Fixed(value));
    }
    let &[coordinate] = axis.coordinates.as_slice() else {
        return Err(CompileError::ArgumentCount {
            at: joint.at.clone(),
            property: AXES[number].into(),
            found: axis.coordinates.len(),
        });
    };
    let coordinate = coordinate_in(spec, coordinate, &joint.at)?;
    Ok(match function.linear_coefficients() {
        Some((slope, intercept)) => AxisMotion::Linear { coordinate, slope, intercept },
        None => AxisMotion::Function { coordinate, function },
    })
}

fn compile_function(at: &Location, property: &str, spec: &FunctionSpec) -> Result<Function, CompileError> {
    Function::compile(spec).map_err(|source| CompileError::Function {
        at: at.clone(),
        property: property.into(),
        source,
    })
}

fn frame_in<'a>(frames: &'a [Frame], frame: FrameIndex, at: &Location) -> Result<&'a Frame, CompileError> {
    check_index(at, "frame", frame.0, frames.len())?;
    Ok(&frames[frame.0])
}

fn check_index(at: &Location, what: &'static str, index: usize, count: usize) -> Result<(), CompileError> {
    if index < count { Ok(()) } else { Err(CompileError::BadReference { at: at.clone(), what, index, count }) }
}

fn check_finite(at: &Location, property: &'static str, values: &[f64]) -> Result<(), CompileError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(&found) => Err(CompileError::NotFinite { at: at.clone(), property, found }),
        None => Ok(()),
    }
}
