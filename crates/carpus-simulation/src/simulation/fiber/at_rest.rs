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
        Ok(FiberCurves::of(&muscle, spec, &mut CurveCache::default()).map(|curves| FiberAtRest { curves }))
    }

    /// Fibre length in equilibrium with the tendon [m], and its derivatives by optimal fibre length and by tendon slack
    /// length [1].
    ///
    /// - `path_length` [m]
    pub fn length(&self, p: &MuscleParameters, path_length: f64, activation: f64) -> [f64; 3] {
        let (optimal, slack) = (p.optimal_fiber_length, p.tendon_slack_length);
        let fiber = Fiber::new(Arc::clone(&self.curves), optimal, slack, p.pennation_angle_at_optimal);
        let drive = Drive { activation, length: path_length };
        let (x, at_limit) = fiber.static_equilibrium(drive);
        let by = fiber.start_by_parameters(x, at_limit, drive, 0.0);
        [optimal * x, x + optimal * by[0], optimal * by[1]]
    }
}
