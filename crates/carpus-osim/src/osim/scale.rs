//! Linear scaling of everything in a model that has a length, as OpenSim's `Model::scale` does it: splices into the
//! text.
//!
//! In: scale factors of bodies, applied to whatever is fixed to them, and ratios of path lengths. Out: the same file
//! with the scaled values. Which factors, and how long paths are, is not decided here: see `carpus::scaling`.
//!
//! | component | scaled | by the factors of |
//! |---|---|---|
//! | `Body` | mass centre, mass, inertia, attached geometry | the body |
//! | `PhysicalOffsetFrame` | translation, attached geometry | the body its parent is fixed to |
//! | `CustomJoint` | functions of the translations | the body of the parent frame, weighted by the axis |
//! | path points, markers | location, functions of a moving point that follows a coordinate | the body it is fixed to |
//! | wrap objects | translation and size, in the directions of the surface's own axes | the body it is fixed to |
//! | `CoordinateCouplerConstraint` | `scale_factor`, if a translation follows | the body of that joint's parent frame |
//! | muscles, `Ligament`, `PathSpring` | optimal fibre, tendon slack and resting lengths | ratio of path lengths |
//!
//! All other forces, contact geometry, point constraints and default values of coordinates stay, as in OpenSim.

mod edits;
mod inertia;

use std::collections::HashMap;

use nalgebra::Vector3;

pub use inertia::scaled_inertia;

use super::document::ElementId;
use super::edit::EditError;
use super::file::OsimFile;
use super::spec::{
    ConstraintKind, ForceKind, FrameIndex, FrameKind, JointKind, Location, ModelSpec, MotionType, MuscleKind,
    PathPointKind, WrapShape,
};
use edits::Edits;

/// Names of the inertia's properties before format 30500, in the order xx yy zz xy xz yz.
const INERTIA_COMPONENTS: [&str; 6] =
    ["inertia_xx", "inertia_yy", "inertia_zz", "inertia_xy", "inertia_xz", "inertia_yz"];

/// What scaling a model's bodies did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScaledBodies {
    /// Mass of the model before [kg].
    pub mass_before: f64,
    /// Mass of the model after [kg].
    pub mass_after: f64,
    /// Components that have lengths and were not scaled: component path, and why.
    pub left: Vec<(String, String)>,
}

/// Why a model cannot be scaled.
#[derive(Debug, thiserror::Error)]
pub enum ScaleError {
    /// No body of that name.
    #[error("the model has no body `{name}`")]
    UnknownBody {
        /// The name.
        name: String,
        /// The most similar name.
        nearest: Option<String>,
    },
    /// A factor that is not a positive number.
    #[error("scale factor of {body}: expected a positive number, found {found}")]
    Factor {
        /// The body.
        body: String,
        /// The factor.
        found: f64,
    },
    /// A coupled translation of a body that is scaled differently along its axes.
    #[error(
        "{constraint}: its translation belongs to {body}, which is scaled by {factors:?}; OpenSim scales such a \
         coupler only by equal factors"
    )]
    UnevenCoupler {
        /// The constraint.
        constraint: String,
        /// The body.
        body: String,
        /// Its factors.
        factors: [f64; 3],
    },
    /// The file could not be edited.
    #[error(transparent)]
    Edit(#[from] EditError),
}

/// Scale factors of bodies (or of `ground`), along the axes of the body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyFactors(HashMap<String, Vector3<f64>>);

impl BodyFactors {
    /// Factors by the names of bodies; what is not named is not scaled.
    ///
    /// # Errors
    /// [`ScaleError::UnknownBody`], [`ScaleError::Factor`].
    pub fn new(spec: &ModelSpec, factors: &[(String, [f64; 3])]) -> Result<BodyFactors, ScaleError> {
        let names = || std::iter::once("ground").chain(spec.bodies.iter().map(|body| body.name.as_str()));
        let mut by_name = HashMap::new();
        for (name, of_body) in factors {
            if !names().any(|known| known == name) {
                let nearest = super::error::nearest(name, names());
                return Err(ScaleError::UnknownBody { name: name.clone(), nearest });
            }
            if let Some(&found) = of_body.iter().find(|f| !(f.is_finite() && **f > 0.0)) {
                return Err(ScaleError::Factor { body: name.clone(), found });
            }
            by_name.insert(name.clone(), Vector3::from(*of_body));
        }
        Ok(BodyFactors(by_name))
    }

