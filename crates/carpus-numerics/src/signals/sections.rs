//! Recursive filters as cascades of sections of second order, applied forward or forward and backward.

use super::error::{SignalError, finite};

/// One section, `H(z) = (b₀ + b₁ z⁻¹ + b₂ z⁻²) / (1 + a₁ z⁻¹ + a₂ z⁻²)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// `b₀, b₁, b₂`.
    pub b: [f64; 3],
    /// `a₁, a₂`; `a₀` is 1.
    pub a: [f64; 2],
}

impl Section {
    /// Gain at frequency zero.
    fn dc_gain(&self) -> f64 {
        self.b.iter().sum::<f64>() / (1.0 + self.a[0] + self.a[1])
    }

    /// State after an endless input of 1.
    fn step_state(&self) -> [f64; 2] {
        let gain = self.dc_gain();
        let second = self.b[2] - self.a[1] * gain;
        [self.b[1] - self.a[0] * gain + second, second]
    }

    /// Filters in place (transposed direct form II).
    fn apply(&self, x: &mut [f64], mut state: [f64; 2]) {
        for sample in x {
            let input = *sample;
            let output = self.b[0] * input + state[0];
            state[0] = self.b[1] * input - self.a[0] * output + state[1];
            state[1] = self.b[2] * input - self.a[1] * output;
            *sample = output;
        }
    }
}

/// A cascade of sections.
#[derive(Clone, Debug, PartialEq)]
pub struct SecondOrderSections {
    sections: Vec<Section>,
}

impl SecondOrderSections {
    /// A cascade; the signal goes through the sections in their order.
    pub fn new(sections: Vec<Section>) -> Self {
        Self { sections }
    }

    /// The sections.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// Magnitude of the frequency response of one pass at `frequency_hz`.
    pub fn gain(&self, frequency_hz: f64, sample_rate_hz: f64) -> f64 {
        let w = 2.0 * std::f64::consts::PI * frequency_hz / sample_rate_hz;
        let z = |k: f64| nalgebra::Complex::from_polar(1.0, -k * w);
        let response = |s: &Section| {
            let numerator = s.b[0] + s.b[1] * z(1.0) + s.b[2] * z(2.0);
            (numerator / (1.0 + s.a[0] * z(1.0) + s.a[1] * z(2.0))).norm()
        };
        self.sections.iter().map(response).product()
    }

    /// Samples by which [`Self::filter_zero_phase`] lengthens a signal at each end: SciPy's default `padlen`.
    pub fn edge(&self) -> usize {
        let first_order = |s: &&Section| s.b[2] == 0.0 && s.a[1] == 0.0;
        3 * (2 * self.sections.len() + 1 - self.sections.iter().filter(first_order).count())
    }

    /// One pass forward, from rest.
    pub fn filter(&self, x: &[f64]) -> Vec<f64> {
        let mut y = x.to_vec();
        for section in &self.sections {
            section.apply(&mut y, [0.0; 2]);
        }
        y
    }

    /// One pass forward and one backward: no delay, gain squared.
    ///
    /// The signal is first continued at both ends by its point reflection (`padtype = "odd"`) over [`Self::edge`]
    /// samples, and each pass starts in the steady state of its first sample: the semantics of
    /// `scipy.signal.sosfiltfilt` with default arguments. (`filtfilt` of the same filter differs by rounding, some
    /// 1e-11.)
    ///
    /// # Errors
    /// - [`SignalError::TooShort`]: not more samples than [`Self::edge`]
    /// - [`SignalError::NotFinite`]: the filter would spread a NaN over the whole signal
    pub fn filter_zero_phase(&self, x: &[f64]) -> Result<Vec<f64>, SignalError> {
        let (n, edge) = (x.len(), self.edge());
        if n <= edge {
            return Err(SignalError::TooShort { found: n, expected: edge + 1 });
        }
        finite(x)?;
        let mut y = Vec::with_capacity(n + 2 * edge);
        y.extend((1..=edge).rev().map(|i| 2.0 * x[0] - x[i]));
        y.extend_from_slice(x);
        y.extend((1..=edge).map(|i| 2.0 * x[n - 1] - x[n - 1 - i]));
        for _pass in 0..2 {
            self.filter_from_steady_state(&mut y);
            y.reverse();
        }
        Ok(y[edge..edge + n].to_vec())
    }

    fn filter_from_steady_state(&self, x: &mut [f64]) {
        let mut level = x.first().copied().unwrap_or(0.0);
        for section in &self.sections {
            section.apply(x, section.step_state().map(|s| s * level));
            level *= section.dc_gain();
        }
    }
}
