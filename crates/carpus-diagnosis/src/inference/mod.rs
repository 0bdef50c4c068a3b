//! One statistical model of a session: muscles, missing effects, discrepancy and noise, estimated together.
//!
//! The theory is `docs/src/theory/many-small-errors.md`; numbers of equations are those of that page. Equation (1):
//!
//! ```text
//! y = τ(θ, φ, u) + Σ_m τ_m h_m + g + ε,   u_m = e_m exp(w_m) + b_m                            (1)
//! ```
//! θ: muscle parameters, priors from the study's bounds (2). φ: effects of the catalogue, each
//! either *missing* from the model, of a plausible size, or of what a laboratory has of everything (3). w, b:
//! error of the logarithm of the EMG, and its baseline. h, g: the discrepancy, what a model of this kind
//! never gets right: a relative error of each muscle's moment τ_m (6), and a moment of its own (7). ε: white
//! and slow noise of the recorded moment.
//!
//! - [`linear_model`]: the session around one point, as a linear Gaussian model
//! - [`discrepancy`]: columns of h and g
//! - [`search`]: which sets of effects are missing
//! - [`session`]: the joint mode: relinearized, noise and EMG estimated along the way
//! - [`muscles`]: muscles alone: values and intervals that every command reports
//! - [`resting_fiber`]: fascicle lengths of images, as data

pub mod discrepancy;
pub mod linear_model;
mod muscle_columns;
mod muscle_prior;
pub mod muscles;
pub mod resting_fiber;
pub mod search;
pub mod session;
