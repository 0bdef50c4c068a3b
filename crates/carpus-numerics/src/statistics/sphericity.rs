//! Sphericity: whether the differences between conditions vary alike, which the F test of repeated measures supposes.

use nalgebra::DMatrix;

use super::distributions::chi_squared_tail;

/// Sphericity of one effect, from the covariance of its orthonormal contrasts.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Sphericity {
    /// Mauchly's W: 1 where sphericity holds exactly, towards 0 where it fails. `None` where there is nothing to test
    /// (an effect of one degree of freedom) or too few participants (n − 1 less than the degrees of freedom).
    pub mauchly_w: Option<f64>,
    /// χ² of Mauchly's W.
    pub chi_squared: Option<f64>,
    /// Its degrees of freedom.
    pub df: usize,
    /// p-value of Mauchly's test: small means that sphericity fails.
    pub p_value: Option<f64>,
    /// Greenhouse–Geisser ε, from 1/df of the effect (least) to 1 (sphericity).
    pub greenhouse_geisser: f64,
    /// Huynh–Feldt ε, less conservative; at most 1.
    pub huynh_feldt: f64,
}

impl Sphericity {
    /// ```text
    /// W = det S / (tr S / d)^d            χ² = −(n − 1 − (2d² + d + 2)/(6d)) ln W,   d(d+1)/2 − 1 degrees of freedom
    /// ε_GG = (tr S)² / (d tr S²)          ε_HF = (n d ε_GG − 2) / (d (n − 1 − d ε_GG))
    /// ```
    /// - `covariance`: S, d × d, of the scores of n participants on orthonormal contrasts
    ///
    /// # References
    /// Mauchly (1940), doi:10.1214/aoms/1177731915; Greenhouse & Geisser (1959), doi:10.1007/BF02289823; Huynh & Feldt
    /// (1976), doi:10.3102/10769986001001069. The p-value has the second-order term of Anderson (2003), An Introduction
    /// to Multivariate Statistical Analysis, section 10.7.4. (R and pingouin use the number of conditions for one d of
    /// that term, which moves p by less than 0.001.)
    pub(super) fn of_contrasts(covariance: &DMatrix<f64>, n: usize) -> Self {
        let (d, n) = (covariance.nrows() as f64, n as f64);
        let trace = covariance.trace();
        let greenhouse_geisser =
            if trace > 0.0 { (trace * trace / (d * covariance.norm_squared())).clamp(1.0 / d, 1.0) } else { 1.0 };
        let room = n - 1.0 - d * greenhouse_geisser;
        let huynh_feldt =
            if room > 0.0 { ((n * d * greenhouse_geisser - 2.0) / (d * room)).clamp(1.0 / d, 1.0) } else { 1.0 };
        let df = (d * (d + 1.0) / 2.0) as usize - 1;
        let testable = d > 1.0 && n > d && trace > 0.0;
        let mauchly_w = testable.then(|| (covariance / (trace / d)).determinant().clamp(0.0, 1.0));
        let chi_squared = mauchly_w.map(|w| -(n - 1.0 - (2.0 * d * d + d + 2.0) / (6.0 * d)) * w.ln());
        let p_value = chi_squared.map(|chi_squared| {
            let scale = 6.0 * d * (n - 1.0) - (2.0 * d * d + d + 2.0); // 6 d (n − 1) times the factor of ln W
            let second_order = (d + 2.0) * (d - 1.0) * (d - 2.0) * (2.0 * d.powi(3) + 6.0 * d * d + 3.0 * d + 2.0)
                / (8.0 * scale * scale);
            let first = chi_squared_tail(chi_squared, df as f64);
            (first + second_order * (chi_squared_tail(chi_squared, df as f64 + 4.0) - first)).clamp(0.0, 1.0)
        });
        Self { mauchly_w, chi_squared, df, p_value, greenhouse_geisser, huynh_feldt }
    }
}
