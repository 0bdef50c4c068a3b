//! `ForceVelocityCurve` and `ForceVelocityInverseCurve`.

use super::properties::{CurveError, require, scale_curviness};
use carpus_numerics::numerics::{QuinticCorner, SmoothSegmentedFunction};
use carpus_osim::osim::spec::ForceVelocitySpec;

const CURVE: &str = "ForceVelocityCurve";
const INVERSE: &str = "ForceVelocityInverseCurve";

/// Normalized velocity where the slopes "near" maximum velocity hold.
const NEAR_VMAX: f64 = 0.9;

/// Force multiplier against normalized fibre velocity (positive when the fibre lengthens).
///
/// # Errors
/// [`CurveError::OutOfRange`], [`CurveError::Corner`].
///
/// # References
/// OpenSim `SmoothSegmentedFunctionFactory::createFiberForceVelocityCurve`; Millard et al. (2013), figure 3C,
/// doi:10.1115/1.4023390.
pub fn force_velocity(spec: &ForceVelocitySpec) -> Result<SmoothSegmentedFunction, CurveError> {
    check(spec, CURVE, 0.0)?;
    let corners = corners(spec).map_err(|source| CurveError::Corner { curve: CURVE, source })?;
    Ok(SmoothSegmentedFunction::new(&corners, spec.concentric_slope_at_vmax, spec.eccentric_slope_at_vmax))
}

/// Normalized fibre velocity against force multiplier: the inverse of the curve with the same properties.
///
/// # Errors
/// [`CurveError::OutOfRange`] (the end slopes must not be 0), [`CurveError::Corner`].
///
/// # References
/// OpenSim `SmoothSegmentedFunctionFactory::createFiberForceVelocityInverseCurve`.
pub fn force_velocity_inverse(spec: &ForceVelocitySpec) -> Result<SmoothSegmentedFunction, CurveError> {
    check(spec, INVERSE, f64::EPSILON.powf(7.0 / 8.0))?;
    let corners = corners(spec).map_err(|source| CurveError::Corner { curve: INVERSE, source })?;
    let mirrored = corners.map(|corner| QuinticCorner { x: corner.y, y: corner.x });
    let slopes = [1.0 / spec.concentric_slope_at_vmax, 1.0 / spec.eccentric_slope_at_vmax];
    Ok(SmoothSegmentedFunction::new(&mirrored, slopes[0], slopes[1]))
}

fn corners(spec: &ForceVelocitySpec) -> Result<[QuinticCorner; 4], carpus_numerics::numerics::CornerError> {
    let concentric = scale_curviness(spec.concentric_curviness);
    let eccentric = scale_curviness(spec.eccentric_curviness);
    let [slope_c, near_c] = [spec.concentric_slope_at_vmax, spec.concentric_slope_near_vmax];
    let [slope_e, near_e] = [spec.eccentric_slope_at_vmax, spec.eccentric_slope_near_vmax];
    let y_e = spec.max_eccentric_velocity_force_multiplier;

    let run = 1.0 - NEAR_VMAX;
    let fastest_shortening = [-1.0, 0.0, slope_c];
    let fast_shortening = [-NEAR_VMAX, 0.5 * near_c * run + 0.5 * slope_c * run, near_c];
    let isometric = [0.0, 1.0, spec.isometric_slope];
    let fast_lengthening = [NEAR_VMAX, y_e - 0.5 * near_e * run - 0.5 * slope_e * run, near_e];
    let fastest_lengthening = [1.0, y_e, slope_e];
    Ok([
        QuinticCorner::new(fastest_shortening, fast_shortening, concentric)?,
        QuinticCorner::new(fast_shortening, isometric, concentric)?,
        QuinticCorner::new(isometric, fast_lengthening, eccentric)?,
        QuinticCorner::new(fast_lengthening, fastest_lengthening, eccentric)?,
    ])
}

/// `slowest`: lowest slope at maximum velocity that is allowed.
fn check(spec: &ForceVelocitySpec, curve: &'static str, slowest: f64) -> Result<(), CurveError> {
    let sqrt_eps = f64::EPSILON.sqrt();
    let multiplier = spec.max_eccentric_velocity_force_multiplier;
    let ok = multiplier > 1.0 && multiplier.is_finite();
    require(ok, curve, "max_eccentric_velocity_force_multiplier", "above 1", multiplier)?;
    let [at, near] = [spec.concentric_slope_at_vmax, spec.concentric_slope_near_vmax];
    let steepest = multiplier - 1.0;
    require(at >= slowest && at < 1.0, curve, "concentric_slope_at_vmax", "0 to below 1", at)?;
    let expected = || format!("above {sqrt_eps:.2e} and the slope at maximum velocity ({at}), at most 1");
    require(near > at && near >= sqrt_eps && near <= 1.0, curve, "concentric_slope_near_vmax", expected(), near)?;
    let iso = spec.isometric_slope;
    require(iso > 1.0 && iso.is_finite(), curve, "isometric_slope", "above 1", iso)?;
    let [at, near] = [spec.eccentric_slope_at_vmax, spec.eccentric_slope_near_vmax];
    require(at >= slowest && at < steepest, curve, "eccentric_slope_at_vmax", format!("0 to below {steepest}"), at)?;
    let expected = || format!("above {sqrt_eps:.2e}, at least {at} and below {steepest}");
    let ok = near >= at && near >= sqrt_eps && near < steepest;
    require(ok, curve, "eccentric_slope_near_vmax", expected(), near)?;
    for (property, curviness) in
        [("concentric_curviness", spec.concentric_curviness), ("eccentric_curviness", spec.eccentric_curviness)]
    {
        require((0.0..=1.0).contains(&curviness), curve, property, "0 to 1", curviness)?;
    }
    Ok(())
}
