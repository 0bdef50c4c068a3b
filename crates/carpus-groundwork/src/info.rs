//! What is in a model, and what was made of it.

use std::path::Path;

use serde::Serialize;

use super::diagnostic::{Diagnostic, Failure};
use super::info_study::StudyUse;
use super::model;
use carpus_multibody::multibody::Model;
use carpus_osim::osim::spec::{CoordinateIndex, JointKind, ModelSpec, MotionType, MuscleKind, MuscleSpec};
use carpus_osim::osim::{Diagnostics, OsimFile};

/// A coordinate, for people and programs.
#[derive(Debug, Serialize)]
pub struct CoordinateInfo {
    /// Its name.
    pub name: String,
    /// Line in the file.
    pub line: usize,
    /// Kind of motion.
    pub motion_type: &'static str,
    /// Unit of the values.
    pub unit: &'static str,
    /// Default.
    pub default_value: f64,
    /// Range.
    pub range: [f64; 2],
    /// Whether it is clamped to the range.
    pub clamped: bool,
    /// Whether it is locked.
    pub locked: bool,
    /// Coordinates that it depends on.
    pub follows: Option<String>,
}

/// A muscle, for people and programs.
#[derive(Debug, Serialize)]
pub struct MuscleInfo {
    /// Its name.
    pub name: String,
    /// Line in the file.
    pub line: usize,
    /// OpenSim class.
    pub class: String,
    /// Maximum isometric force.
    pub max_isometric_force_n: f64,
    /// Optimal fibre length.
    pub optimal_fiber_length_m: f64,
    /// Tendon slack length.
    pub tendon_slack_length_m: f64,
    /// Pennation at the optimal length.
    pub pennation_angle_at_optimal_deg: f64,
    /// OpenSim class of its path.
    pub path: &'static str,
    /// Points of its path.
    pub path_points: usize,
    /// Wrap objects of its path.
    pub wraps: usize,
    /// Whether it applies a force.
    pub applies_force: bool,
}

impl CoordinateInfo {
    /// Whether the range is one that stands for none: a hundred turns or a kilometre both ways, as OpenSim writes for
    /// followers.
    pub fn is_unlimited(&self) -> bool {
        let far = if self.unit == "deg" { 36_000.0 } else { 1000.0 };
        self.range[0] <= -far && self.range[1] >= far
    }

    /// What is unusual about it.
    pub fn notes(&self) -> String {
        let mut notes = Vec::new();
        notes.extend(self.locked.then(|| "locked".to_string()));
        notes.extend((!self.clamped).then(|| "not clamped".to_string()));
        notes.extend(self.follows.as_ref().map(|f| format!("follows {f}")));
        notes.join(", ")
    }
}

impl MuscleInfo {
    /// What is unusual about it.
    pub fn notes(&self) -> String {
        let mut notes = Vec::new();
        notes.extend((self.class != "Millard2012EquilibriumMuscle").then(|| self.class.clone()));
        notes.extend((self.path != "GeometryPath").then(|| self.path.to_string()));
        notes.extend((!self.applies_force).then(|| "applies no force".to_string()));
        notes.join(", ")
    }
}

/// What is in a model.
#[derive(Debug, Serialize)]
pub struct Info {
    /// Name and version of the form.
    pub schema: &'static str,
    /// The file.
    pub file: String,
    /// Name of the model.
    pub model: String,
    /// Format.
    pub document_version: u32,
    /// How many bodies.
    pub bodies: usize,
    /// How many joints.
    pub joints: usize,
    /// How many wrap objects.
    pub wrap_objects: usize,
    /// How many constraints.
    pub constraints: usize,
    /// How many forces that are no muscles.
    pub forces: usize,
    /// How many markers.
    pub markers: usize,
    /// The coordinates.
    pub coordinates: Vec<CoordinateInfo>,
    /// The muscles.
    pub muscles: Vec<MuscleInfo>,
    /// What of it a study can use; `None` where it cannot be computed with.
    pub study: Option<StudyUse>,
    /// What was understood, and what was not.
    pub diagnostics: Diagnostics,
    /// Why it cannot be computed with.
    pub compile_error: Option<String>,
}

impl Info {
    /// Reads a model. A model that can be read, but not computed with, comes back with the reason.
    ///
    /// # Errors
    /// The file cannot be read as a model.
    pub fn read(path: &Path) -> Result<(Info, Option<Diagnostic>), Failure> {
        let file = OsimFile::read(path).map_err(|e| model::osim_failure(path, &e))?;
        Ok(Info::of(file, path))
    }

