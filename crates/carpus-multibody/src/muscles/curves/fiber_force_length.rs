//! `FiberForceLengthCurve`.

use super::properties::{CurveError, require, scale_curviness};
use carpus_numerics::numerics::{QuinticCorner, SmoothSegmentedFunction};
use carpus_osim::osim::spec::FiberForceLengthSpec;

const CURVE: &str = "FiberForceLengthCurve";
const OPTIONAL: &[&str] = &["stiffness_at_low_force", "stiffness_at_one_norm_force", "curviness"];

/// The shape properties in use, given or computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiberForceLengthInUse {
    /// Stiffness at the end of the low-force region.
    pub stiffness_at_low_force: f64,
    /// Stiffness at normalized force 1.
    pub stiffness_at_one_norm_force: f64,
    /// Curviness, 0 to 1.
    pub curviness: f64,
}

impl FiberForceLengthInUse {
    /// The given shape; if none is given, OpenSim's: stiffness 0.2 at low force, 2 / (strain range), curviness 0.75.
    ///
    /// # Errors
    /// [`CurveError::PartlySet`].
    pub fn new(spec: &FiberForceLengthSpec) -> Result<FiberForceLengthInUse, CurveError> {
        match (spec.stiffness_at_low_force, spec.stiffness_at_one_norm_force, spec.curviness) {
            (Some(stiffness_at_low_force), Some(stiffness_at_one_norm_force), Some(curviness)) => {
                Ok(FiberForceLengthInUse { stiffness_at_low_force, stiffness_at_one_norm_force, curviness })
            }
            (None, None, None) => Ok(FiberForceLengthInUse {
                stiffness_at_low_force: 0.2,
                stiffness_at_one_norm_force: 2.0 / (spec.strain_at_one_norm_force - spec.strain_at_zero_force),
                curviness: 0.75,
            }),
            _ => Err(CurveError::PartlySet { curve: CURVE, properties: OPTIONAL }),
        }
    }
}

/// Passive force multiplier against normalized fibre length.
///
/// # Errors
/// [`CurveError`], every variant.
///
/// # References
/// OpenSim `FiberForceLengthCurve`, `SmoothSegmentedFunctionFactory::createFiberForceLengthCurve`; Millard et al.
/// (2013), figure 3B, doi:10.1115/1.4023390.
pub fn fiber_force_length(spec: &FiberForceLengthSpec) -> Result<SmoothSegmentedFunction, CurveError> {
    let [zero, one] = [spec.strain_at_zero_force, spec.strain_at_one_norm_force];
    require(zero.is_finite(), CURVE, "strain_at_zero_force", "a number", zero)?;
    let expected = || format!("above the strain at zero force, {zero}");
    require(one > zero && one.is_finite(), CURVE, "strain_at_one_norm_force", expected(), one)?;
    let in_use = FiberForceLengthInUse::new(spec)?;
    let [k_low, k_iso] = [in_use.stiffness_at_low_force, in_use.stiffness_at_one_norm_force];
    let mean = 1.0 / (one - zero);
    let expected = || format!("above the mean stiffness {mean}");
    require(k_iso > mean && k_iso.is_finite(), CURVE, "stiffness_at_one_norm_force", expected(), k_iso)?;
    let expected = || format!("above 0 and below the mean stiffness {mean}");
    require(k_low > 0.0 && k_low < mean, CURVE, "stiffness_at_low_force", expected(), k_low)?;
    require((0.0..=1.0).contains(&in_use.curviness), CURVE, "curviness", "0 to 1", in_use.curviness)?;

    let c = scale_curviness(in_use.curviness);
    let [x_zero, x_iso] = [1.0 + zero, 1.0 + one];
    let delta_x = (0.1 * (1.0 / k_iso)).min(0.1 * (x_iso - x_zero));
    let x_low = x_zero + delta_x;
    let x_foot = x_zero + 0.5 * (x_low - x_zero);
    let y_low = k_low * (x_low - x_foot);
    let build = || {
        Ok([
            QuinticCorner::new([x_zero, 0.0, 0.0], [x_low, y_low, k_low], c)?,
            QuinticCorner::new([x_low, y_low, k_low], [x_iso, 1.0, k_iso], c)?,
        ])
    };
    let corners = build().map_err(|source| CurveError::Corner { curve: CURVE, source })?;
    Ok(SmoothSegmentedFunction::new(&corners, 0.0, k_iso))
}
