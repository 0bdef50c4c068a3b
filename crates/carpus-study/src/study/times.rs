//! Times of samples: their usual step, and whether it can be one.

use super::fault::Fault;
use super::limits::{LONGEST_STEP, LONGEST_TRIAL, SHORTEST_STEP};

/// What is wrong with times of which the unit cannot be seconds. The work that a trial makes grows with its duration;
/// after this check it grows with the number of its samples.
///
/// - `median_step_s`: median step \[s\]
pub(crate) fn implausible_time(time: &[f64], median_step_s: f64) -> Option<Fault> {
    let (first, last) = (*time.first()?, *time.last()?);
    let duration_s = last - first;
    let mean_step_s = duration_s / (time.len().max(2) - 1) as f64;
    let plausible = (SHORTEST_STEP..=LONGEST_STEP).contains(&median_step_s)
        && mean_step_s <= LONGEST_STEP
        && duration_s <= LONGEST_TRIAL;
    (!plausible).then_some(Fault::ImplausibleTime { median_step_s, duration_s })
}

/// Median; the upper one of two middle values.
pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}
