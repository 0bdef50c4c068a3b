//! What of the difference between measured and simulated moment is noise: of the moment, and of the EMG as it passes
//! through the muscles (errors in variables).
//!
//! ```text
//! V = σ_w² I + σ_s² C_s + σ_e² G K Gᵀ + σ_g² G 1 1ᵀ Gᵀ + σ_f² G D K D Gᵀ + C_q
//! ```
//! G: moment by the log excitation on knots; K, C_s: correlation over knots and over samples (EMG envelope and slow
//! disturbances of the moment), of the family and length that the data prefer; σ_s differs between trials of flexion,
//! of extension and of neither, because a harder push moves the limb more in its fixation; the fourth term is a gain
//! per trial and muscle; D = 1/e turns the fifth into noise that adds to the EMG; C_q, of known size, is the noise of
//! the angle as forces on the joint show it.

mod levels;
mod response;
mod restricted_likelihood;
mod trial_noise;

pub use levels::{COMPONENTS, Kernels, NoiseLevels};
pub use response::Response;
pub use restricted_likelihood::{
    LEAST_WHITE, best_kernel, estimate, estimate_within, prior_deviance, restricted_deviance, spread,
};
pub(crate) use trial_noise::scatter_of_all;
pub use trial_noise::{KNOT_SPACING, TrialNoise, TrialTimes, factor};
