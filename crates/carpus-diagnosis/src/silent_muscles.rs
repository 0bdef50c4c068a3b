//! Muscles of the model that the study does not activate, such as those of the fingers: what moment they could exert.

use super::series::interpolate;
use carpus_osim::osim::spec::ModelSpec;
use carpus_simulation::simulation::{MusculoskeletalModel, Options, PreparedTrial, Recording, Setup};
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
    /// Those of a model, over the angles of its trials. Muscles of classes that are not computed are left out.
    pub fn of(spec: &ModelSpec, model: &MusculoskeletalModel, trials: &[PreparedTrial]) -> SilentMuscles {
        let angles = || trials.iter().flat_map(|t| &t.kinematics().angle).copied();
        let (low, high) = (angles().fold(f64::INFINITY, f64::min), angles().fold(f64::NEG_INFINITY, f64::max));
        if !(low.is_finite() && high.is_finite()) {
            return SilentMuscles::default();
        }
        let part = |k: usize| k as f64 / (ANGLES - 1) as f64;
        let margin = 0.01 + 0.05 * (high - low);
        let angle: Vec<f64> = (0..ANGLES).map(|k| low - margin + (high - low + 2.0 * margin) * part(k)).collect();
        let time: Vec<f64> = (0..ANGLES).map(|k| SWEEP * part(k)).collect();
        let mut out = SilentMuscles { names: Vec::new(), angle, moment: [vec![0.0; ANGLES], vec![0.0; ANGLES]] };
        for muscle in &spec.muscles {
            let computed = muscle.is_computed() && muscle.applies_force;
            if !computed || model.muscle_names().any(|name| name == muscle.name) {
                continue;
            }
            let setup = Setup {
                active_muscles: vec![muscle.name.clone()],
                parts: vec![MomentPart::Muscles],
                dynamometer_damping: 0.0,
                allow_unsupported: true,
                ..model.setup().clone()
            };
            let Some([passive, full]) = moments(spec, &setup, &time, &out.angle) else { continue };
            let active: Vec<f64> = full.iter().zip(&passive).map(|(f, p)| f - p).collect();
            if active.iter().all(|m| m.abs() < 1e-6) {
                continue;
            }
            let side = usize::from(active.iter().sum::<f64>() > 0.0);
            out.moment[side].iter_mut().zip(&active).for_each(|(sum, m)| *sum += m);
            out.names.push(muscle.name.clone());
        }
        out
    }

    /// Moment [N·m] at an angle, fully activated: of those that decrease the coordinate, of those that increase it.
    pub fn moments(&self, angle: f64) -> [f64; 2] {
        if self.names.is_empty() {
            return [0.0; 2];
        }
        [0, 1].map(|side| interpolate(&self.angle, &self.moment[side], angle))
    }
}

/// Moment without and with full excitation; `None` if the muscle cannot be simulated.
fn moments(spec: &ModelSpec, setup: &Setup, time: &[f64], angle: &[f64]) -> Option<[Vec<f64>; 2]> {
    let model = MusculoskeletalModel::compile(spec, setup).ok()?;
    let options = Options { allow_angle_outside_range: true, ..Options::default() };
    let at = |level: f64| {
        let excitation = vec![level; time.len()];
        let recording = Recording { name: String::new(), time, angle, excitation: vec![&excitation] };
        let trial = model.prepare(&recording, &options).ok()?;
        trial.simulate(&model.nominal_parameters()).ok().map(|s| s.moment)
    };
    Some([at(0.0)?, at(1.0)?])
}
