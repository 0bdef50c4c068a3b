//! Controls that make the recorded motion at the least sum of powers of activations: `StaticOptimization`.
//!
//! ```text
//! min Σ |xᵢ|ᵖ     A x = b,   low ≤ x ≤ high
//! ```
//! A x are the accelerations that forces xᵢ·Fᵢ add, b what the motion needs. The problem is convex; its dual is solved
//! by Newton's method: x = clamp(sign(s)·(|s|/p)^(1/(p−1))), s = Aᵀλ.

use nalgebra::{DMatrix, DVector};

use super::analysis::{Analysis, Instant, Options};
use super::error::{ToolError, ToolProblem};
use super::force_analyses::{force_storage, record_values};
use super::setup::Properties;
use super::system::{Actor, System};
use carpus_multibody::dynamics::DynamicsError;
use carpus_multibody::forces::AppliedForces;
use carpus_osim::storage::Storage;

/// Most iterations.
const ITERATIONS: usize = 200;

/// The analysis.
pub struct StaticOptimization {
    options: Options,
    exponent: f64,
    physiology: bool,
    /// Actuators by position among the actors.
    actuators: Vec<usize>,
    ranges: Vec<[f64; 2]>,
    /// Coordinates whose acceleration is to be met.
    coordinates: Vec<usize>,
    /// Accelerations that the motion needs: rows of the states.
    wanted: Storage,
    activations: Storage,
    forces: Storage,
    /// Times at which the actuators cannot make the motion, what is missing, and its unit.
    missing: Vec<(f64, f64, &'static str)>,
}

impl StaticOptimization {
    /// Reads the analysis.
    ///
    /// - `wanted`: accelerations of all coordinates over time
    ///
    /// # Errors
    /// Fewer actuators than coordinates to be moved; options that are not supported.
    pub fn read(analysis: &Properties, system: &System, wanted: Storage) -> Result<StaticOptimization, ToolError> {
        let options = Options::read(analysis)?;
        if !analysis.boolean("use_model_force_set", true)? {
            return Err(analysis.unsupported("use_model_force_set", "only true is, the forces of the model"));
        }
        let exponent = analysis.number("activation_exponent", 2.0)?;
        if !(exponent > 1.0 && exponent.is_finite()) {
            return Err(analysis.bad_value("activation_exponent", "a number above 1", &exponent.to_string()));
        }
        let physiology = analysis.boolean("use_muscle_physiology", true)?;
        analysis.ignore_all(&["optimizer_convergence_criterion", "optimizer_max_iterations"]);
        let (mut actuators, mut ranges, mut labels) = (Vec::new(), Vec::new(), Vec::new());
        let outside = system.outside_of_force_set();
        let is_given = |actor: &Actor| outside.iter().any(|name| name == actor.name(&system.muscles));
        for (k, actor) in system.actors.iter().enumerate().filter(|(_, actor)| !is_given(actor)) {
            let range = match actor {
                // A muscle whose force is not computed is left out, where that is allowed.
                Actor::Muscle(i) if system.muscles[*i].law.is_none() => continue,
                Actor::Muscle(i) => {
                    let spec = &system.spec.muscles[*i];
                    [spec.min_control, spec.max_control]
                }
                actor => match actor.control() {
                    Some((_, range)) => range,
                    None => continue,
                },
            };
            actuators.push(k);
            ranges.push(range);
            labels.push(actor.name(&system.muscles).to_owned());
        }
        let coordinates: Vec<usize> =
            system.tree_order.iter().map(|c| c.0).filter(|i| !system.is_constrained(*i)).collect();
        if actuators.len() < coordinates.len() {
            let what = format!(
                "{} free coordinates and only {} actuators: reserve actuators may be added by force_set_files",
                coordinates.len(),
                actuators.len()
            );
            return Err(analysis.error_at("use_model_force_set", ToolProblem::Data { what }));
        }
        let mut activations = Storage::new("Static Optimization", labels);
        activations.description = "This file contains static optimization results.\n\n".to_owned();
        let forces = force_storage(system);
        Ok(StaticOptimization {
            options,
            exponent,
            physiology,
            actuators,
            ranges,
            coordinates,
            wanted,
            activations,
            forces,
            missing: Vec::new(),
        })
    }

