//! Linear mixed model with one random intercept: persons who are measured once or several times, in groups.

use nalgebra::{DMatrix, DVector};

use super::distributions::{t_quantile, t_two_sided};
use super::error::StatisticsError;

/// Intervals of the intraclass correlation in which the minimum is looked for first.
const GRID: usize = 200;
/// Ratio of the variances beyond which measurements of one person are the same but for rounding errors.
const GREATEST_RATIO: f64 = 1e9;
/// Halvings of such an interval: beyond the last digit.
const HALVINGS: usize = 60;

/// `y = X β + u(person) + e`, `u ~ N(0, σ_u²)`, `e ~ N(0, σ_e²)`, fitted by restricted maximum likelihood.
///
/// Where every person is measured once, or persons differ no more than measurements of one person do, σ_u² is zero and
/// the model is that of least squares.
///
/// # References
/// - Patterson & Thompson (1971), doi:10.1093/biomet/58.3.545: restricted likelihood
/// - Satterthwaite (1946), doi:10.2307/3002019; Kuznetsova et al. (2017), doi:10.18637/jss.v082.i13: degrees of freedom
#[derive(Clone, Debug, PartialEq)]
pub struct MixedModel {
    /// Estimates of β.
    pub coefficients: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Variance between persons σ_u².
    pub between: f64,
    /// Variance of measurements of one person σ_e².
    pub within: f64,
    /// −2 log of the restricted likelihood, as lme4's `REMLcrit` has it.
    pub criterion: f64,
    /// Measurements.
    pub observations: usize,
    /// Persons.
    pub persons: usize,
    /// Derivatives of [`MixedModel::covariance`] with respect to σ_u² and σ_e².
    slopes: [DMatrix<f64>; 2],
    /// Covariance of the estimates of σ_u² and σ_e²; `None`: σ_u² is zero.
    of_variances: Option<[[f64; 2]; 2]>,
}

/// A linear combination of coefficients and its test against zero.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Contrast {
    /// The estimate.
    pub estimate: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// Degrees of freedom by Satterthwaite's approximation.
    pub df: f64,
    /// t statistic.
    pub t: f64,
    /// Two-sided p-value, uncorrected.
    pub p_value: f64,
    /// 95 % interval.
    pub interval_95: [f64; 2],
    /// Cohen's d: the estimate over √(σ_u² + σ_e²), the standard deviation between measurements of different persons.
    pub cohen_d: f64,
    /// The interval over the same.
    pub cohen_d_interval_95: [f64; 2],
}

/// What a ratio λ = σ_u²/σ_e² of the variances gives.
struct Fitted {
    beta: DVector<f64>,
    /// (Xᵀ V₀⁻¹ X)⁻¹ with V₀ = I + λ Z Zᵀ.
    unscaled: DMatrix<f64>,
    /// V₀⁻¹ (y − X β).
    weighted_residual: DVector<f64>,
    within: f64,
    criterion: f64,
    /// Derivative of the criterion with respect to λ.
    slope: f64,
}

/// The data: y, X, the person of every measurement and the number of measurements of every person.
struct Data<'a> {
    y: DVector<f64>,
    x: &'a DMatrix<f64>,
    person: Vec<usize>,
    counts: Vec<f64>,
}

