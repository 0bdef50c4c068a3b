//! Variations of a prepared trial: other muscle properties, another angle or excitation, on the paths already
//! tabulated.

use std::sync::Arc;

use super::activation_dynamics::ActivationLaw;
use super::activation_trajectory::ActivationTrajectory;
use super::error::SimulationError;
use super::fiber::equation::FiberCurves;
use super::fiber::law::{FiberLaw, TabulatedMillard2012};
use super::model::{ActiveMuscle, MusculoskeletalModel, active_muscle_along};
use super::trial::{Options, PreparedMuscle, PreparedTrial, Recording, Source};
use carpus_osim::osim::spec::MuscleSpec;

/// How far beyond the recorded angles paths are tabulated for variations [rad]: 12°.
const ANGLE_MARGIN: f64 = 0.21;

impl MusculoskeletalModel {
    /// The same model with other properties of its active muscles (paths excepted).
    ///
    /// - `muscles`: one specification for each active muscle, in order
    ///
    /// # Errors
    /// A property that is not allowed.
    pub fn with_muscles(&self, muscles: &[MuscleSpec]) -> Result<MusculoskeletalModel, SimulationError> {
        let mut model = self.clone();
        let mut cache = model.curve_cache.clone();
        for (muscle, spec) in model.muscles.iter_mut().zip(muscles) {
            *muscle = active_muscle_along(spec, Arc::clone(&muscle.path), &mut cache)?;
        }
        Ok(model)
    }

    /// The same model with an optimal fibre length of its active muscles' active force of lo (1 + λ (1 − a)): longer at
    /// low activation. The force–velocity curve keeps lo.
    ///
    /// - `lambda`: λ; 0 is OpenSim's muscle
    ///
    /// # References
    /// Lloyd DG, Besier TF (2003), An EMG-driven musculoskeletal model to estimate muscle forces and knee joint moments
    /// in vivo, J Biomech 36.
    pub fn with_length_by_activation(&self, lambda: f64) -> MusculoskeletalModel {
        let mut model = self.clone();
        for muscle in &mut model.muscles {
            let mut curves = (*muscle.curves).clone();
            curves.length_by_activation = lambda;
            muscle.curves = Arc::new(curves);
        }
        model
    }

    /// Logarithms of the ratios of its active muscles' time constants of activation and of deactivation to those of
    /// another model, in order; `None` if muscles differ in anything else.
    pub fn log_ratios_of_time_constants(&self, other: &MusculoskeletalModel) -> Option<Vec<[f64; 2]>> {
        let of_muscle = |(a, b): (&ActiveMuscle, &ActiveMuscle)| {
            let (dynamics, others) = (&a.activation, &b.activation);
            let same = a.has_properties_of(b)
                && dynamics.minimum_activation == others.minimum_activation
                && dynamics.law == others.law;
            // Of other laws the two constants do not act one after the other.
            let alone = dynamics.law == ActivationLaw::FirstOrder || dynamics == others;
            let ratios = [
                dynamics.activation_time_constant / others.activation_time_constant,
                dynamics.deactivation_time_constant / others.deactivation_time_constant,
            ];
            (same && alone).then(|| ratios.map(f64::ln))
        };
        self.muscles.iter().zip(&other.muscles).map(of_muscle).collect()
    }

    /// As [`MusculoskeletalModel::prepare_all`], with paths tabulated 12° beyond the recorded angles, so that
    /// [`MusculoskeletalModel::prepare_like`] may change the angle that far.
    ///
    /// # Errors
    /// As there.
    pub fn prepare_all_with_margin(
        &self,
        recordings: &[Recording],
        options: &Options,
    ) -> Result<Vec<PreparedTrial>, SimulationError> {
        let motions =
            recordings.iter().map(|r| self.checked_motion(r, options)).collect::<Result<Vec<_>, SimulationError>>()?;
        let tables = self.tables_of(recordings, &motions, ANGLE_MARGIN)?;
        recordings
            .iter()
            .zip(motions)
            .zip(tables)
            .map(|((recording, motion), tables)| self.prepare_with(recording, motion, tables, options))
            .collect()
    }

