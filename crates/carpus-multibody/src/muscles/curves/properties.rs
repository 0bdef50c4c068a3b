//! Properties of curves: their checks, and OpenSim's measure of curviness.

use carpus_numerics::numerics::CornerError;
use thiserror::Error;

/// Why a curve cannot be built from its properties.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CurveError {
    /// A property is outside the range in which the curve exists.
    #[error("{curve}: {property} is {found}, expected {expected}")]
    OutOfRange {
        /// OpenSim class name of the curve.
        curve: &'static str,
        /// OpenSim property name.
        property: &'static str,
        /// What is allowed.
        expected: String,
        /// The value.
        found: f64,
    },
    /// Some optional properties are set and others are empty.
    #[error("{curve}: {} must either all be set or all be empty", properties.join(", "))]
    PartlySet {
        /// OpenSim class name of the curve.
        curve: &'static str,
        /// OpenSim property names.
        properties: &'static [&'static str],
    },
    /// Each property is valid, but together they do not give a smooth corner.
    #[error("{curve}: its properties contradict each other: {source}")]
    Corner {
        /// OpenSim class name of the curve.
        curve: &'static str,
        /// The corner.
        source: CornerError,
    },
}

/// OpenSim's internal measure of curviness for the property's 0 to 1.
pub(super) fn scale_curviness(curviness: f64) -> f64 {
    0.1 + 0.8 * curviness
}

/// Fails unless `holds`; NaN never holds.
pub(super) fn require(
    holds: bool,
    curve: &'static str,
    property: &'static str,
    expected: impl Into<String>,
    found: f64,
) -> Result<(), CurveError> {
    if holds { Ok(()) } else { Err(CurveError::OutOfRange { curve, property, expected: expected.into(), found }) }
}
