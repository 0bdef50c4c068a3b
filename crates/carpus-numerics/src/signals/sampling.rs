//! How often a signal was really sampled: one that was put on a faster grid, held or on straight lines between its
//! samples, has fewer samples than rows, and rows that say nothing about its noise.

/// Fewest samples that show a rhythm.
const FEWEST: usize = 10;
/// Share of the distances between samples that have to keep the rhythm: recorders drop a sample now and then, and equal
/// neighbours hide one. Chance keeps it in two thirds at most.
const IN_RHYTHM: f64 = 0.9;
/// From this distance on \[rows\] a sample may stand one row beside its place, as it does where the two rates are no
/// multiples.
const LOOSE_FROM: usize = 4;
/// Most decimals that a signal written with few is looked for.
const MOST_DECIMALS: i32 = 9;
/// Rounding of sums of numbers as large as the signal, relative to its largest.
const ROUNDING: f64 = 1e-12;
/// Bends of lines below this share of the largest corners are none: a curve that was subtracted after interpolation
/// bends the lines by less than 1/5000 of the corners that noise makes, and of recorded noise one bend in a thousand is
/// as small.
const BENT: f64 = 1e-3;

/// One step of a converter of 16 bits, relative to the range that the signal uses: recorders leave more noise than the
/// rounding of such steps.
const CONVERTER: f64 = 1.0 / 65_536.0;
/// Noise of a signal that is nothing but the rounding of its last digit, relative to that rounding.
const ROUNDED: f64 = 1.3;
/// Last digits that are finer than this share of the signal's range are no steps of a recorder: it would have 13 bits
/// of signal and no noise.
const WRITTEN: f64 = 1.0 / 8192.0;
/// From how many rows on noise grows by less than this over twice as many: at the rate of its own samples it does not
/// grow, below twice that rate fourfold and more.
const LEVEL: f64 = 1.8;
/// Noise above this share of the signal's range is no noise but the signal.
const MOST_NOISE: f64 = 0.02;
/// Fewest samples of its own that a smoothed signal is recognized by.
const FEWEST_OWN: usize = 40;

/// How a signal came to its grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Resampled {
    /// Every sample is held until the next.
    Held,
    /// On straight lines between samples.
    Interpolated,
    /// Low-pass filtered, or on smooth curves between samples.
    Smoothed,
}

/// The samples that a signal on a faster grid was made of.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OwnSamples {
    /// What was done to it.
    pub how: Resampled,
    /// Rows at which its own samples stand, or the nearest.
    pub at: Vec<usize>,
    /// Rows from one to the next, on average.
    pub step: f64,
}

/// Recognizes a signal that was held or linearly interpolated to a faster grid of equal steps, by its behaviour alone:
/// the values, or the slopes, change in a rhythm. `None`: every row is a sample of its own, as far as one can see.
pub fn own_samples(x: &[f64]) -> Option<OwnSamples> {
    let largest = x.iter().fold(0.0, |max: f64, v| max.max(v.abs()));
    let unit = written_unit(x);
    held(x, unit).or_else(|| interpolated(x, 2.5 * unit + ROUNDING * largest))
}

/// As [`own_samples`]; also recognizes a signal without the noise of a recorder: one that was low-pass filtered far
/// below half its rate, or put on a faster grid by a smooth curve (spline, sinc). Its own samples are as many a second
/// as have noise of their own.
///
/// Sixth differences hold what is left of noise: they take away all that a person does. Over few rows they are below
/// what even the steps of a good converter leave; over more and more rows they grow, until they are the differences of
/// samples that know nothing of each other, and grow no more. A smooth signal without any noise goes on growing and is
/// not recognized.
pub fn independent_samples(x: &[f64]) -> Option<OwnSamples> {
    own_samples(x).or_else(|| smoothed(x))
}

/// Rows apart from which the samples of a signal without a recorder's noise have noise of their own.
fn smoothed(x: &[f64]) -> Option<OwnSamples> {
    let (lowest, highest) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    let (range, unit) = (highest - lowest, written_unit(x));
    let of_steps = |step: f64| step / 12f64.sqrt();
    let found = white_part(x, 1)?;
    let below_converter = found < of_steps(CONVERTER * range);
    let rounding_alone = found < ROUNDED * of_steps(unit) && unit < WRITTEN * range;
    if !(range > 0.0 && range.is_finite() && (below_converter || rounding_alone)) {
        return None;
    }
    let least = 3.0 * of_steps((CONVERTER * range).max(unit));
    let mut step = 2;
    while x.len() >= FEWEST_OWN * step {
        let noise = white_part(x, step)?;
        if noise > MOST_NOISE * range {
            return None; // the signal itself
        }
        if noise > least && white_part(x, 2 * step)? < LEVEL * noise {
            let at = (0..x.len()).step_by(step).collect();
            return Some(OwnSamples { how: Resampled::Smoothed, at, step: step as f64 });
        }
        step = (step + 1).max(step * 9 / 8);
    }
    None
}

