//! Muscles of the model that the study does not activate, such as those of the fingers: what moment they could exert.

use std::sync::Arc;

use super::series::interpolate;
use carpus_osim::osim::spec::ModelSpec;
use carpus_simulation::simulation::{
    HeldCoordinate, MusculoskeletalModel, Options, PreparedTrial, Recording, Setup, SimulationError,
};
use carpus_study::study::MomentPart;

/// Angles at which the moments are tabulated.
const ANGLES: usize = 61;
/// Duration of the sweep that tabulates them [s]: so slow that every muscle is in equilibrium.
const SWEEP: f64 = 600.0;

/// Active isometric moment of the silent muscles at full activation, by the direction in which they pull.
#[derive(Clone, Debug, Default)]
pub struct SilentMuscles {
    /// Names of those that act on the coordinate.
    pub names: Vec<String>,
    /// Angles [rad], increasing.
    angle: Vec<f64>,
    /// Sum of the moments that decrease and of those that increase the coordinate [N·m].
    moment: [Vec<f64>; 2],
}

impl SilentMuscles {
    /// No muscle.
    pub const fn none() -> SilentMuscles {
        SilentMuscles { names: Vec::new(), angle: Vec::new(), moment: [Vec::new(), Vec::new()] }
    }

    /// Those of every trial; trials of one posture share theirs.
    ///
    /// - `recordings`, `trials`: of all trials, in one order
    ///
    /// # Errors
    /// Loops of constraints that do not close.
    pub fn of_trials(
        spec: &ModelSpec,
        model: &MusculoskeletalModel,
        recordings: &[Recording],
        trials: &[PreparedTrial],
    ) -> Result<Vec<Arc<SilentMuscles>>, SimulationError> {
        let mut postures: Vec<(&[HeldCoordinate], Vec<&PreparedTrial>)> = Vec::new();
        for (recording, trial) in recordings.iter().zip(trials) {
            match postures.iter_mut().find(|(held, _)| *held == recording.held) {
                Some((_, of_posture)) => of_posture.push(trial),
                None => postures.push((&recording.held, vec![trial])),
            }
        }
        let mut found: Vec<(&[HeldCoordinate], SilentMuscles)> = Vec::with_capacity(postures.len());
        for (held, trials) in postures {
            let mut setup = model.setup().clone();
            setup.posture.extend_from_slice(held);
            found.push((held, SilentMuscles::in_posture(spec, &setup, model.closed_range(), &trials)?));
        }
        // A muscle that acts in one posture is there in all.
        let mut names: Vec<String> = Vec::new();
        for name in found.iter().flat_map(|(_, silent)| &silent.names) {
            if !names.contains(name) {
                names.push(name.clone());
            }
        }
        found.iter_mut().for_each(|(_, silent)| silent.names.clone_from(&names));
        let found: Vec<_> = found.into_iter().map(|(held, silent)| (held, Arc::new(silent))).collect();
        let of = |recording: &Recording| found.iter().find(|(held, _)| *held == recording.held).map(|(_, s)| s.clone());
        Ok(recordings.iter().map(|recording| of(recording).unwrap_or_default()).collect())
    }

    /// Those of a model, over the angles of trials of one posture. Muscles of classes that are not computed are left
    /// out.
    ///
    /// - `closed`: angles at which loops of constraints close; `None` without loops
    fn in_posture(
        spec: &ModelSpec,
        setup: &Setup,
        closed: Option<[f64; 2]>,
        trials: &[&PreparedTrial],
    ) -> Result<SilentMuscles, SimulationError> {
        let angles = || trials.iter().flat_map(|t| &t.kinematics().angle).copied();
        let (low, high) = (angles().fold(f64::INFINITY, f64::min), angles().fold(f64::NEG_INFINITY, f64::max));
        if !(low.is_finite() && high.is_finite()) {
            return Ok(SilentMuscles::default());
        }
        let part = |k: usize| k as f64 / (ANGLES - 1) as f64;
        let margin = 0.01 + 0.05 * (high - low);
        let [least, most] = closed.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let (first, last) = ((low - margin).max(least), (high + margin).min(most));
        let angle: Vec<f64> = (0..ANGLES).map(|k| first + (last - first) * part(k)).collect();
        let time: Vec<f64> = (0..ANGLES).map(|k| SWEEP * part(k)).collect();
        let mut out = SilentMuscles { names: Vec::new(), angle, moment: [vec![0.0; ANGLES], vec![0.0; ANGLES]] };
        for muscle in &spec.muscles {
            let computed = muscle.is_computed() && muscle.applies_force;
            if !computed || setup.active_muscles.contains(&muscle.name) {
                continue;
            }
            let setup = Setup {
                active_muscles: vec![muscle.name.clone()],
                parts: vec![MomentPart::Muscles],
                dynamometer_damping: 0.0,
                allow_unsupported: true,
                ..setup.clone()
            };
            let [passive, full] = match moments(spec, &setup, &time, &out.angle) {
                Ok(moments) => moments,
                Err(error) if error.is_about_loops() => return Err(error),
                Err(_) => continue,
            };
            let active: Vec<f64> = full.iter().zip(&passive).map(|(f, p)| f - p).collect();
            if active.iter().all(|m| m.abs() < 1e-6) {
                continue;
            }
            let side = usize::from(active.iter().sum::<f64>() > 0.0);
            out.moment[side].iter_mut().zip(&active).for_each(|(sum, m)| *sum += m);
            out.names.push(muscle.name.clone());
        }
        Ok(out)
    }

    /// Moment [N·m] at an angle, fully activated: of those that decrease the coordinate, of those that increase it.
    pub fn moments(&self, angle: f64) -> [f64; 2] {
        if self.names.is_empty() {
            return [0.0; 2];
        }
        [0, 1].map(|side| interpolate(&self.angle, &self.moment[side], angle))
    }
}

/// Moment without and with full excitation.
///
/// # Errors
/// The muscle cannot be simulated.
fn moments(spec: &ModelSpec, setup: &Setup, time: &[f64], angle: &[f64]) -> Result<[Vec<f64>; 2], SimulationError> {
    let model = MusculoskeletalModel::compile(spec, setup)?;
    let options = Options { allow_angle_outside_range: true, ..Options::default() };
    let at = |level: f64| {
        let excitation = vec![level; time.len()];
        let recording = Recording { name: String::new(), time, angle, excitation: vec![&excitation], held: Vec::new() };
        let trial = model.prepare(&recording, &options)?;
        trial.simulate(&model.nominal_parameters()).map(|s| s.moment)
    };
    Ok([at(0.0)?, at(1.0)?])
}
