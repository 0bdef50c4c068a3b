//! What a page has to know of a case to draw its controls and curves.

use serde_json::{Value, json};

use super::case::{Header, three};
use super::workbench::Workbench;
use carpus_effects::catalogue::with_own;
use carpus_effects::effect::{Effect, Quantity, Role};
use carpus_osim::osim::spec::MotionType;
use carpus_simulation::evaluation::Condition;
use carpus_simulation::simulation::speed_and_acceleration;
use carpus_study::study::{PostureCoordinate, RelativeBounds, Trial};

impl Workbench {
    /// Muscles with their bounds, effects with their parameters and plausible ranges, trials, models to go back to.
    pub fn description(&self) -> Value {
        let Header { study, participant, setup, averaged, states, .. } = &self.header;
        let b = &self.header.bounds;
        let bounds = [b.max_isometric_force, b.optimal_fiber_length, b.tendon_slack_length];
        let nominal = self.model.nominal_parameters();
        let muscle = |(name, own): (&str, [f64; 3])| {
            let ends = |i: usize| {
                let RelativeBounds { lower, upper } = bounds[i];
                [own[i] * lower, own[i] * upper]
            };
            json!({ "name": name, "given": own, "bounds": [ends(0), ends(1), ends(2)] })
        };
        let is_given =
            |e: &&'static dyn Effect| self.given.iter().any(|s| s.effect.description().id == e.description().id);
        let effects: Vec<Value> = with_own().iter().filter(|e| !is_given(e)).map(|e| self.effect(*e)).collect();
        let given: Vec<&str> = self.given.iter().map(|s| s.effect.description().name).collect();
        json!({
            "study": study,
            "participant": participant,
            "coordinate": setup.coordinate,
            "averaged": averaged,
            "muscles": self.model.muscle_names().zip(nominal.iter().map(three)).map(muscle).collect::<Vec<_>>(),
            "effects": effects,
            "given_effects": given,
            "trials": self.trials.iter().map(|t| self.trial(t)).collect::<Vec<_>>(),
            "states": states,
        })
    }

    /// - `at_zero`, `is_ratio`: a value v is shown as `at_zero` eᵛ where it is the logarithm of a ratio
    fn effect(&self, effect: &'static dyn Effect) -> Value {
        let d = effect.description();
        let absent = self.forward.joint.absent(effect);
        let at_zero = effect.reported(&absent.values, &self.forward.muscles);
        let parameters = d.parameters.iter().zip(absent.values.iter().zip(at_zero)).map(|(p, (start, at_zero))| {
            let plausible = self.forward.joint.plausible(p);
            let is_ratio = p.quantity == Quantity::LogRatio;
            let ends = plausible.map(|end| if is_ratio && at_zero > 0.0 { (end / at_zero).ln() } else { end });
            let scale = self.forward.joint.scale(p);
            json!({
                "name": p.name, "unit": p.unit, "amplitude": p.role == Role::Amplitude, "start": start, "scale": scale,
                "range": ends, "is_ratio": is_ratio, "at_zero": at_zero, "source": p.source,
            })
        });
        json!({
            "id": d.id, "name": d.name, "stage": d.stage, "equation": d.equation, "signature": d.signature,
            "experiment": d.experiment, "parameters": parameters.collect::<Vec<_>>(),
        })
    }

    /// Of a trial, one after the other: time [s], angle [deg], speed [deg/s], measured moment [N·m], mean activation of
    /// all muscles as the excitations drive it.
    pub fn recorded(&self, trial: usize) -> Vec<f64> {
        let Some(t) = self.trials.get(trial) else { return Vec::new() };
        let speed = speed_and_acceleration(&t.time, &t.angle).map(|[speed, _]| speed).unwrap_or_default();
        let muscles = &self.forward.base(trial).kinematics().muscles;
        let mean = |k: usize| muscles.iter().map(|m| m.activation[k]).sum::<f64>() / muscles.len().max(1) as f64;
        let degrees = |x: &[f64]| x.iter().map(|v| v.to_degrees()).collect::<Vec<_>>();
        let mut out = t.time.clone();
        out.extend(degrees(&t.angle));
        out.extend(degrees(&speed));
        out.extend(&t.moment);
        out.extend((0..t.len()).map(mean));
        out
    }

    /// - `held`: coordinates that have a value of their own in the trial
    fn trial(&self, trial: &Trial) -> Value {
        let info = &trial.info;
        let coordinates = &self.model.skeleton().coordinates;
        let is_length =
            |name: &str| coordinates.iter().any(|c| c.name == name && c.motion_type == MotionType::Translational);
        let held = |h: &PostureCoordinate| {
            let unit = if is_length(&h.coordinate) { "m" } else { "deg" };
            json!({ "coordinate": h.coordinate, "value": h.value_deg_or_m, "unit": unit })
        };
        json!({
            "name": info.name,
            "condition": Condition::of(info).label(),
            "posture_deg": info.posture.map(f64::to_degrees),
            "held": info.held.iter().map(held).collect::<Vec<_>>(),
            "repetition": info.repetition,
            "use": info.usage,
            "samples": trial.len(),
        })
    }
}
