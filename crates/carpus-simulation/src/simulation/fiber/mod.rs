//! The fibre of one muscle: its force equilibrium, and its integration over a trial.

pub(crate) mod at_rest;
pub(crate) mod curve_table;
pub(crate) mod equation;
pub(crate) mod equilibrium;
pub(crate) mod integrate;
pub(crate) mod law;
pub(crate) mod plan;
pub(crate) mod radau;
pub(crate) mod rigid_tendon;
pub(crate) mod step;

use std::fmt::Debug;
use std::sync::Arc;

use carpus_multibody::muscles::{Millard2012, MuscleModel};
use carpus_numerics::numerics::SmoothSegmentedFunction;
use carpus_osim::osim::spec::{Millard2012Spec, MuscleKind, MuscleSpec};
use curve_table::CurveTable;
use equation::FiberCurves;
use law::{FiberLaw, TabulatedMillard2012};

impl FiberCurves {
    /// Largest deviation of a tabulated curve from the exact one.
    pub(crate) fn deviation(&self) -> f64 {
        self.law.deviation()
    }

    /// What a muscle of any class is simulated with; `None` for properties of another class than the muscle's. The mass
    /// of a `Delp1990Muscle_Deprecated` is left out.
    ///
    /// - `properties`: what `muscle` was built from
    pub(crate) fn of(
        muscle: &MuscleModel,
        properties: &MuscleSpec,
        cache: &mut CurveCache,
    ) -> Option<Arc<FiberCurves>> {
        let law = match muscle {
            MuscleModel::Millard2012(own) => {
                let MuscleKind::Millard2012Equilibrium(properties) = &properties.kind else { return None };
                return Some(FiberCurves::tabulate(own, properties, cache));
            }
            MuscleModel::Thelen2003(own) => FiberLaw::Thelen2003(Arc::new((**own).clone())),
            MuscleModel::DeGrooteFregly2016(own) => FiberLaw::DeGrooteFregly2016(Arc::new((**own).clone())),
            MuscleModel::RigidTendon(own) => FiberLaw::RigidTendon(Arc::new((**own).clone())),
            MuscleModel::Deprecated(own) => FiberLaw::Deprecated(Arc::new((**own).clone())),
        };
        Some(Arc::new(FiberCurves::new(law)))
    }

    /// Tabulates the curves of a muscle; those that `cache` has from another muscle are shared.
    ///
    /// - `properties`: what `muscle` was built from
    pub(crate) fn tabulate(
        muscle: &Millard2012,
        properties: &Millard2012Spec,
        cache: &mut CurveCache,
    ) -> Arc<FiberCurves> {
        let curves = muscle.curves();
        let undamped = !muscle.is_damped() && !muscle.ignore_tendon_compliance();
        let p = properties;
        let mut table = |kind: &str, properties: &dyn Debug, curve| {
            // An undamped muscle's curves are adapted differently.
            cache.table(format!("{kind} {undamped} {properties:?}"), curve)
        };
        Arc::new(FiberCurves::new(FiberLaw::Millard2012(TabulatedMillard2012 {
            active: table("active", &p.active_force_length, &curves.active_force_length),
            passive: table("passive", &p.fiber_force_length, &curves.fiber_force_length),
            force_velocity: table("velocity", &p.force_velocity, &curves.force_velocity),
            tendon: table("tendon", &p.tendon_force_length, &curves.tendon_force_length),
            velocity_of_force: undamped.then(|| table("inverse", &p.force_velocity, &curves.force_velocity_inverse)),
            damping: muscle.parameters().fiber_damping,
            max_velocity: muscle.parameters().max_contraction_velocity,
            min_active_length: curves.min_norm_active_fiber_length,
            sine_max_pennation: properties.maximum_pennation_angle.sin(),
        })))
    }
}

/// Tables of the curves of a model's muscles, by the curves' properties: most muscles of a model have the same.
#[derive(Clone, Debug, Default)]
pub(crate) struct CurveCache {
    tables: Vec<(String, Arc<CurveTable>)>,
}

impl CurveCache {
    fn table(&mut self, key: String, curve: &SmoothSegmentedFunction) -> Arc<CurveTable> {
        if let Some((_, table)) = self.tables.iter().find(|(known, _)| *known == key) {
            return Arc::clone(table);
        }
        let jet = |x: f64| {
            let at = curve.value_and_derivative(x);
            [at.value, at.derivative, curve.second_derivative(x)]
        };
        let table = Arc::new(CurveTable::build(jet, curve.domain()));
        self.tables.push((key, Arc::clone(&table)));
        table
    }
}

#[cfg(test)]
mod conformance;
#[cfg(test)]
mod tests;
