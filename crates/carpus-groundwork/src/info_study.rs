//! What of a model a study can use: muscles, coordinates, forces and constraints.

use serde::Serialize;

use carpus_multibody::multibody::{Coordinate, Model};
use carpus_osim::osim::spec::{ConstraintKind, CoordinateIndex, ForceKind, ModelSpec};
use carpus_simulation::simulation::check_muscles;

/// Names that are listed in a line before the rest is only counted.
const LISTED: usize = 8;

/// Something of the model that a study cannot use.
#[derive(Debug, Serialize)]
pub struct Unusable {
    /// Its name.
    pub name: String,
    /// Why.
    pub reason: String,
}

/// What of a model a study can use.
#[derive(Debug, Default, Serialize)]
pub struct StudyUse {
    /// Muscles that can be active.
    pub muscles: Vec<String>,
    /// Muscles that cannot.
    pub muscles_not: Vec<Unusable>,
    /// Coordinates that a dynamometer can move.
    pub coordinates: Vec<String>,
    /// Forces that the passive moment holds.
    pub forces: Vec<String>,
    /// Forces that it lacks: an error, unless they are allowed to be left out.
    pub forces_not: Vec<Unusable>,
    /// Constraints that hold.
    pub constraints: Vec<String>,
    /// Constraints that do not: an error, unless they are allowed to be left out.
    pub constraints_not: Vec<Unusable>,
}

impl StudyUse {
    /// - `model`: compiled from `spec`
    pub fn of(spec: &ModelSpec, model: &Model) -> StudyUse {
        let mut found = StudyUse::default();
        for (muscle, checked) in check_muscles(spec, model) {
            match checked {
                Ok(()) => found.muscles.push(muscle.to_owned()),
                Err(error) => {
                    let reason = error.to_string();
                    let prefix = format!("{muscle}: ");
                    let reason = reason.strip_prefix(&prefix).unwrap_or(&reason).to_owned();
                    found.muscles_not.push(Unusable { name: muscle.to_owned(), reason });
                }
            }
        }
        let coordinates = model.coordinates.iter().enumerate();
        let is_free = |c: &Coordinate| !c.locked && c.prescribed.is_none();
        let free = coordinates.filter(|(i, c)| is_free(c) && !model.is_dependent(CoordinateIndex(*i)));
        found.coordinates.extend(free.map(|(_, c)| c.name.clone()));
        for force in spec.forces.iter().filter(|force| force.applies_force) {
            let not = |class: &str| Unusable { name: force.name.clone(), reason: format!("{class} is not computed") };
            match &force.kind {
                ForceKind::Unsupported { class } if class == "BodyActuator" => {}
                ForceKind::Unsupported { .. } if force.is_muscle_without_path() => found.muscles_not.push(Unusable {
                    name: force.name.clone(),
                    reason: "neither its path nor its force is computed".to_owned(),
                }),
                ForceKind::Unsupported { class } => found.forces_not.push(not(class)),
                ForceKind::Prescribed(_) => {
                    let reason = "PrescribedForce: a trial's time is not that of the model's functions".to_owned();
                    found.forces_not.push(Unusable { name: force.name.clone(), reason });
                }
                ForceKind::Actuator(_) => {}
                _ => found.forces.push(force.name.clone()),
            }
        }
        for constraint in spec.constraints.iter().filter(|constraint| constraint.is_enforced) {
            match &constraint.kind {
                ConstraintKind::Unsupported { class } => found
                    .constraints_not
                    .push(Unusable { name: constraint.name.clone(), reason: format!("{class} is not enforced") }),
                _ => found.constraints.push(constraint.name.clone()),
            }
        }
        found.constraints.extend(spec.loop_joints().into_iter().map(|joint| spec.joints[joint.0].name.clone()));
        found
    }

    /// In lines, for people.
    pub fn lines(&self) -> Vec<String> {
        let listed = |names: &[String]| match names.len() {
            n if n > LISTED => format!("{} … and {} more", names[..LISTED].join(", "), n - LISTED),
            _ => names.join(", "),
        };
        let mut lines = Vec::new();
        let mut say = |what: &str, names: &[String], not: &[Unusable], without: &str| {
            if names.is_empty() && not.is_empty() {
                return;
            }
            let (n, all) = (names.len(), names.len() + not.len());
            let list = if names.is_empty() { String::new() } else { format!(": {}", listed(names)) };
            lines.push(if not.is_empty() { format!("{n} {what}{list}") } else { format!("{n} of {all} {what}{list}") });
            for Unusable { name, reason } in not.iter().take(LISTED) {
                lines.push(format!("  {without} {name}: {reason}"));
            }
            if not.len() > LISTED {
                lines.push(format!("  … and {} more (--json lists them)", not.len() - LISTED));
            }
        };
        say("muscles can be active", &self.muscles, &self.muscles_not, "not");
        say("coordinates can be moved by the dynamometer", &self.coordinates, &[], "not");
        say("other forces count as passive moment", &self.forces, &self.forces_not, "left out, if allowed:");
        say("constraints hold", &self.constraints, &self.constraints_not, "left out, if allowed:");
        lines
    }
}
