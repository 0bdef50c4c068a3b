//! From the raw electromyogram to muscle excitation.

use super::butterworth::{Band, Butterworth};
use super::error::SignalError;
use super::smoothing::{moving_mean, moving_rms, odd_window, rectify, savitzky_golay};

/// How the oscillation becomes an envelope.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum EnvelopeKind {
    /// Root mean square over the window.
    #[default]
    MovingRms,
    /// Mean of the rectified signal over the window.
    MovingMeanOfRectified,
}

/// Savitzky–Golay smoothing of the envelope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SavitzkyGolay {
    /// Order of the polynomial.
    pub order: usize,
    /// Window \[s\]; taken as the nearest odd number of samples.
    pub window_s: f64,
}

/// Every constant of the way from raw EMG to envelope. The default is the protocol of Jadelis (2025), chapter 2, which
/// leaves open the order of the band-pass (here 4) and the window of the smoothing (here 0.1 s).
///
/// ```text
/// raw ─ band-pass, zero phase ─ moving RMS ─ Savitzky–Golay ─ max(·, 0) ─ ÷ MVC level
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct EmgProcessing {
    /// Edges of the band-pass \[Hz\]; `None` leaves the signal as it is. The upper edge has to lie below half the
    /// sample rate.
    pub band_pass_hz: Option<[f64; 2]>,
    /// Order of the Butterworth prototype of the band-pass. It runs forward and backward, so the gain at either edge
    /// is 1/2.
    pub filter_order: usize,
    /// How the oscillation becomes an envelope.
    pub envelope: EnvelopeKind,
    /// Window of the envelope \[s\], centred; taken as the nearest odd number of samples.
    pub rms_window_s: f64,
    /// Smoothing of the envelope.
    pub savitzky_golay: Option<SavitzkyGolay>,
    /// What of the MVC trials counts as the maximum.
    pub mvc_level: MvcLevel,
    /// Rate at which normalized EMG is written \[Hz\]; `None`: as recorded. [`Self::envelope`] does not resample.
    pub resample_hz: Option<f64>,
}

impl Default for EmgProcessing {
    fn default() -> Self {
        Self {
            band_pass_hz: Some([30.0, 250.0]),
            filter_order: 4,
            envelope: EnvelopeKind::MovingRms,
            rms_window_s: 0.1,
            savitzky_golay: Some(SavitzkyGolay { order: 3, window_s: 0.1 }),
            mvc_level: MvcLevel::Peak,
            resample_hz: None,
        }
    }
}

impl EmgProcessing {
    /// The envelope of one channel, in the channel's unit, at its own instants; never negative.
    ///
    /// # Errors
    /// Those of its steps: a rate too low for the band, a recording shorter than a window, samples that are no numbers.
    pub fn envelope(&self, raw: &[f64], sample_rate_hz: f64) -> Result<Vec<f64>, SignalError> {
        let filtered = match self.band_pass_hz {
            Some([low_hz, high_hz]) => {
                let filter = Butterworth { order: self.filter_order, band: Band::BandPass { low_hz, high_hz } };
                &filter.design(sample_rate_hz)?.filter_zero_phase(raw)?
            }
            None => raw,
        };
        let window = odd_window(self.rms_window_s, sample_rate_hz)?;
        if raw.len() < window {
            return Err(SignalError::TooShort { found: raw.len(), expected: window });
        }
        let mut envelope = match self.envelope {
            EnvelopeKind::MovingRms => moving_rms(filtered, window)?,
            EnvelopeKind::MovingMeanOfRectified => moving_mean(&rectify(filtered), window)?,
        };
        if let Some(smoothing) = self.savitzky_golay {
            let window = odd_window(smoothing.window_s, sample_rate_hz)?;
            envelope = savitzky_golay(&envelope, smoothing.order, window)?;
        }
        // A cubic through the foot of a burst undershoots zero, which no excitation does.
        envelope.iter_mut().for_each(|e| *e = e.max(0.0));
        Ok(envelope)
    }
}

/// What of the MVC trials counts as a channel's maximum.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum MvcLevel {
    /// The largest sample of the envelope.
    #[default]
    Peak,
    /// The largest mean of the envelope over a window, which one spike does not raise.
    LargestMean {
        /// The window \[s\].
        window_s: f64,
    },
}

/// A channel's level at maximum voluntary contraction: the largest found over all MVC trials, each with its sample
/// rate \[Hz\].
///
/// # Errors
/// - [`SignalError::NoMvc`]: no envelope, or none above zero
/// - [`SignalError::WindowDuration`], [`SignalError::TooShort`]: a mean's window that is none, or longer than a trial
pub fn mvc_level(envelopes: &[(&[f64], f64)], level: MvcLevel) -> Result<f64, SignalError> {
    let mut largest = 0.0f64;
    for (envelope, sample_rate_hz) in envelopes {
        let of_trial = match level {
            MvcLevel::Peak => envelope.iter().copied().fold(0.0, f64::max),
            MvcLevel::LargestMean { window_s } => {
                let window = odd_window(window_s, *sample_rate_hz)?;
                if envelope.len() < window {
                    return Err(SignalError::TooShort { found: envelope.len(), expected: window });
                }
                envelope.windows(window).map(|w| w.iter().sum::<f64>() / window as f64).fold(0.0, f64::max)
            }
        };
        largest = largest.max(of_trial);
    }
    if largest > 0.0 { Ok(largest) } else { Err(SignalError::NoMvc { found: largest }) }
}
