//! Why a statistic cannot be computed.

/// Why a statistic cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StatisticsError {
    /// Too few participants, pairs or values.
    #[error("{what}: expected at least {expected}, found {found}")]
    TooFew {
        /// What there is too little of.
        what: &'static str,
        /// Number needed.
        expected: usize,
        /// Number given.
        found: usize,
    },
    /// Two lists that belong together differ in length.
    #[error("{what}: expected {expected}, found {found}")]
    Length {
        /// What was counted.
        what: &'static str,
        /// Number expected.
        expected: usize,
        /// Number given.
        found: usize,
    },
    /// A value that is not a finite number: missing measurements cannot be passed over silently.
    #[error("{what} {row}, value {column}: expected a finite number, found {value}")]
    NotFinite {
        /// What a row is.
        what: &'static str,
        /// Row, from 0.
        row: usize,
        /// Column, from 0.
        column: usize,
        /// The value.
        value: f64,
    },
    /// No variation where the statistic divides by it.
    #[error("{what} do not vary: the statistic is undefined")]
    NoVariation {
        /// What is constant.
        what: &'static str,
    },
    /// A parameter outside its domain.
    #[error("{what}: expected {expected}, found {found}")]
    OutOfDomain {
        /// The parameter.
        what: &'static str,
        /// Its domain.
        expected: &'static str,
        /// The value given.
        found: f64,
    },
    /// No sample size up to the limit reaches the power asked for.
    #[error("no sample size up to {limit} reaches a power of {power}")]
    SampleSize {
        /// Largest sample size tried.
        limit: usize,
        /// Power asked for.
        power: f64,
    },
}

/// Refuses lists of different lengths, of fewer than `least` values, or with values that are not finite.
pub(super) fn pairs(x: &[f64], y: &[f64], least: usize) -> Result<(), StatisticsError> {
    if x.len() != y.len() {
        return Err(StatisticsError::Length { what: "values of the second list", expected: x.len(), found: y.len() });
    }
    if x.len() < least {
        return Err(StatisticsError::TooFew { what: "pairs", expected: least, found: x.len() });
    }
    for (column, values) in [x, y].into_iter().enumerate() {
        if let Some(row) = values.iter().position(|v| !v.is_finite()) {
            return Err(StatisticsError::NotFinite { what: "pair", row, column, value: values[row] });
        }
    }
    Ok(())
}
