//! Agreement of two methods of measurement.

use super::distributions::{normal_quantile, t_quantile, t_two_sided};
use super::error::{StatisticsError, pairs};
use super::pairwise::mean_and_sd;

/// Bias and limits of agreement.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Agreement {
    /// Number of pairs.
    pub n: usize,
    /// Mean of first minus second.
    pub bias: f64,
    /// Standard deviation of the differences.
    pub sd: f64,
    /// Bias ± z · sd: between them lie, of normal differences, the fraction asked for (95 %: z = 1.96).
    pub limits: [f64; 2],
    /// 95 % interval of the bias.
    pub bias_interval_95: [f64; 2],
    /// 95 % interval of the lower limit.
    pub lower_interval_95: [f64; 2],
    /// 95 % interval of the upper limit.
    pub upper_interval_95: [f64; 2],
    /// Two-sided p-value of "no bias".
    pub p_bias: f64,
    /// Mean of the two measurements of each pair: abscissa of the plot.
    pub means: Vec<f64>,
    /// First minus second: ordinate of the plot.
    pub differences: Vec<f64>,
}

/// Limits of agreement of `first` and `second`.
///
/// - `fraction`: of differences between the limits, usually 0.95
///
/// The standard error of a limit is `sd √(1/n + z²/(2(n − 1)))`.
///
/// # Errors
/// - [`StatisticsError::Length`], [`StatisticsError::NotFinite`], [`StatisticsError::TooFew`]: fewer than two pairs
/// - [`StatisticsError::NoVariation`]: every pair differs by the same amount
/// - [`StatisticsError::OutOfDomain`]: a fraction outside (0, 1)
///
/// # References
/// Bland & Altman (1986), doi:10.1016/S0140-6736(86)90837-8; (1999), doi:10.1177/096228029900800204
pub fn bland_altman(first: &[f64], second: &[f64], fraction: f64) -> Result<Agreement, StatisticsError> {
    pairs(first, second, 2)?;
    if !(fraction > 0.0 && fraction < 1.0) {
        let what = "fraction between the limits of agreement";
        return Err(StatisticsError::OutOfDomain { what, expected: "more than 0 and less than 1", found: fraction });
    }
    let differences: Vec<f64> = first.iter().zip(second).map(|(a, b)| a - b).collect();
    let means = first.iter().zip(second).map(|(a, b)| 0.5 * (a + b)).collect();
    let n = differences.len();
    let (bias, sd) = mean_and_sd(&differences);
    if !(sd > 0.0) {
        return Err(StatisticsError::NoVariation { what: "differences of the pairs" });
    }
    let (count, df) = (n as f64, (n - 1) as f64);
    let z = normal_quantile(0.5 + 0.5 * fraction);
    let t = t_quantile(0.975, df);
    let bias_se = sd / count.sqrt();
    let limit_se = sd * (1.0 / count + z * z / (2.0 * df)).sqrt();
    let around = |centre: f64, se: f64| [centre - t * se, centre + t * se];
    let limits = [bias - z * sd, bias + z * sd];
    Ok(Agreement {
        n,
        bias,
        sd,
        limits,
        bias_interval_95: around(bias, bias_se),
        lower_interval_95: around(limits[0], limit_se),
        upper_interval_95: around(limits[1], limit_se),
        p_bias: t_two_sided(bias / bias_se, df),
        means,
        differences,
    })
}
