//! What the dissertation concluded, beside what this study shows: every verdict is computed from the steps before.

use super::scale::STRENGTH;
use super::step::{Context, Step, Told};
use super::{evaluate, ultrasound};
use crate::account::{csv_text, fixed};
use crate::diagnostic::Failure;
use crate::evaluate::LINEAR;
use crate::loading::LoadedParticipant;
use crate::report_parts::{ReportParts, overview};
use crate::screening::ConditionSensitivity;
use crate::units::Unit;
use carpus_numerics::statistics::{PairedT, paired_t_test};
use carpus_personalization::sensitivity::{ScreenedProperty, SensitivityCohort};
use carpus_report::article::{Block, TextTable, p_text};
use carpus_simulation::evaluation::{Cohort, CohortMeasure};

/// The step.
pub(super) struct Conclusions;

/// Significance level.
const ALPHA: f64 = 0.05;

/// Whether a conclusion holds on this study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Holds,
    /// The opposite was found.
    Contradicted,
    /// Neither.
    NotShown,
}

impl Verdict {
    fn words(self) -> &'static str {
        match self {
            Verdict::Holds => "holds",
            Verdict::Contradicted => "does not hold",
            Verdict::NotShown => "not shown",
        }
    }

    /// Of a difference that is expected below 0.
    fn of_fall(test: &PairedT) -> Verdict {
        match (test.p_value < ALPHA, test.mean_difference < 0.0) {
            (true, true) => Verdict::Holds,
            (true, false) => Verdict::Contradicted,
            _ => Verdict::NotShown,
        }
    }

    /// Of a difference that is expected not to be there.
    fn of_none(significant: bool) -> Verdict {
        if significant { Verdict::Contradicted } else { Verdict::Holds }
    }
}

/// A conclusion.
struct Conclusion {
    chapter: u8,
    claim: &'static str,
    here: String,
    verdict: Verdict,
}

impl Step for Conclusions {
    fn id(&self) -> &'static str {
        "conclusions"
    }

    fn title(&self) -> &'static str {
        "Beside the dissertation"
    }

    fn units<'a>(&self, _: &'a Context, _: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        Ok(Vec::new())
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let screened: Vec<ConditionSensitivity> = context.store.finished("sensitivity")?;
        let indices = screened.iter().flat_map(ConditionSensitivity::cohort_indices).collect();
        let mut all = of_sensitivity(&SensitivityCohort::new(indices));
        let errors = evaluate::cohort(context)?;
        let mut models: Vec<String> = Vec::new();
        for error in &errors {
            if !models.contains(&error.model) {
                models.push(error.model.clone());
            }
        }
        all.extend(of_evaluation(&Cohort::new(errors, models)));
        all.extend(of_images(&ultrasound::correlations(context)?));
        if all.is_empty() {
            return Ok(Told::NotRun("none of the steps that they rest on has two participants or more".to_string()));
        }
        let rows: Vec<Vec<String>> = all
            .iter()
            .map(|c| vec![c.chapter.to_string(), c.claim.to_string(), c.here.clone(), c.verdict.words().to_string()])
            .collect();
        let header = ["chapter", "Jadelis (2025)", "this study", "verdict"];
        let count = |v: Verdict| all.iter().filter(|c| c.verdict == v).count();
        let lead = format!(
            "Of {} conclusions of Jadelis (2025), {} hold here, {} do not, and {} are not shown either way.",
            all.len(),
            count(Verdict::Holds),
            count(Verdict::Contradicted),
            count(Verdict::NotShown)
        );
        Ok(Told::Parts(ReportParts {
            overview: vec![overview("", &header, 4, rows.clone())],
            tables: vec![(
                "conclusions.csv".to_string(),
                csv_text(["chapter", "claim", "here", "verdict"].iter(), rows.iter().cloned())?,
            )],
            blocks: vec![
                Block::Text(lead.clone()),
                Block::Table(TextTable {
                    title: "Which of its conclusions hold".to_string(),
                    header: header.map(String::from).to_vec(),
                    left_columns: 4,
                    rows,
                    note:
                        "Paired t-tests over participants, two-sided, α = 0.05, without correction for their number. \
                           Where no \
                           difference is claimed, holds means that none was found."
                            .to_string(),
                }),
            ],
            lead,
            ..ReportParts::default()
        }))
    }
}

fn words(property: ScreenedProperty) -> String {
    property.name().replace('_', " ")
}

fn difference(test: &PairedT, scale: f64, decimals: usize, unit: &str) -> String {
    let [mean, error] = [test.mean_difference, test.standard_error].map(|v| fixed(scale * v, decimals));
    format!("{mean} ± {error}{unit}, p {}", p_text(test.p_value).trim_end_matches('*'))
}