/// Standard deviation of white noise whose differences of sixth order, over so many rows each, are as large as those of
/// a signal (median). `None`: the signal is too short.
fn white_part(x: &[f64], rows: usize) -> Option<f64> {
    const BINOMIAL: [f64; 7] = [1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0];
    /// Sum of their squares: what differences make of the variance of white noise.
    const GAIN: f64 = 924.0;
    /// Median of |N(0, 1)|.
    const MEDIAN_ABSOLUTE_NORMAL: f64 = 0.674_489_750_196_081_7;
    /// Differences that are looked at: their median is known to a hundredth.
    const MOST: usize = 20_000;
    let n = x.len().checked_sub(6 * rows).filter(|n| *n >= 2 * FEWEST)?;
    let difference = |k: usize| BINOMIAL.iter().enumerate().map(|(i, c)| c * x[k + i * rows]).sum::<f64>().abs();
    let mut sizes: Vec<f64> = (0..n).step_by(n.div_ceil(MOST)).map(difference).collect();
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*median / (MEDIAN_ABSOLUTE_NORMAL * GAIN.sqrt()))
}

/// Values that change every so many rows, by more than the resolution they are written with: a slow ramp of few digits
/// changes in a rhythm, too, but by one digit a time.
fn held(x: &[f64], unit: f64) -> Option<OwnSamples> {
    let changes: Vec<usize> = (1..x.len()).filter(|&k| x[k] != x[k - 1]).collect();
    let mut jumps: Vec<f64> = changes.iter().map(|&k| (x[k] - x[k - 1]).abs()).collect();
    jumps.sort_by(f64::total_cmp);
    let median = *jumps.get(jumps.len() / 2)?;
    (median > 1.5 * unit).then(|| in_rhythm(changes, Resampled::Held)).flatten()
}

/// Slopes that change every so many rows.
///
/// - `tolerance`: second differences of straight lines as they are written
fn interpolated(x: &[f64], tolerance: f64) -> Option<OwnSamples> {
    let bend = |k: usize| (x[k + 1] - 2.0 * x[k] + x[k - 1]).abs();
    let rows = 1..x.len().saturating_sub(1);
    let mut sizes: Vec<f64> = rows.clone().map(bend).collect();
    sizes.sort_by(f64::total_cmp);
    let corner = sizes.len().checked_sub(FEWEST).map(|k| sizes[k])?;
    let tolerance = tolerance.max(BENT * corner);
    let bends = rows.filter(|&k| bend(k) > tolerance);
    // A sample between two rows bends the line at both.
    let mut corners: Vec<usize> = Vec::new();
    let mut last = None;
    for k in bends {
        if last.is_none_or(|last| k > last + 1) {
            corners.push(k);
        }
        last = Some(k);
    }
    in_rhythm(corners, Resampled::Interpolated)
}

/// Samples at these rows, if they stand in a rhythm of at least two rows.
fn in_rhythm(at: Vec<usize>, how: Resampled) -> Option<OwnSamples> {
    let gaps: Vec<usize> = at.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if gaps.len() < FEWEST {
        return None;
    }
    let mut sorted = gaps.clone();
    sorted.sort_unstable();
    let usual = sorted[sorted.len() / 2];
    // Straight lines need a row without a bend between two with one, and a sample between rows makes two of these.
    let least = if how == Resampled::Held { 2 } else { 3 };
    let slack = usize::from(usual >= LOOSE_FROM);
    let times = |gap: usize| (gap + usual / 2) / usual;
    let keeps = |gap: &&usize| times(**gap) > 0 && gap.abs_diff(times(**gap) * usual) <= slack;
    let kept = gaps.iter().filter(keeps).count();
    if usual < least || (kept as f64) < IN_RHYTHM * gaps.len() as f64 {
        return None;
    }
    let samples: usize = gaps.iter().map(|gap| times(*gap).max(1)).sum();
    let step = (at[at.len() - 1] - at[0]) as f64 / samples as f64;
    Some(OwnSamples { how, at, step })
}

