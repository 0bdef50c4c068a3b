//! Prepares recorded trials: everything that does not depend on muscle parameters.

use std::sync::Arc;

use rayon::prelude::*;

use super::activation_trajectory::ActivationTrajectory;
use super::error::SimulationError;
use super::fiber::plan::StepPlan;
use super::model::{HeldCoordinate, MusculoskeletalModel};
use super::motion::Motion;
use super::tables::{CoordinateTables, LENGTH, MOMENT_ARM, UNIT_SPEED};
use super::trial::{
    MIN_RECORDING_SAMPLES, MuscleKinematics, Options, PreparedMuscle, PreparedTrial, Recording, Source, TrialKinematics,
};
use carpus_study::study::{ANGLE_RANGE_TOLERANCE, MomentPart};

impl MusculoskeletalModel {
    /// Prepares one recording; see [`MusculoskeletalModel::prepare_all`].
    ///
    /// # Errors
    /// As there.
    pub fn prepare(&self, recording: &Recording, options: &Options) -> Result<PreparedTrial, SimulationError> {
        let motion = self.checked_motion(recording, options)?;
        let tables =
            Arc::new(CoordinateTables::build(self, &self.posture_with(&recording.held)?, motion.range(), 0.0)?);
        self.prepare_with(recording, motion, tables, options)
    }

    /// Computes everything about the recordings that does not depend on muscle parameters. Paths are evaluated once for
    /// the whole range of all recordings of a posture.
    ///
    /// # Errors
    /// A recording that cannot be used (the first in order), or a muscle whose forces cannot be balanced with the
    /// model's own parameters.
    pub fn prepare_all(
        &self,
        recordings: &[Recording],
        options: &Options,
    ) -> Result<Vec<PreparedTrial>, SimulationError> {
        let motions: Vec<Motion> = recordings
            .par_iter()
            .map(|recording| self.checked_motion(recording, options))
            .collect::<Vec<_>>()
            .into_iter()
            .collect::<Result<_, _>>()?;
        let tables = self.tables_of(recordings, &motions, 0.0)?;
        recordings
            .par_iter()
            .zip(motions)
            .zip(tables)
            .map(|((recording, motion), tables)| self.prepare_with(recording, motion, tables, options))
            .collect::<Vec<_>>()
            .into_iter()
            .collect()
    }

    /// Tables for every recording; those of one posture share theirs.
    ///
    /// - `margin`: how far tables go beyond the recorded angles [rad or m]
    pub(crate) fn tables_of(
        &self,
        recordings: &[Recording],
        motions: &[Motion],
        margin: f64,
    ) -> Result<Vec<Arc<CoordinateTables>>, SimulationError> {
        let mut postures: Vec<(&[HeldCoordinate], [f64; 2])> = Vec::new();
        let mut of_recording = Vec::with_capacity(recordings.len());
        for (recording, motion) in recordings.iter().zip(motions) {
            let [low, high] = motion.range();
            let known = postures.iter().position(|(held, _)| *held == recording.held);
            of_recording.push(known.unwrap_or(postures.len()));
            match known {
                Some(i) => postures[i].1 = [postures[i].1[0].min(low), postures[i].1[1].max(high)],
                None => postures.push((&recording.held, [low, high])),
            }
        }
        let build = |(held, [low, high]): &(&[HeldCoordinate], [f64; 2])| {
            let posture = self.posture_with(held)?;
            Ok(Arc::new(CoordinateTables::build(self, &posture, [*low, *high], margin)?))
        };
        let tables: Vec<Arc<CoordinateTables>> =
            postures.par_iter().map(build).collect::<Vec<_>>().into_iter().collect::<Result<_, SimulationError>>()?;
        Ok(of_recording.into_iter().map(|i| Arc::clone(&tables[i])).collect())
    }

