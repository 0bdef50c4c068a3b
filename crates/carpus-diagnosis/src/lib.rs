//! Which physical effect a model lacks: the statistics that say which effects a participant's trials call for.

pub mod addition;
pub mod baselines;
pub mod cohort;
pub mod diagnose;
pub mod experiments;
pub mod fit;
pub mod inference;
pub mod kernel;
pub mod noise;
pub mod plan;
pub mod proposals;
pub mod score_test;
pub mod separability;
pub mod separation;
#[cfg(test)]
#[path = "../../carpus-effects/src/two_silent_muscles.rs"]
mod two_silent_muscles;
pub mod what_remains;
pub mod where_it_fails;

#[cfg(test)]
use carpus_effects::forward_model;

/// Trials that cores share out among them at a time: they take unequal times, and whoever is through with several would
/// wait.
const ONE_BY_ONE: usize = 1;
