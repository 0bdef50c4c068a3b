//! Error measures of one trial.

use std::fmt;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A number, or the reason why there is none. In JSON a number or `{"undefined": "<reason>"}`; never NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measure {
    /// The value.
    Defined(f64),
    /// There is none.
    Undefined(Undefined),
}

/// Why a measure has no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Undefined {
    /// `max|τ_exp|` is zero, so that nothing can be divided by it.
    #[error("the measured moment is zero throughout")]
    ZeroMeasuredMoment,
    /// The measured moment never changes, so that it has no variance to explain.
    #[error("the measured moment is constant")]
    ConstantMeasuredMoment,
    /// The simulated moment never changes, so that it has no correlation.
    #[error("the simulated moment is constant")]
    ConstantSimulatedMoment,
    /// The numbers are too large or too small to be squared.
    #[error("beyond the range of floating-point numbers")]
    OutOfFloatRange,
    /// No trial of the group has a value.
    #[error("no trial has a value")]
    NoTrial,
    /// A standard deviation of fewer than two values.
    #[error("fewer than two trials have a value")]
    TooFewTrials,
}

impl Measure {
    /// The value, if there is one.
    pub fn value(self) -> Option<f64> {
        match self {
            Measure::Defined(value) => Some(value),
            Measure::Undefined(_) => None,
        }
    }

    fn finite(value: f64) -> Self {
        if value.is_finite() { Measure::Defined(value) } else { Measure::Undefined(Undefined::OutOfFloatRange) }
    }
}

impl fmt::Display for Measure {
    /// The number, or a dash; the formatter's precision applies.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Measure::Defined(value) => value.fmt(f),
            Measure::Undefined(_) => f.pad("–"),
        }
    }
}

#[derive(Serialize, Deserialize)]
struct UndefinedReason {
    undefined: Undefined,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum MeasureRepr {
    Number(f64),
    Reason(UndefinedReason),
}

impl Serialize for Measure {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            Measure::Defined(value) => serializer.serialize_f64(value),
            Measure::Undefined(undefined) => UndefinedReason { undefined }.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Measure {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match MeasureRepr::deserialize(deserializer)? {
            MeasureRepr::Number(value) if value.is_finite() => Ok(Measure::Defined(value)),
            MeasureRepr::Number(_) => Err(D::Error::custom("expected a finite number")),
            MeasureRepr::Reason(reason) => Ok(Measure::Undefined(reason.undefined)),
        }
    }
}

/// Why two moments cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EvaluationError {
    /// The two have different lengths.
    #[error("measured moment has {measured} samples, simulated moment has {simulated}; expected the same number")]
    LengthMismatch {
        /// Samples of the measured moment.
        measured: usize,
        /// Samples of the simulated moment.
        simulated: usize,
    },
    /// There are no samples.
    #[error("no samples to compare")]
    NoSamples,
    /// A sample is not a finite number.
    #[error("{which} moment is {value} at sample {sample}; expected a finite number [N·m]")]
    NotFinite {
        /// `measured` or `simulated`.
        which: &'static str,
        /// Index of the sample, from 0.
        sample: usize,
        /// Its value.
        value: f64,
    },
}

/// How far a simulated moment τ_sim is from the measured one τ_exp, in one trial of M samples.
///
/// The four measures of Jadelis (2025) (chapter 3, equations 3.1 to 3.4), as printed there:
/// ```text
/// NRMSE     = 1/M Σ sqrt(((τ_exp(m) − τ_sim(m)) / max|τ_exp|)²)      (3.1)
/// Max Error = max|τ_exp − τ_sim| / max|τ_exp|                        (3.2)
/// XCorr     = 1 − Σ τ_exp τ_sim / Σ τ_exp²                           (3.3)
/// J         = NRMSE + Max Error + XCorr                              (3.4)
/// ```
/// Equation 3.1 is called a root mean square there, but the root stands inside the sum: as printed it is the **mean
/// absolute error** over max|τ_exp|. It is computed as printed, here and in the objective; the root mean square over
/// the same maximum is beside it as [`Self::rmse_over_max_moment`]. `XCorr` is negative where the simulated moment
/// is larger than the measured one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorMeasures {
    /// Number of samples M.
    pub samples: usize,
    /// Equation 3.1 \[1\], ≥ 0.
    pub nrmse: Measure,
    /// Equation 3.2 \[1\], ≥ 0.
    pub max_error: Measure,
    /// Equation 3.3 \[1\]: zero-lag cross-correlation term.
    pub xcorr: Measure,
    /// Equation 3.4 \[1\]: the sum of the three.
    pub objective: Measure,
    /// Root mean square of the error [N·m].
    pub rmse_n_m: Measure,
    /// Root mean square of the error over max|τ_exp| \[1\].
    pub rmse_over_max_moment: Measure,
    /// Mean of τ_sim − τ_exp [N·m].
    pub mean_error_n_m: Measure,
    /// Largest |τ_exp − τ_sim| [N·m].
    pub max_abs_error_n_m: Measure,
    /// max|τ_exp| [N·m], by which the normalized measures divide.
    pub max_abs_measured_n_m: f64,
    /// Pearson's correlation coefficient r \[1\], −1 to 1.
    pub pearson_r: Measure,
    /// Coefficient of determination R² = 1 − Σ(τ_exp − τ_sim)² / Σ(τ_exp − mean τ_exp)² \[1\], ≤ 1, negative where the
    /// mean of the measured moment would be the better prediction. Not the square of r.
    pub r_squared: Measure,
}

