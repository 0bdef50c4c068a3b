//! Tables and figures of models over participants: chapter 3 of the dissertation.

use serde::{Deserialize, Serialize};

use super::account::{csv_text, digits, fixed};
use super::anova::{EFFECT_COLUMNS, EFFECT_HEADER, effect_cells, effect_columns};
use super::diagnostic::Failure;
use super::loading::LoadedParticipant;
use super::report_parts::{ReportParts, overview};
use carpus_report::article::{Block, TextTable, p_text};
use carpus_report::bars::{BarFigure, legend};
use carpus_report::moments::moment_figure;
use carpus_report::results::{rounded, thinned};
use carpus_simulation::evaluation::{Cohort, CohortMeasure, ConditionError};
use carpus_study::study::{Contraction, Direction};

/// Samples of a moment that are kept for drawing.
const DRAWN_SAMPLES: usize = 150;
/// Measures that are drawn and tested, with the numbers of the dissertation's figures and tables.
const DRAWN: [(CohortMeasure, &str, &str); 2] =
    [(CohortMeasure::PearsonR, "3.3", "3.4"), (CohortMeasure::Nrmse, "3.4", "3.3")];

/// A model's key and what people call it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelName {
    /// Key.
    pub id: String,
    /// Name.
    pub label: String,
}

/// Measured and simulated moments of a held-out trial, over the largest measured moment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Representative {
    /// The participant.
    pub participant: String,
    /// The trial.
    pub trial: String,
    /// Its condition.
    pub contraction: Contraction,
    /// Effort [%].
    pub effort_percent: f64,
    /// Direction.
    pub direction: Direction,
    /// Largest measured moment [N·m].
    pub largest_n_m: f64,
    /// Which samples are kept.
    kept: Vec<usize>,
    /// Time [s].
    pub time_s: Vec<f64>,
    /// Measured moment over the largest.
    pub measured: Vec<f64>,
    /// Simulated moment over the largest measured one, by model.
    pub simulated: Vec<(String, Vec<f64>)>,
}

impl Representative {
    /// Adds a model's moment [N·m].
    pub fn add(&mut self, model: &str, moment: &[f64]) {
        let values = self.kept.iter().map(|&i| rounded(moment[i] / self.largest_n_m, 5)).collect();
        self.simulated.push((model.to_owned(), values));
    }
}

/// The first held-out trial of every condition.
pub fn representatives(run: &LoadedParticipant, held_out: &[usize]) -> Vec<Representative> {
    let mut found: Vec<Representative> = Vec::new();
    for &i in held_out {
        let trial = &run.trials[i];
        let info = &trial.info;
        let Some(effort_percent) = info.effort_percent else { continue };
        let same = |r: &Representative| {
            r.contraction == info.contraction && r.effort_percent == effort_percent && r.direction == info.direction
        };
        let largest_n_m = trial.moment.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        if found.iter().any(same) || !(largest_n_m > 0.0) {
            continue;
        }
        let kept = thinned(trial.len(), DRAWN_SAMPLES);
        found.push(Representative {
            participant: run.participant.name.clone(),
            trial: info.name.clone(),
            contraction: info.contraction,
            effort_percent,
            direction: info.direction,
            largest_n_m: rounded(largest_n_m, 6),
            time_s: kept.iter().map(|&k| rounded(trial.time[k], 6)).collect(),
            measured: kept.iter().map(|&k| rounded(trial.moment[k] / largest_n_m, 5)).collect(),
            simulated: Vec::new(),
            kept,
        });
    }
    found
}

/// The whole evaluation of a cohort.
///
/// # Errors
/// None that input can cause.
pub fn evaluation(cohort: &Cohort, names: &[ModelName], curves: &[Representative]) -> Result<ReportParts, Failure> {
    let mut parts = ReportParts { lead: lead(cohort, names), ..ReportParts::default() };
    parts.tables.push(("evaluation_errors.csv".to_string(), errors_csv(cohort.errors())?));
    parts.tables.push(("evaluation_means.csv".to_string(), means_csv(cohort, names)?));
    parts.blocks.push(Block::Text(
        "Held-out trials only. Every participant counts the same; within a participant every direction counts the \
         same. \
         Whiskers: one standard deviation over participants."
            .to_string(),
    ));
    for (measure, figure, _) in DRAWN {
        parts.blocks.push(by_evaluation(cohort, names, measure, figure));
        parts.blocks.push(by_direction(cohort, names, measure, &format!("{figure}b")));
    }
    parts.blocks.push(Block::Table(means_table(cohort, names)));
    anova(cohort, &mut parts)?;
    pairwise(cohort, names, &mut parts)?;
    parts.blocks.extend(representative_figures(cohort, names, curves));
    parts.overview = vec![errors_overview(cohort, names)];
    Ok(parts)
}

