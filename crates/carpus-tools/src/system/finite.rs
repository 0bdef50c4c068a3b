//! Where results are not finite: of which muscle or force, and at which pose.

use super::actor::Actor;
use super::compiled::{Evaluation, System, SystemState, SystemWork};
use carpus_multibody::paths::Path as MusclePath;
use carpus_osim::osim::spec::CoordinateIndex;

/// Coordinates that are named of a pose, at most.
const POSE: usize = 6;

/// A result that is not finite.
#[derive(Clone, Debug, PartialEq)]
pub struct NotFinite {
    /// Muscle or other force.
    pub owner: String,
    /// What of it.
    pub quantity: &'static str,
    /// Its value.
    pub value: f64,
    /// Time [s].
    pub time: f64,
    /// Coordinates on which it depends, with their values.
    pub pose: String,
}

impl System {
    /// The first force that acts and is not finite, if any. Muscles of which something is finite at no state are passed
    /// over: of those the user is told ([`System::muscles_never_finite`]).
    ///
    /// - `evaluation`: at the state
    /// - `acts`: whether an actor applies its force
    pub fn not_finite(
        &self,
        work: &mut SystemWork,
        state: &SystemState,
        evaluation: &Evaluation,
        acts: &dyn Fn(usize) -> bool,
    ) -> Option<NotFinite> {
        let found = |owner: &str, quantity: &'static str, value: f64, path: Option<&MusclePath>| NotFinite {
            owner: owner.to_owned(),
            quantity,
            value,
            time: state.time,
            pose: self.pose(state, path),
        };
        let mut is_told = false;
        for (k, actor) in self.actors.iter().enumerate().filter(|(k, _)| acts(*k)) {
            match actor {
                Actor::Muscle(i) => {
                    let muscle = &self.muscles[*i];
                    let path = Some(&muscle.path);
                    let of_path = [
                        ("length of the path", evaluation.muscle_length[*i]),
                        ("speed of the path", evaluation.muscle_speed[*i]),
                    ];
                    if let Some((quantity, value)) = of_path.into_iter().find(|(_, value)| !value.is_finite()) {
                        return Some(found(&muscle.name, quantity, value, path));
                    }
                    if muscle.law.as_ref().is_some_and(|law| law.never_finite().is_some()) {
                        is_told = true;
                        continue;
                    }
                    let Some(m) = &evaluation.muscles[*i] else { continue };
                    let of_muscle = [
                        ("fibre length", m.fiber_length),
                        ("tendon force", m.tendon_force),
                        ("fibre velocity", m.fiber_velocity),
                        ("fibre force", m.fiber_force),
                    ];
                    if let Some((quantity, value)) = of_muscle.into_iter().find(|(_, value)| !value.is_finite()) {
                        return Some(found(&muscle.name, quantity, value, path));
                    }
                }
                Actor::Along { name, path, .. } if !evaluation.tension[k].is_finite() => {
                    return Some(found(name, "tension", evaluation.tension[k], Some(path)));
                }
                Actor::PathActuator(actuator) if !evaluation.tension[k].is_finite() => {
                    return Some(found(&actuator.name, "tension", evaluation.tension[k], Some(&actuator.path)));
                }
                _ => {}
            }
        }
        let of_all = evaluation.applied.first_not_finite()?;
        // Which of the others it is shows where it acts alone.
        for k in (0..self.actors.len()).filter(|k| acts(*k) && !matches!(self.actors[*k], Actor::Muscle(_))) {
            let alone = self.evaluate(work, state, &|other| other == k).applied;
            if let Some(value) = alone.first_not_finite() {
                return Some(found(self.actors[k].name(&self.muscles), "force", value, None));
            }
        }
        let sum = (!is_told).then_some(of_all)?;
        Some(found("forces on the model", "their sum", sum, None))
    }

    /// Muscles that apply a force and of which something is finite at no state: what, and why.
    pub fn muscles_never_finite(&self) -> Vec<(usize, &'static str)> {
        let acting = self.muscles.iter().enumerate().filter(|(_, muscle)| muscle.applies_force);
        acting.filter_map(|(i, muscle)| Some((i, muscle.law.as_ref()?.never_finite()?))).collect()
    }

    /// Values of the coordinates on which a path depends, or of the first ones.
    fn pose(&self, state: &SystemState, path: Option<&MusclePath>) -> String {
        let moves = |i: &usize| {
            let c = CoordinateIndex(*i);
            !self.is_constrained(*i) && path.is_none_or(|path| path.depends_on(&self.model, c))
        };
        let value = |i: usize| {
            let (name, q) = (&self.model.coordinates[i].name, state.q[i]);
            if self.is_angle(i) { format!("{name} {:.2}°", q.to_degrees()) } else { format!("{name} {q:.5}") }
        };
        let values: Vec<String> = (0..state.q.len()).filter(moves).take(POSE).map(value).collect();
        if values.is_empty() { "every pose".to_owned() } else { values.join(", ") }
    }
}
