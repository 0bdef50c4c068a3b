//! How what is recorded follows what changes before: the muscles' moment, and the excitations of muscles.

use std::borrow::Cow;

use super::super::effect::{JointState, Stage, TrialContext};
use super::super::setting::Setting;
use super::effects_in_order::{add_moments, in_order};
use super::{Core, ForwardModel, joint_state};
use carpus_simulation::simulation::AngleResponse;

/// Change of the muscles' moment for differences of what is recorded [N·m].
const SMALL_MOMENT: f64 = 1e-5;

/// A change of the muscles' moment at the angle as it is, per sample.
#[derive(Clone, Copy, Debug)]
pub enum Change<'c> {
    /// By the parameter at this place of [`Core::by_parameters`].
    Parameter(usize),
    /// The same in all rounds of the moment's feedback [N·m per unit of what changes].
    Moment(&'c [f64]),
    /// In every round, as of [`Core::rounds`].
    OfRounds(&'c [Vec<f64>]),
}

impl<'c> Change<'c> {
    /// - `core`: of the round in question; `round`: its place
    fn at(self, core: &'c Core, round: usize) -> &'c [f64] {
        match self {
            Change::Parameter(column) => &core.by_parameters[column],
            Change::Moment(by) => by,
            Change::OfRounds(rounds) => &rounds[round],
        }
    }
}

/// A change of a muscle's excitation after the effects on it, per sample; elsewhere there is none.
pub struct ExcitationChange {
    /// Which of the active muscles.
    pub muscle: usize,
    /// First sample.
    pub first: usize,
    /// From there on [per unit of what changes].
    pub values: Vec<f64>,
}

impl Core {
    /// This core, then the one whose moment turned its joint, and so on.
    pub fn rounds(&self) -> Vec<&Core> {
        std::iter::successors(Some(self), |core| core.without.as_deref()).collect()
    }

    /// How the muscles' moment follows changes of the joint's angle.
    fn by_angle(&self) -> &AngleResponse {
        self.by_angle.get_or_init(|| self.prepared.angle_response(&self.solutions, &self.factors))
    }
}

impl ForwardModel {
    /// Whether the recorded moment changes otherwise than the muscles' moment does: through the sensor, or
    /// through an effect on the joint that depends on the muscles' moment.
    pub fn reshapes_moment(&self, effects: &[Setting]) -> bool {
        let reshapes = |s: &Setting| senses(s) || !s.is_absent() && s.effect.description().needs_moment();
        self.acting(effects).iter().any(reshapes)
    }

    /// Changes of the recorded moment when the muscles' moment changes, to first order: through its feedback
    /// on the joint's angle and through the sensor. The noise of the angle hardly matters to them and is left
    /// out.
    ///
    /// - `core`: with derivatives
    pub fn recorded_changes<'c>(
        &self,
        trial: usize,
        core: &Core,
        effects: &[Setting],
        changes: impl IntoIterator<Item = Change<'c>>,
    ) -> Vec<Vec<f64>> {
        let acting = self.acting(effects);
        if !acting.iter().any(|s| s.effect.description().needs_moment()) {
            let sensing: Vec<&Setting> = in_order(&acting).into_iter().filter(|s| senses(s)).collect();
            return self.sensed_changes(trial, core, &sensing, changes);
        }
        // What other effects add stays as it is.
        let ordered = in_order(&acting);
        let showing: Vec<&Setting> = ordered
            .iter()
            .copied()
            .filter(|s| s.effect.description().needs_moment() || s.effect.description().stage >= Stage::Sensor)
            .collect();
        let recorded = |mut moment: Vec<f64>, shown: &[f64]| {
            let context = self.context(trial, &core.excitation, shown);
            joint_state(core, &context, |joint| add_moments(&showing, joint, &mut moment));
            showing.iter().for_each(|s| s.effect.sense(&s.values, &context, &mut moment));
            moment
        };
        let base = recorded(core.moment.clone(), core.shown());
        let add =
            |to: &[f64], by: &[f64], step: f64| -> Vec<f64> { to.iter().zip(by).map(|(m, d)| m + step * d).collect() };
        let feeding_back: Vec<&Setting> = ordered.into_iter().filter(|s| s.effect.description().feeds_back()).collect();
        let changed = |by: Change<'c>| {
            let by = &*self.fed_back(trial, core, &feeding_back, by);
            let largest = by.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            if largest == 0.0 {
                return vec![0.0; by.len()];
            }
            // Small, because the direction of a moment may matter, and its share of the largest.
            let step = SMALL_MOMENT / largest;
            let shown = add(core.shown(), by, step);
            let moved = recorded(add(&core.moment, by, step), &shown);
            moved.iter().zip(&base).map(|(a, b)| (a - b) / step).collect()
        };
        changes.into_iter().map(changed).collect()
    }

    /// Changes of the recorded moment when the joint's moment changes: a sensor's moment is affine in it.
    ///
    /// - `sensing`: effects on the sensor, in order
    pub(super) fn sensed_changes<'c>(
        &self,
        trial: usize,
        core: &Core,
        sensing: &[&Setting],
        changes: impl IntoIterator<Item = Change<'c>>,
    ) -> Vec<Vec<f64>> {
        let context = self.context(trial, &core.excitation, core.shown());
        let sense = |mut moment: Vec<f64>| {
            sensing.iter().for_each(|s| s.effect.sense(&s.values, &context, &mut moment));
            moment
        };
        let still = sense(vec![0.0; core.moment.len()]);
        let sensed = |by: Change<'c>| {
            let mut moved = sense(by.at(core, 0).to_vec());
            moved.iter_mut().zip(&still).for_each(|(moved, still)| *moved -= still);
            moved
        };
        changes.into_iter().map(sensed).collect()
    }

    /// The change of the joint's moment when a change of the muscles' moment turns the joint, in as many
    /// rounds as in the simulation [N·m per unit of what changes].
    ///
    /// - `feeding_back`: effects through which it does
    fn fed_back<'c>(
        &self,
        trial: usize,
        core: &'c Core,
        feeding_back: &[&Setting],
        change: Change<'c>,
    ) -> Cow<'c, [f64]> {
        if feeding_back.is_empty() {
            return Cow::Borrowed(change.at(core, 0));
        }
        let angle = |moment: &[f64]| {
            let context = self.context(trial, &core.excitation, moment);
            let mut angle = vec![0.0; moment.len()];
            feeding_back.iter().for_each(|s| s.effect.change_angle(&s.values, &context, &mut angle));
            angle
        };
        // A joint turns in proportion to the moment.
        let still = angle(&vec![0.0; core.moment.len()]);
        let mut found: Option<Cow<[f64]>> = None;
        for (round, core) in core.rounds().into_iter().enumerate().rev() {
            let by = change.at(core, round);
            found = Some(match found {
                None => Cow::Borrowed(by),
                Some(before) => {
                    let turned: Vec<f64> =
                        angle(&before).iter().zip(&still).map(|(angle, still)| angle - still).collect();
                    let mut through = core.by_angle().moment(&turned);
                    through.iter_mut().zip(by).for_each(|(through, by)| *through += by);
                    if round == 0 {
                        // What effects are shown is the muscles' moment alone.
                        let rest = || core.prepared.rest_response(&self.model);
                        core.rest_by_angle.get_or_init(rest).add_moment(&turned, &mut through);
                    }
                    Cow::Owned(through)
                }
            });
        }
        found.unwrap_or_default()
    }

    /// Derivatives of the recorded moment by the fitted muscle parameters: those of the core as the sensor shows them.
    pub fn sensed_derivatives(&self, trial: usize, core: &Core, effects: &[Setting]) -> Vec<Vec<f64>> {
        match self.reshapes_moment(effects) {
            true => {
                let columns = (0..core.by_parameters.len()).map(Change::Parameter);
                self.recorded_changes(trial, core, effects, columns)
            }
            false => core.by_parameters.clone(),
        }
    }

    /// Whether the joint's moment follows excitations otherwise than through the active muscles.
    pub fn follows_excitation(&self, effects: &[Setting]) -> bool {
        let follows = |s: &Setting| !s.is_absent() && s.effect.excitation_memory(self.silent()).is_some();
        self.acting(effects).iter().any(follows)
    }

    /// Change of the recorded moment when excitations change, but for what the active muscles make of it:
    /// first sample and values [N·m per unit of what changes]; `None` where there is none. The noise of the
    /// angle hardly matters to it and is left out.
    pub fn recorded_beside_muscles(
        &self,
        trial: usize,
        core: &Core,
        effects: &[Setting],
        changes: &[ExcitationChange],
    ) -> Option<(usize, Vec<f64>)> {
        if !self.follows_excitation(effects) {
            return None;
        }
        let changes = || changes.iter().filter(|c| !c.values.is_empty());
        let (first, end) = (changes().map(|c| c.first).min()?, changes().map(|c| c.first + c.values.len()).max()?);
        let acting = self.acting(effects);
        let ordered = in_order(&acting);
        let mut following: Vec<(&Setting, f64)> = Vec::new();
        for setting in ordered.iter().copied().filter(|s| !s.is_absent()) {
            following.extend(setting.effect.excitation_memory(self.silent()).map(|memory| (setting, memory)));
        }
        let memory = following.iter().map(|(_, memory)| *memory).fold(0.0, f64::max);
        let context = self.context(trial, &core.excitation, core.shown());
        let until = context.time[end - 1] + memory;
        // A change rises from nothing, unless it is there from the start.
        let samples = first.saturating_sub(1)..context.time.partition_point(|t| *t <= until).max(end);
        let mut excitation = vec![vec![0.0; samples.len()]; self.muscles.len()];
        for change in changes() {
            let to = &mut excitation[change.muscle][change.first - samples.start..];
            to[..change.values.len()].copy_from_slice(&change.values);
        }
        let context = TrialContext {
            time: &context.time[samples.clone()],
            recorded_angle: &context.recorded_angle[samples.clone()],
            muscle_moment: &context.muscle_moment[samples.clone()],
            excitation: &excitation,
            ..context
        };
        let kinematics = core.prepared.kinematics();
        let joint = JointState {
            trial: &context,
            angle: &kinematics.angle[samples.clone()],
            speed: &kinematics.speed[samples.clone()],
            acceleration: &kinematics.acceleration[samples.clone()],
            muscles: &[],
        };
        let mut moment = vec![0.0; samples.len()];
        following.iter().for_each(|(s, _)| s.effect.add_moment(&s.values, &joint, &mut moment));
        let sensing: Vec<&Setting> = ordered.into_iter().filter(|s| senses(s)).collect();
        if sensing.is_empty() {
            return Some((samples.start, moment));
        }
        let mut whole = vec![0.0; core.moment.len()];
        whole[samples].copy_from_slice(&moment);
        Some((0, self.sensed_changes(trial, core, &sensing, [Change::Moment(&whole)]).swap_remove(0)))
    }
}

/// Whether an effect is one on the sensor, and there.
pub(super) fn senses(setting: &Setting) -> bool {
    setting.effect.description().stage == Stage::Sensor && !setting.is_absent()
}
