//! One statistical model of a session: muscles, missing effects, discrepancy and noise, estimated together.
//!
//! ```text
//! y_k = τ_k(θ, φ, e exp(w)) + Σ_m τ_m,k h_m(z_k) + g(z_k) + ε_k
//! ```
//! θ: muscle parameters, priors from the study's bounds. φ: effects of the catalogue, each either *missing* from the model, of a plausible
//! size, or of what a laboratory has of everything. w: error of the logarithm of the EMG. h, g: the discrepancy, what a model of this kind never
//! gets right: a relative error of each muscle's moment τ_m, and a moment of its own. ε: white and slow noise of the recorded moment.
//!
//! - [`excitation`]: the true excitation, given the recorded EMG
//! - [`linear_model`]: the session around one point, as a linear Gaussian model
//! - [`discrepancy`]: columns of h and g
//! - [`search`]: which sets of effects are missing
//! - [`session`]: the joint mode: relinearized, noise and EMG estimated along the way

pub mod discrepancy;
pub mod excitation;
pub mod linear_model;
pub mod search;
pub mod session;
