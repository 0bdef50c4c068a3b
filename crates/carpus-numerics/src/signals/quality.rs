//! What can be wrong with a recorded channel.

use super::smoothing::savitzky_golay;

/// Frequencies of mains supply \[Hz\].
pub const MAINS_FREQUENCIES_HZ: [f64; 2] = [50.0, 60.0];
/// Harmonics of the mains that are looked at besides the fundamental.
const HIGHEST_HARMONIC: usize = 3;
/// Half width of the neighbourhood that a mains line is compared with \[Hz\].
const NEIGHBOURHOOD_HZ: std::ops::Range<f64> = 4.0..10.0;

/// Half the time that belongs to a sample that stands out \[s\]: an artefact of a switch or a cable is over after that,
/// and slower drift is no part of it.
const OWN_TIME_S: f64 = 0.025;
/// Half the time whose signal a sample is compared with \[s\]: an effort hardly changes within it.
const ABOUT_S: f64 = 0.25;
/// Quantile of the signal's size about a sample that stands for that signal: of noise with normal distribution two
/// standard deviations, and few further artefacts do not move it.
const QUANTILE_ABOUT: f64 = 0.95;
/// Fewest samples that say what the signal about a sample is.
const FEWEST_ABOUT: usize = 20;

/// Beyond which values a channel is worth a look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QualityLimits {
    /// Consecutive samples at the channel's very extreme that count as clipped: by chance an extreme is reached once.
    pub clipped_run: usize,
    /// Fraction of samples in such runs from which clipping is reported.
    pub clipped_fraction: f64,
    /// Fraction of the channel's power in a mains line and its harmonics from which hum is reported.
    pub mains_fraction: f64,
    /// How many times the line has to exceed the power beside it.
    pub mains_prominence: f64,
    /// Excitation (1 = MVC) above which the MVC trials were no maximum.
    pub above_mvc: f64,
    /// How many times a sample has to exceed the signal about it to be an artefact. The largest of a million samples of
    /// normal noise does so 2.5 times, action potentials of single motor units in an effort up to 5 times.
    pub artefact_ratio: f64,
    /// Excitation (1 = MVC) that an artefact has to cause to be worth a look: single motor units stand out of silence,
    /// too.
    pub artefact_excitation: f64,
}

impl Default for QualityLimits {
    fn default() -> Self {
        Self {
            clipped_run: 3,
            clipped_fraction: 1e-3,
            mains_fraction: 0.05,
            mains_prominence: 10.0,
            above_mvc: 1.05,
            artefact_ratio: 8.0,
            artefact_excitation: 0.1,
        }
    }
}

/// What a check of a channel found.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Finding {
    /// There are no samples.
    #[error("no samples")]
    Missing,
    /// Samples that are no numbers.
    #[error("{count} samples are not finite numbers")]
    NotFinite {
        /// How many.
        count: usize,
    },
    /// Every sample is the same: electrode off or channel not connected.
    #[error("the channel is {value} in every sample")]
    Flat {
        /// The sample.
        value: f64,
    },
    /// Samples rest at the extreme of the amplifier's range.
    #[error("clipped: {:.2} % of samples rest at {level} (runs at the extreme)", 100.0 * fraction)]
    Clipped {
        /// The level at which they rest, in the channel's unit.
        level: f64,
        /// Fraction of all samples.
        fraction: f64,
    },
    /// A line of the mains supply.
    #[error("mains hum: {:.0} % of the power is at {frequency_hz} Hz and harmonics", 100.0 * fraction)]
    MainsHum {
        /// Mains frequency \[Hz\].
        frequency_hz: f64,
        /// Fraction of the channel's power (variance) in the line and its harmonics.
        fraction: f64,
    },
    /// A sample or two far beyond the signal about them: not of a muscle.
    #[error("artefact: the sample {after_s:.3} s after the start is {ratio:.0} times as large as the signal about it")]
    Artefact {
        /// Its time since the trial's first sample \[s\].
        after_s: f64,
        /// How many times the size of the signal about it.
        ratio: f64,
    },
    /// Excitation above that of the maximum voluntary contractions.
    #[error("{:.1} % of samples are above MVC, the highest {highest:.2} of it", 100.0 * fraction)]
    AboveMvc {
        /// The highest excitation.
        highest: f64,
        /// Fraction of samples above the limit.
        fraction: f64,
    },
}