/// Chapter 2.
fn of_sensitivity(cohort: &SensitivityCohort) -> Vec<Conclusion> {
    let mut all = Vec::new();
    let ranked = cohort.ranked();
    if let [first, second, ..] = ranked.as_slice() {
        let most = first.0 == ScreenedProperty::TendonSlackLength;
        all.push(Conclusion {
            chapter: 2,
            claim: "Tendon slack length influences the model's error most",
            here: format!(
                "μ* of {} {}, of {} {}",
                words(first.0),
                fixed(first.1, 2),
                words(second.0),
                fixed(second.1, 2)
            ),
            verdict: if most { Verdict::Holds } else { Verdict::Contradicted },
        });
    }
    let main = |p| cohort.main_effects(p).ok();
    for (property, claim) in [
        (
            ScreenedProperty::TendonSlackLength,
            "Tendon slack length is more influential in isotonic than in isometric trials",
        ),
        (
            ScreenedProperty::OptimalFiberLength,
            "Optimal fibre length is more influential in isotonic than in isometric trials",
        ),
    ] {
        let Some([contractions, _]) = main(property) else { continue };
        let Some(pair) = contractions.iter().find(|c| c.first == "isometric" && c.second == "isotonic") else {
            continue;
        };
        all.push(Conclusion {
            chapter: 2,
            claim,
            here: format!("μ* isometric − isotonic {}", difference(&pair.test, 1.0, 3, "")),
            verdict: Verdict::of_fall(&pair.test),
        });
    }
    if let Some([contractions, efforts]) = main(ScreenedProperty::MaxIsometricForce) {
        let least = |pairs: &[carpus_numerics::statistics::Comparison]| {
            pairs.iter().map(|c| c.p_bonferroni).fold(1.0, f64::min)
        };
        let [by_contraction, by_effort] = [least(&contractions), least(&efforts)];
        all.push(Conclusion {
            chapter: 2,
            claim: "Maximum isometric force is equally influential in all conditions",
            here: format!(
                "p of contraction {}, of effort {}",
                p_text(by_contraction).trim_end_matches('*'),
                p_text(by_effort).trim_end_matches('*')
            ),
            verdict: Verdict::of_none(by_contraction.min(by_effort) < ALPHA),
        });
    }
    let tested: Vec<(ScreenedProperty, f64)> = ScreenedProperty::ALL
        .into_iter()
        .filter_map(|p| Some((p, main(p)?[1].iter().map(|c| c.p_bonferroni).fold(1.0, f64::min))))
        .collect();
    if !tested.is_empty() {
        let changed: Vec<String> = tested.iter().filter(|(_, p)| *p < ALPHA).map(|(p, _)| words(*p)).collect();
        let others = tested.iter().any(|(p, v)| *v < ALPHA && *p != ScreenedProperty::TendonSlackLength);
        all.push(Conclusion {
            chapter: 2,
            claim: "Of all parameters only the influence of tendon slack length depends on effort",
            here: match changed.as_slice() {
                [] => "no parameter's μ* differs between efforts".to_string(),
                some => format!("μ* differs between efforts for {}", some.join(", ")),
            },
            verdict: Verdict::of_none(others),
        });
    }
    all
}

/// Chapter 3, on held-out NRMSE.
fn of_evaluation(cohort: &Cohort) -> Vec<Conclusion> {
    let mut all = Vec::new();
    let fitted: Vec<&str> =
        cohort.models().iter().map(String::as_str).filter(|m| *m != LINEAR && *m != STRENGTH).collect();
    let of = |words: &[&str]| -> Vec<&str> {
        fitted.iter().copied().filter(|m| words.iter().any(|w| m.split('_').any(|part| part == *w))).collect()
    };
    // Per participant the mean over models of a group minus that over models of another.
    let test = |first: &[&str], second: &[&str]| -> Option<PairedT> {
        let mean = |p: &str, models: &[&str]| -> Option<f64> {
            let of: Option<Vec<f64>> =
                models.iter().map(|m| cohort.value(p, m, CohortMeasure::Nrmse, |_| true)).collect();
            of.filter(|v| !v.is_empty()).map(|v| v.iter().sum::<f64>() / v.len() as f64)
        };
        let pairs: Vec<(f64, f64)> =
            cohort.participants().iter().filter_map(|p| Some((mean(p, first)?, mean(p, second)?))).collect();
        let (first, second): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
        paired_t_test(&first, &second).ok()
    };
    let mut compare = |claim, first: &[&str], second: &[&str], what: &str, verdict: &dyn Fn(&PairedT) -> Verdict| {
        let Some(test) = test(first, second) else { return };
        let here = format!("NRMSE {what} {}", difference(&test, 100.0, 2, " %"));
        all.push(Conclusion { chapter: 3, claim, here, verdict: verdict(&test) });
    };
    compare(
        "Fitted models have a lower error than the linearly scaled one",
        &fitted,
        &[LINEAR],
        "fitted − linear",
        &Verdict::of_fall,
    );
    compare(
        "Fitted models have a lower error than the strength-scaled one",
        &fitted,
        &[STRENGTH],
        "fitted − strength scaled",
        &Verdict::of_fall,
    );
    compare(
        "Training on both kinds of contraction gives a lower error than on one",
        &of(&["combined", "cross"]),
        &of(&["isometric", "isotonic"]),
        "both − one",
        &Verdict::of_fall,
    );
    compare(
        "Isotonic training gives a lower error than isometric training (its hypothesis)",
        &of(&["isotonic"]),
        &of(&["isometric"]),
        "isotonic − isometric",
        &Verdict::of_fall,
    );
    let efforts = |light: &str| of(&[light]);
    compare(
        "The effort of the training trials makes no difference",
        &efforts("25"),
        &efforts("50"),
        "25 % − 50 %",
        &|t| Verdict::of_none(t.p_value < ALPHA),
    );
    let mut ranked: Vec<(&str, f64)> = fitted
        .iter()
        .filter_map(|m| Some((*m, cohort.over_participants(m, CohortMeasure::Nrmse, |_| true)?.mean)))
        .collect();
    ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
    if let [best, next, ..] = ranked.as_slice() {
        let named = |(m, v): &(&str, f64)| format!("{} % with {} %", fixed(100.0 * v, 2), m.replace('_', " "));
        all.push(Conclusion {
            chapter: 3,
            claim: "Combined training at 25 % has the lowest mean error of all cases",
            here: format!("{}, then {}", named(best), named(next)),
            verdict: if best.0 == "combined_25" { Verdict::Holds } else { Verdict::Contradicted },
        });
    }
    all
}

