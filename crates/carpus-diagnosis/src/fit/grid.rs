//! Blocks of samples that residuals are averaged over, and knots of the EMG's noise.

use nalgebra::DVector;

use crate::noise::KNOT_SPACING;

/// Blocks that the samples of a trial are averaged to, if there are as many …
const BLOCKS: usize = 80;
/// … and in trials in which they would be longer than this [s], more …
const LONGEST: f64 = 0.0625;
/// … up to so many.
const MOST_BLOCKS: usize = 400;

/// Start of every block of samples, and the end.
pub fn block_starts(time: &[f64]) -> Vec<usize> {
    let samples = time.len();
    let wanted = (time[samples - 1] - time[0]) / LONGEST;
    let blocks = samples.min((wanted as usize).clamp(BLOCKS, MOST_BLOCKS));
    (0..=blocks).map(|b| b * samples / blocks).collect()
}

/// Mean of a series over every block of samples.
pub fn block_means(series: &[f64], starts: &[usize]) -> DVector<f64> {
    DVector::from_iterator(
        starts.len() - 1,
        starts.windows(2).map(|w| series[w[0]..w[1]].iter().sum::<f64>() / (w[1] - w[0]) as f64),
    )
}

pub(crate) fn knot_count(time: &[f64]) -> usize {
    ((time[time.len() - 1] - time[0]) / KNOT_SPACING).ceil() as usize + 1
}

/// Memory that a fit takes for the noise of a trial [bytes]: what the logarithm of every muscle's excitation does on
/// every knot in every block, three times over; and with envelopes, which a diagnosis estimates, two covariances of all
/// knots for every muscle.
///
/// - `time`: of the samples [s]
pub fn memory_of_noise(time: &[f64], muscles: usize, with_envelopes: bool) -> f64 {
    const NUMBER: f64 = 8.0;
    let (blocks, knots) = (block_starts(time).len() as f64, knot_count(time) as f64);
    let of_muscle = 3.0 * blocks * knots + if with_envelopes { 2.0 * knots * knots } else { 0.0 };
    NUMBER * of_muscle * muscles as f64
}

/// A value between knots.
///
/// - `t`: time since the first [s]
pub(crate) fn between_knots(values: &DVector<f64>, t: f64) -> f64 {
    let x = t / KNOT_SPACING;
    let i = (x as usize).min(values.len() - 2);
    values[i] + (x - i as f64) * (values[i + 1] - values[i])
}

/// Width of the bend by which excitations come to rest below 1, of their logarithm.
const BEND: f64 = 0.02;

/// An excitation below 1: `e (1 + e^(1/β))^-β`, β = 0.02. Muscles are not excited by more than 1, and a correction that
/// would ask for more must see that it changes nothing.
fn bounded(excitation: f64) -> f64 {
    excitation * (1.0 + excitation.powf(1.0 / BEND)).powf(-BEND)
}

/// Of an excitation that is [`bounded`], the derivative of its logarithm by that of the excitation.
pub(crate) fn slope_of_bounded(bounded: f64) -> f64 {
    1.0 - bounded.min(1.0).powf(1.0 / BEND)
}

/// Recorded excitation times exp(correction), below 1.
pub(crate) fn corrected(time: &[f64], excitation: &[Vec<f64>], correction: &[DVector<f64>]) -> Vec<Vec<f64>> {
    let corrected = |(e, w): (&Vec<f64>, &DVector<f64>)| {
        e.iter().zip(time).map(|(e, t)| bounded(e * between_knots(w, t - time[0]).exp())).collect()
    };
    excitation.iter().zip(correction).map(corrected).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_slope_of_bounded_is_its_derivative() {
        for log in [-3.0, -0.2, -0.05, -0.01, 0.0, 0.01, 0.05, 0.3_f64] {
            let at = |x: f64| bounded(x.exp()).ln();
            let difference = (at(log + 1e-6) - at(log - 1e-6)) / 2e-6;
            let slope = slope_of_bounded(bounded(log.exp()));
            assert!((slope - difference).abs() < 1e-6, "{log}: {slope}, {difference}");
        }
    }

    #[test]
    fn verif_excitations_stay_below_one_and_small_ones_as_they_are() {
        assert!(bounded(1.6) < 1.0 + 1e-12 && bounded(1.0) < 1.0);
        assert!((bounded(0.8) - 0.8).abs() < 1e-6);
        assert_eq!(bounded(0.0), 0.0);
    }
}
