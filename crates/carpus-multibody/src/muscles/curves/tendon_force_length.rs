//! `TendonForceLengthCurve`.

use super::properties::{CurveError, require, scale_curviness};
use carpus_numerics::numerics::{QuinticCorner, SmoothSegmentedFunction};
use carpus_osim::osim::spec::TendonForceLengthSpec;

const CURVE: &str = "TendonForceLengthCurve";
const OPTIONAL: &[&str] = &["stiffness_at_one_norm_force", "norm_force_at_toe_end", "curviness"];

/// The shape properties in use, given or computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TendonForceLengthInUse {
    /// Stiffness at normalized force 1.
    pub stiffness_at_one_norm_force: f64,
    /// Normalized force at the end of the toe region.
    pub norm_force_at_toe_end: f64,
    /// Curviness, 0 to 1.
    pub curviness: f64,
}

impl TendonForceLengthInUse {
    /// The given shape; if none is given, OpenSim's: stiffness 1.375 / strain, toe to 2/3, curviness 0.5.
    ///
    /// # Errors
    /// [`CurveError::PartlySet`].
    pub fn new(spec: &TendonForceLengthSpec) -> Result<TendonForceLengthInUse, CurveError> {
        match (spec.stiffness_at_one_norm_force, spec.norm_force_at_toe_end, spec.curviness) {
            (Some(stiffness_at_one_norm_force), Some(norm_force_at_toe_end), Some(curviness)) => {
                Ok(TendonForceLengthInUse { stiffness_at_one_norm_force, norm_force_at_toe_end, curviness })
            }
            (None, None, None) => Ok(TendonForceLengthInUse {
                stiffness_at_one_norm_force: 1.375 / spec.strain_at_one_norm_force,
                norm_force_at_toe_end: 2.0 / 3.0,
                curviness: 0.5,
            }),
            _ => Err(CurveError::PartlySet { curve: CURVE, properties: OPTIONAL }),
        }
    }
}

/// Tendon force multiplier against normalized tendon length.
///
/// # Errors
/// [`CurveError`], every variant.
///
/// # References
/// OpenSim `TendonForceLengthCurve`, `SmoothSegmentedFunctionFactory::createTendonForceLengthCurve`; Millard et al.
/// (2013), figure 3D, doi:10.1115/1.4023390.
pub fn tendon_force_length(spec: &TendonForceLengthSpec) -> Result<SmoothSegmentedFunction, CurveError> {
    let strain = spec.strain_at_one_norm_force;
    require(strain > 0.0 && strain.is_finite(), CURVE, "strain_at_one_norm_force", "above 0", strain)?;
    let in_use = TendonForceLengthInUse::new(spec)?;
    let [k_iso, y_toe] = [in_use.stiffness_at_one_norm_force, in_use.norm_force_at_toe_end];
    require(y_toe > 0.0 && y_toe < 1.0, CURVE, "norm_force_at_toe_end", "above 0 and below 1", y_toe)?;
    let expected = || format!("above 1/strain_at_one_norm_force = {}", 1.0 / strain);
    let ok = k_iso > 1.0 / strain && k_iso.is_finite();
    require(ok, CURVE, "stiffness_at_one_norm_force", expected(), k_iso)?;
    require((0.0..=1.0).contains(&in_use.curviness), CURVE, "curviness", "0 to 1", in_use.curviness)?;

    let c = scale_curviness(in_use.curviness);
    let x_iso = 1.0 + strain;
    let x_toe = (y_toe - 1.0) / k_iso + x_iso;
    // The toe's tangent meets the axis right of slack length, which limits the curvature there.
    let x_foot = 1.0 + (x_toe - 1.0) / 10.0;
    let y_mid = y_toe * 0.5;
    let x_mid = (y_mid - 1.0) / k_iso + x_iso;
    let k_mid = y_mid / (x_mid - x_foot);
    let x_control = x_foot + 0.5 * (x_mid - x_foot);
    let y_control = k_mid * (x_control - x_foot);
    let build = || {
        Ok([
            QuinticCorner::new([1.0, 0.0, 0.0], [x_control, y_control, k_mid], c)?,
            QuinticCorner::new([x_control, y_control, k_mid], [x_toe, y_toe, k_iso], c)?,
        ])
    };
    let corners = build().map_err(|source| CurveError::Corner { curve: CURVE, source })?;
    Ok(SmoothSegmentedFunction::new(&corners, 0.0, k_iso))
}
