//! Design of digital Butterworth filters by the bilinear transformation.

use nalgebra::Complex;

use super::error::{SignalError, positive_rate};
use super::sections::{SecondOrderSections, Section};

/// Highest order accepted: beyond it the sections' coefficients lose digits.
const MAX_ORDER: usize = 20;

/// What a filter lets pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Band {
    /// Frequencies below the cutoff.
    LowPass {
        /// Frequency at which the gain has fallen to 1/√2 \[Hz\].
        cutoff_hz: f64,
    },
    /// Frequencies above the cutoff.
    HighPass {
        /// Frequency at which the gain has fallen to 1/√2 \[Hz\].
        cutoff_hz: f64,
    },
    /// Frequencies between two cutoffs.
    BandPass {
        /// Lower frequency at which the gain has fallen to 1/√2 \[Hz\].
        low_hz: f64,
        /// Upper frequency at which the gain has fallen to 1/√2 \[Hz\].
        high_hz: f64,
    },
}

/// A Butterworth filter: gain as flat as an order allows,
///
/// ```text
/// |H(f)|² = 1 / (1 + (f/f_c)^(2 N))          (low pass, before the frequency axis is warped)
/// ```
/// Applied forward and backward ([`SecondOrderSections::filter_zero_phase`]) the phase cancels and the gain is squared:
/// 1/2 at the cutoff.
///
/// # References
/// Oppenheim & Schafer, Discrete-Time Signal Processing, 3rd ed., section 7.2; conventions of `scipy.signal.butter`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Butterworth {
    /// Order `N` of the low-pass prototype. A band-pass has 2 N poles, as in SciPy and MATLAB.
    pub order: usize,
    /// What passes.
    pub band: Band,
}

impl Butterworth {
    /// The filter for signals of `sample_rate_hz`, as a cascade of sections of second order.
    ///
    /// # Errors
    /// - [`SignalError::SampleRate`], [`SignalError::Order`]
    /// - [`SignalError::Cutoff`]: not inside (0, half the sample rate), or a band whose upper edge is not above its
    ///   lower
    pub fn design(&self, sample_rate_hz: f64) -> Result<SecondOrderSections, SignalError> {
        positive_rate(sample_rate_hz)?;
        if !(1..=MAX_ORDER).contains(&self.order) {
            return Err(SignalError::Order { found: self.order, most: MAX_ORDER });
        }
        let warp = |cutoff_hz: f64, above_hz: f64| {
            let nyquist_hz = sample_rate_hz / 2.0;
            if cutoff_hz > above_hz && cutoff_hz < nyquist_hz {
                // The bilinear transformation bends the frequency axis; this bends the cutoff the other way.
                Ok(2.0 * RATE * (std::f64::consts::PI * cutoff_hz / sample_rate_hz).tan())
            } else {
                Err(SignalError::Cutoff { found_hz: cutoff_hz, above_hz, nyquist_hz })
            }
        };
        let prototype = prototype_poles(self.order);
        Ok(match self.band {
            Band::LowPass { cutoff_hz } => {
                let w = warp(cutoff_hz, 0.0)?;
                digital(prototype.iter().map(|p| p * w).collect(), [-1.0, -1.0], 0, w.powi(self.order as i32))
            }
            Band::HighPass { cutoff_hz } => {
                let w = warp(cutoff_hz, 0.0)?;
                digital(prototype.iter().map(|p| w / p).collect(), [1.0, 1.0], self.order, 1.0)
            }
            Band::BandPass { low_hz, high_hz } => {
                let (low, high) = (warp(low_hz, 0.0)?, warp(high_hz, low_hz)?);
                let width = high - low;
                let poles = prototype.iter().flat_map(|p| {
                    let middle = p * (width / 2.0);
                    let apart = (middle * middle - low * high).sqrt();
                    [middle + apart, middle - apart]
                });
                digital(poles.collect(), [1.0, -1.0], self.order, width.powi(self.order as i32))
            }
        })
    }
}

/// Rate of the bilinear transformation; cancels, so any number does. SciPy's choice keeps the same rounding.
const RATE: f64 = 2.0;

/// Poles of the analog low-pass with cutoff 1 rad/s: on the left half of the unit circle.
fn prototype_poles(order: usize) -> Vec<Complex<f64>> {
    (0..order)
        .map(|k| {
            let m = 2.0 * k as f64 + 1.0 - order as f64;
            -Complex::from_polar(1.0, std::f64::consts::PI * m / (2.0 * order as f64))
        })
        .collect()
}

/// Bilinear transformation of an analog filter whose zeros lie at 0 (`n_zeros` of them) or at infinity, and its
/// arrangement in sections.
///
/// - `zeros`: where the two zeros of each section lie in the z-plane; of a section of first order, the first of them
fn digital(poles: Vec<Complex<f64>>, zeros: [f64; 2], n_zeros: usize, gain: f64) -> SecondOrderSections {
    let twice = 2.0 * RATE;
    let denominator: Complex<f64> = poles.iter().map(|p| twice - p).product();
    let gain = gain * (twice.powi(n_zeros as i32) / denominator).re;
    let poles: Vec<Complex<f64>> = poles.iter().map(|p| (twice + p) / (twice - p)).collect();

    let mut sections: Vec<(f64, Section)> = Vec::new();
    let [z1, z2] = zeros;
    let b = [1.0, -(z1 + z2), z1 * z2];
    for p in poles.iter().filter(|p| p.im > 0.0) {
        sections.push((p.norm(), Section { b, a: [-2.0 * p.re, p.norm_sqr()] }));
    }
    let mut real: Vec<f64> = poles.iter().filter(|p| p.im == 0.0).map(|p| p.re).collect();
    real.sort_by(f64::total_cmp);
    for pair in real.chunks(2) {
        sections.push(match *pair {
            [p, q] => (p.abs().max(q.abs()), Section { b, a: [-(p + q), p * q] }),
            _ => (pair[0].abs(), Section { b: [1.0, -z1, 0.0], a: [-pair[0], 0.0] }),
        });
    }
    // The sharpest resonance last, so that it works on a signal that the others have already tamed.
    sections.sort_by(|x, y| x.0.total_cmp(&y.0));
    let mut sections: Vec<Section> = sections.into_iter().map(|(_, section)| section).collect();
    if let Some(first) = sections.first_mut() {
        first.b = first.b.map(|b| b * gain);
    }
    SecondOrderSections::new(sections)
}
