//! Why effects cannot be written into a model.

use thiserror::Error;

use carpus_osim::osim::EditError;

/// Why effects cannot be written.
#[derive(Debug, Error)]
pub enum ExportError {
    /// A value is missing, too many, NaN or infinite.
    #[error("{effect}: expected {expected} finite values, found {found:?}")]
    BadValues {
        /// The effect.
        effect: &'static str,
        /// How many parameters it has.
        expected: usize,
        /// The values.
        found: Vec<f64>,
    },
    /// The model has no such coordinate.
    #[error("the model has no coordinate \"{name}\"")]
    UnknownCoordinate {
        /// The name.
        name: String,
    },
    /// A muscle of the file could not be changed.
    #[error(transparent)]
    Muscle(EditError),
    /// The file could not be changed.
    #[error("{effect}: {source}")]
    Edit {
        /// The effect.
        effect: &'static str,
        /// Why.
        source: EditError,
    },
}
