//! Physical effects that a model may lack: the catalogue of effects, and simulation of a model with any of them.
//!
//! In: trials and a model. An [`effect::Effect`] changes one stage of the way from excitation to recorded moment;
//! [`forward_model::ForwardModel`] simulates trials with a set of effects in their order, with derivatives by muscle
//! parameters and by the effects' parameters. [`export`] writes a model that has them.

pub mod angle_noise;
pub mod answers;
pub mod catalogue;
pub mod conformance;
pub mod covered;
pub mod denoising;
pub mod effect;
pub mod effects;
pub mod export;
pub mod forward_model;
pub mod holds;
pub mod joint_traits;
pub mod moments;
pub mod own_effect;
pub mod random;
pub mod series;
pub mod setting;
pub mod silent_muscles;
pub mod synthesis;
pub mod trial_record;
#[cfg(test)]
mod two_silent_muscles;
