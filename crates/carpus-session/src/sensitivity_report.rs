//! Tables and figures of sensitivity over participants: chapter 2 of the dissertation.

use super::account::{csv_text, digits, fixed};
use super::anova::{EFFECT_COLUMNS, EFFECT_HEADER, effect_cells, effect_columns};
use super::diagnostic::Failure;
use super::report_parts::{ReportParts, overview};
use super::screening::{ConditionSensitivity, condition_name};
use carpus_numerics::statistics::Comparison;
use carpus_personalization::sensitivity::{Cell, ScreenedProperty, SensitivityCohort};
use carpus_report::article::{Block, TextTable, p_text};
use carpus_report::bars::{BarFigure, heat_map, legend};
use carpus_report::convergence::{convergence_figure, convergence_legend};
use carpus_study::study::Contraction;

/// The whole account of a screening.
///
/// # Errors
/// None that input can cause.
pub fn report(outcomes: &[ConditionSensitivity]) -> Result<ReportParts, Failure> {
    let cohort = SensitivityCohort::new(outcomes.iter().flat_map(ConditionSensitivity::cohort_indices).collect());
    let mut parts = ReportParts {
        overview: vec![indices_overview(outcomes)],
        lead: lead(&cohort),
        tables: vec![
            ("morris.csv".to_string(), morris_csv(outcomes)?),
            ("convergence.csv".to_string(), convergence_csv(outcomes)?),
            ("sensitivity_means.csv".to_string(), means_csv(&cohort)?),
        ],
        ..ReportParts::default()
    };
    if outcomes.iter().any(|o| o.sobol.is_some()) {
        parts.tables.push(("sobol.csv".to_string(), sobol_csv(outcomes)?));
    }
    let (runs, failed, lost) = outcomes.iter().fold((0, 0, 0), |(runs, failed, lost), o| {
        (runs + o.morris.runs, failed + o.morris.failures.len(), lost + o.morris.lost_effects)
    });
    parts.blocks.push(Block::Text(format!(
        "Morris screening of 5 parameters per muscle within the bounds of table 2.1; the response is NRMSE + MaxErr + \
         XCorr. \
         {runs} runs, {failed} failed, {lost} elementary effects lost."
    )));
    parts.blocks.push(Block::Table(means_table(&cohort)));
    parts.blocks.push(conditions_figure(&cohort));
    anova_of_conditions(&cohort, &mut parts)?;
    pairs_of_conditions(&cohort, &mut parts)?;
    parts.blocks.extend(muscles_figure(&cohort));
    anova_of_muscles(&cohort, &mut parts)?;
    pairs_of_muscles(&cohort, &mut parts)?;
    parts.blocks.extend(convergence_block(outcomes));
    parts.blocks.extend(sobol_block(outcomes));
    Ok(parts)
}

fn cell_name(cell: Cell) -> String {
    condition_name((cell.0, Some(cell.1)))
}

fn words(property: ScreenedProperty) -> String {
    property.name().replace('_', " ")
}

fn lead(cohort: &SensitivityCohort) -> String {
    let ranked = cohort.ranked();
    match ranked.as_slice() {
        [first, second, ..] => format!(
            "The error responds most to {} (μ* {}), then to {} (μ* {}).",
            words(first.0),
            fixed(first.1, 2),
            words(second.0),
            fixed(second.1, 2)
        ),
        _ => String::new(),
    }
}

fn means_table(cohort: &SensitivityCohort) -> TextTable {
    let cells = cohort.cells();
    let mut header = vec!["parameter".to_string()];
    header.extend(cells.iter().map(|c| cell_name(*c)));
    let rows = ScreenedProperty::ALL.into_iter().map(|property| {
        let mut row = vec![words(property)];
        row.extend(cells.iter().map(|c| {
            cohort
                .mean_index(property, *c, None)
                .map_or("–".to_string(), |m| format!("{} ± ({})", fixed(m.mu_star, 3), fixed(m.sigma, 3)))
        }));
        row
    });
    TextTable {
        title: "Table 2.2: mean sensitivity indices μ* ± (σ)".to_string(),
        header,
        left_columns: 1,
        rows: rows.collect(),
        note: "Mean over participants and muscles.".to_string(),
    }
}

