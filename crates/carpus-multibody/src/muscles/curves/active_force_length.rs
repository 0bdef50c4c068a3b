//! `ActiveForceLengthCurve`.

use super::properties::{CurveError, require, scale_curviness};
use carpus_numerics::numerics::{QuinticCorner, SmoothSegmentedFunction};
use carpus_osim::osim::spec::ActiveForceLengthSpec;

const CURVE: &str = "ActiveForceLengthCurve";

/// Active force multiplier against normalized fibre length.
///
/// # Errors
/// [`CurveError::OutOfRange`], [`CurveError::Corner`].
///
/// # References
/// OpenSim `SmoothSegmentedFunctionFactory::createFiberActiveForceLengthCurve`; Millard et al. (2013), figure 3A,
/// doi:10.1115/1.4023390.
pub fn active_force_length(spec: &ActiveForceLengthSpec) -> Result<SmoothSegmentedFunction, CurveError> {
    check(spec)?;
    let [x0, x1, x2, x3] =
        [spec.min_norm_active_fiber_length, spec.transition_norm_fiber_length, 1.0, spec.max_norm_active_fiber_length];
    let (low, shallow) = (spec.minimum_value, spec.shallow_ascending_slope);
    let c = scale_curviness(1.0);

    // The plateau reaches 5 % of optimal length to either side.
    let x_delta = 0.05 * x2;
    let x_shoulder = x2 - x_delta;
    let y1 = 1.0 - shallow * (x_shoulder - x1);
    let steep = 1.25 * y1 / (x1 - x0);
    let (x01, y01) = (x0 + 0.5 * (x1 - x0), 0.5 * y1);
    let (x1s, y1s) = (x1 + 0.5 * (x_shoulder - x1), y1 + 0.5 * (1.0 - y1));
    let x23 = (x2 + x_delta) + 0.5 * (x3 - (x2 + x_delta));
    let descending = -1.0 / ((x3 - x_delta) - (x2 + x_delta));

    let knots = [
        [x0, low, 0.0],
        [x01, y01, steep],
        [x1s, y1s, shallow],
        [x2, 1.0, 0.0],
        [x23, 0.5, descending],
        [x3, low, 0.0],
    ];
    let corners: Result<Vec<_>, _> = knots.windows(2).map(|k| QuinticCorner::new(k[0], k[1], c)).collect();
    let corners = corners.map_err(|source| CurveError::Corner { curve: CURVE, source })?;
    Ok(SmoothSegmentedFunction::new(&corners, 0.0, 0.0))
}

fn check(spec: &ActiveForceLengthSpec) -> Result<(), CurveError> {
    let eps = f64::EPSILON.sqrt();
    let [x0, x1, x3] =
        [spec.min_norm_active_fiber_length, spec.transition_norm_fiber_length, spec.max_norm_active_fiber_length];
    require(x0 >= 0.0, CURVE, "min_norm_active_fiber_length", "at least 0", x0)?;
    require(x1 > x0 + eps, CURVE, "transition_norm_fiber_length", format!("above the minimum length {x0}"), x1)?;
    require(x1 + eps < 1.0, CURVE, "transition_norm_fiber_length", "below 1", x1)?;
    require(x3 > 1.0 + eps && x3.is_finite(), CURVE, "max_norm_active_fiber_length", "above 1", x3)?;
    require(spec.minimum_value >= 0.0, CURVE, "minimum_value", "at least 0", spec.minimum_value)?;
    let limit = (1.0 - spec.minimum_value) / (1.0 - x1);
    let slope = spec.shallow_ascending_slope;
    require(slope >= 0.0 && slope < limit, CURVE, "shallow_ascending_slope", format!("0 to below {limit}"), slope)
}