    pub(crate) fn checked_motion(&self, recording: &Recording, options: &Options) -> Result<Motion, SimulationError> {
        self.check_samples(recording)?;
        if !options.allow_angle_outside_range {
            let coordinate = &self.skeleton.coordinates[self.coordinate.0];
            let [lower, upper] = coordinate.range;
            let outside = |a: &f64| *a < lower - ANGLE_RANGE_TOLERANCE || *a > upper + ANGLE_RANGE_TOLERANCE;
            if let Some(sample) = recording.angle.iter().position(outside) {
                return Err(SimulationError::AngleOutOfRange {
                    recording: recording.name.clone(),
                    time: recording.time[sample],
                    angle: recording.angle[sample],
                    coordinate: coordinate.name.clone(),
                    lower,
                    upper,
                });
            }
        }
        Motion::interpolate(recording.time, recording.angle, options.motion)
            .map_err(|source| SimulationError::Motion { recording: recording.name.clone(), source })
    }

    pub(crate) fn check_samples(&self, recording: &Recording) -> Result<(), SimulationError> {
        let name = || recording.name.clone();
        let count = recording.time.len();
        if count < MIN_RECORDING_SAMPLES {
            let expected = MIN_RECORDING_SAMPLES;
            return Err(SimulationError::TooFewSamples { recording: name(), found: count, expected });
        }
        if recording.excitation.len() != self.muscles.len() {
            let (found, expected) = (recording.excitation.len(), self.muscles.len());
            return Err(SimulationError::ExcitationCount { recording: name(), found, expected });
        }
        let excitations =
            recording.excitation.iter().zip(&self.muscles).map(|(e, m)| (format!("excitation of {}", m.name), *e));
        let columns = [("time".to_owned(), recording.time), ("angle".to_owned(), recording.angle)];
        for (column, values) in columns.into_iter().chain(excitations) {
            if values.len() != count {
                let found = values.len();
                return Err(SimulationError::ColumnLength { recording: name(), column, found, expected: count });
            }
            if let Some(sample) = values.iter().position(|v| !v.is_finite()) {
                let value = values[sample];
                return Err(SimulationError::NotFinite { recording: name(), column, sample, value });
            }
        }
        if let Some(pair) = recording.time.windows(2).find(|pair| pair[1] <= pair[0]) {
            let (before, time) = (pair[0], pair[1]);
            return Err(SimulationError::TimeNotIncreasing { recording: name(), time, before });
        }
        Ok(())
    }

    pub(crate) fn prepare_with(
        &self,
        recording: &Recording,
        motion: Motion,
        tables: Arc<CoordinateTables>,
        options: &Options,
    ) -> Result<PreparedTrial, SimulationError> {
        let mut muscles = Vec::with_capacity(self.muscles.len());
        for (i, muscle) in self.muscles.iter().enumerate() {
            muscle.check(&muscle.nominal)?;
            let activation =
                ActivationTrajectory::integrate(&muscle.activation, recording.time, recording.excitation[i])
                    .map_err(|stuck| muscle.too_fast(&recording.name, stuck))?;
            let plan = if muscle.rigid_tendon {
                None
            } else {
                let source = Source { activation: &activation, motion: &motion, path: &tables.muscles[i] };
                let fiber = muscle.fiber(&muscle.nominal);
                let plan = StepPlan::build(&fiber, &source, recording.time, &options.fiber).map_err(|stuck| {
                    let (recording, muscle) = (recording.name.clone(), muscle.name.clone());
                    SimulationError::NoBalance { recording, muscle, time: stuck.time }
                })?;
                Some(Arc::new(plan))
            };
            muscles.push(Arc::new(PreparedMuscle {
                muscle: muscle.clone(),
                excitation: recording.excitation[i].into(),
                activation: Arc::new(activation),
                plan,
            }));
        }
        let kinematics = Arc::new(self.kinematics(recording.time, &motion, &tables, &muscles));
        Ok(PreparedTrial {
            name: recording.name.clone(),
            time: recording.time.into(),
            motion: Arc::new(motion),
            tables,
            muscles,
            kinematics,
            accuracy: options.fiber,
            angle: recording.angle.into(),
        })
    }

