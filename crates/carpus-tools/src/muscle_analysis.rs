//! Lengths, velocities, forces, powers and moment arms of muscles: `MuscleAnalysis`.

use super::analysis::{Analysis, Instant, Options, UNITS};
use super::error::ToolError;
use super::setup::Properties;
use super::system::System;
use carpus_multibody::dynamics::Dynamics;
use carpus_multibody::muscles::MuscleDynamics;
use carpus_osim::osim::spec::CoordinateIndex;
use carpus_osim::storage::Storage;

/// A quantity: name of its storage, and its value.
type Quantity = (&'static str, fn(&MuscleDynamics, f64, f64) -> f64);

/// In OpenSim's order; arguments beside the muscle: length and lengthening speed of its path.
const QUANTITIES: [Quantity; 18] = [
    ("PennationAngle", |m, _, _| m.pennation_angle),
    ("Length", |_, length, _| length),
    ("FiberLength", |m, _, _| m.fiber_length),
    ("NormalizedFiberLength", |m, _, _| m.normalized_fiber_length),
    ("TendonLength", |m, _, _| m.tendon_length),
    ("FiberVelocity", |m, _, _| m.fiber_velocity),
    ("NormFiberVelocity", |m, _, _| m.normalized_fiber_velocity),
    ("PennationAngularVelocity", |m, _, _| m.pennation_angular_velocity),
    ("TendonForce", |m, _, _| m.tendon_force),
    ("FiberForce", |m, _, _| m.fiber_force),
    ("ActiveFiberForce", |m, _, _| m.active_fiber_force),
    ("PassiveFiberForce", |m, _, _| m.passive_fiber_force),
    ("ActiveFiberForceAlongTendon", |m, _, _| m.active_fiber_force_along_tendon),
    ("PassiveFiberForceAlongTendon", |m, _, _| m.passive_fiber_force_along_tendon),
    ("FiberActivePower", |m, _, _| -(m.active_fiber_force + m.passive_fiber_damping_force) * m.fiber_velocity),
    ("FiberPassivePower", |m, _, _| -m.passive_fiber_elastic_force * m.fiber_velocity),
    ("TendonPower", |m, _, _| -m.tendon_force * m.tendon_velocity),
    ("MuscleActuatorPower", |m, _, speed| -m.tendon_force * speed),
];

/// The analysis.
pub struct MuscleAnalysis {
    options: Options,
    muscles: Vec<usize>,
    coordinates: Vec<CoordinateIndex>,
    /// One per quantity.
    stores: Vec<Storage>,
    /// Moment arms, then moments, one per coordinate each.
    arms: Vec<Storage>,
    moments: Vec<Storage>,
    warnings: Vec<String>,
}

impl MuscleAnalysis {
    /// Reads the analysis. Muscles and coordinates that the model does not have are left out, with a warning.
    ///
    /// # Errors
    /// Values that cannot be used.
    pub fn read(analysis: &Properties, system: &System) -> Result<MuscleAnalysis, ToolError> {
        let options = Options::read(analysis)?;
        let mut warnings = Vec::new();
        let names = analysis.words("muscle_list").unwrap_or_else(|| vec!["all".into()]);
        // Muscles of OpenSim's model are those of its force set.
        let is_listed = |i: &usize| system.spec.muscles[*i].at.is_in_force_set();
        let muscles = if names == ["all"] {
            (0..system.muscles.len()).filter(is_listed).collect()
        } else {
            let mut found = Vec::new();
            for name in &names {
                match (0..system.muscles.len()).filter(is_listed).find(|i| system.muscles[*i].name == *name) {
                    Some(i) => found.push(i),
                    None => warnings.push(format!("{}: the model has no muscle `{name}`", options.name)),
                }
            }
            found
        };
        for muscle in muscles.iter().map(|i| &system.muscles[*i]).filter(|m| m.law.is_none()) {
            let text = format!(
                "{}: the force of muscle `{}` is not computed: its columns hold nan",
                options.name, muscle.name
            );
            warnings.push(text);
        }
        let mut coordinates = Vec::new();
        let list = analysis.words("moment_arm_coordinate_list").unwrap_or_else(|| vec!["all".into()]);
        if analysis.boolean("compute_moments", true)? {
            if list.first().is_some_and(|first| first.eq_ignore_ascii_case("all")) {
                // By its name: of several coordinates of one name OpenSim takes the first.
                let is_first =
                    |c: &CoordinateIndex| system.model.coordinate(&system.model.coordinates[c.0].name) == Some(*c);
                coordinates = (0..system.model.n_coordinates()).map(CoordinateIndex).filter(is_first).collect();
            } else {
                for name in &list {
                    match system.model.coordinate(name) {
                        Some(c) => coordinates.push(c),
                        None => warnings.push(format!("{}: the model has no coordinate `{name}`", options.name)),
                    }
                }
            }
        }
        let labels: Vec<String> = muscles.iter().map(|i| system.muscles[*i].name.clone()).collect();
        let description = format!(
            "\nThis analysis gathers basic information about muscles during a simulation (e.g., forces, tendon \
             lengths, moment arms, etc).{UNITS}"
        );
        let storage = |name: String| {
            let mut storage = Storage::new(&name, labels.clone());
            storage.description.clone_from(&description);
            storage
        };
        let named = |kind: &str| {
            let name = |c: &CoordinateIndex| format!("{kind}_{}", system.model.coordinates[c.0].name);
            coordinates.iter().map(name).map(storage).collect()
        };
        let stores = QUANTITIES.iter().map(|(name, _)| storage((*name).to_owned())).collect();
        let (arms, moments) = (named("MomentArm"), named("Moment"));
        Ok(MuscleAnalysis { options, muscles, coordinates, stores, arms, moments, warnings })
    }
}

impl Analysis for MuscleAnalysis {
    fn options(&self) -> &Options {
        &self.options
    }

    fn needs_forces(&self) -> bool {
        false
    }

    fn uses_forces(&self) -> bool {
        true
    }

    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        let (system, state, evaluation) = (instant.system, instant.state, instant.evaluation);
        // As in OpenSim, TendonForce and moments are of what a muscle actuates: nothing where it applies no force. All
        // else is of its state, whether it applies force or not.
        let is_idle = |i: usize| !system.muscles[i].applies_force;
        for ((name, quantity), store) in QUANTITIES.iter().zip(&mut self.stores) {
            let value = |i: &usize| {
                let (length, speed) = (evaluation.muscle_length[*i], evaluation.muscle_speed[*i]);
                match &evaluation.muscles[*i] {
                    _ if *name == "TendonForce" && is_idle(*i) => 0.0,
                    Some(muscle) => quantity(muscle, length, speed),
                    None if *name == "Length" => length,
                    None => f64::NAN,
                }
            };
            store.push(state.time, self.muscles.iter().map(value).collect());
        }
        let mut cache = instant.work.dynamics.cache().clone();
        let joined = system.constraints.tie_several();
        let mut dynamics = joined.then(|| Dynamics::new(&system.model, &system.constraints));
        for (k, coordinate) in self.coordinates.iter().enumerate() {
            let paths = &instant.work.paths;
            let arms: Vec<f64> = if let Some(dynamics) = &mut dynamics {
                let speeds = dynamics.unit_motion(state.time, &state.q, *coordinate);
                dynamics.update(&state.q, &speeds);
                let (cache, qdot) = (dynamics.cache(), dynamics.qdot());
                let arm = |i: &usize| system.muscles[*i].path.moment_arm_of_motion(&state.q, qdot, cache, &paths[*i]);
                self.muscles.iter().map(arm).collect()
            } else {
                system.model.update_unit_motion(&state.q, *coordinate, &mut cache);
                let arm = |i: &usize| system.muscles[*i].path.moment_arm(&state.q, &cache, &paths[*i]);
                self.muscles.iter().map(arm).collect()
            };
            let force = |i: &usize| match &evaluation.muscles[*i] {
                _ if is_idle(*i) => 0.0,
                found => found.as_ref().map_or(f64::NAN, |m| m.tendon_force),
            };
            let moments = arms.iter().zip(&self.muscles).map(|(arm, i)| arm * force(i)).collect();
            self.arms[k].push(state.time, arms);
            self.moments[k].push(state.time, moments);
        }
        Ok(())
    }

    fn results(&self) -> Vec<(String, &Storage)> {
        let all = self.arms.iter().chain(&self.moments).chain(&self.stores);
        all.map(|storage| (storage.name.clone(), storage)).collect()
    }

    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }
}
