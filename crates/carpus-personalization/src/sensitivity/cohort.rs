//! Sensitivity indices of several participants: means and tests over conditions and muscles, as in chapter 2 of the
//! dissertation (tables 2.2 to 2.5 and 2.3b, figure 2.5).

use super::muscle_screening::ScreenedProperty;
use carpus_numerics::statistics::{
    Comparison, Effect, Factor, PairedT, RepeatedMeasures, StatisticsError, bonferroni, paired_t_test,
    pairwise_comparisons,
};
use carpus_study::study::Contraction;

/// Indices of one parameter in one participant's trials of one condition.
#[derive(Clone, Debug, PartialEq)]
pub struct CohortIndex {
    /// The participant.
    pub participant: String,
    /// Kind of contraction.
    pub contraction: Contraction,
    /// Effort [% of the maximum voluntary effort].
    pub effort_percent: f64,
    /// The muscle.
    pub muscle: String,
    /// The property.
    pub property: ScreenedProperty,
    /// μ*.
    pub mu_star: f64,
    /// σ.
    pub sigma: f64,
}

/// A condition: contraction and effort.
pub type Cell = (Contraction, f64);

/// A comparison of two conditions.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CellComparison {
    /// First condition: contraction and effort.
    pub first: Cell,
    /// Second condition.
    pub second: Cell,
    /// The test of first minus second.
    pub test: PairedT,
    /// p-value times the number of comparisons of the property, at most 1.
    pub p_bonferroni: f64,
}

/// Mean over participants and muscles.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct MeanIndex {
    /// Mean μ*.
    pub mu_star: f64,
    /// Standard deviation over participants of μ* averaged over muscles; zero for a single participant.
    pub deviation_over_participants: f64,
    /// Mean σ.
    pub sigma: f64,
    /// Participants.
    pub participants: usize,
}

/// Indices of a cohort.
#[derive(Clone, Debug, PartialEq)]
pub struct SensitivityCohort {
    indices: Vec<CohortIndex>,
    participants: Vec<String>,
    muscles: Vec<String>,
    contractions: Vec<Contraction>,
    efforts: Vec<f64>,
}

impl SensitivityCohort {
    /// From all indices, in any order; participants and muscles keep the order in which they first appear.
    pub fn new(indices: Vec<CohortIndex>) -> SensitivityCohort {
        let (mut participants, mut muscles) = (Vec::new(), Vec::new());
        let (mut contractions, mut efforts) = (Vec::new(), Vec::new());
        for index in &indices {
            if !participants.contains(&index.participant) {
                participants.push(index.participant.clone());
            }
            if !muscles.contains(&index.muscle) {
                muscles.push(index.muscle.clone());
            }
            contractions.push(index.contraction);
            efforts.push(index.effort_percent);
        }
        contractions.sort_unstable();
        contractions.dedup();
        efforts.sort_by(f64::total_cmp);
        efforts.dedup();
        SensitivityCohort { indices, participants, muscles, contractions, efforts }
    }

    /// The muscles.
    pub fn muscles(&self) -> &[String] {
        &self.muscles
    }

    /// The participants.
    pub fn participants(&self) -> &[String] {
        &self.participants
    }

    /// The conditions: contraction × effort.
    pub fn cells(&self) -> Vec<Cell> {
        self.contractions.iter().flat_map(|c| self.efforts.iter().map(move |e| (*c, *e))).collect()
    }

    fn mean(&self, value: fn(&CohortIndex) -> f64, chosen: impl Fn(&CohortIndex) -> bool) -> Option<f64> {
        let (sum, count) =
            self.indices.iter().filter(|i| chosen(i)).fold((0.0, 0usize), |(s, n), i| (s + value(i), n + 1));
        (count > 0).then(|| sum / count as f64)
    }

    /// μ* of a participant in a condition, averaged over muscles.
    fn over_muscles(&self, participant: &str, property: ScreenedProperty, cell: Cell) -> Option<f64> {
        self.mean(|i| i.mu_star, |i| i.participant == participant && i.property == property && is_in(i, cell))
    }

    /// One row a participant, one value a condition; participants who lack a condition are left out.
    fn rows(&self, property: ScreenedProperty, cells: &[Cell]) -> Vec<Vec<f64>> {
        let row =
            |p: &String| cells.iter().map(|cell| self.over_muscles(p, property, *cell)).collect::<Option<Vec<f64>>>();
        self.participants.iter().filter_map(row).collect()
    }

    /// Properties and their mean μ* over conditions, the most influential first.
    pub fn ranked(&self) -> Vec<(ScreenedProperty, f64)> {
        let overall = |property| {
            let found: Vec<f64> =
                self.cells().iter().filter_map(|c| self.mean_index(property, *c, None)).map(|m| m.mu_star).collect();
            (!found.is_empty()).then(|| found.iter().sum::<f64>() / found.len() as f64)
        };
        let mut ranked: Vec<(ScreenedProperty, f64)> =
            ScreenedProperty::ALL.into_iter().filter_map(|p| Some((p, overall(p)?))).collect();
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
        ranked
    }