impl Data<'_> {
    /// Sums over the measurements of every person.
    fn sums(&self, of: &DMatrix<f64>) -> DMatrix<f64> {
        let mut sums = DMatrix::zeros(self.counts.len(), of.ncols());
        for (i, person) in self.person.iter().enumerate() {
            let mut row = sums.row_mut(*person);
            row += of.row(i);
        }
        sums
    }

    /// V₀⁻¹ times a matrix.
    fn weighted(&self, of: &DMatrix<f64>, ratio: f64) -> DMatrix<f64> {
        let sums = self.sums(of);
        DMatrix::from_fn(of.nrows(), of.ncols(), |i, j| {
            let person = self.person[i];
            of[(i, j)] - ratio / (1.0 + ratio * self.counts[person]) * sums[(person, j)]
        })
    }

    fn fitted(&self, ratio: f64) -> Option<Fitted> {
        let (n, p) = self.x.shape();
        let df = (n - p) as f64;
        let weighted_x = self.weighted(self.x, ratio);
        let information = self.x.transpose() * &weighted_x;
        let factor = information.clone().cholesky()?;
        let unscaled = factor.inverse();
        let beta = factor.solve(&(weighted_x.transpose() * &self.y));
        let residual = &self.y - self.x * &beta;
        let weighted_residual = self.weighted(&DMatrix::from_column_slice(n, 1, residual.as_slice()), ratio);
        let weighted_residual = weighted_residual.column(0).into_owned();
        let within = residual.dot(&weighted_residual) / df;
        let log_determinant: f64 = self.counts.iter().map(|c| (ratio * c).ln_1p()).sum();
        let log_information = 2.0 * factor.l().diagonal().map(f64::ln).sum();
        let criterion = df * (1.0 + (std::f64::consts::TAU * within).ln()) + log_determinant + log_information;
        let sums_x = self.sums(&weighted_x);
        let sums_r = self.sums(&DMatrix::from_column_slice(n, 1, weighted_residual.as_slice()));
        let of_determinant: f64 = self.counts.iter().map(|c| c / (1.0 + ratio * c)).sum();
        let slope =
            of_determinant - (&unscaled * sums_x.transpose() * &sums_x).trace() - sums_r.norm_squared() / within;
        Some(Fitted { beta, unscaled, weighted_residual, within, criterion, slope })
    }

    /// The ratio of the variances at the minimum of the criterion, looked for over the intraclass correlation ρ,
    /// λ = ρ/(1 − ρ).
    fn best_ratio(&self) -> Option<f64> {
        if self.counts.iter().all(|count| *count == 1.0) {
            return Some(0.0);
        }
        let ratio = |rho: f64| rho / (1.0 - rho);
        let grid = |k: usize| k as f64 / GRID as f64;
        let criteria: Vec<f64> =
            (0..GRID).map(|k| self.fitted(ratio(grid(k))).map(|f| f.criterion)).collect::<Option<_>>()?;
        let best = criteria.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).map(|(k, _)| k)?;
        let (mut low, mut high) = (grid(best.saturating_sub(1)), grid(best + 1).min(1.0 - 1e-12));
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.fitted(ratio(middle))?.slope < 0.0 { low = middle } else { high = middle }
        }
        Some(if low == 0.0 { 0.0 } else { ratio(0.5 * (low + high)) })
    }
}

/// Fits a linear mixed model with one intercept a person.
///
/// - `y`: measurements
/// - `x`: the design, one row a measurement; columns must not depend on each other
/// - `person`: of every measurement, any numbers
///
/// # Errors
/// - [`StatisticsError::Length`], [`StatisticsError::NotFinite`]
/// - [`StatisticsError::TooFew`]: no more measurements than coefficients
/// - [`StatisticsError::NoVariation`]: columns of the design depend on each other; nothing is left unexplained
pub fn mixed_model(y: &[f64], x: &DMatrix<f64>, person: &[usize]) -> Result<MixedModel, StatisticsError> {
    let (n, p) = x.shape();
    for (what, found) in [("rows of the design", n), ("persons", person.len())] {
        if found != y.len() {
            return Err(StatisticsError::Length { what, expected: y.len(), found });
        }
    }
    if let Some(row) = y.iter().position(|v| !v.is_finite()) {
        return Err(StatisticsError::NotFinite { what: "measurement", row, column: 0, value: y[row] });
    }
    if n <= p {
        return Err(StatisticsError::TooFew { what: "measurements", expected: p + 1, found: n });
    }
    let mut known: Vec<usize> = person.to_vec();
    known.sort_unstable();
    known.dedup();
    let person: Vec<usize> = person.iter().map(|q| known.partition_point(|k| k < q)).collect();
    let mut counts = vec![0.0; known.len()];
    person.iter().for_each(|q| counts[*q] += 1.0);
    let data = Data { y: DVector::from_column_slice(y), x, person, counts };
    let dependent = || StatisticsError::NoVariation { what: "columns of the design, beside one another," };
    let ratio = data.best_ratio().ok_or_else(dependent)?;
    let fitted = data.fitted(ratio).ok_or_else(dependent)?;
    // Of measurements that are the same in every group rounding errors are left.
    let rounding = n as f64 * data.y.amax() * f64::EPSILON;
    if ratio > GREATEST_RATIO {
        return Err(StatisticsError::NoVariation { what: "measurements of one person" });
    }
    if !(fitted.within > rounding * rounding) {
        return Err(StatisticsError::NoVariation { what: "measurements of a group" });
    }
    data.summed_up(ratio, fitted)
}