    /// Prepares a variation of a trial on the paths and steps of `like`, which must come from this skeleton and have
    /// the same times: only what depends on something that differs is computed. A step that misses the tolerance for
    /// the variation is divided while it is simulated.
    ///
    /// # Errors
    /// As [`MusculoskeletalModel::prepare`].
    pub fn prepare_like(
        &self,
        recording: &Recording,
        like: &PreparedTrial,
        options: &Options,
    ) -> Result<PreparedTrial, SimulationError> {
        self.prepare_from(recording, like, options, None)
    }

    /// As [`MusculoskeletalModel::prepare_like`] for two variations so small that their difference gives a derivative:
    /// activation is integrated in the steps of `like`. They are not to be simulated.
    ///
    /// - `models`: of each variation
    ///
    /// # Errors
    /// As there.
    pub fn prepare_beside(
        models: [&MusculoskeletalModel; 2],
        recordings: [&Recording; 2],
        like: &PreparedTrial,
        options: &Options,
    ) -> Result<[PreparedTrial; 2], SimulationError> {
        let same_time = recordings.iter().all(|r| r.time == &*like.time);
        let mut activations: [Vec<Option<Arc<ActivationTrajectory>>>; 2] = [Vec::new(), Vec::new()];
        for (i, known) in like.muscles.iter().enumerate() {
            let dynamics = models.map(|m| &m.muscles[i].activation);
            let excitation = recordings.map(|r| r.excitation[i]);
            let differs =
                [0, 1].map(|side| *dynamics[side] != known.muscle.activation || excitation[side] != &*known.excitation);
            let long_enough = excitation.iter().all(|e| e.len() == like.time.len());
            let both = if same_time && long_enough && differs.contains(&true) {
                known.activation.beside(dynamics, &like.time, excitation).map(|a| Some(Arc::new(a)))
            } else {
                [None, None]
            };
            for (to, found) in activations.iter_mut().zip(both) {
                to.push(found);
            }
        }
        let [up, down] = [0, 1].map(|i| models[i].prepare_from(recordings[i], like, options, Some(&activations[i])));
        Ok([up?, down?])
    }

    /// - `beside`: activations in the steps of `like`, for muscles that are activated otherwise
    fn prepare_from(
        &self,
        recording: &Recording,
        like: &PreparedTrial,
        options: &Options,
        beside: Option<&[Option<Arc<ActivationTrajectory>>]>,
    ) -> Result<PreparedTrial, SimulationError> {
        let known = like.muscles.iter().map(|m| m.muscle.rigid_tendon);
        let same_tendons = self.muscles.iter().map(|m| m.rigid_tendon).eq(known);
        if recording.time != &*like.time || !same_tendons {
            let motion = self.checked_motion(recording, options)?;
            return self.prepare_with(recording, motion, Arc::clone(&like.tables), options);
        }
        let mut out = like.clone();
        let moves_otherwise = recording.angle != &*like.angle;
        if moves_otherwise {
            out.motion = Arc::new(self.checked_motion(recording, options)?);
            out.angle = recording.angle.into();
        } else {
            self.check_samples(recording)?;
        }
        let mut driven_otherwise = false;
        for (i, muscle) in self.muscles.iter().enumerate() {
            let known = &like.muscles[i];
            let excitation = recording.excitation[i];
            let same_activation = muscle.activation == known.muscle.activation && excitation == &*known.excitation;
            let same_muscle = muscle.has_properties_of(&known.muscle);
            if same_activation && same_muscle && !moves_otherwise {
                continue;
            }
            muscle.check(&muscle.nominal)?;
            let activation = if same_activation {
                Arc::clone(&known.activation)
            } else if let Some(found) = beside.and_then(|b| b[i].as_ref()) {
                Arc::clone(found)
            } else {
                let followed = ActivationTrajectory::integrate(&muscle.activation, recording.time, excitation);
                Arc::new(followed.map_err(|stuck| muscle.too_fast(&recording.name, stuck))?)
            };
            let source = Source { activation: &activation, motion: &out.motion, path: &out.tables.muscles[i] };
            let plan = match &known.plan {
                Some(plan) if beside.is_some() || same_activation && !moves_otherwise => Some(Arc::clone(plan)),
                Some(plan) => Some(Arc::new(plan.driven_by(&source))),
                None => None,
            };
            let muscle = ActiveMuscle { path: Arc::clone(&known.muscle.path), ..muscle.clone() };
            let excitation = if same_activation { Arc::clone(&known.excitation) } else { excitation.into() };
            out.muscles[i] = Arc::new(PreparedMuscle { muscle, excitation, activation, plan });
            driven_otherwise |= !same_activation;
        }
        if moves_otherwise {
            out.kinematics = Arc::new(self.kinematics(recording.time, &out.motion, &out.tables, &out.muscles));
        } else if driven_otherwise {
            let kinematics = Arc::make_mut(&mut out.kinematics);
            for (series, prepared) in kinematics.muscles.iter_mut().zip(&out.muscles) {
                let mut cursor = 0;
                for (a, t) in series.activation.iter_mut().zip(&*out.time) {
                    *a = prepared.activation.value(*t, &mut cursor);
                }
            }
        }
        Ok(out)
    }
}

