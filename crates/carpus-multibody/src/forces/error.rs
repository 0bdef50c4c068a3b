//! Why a force cannot be built.

use carpus_osim::functions::{ExpressionError, FunctionError};
use carpus_osim::osim::spec::Location;

/// Why a force cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ForceError {
    /// A function of the force cannot be built.
    #[error("{}: {property}: {source}", .at.path)]
    Function {
        /// The force.
        at: Location,
        /// Property name.
        property: &'static str,
        /// What is wrong with the function.
        source: FunctionError,
    },
    /// A formula cannot be read.
    #[error("{}: expression: {source}", .at.path)]
    Expression {
        /// The force.
        at: Location,
        /// What is wrong with the formula.
        source: ExpressionError,
    },
    /// A property is NaN or infinite.
    #[error("{}: expected finite {property}, found {found}", .at.path)]
    NotFinite {
        /// The force.
        at: Location,
        /// Property name.
        property: &'static str,
        /// The value found.
        found: f64,
    },
    /// A property must be positive.
    #[error("{}: expected positive {property}, found {found}", .at.path)]
    NotPositive {
        /// The force.
        at: Location,
        /// Property name.
        property: &'static str,
        /// The value found.
        found: f64,
    },
    /// The force refers to a coordinate or frame that does not exist.
    #[error("{}: refers to {what} {index}, but there are only {count}", .at.path)]
    BadReference {
        /// The force.
        at: Location,
        /// "coordinate" or "frame".
        what: &'static str,
        /// The index referred to.
        index: usize,
        /// How many there are.
        count: usize,
    },
}

impl ForceError {
    /// The force that it is about.
    pub fn at(&self) -> &Location {
        match self {
            ForceError::Function { at, .. }
            | ForceError::Expression { at, .. }
            | ForceError::NotFinite { at, .. }
            | ForceError::NotPositive { at, .. }
            | ForceError::BadReference { at, .. } => at,
        }
    }
}

pub(super) fn check_finite(at: &Location, property: &'static str, found: f64) -> Result<f64, ForceError> {
    if found.is_finite() { Ok(found) } else { Err(ForceError::NotFinite { at: at.clone(), property, found }) }
}

pub(super) fn check_index(at: &Location, what: &'static str, index: usize, count: usize) -> Result<(), ForceError> {
    if index < count { Ok(()) } else { Err(ForceError::BadReference { at: at.clone(), what, index, count }) }
}
