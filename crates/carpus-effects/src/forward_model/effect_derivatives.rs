//! Derivatives of the recorded moment by parameters of effects.

use std::borrow::Cow;
use std::sync::{Arc, PoisonError};

use super::super::effect::{JointState, MuscleState, Stage};
use super::super::setting::Setting;
use super::effects_in_order::{change_at, in_order, muscle_change, shown_effects};
use super::recorded_changes::{Change, ExcitationChange, senses};
use super::{Core, FEEDBACK_ROUNDS, ForwardModel, TrialInput};
use carpus_simulation::simulation::{
    ExcitationTangent, ForceChange, MuscleParameters, MusculoskeletalModel, PreparedTrial, SimulationError,
};

impl Core {
    /// How forces follow changes of excitation and of time constants of activation; `None` where these change
    /// the joint's angle too, where a tendon is rigid, and for a core without derivatives.
    fn tangents(&self) -> Option<&[ExcitationTangent]> {
        let calc = || {
            let of = |(i, solution)| self.prepared.excitation_tangent(i, solution);
            let known = self.without.is_none() && !self.solutions.is_empty();
            known.then(|| self.solutions.iter().enumerate().map(of).collect()).flatten()
        };
        self.tangents.get_or_init(calc).as_deref()
    }
}

impl ForwardModel {
    /// Derivative of the recorded moment by a parameter of an effect [N·m per unit of the parameter's scale].
    ///
    /// What the muscles' dynamics make of the effect is the exact derivative of the simulation
    /// ([`PreparedTrial::force_derivative`]); closed formulas before and after them are differentiated by
    /// central differences of a ten-thousandth of the scale, which at a kink give the mean of both sides,
    /// unless the effect knows its derivative itself ([`crate::effect::Effect::moment_derivative`]). Noise of
    /// the recorded angle matters to what effects on the joint add themselves, and hardly to how other
    /// effects change it: there it is left out.
    ///
    /// - `effects`: the effects that are on, the one in question at position `which`
    /// - `core`: of the same trial, input, parameters and effects, with derivatives
    /// - `variants`: from [`ForwardModel::difference_variants`]
    ///
    /// # Errors
    /// A property that is not allowed.
    pub fn effect_derivative(
        &self,
        trial: usize,
        core: &Core,
        input: &TrialInput,
        parameters: &[MuscleParameters],
        effects: &[Setting],
        which: usize,
        variants: &[[Cow<'_, MusculoskeletalModel>; 2]],
        parameter: usize,
    ) -> Result<Vec<f64>, SimulationError> {
        let stage = effects[which].effect.description().stage;
        if stage.adds_moment() {
            return Ok(self.joint_derivative(trial, core, effects, which, parameter));
        }
        let step = effects[which].effect.description().stage.difference_step();
        let sides = [1.0, -1.0].map(|sign| self.moved(effects, which, parameter, sign * step));
        if stage <= Stage::Activation
            && let Some((changes, follows)) =
                self.followed(trial, core, input, (stage, &sides), variants.get(parameter), 2.0 * step)
        {
            let by = self.moment_derivative(trial, core, input, parameters, effects, &follows, 2.0 * step);
            let mut by = match self.reshapes_moment(effects) {
                true => self.recorded_changes(trial, core, effects, [Change::Moment(&by)]).swap_remove(0),
                false => by,
            };
            if let Some((first, beside)) = self.recorded_beside_muscles(trial, core, effects, &changes) {
                by[first..].iter_mut().zip(&beside).for_each(|(by, beside)| *by += beside);
            }
            return Ok(by);
        }
        let [up, down] = if stage >= Stage::Sensor {
            sides.each_ref().map(|effects| self.recorded_at(trial, core, effects))
        } else {
            let variants = variants[parameter].each_ref().map(|v| &**v);
            let acting = sides.each_ref().map(|effects| self.acting(effects).into_owned());
            let acting = (&acting, FEEDBACK_ROUNDS);
            let [up, down] = self.beside(trial, core, input, parameters, acting, variants, 2.0 * step)?;
            [self.recorded_at(trial, &up, &sides[0]), self.recorded_at(trial, &down, &sides[1])]
        };
        Ok(up.iter().zip(&down).map(|(a, b)| (a - b) / (2.0 * step)).collect())
    }

    /// The moment that the sensor records were the angle free of noise [N·m].
    fn recorded_at(&self, trial: usize, core: &Core, effects: &[Setting]) -> Vec<f64> {
        self.recorded(trial, core, core.moment.clone(), core.shown(), effects, false)
    }

    /// Derivative of the recorded moment by a parameter of an effect on the joint, as expected with noise in
    /// the recorded angle [N·m per unit of the parameter's scale]. Effects on the joint add their moments:
    /// what the others add stays as it is.
    fn joint_derivative(
        &self,
        trial: usize,
        core: &Core,
        effects: &[Setting],
        which: usize,
        parameter: usize,
    ) -> Vec<f64> {
        let by = self.added_derivative(trial, core, effects, which, parameter);
        let acting = self.acting(effects);
        let sensing: Vec<&Setting> = in_order(&acting).into_iter().filter(|s| senses(s)).collect();
        match sensing.is_empty() {
            true => by.to_vec(),
            false => self.sensed_changes(trial, core, &sensing, [Change::Moment(&by)]).swap_remove(0),
        }
    }

    /// The same of the joint's moment. Of an absent effect that follows the motion alone it is known once it
    /// was asked for at the recorded motion.
    fn added_derivative(
        &self,
        trial: usize,
        core: &Core,
        effects: &[Setting],
        which: usize,
        parameter: usize,
    ) -> Arc<Vec<f64>> {
        let setting = &effects[which];
        let calc = || Arc::new(self.calc_added_derivative(trial, core, setting, parameter));
        let (here, recorded) = (core.prepared.kinematics(), self.base[trial].kinematics());
        let as_recorded = || {
            here.angle == recorded.angle && here.speed == recorded.speed && here.acceleration == recorded.acceleration
        };
        let usual = || setting.values == self.joint.absent(setting.effect).values;
        if !setting.effect.follows_motion_alone(self.silent()) || !usual() || !as_recorded() {
            return calc();
        }
        let key = (setting.effect.description().id, parameter);
        let known = || self.by_motion[trial].0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(by) = known().get(&key) {
            return by.clone();
        }
        known().entry(key).or_insert(calc()).clone()
    }

    fn calc_added_derivative(&self, trial: usize, core: &Core, setting: &Setting, parameter: usize) -> Vec<f64> {
        let Setting { effect, values } = setting;
        let step = effect.description().stage.difference_step();
        let scale = self.joint.scale(&effect.description().parameters[parameter]);
        let sides = [1.0, -1.0].map(|sign| {
            let mut values = values.clone();
            values[parameter] += sign * step * scale;
            values
        });
        let context = self.context(trial, &core.excitation, core.shown());
        let kinematics = core.prepared.kinematics();
        let samples = kinematics.angle.len();
        let mut both = [vec![0.0; samples], vec![0.0; samples]];
        // Adds the derivative, times a weight.
        let mut add = |joint: &JointState, weight: f64, to: &mut [f64]| {
            if let Some(by) = effect.moment_derivative(values, parameter, joint) {
                to.iter_mut().zip(&by).for_each(|(to, by)| *to += weight * scale * by);
                return;
            }
            for (values, moment) in sides.iter().zip(&mut both) {
                moment.fill(0.0);
                effect.add_moment(values, joint, moment);
            }
            let weight = weight / (2.0 * step);
            to.iter_mut().zip(&both[0]).zip(&both[1]).for_each(|((to, up), down)| *to += weight * (up - down));
        };
        let muscles = &kinematics.muscles[..];
        let mut by = vec![0.0; samples];
        match self.angle_noise.as_ref().map_or(&[][..], |noise| &noise.draws[trial]) {
            [] => {
                let (angle, speed) = (&kinematics.angle, &kinematics.speed);
                let acceleration = &kinematics.acceleration;
                add(&JointState { trial: &context, angle, speed, acceleration, muscles }, 1.0, &mut by);
            }
            draws => {
                let sum = |a: &[f64], b: &[f64], to: &mut [f64]| {
                    to.iter_mut().zip(a).zip(b).for_each(|((to, a), b)| *to = a + b);
                };
                let [mut angle, mut speed, mut acceleration] = [(); 3].map(|()| vec![0.0; samples]);
                for draw in draws {
                    sum(&kinematics.angle, &draw.angle, &mut angle);
                    sum(&kinematics.speed, &draw.speed, &mut speed);
                    sum(&kinematics.acceleration, &draw.acceleration, &mut acceleration);
                    let (angle, speed, acceleration) = (&angle, &speed, &acceleration);
                    let joint = JointState { trial: &context, angle, speed, acceleration, muscles };
                    add(&joint, 1.0 / draws.len() as f64, &mut by);
                }
            }
        }
        by
    }

    /// Changes of the excitations from one side to the other, and how the muscles that something changes for
    /// follow; `None` where more changes than their excitations and time constants of activation.
    ///
    /// - `stage`: of what differs; `sides`, `variants`, `distance`: as for [`ForwardModel::beside`]
    fn followed(
        &self,
        trial: usize,
        core: &Core,
        input: &TrialInput,
        (stage, sides): (Stage, &[Vec<Setting>; 2]),
        variants: Option<&[Cow<'_, MusculoskeletalModel>; 2]>,
        distance: f64,
    ) -> Option<(Vec<ExcitationChange>, Vec<(usize, ForceChange)>)> {
        if stage == Stage::Activation {
            let [up, down] = variants?;
            let ratios = up.log_ratios_of_time_constants(down)?;
            let tangents = core.tangents()?;
            let of_muscle =
                |(i, ratios): (usize, [f64; 2])| (i, tangents[i].follow_time_constants(ratios.map(|r| r / distance)));
            return Some((Vec::new(), ratios.into_iter().enumerate().map(of_muscle).collect()));
        }
        let tangents = core.tangents()?;
        let changes = self.excitation_changes_between(trial, core, input, sides, distance);
        let follows = changes.iter().map(|c| (c.muscle, tangents[c.muscle].follow(&c.values))).collect();
        Some((changes, follows))
    }

    /// Changes of the excitations from one side to the other, of those that differ, in order.
    ///
    /// - `sides`, `distance`: as for [`ForwardModel::beside`]
    fn excitation_changes_between(
        &self,
        trial: usize,
        core: &Core,
        input: &TrialInput,
        sides: &[Vec<Setting>; 2],
        distance: f64,
    ) -> Vec<ExcitationChange> {
        let context = self.context(trial, &input.excitation, core.shown());
        let [up, down] = sides.each_ref().map(|side| self.driven(trial, &in_order(&self.acting(side)), &context).1);
        let between = |(muscle, (up, down)): (usize, (&Vec<f64>, &Vec<f64>))| {
            let values = || up.iter().zip(down).map(|(a, b)| (a - b) / distance).collect();
            (up != down).then(|| ExcitationChange { muscle, first: 0, values: values() })
        };
        up.iter().zip(&down).enumerate().filter_map(between).collect()
    }

    /// Derivative of the muscles' moment by what changes activation and force alone.
    ///
    /// - `follows`: changes of the muscles that follow, by place; `distance`: between the sides that they are between
    fn moment_derivative(
        &self,
        trial: usize,
        core: &Core,
        input: &TrialInput,
        parameters: &[MuscleParameters],
        effects: &[Setting],
        follows: &[(usize, ForceChange)],
        distance: f64,
    ) -> Vec<f64> {
        let context = self.context(trial, &input.excitation, core.shown());
        let acting = self.acting(effects);
        let ordered = in_order(&acting);
        let kinematics = core.prepared.kinematics();
        let mut out = vec![0.0; kinematics.angle.len()];
        for (i, follows) in follows {
            let i = *i;
            let p = &parameters[i];
            let path = &kinematics.muscles[i];
            let change = |by: f64| {
                let activation = path.activation.iter().zip(&follows.activation).map(|(a, d)| a + by * d);
                let activation: Vec<f64> = activation.collect();
                let arm = &path.moment_arm;
                let state = MuscleState {
                    trial: &context,
                    muscle: i,
                    angle: &kinematics.angle,
                    moment_arm: arm,
                    activation: &activation,
                };
                change_at(&ordered, &state)
            };
            let [more, less] = [0.5 * distance, -0.5 * distance].map(change);
            let force = &core.solutions[i].force;
            for (k, out) in out.iter_mut().enumerate() {
                let by_force = 0.5 * (more.factor[k] + less.factor[k]) * follows.force[k];
                let [above, below] = [&more, &less].map(|side| side.factor[k] * (force[k] + side.force[k]));
                let by_change = (above - below) / distance;
                *out += p.max_isometric_force * path.moment_arm[k] * (by_force + by_change);
            }
        }
        out
    }

    /// A trial's core a little way in a direction and against it.
    ///
    /// - `sides`: the effects there, and rounds of feedback; `distance`: between them
    fn beside(
        &self,
        trial: usize,
        core: &Core,
        input: &TrialInput,
        parameters: &[MuscleParameters],
        (sides, rounds): (&[Vec<Setting>; 2], usize),
        variants: [&MusculoskeletalModel; 2],
        distance: f64,
    ) -> Result<[Core; 2], SimulationError> {
        let without = match &core.without {
            Some(without) => {
                let [(above, rounds), (below, _)] = sides.each_ref().map(|s| shown_effects(s, rounds));
                let sides = [above, below];
                let [up, down] =
                    self.beside(trial, without, input, parameters, (&sides, rounds), variants, distance)?;
                [Some(Box::new(up)), Some(Box::new(down))]
            }
            None => [None, None],
        };
        let moments = without.each_ref().map(|w| w.as_ref().map_or(&core.muscle_moment, |w| &w.muscle_moment));
        let contexts = moments.map(|moment| self.context(trial, &input.excitation, moment));
        let ordered = sides.each_ref().map(|s| in_order(s));
        let driven = [0, 1].map(|i| self.driven(trial, &ordered[i], &contexts[i]));
        let recordings = driven.each_ref().map(|(angle, excitation)| self.recording(trial, angle, excitation));
        let prepared =
            MusculoskeletalModel::prepare_beside(variants, recordings.each_ref(), &core.prepared, &self.options)?;
        let mut moments = prepared.each_ref().map(PreparedTrial::moment_without_muscles);
        for (i, p) in parameters.iter().enumerate() {
            let solution = match core.solutions.get(i) {
                Some(known) => Cow::Borrowed(known),
                None => Cow::Owned(core.prepared.solve(i, p)?),
            };
            let by = core.prepared.force_derivative(i, &solution, prepared.each_ref(), distance);
            for (side, sign) in [(0, 0.5), (1, -0.5)] {
                let change = muscle_change(&ordered[side], &contexts[side], &prepared[side], i, &driven[side].0);
                let arm = &prepared[side].kinematics().muscles[i].moment_arm;
                for (k, moment) in moments[side].iter_mut().enumerate() {
                    let force = solution.force[k] + by.as_ref().map_or(0.0, |by| sign * distance * by[k]);
                    *moment += p.max_isometric_force * change.factor[k] * (arm[k] * (force + change.force[k]));
                }
            }
        }
        let core = |prepared, excitation, moment, without| Core { without, ..Core::bare(prepared, excitation, moment) };
        let ([(_, above), (_, below)], [m_up, m_down], [w_up, w_down]) = (driven, moments, without);
        let [up, down] = prepared;
        Ok([core(up, above, m_up, w_up), core(down, below, m_down, w_down)])
    }

    /// The models on both sides of the difference, per parameter of an effect.
    ///
    /// # Errors
    /// A property that is not allowed.
    pub fn difference_variants(
        &self,
        effects: &[Setting],
        which: usize,
    ) -> Result<Vec<[Cow<'_, MusculoskeletalModel>; 2]>, SimulationError> {
        (0..effects[which].values.len())
            .map(|parameter| {
                let step = effects[which].effect.description().stage.difference_step();
                let up = self.variant(&self.moved(effects, which, parameter, step))?;
                let down = self.variant(&self.moved(effects, which, parameter, -step))?;
                Ok([up, down])
            })
            .collect()
    }

    /// Effects, a parameter of one of them moved by so many of its scales.
    fn moved(&self, effects: &[Setting], which: usize, parameter: usize, step: f64) -> Vec<Setting> {
        let mut effects = effects.to_vec();
        let moved = &effects[which].effect.description().parameters[parameter];
        effects[which].values[parameter] += step * self.joint.scale(moved);
        effects
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::effect;
    use crate::two_silent_muscles::with_two_silent_muscles;

    fn sized(id: &str, values: &[f64]) -> Setting {
        let mut setting = Setting::absent(effect(id).unwrap());
        setting.values[..values.len()].copy_from_slice(values);
        setting
    }

    /// Whole simulations with silent muscles and without them: what they add to a derivative, and to the
    /// difference of moments.
    #[test]
    fn verif_silent_muscles_follow_what_changes_the_excitation() {
        /// Of the difference, in scales.
        const STEP: f64 = 0.01;
        let forward = with_two_silent_muscles();
        let parameters = forward.nominal_parameters();
        let recorded = |trial: usize, effects: &[Setting]| {
            let (variant, input) = (forward.variant(effects).unwrap(), forward.recorded_input(trial));
            let core = forward.core(&variant, trial, &input, &parameters, effects, false).unwrap();
            forward.recorded_moment(trial, &core, effects)
        };
        let rms = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
        let less = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
        for (id, values, limit) in [
            ("electromechanical_delay", &[0.013][..], 0.02),
            ("emg_nonlinearity", &[-1.0], 1e-3),
            ("emg_gain_drift", &[0.1], 1e-3),
            ("fatigue", &[0.3], 1e-3),
            ("emg_crosstalk", &[0.1], 0.02),
        ] {
            let others = [sized(id, values), sized("time_shift", &[0.01]), sized("stretch_reflex", &[0.05])];
            let with = [&others[..], &[sized("unmodelled_muscles", &[0.5, 0.4])]].concat();
            for parameter in effect(id).unwrap().description().amplitudes() {
                let scale = forward.joint.scale(&effect(id).unwrap().description().parameters[parameter]);
                let derivative = |trial: usize, effects: &[Setting]| {
                    let (variant, input) = (forward.variant(effects).unwrap(), forward.recorded_input(trial));
                    let core = forward.core(&variant, trial, &input, &parameters, effects, true).unwrap();
                    let variants = forward.difference_variants(effects, 0).unwrap();
                    forward
                        .effect_derivative(trial, &core, &input, &parameters, effects, 0, &variants, parameter)
                        .unwrap()
                };
                let difference = |trial: usize, effects: &[Setting]| -> Vec<f64> {
                    let side = |sign: f64| {
                        let mut effects = effects.to_vec();
                        effects[0].values[parameter] += sign * STEP * scale;
                        recorded(trial, &effects)
                    };
                    less(&side(1.0), &side(-1.0)).iter().map(|d| d / (2.0 * STEP)).collect()
                };
                // The second trial: what drifts over the session starts at the first.
                let found = less(&derivative(1, &with), &derivative(1, &others));
                let expected = less(&difference(1, &with), &difference(1, &others));
                let error = rms(&less(&found, &expected)) / rms(&expected);
                println!("{id}: {error:.1e} of {:.1e}", rms(&expected));
                assert!(rms(&expected) > 1e-5 && error < limit, "{id}: {error:.1e}");
            }
        }
    }

    /// What is kept of an effect must not depend on muscles, excitations or other effects.
    #[test]
    fn verif_effects_that_follow_the_motion_alone_do_whatever_the_muscles_do() {
        let forward = with_two_silent_muscles();
        let given = forward.nominal_parameters();
        let mut other = given.clone();
        other.iter_mut().for_each(|p| p.max_isometric_force *= 1.3);
        let beside = [sized("emg_nonlinearity", &[-1.0]), sized("electromechanical_delay", &[0.02])];
        let mut count = 0;
        for effect in crate::catalogue::CATALOGUE {
            let setting = forward.joint.absent(*effect);
            if !effect.follows_motion_alone(forward.silent()) {
                continue;
            }
            count += 1;
            let [plain, moved] = [(&given, &[][..]), (&other, &beside[..])].map(|(parameters, effects)| {
                let (variant, input) = (forward.variant(effects).unwrap(), forward.recorded_input(0));
                forward.core(&variant, 0, &input, parameters, effects, true).unwrap()
            });
            for parameter in 0..setting.values.len() {
                let known = forward.added_derivative(0, &plain, std::slice::from_ref(&setting), 0, parameter);
                let anew = forward.calc_added_derivative(0, &moved, &setting, parameter);
                assert_eq!(*known, anew, "{}", effect.description().id);
            }
        }
        assert!(count >= 8, "{count}");
        assert!(!effect("unmodelled_muscles").unwrap().follows_motion_alone(forward.silent()));
    }
}