    /// Force of an actuator for a control of 1.
    fn optimal_force(&self, instant: &Instant, actor: usize) -> f64 {
        match &instant.system.actors[actor] {
            Actor::Muscle(i) => {
                let muscle = &instant.system.muscles[*i];
                let Some(law) = &muscle.law else { return f64::NAN };
                if !self.physiology {
                    return instant.system.spec.muscles[*i].max_isometric_force;
                }
                let (length, speed) = (instant.evaluation.muscle_length[*i], instant.evaluation.muscle_speed[*i]);
                law.inextensible_tendon_active_fiber_force(length, speed, 1.0)
            }
            actor => actor.control().map_or(0.0, |(optimal, _)| optimal),
        }
    }
}

impl Analysis for StaticOptimization {
    fn options(&self) -> &Options {
        &self.options
    }

    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        let (system, state) = (instant.system, instant.state);
        let fail = |source| ToolError::new(&system.path, ToolProblem::Dynamics { time: state.time, source });
        let optimal: Vec<f64> = self.actuators.iter().map(|k| self.optimal_force(instant, *k)).collect();
        let names: Vec<&str> = self.actuators.iter().map(|k| system.actors[*k].name(&system.muscles)).collect();
        let none = |name: &str| names.contains(&name).then_some(0.0);
        let applied = system.with_actuator_forces(instant.work, state, &none);
        let full = |(k, force): (&usize, &f64)| {
            let mut alone = AppliedForces::new(&system.model);
            if *force != 0.0 {
                system.apply_actuator(instant.work, state, *k, *force, &mut alone);
            }
            alone
        };
        let alone: Vec<AppliedForces> = self.actuators.iter().zip(&optimal).map(full).collect();
        let dynamics = &mut instant.work.dynamics;
        let wanted = self.wanted.at(state.time);
        let rest = match dynamics.accelerations(state.time, &state.q, &state.u, &applied) {
            Ok(found) => Some(found.udot),
            // Forces are determined also where accelerations are not: where axes of a joint coincide.
            Err(DynamicsError::Massless { .. }) => None,
            Err(error) => return Err(fail(error)),
        };
        let (needed, matrix, unit) = match rest {
            Some(rest) => {
                let responses = dynamics.responses(state.time, &state.q, &state.u, &alone).map_err(fail)?;
                let missing = self.coordinates.iter().map(|c| wanted[*c] - rest[*c]);
                let needed = DVector::from_iterator(self.coordinates.len(), missing);
                (needed, responses.select_rows(&self.coordinates), "rad/s² or m/s²")
            }
            None => {
                let wanted: Vec<(usize, f64)> = self.coordinates.iter().map(|c| (*c, wanted[*c])).collect();
                let at = [state.q.as_slice(), state.u.as_slice()];
                let found = dynamics.demands(state.time, at, &wanted, &applied, &alone).map_err(fail)?;
                (found.0, found.1, "N·m or N")
            }
        };
        let (controls, left) = least_powers(&matrix, &needed, &self.ranges, self.exponent);
        // Also where it is not a number.
        if !(left <= 1e-4) {
            self.missing.push((state.time, left, unit));
        }
        let control = |actor: usize| self.actuators.iter().position(|k| *k == actor).map(|i| controls[i] * optimal[i]);
        let values = (0..system.actors.len()).flat_map(|k| record_values(instant, k, &control)).collect();
        self.activations.push(state.time, controls.iter().copied().collect());
        self.forces.push(state.time, values);
        Ok(())
    }

    fn results(&self) -> Vec<(String, &Storage)> {
        vec![("activation".to_owned(), &self.activations), ("force".to_owned(), &self.forces)]
    }

    fn texts(&self) -> Vec<(String, String)> {
        vec![("controls.xml".to_owned(), control_set(&self.activations))]
    }

    fn warnings(&self) -> Vec<String> {
        let Some(&(first, ..)) = self.missing.first() else { return Vec::new() };
        // What is not a number is more than any number.
        let size = |left: f64| if left.is_nan() { f64::INFINITY } else { left };
        let most = self.missing.iter().max_by(|a, b| size(a.1).total_cmp(&size(b.1)));
        let (time, left, unit) = most.copied().unwrap_or_default();
        vec![format!(
            "{}: at {} of {} times the actuators cannot make the motion, the first at t = {first} s; at most \
             {left:.3e} {unit} are missing, at t = {time} s",
            self.options.name,
            self.missing.len(),
            self.activations.len()
        )]
    }
}

/// xᵉ, without the general power where that is not needed.
fn raised(x: f64, exponent: f64) -> f64 {
    match exponent {
        1.0 => x,
        2.0 => x * x,
        _ => x.powf(exponent),
    }
}

