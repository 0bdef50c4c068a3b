//! The fibre of a muscle of any class at rest, with exact derivatives.

use std::sync::Arc;

use super::CurveCache;
use super::equation::{Drive, Fiber, FiberCurves};
use crate::simulation::model::MuscleParameters;
use carpus_multibody::muscles::{MuscleError, MuscleModel};
use carpus_osim::osim::spec::MuscleSpec;

/// The fibre of a muscle at rest whose tendon is a spring.
#[derive(Clone, Debug)]
pub struct FiberAtRest {
    curves: Arc<FiberCurves>,
    /// Least activation that the class takes.
    least_activation: f64,
}

impl FiberAtRest {
    /// The fibre of a muscle; `None` if its tendon is rigid.
    ///
    /// # Errors
    /// A class that is not simulated; properties that OpenSim too would refuse.
    pub fn of(spec: &MuscleSpec) -> Result<Option<FiberAtRest>, MuscleError> {
        let muscle = MuscleModel::from_spec(spec)?;
        if muscle.ignore_tendon_compliance() {
            return Ok(None);
        }
        let least_activation = match &muscle {
            MuscleModel::Thelen2003(own) => own.activation_dynamics().clamp(0.0),
            _ => 0.0,
        };
        let curves = FiberCurves::of(&muscle, spec, &mut CurveCache::default());
        Ok(curves.map(|curves| FiberAtRest { curves, least_activation }))
    }

    /// Fibre length in equilibrium with the tendon [m], and its derivatives by optimal fibre length and by tendon slack
    /// length [1]; `None` where these are not finite: a slack tendon on a fibre without passive force.
    ///
    /// - `path_length` [m]
    pub fn length(&self, p: &MuscleParameters, path_length: f64, activation: f64) -> Option<[f64; 3]> {
        let (optimal, slack) = (p.optimal_fiber_length, p.tendon_slack_length);
        let fiber = Fiber::new(Arc::clone(&self.curves), optimal, slack, p.pennation_angle_at_optimal);
        let drive = Drive { activation: activation.max(self.least_activation), length: path_length };
        let (x, at_limit) = fiber.static_equilibrium(drive);
        let by = fiber.start_by_parameters(x, at_limit, drive, 0.0);
        let found = [optimal * x, x + optimal * by[0], optimal * by[1]];
        found.iter().all(|v| v.is_finite()).then_some(found)
    }
}
