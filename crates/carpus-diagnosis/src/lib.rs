//! Which physical effect a model lacks: catalogue of effects, simulation with any of them, and the statistics that say
//! which of them a participant's trials call for.

pub mod addition;
pub mod angle_noise;
pub mod baselines;
pub mod catalogue;
pub mod cohort;
pub mod conformance;
mod covered;
pub mod denoising;
pub mod diagnose;
pub mod effect;
pub mod effects;
pub mod experiments;
pub mod export;
pub mod fit;
pub mod forward_model;
pub mod holds;
pub mod inference;
pub mod joint_traits;
pub mod kernel;
pub mod moments;
pub mod noise;
pub mod own_effect;
pub mod plan;
pub mod proposals;
pub mod score_test;
pub mod separability;
pub mod separation;
mod series;
pub mod setting;
pub mod silent_muscles;
pub mod synthesis;
pub mod trial_record;
#[cfg(test)]
mod two_silent_muscles;
pub mod what_remains;
pub mod where_it_fails;

/// Trials that cores share out among them at a time: they take unequal times, and whoever is through with several would
/// wait.
const ONE_BY_ONE: usize = 1;
