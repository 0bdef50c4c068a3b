//! What every effect has to do, of the catalogue or of a laboratory's own, shown on recorded trials.

use super::effect::{Effect, Quantity, Role};
use super::forward_model::{Core, ForwardModel, Setting, TrialInput};
use carpus_simulation::simulation::SimulationError;

/// Largest moment that a plausible effect makes of a wrist's [N·m], and of a stronger joint in proportion.
const LARGEST_MOMENT: f64 = 500.0;
/// Relative error of a derivative.
const DERIVATIVE: f64 = 1e-3;
/// Of one with kinks that a difference steps over.
const DERIVATIVE_AT_KINKS: f64 = 0.02;
/// Step of the difference on the joint, in scales: its square and what rounding makes of it stay far below
/// [`DERIVATIVE`].
const JOINT_STEP: f64 = 1e-3;
/// Step elsewhere, in scales: errors of the integration, divided by it, stay small.
const STEP: f64 = 0.01;
/// What moments of one effect of one and three halves of a size may be off from proportion [N·m].
const PROPORTION: f64 = 1e-10;
/// Least change of the moment that a typical size makes [N·m].
const NOTICEABLE: f64 = 1e-6;
/// Ends of plausible ranges that are tried together, at most.
const MOST_CORNERS: usize = 64;

/// One thing that an effect has to do, and whether it does.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Check {
    /// What.
    pub what: String,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
    /// Whether it is so.
    pub passed: bool,
}

/// Trials and the effect in question.
struct Subject<'a> {
    forward: &'a ForwardModel,
    effect: &'static dyn Effect,
    inputs: Vec<TrialInput>,
    /// Per trial, without effects; of an effect that acts at the joint or behind it every moment is made of these.
    cores: Vec<Core>,
}

/// All checks of an effect.
///
/// - `forward`: trials that it is shown on
/// - `kinked`: whether it jumps somewhere, in value or slope
///
/// # Errors
/// A trial that cannot be simulated.
pub fn checks(
    forward: &ForwardModel,
    effect: &'static dyn Effect,
    kinked: bool,
) -> Result<Vec<Check>, SimulationError> {
    let inputs: Vec<TrialInput> = (0..forward.trials.len()).map(|g| forward.recorded_input(g)).collect();
    let plain = forward.variant(&[])?;
    let parameters = forward.nominal_parameters();
    let core = |(g, input): (usize, &TrialInput)| forward.core(&plain, g, input, &parameters, &[], true);
    let cores = inputs.iter().enumerate().map(core).collect::<Result<Vec<Core>, _>>()?;
    let subject = Subject { forward, effect, inputs, cores };
    let mut all = vec![subject.absent()?, subject.present()?, subject.plausible()?];
    if effect.description().stage.adds_moment() {
        all.push(subject.proportion()?);
    }
    for parameter in 0..effect.description().parameters.len() {
        all.extend(subject.derivatives(parameter, kinked)?);
    }
    Ok(all)
}

fn check(what: impl Into<String>, found: String, expected: impl Into<String>, passed: bool) -> Check {
    Check { what: what.into(), found, expected: expected.into(), passed }
}

fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |m, v| if v.is_nan() { f64::NAN } else { m.max(v.abs()) })
}

fn difference<'a>(a: &'a [f64], b: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    a.iter().zip(b).map(|(a, b)| a - b)
}

