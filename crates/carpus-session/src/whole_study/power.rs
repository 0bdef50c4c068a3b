//! Could this many participants have shown it? The power analysis of chapter 3, on the study's own effect.

use super::evaluate;
use super::step::{Context, Step, Told};
use crate::account::{csv_text, digits, fixed};
use crate::diagnostic::Failure;
use crate::evaluate::LINEAR;
use crate::loading::LoadedParticipant;
use crate::report_parts::{ReportParts, overview};
use crate::units::Unit;
use carpus_numerics::statistics::{PowerAnalysis, Tails, TestDesign, paired_t_test};
use carpus_report::article::{Block, TextTable, p_text};
use carpus_simulation::evaluation::{Cohort, CohortMeasure};

/// The step.
pub(super) struct Power;

/// Power that is asked for.
const WANTED: f64 = 0.8;

impl Step for Power {
    fn id(&self) -> &'static str {
        "power"
    }

    fn title(&self) -> &'static str {
        "Power"
    }

    fn units<'a>(&self, _: &'a Context, _: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        Ok(Vec::new())
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let errors = evaluate::cohort(context)?;
        let mut models: Vec<String> = Vec::new();
        for error in &errors {
            if error.model != LINEAR && !models.contains(&error.model) {
                models.push(error.model.clone());
            }
        }
        let cohort = Cohort::new(errors, models.clone());
        let (mut rows, mut csv) = (Vec::new(), Vec::new());
        for model in &models {
            let pairs: Vec<[f64; 2]> = cohort
                .participants()
                .iter()
                .filter_map(|p| {
                    let of = |m: &str| cohort.value(p, m, CohortMeasure::Nrmse, |_| true);
                    Some([of(LINEAR)?, of(model)?])
                })
                .collect();
            let column = |k: usize| pairs.iter().map(|p| p[k]).collect::<Vec<f64>>();
            let Ok(test) = paired_t_test(&column(0), &column(1)) else { continue };
            let d = test.cohen_d_z.abs();
            let analysis =
                PowerAnalysis { design: TestDesign::PairedT { cohen_d_z: d }, alpha: 0.05, tails: Tails::Two };
            let power = analysis.power(pairs.len()).ok();
            // An effect near zero needs more participants than there are people.
            let needed = analysis.needed_n(WANTED).ok();
            let or_dash = |v: Option<String>| v.unwrap_or_else(|| "–".to_string());
            rows.push(vec![
                model.replace('_', " "),
                format!("{} ± {}", fixed(100.0 * test.mean_difference, 2), fixed(100.0 * test.standard_error, 2)),
                p_text(test.p_value),
                fixed(test.cohen_d_z, 2),
                or_dash(power.map(|p| fixed(p, 2))),
                or_dash(needed.map(|n| n.to_string())),
            ]);
            let mut row = vec![model.clone(), pairs.len().to_string()];
            row.extend([test.mean_difference, test.standard_error, test.p_value, test.cohen_d_z].map(digits));
            row.push(power.map(digits).unwrap_or_default());
            row.push(needed.map(|n| n.to_string()).unwrap_or_default());
            csv.push(row);
        }
        if rows.is_empty() {
            return Ok(Told::NotRun(
                "there are no errors of fitted models on held-out trials of at least two participants".to_string(),
            ));
        }
        let header = ["model", "fall of NRMSE ± SE [%]", "p", "d_z", "power", "n for 0.8"];
        let columns =
            ["model", "participants", "mean_difference", "standard_error", "p", "cohen_d_z", "power", "needed_n"];
        let shown = overview("", &header, 1, rows.clone());
        Ok(Told::Parts(ReportParts {
            blocks: vec![Block::Table(TextTable {
                title: "Each training case against the linearly scaled model, paired t-test on held-out \
                        NRMSE"
                    .to_string(),
                header: header.map(String::from).to_vec(),
                left_columns: 1,
                rows,
                note: "Post hoc, two-sided, α = 0.05; power computed from the effect that was found says no more than \
                       its p-value."
                    .to_string(),
            })],
            tables: vec![("power.csv".to_string(), csv_text(columns.iter(), csv.into_iter())?)],
            overview: vec![shown],
            ..ReportParts::default()
        }))
    }
}