/// Chapter 4.
///
/// - `cases`: key of the model, quantity, Pearson's r and p
fn of_images(cases: &[(String, String, f64, f64)]) -> Vec<Conclusion> {
    let lengths: Vec<&(String, String, f64, f64)> =
        cases.iter().filter(|(_, quantity, ..)| quantity == "belly_length" || quantity == "tendon_length").collect();
    if lengths.is_empty() {
        return Vec::new();
    }
    let positive = lengths.iter().filter(|(.., r, p)| *r > 0.0 && *p < ALPHA).count();
    let mut all = vec![Conclusion {
        chapter: 4,
        claim: "Fibre and tendon lengths correlate positively with the images, whatever the model",
        here: format!("{positive} of {} correlations with p < 0.05", lengths.len()),
        verdict: if positive == lengths.len() { Verdict::Holds } else { Verdict::Contradicted },
    }];
    let mean = |linear: bool| {
        let of: Vec<f64> =
            lengths.iter().filter(|(m, ..)| (m == LINEAR) == linear && m != STRENGTH).map(|l| l.2).collect();
        (!of.is_empty()).then(|| of.iter().sum::<f64>() / of.len() as f64)
    };
    if let (Some(linear), Some(fitted)) = (mean(true), mean(false)) {
        all.push(Conclusion {
            chapter: 4,
            claim: "Fitting lengths to moments does not bring them closer to the images than scaling does",
            here: format!("mean r of lengths, fitted {}, linearly scaled {}", fixed(fitted, 2), fixed(linear, 2)),
            verdict: if fitted <= linear { Verdict::Holds } else { Verdict::Contradicted },
        });
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_simulation::evaluation::ConditionError;
    use carpus_study::study::{Contraction, Direction};

    #[test]
    fn verif_verdicts_follow_the_numbers() {
        let error = |participant: &str, model: &str, nrmse: f64| ConditionError {
            participant: participant.into(),
            model: model.into(),
            contraction: Contraction::Isotonic,
            effort_percent: 25.0,
            direction: Direction::Flexion,
            trials: 1,
            nrmse,
            pearson_r: None,
            rmse_n_m: 1.0,
        };
        let models = ["isometric_25", "isotonic_25", "combined_25", LINEAR];
        let values = [[0.10, 0.14, 0.08, 0.30], [0.11, 0.16, 0.08, 0.33], [0.09, 0.125, 0.075, 0.28]];
        let errors = values
            .iter()
            .zip(["a", "b", "c"])
            .flat_map(|(row, p)| row.iter().zip(models).map(move |(v, m)| error(p, m, *v)))
            .collect();
        let found = of_evaluation(&Cohort::new(errors, models.map(String::from).to_vec()));
        let verdict = |part: &str| found.iter().find(|c| c.claim.contains(part)).unwrap().verdict;
        assert_eq!(verdict("than the linearly scaled"), Verdict::Holds);
        assert_eq!(verdict("on both kinds"), Verdict::Holds);
        assert_eq!(verdict("its hypothesis"), Verdict::Contradicted);
        assert_eq!(verdict("lowest mean error"), Verdict::Holds);
        assert!(found.iter().all(|c| !c.claim.contains("strength-scaled")), "there is no such model");
        let images = [("combined_25", 0.5, 0.01), (LINEAR, 0.7, 0.01)]
            .map(|(m, r, p)| (m.to_string(), "belly_length".to_string(), r, p));
        assert!(of_images(&images).iter().all(|c| c.verdict == Verdict::Holds));
    }
}