impl ActiveMuscle {
    /// Whether all but the dynamics of activation is known to be another's.
    fn has_properties_of(&self, other: &ActiveMuscle) -> bool {
        self.curves.are_same(&other.curves) && self.nominal == other.nominal && self.rigid_tendon == other.rigid_tendon
    }
}

impl PreparedTrial {
    /// Fibre damping β of each active muscle; `None` for classes whose fibres have none of Millard's kind.
    pub fn fiber_damping(&self) -> Vec<Option<f64>> {
        let of = |m: &Arc<PreparedMuscle>| match &m.muscle.curves.law {
            FiberLaw::Millard2012(law) => Some(law.damping),
            _ => None,
        };
        self.muscles.iter().map(of).collect()
    }

    /// The same trial with other fibre damping.
    ///
    /// - `damping`: β of each active muscle, in order; `None` where the class has none. The model without damping is
    ///   another one (its fibre velocity comes from an inverted curve), so a damped muscle needs more than 0 and an
    ///   undamped one keeps 0.
    ///
    /// # Errors
    /// [`SimulationError::ParameterCount`]; [`SimulationError::InvalidParameter`] for a damping that is not allowed.
    pub fn with_fiber_damping(&self, damping: &[Option<f64>]) -> Result<PreparedTrial, SimulationError> {
        if damping.len() != self.muscles.len() {
            let (found, expected) = (damping.len(), self.muscles.len());
            return Err(SimulationError::ParameterCount { found, expected });
        }
        let mut trial = self.clone();
        for (prepared, &value) in trial.muscles.iter_mut().zip(damping) {
            let muscle = &mut Arc::make_mut(prepared).muscle;
            let own = match &muscle.curves.law {
                FiberLaw::Millard2012(law) => Some(law.clone()),
                _ => None,
            };
            let (allowed, expected) = match (&own, value) {
                (None, given) => (given.is_none(), "none, as fibres of this class have none"),
                (Some(_), None) => (false, "a number"),
                (Some(law), Some(value)) if law.damping > 0.0 => {
                    (value > 0.0 && value <= 1.0, "more than 0 and at most 1")
                }
                (Some(_), Some(value)) => (value == 0.0, "0, as the muscle has no damping"),
            };
            if !allowed {
                let (muscle, property, value) = (muscle.name.clone(), "fiber_damping", value.unwrap_or(f64::NAN));
                return Err(SimulationError::InvalidParameter { muscle, property, value, expected });
            }
            if let (Some(law), Some(damping)) = (own, value) {
                let law = FiberLaw::Millard2012(TabulatedMillard2012 { damping, ..law });
                muscle.curves = Arc::new(FiberCurves { law, ..(*muscle.curves).clone() });
            }
        }
        Ok(trial)
    }
}
