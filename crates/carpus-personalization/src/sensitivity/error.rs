//! Why a sensitivity analysis cannot be made.

/// Why a sensitivity analysis cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SensitivityError {
    /// Too few parameters, starts, levels or points.
    #[error("{what}: expected at least {expected}, found {found}")]
    TooFew {
        /// What there is too little of.
        what: &'static str,
        /// Number needed.
        expected: usize,
        /// Number given.
        found: usize,
    },
    /// Bounds that span nothing.
    #[error("bounds of {parameter}: expected finite lower < upper, found {lower} and {upper}")]
    Bounds {
        /// The parameter.
        parameter: String,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// Lists that belong together differ in length.
    #[error("{what}: expected {expected}, found {found}")]
    Length {
        /// What was counted.
        what: &'static str,
        /// Number expected.
        expected: usize,
        /// Number given.
        found: usize,
    },
    /// A pair of points that should differ in one parameter does not.
    #[error("trajectory {start}, step {step}: expected a change of exactly one parameter, found {changed}")]
    NotOneAtATime {
        /// The trajectory, from 0.
        start: usize,
        /// The step in it, from 0.
        step: usize,
        /// How many parameters change.
        changed: usize,
    },
    /// Too many runs failed for any index.
    #[error("{failed} of {runs} runs failed; nothing is left to compare. First failure: {first}")]
    NothingLeft {
        /// Failed runs.
        failed: usize,
        /// All runs.
        runs: usize,
        /// Why the first one failed.
        first: String,
    },
    /// The response is the same everywhere.
    #[error("the response is {value} in every run: it has no variance to share out")]
    NoVariation {
        /// The response.
        value: f64,
    },
}
