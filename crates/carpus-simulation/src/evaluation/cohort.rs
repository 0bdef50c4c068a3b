//! Errors of several models over several participants: means, analyses of variance and comparisons of models, as in
//! chapter 3 of the dissertation.

use serde::{Deserialize, Serialize};

use super::table::ErrorTable;
use carpus_numerics::statistics::{
    Comparison, Effect, Factor, RepeatedMeasures, StatisticsError, pairwise_comparisons,
};
use carpus_study::study::{Contraction, Direction};

/// Mean errors of a model over a participant's held-out trials of one condition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ConditionError {
    /// The participant.
    pub participant: String,
    /// The model.
    pub model: String,
    /// Kind of contraction.
    pub contraction: Contraction,
    /// Effort [% of the maximum voluntary effort].
    pub effort_percent: f64,
    /// Direction of the effort.
    pub direction: Direction,
    /// Trials.
    pub trials: usize,
    /// Equation 3.1.
    pub nrmse: f64,
    /// Pearson's r; `None` where a moment never changes.
    pub pearson_r: Option<f64>,
    /// Root mean square of the error [N·m].
    pub rmse_n_m: f64,
}

/// What is analysed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CohortMeasure {
    /// Equation 3.1.
    Nrmse,
    /// Pearson's correlation coefficient.
    PearsonR,
    /// Root mean square of the error [N·m].
    Rmse,
}

impl CohortMeasure {
    /// All.
    pub const ALL: [CohortMeasure; 3] = [CohortMeasure::Nrmse, CohortMeasure::PearsonR, CohortMeasure::Rmse];

    /// Its key in tables.
    pub fn id(self) -> &'static str {
        match self {
            CohortMeasure::Nrmse => "nrmse",
            CohortMeasure::PearsonR => "pearson_r",
            CohortMeasure::Rmse => "rmse_n_m",
        }
    }

    /// Its column in tables whose unit is in the name, and by what a value is multiplied there.
    pub fn column(self) -> (&'static str, f64) {
        match self {
            CohortMeasure::Nrmse => ("nrmse_percent", 100.0),
            CohortMeasure::PearsonR | CohortMeasure::Rmse => (self.id(), 1.0),
        }
    }

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            CohortMeasure::Nrmse => "NRMSE",
            CohortMeasure::PearsonR => "Pearson's r",
            CohortMeasure::Rmse => "RMSE [N·m]",
        }
    }

    fn of(self, error: &ConditionError) -> Option<f64> {
        match self {
            CohortMeasure::Nrmse => Some(error.nrmse),
            CohortMeasure::PearsonR => error.pearson_r,
            CohortMeasure::Rmse => Some(error.rmse_n_m),
        }
    }
}

/// Held-out isometric and isotonic conditions of a model's errors.
pub fn condition_errors(participant: &str, model: &str, errors: &ErrorTable) -> Vec<ConditionError> {
    let held_out = errors.held_out.iter().flat_map(|set| &set.conditions);
    held_out
        .filter(|c| matches!(c.condition.contraction, Contraction::Isometric | Contraction::Isotonic))
        .filter_map(|c| {
            Some(ConditionError {
                participant: participant.to_owned(),
                model: model.to_owned(),
                contraction: c.condition.contraction,
                effort_percent: c.condition.effort_percent?,
                direction: c.condition.direction,
                trials: c.errors.trials,
                nrmse: c.errors.nrmse.mean.value()?,
                pearson_r: c.errors.pearson_r.mean.value(),
                rmse_n_m: c.errors.rmse_n_m.mean.value()?,
            })
        })
        .collect()
}

/// Mean and standard deviation over participants.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OverParticipants {
    /// Participants that have a value.
    pub participants: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation (n − 1); zero for a single participant.
    pub standard_deviation: f64,
}

/// The errors of a cohort: every participant × model × condition.
#[derive(Clone, Debug, PartialEq)]
pub struct Cohort {
    errors: Vec<ConditionError>,
    participants: Vec<String>,
    models: Vec<String>,
    contractions: Vec<Contraction>,
    efforts: Vec<f64>,
}

