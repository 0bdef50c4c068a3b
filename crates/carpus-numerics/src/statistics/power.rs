//! Power of a test and the sample size it needs, as G*Power computes them.

use statrs::function::gamma::ln_gamma;

use super::distributions::{noncentral_t_cdf, t_quantile};
use super::error::StatisticsError;
use super::quadrature::integral;

/// Largest sample size looked for.
const LARGEST_SAMPLE: usize = 1_000_000;

/// Whether an effect in the other direction would count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tails {
    /// Only an effect in the direction of the stated effect size counts.
    One,
    /// An effect in either direction counts.
    Two,
}

/// A test and the size of the effect it should find.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TestDesign {
    /// t-test of the difference of n pairs. G*Power: "Means: Difference between two dependent means".
    PairedT {
        /// Mean difference over the standard deviation of the differences, d_z.
        cohen_d_z: f64,
    },
    /// t-test of two independent groups of n each. G*Power: "Means: Difference between two independent means".
    TwoSampleT {
        /// Difference of means over the common standard deviation, d.
        cohen_d: f64,
    },
    /// Pearson correlation of n pairs of a bivariate normal, exactly. G*Power: "Correlation: Bivariate normal model".
    Correlation {
        /// Correlation in the population, −1 to 1.
        r: f64,
    },
    /// Correlation of n pairs with the first variable fixed. G*Power: "Correlation: Point biserial model".
    PointBiserial {
        /// Correlation in the population, −1 to 1.
        r: f64,
    },
}

/// A test, its effect size and its significance level.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PowerAnalysis {
    /// The test and the effect.
    pub design: TestDesign,
    /// Probability of a significant result without effect, usually 0.05.
    pub alpha: f64,
    /// One- or two-sided.
    pub tails: Tails,
}

impl PowerAnalysis {
    /// Probability that the test is significant with `n` participants (pairs; of [`TestDesign::TwoSampleT`] per group).
    ///
    /// # Errors
    /// - [`StatisticsError::OutOfDomain`]: α outside (0, 1), a correlation outside (−1, 1), an effect that is no number
    /// - [`StatisticsError::TooFew`]: fewer participants than the test needs
    ///
    /// # References
    /// Faul et al. (2007), doi:10.3758/BF03193146; (2009), doi:10.3758/BRM.41.4.1149
    pub fn power(&self, n: usize) -> Result<f64, StatisticsError> {
        self.check()?;
        let least = self.least_sample();
        if n < least {
            return Err(StatisticsError::TooFew { what: "participants", expected: least, found: n });
        }
        let count = n as f64;
        let by_t = |df: f64, noncentrality: f64| {
            let critical = self.critical_t(df);
            let beyond = 1.0 - noncentral_t_cdf(critical, df, noncentrality.abs());
            let other_side = match self.tails {
                Tails::One => 0.0,
                Tails::Two => noncentral_t_cdf(-critical, df, noncentrality.abs()),
            };
            (beyond + other_side).clamp(0.0, 1.0)
        };
        Ok(match self.design {
            TestDesign::PairedT { cohen_d_z } => by_t(count - 1.0, cohen_d_z * count.sqrt()),
            TestDesign::TwoSampleT { cohen_d } => by_t(2.0 * count - 2.0, cohen_d * (0.5 * count).sqrt()),
            TestDesign::PointBiserial { r } => by_t(count - 2.0, (r * r / (1.0 - r * r) * count).sqrt()),
            TestDesign::Correlation { r } => self.correlation_power(r.abs(), count),
        })
    }

    /// Fewest participants (pairs; of [`TestDesign::TwoSampleT`] per group) with at least this power.
    ///
    /// # Errors
    /// Those of [`Self::power`]; [`StatisticsError::SampleSize`] where a million do not suffice, as without any effect.
    pub fn needed_n(&self, power: f64) -> Result<usize, StatisticsError> {
        if !(power > 0.0 && power < 1.0) {
            let expected = "more than 0 and less than 1";
            return Err(StatisticsError::OutOfDomain { what: "power", expected, found: power });
        }
        let mut low = self.least_sample();
        if self.power(low)? >= power {
            return Ok(low);
        }
        let mut high = 2 * low;
        while self.power(high)? < power {
            low = high;
            high *= 2;
            if high > LARGEST_SAMPLE {
                return Err(StatisticsError::SampleSize { limit: LARGEST_SAMPLE, power });
            }
        }
        while high - low > 1 {
            let middle = low.midpoint(high);
            if self.power(middle)? < power { low = middle } else { high = middle }
        }
        Ok(high)
    }

