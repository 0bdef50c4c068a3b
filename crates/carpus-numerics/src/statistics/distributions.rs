//! Tails and quantiles of the distributions behind the tests. Central distributions come from `statrs`.

use statrs::function::{beta::beta_reg, erf::erfc, gamma::gamma_ur, gamma::ln_gamma};

use super::quadrature::integral;

/// Probability that a standard normal variable is below `x`.
pub fn normal_cdf(x: f64) -> f64 {
    0.5 * erfc(-x / std::f64::consts::SQRT_2)
}

/// A draw from N(0, 1), made of two draws that are uniform in (0, 1].
///
/// # References
/// Box & Muller (1958), doi:10.1214/aoms/1177706645
pub fn normal_of_uniform([u, v]: [f64; 2]) -> f64 {
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Value below which a standard normal variable is with probability `p` (0 < p < 1).
pub fn normal_quantile(p: f64) -> f64 {
    quantile(p, normal_cdf)
}

/// Probability that Student's t with `df` degrees of freedom (> 0) is below `t`.
pub fn t_cdf(t: f64, df: f64) -> f64 {
    let half_tail = 0.5 * t_two_sided(t, df);
    if t > 0.0 { 1.0 - half_tail } else { half_tail }
}

/// Probability that |t| with `df` degrees of freedom (> 0) is at least as large.
pub fn t_two_sided(t: f64, df: f64) -> f64 {
    match t * t {
        square if square.is_infinite() => 0.0,
        square => beta_reg(df / 2.0, 0.5, df / (df + square)),
    }
}

/// Value below which Student's t with `df` degrees of freedom is with probability `p` (0 < p < 1).
pub fn t_quantile(p: f64, df: f64) -> f64 {
    quantile(p, |t| t_cdf(t, df))
}

/// Probability that F with `df1` and `df2` degrees of freedom (> 0) is at least `f`.
pub fn f_tail(f: f64, df1: f64, df2: f64) -> f64 {
    if f.is_infinite() {
        return 0.0;
    }
    beta_reg(df2 / 2.0, df1 / 2.0, (df2 / (df2 + df1 * f.max(0.0))).min(1.0))
}

/// Probability that χ² with `df` degrees of freedom (> 0) is at least `x`.
pub fn chi_squared_tail(x: f64, df: f64) -> f64 {
    if x <= 0.0 { 1.0 } else { gamma_ur(df / 2.0, x / 2.0) }
}

/// Probability that the noncentral t, `(Z + δ) / √(V/ν)` with Z standard normal and V χ² of ν degrees of freedom, is
/// below `t`.
///
/// ```text
/// P(T ≤ t) = ∫₀^∞ Φ(t u − δ) g(u) du,    g(u) = 2 (ν/2)^(ν/2) / Γ(ν/2) · u^(ν−1) e^(−ν u²/2)    density of √(V/ν)
/// ```
/// - `df`: ν ≥ 1
/// - `noncentrality`: δ
pub fn noncentral_t_cdf(t: f64, df: f64, noncentrality: f64) -> f64 {
    let log_constant = std::f64::consts::LN_2 + 0.5 * df * (0.5 * df).ln() - ln_gamma(0.5 * df);
    let density = |u: f64| (log_constant + (df - 1.0) * u.ln() - 0.5 * df * u * u).exp();
    // √(V/ν) has mean near 1 and standard deviation near 1/√(2ν): beyond 12 of the latter less than 1e-30 is left.
    let reach = 12.0 / df.sqrt();
    integral(|u| normal_cdf(t * u - noncentrality) * density(u), (1.0 - reach).max(0.0), 1.0 + reach, 64)
}

/// Inverse of an increasing distribution function, to the last digits it carries.
fn quantile(p: f64, cdf: impl Fn(f64) -> f64) -> f64 {
    if !(p > 0.0 && p < 1.0) {
        return if p == 0.0 {
            f64::NEG_INFINITY
        } else if p == 1.0 {
            f64::INFINITY
        } else {
            f64::NAN
        };
    }
    let (mut low, mut high) = (-1.0, 1.0);
    while cdf(low) > p {
        low *= 2.0;
    }
    while cdf(high) < p {
        high *= 2.0;
    }
    // Bisection: slow, and safe in tails where the distribution is flat.
    while high - low > 4.0 * f64::EPSILON * f64::max(low.abs(), high.abs()) {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if cdf(middle) < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}
