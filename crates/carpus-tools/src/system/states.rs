//! States by the names that OpenSim gives them.

use super::compiled::{System, SystemState};

/// What of the force set has states.
enum Owner {
    /// A muscle (index).
    Muscle(usize),
    /// A bushing or limit whose damping takes energy (number among them).
    Damper(usize),
    /// An actuator with an activation (number among them).
    Lagged(usize),
}

impl System {
    /// What of the force set has states, in its order.
    fn with_states(&self) -> Vec<Owner> {
        let order = |force: usize| self.spec.forces[force].at.order();
        let muscles = self.spec.muscles.iter().enumerate().map(|(i, m)| (m.at.order(), Owner::Muscle(i)));
        let bushings = self.dampers().enumerate().map(|(k, (i, _))| (order(i), Owner::Damper(k)));
        let lagged = self.lagged().enumerate().map(|(k, (i, _))| (order(i), Owner::Lagged(k)));
        let mut all: Vec<_> = muscles.chain(bushings).chain(lagged).collect();
        all.sort_by_key(|(order, _)| *order);
        all.into_iter().map(|(_, owner)| owner).collect()
    }

    /// Names of the states in OpenSim's order: value and speed of every coordinate, then what muscles and dampers have.
    pub fn state_names(&self) -> Vec<String> {
        let coordinates = self.spec.coordinates.iter();
        let mut names: Vec<String> =
            coordinates.flat_map(|c| [format!("{}/value", c.at.path), format!("{}/speed", c.at.path)]).collect();
        let dampers: Vec<(usize, &str)> = self.dampers().collect();
        let lagged: Vec<usize> = self.lagged().map(|(i, _)| i).collect();
        let path = |force: usize| &self.spec.forces[force].at.path;
        for owner in self.with_states() {
            match owner {
                Owner::Muscle(i) => {
                    self.for_each_muscle_state(i, |name| names.push(format!("{}/{name}", self.muscles[i].path_name)))
                }
                Owner::Damper(k) => {
                    let (force, state) = dampers[k];
                    names.push(format!("{}/{state}", path(force)));
                }
                Owner::Lagged(k) => names.push(format!("{}/activation", path(lagged[k]))),
            }
        }
        names
    }

    fn for_each_muscle_state(&self, i: usize, mut visit: impl FnMut(&'static str)) {
        let Some(law) = &self.muscles[i].law else { return };
        if !law.ignore_activation_dynamics() {
            visit("activation");
        }
        if !law.ignore_tendon_compliance() {
            visit(law.equilibrium_state_name());
        }
        if law.has_velocity_state() {
            visit("fiber_velocity");
        }
    }

    /// Values of the states in the order of [`System::state_names`].
    pub fn state_values(&self, state: &SystemState) -> Vec<f64> {
        let mut values: Vec<f64> = state.q.iter().zip(&state.u).flat_map(|(q, u)| [*q, *u]).collect();
        for owner in self.with_states() {
            match owner {
                Owner::Muscle(i) => self.for_each_muscle_state(i, |name| {
                    values.push(match name {
                        "activation" => state.activation[i],
                        "fiber_velocity" => state.fiber_velocity[i],
                        _ => state.fiber_length[i],
                    });
                }),
                Owner::Damper(k) => values.push(state.dissipated_energy[k]),
                Owner::Lagged(k) => values.push(state.actuator_activation[k]),
            }
        }
        values
    }

    /// Sets one state by its name; `false` if there is none.
    pub fn set_state(&self, state: &mut SystemState, name: &str, value: f64) -> bool {
        let Some((owner, variable)) = name.rsplit_once('/') else { return false };
        let coordinate = || self.spec.coordinates.iter().position(|c| c.at.path == owner);
        let muscle = || self.muscles.iter().position(|m| m.path_name == owner);
        let lagged = || self.lagged().position(|(i, _)| self.spec.forces[i].at.path == owner);
        let place = match variable {
            "value" => coordinate().map(|i| &mut state.q[i]),
            "speed" => coordinate().map(|i| &mut state.u[i]),
            "activation" => match muscle() {
                Some(i) => Some(&mut state.activation[i]),
                None => lagged().map(|k| &mut state.actuator_activation[k]),
            },
            "fiber_length" | "normalized_tendon_force" => muscle().map(|i| &mut state.fiber_length[i]),
            "fiber_velocity" => muscle().map(|i| &mut state.fiber_velocity[i]),
            "dissipated_energy" | "dissipatedEnergy" => {
                let is_it = |(i, name): (usize, &str)| self.spec.forces[i].at.path == owner && name == variable;
                self.dampers().position(is_it).map(|k| &mut state.dissipated_energy[k])
            }
            _ => None,
        };
        match place {
            Some(place) => {
                *place = value;
                true
            }
            None => false,
        }
    }
}
