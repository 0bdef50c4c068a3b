//! Trials of a participant, prepared.

use super::diagnostic::{Diagnostic, Failure};
use super::loading::LoadedParticipant;
use carpus_diagnosis::forward_model::ForwardModel;

/// The trials of a participant, ready to be simulated with effects.
///
/// # Errors
/// A trial that cannot be simulated.
pub(super) fn forward_model_of(run: &LoadedParticipant) -> Result<ForwardModel, Failure> {
    let forward = ForwardModel::for_diagnosis(&run.loaded.file.spec, &run.model, &run.trials)
        .map_err(|e| Diagnostic::error(e.to_string()).in_file(&run.loaded.path))?;
    Ok(forward.with_given(run.given.clone()))
}
