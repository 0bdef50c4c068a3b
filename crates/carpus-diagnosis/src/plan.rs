//! Which further trials would tell effects apart: what `carpus plan` asks.

use super::diagnose::Request;
use super::separation::{Laboratory, Separation, separations};
use carpus_simulation::simulation::SimulationError;

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
    let mut session = request.session();
    let alone = session.estimate(&[], true, &request.report())?;
    let null = session.as_fit(&alone);
    let analysis = &session.analysis;
    separations(analysis, &null, laboratory, &request.bounds, rivals, &|done, all| progress(1 + done, 1 + all))
}
