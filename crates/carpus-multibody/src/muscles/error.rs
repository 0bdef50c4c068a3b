//! Why a muscle cannot be built.

use super::curves::CurveError;
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::FunctionSpec;
use thiserror::Error;

/// Why a muscle cannot be built.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MuscleError {
    /// The force of the muscle's class is not computed.
    #[error("{muscle}: the force of a {class} is not computed")]
    NotComputed {
        /// Muscle name.
        muscle: String,
        /// OpenSim class name.
        class: String,
    },
    /// A property's value is not allowed.
    #[error("{property} is {found}, expected {expected}")]
    InvalidProperty {
        /// OpenSim property name.
        property: &'static str,
        /// What is allowed.
        expected: String,
        /// The value.
        found: f64,
    },
    /// A function of the muscle cannot be built.
    #[error("{property}: {source}")]
    Function {
        /// OpenSim property name.
        property: &'static str,
        /// What is wrong with it.
        source: carpus_osim::functions::FunctionError,
    },
    /// A curve cannot be built.
    #[error(transparent)]
    Curve(#[from] CurveError),
    /// One of the above, in the named muscle.
    #[error("{muscle}: {source}")]
    InMuscle {
        /// Muscle name.
        muscle: String,
        /// What is wrong.
        source: Box<MuscleError>,
    },
}

impl MuscleError {
    /// Fails with [`MuscleError::InvalidProperty`] unless `holds`.
    pub(super) fn require(holds: bool, property: &'static str, expected: &str, found: f64) -> Result<(), MuscleError> {
        if holds {
            Ok(())
        } else {
            Err(MuscleError::InvalidProperty { property, expected: expected.to_owned(), found })
        }
    }

    /// The function of a property.
    pub(super) fn function(property: &'static str, spec: &FunctionSpec) -> Result<Function, MuscleError> {
        Function::compile(spec).map_err(|source| MuscleError::Function { property, source })
    }
}
