//! The fibre of one muscle: its force equilibrium, and its integration over a trial.

pub(crate) mod curve_table;
pub(crate) mod equation;
pub(crate) mod integrate;
pub(crate) mod radau;
pub(crate) mod rigid_tendon;

use std::sync::Arc;

use crate::muscles::Millard2012;
use crate::numerics::SmoothSegmentedFunction;
use curve_table::CurveTable;
use equation::FiberCurves;

impl FiberCurves {
    /// Largest deviation of a tabulated curve from the exact one.
    pub(crate) fn deviation(&self) -> f64 {
        let curves = [&self.active, &self.passive, &self.force_velocity, &self.tendon];
        curves.into_iter().chain(&self.velocity_of_force).map(CurveTable::deviation).fold(0.0, f64::max)
    }

    /// Tabulates the curves of a muscle.
    pub(crate) fn tabulate(muscle: &Millard2012, maximum_pennation_angle: f64) -> Arc<FiberCurves> {
        let table = |curve: &SmoothSegmentedFunction| {
            let jet = |x: f64| {
                let at = curve.value_and_derivative(x);
                [at.value, at.derivative, curve.second_derivative(x)]
            };
            CurveTable::build(jet, curve.domain())
        };
        let curves = muscle.curves();
        let undamped = !muscle.is_damped() && !muscle.ignore_tendon_compliance();
        Arc::new(FiberCurves {
            active: table(&curves.active_force_length),
            passive: table(&curves.fiber_force_length),
            force_velocity: table(&curves.force_velocity),
            tendon: table(&curves.tendon_force_length),
            velocity_of_force: undamped.then(|| table(&curves.force_velocity_inverse)),
            damping: muscle.parameters().fiber_damping,
            max_velocity: muscle.parameters().max_contraction_velocity,
            min_active_length: curves.min_norm_active_fiber_length,
            sine_max_pennation: maximum_pennation_angle.sin(),
        })
    }
}

#[cfg(test)]
mod tests;
