//! Blocks of samples that residuals are averaged over, and knots of the EMG's noise.

use nalgebra::DVector;

use super::super::noise::KNOT_SPACING;

/// Blocks that the samples of a trial are averaged to, if there are as many …
const BLOCKS: usize = 80;
/// … and in trials in which they would be longer than this [s], more …
const LONGEST: f64 = 0.0625;
/// … up to so many.
const MOST_BLOCKS: usize = 400;

/// Start of every block of samples, and the end.
pub(crate) fn block_starts(time: &[f64]) -> Vec<usize> {
    let samples = time.len();
    let wanted = (time[samples - 1] - time[0]) / LONGEST;
    let blocks = samples.min((wanted as usize).clamp(BLOCKS, MOST_BLOCKS));
    (0..=blocks).map(|b| b * samples / blocks).collect()
}

pub(crate) fn block_means(series: &[f64], starts: &[usize]) -> DVector<f64> {
    DVector::from_iterator(
        starts.len() - 1,
        starts.windows(2).map(|w| series[w[0]..w[1]].iter().sum::<f64>() / (w[1] - w[0]) as f64),
    )
}

pub(in crate::diagnosis) fn knot_count(time: &[f64]) -> usize {
    ((time[time.len() - 1] - time[0]) / KNOT_SPACING).ceil() as usize + 1
}

/// A value between knots.
///
/// - `t`: time since the first [s]
pub(in crate::diagnosis) fn between_knots(values: &DVector<f64>, t: f64) -> f64 {
    let x = t / KNOT_SPACING;
    let i = (x as usize).min(values.len() - 2);
    values[i] + (x - i as f64) * (values[i + 1] - values[i])
}

/// Recorded excitation times exp(correction).
pub(in crate::diagnosis) fn corrected(
    time: &[f64],
    excitation: &[Vec<f64>],
    correction: &[DVector<f64>],
) -> Vec<Vec<f64>> {
    let corrected = |(e, w): (&Vec<f64>, &DVector<f64>)| {
        e.iter().zip(time).map(|(e, t)| (e * between_knots(w, t - time[0]).exp()).min(1.0)).collect()
    };
    excitation.iter().zip(correction).map(corrected).collect()
}
