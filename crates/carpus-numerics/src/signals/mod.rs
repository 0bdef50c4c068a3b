//! Signals before they become a study's quantities: zero-phase filters, envelopes, normalization of EMG, and what can
//! be wrong with a recorded channel.
//!
//! In: samples at a stated rate \[Hz\]. Out: samples at the same instants, or the findings of a check. No files are
//! read here and nothing is printed; which column is which muscle is the business of `study`.
//!
//! Reading order: [`Butterworth`] (design), [`SecondOrderSections`] (application), [`savitzky_golay`], [`moving_rms`],
//! then [`EmgProcessing`], which chains them, and [`check_channel`].

mod butterworth;
mod emg;
mod error;
mod quality;
mod resampling;
mod sampling;
mod sections;
mod smoothing;

pub use butterworth::{Band, Butterworth};
pub use emg::{EmgProcessing, EnvelopeKind, MvcLevel, SavitzkyGolay, mvc_level};
pub use error::SignalError;
pub use quality::{Finding, MAINS_FREQUENCIES_HZ, QualityLimits, check_artefact, check_channel, check_excitation};
pub use resampling::{interpolate_linear, resample, sample_rate};
pub use sampling::{OwnSamples, Resampled, independent_samples, own_samples};
pub use sections::{SecondOrderSections, Section};
pub use smoothing::{moving_mean, moving_rms, odd_window, rectify, savitzky_golay};
