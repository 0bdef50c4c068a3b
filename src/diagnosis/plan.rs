//! Which further trials would tell effects apart: what `carpus plan` asks.

use super::addition::unidentifiable;
use super::diagnose::{Request, tested_null};
use super::fit::Analysis;
use super::separation::{Laboratory, Separation, separations};
use crate::simulation::SimulationError;
use crate::study::TrialUse;

/// Everything that experiments do for every pair of these effects; the most useful first.
///
/// - `progress`: told how many steps are done, of how many
///
/// # Errors
/// A trial that cannot be simulated.
pub fn plan(
    request: &Request,
    laboratory: Laboratory,
    rivals: &[&'static str],
    progress: &dyn Fn(usize, usize),
) -> Result<Vec<Separation>, SimulationError> {
    let train = request.forward.trials_for(TrialUse::Train);
    let (analysis, null) =
        Analysis::new(request.forward, train, request.candidates.clone(), &request.bounds, request.seed)?;
    let null = tested_null(&analysis, null, &unidentifiable(&analysis))?.fit;
    separations(&analysis, &null, laboratory, &request.bounds, rivals, &|done, all| progress(1 + done, 1 + all))
}
