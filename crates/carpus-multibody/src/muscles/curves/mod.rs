//! The Millard 2012 muscle curves: each from its OpenSim properties to a [`SmoothSegmentedFunction`].
//!
//! # References
//! Millard et al. (2013), Flexing computational muscle, doi:10.1115/1.4023390; OpenSim
//! `SmoothSegmentedFunctionFactory`.

mod active_force_length;
mod fiber_force_length;
mod force_velocity;
mod properties;
mod tendon_force_length;

pub use active_force_length::active_force_length;
pub use fiber_force_length::{FiberForceLengthInUse, fiber_force_length};
pub use force_velocity::{force_velocity, force_velocity_inverse};
pub use properties::CurveError;
pub use tendon_force_length::{TendonForceLengthInUse, tendon_force_length};

use carpus_numerics::numerics::SmoothSegmentedFunction;
use carpus_osim::osim::spec::{ActiveForceLengthSpec, ForceVelocitySpec, Millard2012Spec};

/// The curves of one muscle, in the shape that the equilibrium model uses.
#[derive(Clone, Debug)]
pub struct MillardCurves {
    /// Active force–length multiplier against normalized fibre length.
    pub active_force_length: SmoothSegmentedFunction,
    /// Force–velocity multiplier against normalized fibre velocity.
    pub force_velocity: SmoothSegmentedFunction,
    /// Normalized fibre velocity against force–velocity multiplier, with finite end slopes.
    pub force_velocity_inverse: SmoothSegmentedFunction,
    /// Passive force multiplier against normalized fibre length.
    pub fiber_force_length: SmoothSegmentedFunction,
    /// Tendon force multiplier against normalized tendon length.
    pub tendon_force_length: SmoothSegmentedFunction,
    /// Normalized fibre length where the active force–length curve starts.
    pub min_norm_active_fiber_length: f64,
}

impl MillardCurves {
    /// The curves as OpenSim adapts them to the model in use.
    ///
    /// With damping, or with a rigid tendon, the active force–length curve is lowered to a minimum of 0 and the
    /// force–velocity curve gets flat ends. Without damping and with a compliant tendon (`singular`) the minimum is
    /// raised to 0.1 and the end slopes to half the slopes near the ends.
    ///
    /// # Errors
    /// [`CurveError`] of the first curve that cannot be built.
    ///
    /// # References
    /// OpenSim `Millard2012EquilibriumMuscle::extendFinalizeFromProperties`.
    pub fn new(spec: &Millard2012Spec, singular: bool) -> Result<MillardCurves, CurveError> {
        let active = adapt_active(&spec.active_force_length, singular);
        let velocity = adapt_velocity(&spec.force_velocity, singular);
        Ok(MillardCurves {
            active_force_length: active_force_length(&active)?,
            force_velocity: force_velocity(&velocity)?,
            force_velocity_inverse: force_velocity_inverse(&ForceVelocitySpec {
                concentric_slope_at_vmax: 0.5 * velocity.concentric_slope_near_vmax,
                eccentric_slope_at_vmax: 0.5 * velocity.eccentric_slope_near_vmax,
                ..velocity
            })?,
            fiber_force_length: fiber_force_length(&spec.fiber_force_length)?,
            tendon_force_length: tendon_force_length(&spec.tendon_force_length)?,
            min_norm_active_fiber_length: active.min_norm_active_fiber_length,
        })
    }
}

fn adapt_active(spec: &ActiveForceLengthSpec, singular: bool) -> ActiveForceLengthSpec {
    let minimum_value = if singular { spec.minimum_value.max(0.1) } else { spec.minimum_value.min(0.0) };
    ActiveForceLengthSpec { minimum_value, ..*spec }
}

fn adapt_velocity(spec: &ForceVelocitySpec, singular: bool) -> ForceVelocitySpec {
    let end_slope = |at: f64, near: f64| if singular { at.max(0.5 * near) } else { at.min(0.0) };
    ForceVelocitySpec {
        concentric_slope_at_vmax: end_slope(spec.concentric_slope_at_vmax, spec.concentric_slope_near_vmax),
        eccentric_slope_at_vmax: end_slope(spec.eccentric_slope_at_vmax, spec.eccentric_slope_near_vmax),
        ..*spec
    }
}
