//! One recorded trial: its samples.

use super::fault::Fault;
use super::limits::{ANGLE_RANGE_TOLERANCE, ANGLE_RANGE_WARNING, POSITION_RANGE_WARNING};
use super::problem::Problem;
use super::trial_list::TrialInfo;
use carpus_numerics::signals::OwnSamples;

/// The samples of one trial, in internal units.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// What `trials.csv` says of it.
    pub info: TrialInfo,
    /// Time \[s\], strictly increasing.
    pub time: Vec<f64>,
    /// Angle of the dynamometer's coordinate \[rad\].
    pub angle: Vec<f64>,
    /// Angular velocity [rad/s], if it was recorded; else the derivative of the angle is meant.
    pub velocity: Option<Vec<f64>>,
    /// Moment the person exerts about the coordinate [N·m], positive in the coordinate's positive direction.
    pub moment: Vec<f64>,
    /// Moments about the further coordinates of `[dynamometer] further_moments` [N·m], in their order.
    pub further_moments: Vec<Vec<f64>>,
    /// Excitation of each active muscle, 0 to 1, in the order of the study's active muscles.
    pub excitation: Vec<Vec<f64>>,
    /// The moment's own samples, where it was held, interpolated or smoothed on the grid of the file; `None`: one a
    /// row.
    pub moment_samples: Option<OwnSamples>,
    /// What a person should look at.
    pub warnings: Vec<Problem>,
    /// Times of `excitation` \[s\] while it holds raw EMG of a recorder of its own; `None`: they are `time`.
    pub(super) emg_time: Option<Vec<f64>>,
    /// Line of each sample in the file; empty if the trial was not read from a file.
    pub(super) lines: Vec<u32>,
}

impl Trial {
    /// A trial that does not come from a file. Nothing is checked.
    pub fn from_samples(
        info: TrialInfo,
        time: Vec<f64>,
        angle: Vec<f64>,
        moment: Vec<f64>,
        excitation: Vec<Vec<f64>>,
    ) -> Self {
        let (velocity, further_moments, warnings, lines) = (None, Vec::new(), Vec::new(), Vec::new());
        let (moment_samples, emg_time) = (None, None);
        Self {
            info,
            time,
            angle,
            velocity,
            moment,
            further_moments,
            excitation,
            moment_samples,
            warnings,
            emg_time,
            lines,
        }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are no samples; never so for a trial read from a file.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Time from the first to the last sample \[s\].
    pub fn duration(&self) -> f64 {
        self.time.last().zip(self.time.first()).map_or(0.0, |(last, first)| last - first)
    }

    /// Largest absolute moment [N·m].
    pub fn max_abs_moment(&self) -> f64 {
        self.moment.iter().fold(0.0, |max, m| f64::max(max, m.abs()))
    }

    /// Rows of the file from one sample of the moment to the next: 1 where every row is one.
    pub fn rows_per_moment(&self) -> f64 {
        self.moment_samples.as_ref().map_or(1.0, |own| own.step)
    }

    /// The moment [N·m] at its own samples: all that tells of its noise.
    pub fn own_moment(&self) -> Vec<f64> {
        match &self.moment_samples {
            Some(own) => own.at.iter().map(|k| self.moment[*k]).collect(),
            None => self.moment.clone(),
        }
    }

    /// With so many samples averaged to one; what is over at the end is left out.
    pub fn averaged(&self, count: usize) -> Trial {
        let mean = |x: &Vec<f64>| -> Vec<f64> {
            x.chunks_exact(count.max(1)).map(|part| part.iter().sum::<f64>() / part.len() as f64).collect()
        };
        let coarser = |own: &OwnSamples| {
            let mut at: Vec<usize> = own.at.iter().map(|k| k / count.max(1)).collect();
            at.dedup();
            at.retain(|k| *k < self.len() / count.max(1));
            let step = own.step / count.max(1) as f64;
            (step > 1.0).then_some(OwnSamples { at, step, ..*own })
        };
        Trial {
            info: self.info.clone(),
            moment_samples: self.moment_samples.as_ref().and_then(coarser),
            time: mean(&self.time),
            angle: mean(&self.angle),
            velocity: self.velocity.as_ref().map(mean),
            moment: mean(&self.moment),
            further_moments: self.further_moments.iter().map(mean).collect(),
            excitation: self.excitation.iter().map(mean).collect(),
            warnings: self.warnings.clone(),
            emg_time: None,
            lines: self.lines.chunks_exact(count.max(1)).map(|part| part[0]).collect(),
        }
    }

    /// Leaves out all samples but these; EMG is not touched.
    pub(super) fn keep(&mut self, range: std::ops::Range<usize>) {
        let own = [&mut self.time, &mut self.angle, &mut self.moment].into_iter();
        for samples in own.chain(&mut self.velocity).chain(&mut self.further_moments) {
            *samples = samples[range.clone()].to_vec();
        }
        self.lines = self.lines[range].to_vec();
    }

    /// Line of a sample in the trial's file; `None` if it does not come from a file.
    pub fn line_of_sample(&self, sample: usize) -> Option<usize> {
        self.lines.get(sample).map(|line| *line as usize)
    }

    /// Checks the angle against the range of the coordinate it is prescribed to.
    ///
    /// - `is_translation`: whether the coordinate is one
    /// - `lower`, `upper`: the coordinate's range in the model [rad or m]
    ///
    /// A sample outside by more than [`ANGLE_RANGE_TOLERANCE`] makes it a warning, at the line of the first such
    /// sample; one outside by more than [`ANGLE_RANGE_WARNING`] ([`POSITION_RANGE_WARNING`] of a translation) an error.
    pub fn check_against_range(
        &self,
        coordinate: &str,
        is_translation: bool,
        [lower, upper]: [f64; 2],
    ) -> Option<Problem> {
        let excess = |angle: f64| f64::max(lower - angle, angle - upper);
        let is_outside = |angle: &f64| excess(*angle) > ANGLE_RANGE_TOLERANCE;
        let first = self.angle.iter().position(is_outside)?;
        let extreme =
            self.angle.iter().copied().fold(self.angle[first], |a, b| if excess(b) > excess(a) { b } else { a });
        let fault = Fault::AngleOutOfRange {
            coordinate: coordinate.to_owned(),
            is_translation,
            lower,
            upper,
            extreme,
            count: self.angle.iter().filter(|a| is_outside(a)).count(),
            samples: self.len(),
        };
        let allowed = if is_translation { POSITION_RANGE_WARNING } else { ANGLE_RANGE_WARNING };
        let problem = if excess(extreme) > allowed { Problem::error } else { Problem::warning };
        Some(problem(&self.info.file, self.line_of_sample(first), fault))
    }
}