fn all(_: &ConditionError) -> bool {
    true
}

fn in_set(contraction: Contraction, effort: f64) -> impl Fn(&ConditionError) -> bool {
    move |e| e.contraction == contraction && e.effort_percent == effort
}

fn set_name((contraction, effort): (Contraction, f64)) -> String {
    format!("{} {effort} %", contraction.word())
}

fn lead(cohort: &Cohort, names: &[ModelName]) -> String {
    let best = names
        .iter()
        .filter_map(|n| Some((n, cohort.over_participants(&n.id, CohortMeasure::Nrmse, all)?)))
        .min_by(|a, b| a.1.mean.total_cmp(&b.1.mean));
    match best {
        Some((name, found)) => format!(
            "{} models on the held-out trials of {} participant{}. The least mean NRMSE over all of them, {:.1} % ± \
             {:.1} %, \
             has the model {}.",
            names.len(),
            cohort.participants().len(),
            if cohort.participants().len() == 1 { "" } else { "s" },
            100.0 * found.mean,
            100.0 * found.standard_deviation,
            name.label
        ),
        None => "No model has a held-out error.".to_string(),
    }
}

fn labels(names: &[ModelName]) -> Vec<String> {
    names.iter().map(|n| n.label.clone()).collect()
}

fn by_evaluation(cohort: &Cohort, names: &[ModelName], measure: CohortMeasure, number: &str) -> Block {
    let sets = cohort.evaluations();
    let cell = |set: (Contraction, f64), name: &ModelName| {
        let found = cohort.over_participants(&name.id, measure, in_set(set.0, set.1))?;
        Some((found.mean, found.standard_deviation))
    };
    let figure = BarFigure {
        description: format!("{} of every model in every evaluation", measure.label()),
        groups: sets.iter().map(|s| set_name(*s)).collect(),
        series: labels(names),
        values: sets.iter().map(|s| names.iter().map(|n| cell(*s, n)).collect()).collect(),
        size: [900.0, 250.0],
    };
    Block::Figures {
        title: format!("Figure {number}: {} by evaluation", measure.label()),
        note: legend(&figure.series),
        columns: 1,
        figures: vec![(String::new(), figure.svg())],
    }
}

fn by_direction(cohort: &Cohort, names: &[ModelName], measure: CohortMeasure, number: &str) -> Block {
    let directions = [Direction::Flexion, Direction::Extension];
    let cell = |direction: Direction, name: &ModelName| {
        let found = cohort.over_participants(&name.id, measure, |e| e.direction == direction)?;
        Some((found.mean, found.standard_deviation))
    };
    let figure = BarFigure {
        description: format!("{} of every model in flexion and extension", measure.label()),
        groups: directions.iter().map(|d| d.word().to_string()).collect(),
        series: labels(names),
        values: directions.iter().map(|d| names.iter().map(|n| cell(*d, n)).collect()).collect(),
        size: [900.0, 220.0],
    };
    Block::Figures {
        title: format!("Figure {number}: {} by direction", measure.label()),
        note: legend(&figure.series),
        columns: 1,
        figures: vec![(String::new(), figure.svg())],
    }
}

fn means_table(cohort: &Cohort, names: &[ModelName]) -> TextTable {
    let sets = cohort.evaluations();
    let mut header = vec!["model".to_string(), "measure".to_string()];
    header.extend(sets.iter().map(|s| set_name(*s)));
    header.push("all".to_string());
    let mut rows = Vec::new();
    for name in names {
        for measure in CohortMeasure::ALL {
            let text =
                |chosen: &dyn Fn(&ConditionError) -> bool| match cohort.over_participants(&name.id, measure, chosen) {
                    Some(found) => format!("{} ± {}", fixed(found.mean, 3), fixed(found.standard_deviation, 3)),
                    None => "–".to_string(),
                };
            let mut row = vec![name.label.clone(), measure.label().to_string()];
            row.extend(sets.iter().map(|s| text(&in_set(s.0, s.1))));
            row.push(text(&all));
            rows.push(row);
        }
    }
    TextTable {
        title: "Errors, mean ± standard deviation over participants".to_string(),
        header,
        left_columns: 2,
        rows,
        note: String::new(),
    }
}