impl Cohort {
    /// - `models`: names of the models, in the order in which they are shown
    pub fn new(errors: Vec<ConditionError>, models: Vec<String>) -> Cohort {
        let mut participants: Vec<String> = Vec::new();
        let (mut contractions, mut efforts) = (Vec::new(), Vec::new());
        for error in &errors {
            if !participants.contains(&error.participant) {
                participants.push(error.participant.clone());
            }
            contractions.push(error.contraction);
            efforts.push(error.effort_percent);
        }
        contractions.sort_unstable();
        contractions.dedup();
        efforts.sort_by(f64::total_cmp);
        efforts.dedup();
        Cohort { errors, participants, models, contractions, efforts }
    }

    /// All errors.
    pub fn errors(&self) -> &[ConditionError] {
        &self.errors
    }

    /// Names of the models.
    pub fn models(&self) -> &[String] {
        &self.models
    }

    /// Names of the participants.
    pub fn participants(&self) -> &[String] {
        &self.participants
    }

    /// The evaluation sets: contraction × effort.
    pub fn evaluations(&self) -> Vec<(Contraction, f64)> {
        self.contractions.iter().flat_map(|c| self.efforts.iter().map(move |e| (*c, *e))).collect()
    }

    /// Mean of a measure over those of a participant's and model's conditions that are chosen; each condition counts
    /// the same.
    pub fn value(
        &self,
        participant: &str,
        model: &str,
        measure: CohortMeasure,
        chosen: impl Fn(&ConditionError) -> bool,
    ) -> Option<f64> {
        let of = self.errors.iter().filter(|e| e.participant == participant && e.model == model && chosen(e));
        let (sum, count) = of.filter_map(|e| measure.of(e)).fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
        (count > 0).then(|| sum / count as f64)
    }

    /// Mean ± standard deviation over participants.
    pub fn over_participants(
        &self,
        model: &str,
        measure: CohortMeasure,
        chosen: impl Fn(&ConditionError) -> bool,
    ) -> Option<OverParticipants> {
        let values: Vec<f64> =
            self.participants.iter().filter_map(|p| self.value(p, model, measure, &chosen)).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        (!values.is_empty()).then(|| OverParticipants {
            participants: values.len(),
            mean,
            standard_deviation: if values.len() > 1 { (squares / (n - 1.0)).sqrt() } else { 0.0 },
        })
    }

    /// Values of participants who have all of the cells; one row each.
    fn rows(&self, measure: CohortMeasure, cells: &[(&str, Contraction, f64)]) -> Vec<Vec<f64>> {
        let row = |participant: &String| -> Option<Vec<f64>> {
            let cell = |(model, contraction, effort): &(&str, Contraction, f64)| {
                let chosen = |e: &ConditionError| e.contraction == *contraction && e.effort_percent == *effort;
                self.value(participant, model, measure, chosen)
            };
            cells.iter().map(cell).collect()
        };
        self.participants.iter().filter_map(row).collect()
    }

    /// Model × evaluation contraction × evaluation effort within participants (tables 3.3 and 3.4); factors of a single
    /// level are left out.
    ///
    /// # Errors
    /// Fewer than two participants with all conditions, or nothing that differs.
    pub fn anova(&self, measure: CohortMeasure) -> Result<Vec<Effect>, StatisticsError> {
        let mut factors = vec![
            Factor::new("model type", self.models.iter()),
            Factor::new("evaluation type", self.contractions.iter().map(|c| c.word())),
            Factor::new("effort level", self.efforts.iter().map(f64::to_string)),
        ];
        factors.retain(|f| f.levels.len() > 1);
        let mut cells = Vec::new();
        for model in &self.models {
            for (contraction, effort) in self.evaluations() {
                cells.push((model.as_str(), contraction, effort));
            }
        }
        Ok(RepeatedMeasures::new(factors, &self.rows(measure, &cells))?.anova())
    }

    /// All pairs of models in one evaluation set, with Bonferroni's correction for their number.
    ///
    /// # Errors
    /// Fewer than two participants with all models; two models that differ by the same amount in all participants.
    pub fn pairwise(
        &self,
        measure: CohortMeasure,
        contraction: Contraction,
        effort: f64,
    ) -> Result<Vec<Comparison>, StatisticsError> {
        let cells: Vec<_> = self.models.iter().map(|m| (m.as_str(), contraction, effort)).collect();
        pairwise_comparisons(&self.models, &self.rows(measure, &cells))
    }
}
