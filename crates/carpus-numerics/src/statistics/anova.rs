//! Analysis of variance with repeated measures.

use nalgebra::{DMatrix, RowDVector};

use super::distributions::f_tail;
use super::error::StatisticsError;
use super::sphericity::Sphericity;

/// A within-subject factor, such as contraction or effort.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Factor {
    /// Its name.
    pub name: String,
    /// Names of its levels, at least two.
    pub levels: Vec<String>,
}

impl Factor {
    /// A factor of named levels.
    pub fn new(name: impl Into<String>, levels: impl IntoIterator<Item = impl Into<String>>) -> Self {
        Self { name: name.into(), levels: levels.into_iter().map(Into::into).collect() }
    }
}

/// One measurement of every participant in every combination of the factors' levels.
#[derive(Clone, Debug, PartialEq)]
pub struct RepeatedMeasures {
    factors: Vec<Factor>,
    /// n × cells; the last factor's level changes fastest.
    values: DMatrix<f64>,
}

/// A main effect or an interaction, with its F test.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Effect {
    /// Names of the factors it is of; more than one: their interaction.
    pub factors: Vec<String>,
    /// Sum of squares of the effect.
    pub sum_of_squares: f64,
    /// Sum of squares of its error: the effect's interaction with participants.
    pub error_sum_of_squares: f64,
    /// Degrees of freedom of the effect.
    pub df_effect: usize,
    /// Degrees of freedom of its error.
    pub df_error: usize,
    /// F statistic.
    pub f: f64,
    /// p-value if sphericity holds.
    pub p_value: f64,
    /// p-value with the degrees of freedom shrunk by Greenhouse–Geisser's ε.
    pub p_greenhouse_geisser: f64,
    /// p-value with the degrees of freedom shrunk by Huynh–Feldt's ε.
    pub p_huynh_feldt: f64,
    /// Sphericity of the effect's contrasts.
    pub sphericity: Sphericity,
    /// Partial η²: SS / (SS + SS of its error).
    pub partial_eta_squared: f64,
    /// Generalized η²: SS / (SS + all variation that comes from participants); Olejnik & Algina (2003),
    /// doi:10.1037/1082-989X.8.4.434.
    pub generalized_eta_squared: f64,
}

impl Effect {
    /// `contraction × effort`.
    pub fn name(&self) -> String {
        self.factors.join(" × ")
    }
}

impl RepeatedMeasures {
    /// - `rows`: one row a participant; its values in the order of the combinations of levels, the last factor's level
    ///   changing fastest
    ///
    /// # Errors
    /// - [`StatisticsError::TooFew`]: no factor, a factor of one level, a single participant
    /// - [`StatisticsError::Length`]: a row that is not one value per combination
    /// - [`StatisticsError::NotFinite`]: a missing value; leave the participant out, knowingly
    pub fn new(factors: Vec<Factor>, rows: &[Vec<f64>]) -> Result<Self, StatisticsError> {
        let fewest = factors.iter().map(|f| f.levels.len()).min();
        let Some(fewest) = fewest else {
            return Err(StatisticsError::TooFew { what: "factors", expected: 1, found: 0 });
        };
        if fewest < 2 {
            return Err(StatisticsError::TooFew { what: "levels of a factor", expected: 2, found: fewest });
        }
        if rows.len() < 2 {
            return Err(StatisticsError::TooFew { what: "participants", expected: 2, found: rows.len() });
        }
        let cells: usize = factors.iter().map(|f| f.levels.len()).product();
        for (i, row) in rows.iter().enumerate() {
            if row.len() != cells {
                let what = "values of a participant (one per combination of levels)";
                return Err(StatisticsError::Length { what, expected: cells, found: row.len() });
            }
            if let Some(column) = row.iter().position(|v| !v.is_finite()) {
                return Err(StatisticsError::NotFinite { what: "participant", row: i, column, value: row[column] });
            }
        }
        let values = DMatrix::from_fn(rows.len(), cells, |i, j| rows[i][j]);
        Ok(Self { factors, values })
    }

    /// Number of participants.
    pub fn n_participants(&self) -> usize {
        self.values.nrows()
    }

    /// The factors.
    pub fn factors(&self) -> &[Factor] {
        &self.factors
    }

