//! A trial as it was recorded: moments about one or several coordinates, and the excitations that are to explain them.

use nalgebra::DVector;

use carpus_diagnosis::fit::{block_means, block_starts};
use carpus_simulation::simulation::{HeldCoordinate, PreparedTrial, Recording};
use carpus_study::study::Direction;

/// Generalized force about one coordinate over a trial.
#[derive(Clone, Debug)]
pub struct Channel {
    /// The coordinate.
    pub coordinate: String,
    /// Measured [N·m].
    pub measured: Vec<f64>,
    /// The part that is not of muscles [N·m].
    pub without_muscles: Vec<f64>,
    /// Moment arm of every active muscle [m].
    pub moment_arms: Vec<Vec<f64>>,
}

/// A recorded trial.
#[derive(Clone, Debug)]
pub struct RecordedTrial {
    /// Name for messages.
    pub name: String,
    /// Direction of the effort.
    pub direction: Direction,
    /// Time [s].
    pub time: Vec<f64>,
    /// Angle of the moving coordinate [rad].
    pub angle: Vec<f64>,
    /// Samples for one of the moment's own, 1 or more.
    pub rows_per_moment: f64,
    /// Excitation of every active muscle, as recorded.
    pub excitation: Vec<Vec<f64>>,
    /// Coordinates held otherwise than in the posture of the study.
    pub held: Vec<HeldCoordinate>,
    /// What was measured.
    pub channels: Vec<Channel>,
    /// Prepared with the excitation as recorded.
    pub prepared: PreparedTrial,
}

impl RecordedTrial {
    /// A trial with one measured moment, about the moving coordinate.
    pub fn new(
        name: &str,
        direction: Direction,
        coordinate: &str,
        recording: &Recording,
        measured: &[f64],
        prepared: &PreparedTrial,
    ) -> RecordedTrial {
        let moment_arms = prepared.kinematics().muscles.iter().map(|m| m.moment_arm.clone()).collect();
        RecordedTrial {
            name: name.to_string(),
            direction,
            time: recording.time.to_vec(),
            angle: recording.angle.to_vec(),
            rows_per_moment: 1.0,
            excitation: recording.excitation.iter().map(|e| e.to_vec()).collect(),
            held: recording.held.clone(),
            channels: vec![Channel {
                coordinate: coordinate.to_string(),
                measured: measured.to_vec(),
                without_muscles: prepared.moment_without_muscles(),
                moment_arms,
            }],
            prepared: prepared.clone(),
        }
    }

    /// The same trial with moments that were held or interpolated: as many samples for one of their own.
    pub fn sampled_every(self, rows: f64) -> RecordedTrial {
        RecordedTrial { rows_per_moment: rows, ..self }
    }

    /// The same trial with the moment about a further coordinate, which muscles alone make.
    ///
    /// - `moment_arms`: of every active muscle about it
    pub fn with_channel(mut self, coordinate: &str, measured: &[f64], moment_arms: Vec<Vec<f64>>) -> RecordedTrial {
        let without_muscles = vec![0.0; measured.len()];
        let (coordinate, measured) = (coordinate.to_string(), measured.to_vec());
        self.channels.push(Channel { coordinate, measured, without_muscles, moment_arms });
        self
    }

    /// Its time and angle with an excitation.
    pub(super) fn recording<'b>(&'b self, excitation: &'b [Vec<f64>]) -> Recording<'b> {
        Recording {
            name: self.name.clone(),
            time: &self.time,
            angle: &self.angle,
            excitation: excitation.iter().map(Vec::as_slice).collect(),
            held: self.held.clone(),
        }
    }

    /// Blocks of samples, the same for every channel.
    pub(super) fn starts(&self) -> Vec<usize> {
        block_starts(&self.time)
    }

    /// Block means of the moments, channel after channel, that a muscle's force makes.
    pub(super) fn moments_of(&self, muscle: usize, force: &[f64], starts: &[usize]) -> DVector<f64> {
        self.stacked(starts, |c| {
            self.channels[c].moment_arms[muscle].iter().zip(force).map(|(arm, f)| arm * f).collect()
        })
    }

    pub(super) fn stacked(&self, starts: &[usize], series: impl Fn(usize) -> Vec<f64>) -> DVector<f64> {
        let parts: Vec<DVector<f64>> = (0..self.channels.len()).map(|c| block_means(&series(c), starts)).collect();
        DVector::from_iterator(parts.iter().map(DVector::len).sum(), parts.iter().flat_map(|p| p.iter().copied()))
    }
}