fn conditions_figure(cohort: &SensitivityCohort) -> Block {
    let cells = cohort.cells();
    let value =
        |property, cell| cohort.mean_index(property, cell, None).map(|m| (m.mu_star, m.deviation_over_participants));
    let figure = BarFigure {
        description: "Mean sensitivity of every parameter in every condition".to_string(),
        groups: ScreenedProperty::ALL.into_iter().map(words).collect(),
        series: cells.iter().map(|c| cell_name(*c)).collect(),
        values: ScreenedProperty::ALL.into_iter().map(|p| cells.iter().map(|c| value(p, *c)).collect()).collect(),
        size: [900.0, 230.0],
    };
    Block::Figures {
        title: "Figure 2.3: μ* by condition".to_string(),
        note: legend(&figure.series),
        columns: 1,
        figures: vec![(String::new(), figure.svg())],
    }
}

fn muscles_figure(cohort: &SensitivityCohort) -> Vec<Block> {
    let cells: Vec<Cell> = cohort.cells().into_iter().filter(|c| c.0 == Contraction::Isotonic).collect();
    if cells.is_empty() || cohort.muscles().len() < 2 {
        return Vec::new();
    }
    let figure = |cell: Cell| {
        let value = |property, muscle: &String| {
            cohort.mean_index(property, cell, Some(muscle)).map(|m| (m.mu_star, m.deviation_over_participants))
        };
        let figure = BarFigure {
            description: format!("Sensitivity by muscle, {}", cell_name(cell)),
            groups: ScreenedProperty::ALL.into_iter().map(words).collect(),
            series: cohort.muscles().to_vec(),
            values: ScreenedProperty::ALL
                .into_iter()
                .map(|p| cohort.muscles().iter().map(|m| value(p, m)).collect())
                .collect(),
            size: [900.0, 220.0],
        };
        (cell_name(cell), figure.svg())
    };
    vec![Block::Figures {
        title: "Figure 2.4: μ* by muscle, isotonic conditions".to_string(),
        note: legend(cohort.muscles()),
        columns: 1,
        figures: cells.into_iter().map(figure).collect(),
    }]
}

fn anova_of_conditions(cohort: &SensitivityCohort, parts: &mut ReportParts) -> Result<(), Failure> {
    let (mut shown, mut rows, mut json) = (Vec::new(), Vec::new(), Vec::new());
    let mut reason = None;
    for property in ScreenedProperty::ALL {
        let effects = match cohort.anova_of_conditions(property) {
            Ok(effects) => effects,
            Err(error) => {
                reason = Some(error.to_string());
                continue;
            }
        };
        for e in &effects {
            let mut row = vec![words(property), e.name()];
            row.extend(effect_cells(e, 3));
            shown.push(row);
            let mut row = vec![property.name().to_string(), e.name()];
            row.extend(effect_columns(e));
            rows.push(row);
        }
        json.push(serde_json::json!({ "property": property, "effects": effects }));
    }
    if let Some(reason) = reason.filter(|_| shown.is_empty()) {
        parts.blocks.push(Block::Text(format!("No tests over conditions: {reason}.")));
    }
    parts.anova = json.into();
    if shown.is_empty() {
        return Ok(());
    }
    let mut header = vec!["parameter", "factor"];
    header.extend(EFFECT_HEADER);
    parts.overview.push(overview("", &header, 2, shown.clone()));
    parts.blocks.push(Block::Table(TextTable {
        title: "Table 2.3: analysis of variance across conditions".to_string(),
        header: header.into_iter().map(String::from).collect(),
        left_columns: 2,
        rows: shown,
        note: "μ* averaged over muscles, within participants. Factors of two levels are spherical by themselves."
            .to_string(),
    }));
    let columns = ["property", "effect"].iter().chain(&EFFECT_COLUMNS);
    parts.tables.push(("anova.csv".to_string(), csv_text(columns, rows.into_iter())?));
    Ok(())
}

