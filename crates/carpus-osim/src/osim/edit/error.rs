//! Why an edit is refused.

use thiserror::Error;

use crate::osim::error::{DocumentError, OsimError};

/// Why an edit was refused; the file is then as it was.
#[derive(Debug, Error)]
pub enum EditError {
    /// No muscle of that name.
    #[error("{file}: no muscle named \"{name}\"")]
    UnknownMuscle {
        /// File name.
        file: String,
        /// The name.
        name: String,
        /// The most similar name.
        nearest: Option<String>,
    },
    /// Several muscles of that name in the file.
    #[error("{file}: {count} muscles are named \"{name}\" (lines {lines:?})", count = .lines.len())]
    AmbiguousMuscle {
        /// File name.
        file: String,
        /// The name.
        name: String,
        /// Where they stand.
        lines: Vec<usize>,
    },
    /// No component at that path.
    #[error("{file}: no component at {path}")]
    UnknownComponent {
        /// File name.
        file: String,
        /// The path.
        path: String,
        /// The most similar path.
        nearest: Option<String>,
    },
    /// The component has no such property.
    #[error("{file}:{line}: {path} has no property \"{property}\"")]
    UnknownProperty {
        /// File name.
        file: String,
        /// Line of the component.
        line: usize,
        /// Path of the component.
        path: String,
        /// The property.
        property: String,
        /// The most similar property.
        nearest: Option<String>,
    },
    /// The property holds objects, not text.
    #[error("{file}:{line}: {property} of {path} holds components, not a value")]
    NotAValue {
        /// File name.
        file: String,
        /// Line of the property.
        line: usize,
        /// Path of the component.
        path: String,
        /// The property.
        property: String,
    },
    /// A muscle parameter has to be a number.
    #[error("{property} of {muscle}: expected a number, found {value}")]
    NotANumber {
        /// Muscle name.
        muscle: String,
        /// Property name.
        property: String,
        /// The value.
        value: f64,
    },
    /// The component to be added is not one well-formed element.
    #[error("component to be added: {0}")]
    Fragment(DocumentError),
    /// The edited file could not be read.
    #[error("the edit would make the model invalid: {0}")]
    Invalid(OsimError),
}

impl EditError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            EditError::UnknownMuscle { nearest, .. }
            | EditError::UnknownComponent { nearest, .. }
            | EditError::UnknownProperty { nearest, .. } => {
                nearest.as_ref().map(|nearest| format!("did you mean \"{nearest}\"?"))
            }
            EditError::AmbiguousMuscle { .. } => Some("give every muscle a name of its own".to_owned()),
            EditError::Invalid(error) => error.hint(),
            _ => None,
        }
    }
}
