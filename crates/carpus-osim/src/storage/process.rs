//! What OpenSim's tools do with a storage before they use it.

use super::table::Storage;
use crate::functions::{Function, FunctionError};
use crate::osim::spec::FunctionSpec;

/// Most rows that resampling makes (`MAX_RESAMPLE_SIZE`).
const MOST_ROWS: f64 = 100_000.0;

/// Interpolating spline of odd degree through points, as `GCVSplineSet` makes it for columns of a storage.
///
/// # Errors
/// Too few points, or times that do not ascend.
pub fn spline(degree: usize, time: &[f64], values: &[f64]) -> Result<Function, FunctionError> {
    Function::compile(&FunctionSpec::GcvSpline {
        half_order: degree.div_ceil(2),
        error_variance: 0.0,
        x: time.to_vec(),
        y: values.to_vec(),
        weights: vec![1.0; time.len()],
    })
}

impl Storage {
    /// Extends the data at both ends by `size` rows of its own, mirrored about the end points, so that values and
    /// slopes go on (`Storage::pad`, `Signal::Pad`).
    pub fn pad(&mut self, size: usize) {
        let size = size.min(self.len().saturating_sub(1));
        if size == 0 {
            return;
        }
        self.time = padded(&self.time, size);
        self.lines.clear();
        let columns: Vec<Vec<f64>> = (0..self.labels.len()).map(|i| padded(&self.column(i), size)).collect();
        self.rows = (0..self.time.len()).map(|r| columns.iter().map(|c| c[r]).collect()).collect();
    }

    /// Filters every column by a low-pass Butterworth filter of third order, forward and backward
    /// (`Storage::lowpassIIR`). Rows at uneven times are first resampled at the smallest interval by splines of degree
    /// 5.
    ///
    /// # Errors
    /// Splines that cannot be made.
    pub fn lowpass(&mut self, cutoff_hz: f64) -> Result<(), FunctionError> {
        let n = self.len();
        if n < 4 {
            return Ok(());
        }
        let mut step = self.time.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
        if step < f64::EPSILON {
            return Ok(());
        }
        let mean = (self.time[n - 1] - self.time[0]) / (n - 1) as f64;
        if mean - step > f64::EPSILON {
            step = self.resample(step, 5)?;
        }
        for i in 0..self.labels.len() {
            let filtered = lowpass(step, cutoff_hz, &self.column(i));
            self.rows.iter_mut().zip(filtered).for_each(|(row, value)| row[i] = value);
        }
        Ok(())
    }

    /// Rows at even times by interpolating splines (`Storage::resample`).
    ///
    /// # Errors
    /// Splines that cannot be made.
    pub fn resample(&mut self, step: f64, degree: usize) -> Result<f64, FunctionError> {
        let n = self.len();
        if n <= 1 {
            return Ok(step);
        }
        let (first, last) = (self.time[0], self.time[n - 1]);
        let step = if (last - first) / step > MOST_ROWS { (last - first) / MOST_ROWS } else { step };
        let splines: Vec<Function> = self.splines(degree)?;
        let mut time = first;
        self.time.clear();
        self.lines.clear();
        // A step below the rounding of a late time would never arrive.
        while time <= last && self.time.last() != Some(&time) && self.time.len() <= MOST_ROWS as usize {
            self.time.push(time);
            time += step;
        }
        self.rows = self.time.iter().map(|t| splines.iter().map(|s| s.value(*t)).collect()).collect();
        Ok(step)
    }

    /// Interpolating splines of odd degree through every column.
    ///
    /// # Errors
    /// Too few rows.
    pub fn splines(&self, degree: usize) -> Result<Vec<Function>, FunctionError> {
        // A spline of degree 5 needs 6 points; with fewer, the highest odd degree that they allow.
        let most =
            if self.len().is_multiple_of(2) { self.len().saturating_sub(1) } else { self.len().saturating_sub(2) };
        let degree = degree.min(most.max(1));
        (0..self.labels.len()).map(|i| spline(degree, &self.time, &self.column(i))).collect()
    }
}

fn padded(x: &[f64], size: usize) -> Vec<f64> {
    let (first, last) = (x[0], x[x.len() - 1]);
    let before = (1..=size).rev().map(|i| 2.0 * first - x[i]);
    let after = (1..=size).map(|i| 2.0 * last - x[x.len() - 1 - i]);
    before.chain(x.iter().copied()).chain(after).collect()
}

/// `Signal::LowpassIIR`: its coefficients and its start, forward and backward.
pub(crate) fn lowpass(step: f64, cutoff_hz: f64, signal: &[f64]) -> Vec<f64> {
    let rate = 1.0 / step;
    let cutoff = if cutoff_hz >= 0.5 * rate { 0.49 * rate } else { cutoff_hz };
    let wa = (std::f64::consts::TAU * cutoff * step / 2.0).tan();
    let (wa2, wa3) = (wa * wa, wa * wa * wa);
    let denominator = (wa + 1.0) * (wa * wa + wa + 1.0);
    let a = [wa3, 3.0 * wa3, 3.0 * wa3, wa3].map(|c| c / denominator);
    let b = [
        (3.0 * wa3 + 2.0 * wa2 - 2.0 * wa - 3.0) / denominator,
        (3.0 * wa3 - 2.0 * wa2 - 2.0 * wa + 3.0) / denominator,
        (wa - 1.0) * (wa2 - wa + 1.0) / denominator,
    ];
    let pass = |x: &[f64]| {
        let mut y = x.to_vec();
        for i in 3..x.len() {
            y[i] = a[0] * x[i] + a[1] * x[i - 1] + a[2] * x[i - 2] + a[3] * x[i - 3]
                - b[0] * y[i - 1]
                - b[1] * y[i - 2]
                - b[2] * y[i - 3];
        }
        y.reverse();
        y
    };
    pass(&pass(signal))
}