fn pairs_of_conditions(cohort: &SensitivityCohort, parts: &mut ReportParts) -> Result<(), Failure> {
    let (mut main, mut interactions, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    for property in ScreenedProperty::ALL {
        let factors = ["contraction", "effort"];
        for (factor, comparisons) in factors.into_iter().zip(cohort.main_effects(property).ok().into_iter().flatten()) {
            for c in comparisons {
                let difference =
                    format!("{} ± ({})", fixed(c.test.mean_difference, 3), fixed(c.test.standard_error, 3));
                let pair = format!("{} − {}", c.first, c.second);
                main.push(vec![words(property), factor.to_string(), pair, difference, p_text(c.p_bonferroni)]);
                let mut row = vec![property.name().to_string(), factor.to_string(), c.first, c.second];
                row.extend(test_columns(&c.test, c.p_bonferroni));
                rows.push(row);
            }
        }
        for c in cohort.interactions(property).unwrap_or_default() {
            let (first, second) = (cell_name(c.first), cell_name(c.second));
            let difference = format!("{} ± {}", fixed(c.test.mean_difference, 3), fixed(c.test.standard_error, 3));
            interactions.push(vec![
                words(property),
                first.clone(),
                second.clone(),
                difference,
                p_text(c.test.p_value),
                p_text(c.p_bonferroni),
            ]);
            let mut row = vec![property.name().to_string(), "interaction".to_string(), first, second];
            row.extend(test_columns(&c.test, c.p_bonferroni));
            rows.push(row);
        }
    }
    if rows.is_empty() {
        return Ok(());
    }
    let strings = |words: &[&str]| words.iter().map(|w| (*w).to_string()).collect::<Vec<_>>();
    parts.blocks.push(Block::Table(TextTable {
        title: "Table 2.4: pairs of contractions and of efforts".to_string(),
        header: strings(&["parameter", "factor", "pair", "difference ± SE", "p (Bonferroni)"]),
        left_columns: 3,
        rows: main,
        note: String::new(),
    }));
    parts.blocks.push(Block::Table(TextTable {
        title: "Table 2.3b: pairs of conditions that differ in one factor".to_string(),
        header: strings(&["parameter", "first", "second", "difference ± SE", "p", "p (Bonferroni)"]),
        left_columns: 3,
        rows: interactions,
        note: "The correction is for the pairs of one parameter.".to_string(),
    }));
    let columns = ["property", "factor", "first", "second"].iter().chain(&TEST_COLUMNS);
    parts.tables.push(("pairwise.csv".to_string(), csv_text(columns, rows.into_iter())?));
    Ok(())
}

const TEST_COLUMNS: [&str; 7] = ["mean_difference", "standard_error", "t", "df", "p", "p_bonferroni", "cohen_d_z"];

fn test_columns(test: &carpus_numerics::statistics::PairedT, p_bonferroni: f64) -> Vec<String> {
    let mut row: Vec<String> = [test.mean_difference, test.standard_error, test.t].map(digits).to_vec();
    row.push(test.df.to_string());
    row.extend([test.p_value, p_bonferroni, test.cohen_d_z].map(digits));
    row
}

fn anova_of_muscles(cohort: &SensitivityCohort, parts: &mut ReportParts) -> Result<(), Failure> {
    let (mut shown, mut rows) = (Vec::new(), Vec::new());
    for property in ScreenedProperty::ALL {
        for cell in cohort.cells() {
            let Ok(e) = cohort.anova_of_muscles(property, cell) else { continue };
            let mut row = vec![words(property), cell_name(cell)];
            row.extend(effect_cells(&e, 3));
            shown.push(row);
            let mut row = vec![property.name().to_string(), cell.0.word().to_string(), cell.1.to_string()];
            row.extend(effect_columns(&e));
            rows.push(row);
        }
    }
    if rows.is_empty() {
        return Ok(());
    }
    let mut header = vec!["parameter".to_string(), "condition".to_string()];
    header.extend(EFFECT_HEADER.map(String::from));
    parts.blocks.push(Block::Table(TextTable {
        title: "Table 2.5: analysis of variance across muscles".to_string(),
        header,
        left_columns: 2,
        rows: shown,
        note: String::new(),
    }));
    let columns = ["property", "contraction", "effort_percent"].iter().chain(&EFFECT_COLUMNS);
    parts.tables.push(("anova_muscles.csv".to_string(), csv_text(columns, rows.into_iter())?));
    Ok(())
}

fn pairs_of_muscles(cohort: &SensitivityCohort, parts: &mut ReportParts) -> Result<(), Failure> {
    let muscles = cohort.muscles();
    let at = |name: &str| muscles.iter().position(|m| m == name);
    let (mut rows, mut figures) = (Vec::new(), Vec::new());
    for cell in cohort.cells() {
        for property in ScreenedProperty::ALL {
            let Ok(pairs) = cohort.pairs_of_muscles(property, cell) else { continue };
            let mut p: Vec<Vec<Option<f64>>> = vec![vec![None; muscles.len()]; muscles.len()];
            for Comparison { first, second, test, p_bonferroni, .. } in pairs {
                if let (Some(i), Some(j)) = (at(&first), at(&second)) {
                    (p[i][j], p[j][i]) = (Some(p_bonferroni), Some(p_bonferroni));
                }
                let mut row =
                    vec![property.name().to_string(), cell.0.word().to_string(), cell.1.to_string(), first, second];
                row.extend(test_columns(&test, p_bonferroni));
                rows.push(row);
            }
            if cell.0 == Contraction::Isotonic {
                let caption = format!("{}, {}", words(property), cell_name(cell));
                figures.push((caption.clone(), heat_map(&caption, muscles, &p)));
            }
        }
    }
    if rows.is_empty() {
        return Ok(());
    }
    if !figures.is_empty() {
        parts.blocks.push(Block::Figures {
            title: "Figure 2.5: pairs of muscles, isotonic conditions".to_string(),
            note: "* p &lt; 0.05, ** p &lt; 0.01, with Bonferroni's correction.".to_string(),
            columns: 4,
            figures,
        });
    }
    let columns = ["property", "contraction", "effort_percent", "first", "second"].iter().chain(&TEST_COLUMNS);
    parts.tables.push(("pairwise_muscles.csv".to_string(), csv_text(columns, rows.into_iter())?));
    Ok(())
}

/// μ* of each property from the first starts only, averaged over participants and muscles; and whether more would
/// change it.
fn convergence_block(outcomes: &[ConditionSensitivity]) -> Vec<Block> {
    let mut cells: Vec<(Contraction, Option<f64>)> = Vec::new();
    for o in outcomes {
        if !cells.contains(&(o.contraction, o.effort_percent)) {
            cells.push((o.contraction, o.effort_percent));
        }
    }
    let mut figures = Vec::new();
    let mut widest: f64 = 0.0;
    for cell in cells {
        let of: Vec<&ConditionSensitivity> =
            outcomes.iter().filter(|o| (o.contraction, o.effort_percent) == cell).collect();
        let Some(first) = of.first() else { continue };
        let starts: Vec<f64> = first.convergence.iter().map(|c| c.r as f64).collect();
        let curves: Vec<(String, Vec<f64>)> = ScreenedProperty::ALL
            .into_iter()
            .map(|property| {
                let suffix = format!(".{}", property.name());
                let mean = |step: usize| {
                    let values: Vec<f64> = of
                        .iter()
                        .filter_map(|o| Some((o, o.convergence.get(step)?)))
                        .flat_map(|(o, c)| o.morris.indices.iter().zip(&c.mu_star))
                        .filter(|(index, _)| index.name.ends_with(&suffix))
                        .map(|(_, v)| *v)
                        .collect();
                    values.iter().sum::<f64>() / values.len() as f64
                };
                (words(property), (0..starts.len()).map(mean).collect())
            })
            .collect();
        let last = of.iter().filter_map(|o| o.convergence.last()).map(|c| c.widest_interval);
        widest = last.fold(widest, f64::max);
        let caption = condition_name(cell);
        figures.push((caption.clone(), convergence_figure(&caption, &starts, &curves)));
    }
    if figures.is_empty() {
        return Vec::new();
    }
    vec![Block::Figures {
        title: "Convergence of μ* with the starts r".to_string(),
        note: format!(
            "{}<br>With all starts the widest 95 % bootstrap interval of a single participant's μ* is \
             {} % of the largest μ*; every interval is in morris.csv.",
            convergence_legend(&ScreenedProperty::ALL.map(words)),
            fixed(100.0 * widest, 0)
        ),
        columns: 2,
        figures,
    }]
}

/// Sobol' indices, averaged over participants and muscles.
fn sobol_block(outcomes: &[ConditionSensitivity]) -> Vec<Block> {
    let mut rows = Vec::new();
    for property in ScreenedProperty::ALL {
        let suffix = format!(".{}", property.name());
        let of = || {
            let sobol = outcomes.iter().filter_map(|o| o.sobol.as_ref());
            sobol.flat_map(|s| &s.indices).filter(|i| i.name.ends_with(&suffix))
        };
        let count = of().count() as f64;
        if count > 0.0 {
            let mean = |value: fn(&carpus_personalization::sensitivity::SobolIndices) -> f64| {
                of().map(value).sum::<f64>() / count
            };
            rows.push(vec![words(property), fixed(mean(|i| i.first_order), 3), fixed(mean(|i| i.total_order), 3)]);
        }
    }
    if rows.is_empty() {
        return Vec::new();
    }
    vec![Block::Table(TextTable {
        title: "Sobol' indices, mean over participants, conditions and muscles".to_string(),
        header: ["parameter", "first order", "total"].map(String::from).to_vec(),
        left_columns: 1,
        rows,
        note: "Shares of the variance of the response; per muscle with intervals in sobol.csv.".to_string(),
    })]
}

fn means_csv(cohort: &SensitivityCohort) -> Result<String, Failure> {
    let header = [
        "property",
        "contraction",
        "effort_percent",
        "muscle",
        "participants",
        "mu_star",
        "deviation_over_participants",
        "sigma",
    ];
    let mut rows = Vec::new();
    for property in ScreenedProperty::ALL {
        for cell in cohort.cells() {
            let muscles = cohort.muscles().iter().map(|m| Some(m.as_str())).chain([None]);
            for muscle in muscles {
                let Some(m) = cohort.mean_index(property, cell, muscle) else { continue };
                let mut row = vec![property.name().to_string(), cell.0.word().to_string(), cell.1.to_string()];
                row.extend([muscle.unwrap_or("all").to_string(), m.participants.to_string()]);
                row.extend([m.mu_star, m.deviation_over_participants, m.sigma].map(digits));
                rows.push(row);
            }
        }
    }
    csv_text(header.iter(), rows.into_iter())
}

/// Per participant and condition μ* averaged over muscles, and what failed.
fn indices_overview(outcomes: &[ConditionSensitivity]) -> TextTable {
    let mut header = vec!["participant", "condition", "trials", "runs", "failed", "lost effects"];
    header.extend(ScreenedProperty::ALL.map(ScreenedProperty::name));
    let rows = outcomes.iter().map(|o| {
        let mut row = vec![o.participant.clone(), o.condition(), o.trials.len().to_string()];
        row.extend([o.morris.runs, o.morris.failures.len(), o.morris.lost_effects].map(|n| n.to_string()));
        row.extend(ScreenedProperty::ALL.map(|property| fixed(o.mean_mu_star(property), 3)));
        row
    });
    overview("μ*, mean over muscles", &header, 2, rows.collect())
}

/// Participant, contraction, effort, muscle and property: the first cells of a row.
fn key(outcome: &ConditionSensitivity, parameter: &str) -> Vec<String> {
    let (muscle, property) = parameter.rsplit_once('.').unwrap_or((parameter, ""));
    let effort = outcome.effort_percent.map_or(String::new(), |e| e.to_string());
    vec![outcome.participant.clone(), outcome.contraction.word().to_string(), effort, muscle.into(), property.into()]
}

const KEY_COLUMNS: [&str; 5] = ["participant", "contraction", "effort_percent", "muscle", "property"];

fn bounds(interval: Option<[f64; 2]>) -> [String; 2] {
    interval.map_or([String::new(), String::new()], |ends| ends.map(|v| v.to_string()))
}

fn morris_csv(outcomes: &[ConditionSensitivity]) -> Result<String, Failure> {
    let columns =
        ["mu", "mu_star", "mu_star_lower_95", "mu_star_upper_95", "sigma", "sigma_lower_95", "sigma_upper_95"];
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.morris.indices.iter().map(move |index| {
            let mut row = key(outcome, &index.name);
            row.extend([index.mu.to_string(), index.mu_star.to_string()]);
            row.extend(bounds(index.mu_star_interval_95));
            row.push(index.sigma.to_string());
            row.extend(bounds(index.sigma_interval_95));
            row.push(index.n_effects.to_string());
            row
        })
    });
    csv_text(KEY_COLUMNS.iter().chain(&columns).chain(&["n_effects"]), rows)
}