impl Data<'_> {
    /// The model with what degrees of freedom need: with P = V⁻¹ − V⁻¹ X C Xᵀ V⁻¹ and V = σ_u² Z Zᵀ + σ_e² I,
    ///
    /// ```text
    /// ∂C/∂ψ_k = C Xᵀ V⁻¹ V_k V⁻¹ X C
    /// ∂²(−2 log L)/∂ψ_j ∂ψ_k = −tr(P V_j P V_k) + 2 yᵀ P V_j P V_k P y,    covariance of ψ: twice its inverse
    /// ```
    fn summed_up(&self, ratio: f64, fitted: Fitted) -> Result<MixedModel, StatisticsError> {
        let within = fitted.within;
        let covariance = &fitted.unscaled * within;
        let weighted_x = self.weighted(self.x, ratio) / within;
        let slope_of = |middle: DMatrix<f64>| &covariance * middle * &covariance;
        let sums = self.sums(&weighted_x);
        let slopes = [slope_of(sums.transpose() * sums), slope_of(weighted_x.transpose() * &weighted_x)];
        let of_variances = match ratio > 0.0 {
            true => Some(self.of_variances(ratio, &fitted, &covariance, &weighted_x)?),
            false => None,
        };
        Ok(MixedModel {
            of_variances,
            coefficients: fitted.beta,
            covariance,
            between: ratio * within,
            within,
            criterion: fitted.criterion,
            observations: self.y.len(),
            persons: self.counts.len(),
            slopes,
        })
    }

    fn of_variances(
        &self,
        ratio: f64,
        fitted: &Fitted,
        covariance: &DMatrix<f64>,
        weighted_x: &DMatrix<f64>,
    ) -> Result<[[f64; 2]; 2], StatisticsError> {
        let (n, within) = (self.y.len(), fitted.within);
        let inverse = self.weighted(&DMatrix::identity(n, n), ratio) / within;
        let projection = inverse - weighted_x * covariance * weighted_x.transpose();
        // P y = V⁻¹ (y − X β).
        let py = DMatrix::from_column_slice(n, 1, (&fitted.weighted_residual / within).as_slice());
        let by_person = |of: &DMatrix<f64>| {
            let sums = self.sums(of);
            DMatrix::from_fn(n, of.ncols(), |i, j| sums[(self.person[i], j)])
        };
        let products = [by_person(&projection), projection.clone()];
        let applied = [by_person(&py), py];
        let entry = |j: usize, k: usize| {
            let trace = products[j].component_mul(&products[k].transpose()).sum();
            2.0 * applied[j].dot(&(&projection * &applied[k])) - trace
        };
        let [a, b, d] = [entry(0, 0), entry(0, 1), entry(1, 1)];
        let determinant = a * d - b * b;
        if !(determinant > 0.0 && a > 0.0) {
            return Err(StatisticsError::NoVariation { what: "measurements of one person" });
        }
        Ok([[2.0 * d / determinant, -2.0 * b / determinant], [-2.0 * b / determinant, 2.0 * a / determinant]])
    }
}

impl MixedModel {
    /// Share of the variance that is between persons.
    pub fn intraclass_correlation(&self) -> f64 {
        self.between / (self.between + self.within)
    }

    /// Tests Σ wᵢ βᵢ against zero.
    ///
    /// - `weights`: one for every coefficient
    ///
    /// # Errors
    /// [`StatisticsError::Length`]
    pub fn contrast(&self, weights: &[f64]) -> Result<Contrast, StatisticsError> {
        let expected = self.coefficients.len();
        if weights.len() != expected {
            return Err(StatisticsError::Length { what: "weights", expected, found: weights.len() });
        }
        let w = DVector::from_column_slice(weights);
        let quadratic = |m: &DMatrix<f64>| w.dot(&(m * &w));
        let (estimate, variance) = (w.dot(&self.coefficients), quadratic(&self.covariance));
        let df = match &self.of_variances {
            None => (self.observations - expected) as f64,
            Some(covariance) => {
                let slope = [0, 1].map(|k| quadratic(&self.slopes[k]));
                let of_variance: f64 = (0..2)
                    .flat_map(|j| (0..2).map(move |k| (j, k)))
                    .map(|(j, k)| slope[j] * covariance[j][k] * slope[k])
                    .sum();
                2.0 * variance * variance / of_variance
            }
        };
        let standard_error = variance.sqrt();
        let t = estimate / standard_error;
        let reach = t_quantile(0.975, df) * standard_error;
        let interval_95 = [estimate - reach, estimate + reach];
        let sd = (self.between + self.within).sqrt();
        Ok(Contrast {
            estimate,
            standard_error,
            df,
            t,
            p_value: t_two_sided(t, df),
            interval_95,
            cohen_d: estimate / sd,
            cohen_d_interval_95: interval_95.map(|end| end / sd),
        })
    }
}

