//! Trials, muscles and moments of a participant, prepared.

use super::diagnostic::{Diagnostic, Failure};
use super::loading::LoadedParticipant;
use carpus_diagnosis::separation::Laboratory;
use carpus_effects::forward_model::ForwardModel;
use carpus_osim::osim::spec::MuscleSpec;

/// The trials of a participant, ready to be simulated with effects.
///
/// # Errors
/// A trial that cannot be simulated.
pub(super) fn forward_model_of(run: &LoadedParticipant) -> Result<ForwardModel, Failure> {
    let forward = ForwardModel::for_diagnosis(&run.loaded.file.spec, &run.model, &run.trials)
        .map_err(|e| Diagnostic::error(e.to_string()).in_file(&run.loaded.path))?;
    Ok(forward.with_given(run.given.clone()))
}

/// What experiments are simulated with.
pub fn laboratory(run: &LoadedParticipant) -> Laboratory<'_> {
    Laboratory { spec: &run.loaded.file.spec, model: &run.model }
}

/// The session's MVC moment [N·m]: as the study states it, else the largest that was recorded.
pub(super) fn largest_moment(run: &LoadedParticipant) -> f64 {
    let p = &run.participant;
    let stated = [p.mvc_flexion, p.mvc_extension].into_iter().flatten().fold(0.0, f64::max);
    if stated > 0.0 { stated } else { run.trials.iter().map(|t| t.max_abs_moment()).fold(0.0, f64::max) }
}

pub(super) fn active_specs(run: &LoadedParticipant) -> Vec<MuscleSpec> {
    let spec = &run.loaded.file.spec;
    run.model.muscle_names().filter_map(|name| spec.muscles.iter().find(|m| m.name == name)).cloned().collect()
}