fn sobol_csv(outcomes: &[ConditionSensitivity]) -> Result<String, Failure> {
    let columns = [
        "first_order",
        "first_order_lower_95",
        "first_order_upper_95",
        "total_order",
        "total_order_lower_95",
        "total_order_upper_95",
        "n_rows",
    ];
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.sobol.iter().flat_map(|sobol| &sobol.indices).map(move |index| {
            let mut row = key(outcome, &index.name);
            row.push(index.first_order.to_string());
            row.extend(bounds(index.first_order_interval_95));
            row.push(index.total_order.to_string());
            row.extend(bounds(index.total_order_interval_95));
            row.push(index.n_rows.to_string());
            row
        })
    });
    csv_text(KEY_COLUMNS.iter().chain(&columns), rows)
}

fn convergence_csv(outcomes: &[ConditionSensitivity]) -> Result<String, Failure> {
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.convergence.iter().flat_map(move |step| {
            outcome.morris.indices.iter().zip(&step.mu_star).map(move |(index, mu_star)| {
                let mut row = key(outcome, &index.name);
                row.extend([step.r.to_string(), mu_star.to_string(), step.widest_interval.to_string()]);
                row
            })
        })
    });
    csv_text(KEY_COLUMNS.iter().chain(&["starts", "mu_star", "widest_interval_of_largest"]), rows)
}