/// Compares a simulated with a measured moment [N·m], sample by sample.
///
/// # Errors
/// - [`EvaluationError::LengthMismatch`], [`EvaluationError::NoSamples`]
/// - [`EvaluationError::NotFinite`]: a sample is infinite or not a number
pub fn error_measures(measured: &[f64], simulated: &[f64]) -> Result<ErrorMeasures, EvaluationError> {
    validate(measured, simulated)?;
    let samples = measured.len();
    let m = samples as f64;
    let pairs = || measured.iter().zip(simulated);
    let errors = || pairs().map(|(exp, sim)| exp - sim);
    let max_abs = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, |max, v| f64::max(max, v.abs()));

    let largest = max_abs(&mut measured.iter().copied());
    let largest_error = max_abs(&mut errors());
    let over_largest = |value: f64| {
        if largest > 0.0 { Measure::finite(value / largest) } else { Measure::Undefined(Undefined::ZeroMeasuredMoment) }
    };
    let squared_error = sum(errors().map(|e| e * e));
    let rmse = (squared_error / m).sqrt();
    let nrmse = over_largest(sum(errors().map(f64::abs)) / m);
    let max_error = over_largest(largest_error);
    let xcorr = ratio(sum(pairs().map(|(exp, sim)| exp * sim)), sum(measured.iter().map(|v| v * v)), largest);
    let objective = match (nrmse, max_error, xcorr) {
        (Measure::Defined(a), Measure::Defined(b), Measure::Defined(c)) => Measure::finite(a + b + c),
        (a, b, c) => [a, b, c].into_iter().find(|x| x.value().is_none()).unwrap_or(c),
    };

    let (mean_exp, mean_sim) = (sum(measured.iter().copied()) / m, sum(simulated.iter().copied()) / m);
    let variance_exp = sum(measured.iter().map(|v| (v - mean_exp).powi(2)));
    let variance_sim = sum(simulated.iter().map(|v| (v - mean_sim).powi(2)));
    let covariance = sum(pairs().map(|(exp, sim)| (exp - mean_exp) * (sim - mean_sim)));
    let (pearson_r, r_squared) = if is_constant(measured) {
        let undefined = Measure::Undefined(Undefined::ConstantMeasuredMoment);
        (undefined, undefined)
    } else {
        let r = if is_constant(simulated) {
            Measure::Undefined(Undefined::ConstantSimulatedMoment)
        } else {
            // Written so that a perfect simulation has r = 1 exactly, and no product of variances overflows.
            match Measure::finite(covariance / variance_exp * (variance_exp / variance_sim).sqrt()) {
                Measure::Defined(r) => Measure::Defined(r.clamp(-1.0, 1.0)), // rounding may leave the last bit above 1
                undefined => undefined,
            }
        };
        (r, Measure::finite(1.0 - squared_error / variance_exp))
    };
    Ok(ErrorMeasures {
        samples,
        nrmse,
        max_error,
        xcorr,
        objective,
        rmse_n_m: Measure::finite(rmse),
        rmse_over_max_moment: over_largest(rmse),
        mean_error_n_m: Measure::finite(mean_sim - mean_exp),
        max_abs_error_n_m: Measure::finite(largest_error),
        max_abs_measured_n_m: largest,
        pearson_r,
        r_squared,
    })
}

/// `1 − product / square`, undefined if the measured moment is zero.
fn ratio(product: f64, square: f64, largest: f64) -> Measure {
    if largest == 0.0 {
        Measure::Undefined(Undefined::ZeroMeasuredMoment)
    } else if square == 0.0 {
        Measure::Undefined(Undefined::OutOfFloatRange) // squares of denormal numbers
    } else {
        Measure::finite(1.0 - product / square)
    }
}

fn validate(measured: &[f64], simulated: &[f64]) -> Result<(), EvaluationError> {
    if measured.len() != simulated.len() {
        return Err(EvaluationError::LengthMismatch { measured: measured.len(), simulated: simulated.len() });
    }
    if measured.is_empty() {
        return Err(EvaluationError::NoSamples);
    }
    for (which, values) in [("measured", measured), ("simulated", simulated)] {
        if let Some(sample) = values.iter().position(|v| !v.is_finite()) {
            return Err(EvaluationError::NotFinite { which, sample, value: values[sample] });
        }
    }
    Ok(())
}

fn is_constant(values: &[f64]) -> bool {
    values.iter().all(|v| *v == values[0])
}

/// Sum from first to last with Neumaier's compensation: the order is fixed and rounding does not grow with length.
pub(crate) fn sum(values: impl Iterator<Item = f64>) -> f64 {
    let (mut total, mut lost) = (0.0f64, 0.0f64);
    for value in values {
        let next = total + value;
        lost += if total.abs() >= value.abs() { (total - next) + value } else { (value - next) + total };
        total = next;
    }
    if lost.is_finite() { total + lost } else { total }
}