/// Holm's correction of p-values of one family, in their order.
///
/// # References
/// Holm (1979), <https://www.jstor.org/stable/4615733>
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|a, b| p_values[*a].total_cmp(&p_values[*b]));
    let mut corrected = vec![0.0; p_values.len()];
    let mut largest: f64 = 0.0;
    for (rank, i) in order.into_iter().enumerate() {
        largest = largest.max((p_values[i] * (p_values.len() - rank) as f64).min(1.0));
        corrected[i] = largest;
    }
    corrected
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::paired_t_test;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-9 * b.abs().max(1.0)
    }

    const BEFORE: [f64; 7] = [3.1, 4.4, 2.2, 5.3, 6.8, 4.1, 3.0];
    const AFTER: [f64; 7] = [3.6, 4.9, 2.1, 6.4, 7.1, 4.9, 3.8];

    #[test]
    fn verif_before_and_after_of_the_same_persons_is_the_paired_t_test() {
        let y: Vec<f64> = BEFORE.iter().chain(&AFTER).copied().collect();
        let person: Vec<usize> = (0..14).map(|i| 10 + i % 7).collect();
        let x = DMatrix::from_fn(14, 2, |i, j| if j == i / 7 { 1.0 } else { 0.0 });
        let found = mixed_model(&y, &x, &person).unwrap();
        let contrast = found.contrast(&[-1.0, 1.0]).unwrap();
        let test = paired_t_test(&AFTER, &BEFORE).unwrap();
        assert!(found.between > 0.0 && found.persons == 7);
        assert!(close(contrast.estimate, test.mean_difference) && close(contrast.t, test.t), "{contrast:?}");
        assert!((contrast.df - 6.0).abs() < 1e-6 && close(contrast.p_value, test.p_value), "{contrast:?}");
    }

    #[test]
    fn verif_persons_measured_once_are_compared_by_student_s_t_test() {
        let y: Vec<f64> = BEFORE.iter().chain(&AFTER[..5]).copied().collect();
        let person: Vec<usize> = (0..12).collect();
        let x = DMatrix::from_fn(12, 2, |i, j| if j == usize::from(i >= 7) { 1.0 } else { 0.0 });
        let found = mixed_model(&y, &x, &person).unwrap();
        let contrast = found.contrast(&[-1.0, 1.0]).unwrap();
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let squares = |v: &[f64]| v.iter().map(|a| (a - mean(v)).powi(2)).sum::<f64>();
        let pooled = (squares(&BEFORE) + squares(&AFTER[..5])) / 10.0;
        let difference = mean(&AFTER[..5]) - mean(&BEFORE);
        assert_eq!((found.between, contrast.df), (0.0, 10.0));
        assert!(close(found.within, pooled) && close(contrast.estimate, difference));
        assert!(close(contrast.t, difference / (pooled * (1.0 / 7.0 + 1.0 / 5.0)).sqrt()));
        assert!(close(contrast.cohen_d, difference / pooled.sqrt()));
    }

    #[test]
    fn verif_what_cannot_be_told_apart_is_refused() {
        let x = DMatrix::from_element(5, 2, 1.0);
        let refused = mixed_model(&[1.0, 2.0, 3.0, 4.0, 6.0], &x, &[0, 1, 2, 3, 4]);
        assert!(matches!(refused, Err(StatisticsError::NoVariation { .. })), "{refused:?}");
        let x = DMatrix::from_element(3, 1, 1.0);
        assert!(matches!(mixed_model(&[2.0; 3], &x, &[0, 1, 2]), Err(StatisticsError::NoVariation { .. })));
        let (age, visits) = ([30.0, 31.0, 33.0, 30.0, 31.0, 33.0], [0, 1, 2, 0, 1, 2]);
        let x_of_visits = DMatrix::from_fn(6, 2, |i, j| f64::from(u8::from(i / 3 == j)));
        let of_age = mixed_model(&age, &x_of_visits, &visits);
        assert!(matches!(of_age, Err(StatisticsError::NoVariation { .. })), "{of_age:?}");
        assert!(matches!(mixed_model(&[2.0; 2], &x, &[0, 1, 2]), Err(StatisticsError::Length { .. })));
        assert!(matches!(mixed_model(&[1.0, f64::NAN, 2.0], &x, &[0, 1, 2]), Err(StatisticsError::NotFinite { .. })));
    }

    #[test]
    fn verif_holm_never_falls_with_the_rank() {
        assert_eq!(holm(&[0.01, 0.04, 0.03]), [0.03, 0.06, 0.06]);
        assert_eq!(holm(&[]), [0.0; 0]);
    }
}