    fn check(&self) -> Result<(), StatisticsError> {
        let domain = |what, expected, found, inside: bool| {
            if inside { Ok(()) } else { Err(StatisticsError::OutOfDomain { what, expected, found }) }
        };
        domain("α", "more than 0 and less than 1", self.alpha, self.alpha > 0.0 && self.alpha < 1.0)?;
        match self.design {
            TestDesign::PairedT { cohen_d_z: d } | TestDesign::TwoSampleT { cohen_d: d } => {
                domain("Cohen's d", "a finite number", d, d.is_finite())
            }
            TestDesign::Correlation { r } | TestDesign::PointBiserial { r } => {
                domain("correlation", "more than −1 and less than 1", r, r.abs() < 1.0)
            }
        }
    }

    fn least_sample(&self) -> usize {
        match self.design {
            TestDesign::PairedT { .. } | TestDesign::TwoSampleT { .. } => 2,
            TestDesign::Correlation { .. } | TestDesign::PointBiserial { .. } => 3,
        }
    }

    fn critical_t(&self, df: f64) -> f64 {
        let tail = match self.tails {
            Tails::One => self.alpha,
            Tails::Two => self.alpha / 2.0,
        };
        t_quantile(1.0 - tail, df)
    }

    /// Power by the exact distribution of r in samples of a bivariate normal.
    fn correlation_power(&self, rho: f64, n: f64) -> f64 {
        let df = n - 2.0;
        let t = self.critical_t(df);
        let critical = t / (t * t + df).sqrt();
        // r = sin θ removes the singular ends of the density.
        let half_pi = std::f64::consts::FRAC_PI_2;
        // θ has a standard deviation of at most 1/√n; nothing is left beyond 12 of them.
        let reach = 12.0 / df.sqrt();
        let (least, most) = ((rho.asin() - reach).max(-half_pi), (rho.asin() + reach).min(half_pi));
        let tail = |from: f64, to: f64| {
            let (from, to) = (from.clamp(least, most), to.clamp(least, most));
            integral(|theta| correlation_density(theta, rho, n), from, to, 64)
        };
        let other_side = match self.tails {
            Tails::One => 0.0,
            Tails::Two => tail(-half_pi, -critical.asin()),
        };
        (tail(critical.asin(), half_pi) + other_side).clamp(0.0, 1.0)
    }
}

/// Density of θ = arcsin r, where r is the correlation in a sample of n from a bivariate normal of correlation ρ:
///
/// ```text
/// f(r) = (n−2) Γ(n−1) (1−ρ²)^((n−1)/2) (1−r²)^((n−4)/2) / (√(2π) Γ(n−½) (1−ρr)^(n−3/2)) · ₂F₁(½, ½; n−½; (ρr+1)/2)
/// ```
/// Hotelling (1953), eq. 25, doi:10.1111/j.2517-6161.1953.tb00135.x
fn correlation_density(theta: f64, rho: f64, n: f64) -> f64 {
    let r = theta.sin();
    let log = (n - 2.0).ln() + ln_gamma(n - 1.0) - ln_gamma(n - 0.5) - 0.5 * (2.0 * std::f64::consts::PI).ln()
        + 0.5 * (n - 1.0) * (1.0 - rho * rho).ln()
        + (n - 3.0) * theta.cos().ln()
        - (n - 1.5) * (1.0 - rho * r).ln();
    log.exp() * hypergeometric_half_half(n - 0.5, 0.5 * (rho * r + 1.0))
}

/// ₂F₁(½, ½; c; x) for c ≥ 2.5 and 0 ≤ x ≤ 1 by its series.
fn hypergeometric_half_half(c: f64, x: f64) -> f64 {
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 0..10_000 {
        let k = f64::from(k);
        term *= (k + 0.5) * (k + 0.5) / ((c + k) * (k + 1.0)) * x;
        sum += term;
        if term < 1e-17 * sum {
            break;
        }
    }
    sum
}
