//! Comparisons of two conditions measured on the same participants.

use super::distributions::{t_quantile, t_two_sided};
use super::error::{StatisticsError, pairs};

/// A paired t-test.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PairedT {
    /// Mean of first minus second.
    pub mean_difference: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// t statistic.
    pub t: f64,
    /// Degrees of freedom.
    pub df: usize,
    /// Two-sided p-value, uncorrected.
    pub p_value: f64,
    /// Cohen's d_z: mean difference over the standard deviation of the differences. What a power analysis of the
    /// paired test needs.
    pub cohen_d_z: f64,
    /// Cohen's d_av: mean difference over the root mean square of the two standard deviations.
    pub cohen_d_av: f64,
}

/// Two conditions of several, compared.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Comparison {
    /// Name of the first condition.
    pub first: String,
    /// Name of the second condition.
    pub second: String,
    /// The test.
    pub test: PairedT,
    /// p-value times the number of comparisons, at most 1.
    pub p_bonferroni: f64,
    /// Simultaneous 95 % interval of the mean difference (each at 1 − 0.05/comparisons).
    pub interval_95: [f64; 2],
}

/// The t-test of `first − second`.
///
/// # Errors
/// - [`StatisticsError::Length`], [`StatisticsError::NotFinite`], [`StatisticsError::TooFew`]: fewer than two pairs
/// - [`StatisticsError::NoVariation`]: every pair differs by the same amount
pub fn paired_t_test(first: &[f64], second: &[f64]) -> Result<PairedT, StatisticsError> {
    pairs(first, second, 2)?;
    let differences: Vec<f64> = first.iter().zip(second).map(|(a, b)| a - b).collect();
    let n = differences.len() as f64;
    let (mean_difference, sd) = mean_and_sd(&differences);
    if !(sd > 0.0) {
        return Err(StatisticsError::NoVariation { what: "differences of the pairs" });
    }
    let standard_error = sd / n.sqrt();
    let t = mean_difference / standard_error;
    let df = differences.len() - 1;
    let pooled = (0.5 * (mean_and_sd(first).1.powi(2) + mean_and_sd(second).1.powi(2))).sqrt();
    Ok(PairedT {
        mean_difference,
        standard_error,
        t,
        df,
        p_value: t_two_sided(t, df as f64),
        cohen_d_z: mean_difference / sd,
        cohen_d_av: mean_difference / pooled,
    })
}

/// All pairs of conditions, with Bonferroni's correction for their number.
///
/// - `conditions`: their names
/// - `rows`: one row a participant, one value per condition
///
/// # Errors
/// Those of [`paired_t_test`]; [`StatisticsError::Length`] for a row of another length.
pub fn pairwise_comparisons(conditions: &[String], rows: &[Vec<f64>]) -> Result<Vec<Comparison>, StatisticsError> {
    for row in rows {
        if row.len() != conditions.len() {
            let what = "values of a participant (one per condition)";
            return Err(StatisticsError::Length { what, expected: conditions.len(), found: row.len() });
        }
    }
    let column = |j: usize| -> Vec<f64> { rows.iter().map(|row| row[j]).collect() };
    let count = conditions.len() * conditions.len().saturating_sub(1) / 2;
    let mut comparisons = Vec::with_capacity(count);
    for i in 0..conditions.len() {
        for j in i + 1..conditions.len() {
            let test = paired_t_test(&column(i), &column(j))?;
            let reach = t_quantile(1.0 - 0.025 / count as f64, test.df as f64) * test.standard_error;
            comparisons.push(Comparison {
                first: conditions[i].clone(),
                second: conditions[j].clone(),
                test,
                p_bonferroni: bonferroni(test.p_value, count),
                interval_95: [test.mean_difference - reach, test.mean_difference + reach],
            });
        }
    }
    Ok(comparisons)
}

/// Bonferroni's correction of one p-value among `comparisons`.
pub fn bonferroni(p_value: f64, comparisons: usize) -> f64 {
    (p_value * comparisons as f64).min(1.0)
}

/// Mean, and standard deviation with n − 1.
pub(super) fn mean_and_sd(x: &[f64]) -> (f64, f64) {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let variance = x.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
    (mean, variance.sqrt())
}
