//! Pearson's correlation and the straight line of least squares.

use super::distributions::{normal_quantile, t_quantile, t_two_sided};
use super::error::{StatisticsError, pairs};

/// Pearson's product-moment correlation.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Correlation {
    /// r, −1 to 1.
    pub r: f64,
    /// Number of pairs.
    pub n: usize,
    /// Two-sided p-value of "no correlation", from t with n − 2 degrees of freedom.
    pub p_value: f64,
    /// 95 % interval by Fisher's z; `None` for fewer than four pairs.
    pub interval_95: Option<[f64; 2]>,
}

/// The line `y = intercept + slope · x`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LinearRegression {
    /// Change of y per unit of x.
    pub slope: f64,
    /// y at x = 0.
    pub intercept: f64,
    /// Standard error of the slope.
    pub slope_standard_error: f64,
    /// Standard error of the intercept.
    pub intercept_standard_error: f64,
    /// 95 % interval of the slope.
    pub slope_interval_95: [f64; 2],
    /// Standard deviation of the residuals, with n − 2.
    pub residual_sd: f64,
    /// Fraction of y's variance that the line explains.
    pub r_squared: f64,
    /// Two-sided p-value of "slope 0".
    pub p_value: f64,
    /// Number of pairs.
    pub n: usize,
}

/// Sums about the means.
struct Moments {
    mean_x: f64,
    mean_y: f64,
    xx: f64,
    yy: f64,
    xy: f64,
}

impl Moments {
    fn new(x: &[f64], y: &[f64]) -> Result<Self, StatisticsError> {
        pairs(x, y, 3)?;
        let n = x.len() as f64;
        let (mean_x, mean_y) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
        let sum = |f: &dyn Fn(f64, f64) -> f64| x.iter().zip(y).map(|(a, b)| f(a - mean_x, b - mean_y)).sum::<f64>();
        let moments = Self { mean_x, mean_y, xx: sum(&|a, _| a * a), yy: sum(&|_, b| b * b), xy: sum(&|a, b| a * b) };
        if !(moments.xx > 0.0) {
            return Err(StatisticsError::NoVariation { what: "values of x" });
        }
        Ok(moments)
    }
}

/// Pearson's correlation of two lists.
///
/// # Errors
/// [`StatisticsError::Length`], [`StatisticsError::NotFinite`], [`StatisticsError::TooFew`] (three pairs at least),
/// [`StatisticsError::NoVariation`].
pub fn pearson(x: &[f64], y: &[f64]) -> Result<Correlation, StatisticsError> {
    let m = Moments::new(x, y)?;
    if !(m.yy > 0.0) {
        return Err(StatisticsError::NoVariation { what: "values of y" });
    }
    let n = x.len();
    let r = (m.xy / (m.xx.sqrt() * m.yy.sqrt())).clamp(-1.0, 1.0);
    let df = (n - 2) as f64;
    let t = r * (df / ((1.0 - r) * (1.0 + r))).sqrt();
    let interval_95 = (n > 3).then(|| {
        let reach = normal_quantile(0.975) / ((n - 3) as f64).sqrt();
        [(r.atanh() - reach).tanh(), (r.atanh() + reach).tanh()]
    });
    Ok(Correlation { r, n, p_value: t_two_sided(t, df), interval_95 })
}

/// The line of least squares.
///
/// # Errors
/// As [`pearson`], except that constant y is allowed.
pub fn linear_regression(x: &[f64], y: &[f64]) -> Result<LinearRegression, StatisticsError> {
    let m = Moments::new(x, y)?;
    let n = x.len();
    let df = (n - 2) as f64;
    let slope = m.xy / m.xx;
    let intercept = m.mean_y - slope * m.mean_x;
    let residual: f64 = x.iter().zip(y).map(|(a, b)| (b - intercept - slope * a).powi(2)).sum();
    let residual_sd = (residual / df).sqrt();
    let slope_standard_error = residual_sd / m.xx.sqrt();
    let intercept_standard_error = residual_sd * (1.0 / n as f64 + m.mean_x * m.mean_x / m.xx).sqrt();
    let reach = t_quantile(0.975, df) * slope_standard_error;
    let r_squared = if m.yy > 0.0 { (m.xy / m.xx.sqrt() / m.yy.sqrt()).powi(2).min(1.0) } else { 0.0 };
    // A flat line through constant values: 0/0, no evidence of a slope.
    let p_value = if m.yy > 0.0 { t_two_sided(slope / slope_standard_error, df) } else { 1.0 };
    Ok(LinearRegression {
        slope,
        intercept,
        slope_standard_error,
        intercept_standard_error,
        slope_interval_95: [slope - reach, slope + reach],
        residual_sd,
        r_squared,
        p_value,
        n,
    })
}