fn means_csv(cohort: &Cohort, names: &[ModelName]) -> Result<String, Failure> {
    let header = [
        "model",
        "measure",
        "contraction",
        "effort_percent",
        "direction",
        "participants",
        "mean",
        "standard_deviation",
    ];
    let mut rows = Vec::new();
    for name in names {
        for measure in CohortMeasure::ALL {
            let mut push = |cells: [String; 3], chosen: &dyn Fn(&ConditionError) -> bool| {
                if let Some(found) = cohort.over_participants(&name.id, measure, chosen) {
                    let (column, factor) = measure.column();
                    let mut row = vec![name.id.clone(), column.to_string()];
                    row.extend(cells);
                    row.push(found.participants.to_string());
                    row.extend([found.mean, found.standard_deviation].map(|value| digits(factor * value)));
                    rows.push(row);
                }
            };
            let any = || "all".to_string();
            for set in cohort.evaluations() {
                push([set.0.word().to_string(), set.1.to_string(), any()], &in_set(set.0, set.1));
            }
            for direction in [Direction::Flexion, Direction::Extension] {
                push([any(), any(), direction.word().to_string()], &|e| e.direction == direction);
            }
            push([any(), any(), any()], &all);
        }
    }
    csv_text(header.iter(), rows.into_iter())
}

fn anova(cohort: &Cohort, parts: &mut ReportParts) -> Result<(), Failure> {
    let mut rows = Vec::new();
    let mut json = serde_json::Map::new();
    for (measure, _, number) in DRAWN.into_iter().rev() {
        let effects = match cohort.anova(measure) {
            Ok(effects) => effects,
            Err(error) => {
                parts.blocks.push(Block::Text(format!("No analysis of variance of {}: {error}.", measure.label())));
                continue;
            }
        };
        let cells = effects.iter().map(|e| [e.name()].into_iter().chain(effect_cells(e, 2)).collect());
        let header: Vec<&str> = ["comparison"].into_iter().chain(EFFECT_HEADER).collect();
        parts.blocks.push(Block::Table(TextTable {
            title: format!("Table {number}: {}, analysis of variance with repeated measures", measure.label()),
            header: header.into_iter().map(String::from).collect(),
            left_columns: 1,
            rows: cells.collect(),
            note: "Within participants; where Mauchly's test rejects sphericity or cannot be made, the corrected p \
                   counts."
                .to_string(),
        }));
        json.insert(
            measure.id().to_string(),
            serde_json::to_value(&effects).map_err(|e| Failure::Internal(e.to_string()))?,
        );
        rows.extend(effects.iter().map(|e| {
            let mut row = vec![measure.id().to_string(), e.name()];
            row.extend(effect_columns(e));
            row
        }));
    }
    let header = ["measure", "effect"].iter().chain(&EFFECT_COLUMNS);
    if !rows.is_empty() {
        parts.tables.push(("evaluation_anova.csv".to_string(), csv_text(header, rows.into_iter())?));
    }
    parts.anova = json.into();
    Ok(())
}

fn pairwise(cohort: &Cohort, names: &[ModelName], parts: &mut ReportParts) -> Result<(), Failure> {
    let label = |id: &str| names.iter().find(|n| n.id == id).map_or(id.to_string(), |n| n.label.clone());
    let (mut rows, mut shown) = (Vec::new(), Vec::new());
    for (measure, _, _) in DRAWN {
        for (contraction, effort) in cohort.evaluations() {
            let Ok(comparisons) = cohort.pairwise(measure, contraction, effort) else { continue };
            for c in comparisons {
                let set = set_name((contraction, effort));
                let (column, factor) = measure.column();
                let [difference, error] = [c.test.mean_difference, c.test.standard_error].map(|value| factor * value);
                let unit = if factor == 1.0 { "" } else { " [%]" };
                if c.p_bonferroni < 0.05 {
                    shown.push(vec![
                        format!("{}{unit}", measure.label()),
                        set.clone(),
                        label(&c.first),
                        label(&c.second),
                        format!("{} ± {}", fixed(difference, 3), fixed(error, 3)),
                        p_text(c.p_bonferroni),
                    ]);
                }
                let mut row = vec![column.to_string(), contraction.word().to_string(), effort.to_string()];
                row.extend([c.first, c.second]);
                row.extend([difference, error, c.test.t].map(digits));
                row.extend([
                    c.test.df.to_string(),
                    digits(c.test.p_value),
                    digits(c.p_bonferroni),
                    digits(c.test.cohen_d_z),
                ]);
                rows.push(row);
            }
        }
    }
    if rows.is_empty() {
        return Ok(());
    }
    let header = [
        "measure",
        "contraction",
        "effort_percent",
        "first",
        "second",
        "mean_difference",
        "standard_error",
        "t",
        "df",
        "p",
        "p_bonferroni",
        "cohen_d_z",
    ];
    let count = rows.len();
    parts.tables.push(("evaluation_pairwise.csv".to_string(), csv_text(header.iter(), rows.into_iter())?));
    let header = ["measure", "evaluation", "first", "second", "difference ± SE", "p (Bonferroni)"];
    let found = shown.len();
    parts.blocks.push(Block::Table(TextTable {
        title: "Pairs of models that differ".to_string(),
        header: header.map(String::from).to_vec(),
        left_columns: 4,
        rows: shown,
        note: format!("{found} of {count} comparisons have p < 0.05; the others are in evaluation_pairwise.csv."),
    }));
    Ok(())
}