    pub(crate) fn kinematics(
        &self,
        time: &[f64],
        motion: &Motion,
        tables: &CoordinateTables,
        muscles: &[Arc<PreparedMuscle>],
    ) -> TrialKinematics {
        let n = time.len();
        let series = || Vec::with_capacity(n);
        let mut out = TrialKinematics {
            time: time.to_vec(),
            angle: series(),
            speed: series(),
            acceleration: series(),
            muscles: Vec::with_capacity(muscles.len()),
            passive_moment: series(),
            gravity_moment: series(),
            inertia_moment: series(),
            damping_moment: series(),
        };
        let mut cursor = 0;
        for &t in time {
            let [angle, speed, acceleration] = motion.jet(t, &mut cursor);
            out.angle.push(angle);
            out.speed.push(speed);
            out.acceleration.push(acceleration);
        }
        for (table, prepared) in tables.muscles.iter().zip(muscles) {
            let mut muscle = MuscleKinematics {
                length: series(),
                lengthening_speed: series(),
                moment_arm: series(),
                activation: series(),
            };
            let (mut at, mut activation) = (0, 0);
            for k in 0..n {
                let values = table.values(out.angle[k], &mut at);
                muscle.length.push(values[LENGTH]);
                muscle.moment_arm.push(values[MOMENT_ARM]);
                muscle.lengthening_speed.push(values[UNIT_SPEED] * out.speed[k]);
                muscle.activation.push(prepared.activation.value(time[k], &mut activation));
            }
            out.muscles.push(muscle);
        }
        self.passive_moments(&mut out, tables);
        out
    }

    /// The moments of everything but the muscles, at the motion that `out` has; those that it has are replaced.
    pub(crate) fn passive_moments(&self, out: &mut TrialKinematics, tables: &CoordinateTables) {
        let moments =
            [&mut out.passive_moment, &mut out.gravity_moment, &mut out.inertia_moment, &mut out.damping_moment];
        moments.into_iter().for_each(Vec::clear);
        let mut cursor = 0;
        let mut cursors = vec![0; tables.passive_paths.len()];
        let mut followers = vec![0; tables.expressions.len()];
        let passive = self.setup.includes(MomentPart::Passive);
        for k in 0..out.time.len() {
            let (angle, speed, acceleration) = (out.angle[k], out.speed[k], out.acceleration[k]);
            let forces = tables.forces(angle, &mut cursor);
            let mut passive_moment = forces.elastic + forces.viscous * speed;
            if passive {
                for ((force, table), cursor) in self.passive_paths.iter().zip(&tables.passive_paths).zip(&mut cursors) {
                    let at = table.values(angle, cursor);
                    passive_moment += at[MOMENT_ARM] * force.law.tension(at[LENGTH], at[UNIT_SPEED] * speed);
                }
            }
            if passive {
                let formulas = self.forces.expressions().zip(&tables.expressions).zip(&mut followers);
                for ((force, table), cursor) in formulas {
                    if let Some(table) = table {
                        let [value, coupling, unit_speed] = table.values(angle, cursor);
                        passive_moment += coupling * force.force(value, unit_speed * speed);
                    }
                }
            }
            out.passive_moment.push(passive_moment);
            out.gravity_moment.push(forces.gravity);
            out.inertia_moment.push(forces.by_acceleration * acceleration + forces.by_speed_squared * speed * speed);
            out.damping_moment.push(-self.setup.dynamometer_damping * speed);
        }
        self.include_muscles(out);
    }

    /// Without muscles in the sum, their moment arms count as zero.
    fn include_muscles(&self, out: &mut TrialKinematics) {
        if !self.setup.includes(MomentPart::Muscles) {
            out.muscles.iter_mut().for_each(|m| m.moment_arm.fill(0.0));
        }
    }
}