    /// Factors of the body that a frame is fixed to; 1 where none were given.
    fn of_frame(&self, spec: &ModelSpec, frame: FrameIndex) -> Vector3<f64> {
        self.0.get(base_name(spec, frame)).copied().unwrap_or(Vector3::repeat(1.0))
    }

    /// Whether a body is scaled.
    fn contains(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }
}

/// Name of the body that a frame is fixed to.
fn base_name(spec: &ModelSpec, mut frame: FrameIndex) -> &str {
    while let FrameKind::Offset { parent, .. } = spec.frames[frame.0].kind {
        frame = parent;
    }
    &spec.frames[frame.0].name
}

impl OsimFile {
    /// Scales the bodies and everything fixed to them; lengths that depend on paths are left to
    /// [`OsimFile::scale_path_lengths`].
    ///
    /// - `preserve_mass_distribution`: bodies keep their mass; else it grows with the product of the factors
    /// - `final_mass`: mass that the model is brought to at the end [kg], all bodies in proportion
    ///
    /// # Errors
    /// [`ScaleError`]; the file is then as it was.
    ///
    /// # References
    /// OpenSim 4.6 `Model::scale`, `Body::scaleInertialProperties` and `extendScale` of each component.
    pub fn scale_bodies(
        &mut self,
        factors: &BodyFactors,
        preserve_mass_distribution: bool,
        final_mass: Option<f64>,
    ) -> Result<ScaledBodies, ScaleError> {
        let mut scaled = ScaledBodies::default();
        let mut edits = Edits::new(self);
        masses(self, factors, preserve_mass_distribution, final_mass, &mut edits, &mut scaled);
        frames(self, factors, &mut edits);
        joints(self, factors, &mut edits);
        paths(self, factors, &mut edits);
        wrap_objects(self, factors, &mut edits);
        for marker in &self.spec.markers {
            edits.scale_vector(&marker.at, &["location"], marker.location, factors.of_frame(&self.spec, marker.frame));
        }
        constraints(self, factors, &mut edits)?;
        unread_points(self, factors, &mut edits, &mut scaled.left);
        edits.finish(self)?;
        Ok(scaled)
    }

    /// Scales lengths along paths: optimal fibre and tendon slack lengths of muscles, resting lengths of ligaments and
    /// springs.
    ///
    /// - `ratio`: length after over length before, of the muscle or force with that component path
    ///
    /// # Errors
    /// [`EditError`]; the file is then as it was.
    pub fn scale_path_lengths(&mut self, ratio: &HashMap<String, f64>) -> Result<(), EditError> {
        let mut edits = Edits::new(self);
        for muscle in &self.spec.muscles {
            // OpenSim's RigidTendonMuscle has no such rule.
            let excluded = matches!(&muscle.kind, MuscleKind::OtherClass { class, .. } if class == "RigidTendonMuscle");
            let Some(ratio) = ratio.get(&muscle.at.path).filter(|_| !excluded) else { continue };
            edits.scale_number(&muscle.at, &["optimal_fiber_length"], muscle.optimal_fiber_length, *ratio);
            edits.scale_number(&muscle.at, &["tendon_slack_length"], muscle.tendon_slack_length, *ratio);
        }
        for force in &self.spec.forces {
            let (property, length) = match &force.kind {
                ForceKind::Ligament { resting_length, .. } | ForceKind::PathSpring { resting_length, .. } => {
                    ("resting_length", *resting_length)
                }
                ForceKind::Blankevoort1991Ligament { slack_length, .. } => ("slack_length", *slack_length),
                _ => continue,
            };
            if let Some(ratio) = ratio.get(&force.at.path) {
                edits.scale_number(&force.at, &[property], length, *ratio);
            }
        }
        edits.finish(self)
    }
}