/// The moments of the participant whose error is nearest to the cohort's mean.
fn representative_figures(cohort: &Cohort, names: &[ModelName], curves: &[Representative]) -> Option<Block> {
    let shown = curves.first()?.simulated.first()?.0.clone();
    let mean = cohort.over_participants(&shown, CohortMeasure::Nrmse, all)?.mean;
    let distance =
        |p: &&String| cohort.value(p, &shown, CohortMeasure::Nrmse, all).map_or(f64::INFINITY, |v| (v - mean).abs());
    let who = cohort.participants().iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    let mut of_who: Vec<&Representative> = curves.iter().filter(|c| c.participant == *who).collect();
    of_who.sort_by(|a, b| {
        let key = |c: &Representative| (c.contraction, c.effort_percent.to_bits(), c.direction);
        key(a).cmp(&key(b))
    });
    let label = |id: &str| names.iter().find(|n| n.id == id).map_or(id.to_string(), |n| n.label.clone());
    let figures = of_who.iter().map(|c| {
        let caption = format!("{}, {}", set_name((c.contraction, c.effort_percent)), c.direction.word());
        let simulated: Vec<(String, &[f64])> = c.simulated.iter().map(|(id, v)| (label(id), v.as_slice())).collect();
        (caption.clone(), moment_figure(&caption, &c.time_s, &c.measured, &simulated))
    });
    let classes = ["after", "before", "third"];
    let legend: String = curves.first()?.simulated.iter().zip(classes).fold(
        r#"<span class="swatch"><i class="line measured"></i>measured</span>"#.to_string(),
        |text, ((id, _), class)| {
            let name = carpus_report::article::escape(&label(id));
            format!(r#"{text}<span class="swatch"><i class="line {class}"></i>{name}</span>"#)
        },
    );
    Some(Block::Figures {
        title: format!("Figure 3.5: moments of participant {who}, over the largest measured moment"),
        note: legend,
        columns: 2,
        figures: figures.collect(),
    })
}

fn errors_overview(cohort: &Cohort, names: &[ModelName]) -> TextTable {
    let sets = cohort.evaluations();
    let mut header = vec!["model".to_string()];
    header.extend(sets.iter().map(|s| set_name(*s)));
    header.extend(["all", "r", "RMSE N·m"].map(String::from));
    let rows = names.iter().map(|name| {
        let of = |measure, factor: f64, decimals, chosen: &dyn Fn(&ConditionError) -> bool| {
            cohort.over_participants(&name.id, measure, chosen).map_or("–".to_string(), |f| {
                format!("{} ± {}", fixed(factor * f.mean, decimals), fixed(factor * f.standard_deviation, decimals))
            })
        };
        let mut row = vec![name.label.clone()];
        row.extend(sets.iter().map(|s| of(CohortMeasure::Nrmse, 100.0, 1, &in_set(s.0, s.1))));
        row.push(of(CohortMeasure::Nrmse, 100.0, 1, &all));
        row.push(of(CohortMeasure::PearsonR, 1.0, 3, &all));
        row.push(of(CohortMeasure::Rmse, 1.0, 3, &all));
        row
    });
    overview("NRMSE [%] on held-out trials, mean ± standard deviation over participants", &header, 1, rows.collect())
}

/// Errors of every participant, model and condition as CSV.
///
/// # Errors
/// None that input can cause.
fn errors_csv(errors: &[ConditionError]) -> Result<String, Failure> {
    let header = [
        "participant",
        "model",
        "contraction",
        "effort_percent",
        "direction",
        "trials",
        "nrmse_percent",
        "pearson_r",
        "rmse_n_m",
    ];
    let rows = errors.iter().map(|e| {
        vec![
            e.participant.clone(),
            e.model.clone(),
            e.contraction.word().to_string(),
            e.effort_percent.to_string(),
            e.direction.word().to_string(),
            e.trials.to_string(),
            digits(100.0 * e.nrmse),
            e.pearson_r.map(digits).unwrap_or_default(),
            digits(e.rmse_n_m),
        ]
    });
    csv_text(header.iter(), rows)
}