/// Unit of the last decimal that the values are written with; 0 if they have more than [`MOST_DECIMALS`].
fn written_unit(x: &[f64]) -> f64 {
    let has_few = |decimals: &i32| {
        let scale = 10f64.powi(*decimals);
        x.iter().all(|v| ((v * scale).round() - v * scale).abs() < 1e-4)
    };
    (0..=MOST_DECIMALS).find(has_few).map_or(0.0, |decimals| 10f64.powi(-decimals))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uniform numbers from −1 to 1.
    fn noise(n: usize) -> Vec<f64> {
        let mut state = 7u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 30) as f64 - 1.0
        };
        (0..n).map(|_| next()).collect()
    }

    /// A torque of 100 Hz over four seconds, noise and effort.
    fn torque() -> Vec<f64> {
        noise(401).iter().enumerate().map(|(k, e)| 3.0 * (0.02 * k as f64).sin() + 0.05 * e).collect()
    }

    /// On a grid of `ratio` rows a sample that begins `shift` rows late.
    fn resampled(how: Resampled, ratio: f64, shift: f64) -> Vec<f64> {
        let torque = torque();
        let rows = ((torque.len() - 2) as f64 * ratio) as usize;
        let value = |k: usize| {
            let place = (k as f64 + shift) / ratio;
            let before = place as usize;
            let change = torque[before + 1] - torque[before];
            if how == Resampled::Held { torque[before] } else { torque[before] + change * (place - before as f64) }
        };
        (0..rows).map(value).collect()
    }

    fn rounded(x: &[f64], decimals: i32) -> Vec<f64> {
        let scale = 10f64.powi(decimals);
        x.iter().map(|v| (v * scale).round() / scale).collect()
    }

    #[test]
    fn verif_held_and_interpolated_signals_are_recognized_at_any_ratio() {
        for how in [Resampled::Held, Resampled::Interpolated] {
            for (ratio, shift) in [(20.0, 0.0), (20.0, 0.4), (10.0, 0.3), (33.3, 0.0), (5.0, 0.0)] {
                let x = resampled(how, ratio, shift);
                for x in [x.clone(), rounded(&x, 5), rounded(&x, 4)] {
                    let found = own_samples(&x).unwrap_or_else(|| panic!("{how:?} {ratio} {shift}"));
                    assert_eq!(found.how, how);
                    assert!((found.step / ratio - 1.0).abs() < 0.02, "{how:?} {ratio} {shift}: {}", found.step);
                }
            }
        }
        assert_eq!(own_samples(&resampled(Resampled::Held, 2.0, 0.0)).map(|f| f.how), Some(Resampled::Held));
    }

    /// A torque of 100 Hz on a grid of `ratio` rows a sample, by cubic curves through the samples (Catmull and Rom).
    fn on_cubics(torque: &[f64], ratio: usize) -> Vec<f64> {
        let curve = |k: usize| {
            let (i, t) = (1 + k / ratio, (k % ratio) as f64 / ratio as f64);
            let [a, b, c, d] = [torque[i - 1], torque[i], torque[i + 1], torque[i + 2]];
            b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
        };
        (0..(torque.len() - 3) * ratio).map(curve).collect()
    }

    #[test]
    fn verif_smooth_signals_are_recognized_by_the_noise_that_they_lack() {
        let long: Vec<f64> =
            noise(1001).iter().enumerate().map(|(k, e)| 3.0 * (0.02 * k as f64).sin() + 0.05 * e).collect();
        for ratio in [10, 20, 33] {
            let x = on_cubics(&long, ratio);
            for x in [x.clone(), rounded(&x, 6), rounded(&x, 4)] {
                let found = independent_samples(&x).unwrap_or_else(|| panic!("{ratio}"));
                assert_eq!(found.how, Resampled::Smoothed);
                assert!((0.7..1.1).contains(&(found.step / ratio as f64)), "{ratio}: {}", found.step);
            }
        }
        // 1000 Hz, low-passed at 20 Hz there and back: 40 samples a second are independent.
        let x: Vec<f64> =
            noise(10_000).iter().enumerate().map(|(k, e)| 3.0 * (0.002 * k as f64).sin() + 0.05 * e).collect();
        let filter = crate::signals::Butterworth { order: 4, band: crate::signals::Band::LowPass { cutoff_hz: 20.0 } };
        let smooth = filter.design(1000.0).unwrap().filter_zero_phase(&x).unwrap();
        for x in [smooth.clone(), rounded(&smooth, 5)] {
            let found = independent_samples(&x).unwrap();
            assert!((12.0..40.0).contains(&found.step), "{}", found.step);
        }
        assert_eq!(independent_samples(&x), None);
        // Straight lines remain what they are; what never had noise has no rate of its own.
        let lines = resampled(Resampled::Interpolated, 20.0, 0.0);
        assert_eq!(independent_samples(&lines), own_samples(&lines));
        let quiet: Vec<f64> = (0..4000).map(|k| 3.0 * (1e-3 * f64::from(k)).sin()).collect();
        for decimals in [12, 6, 4, 3] {
            assert_eq!(independent_samples(&rounded(&quiet, decimals)), None, "{decimals}");
            assert_eq!(independent_samples(&rounded(&x, decimals)), None, "{decimals}");
        }
    }

    #[test]
    fn verif_recorded_signals_are_left_as_they_are() {
        let slow: Vec<f64> = (0..4000).map(|k| 3.0 * (1e-3 * f64::from(k)).sin()).collect();
        let ramp: Vec<f64> = (0..4000).map(|k| 1e-3 * f64::from(k)).collect();
        let recorded: Vec<f64> = slow.iter().zip(noise(4000)).map(|(s, e)| s + 0.02 * e).collect();
        let triangle: Vec<f64> = (0..4000).map(|k| (f64::from(k % 1000) - 500.0).abs()).collect();
        for x in [&torque(), &slow, &ramp, &recorded, &triangle, &vec![0.0; 500], &vec![1.5; 3], &Vec::new()] {
            assert_eq!(own_samples(x), None);
            // A machine of few digits: quiet signals stay at one for a while, ramps change in a rhythm.
            for decimals in 1..4 {
                assert_eq!(own_samples(&rounded(x, decimals)), None, "{decimals}");
            }
        }
    }
}