/// Mass, mass centre and inertia of every body.
fn masses(
    file: &OsimFile,
    factors: &BodyFactors,
    preserve_mass_distribution: bool,
    final_mass: Option<f64>,
    edits: &mut Edits,
    scaled: &mut ScaledBodies,
) {
    let spec = &file.spec;
    let mut bodies: Vec<_> = spec.bodies.iter().map(|body| (body.mass, body.inertia)).collect();
    scaled.mass_before = bodies.iter().map(|(mass, _)| mass).sum();
    for (body, (mass, inertia)) in spec.bodies.iter().zip(&mut bodies) {
        if factors.contains(&body.name) {
            let of_body = factors.of_frame(spec, body.frame);
            (*mass, *inertia) = scaled_inertia(body.mass, &body.inertia, &of_body, !preserve_mass_distribution);
            edits.scale_vector(&body.at, &["mass_center"], body.mass_center, of_body);
        }
    }
    scaled.mass_after = bodies.iter().map(|(mass, _)| mass).sum();
    if let Some(final_mass) = final_mass.filter(|mass| *mass > 0.0 && scaled.mass_after > 0.0) {
        let share = final_mass / scaled.mass_after;
        bodies.iter_mut().for_each(|(mass, inertia)| {
            *mass *= share;
            *inertia *= share;
        });
        scaled.mass_after = final_mass;
    }
    for (body, (mass, inertia)) in spec.bodies.iter().zip(bodies) {
        edits.set_numbers(&body.at, &["mass"], &[body.mass], &[mass]);
        if mass <= f64::EPSILON && factors.contains(&body.name) {
            // OpenSim takes the inertia of a body without mass as zero, and writes it so once it has scaled it.
            edits.set_zero(&body.at, "inertia");
            INERTIA_COMPONENTS.iter().for_each(|name| edits.set_zero(&body.at, name));
            continue;
        }
        let components =
            |m: &nalgebra::Matrix3<f64>| [m[(0, 0)], m[(1, 1)], m[(2, 2)], m[(0, 1)], m[(0, 2)], m[(1, 2)]];
        let (before, after) = (components(&body.inertia), components(&inertia));
        if spec.document_version < 30500 {
            for (i, name) in INERTIA_COMPONENTS.into_iter().enumerate() {
                edits.set_numbers(&body.at, &[name], &before[i..=i], &after[i..=i]);
            }
        } else {
            edits.set_numbers(&body.at, &["inertia"], &before, &after);
        }
    }
}

/// Translations of offset frames, and geometry attached to frames.
fn frames(file: &OsimFile, factors: &BodyFactors, edits: &mut Edits) {
    let spec = &file.spec;
    for (i, frame) in spec.frames.iter().enumerate() {
        let of_frame = factors.of_frame(spec, FrameIndex(i));
        if let FrameKind::Offset { translation, .. } = frame.kind {
            if let Some(property) = linked_location(file, i) {
                edits.scale_vector(&frame.at, &[property], translation, of_frame);
                continue;
            }
            let names = location_names(spec, i);
            edits.scale_vector(&frame.at, names, translation, of_frame);
            if names != ["translation"] {
                continue; // the element is the joint's
            }
        }
        edits.scale_geometry(&frame.at, of_frame);
    }
}

/// Property of a bushing or weld of an old file that holds the translation of an offset frame.
fn linked_location(file: &OsimFile, frame: usize) -> Option<&'static str> {
    let (spec, document) = (&file.spec, &file.document);
    let element = spec.frames[frame].at.element?;
    let mut linkers = spec.forces.iter().map(|f| &f.at).chain(spec.constraints.iter().map(|c| &c.at));
    linkers.find(|at| at.element == Some(element))?;
    let is_of = |property: &str| {
        let body = document.child(ElementId(element), property).map(|body| document.text(body));
        body.is_some_and(|body| format!("{}_offset", body.trim()) == spec.frames[frame].name)
    };
    Some(if is_of("body_1") { "location_body_1" } else { "location_body_2" })
}

