//! Effects as they act, one after the other.

use super::super::effect::{ExcitationScope, JointState, MuscleState, Stage, TrialContext};
use super::super::setting::Setting;
use carpus_simulation::simulation::PreparedTrial;

/// Effects in the order in which they act. Where that does not matter it is that of their identifiers, so
/// that sums are the same to the last bit.
pub(super) fn in_order(effects: &[Setting]) -> Vec<&Setting> {
    let mut ordered: Vec<&Setting> = effects.iter().collect();
    ordered.sort_by_key(|s| {
        let d = s.effect.description();
        (d.stage, d.order, d.id)
    });
    ordered
}

pub(super) fn add_moments(ordered: &[&Setting], joint: &JointState, moment: &mut [f64]) {
    for setting in ordered {
        setting.effect.add_moment(&setting.values, joint, moment);
    }
}

/// What effects change in the moment of a muscle, per sample: maximum isometric force · factor · moment arm ·
/// (tendon force + force).
pub(super) struct MuscleChange {
    pub(super) factor: Vec<f64>,
    /// Share of the maximum isometric force.
    pub(super) force: Vec<f64>,
}

pub(super) fn muscle_change(
    ordered: &[&Setting],
    trial: &TrialContext,
    prepared: &PreparedTrial,
    muscle: usize,
    angle: &[f64],
) -> MuscleChange {
    let path = &prepared.kinematics().muscles[muscle];
    let arm = &path.moment_arm;
    change_at(ordered, &MuscleState { trial, muscle, angle, moment_arm: arm, activation: &path.activation })
}

pub(super) fn change_at(ordered: &[&Setting], state: &MuscleState) -> MuscleChange {
    let n = state.angle.len();
    let mut change = MuscleChange { factor: vec![1.0; n], force: vec![0.0; n] };
    for setting in ordered {
        setting.effect.scale_muscle(&setting.values, state, &mut change.factor);
        setting.effect.add_muscle_force(&setting.values, state, &mut change.force);
    }
    change
}

/// The effects with which the trial is simulated whose moment these effects are shown, and the rounds of
/// feedback left: those that do not ask for it, and for as many rounds as there are those that feed back on
/// themselves.
pub(super) fn shown_effects(effects: &[Setting], rounds: usize) -> (Vec<Setting>, usize) {
    let stays =
        |s: &&Setting| !s.effect.description().needs_moment() || (rounds > 0 && s.effect.description().feeds_back());
    (effects.iter().filter(stays).cloned().collect(), rounds.saturating_sub(1))
}

pub(super) fn changes_excitation(setting: &Setting) -> bool {
    setting.effect.description().stage == Stage::Excitation && !setting.is_absent()
}

/// What an effect on excitations reads.
pub(super) fn scope(setting: &Setting) -> ExcitationScope {
    setting.effect.description().behaviour.excitation
}