/// Checks the raw samples of a channel: missing, flat, clipped, mains hum.
pub fn check_channel(raw: &[f64], sample_rate_hz: f64, limits: &QualityLimits) -> Vec<Finding> {
    let Some(&first) = raw.first() else { return vec![Finding::Missing] };
    let count = raw.iter().filter(|v| !v.is_finite()).count();
    if count > 0 {
        return vec![Finding::NotFinite { count }];
    }
    if raw.iter().all(|v| *v == first) {
        return vec![Finding::Flat { value: first }];
    }
    let (lowest, highest) = raw.iter().fold((first, first), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
    let clipped = [lowest, highest].into_iter().filter_map(|level| {
        let fraction = resting_at(raw, level, limits.clipped_run) as f64 / raw.len() as f64;
        (fraction >= limits.clipped_fraction).then_some(Finding::Clipped { level, fraction })
    });
    let hum = MAINS_FREQUENCIES_HZ.into_iter().filter_map(|frequency_hz| {
        let fraction = mains_fraction(raw, sample_rate_hz, frequency_hz, limits.mains_prominence)?;
        (fraction >= limits.mains_fraction).then_some(Finding::MainsHum { frequency_hz, fraction })
    });
    clipped.chain(hum).collect()
}

/// Checks an excitation (1 = MVC) for values that say that the MVC trials were not the maximum.
pub fn check_excitation(excitation: &[f64], limits: &QualityLimits) -> Option<Finding> {
    let above = excitation.iter().filter(|e| **e > limits.above_mvc).count();
    let highest = excitation.iter().copied().fold(0.0, f64::max);
    (above > 0).then(|| Finding::AboveMvc { highest, fraction: above as f64 / excitation.len() as f64 })
}

/// Checks a raw channel for an artefact that matters: the sample that stands out most, if its envelope is an
/// excitation.
///
/// - `excitation`: the channel's envelope over its level at maximum voluntary contraction, at the same samples
pub fn check_artefact(raw: &[f64], excitation: &[f64], sample_rate_hz: f64, limits: &QualityLimits) -> Option<Finding> {
    let samples = |seconds: f64| (seconds * sample_rate_hz).round().max(1.0) as usize;
    let (own, about) = (samples(OWN_TIME_S), samples(ABOUT_S));
    // Moving mean; at the ends, where the window is cut, a line, which slow drift is there.
    let slow = savitzky_golay(raw, 1, 2 * own + 1).ok()?;
    let size: Vec<f64> = raw.iter().zip(&slow).map(|(x, slow)| (x - slow).abs()).collect();
    let (at, largest) = size.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    let is_about = |k: &usize| k.abs_diff(at) > own;
    let mut others: Vec<f64> =
        (at.saturating_sub(about)..(at + about + 1).min(size.len())).filter(is_about).map(|k| size[k]).collect();
    others.sort_by(f64::total_cmp);
    let usual = *others.get((QUANTILE_ABOUT * others.len() as f64) as usize)?;
    let counts = excitation.get(at).is_some_and(|e| *e >= limits.artefact_excitation);
    let stands_out = others.len() >= FEWEST_ABOUT && *largest > limits.artefact_ratio * usual;
    (counts && stands_out).then(|| Finding::Artefact { after_s: at as f64 / sample_rate_hz, ratio: largest / usual })
}

/// Samples in runs of at least `shortest_run` at exactly `level`.
fn resting_at(x: &[f64], level: f64, shortest_run: usize) -> usize {
    x.chunk_by(|a, b| (*a == level) == (*b == level))
        .filter(|run| run[0] == level && run.len() >= shortest_run.max(1))
        .map(<[f64]>::len)
        .sum()
}

/// Fraction of the power in the line at `frequency_hz` and its harmonics; `None` if the fundamental does not stand out
/// from its neighbourhood, or if the recording is too short or too coarse to tell.
fn mains_fraction(x: &[f64], sample_rate_hz: f64, frequency_hz: f64, prominence: f64) -> Option<f64> {
    // A segment of a second, so that a line within half a hertz of its nominal frequency stays in one bin.
    let length = sample_rate_hz.round() as usize;
    let enough = length >= 16 && x.len() >= length && sample_rate_hz > 2.0 * (frequency_hz + NEIGHBOURHOOD_HZ.end);
    enough.then_some(())?;
    let spectrum = Spectrum::new(x, length, sample_rate_hz);
    let line = spectrum.line(frequency_hz);
    let offsets = (NEIGHBOURHOOD_HZ.start as usize..=NEIGHBOURHOOD_HZ.end as usize).map(|k| k as f64);
    let mut beside: Vec<f64> =
        offsets.flat_map(|k| [spectrum.line(frequency_hz - k), spectrum.line(frequency_hz + k)]).collect();
    beside.sort_by(f64::total_cmp);
    let neighbourhood = beside[beside.len() / 2];
    (line > prominence * neighbourhood && spectrum.variance > 0.0).then_some(())?;
    let harmonics = (2..=HIGHEST_HARMONIC).map(|k| k as f64 * frequency_hz).filter(|f| *f < sample_rate_hz / 2.0);
    let power = line - neighbourhood + harmonics.map(|f| (spectrum.line(f) - neighbourhood).max(0.0)).sum::<f64>();
    Some((power / spectrum.variance).min(1.0))
}

/// Segments of a signal under a Hann window.
struct Spectrum {
    segments: Vec<Vec<f64>>,
    window_sum: f64,
    sample_rate_hz: f64,
    variance: f64,
}

impl Spectrum {
    fn new(x: &[f64], length: usize, sample_rate_hz: f64) -> Self {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let window: Vec<f64> =
            (0..length).map(|i| 0.5 - 0.5 * (2.0 * std::f64::consts::PI * i as f64 / length as f64).cos()).collect();
        let segments = x
            .chunks_exact(length)
            .map(|segment| segment.iter().zip(&window).map(|(x, w)| (x - mean) * w).collect())
            .collect();
        let variance = x.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / x.len() as f64;
        Self { segments, window_sum: window.iter().sum(), sample_rate_hz, variance }
    }

    /// Power of the sinusoid at a frequency (half its squared amplitude), averaged over the segments.
    fn line(&self, frequency_hz: f64) -> f64 {
        let turn = nalgebra::Complex::from_polar(1.0, -2.0 * std::f64::consts::PI * frequency_hz / self.sample_rate_hz);
        let power = |segment: &Vec<f64>| {
            // Horner's rule in the unit phasor: Σ xᵢ turnⁱ.
            let sum = segment
                .iter()
                .rev()
                .fold(nalgebra::Complex::new(0.0, 0.0), |sum: nalgebra::Complex<f64>, x| sum * turn + x);
            2.0 * sum.norm_sqr() / (self.window_sum * self.window_sum)
        };
        self.segments.iter().map(power).sum::<f64>() / self.segments.len() as f64
    }
}
