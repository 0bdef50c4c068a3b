//! Why a signal could not be processed.

/// Why a signal could not be processed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SignalError {
    /// The sample rate is not a positive number.
    #[error("sample rate: expected a positive number of Hz, found {found_hz}")]
    SampleRate {
        /// The rate given \[Hz\].
        found_hz: f64,
    },
    /// A cutoff outside (0, half the sample rate), or a band whose edges are in the wrong order.
    #[error(
        "cutoff {found_hz} Hz: expected more than {above_hz} Hz and less than half the sample rate ({nyquist_hz} Hz)"
    )]
    Cutoff {
        /// The cutoff given \[Hz\].
        found_hz: f64,
        /// It has to exceed this \[Hz\].
        above_hz: f64,
        /// Half the sample rate \[Hz\].
        nyquist_hz: f64,
    },
    /// A filter order of 0 or one so high that double precision cannot carry it.
    #[error("filter order: expected 1 to {most}, found {found}")]
    Order {
        /// The order given.
        found: usize,
        /// The highest order accepted.
        most: usize,
    },
    /// A window that holds no sample, is even where a centre is needed, or is not longer than the polynomial's order.
    #[error("window of {found} samples: expected {expected}")]
    Window {
        /// Samples in the window.
        found: usize,
        /// What was expected.
        expected: String,
    },
    /// A window that is not a positive number of seconds, or longer than any trial.
    #[error("window: expected a positive number of seconds, at most {most_s}, found {found_s}")]
    WindowDuration {
        /// The longest accepted \[s\].
        most_s: f64,
        /// The duration given \[s\].
        found_s: f64,
    },
    /// A rate that makes many times as many samples as there are.
    #[error("new sample rate {to_hz} Hz: expected at most {most} times the recorded one, {from_hz} Hz")]
    NewRate {
        /// The recorded rate \[Hz\].
        from_hz: f64,
        /// The rate given \[Hz\].
        to_hz: f64,
        /// Largest ratio accepted.
        most: f64,
    },
    /// Fewer samples than the operation needs.
    #[error("only {found} samples; expected at least {expected}")]
    TooShort {
        /// Samples given.
        found: usize,
        /// Samples needed.
        expected: usize,
    },
    /// A sample that is not a finite number.
    #[error("sample {index} is {value}; expected a finite number")]
    NotFinite {
        /// Position of the first such sample.
        index: usize,
        /// The sample.
        value: f64,
    },
    /// Times that do not increase, or of another number than the values.
    #[error("times: expected {expected}")]
    Times {
        /// What was expected.
        expected: &'static str,
    },
    /// No channel reaches above zero in the trials that should hold the maximum voluntary contraction.
    #[error("no activity in the maximum voluntary contractions: the largest envelope is {found}")]
    NoMvc {
        /// The largest envelope found, in the channel's unit.
        found: f64,
    },
}

/// Refuses a signal that contains NaN or infinities.
pub(super) fn finite(x: &[f64]) -> Result<(), SignalError> {
    match x.iter().position(|v| !v.is_finite()) {
        Some(index) => Err(SignalError::NotFinite { index, value: x[index] }),
        None => Ok(()),
    }
}

/// Refuses a sample rate that is not positive and finite.
pub(super) fn positive_rate(sample_rate_hz: f64) -> Result<(), SignalError> {
    let positive = sample_rate_hz.is_finite() && sample_rate_hz > 0.0;
    if positive { Ok(()) } else { Err(SignalError::SampleRate { found_hz: sample_rate_hz }) }
}