    /// As [`Info::read`], of a model in memory.
    ///
    /// - `path`: its name in messages
    pub fn of(file: OsimFile, path: &Path) -> (Info, Option<Diagnostic>) {
        let spec = &file.spec;
        let compiled = Model::compile(spec);
        let info = Info {
            schema: "carpus.info/1",
            file: path.display().to_string(),
            model: spec.name.clone(),
            document_version: spec.document_version,
            bodies: spec.bodies.len(),
            joints: spec.joints.len(),
            wrap_objects: spec.wrap_objects.len(),
            constraints: spec.constraints.len(),
            forces: spec.forces.len(),
            markers: spec.markers.len(),
            coordinates: coordinates(spec, compiled.as_ref().ok()),
            muscles: spec.muscles.iter().map(muscle).collect(),
            study: compiled.as_ref().ok().map(|model| StudyUse::of(spec, model)),
            compile_error: compiled.as_ref().err().map(ToString::to_string),
            diagnostics: file.diagnostics,
        };
        let reason = compiled.err().map(|e| {
            let message = Diagnostic::error(e.to_string()).in_file(path).at_line(e.at().line);
            message.hint("the file can be read, but not computed with")
        });
        (info, reason)
    }
}

/// How many components were understood, and of which classes, the most frequent first.
pub fn understood(diagnostics: &Diagnostics) -> String {
    let count: usize = diagnostics.understood.values().sum();
    let mut classes: Vec<_> = diagnostics.understood.iter().collect();
    classes.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
    let listed: Vec<_> = classes.iter().map(|(class, n)| format!("{n} {class}")).collect();
    let listed = if listed.is_empty() { String::new() } else { format!(" ({})", listed.join(", ")) };
    format!("{count} components{listed}")
}

fn coordinates(spec: &ModelSpec, model: Option<&Model>) -> Vec<CoordinateInfo> {
    let info = |(i, c): (usize, &carpus_osim::osim::spec::CoordinateSpec)| {
        let index = CoordinateIndex(i);
        let unit = unit_of(spec, index);
        let motion_type = match c.motion_type {
            MotionType::Rotational => "rotational",
            MotionType::Translational => "translational",
            MotionType::Coupled => "coupled",
        };
        let shown = |v: f64| if unit == "deg" { v.to_degrees() } else { v };
        let follows = model.filter(|m| m.is_dependent(index)).map(|m| m.names_of_roots(index, ""));
        CoordinateInfo {
            name: c.name.clone(),
            line: c.at.line,
            motion_type,
            unit,
            default_value: shown(c.default_value),
            range: c.range.map(shown),
            clamped: c.clamped,
            locked: c.locked,
            follows,
        }
    };
    spec.coordinates.iter().enumerate().map(info).collect()
}

/// Unit in which people read a coordinate: `deg`, `m` or `rad or m`.
///
/// Of a coordinate OpenSim may say only that it is coupled: what turns its joint, wholly or among other things, is an
/// angle. One that no axis uses may be either.
pub fn unit_of(spec: &ModelSpec, index: CoordinateIndex) -> &'static str {
    match spec.coordinates[index.0].motion_type {
        MotionType::Rotational => return "deg",
        MotionType::Translational => return "m",
        MotionType::Coupled => {}
    }
    let JointKind::Custom(axes) = &spec.joints[spec.coordinates[index.0].joint.0].kind else { return "rad or m" };
    match axes.iter().position(|axis| axis.coordinates.contains(&index)) {
        Some(0..3) => "deg",
        Some(_) => "m",
        None => "rad or m",
    }
}

fn muscle(spec: &MuscleSpec) -> MuscleInfo {
    MuscleInfo {
        name: spec.name.clone(),
        line: spec.at.line,
        class: match &spec.kind {
            MuscleKind::Millard2012Equilibrium(_) => "Millard2012EquilibriumMuscle".to_string(),
            MuscleKind::OtherClass { class, .. } => class.clone(),
        },
        max_isometric_force_n: spec.max_isometric_force,
        optimal_fiber_length_m: spec.optimal_fiber_length,
        tendon_slack_length_m: spec.tendon_slack_length,
        pennation_angle_at_optimal_deg: spec.pennation_angle_at_optimal.to_degrees(),
        path: if spec.path.functions.is_some() { "FunctionBasedPath" } else { "GeometryPath" },
        path_points: spec.path.points.len(),
        wraps: spec.path.wraps.len(),
        applies_force: spec.applies_force,
    }
}