/// How a file names the translation of an offset frame: before 30505 the frames of joints are properties of the joint.
fn location_names(spec: &ModelSpec, frame: usize) -> &'static [&'static str] {
    let at = &spec.frames[frame].at;
    let is_joint = at.element.is_some() && spec.joints.iter().any(|joint| joint.at.element == at.element);
    if !is_joint {
        return &["translation"];
    }
    let first = spec.frames.iter().position(|other| other.at.element == at.element);
    if first == Some(frame) { &["location_in_parent"] } else { &["location_in_child", "location"] }
}

/// Translations of custom joints, radii and lengths of others; couplers are in [`constraints`].
fn joints(file: &OsimFile, factors: &BodyFactors, edits: &mut Edits) {
    for joint in &file.spec.joints {
        let of_parent = factors.of_frame(&file.spec, joint.parent_frame);
        let of_child = factors.of_frame(&file.spec, joint.child_frame);
        let axes = match &joint.kind {
            JointKind::Custom(axes) => axes,
            JointKind::Ellipsoid { radii_x_y_z } => {
                edits.scale_vector(&joint.at, &["radii_x_y_z"], *radii_x_y_z, of_parent);
                continue;
            }
            JointKind::Scapulothoracic {
                thoracic_ellipsoid_radii_x_y_z: radii,
                scapula_winging_axis_origin: origin,
                ..
            } => {
                edits.scale_vector(&joint.at, &["thoracic_ellipsoid_radii_x_y_z"], *radii, of_parent);
                let scaled = [origin[0] * of_child.x, origin[1] * of_child.y];
                edits.set_numbers(&joint.at, &["scapula_winging_axis_origin"], origin, &scaled);
                continue;
            }
            JointKind::ConstantCurvature { length, .. } => {
                edits.scale_number(&joint.at, &["length"], *length, of_child.y);
                continue;
            }
            _ => continue,
        };
        for (axis, name) in axes[3..].iter().zip(["translation1", "translation2", "translation3"]) {
            edits.scale_axis_function(&joint.at, name, &axis.function, axis.axis.abs().dot(&of_parent));
        }
    }
}

/// Path points of muscles, ligaments and springs.
fn paths(file: &OsimFile, factors: &BodyFactors, edits: &mut Edits) {
    let of_forces = file.spec.forces.iter().filter_map(|force| force.kind.path());
    for path in file.spec.muscles.iter().map(|muscle| &muscle.path).chain(of_forces) {
        for point in &path.points {
            let of_body = factors.of_frame(&file.spec, point.frame);
            match &point.kind {
                PathPointKind::Fixed { location } | PathPointKind::Conditional { location, .. } => {
                    edits.scale_vector(&point.at, &["location"], *location, of_body);
                }
                PathPointKind::Moving { location } => {
                    let names =
                        [["x_location", "XAttachment"], ["y_location", "YAttachment"], ["z_location", "ZAttachment"]];
                    for ((names, (function, coordinate)), factor) in
                        names.iter().zip(location.iter()).zip(of_body.iter())
                    {
                        // OpenSim leaves a component alone that follows no coordinate.
                        if coordinate.is_some() {
                            edits.scale_point_function(&point.at, names, function, *factor);
                        }
                    }
                }
            }
        }
    }
}

/// Position and size of wrap objects.
fn wrap_objects(file: &OsimFile, factors: &BodyFactors, edits: &mut Edits) {
    for wrap in &file.spec.wrap_objects {
        let of_body = factors.of_frame(&file.spec, wrap.frame);
        edits.scale_vector(&wrap.at, &["translation"], wrap.translation, of_body);
        let angles = wrap.xyz_body_rotation;
        let rotation = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), angles.x)
            * nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), angles.y)
            * nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), angles.z);
        let along = |axis: usize| rotation.matrix().column(axis).component_mul(&of_body).norm();
        let across = 0.5 * (along(0) + along(1));
        match wrap.shape {
            WrapShape::Sphere { radius } => edits.scale_number(&wrap.at, &["radius"], radius, of_body.sum() / 3.0),
            WrapShape::Cylinder { radius, length } => {
                edits.scale_number(&wrap.at, &["radius"], radius, across);
                edits.scale_number(&wrap.at, &["length"], length, along(2));
            }
            WrapShape::Ellipsoid { dimensions } => {
                let by = Vector3::new(along(0), along(1), along(2));
                edits.scale_vector(&wrap.at, &["dimensions"], dimensions.into(), by);
            }
            WrapShape::Torus { inner_radius, outer_radius } => {
                edits.scale_number(&wrap.at, &["inner_radius"], inner_radius, across);
                edits.scale_number(&wrap.at, &["outer_radius"], outer_radius, across);
            }
        }
    }
}