    /// Mean μ* and σ of a condition (table 2.2, figure 2.3), or of one muscle in it (figure 2.4).
    pub fn mean_index(&self, property: ScreenedProperty, cell: Cell, muscle: Option<&str>) -> Option<MeanIndex> {
        let chosen = |i: &CohortIndex| {
            i.property == property && is_in(i, cell) && muscle.is_none_or(|muscle| i.muscle == muscle)
        };
        let values: Vec<f64> = self
            .participants
            .iter()
            .filter_map(|p| self.mean(|i| i.mu_star, |i| i.participant == *p && chosen(i)))
            .collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        Some(MeanIndex {
            mu_star: mean,
            deviation_over_participants: if values.len() > 1 { (squares / (n - 1.0)).sqrt() } else { 0.0 },
            sigma: self.mean(|i| i.sigma, chosen)?,
            participants: values.len(),
        })
    }

    /// Contraction × effort within participants, μ* averaged over muscles (table 2.3).
    ///
    /// # Errors
    /// Fewer than two contractions, efforts, or participants with all conditions.
    pub fn anova_of_conditions(&self, property: ScreenedProperty) -> Result<Vec<Effect>, StatisticsError> {
        Ok(self.design(property)?.anova())
    }

    fn design(&self, property: ScreenedProperty) -> Result<RepeatedMeasures, StatisticsError> {
        let factors = vec![
            Factor::new("contraction", self.contractions.iter().map(|c| c.word())),
            Factor::new("effort", self.efforts.iter().map(f64::to_string)),
        ];
        RepeatedMeasures::new(factors, &self.rows(property, &self.cells()))
    }

    /// Pairs of contractions, and pairs of efforts, each averaged over the other factor (table 2.4).
    ///
    /// # Errors
    /// As [`Self::anova_of_conditions`]; levels that differ by the same amount in all participants.
    pub fn main_effects(&self, property: ScreenedProperty) -> Result<[Vec<Comparison>; 2], StatisticsError> {
        let design = self.design(property)?;
        let of_factor = |k: usize| {
            let levels = &design.factors()[k].levels;
            pairwise_comparisons(levels, &design.marginal_means(k).unwrap_or_default())
        };
        Ok([of_factor(0)?, of_factor(1)?])
    }

    /// Pairs of conditions that differ in one factor alone, corrected for their number (table 2.3b).
    ///
    /// # Errors
    /// Fewer than two participants; conditions that differ by the same amount in all participants.
    pub fn interactions(&self, property: ScreenedProperty) -> Result<Vec<CellComparison>, StatisticsError> {
        let cells = self.cells();
        let rows = self.rows(property, &cells);
        let column = |k: usize| rows.iter().map(|row| row[k]).collect::<Vec<f64>>();
        let mut comparisons = Vec::new();
        for (i, &first) in cells.iter().enumerate() {
            for (j, &second) in cells.iter().enumerate().skip(i + 1) {
                if (first.0 == second.0) != (first.1 == second.1) {
                    let test = paired_t_test(&column(i), &column(j))?;
                    comparisons.push(CellComparison { first, second, test, p_bonferroni: test.p_value });
                }
            }
        }
        let count = comparisons.len();
        comparisons.iter_mut().for_each(|c| c.p_bonferroni = bonferroni(c.test.p_value, count));
        Ok(comparisons)
    }

    /// One row a participant, one value a muscle.
    fn muscle_rows(&self, property: ScreenedProperty, cell: Cell) -> Vec<Vec<f64>> {
        let of = |p: &String, m: &String| {
            self.mean(
                |i| i.mu_star,
                |i| i.participant == *p && i.muscle == *m && i.property == property && is_in(i, cell),
            )
        };
        let row = |p: &String| self.muscles.iter().map(|m| of(p, m)).collect::<Option<Vec<f64>>>();
        self.participants.iter().filter_map(row).collect()
    }

    /// Muscles within participants, in one condition (table 2.5).
    ///
    /// # Errors
    /// Fewer than two muscles or participants.
    pub fn anova_of_muscles(&self, property: ScreenedProperty, cell: Cell) -> Result<Effect, StatisticsError> {
        let factor = Factor::new("muscle", self.muscles.iter());
        let design = RepeatedMeasures::new(vec![factor], &self.muscle_rows(property, cell))?;
        let too_few = StatisticsError::TooFew { what: "factors", expected: 1, found: 0 };
        design.anova().into_iter().next().ok_or(too_few)
    }

    /// Pairs of muscles in one condition (figure 2.5).
    ///
    /// # Errors
    /// As [`Self::anova_of_muscles`]; muscles that differ by the same amount in all participants.
    pub fn pairs_of_muscles(&self, property: ScreenedProperty, cell: Cell) -> Result<Vec<Comparison>, StatisticsError> {
        pairwise_comparisons(&self.muscles, &self.muscle_rows(property, cell))
    }
}

fn is_in(index: &CohortIndex, (contraction, effort): Cell) -> bool {
    index.contraction == contraction && index.effort_percent == effort
}