impl Subject<'_> {
    fn trials(&self) -> std::ops::Range<usize> {
        0..self.inputs.len()
    }

    /// The effect, amplitudes so many times their scale, shapes as usual.
    fn sized(&self, sizes: f64) -> Setting {
        let mut setting = self.forward.joint.absent(self.effect);
        let d = self.effect.description();
        d.amplitudes().for_each(|i| setting.values[i] = sizes * self.forward.joint.scale(&d.parameters[i]));
        setting
    }

    /// The recorded moment of a trial.
    fn moment(&self, trial: usize, setting: &Setting) -> Result<Vec<f64>, SimulationError> {
        self.moment_with(trial, std::slice::from_ref(setting))
    }

    fn moment_with(&self, trial: usize, effects: &[Setting]) -> Result<Vec<f64>, SimulationError> {
        if self.effect.description().stage.adds_moment() {
            return Ok(self.forward.recorded_moment(trial, &self.cores[trial], effects));
        }
        let variant = self.forward.variant(effects)?;
        let parameters = self.forward.nominal_parameters();
        let core = self.forward.core(&variant, trial, &self.inputs[trial], &parameters, effects, false)?;
        Ok(self.forward.recorded_moment(trial, &core, effects))
    }

    /// Values at the ends of what is plausible, each parameter at either.
    fn corners(&self) -> Vec<Setting> {
        let parameters = self.effect.description().parameters;
        let shift = parameters.len().min(MOST_CORNERS.ilog2() as usize);
        let absent = self.forward.joint.absent(self.effect);
        let usual = self.effect.reported(&absent.values, &self.forward.muscles);
        let corner = |bits: usize| {
            let mut setting = absent.clone();
            for (i, (value, p)) in setting.values.iter_mut().zip(parameters).enumerate() {
                // Where there are more parameters, some move together.
                let end = self.forward.joint.plausible(p)[(bits >> (i % shift)) & 1];
                *value = match p.quantity {
                    Quantity::Itself => end,
                    Quantity::LogRatio => (end / usual[i]).ln(),
                };
            }
            setting
        };
        if shift == 0 { Vec::new() } else { (0..1_usize << shift).map(corner).collect() }
    }

    fn absent(&self) -> Result<Check, SimulationError> {
        let mut changed = 0;
        let mut others = self.corners();
        others.push(self.forward.joint.absent(self.effect));
        for setting in &mut others {
            self.effect.description().amplitudes().for_each(|i| setting.values[i] = 0.0);
            for trial in self.trials() {
                let [plain, with] = [self.moment_with(trial, &[])?, self.moment(trial, setting)?];
                changed += with.iter().zip(&plain).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
            }
        }
        let found = if changed == 0 { "nothing changes".to_owned() } else { format!("{changed} samples change") };
        Ok(check("amplitudes at 0 leave the model as it is, to the last bit", found, "nothing changes", changed == 0))
    }

    fn present(&self) -> Result<Check, SimulationError> {
        let mut most = 0.0_f64;
        for trial in self.trials() {
            let plain = self.moment(trial, &self.sized(0.0))?;
            most = most.max(largest(difference(&self.moment(trial, &self.sized(1.0))?, &plain)));
        }
        let found = format!("the moment changes by up to {most:.3} N·m");
        Ok(check("a typical size shows in these trials", found, "a change", most > NOTICEABLE))
    }

    fn plausible(&self) -> Result<Check, SimulationError> {
        let limit = LARGEST_MOMENT * self.forward.joint.strength;
        let (mut most, mut at) = (0.0_f64, String::new());
        for setting in self.corners() {
            for trial in self.trials() {
                let size = largest(self.moment(trial, &setting)?);
                if !(size <= most) {
                    let parameters = self.effect.description().parameters.iter();
                    let values = parameters.zip(&setting.values).map(|(p, v)| format!("{} = {v}", p.name));
                    (most, at) = (size, values.collect::<Vec<_>>().join(", "));
                }
                if size.is_nan() {
                    return Ok(check("plausible sizes give numbers", format!("none at {at}"), "numbers", false));
                }
            }
        }
        let found = format!("moments up to {most:.1} N·m (at {at})");
        Ok(check("plausible sizes give moments that a joint has", found, format!("below {limit:.0} N·m"), most < limit))
    }

    fn proportion(&self) -> Result<Check, SimulationError> {
        let mut worst = 0.0_f64;
        for trial in self.trials() {
            let plain = self.moment(trial, &self.sized(0.0))?;
            let [one, three] = [self.moment(trial, &self.sized(0.5))?, self.moment(trial, &self.sized(1.5))?];
            let left = difference(&one, &plain).zip(difference(&three, &plain)).map(|(one, three)| 3.0 * one - three);
            worst = worst.max(largest(left));
        }
        let what = "three times the amplitudes make three times the moment";
        Ok(check(what, format!("off by {worst:.1e} N·m"), format!("below {PROPORTION:.0e} N·m"), worst < PROPORTION))
    }

    fn derivatives(&self, parameter: usize, kinked: bool) -> Result<Vec<Check>, SimulationError> {
        let p = &self.effect.description().parameters[parameter];
        let (limit, mut all) = (if kinked { DERIVATIVE_AT_KINKS } else { DERIVATIVE }, Vec::new());
        let mut sizes = vec![("a typical size", 0.7)];
        if p.role == Role::Amplitude {
            sizes.insert(0, ("0", 0.0));
        }
        for (at, size) in sizes {
            let error = self.derivative_error(&self.sized(size), parameter)?;
            let what = format!("derivative by {} at {at} is that of differences", p.name);
            let found = format!("off by {error:.1e} of it");
            all.push(check(what, found, format!("below {limit:.0e}"), error < limit));
        }
        Ok(all)
    }

    /// Root mean square over all trials of what a derivative is off from a central difference, relative to that of the
    /// derivative.
    fn derivative_error(&self, setting: &Setting, parameter: usize) -> Result<f64, SimulationError> {
        let (forward, effects) = (self.forward, std::slice::from_ref(setting));
        let d = self.effect.description();
        let parameters = forward.nominal_parameters();
        let variant = forward.variant(effects)?;
        let variants = forward.difference_variants(effects, 0)?;
        let scale = forward.joint.scale(&d.parameters[parameter]);
        let step = if d.stage.adds_moment() { JOINT_STEP } else { STEP };
        let (mut error, mut size) = (0.0, 0.0);
        for trial in self.trials() {
            let input = &self.inputs[trial];
            let core = forward.core(&variant, trial, input, &parameters, effects, true)?;
            let by = forward.effect_derivative(trial, &core, input, &parameters, effects, 0, &variants, parameter)?;
            let side = |sign: f64| {
                let mut setting = setting.clone();
                setting.values[parameter] += sign * step * scale;
                self.moment(trial, &setting)
            };
            let [up, down] = [side(1.0)?, side(-1.0)?];
            error += difference(&up, &down).zip(&by).map(|(d, by)| (d / (2.0 * step) - by).powi(2)).sum::<f64>();
            size += by.iter().map(|by| by * by).sum::<f64>();
        }
        Ok(if size == 0.0 { error.sqrt() } else { (error / size).sqrt() })
    }
}