/// Couplers that translations follow.
fn constraints(file: &OsimFile, factors: &BodyFactors, edits: &mut Edits) -> Result<(), ScaleError> {
    let spec = &file.spec;
    for constraint in &spec.constraints {
        let ConstraintKind::CoordinateCoupler { dependent_coordinate, scale_factor, .. } = &constraint.kind else {
            continue;
        };
        let dependent = &spec.coordinates[dependent_coordinate.0];
        if dependent.motion_type != MotionType::Translational {
            continue;
        }
        let frame = spec.joints[dependent.joint.0].parent_frame;
        let of_parent = factors.of_frame(spec, frame);
        if of_parent.x != of_parent.y || of_parent.x != of_parent.z {
            return Err(ScaleError::UnevenCoupler {
                constraint: constraint.at.path.clone(),
                body: base_name(spec, frame).to_owned(),
                factors: of_parent.into(),
            });
        }
        edits.scale_number(&constraint.at, &["scale_factor"], *scale_factor, of_parent.x);
    }
    Ok(())
}

/// Path points of forces that are not computed here: scaled where their frame is plain, else listed.
fn unread_points(file: &OsimFile, factors: &BodyFactors, edits: &mut Edits, left: &mut Vec<(String, String)>) {
    let (document, spec) = (&file.document, &file.spec);
    for (i, frame) in spec.frames.iter().enumerate() {
        let is_of_stations = matches!(frame.kind, FrameKind::Offset { .. }) && frame.at.element.is_none();
        if is_of_stations && factors.of_frame(spec, FrameIndex(i)) != Vector3::repeat(1.0) {
            left.push((frame.at.path.clone(), "StationDefinedFrame: its stations stay".to_owned()));
        }
    }
    for force in &spec.forces {
        let (ForceKind::Unsupported { class }, Some(element)) = (&force.kind, force.at.element) else { continue };
        if class == "ExpressionBasedPathForce" {
            left.push((force.at.path.clone(), format!("{class}: its slack or resting length stays")));
        }
        let mut open = vec![ElementId(element)];
        while let Some(at) = open.pop() {
            open.extend(document.children(at));
            let tag = document.tag(at);
            let is_point = matches!(tag, "PathPoint" | "ConditionalPathPoint" | "MusclePoint" | "MuscleViaPoint");
            if !is_point && !matches!(tag, "MovingPathPoint" | "MovingMusclePoint") {
                continue;
            }
            let name = document.attribute(at, "name").unwrap_or_default();
            let path = format!("{}/{name}", force.at.path);
            let named = ["socket_parent_frame", "body"].iter().find_map(|tag| document.child(at, tag));
            let wanted = named.map(|named| document.text(named)).unwrap_or_default();
            let frame =
                spec.frames.iter().position(|f| f.at.path == wanted || (f.name == wanted && !wanted.is_empty()));
            let location = document.child(at, "location").map(|location| document.text(location));
            let numbers =
                location.map(|text| text.split_ascii_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>());
            match (frame, numbers) {
                (Some(frame), Some(Ok(numbers))) if is_point && numbers.len() == 3 => {
                    let of_body = factors.of_frame(spec, FrameIndex(frame));
                    let at = Location { line: document.line(at), path, element: Some(at.0), ..Location::default() };
                    edits.scale_vector(&at, &["location"], Vector3::from_column_slice(&numbers), of_body);
                }
                _ => left.push((path, format!("{tag} of a {class}: its frame or location is not understood"))),
            }
        }
    }
}