/// Solves the problem; returns x and the largest violation of A x = b.
fn least_powers(a: &DMatrix<f64>, b: &DVector<f64>, ranges: &[[f64; 2]], power: f64) -> (DVector<f64>, f64) {
    let (m, n) = a.shape();
    // Rows of very different size (accelerations of light bodies) are brought to one.
    let size = DVector::from_fn(m, |i, _| a.row(i).norm().max(1e-12));
    let a = DMatrix::from_fn(m, n, |i, j| a[(i, j)] / size[i]);
    let b = b.component_div(&size);
    // Value of the dual, x, and the slope of x.
    let at = |multipliers: &DVector<f64>| {
        let s = a.tr_mul(multipliers);
        let (mut x, mut slope) = (DVector::zeros(n), DVector::zeros(n));
        let mut value = multipliers.dot(&b);
        for i in 0..n {
            let free = raised(s[i].abs() / power, 1.0 / (power - 1.0)).copysign(s[i]);
            x[i] = free.max(ranges[i][0]).min(ranges[i][1]);
            value += raised(x[i].abs(), power) - s[i] * x[i];
            if x[i] == free {
                slope[i] = if power == 2.0 {
                    0.5
                } else {
                    (s[i].abs().max(1e-9) / power).powf((2.0 - power) / (power - 1.0)) / (power * (power - 1.0))
                };
            }
        }
        (value, x, slope)
    };
    let scale = b.amax().max(1.0);
    let mut multipliers = DVector::zeros(m);
    let (mut value, mut x, mut slope) = at(&multipliers);
    for _ in 0..ITERATIONS {
        let error = &b - &a * &x;
        if error.amax() < 1e-12 * scale {
            break;
        }
        let mut normal = DMatrix::zeros(m, m);
        for i in (0..n).filter(|i| slope[*i] > 0.0) {
            let column = a.column(i);
            normal.ger(slope[i], &column, &column, 1.0);
        }
        for i in 0..m {
            normal[(i, i)] += 1e-9;
        }
        let Some(step) = normal.lu().solve(&error) else { break };
        // The dual is concave and its gradient is the violation.
        let rise = error.dot(&step);
        let mut share = 1.0;
        let mut improved = false;
        for _ in 0..60 {
            let trial = &multipliers + share * &step;
            let found = at(&trial);
            if found.0 >= value + 1e-4 * share * rise {
                multipliers = trial;
                (value, x, slope) = found;
                improved = true;
                break;
            }
            share *= 0.5;
        }
        if !improved {
            break;
        }
    }
    let left = (&b - &a * &x).component_mul(&size).amax();
    (x, left)
}

/// Controls as OpenSim writes them from a storage: linear between nodes.
fn control_set(storage: &Storage) -> String {
    use std::fmt::Write;
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>\n<OpenSimDocument Version=\"40600\">\n\t<ControlSet \
         name=\"Control Set\">\n\t\t<objects>\n",
    );
    for (i, label) in storage.labels.iter().enumerate() {
        let _ = write!(
            text,
            "\t\t\t<ControlLinear \
             name=\"{label}\">\n\t\t\t\t<is_model_control>true</is_model_control>\n\t\t\t\t\
             <extrapolate>true</extrapolate>\n\t\t\t\t<default_min>0.02</default_min>\n\t\t\t\t\
             <default_max>1</default_max>\n\t\t\t\t<filter_on>false</filter_on>\n\t\t\t\t\
             <use_steps>false</use_steps>\n\t\t\t\t<x_nodes>\n"
        );
        for (time, row) in storage.time.iter().zip(&storage.rows) {
            let _ = write!(
                text,
                "\t\t\t\t\t<ControlLinearNode>\n\t\t\t\t\t\t<t>{time}</t>\n\t\t\t\t\t\t\
                 <value>{}</value>\n\t\t\t\t\t</ControlLinearNode>\n",
                row[i]
            );
        }
        text.push_str(
            "\t\t\t\t</x_nodes>\n\t\t\t\t<min_nodes />\n\t\t\t\t<max_nodes \
                       />\n\t\t\t\t<kp>100</kp>\n\t\t\t\t<kv>20</kv>\n\t\t\t</ControlLinear>\n",
        );
    }
    text.push_str("\t\t</objects>\n\t\t<groups />\n\t</ControlSet>\n</OpenSimDocument>\n");
    text
}