    /// The test of every main effect and interaction, main effects first.
    ///
    /// Each effect is tested on the participants' scores `Z = Y C` on its orthonormal contrasts C:
    ///
    /// ```text
    /// SS = n |z̄|²      SS_error = Σ |zᵢ − z̄|²      F = (SS / d) / (SS_error / (d (n − 1)))
    /// ```
    /// where nothing varies F is 0/0, reported as NaN.
    pub fn anova(&self) -> Vec<Effect> {
        let n_factors = self.factors.len();
        let mut subsets: Vec<usize> = (1..1usize << n_factors).collect();
        subsets.sort_by_key(|subset| (subset.count_ones(), subset.reverse_bits().wrapping_neg()));
        let participants = self.scores(0);
        let between = scatter(&participants).trace();
        let scores: Vec<_> = subsets.iter().map(|&subset| (subset, self.scores(subset))).collect();
        let all_errors: f64 = between + scores.iter().map(|(_, z)| scatter(z).trace()).sum::<f64>();
        scores.iter().map(|(subset, z)| self.effect(*subset, z, all_errors)).collect()
    }

    fn effect(&self, subset: usize, z: &DMatrix<f64>, all_errors: f64) -> Effect {
        let (n, d) = (z.nrows(), z.ncols());
        let scatter = scatter(z);
        let sum_of_squares = n as f64 * z.row_mean().norm_squared();
        let error_sum_of_squares = scatter.trace();
        let (df_effect, df_error) = (d, d * (n - 1));
        let f = (sum_of_squares / df_effect as f64) / (error_sum_of_squares / df_error as f64);
        let sphericity = Sphericity::of_contrasts(&(scatter / (n - 1) as f64), n);
        let p = |epsilon: f64| {
            if f.is_nan() { f64::NAN } else { f_tail(f, epsilon * df_effect as f64, epsilon * df_error as f64) }
        };
        let factors = self.factors.iter().enumerate().filter(|(i, _)| subset >> i & 1 == 1);
        Effect {
            factors: factors.map(|(_, factor)| factor.name.clone()).collect(),
            sum_of_squares,
            error_sum_of_squares,
            df_effect,
            df_error,
            f,
            p_value: p(1.0),
            p_greenhouse_geisser: p(sphericity.greenhouse_geisser),
            p_huynh_feldt: p(sphericity.huynh_feldt),
            sphericity,
            partial_eta_squared: sum_of_squares / (sum_of_squares + error_sum_of_squares),
            generalized_eta_squared: sum_of_squares / (sum_of_squares + all_errors),
        }
    }

    /// Scores of the participants on the orthonormal contrasts of the factors in `subset` (bit i: factor i), averaged
    /// over the others.
    fn scores(&self, subset: usize) -> DMatrix<f64> {
        let mut contrasts = DMatrix::identity(1, 1);
        for (i, factor) in self.factors.iter().enumerate() {
            let levels = factor.levels.len();
            let of_factor = if subset >> i & 1 == 1 {
                helmert(levels)
            } else {
                DMatrix::from_element(levels, 1, (levels as f64).sqrt().recip())
            };
            contrasts = contrasts.kronecker(&of_factor);
        }
        &self.values * contrasts
    }

    /// Means over all other factors: for each participant one value per level of the factor; `None` if there is no
    /// such factor. What post-hoc comparisons of a main effect compare.
    pub fn marginal_means(&self, factor: usize) -> Option<Vec<Vec<f64>>> {
        let levels = self.factors.get(factor)?.levels.len();
        let inner: usize = self.factors[factor + 1..].iter().map(|f| f.levels.len()).product();
        let of_level = |i: usize, level: usize| {
            let cells = (0..self.values.ncols()).filter(|cell| cell / inner % levels == level);
            let (sum, count) =
                cells.fold((0.0, 0usize), |(sum, count), cell| (sum + self.values[(i, cell)], count + 1));
            sum / count as f64
        };
        Some((0..self.n_participants()).map(|i| (0..levels).map(|level| of_level(i, level)).collect()).collect())
    }
}

/// Orthonormal Helmert contrasts of `levels` levels, one a column.
fn helmert(levels: usize) -> DMatrix<f64> {
    DMatrix::from_fn(levels, levels - 1, |level, contrast| {
        let k = (contrast + 1) as f64;
        let norm = (k * (k + 1.0)).sqrt();
        match level {
            l if l <= contrast => 1.0 / norm,
            l if l == contrast + 1 => -k / norm,
            _ => 0.0,
        }
    })
}

/// Σ (zᵢ − z̄)ᵀ (zᵢ − z̄) over the rows.
fn scatter(z: &DMatrix<f64>) -> DMatrix<f64> {
    let mean: RowDVector<f64> = z.row_mean();
    let centred = DMatrix::from_fn(z.nrows(), z.ncols(), |i, j| z[(i, j)] - mean[j]);
    centred.transpose() * centred
}
