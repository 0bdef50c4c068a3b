//! Intervals of muscle parameters over participants: tables, figures and CSV.

use super::account::{csv_text, fixed};
use super::diagnostic::Failure;
use super::identify_files::{INTERVAL_COLUMNS, interval_row};
use super::report_parts::{ReportParts, overview};
use carpus_report::article::{Block, TextTable};
use carpus_report::identifiability::{IdentifiabilityResult, ParameterKnowledge};
use carpus_report::intervals::{IntervalRow, intervals};
use carpus_report::results::rounded;

/// Combinations shown of every participant, on either side.
const SHOWN: usize = 2;
/// Trials shown.
const TRIALS: usize = 10;
/// Correlations of at least this size are shown.
const CORRELATED: f64 = 0.5;

/// A parameter of all participants that have it.
struct Parameter<'a> {
    muscle: &'a str,
    property: &'a str,
    of: Vec<(&'a str, &'a ParameterKnowledge)>,
}

/// The section of a study.
///
/// # Errors
/// None that input can cause.
pub fn report(all: &[IdentifiabilityResult]) -> Result<ReportParts, Failure> {
    let parameters = parameters(all);
    let level = all.first().map_or(0.9, |r| r.level);
    let (total, determined) = parameters
        .iter()
        .flat_map(|p| &p.of)
        .fold((0, 0), |(n, d), (_, k)| (n + 1, d + usize::from(k.is_determined())));
    let header = ["muscle", "property", "determined in", "at a bound in", "median ± %", "median share from data"];
    let rows: Vec<Vec<String>> = parameters.iter().map(summary).collect();
    let mut warnings: Vec<String> = Vec::new();
    for r in all {
        for w in &r.warnings {
            let text = format!("Identifiability: {}", w.message);
            if !warnings.contains(&text) {
                warnings.push(text);
            }
        }
    }
    let figures = parameters.iter().map(|p| (format!("{} {}", p.muscle, p.property.replace('_', " ")), figure(p)));
    let mut blocks = vec![
        Block::Text(format!(
            "Intervals of level {} from the training trials alone (profile likelihood; noise of moment and EMG \
             estimated from \
             the trials, autocorrelation included) and, with prior knowledge, from the posterior. A parameter is \
             determined where \
             the data set both ends. Everything holds if nothing is missing in the model's structure. Each \
             participant's own \
             page is in identify/PARTICIPANT/report.html.",
            percent(level)
        )),
        Block::Table(TextTable {
            title: "Which parameters do the trials determine?".to_string(),
            header: header.iter().map(|h| (*h).to_string()).collect(),
            left_columns: 2,
            rows: rows.clone(),
            note: "± %: half the interval over the most likely value, where the data set both ends; share from data: \
                   of the prior \
                   variance of the logarithm."
                .to_string(),
        }),
        Block::Figures {
            title: "Intervals, as factors of the model's value".to_string(),
            note: "Rose: the data do not reach the bound at one end at least.".to_string(),
            columns: 4,
            figures: figures.collect(),
        },
        Block::Table(combinations(all)),
    ];
    if let Some(block) = correlations(all) {
        blocks.push(Block::Table(block));
    }
    let (trials, trials_csv) = next_trials(all)?;
    blocks.push(Block::Table(trials));
    blocks.push(Block::Table(soundness(all)));
    Ok(ReportParts {
        lead: format!("The trials bound {determined} of {total} parameters from both sides."),
        warnings,
        blocks,
        tables: vec![
            ("identify_intervals.csv".to_string(), intervals_csv(all)?),
            ("identify_next_trials.csv".to_string(), trials_csv),
        ],
        overview: vec![overview(&format!("{} intervals", percent(level)), &header, 2, rows)],
        ..ReportParts::default()
    })
}

fn percent(share: f64) -> String {
    format!("{} %", rounded(100.0 * share, 4))
}

fn parameters(all: &[IdentifiabilityResult]) -> Vec<Parameter<'_>> {
    let mut found: Vec<Parameter<'_>> = Vec::new();
    for r in all {
        for k in &r.parameters {
            match found.iter_mut().find(|p| p.muscle == k.muscle && p.property == k.property) {
                Some(parameter) => parameter.of.push((&r.participant, k)),
                None => {
                    found.push(Parameter { muscle: &k.muscle, property: &k.property, of: vec![(&r.participant, k)] })
                }
            }
        }
    }
    found
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    (n > 0).then(|| 0.5 * (values[(n - 1) / 2] + values[n / 2]))
}

fn summary(p: &Parameter) -> Vec<String> {
    let n = p.of.len();
    let determined: Vec<&ParameterKnowledge> = p.of.iter().map(|(_, k)| *k).filter(|k| k.is_determined()).collect();
    let half = |k: &&ParameterKnowledge| 50.0 * (k.interval[1] - k.interval[0]) / k.most_likely;
    let width = median(determined.iter().map(half).collect());
    let share = median(p.of.iter().map(|(_, k)| k.share_from_data).collect());
    vec![
        p.muscle.to_string(),
        p.property.to_string(),
        format!("{} of {n}", determined.len()),
        format!("{} of {n}", p.of.iter().filter(|(_, k)| k.at_bound.is_some()).count()),
        width.map_or("–".to_string(), |w| fixed(w, 1)),
        share.map_or("–".to_string(), |s| fixed(s, 2)),
    ]
}

fn figure(p: &Parameter) -> String {
    let rows: Vec<IntervalRow> =
        p.of.iter()
            .map(|(who, k)| IntervalRow {
                label: (*who).to_string(),
                value: k.most_likely / k.model,
                interval: k.interval.map(|v| v / k.model),
                ends: k.end_from_data,
            })
            .collect();
    intervals(&format!("{} {} of {} participants", p.muscle, p.property, rows.len()), &rows)
}

fn combinations(all: &[IdentifiabilityResult]) -> TextTable {
    let row = |r: &IdentifiabilityResult, what: &str, c: &carpus_report::identifiability::CombinationResult| {
        let known = |v: f64| format!("±{} %", rounded(v, 2));
        vec![r.participant.clone(), what.to_string(), c.words.clone(), known(c.sd_percent), known(c.prior_sd_percent)]
    };
    let rows = all.iter().flat_map(|r| {
        let fixed = r.combinations.iter().filter(|c| c.share_from_data >= 0.5).take(SHOWN);
        let free = r.combinations.iter().rev().filter(|c| c.share_from_data < 0.5).take(SHOWN);
        fixed.map(move |c| row(r, "fixed", c)).chain(free.map(move |c| row(r, "left free", c)))
    });
    TextTable {
        title: "Which combinations do the trials fix, and which do they leave free?".to_string(),
        header: ["participant", "", "combination", "known to", "before the data"].map(String::from).to_vec(),
        left_columns: 3,
        rows: rows.collect(),
        note: String::new(),
    }
}

/// Pairs of parameters by their mean correlation over participants.
fn correlations(all: &[IdentifiabilityResult]) -> Option<TextTable> {
    let first = all.first()?;
    let name = |i: usize| format!("{} {}", first.parameters[i].muscle, first.parameters[i].property.replace('_', " "));
    let same: Vec<&IdentifiabilityResult> =
        all.iter().filter(|r| r.parameters.len() == first.parameters.len()).collect();
    let n = first.parameters.len();
    let mut pairs: Vec<(usize, usize, Vec<f64>)> = (0..n)
        .flat_map(|i| (0..i).map(move |j| (i, j)))
        .map(|(i, j)| (i, j, same.iter().map(|r| r.correlations[i][j]).collect::<Vec<f64>>()))
        .collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    pairs.retain(|(.., r)| mean(r).abs() >= CORRELATED);
    pairs.sort_by(|a, b| mean(&b.2).abs().total_cmp(&mean(&a.2).abs()));
    let rows = pairs.iter().take(12).map(|(i, j, r)| {
        let [low, high] = [r.iter().copied().fold(1.0, f64::min), r.iter().copied().fold(-1.0, f64::max)];
        vec![name(*j), name(*i), fixed(mean(r), 2), format!("{} to {}", fixed(low, 2), fixed(high, 2))]
    });
    (!pairs.is_empty()).then(|| TextTable {
        title: "Which parameters cannot be told apart?".to_string(),
        header: ["parameter", "and", "mean correlation", "over participants"].map(String::from).to_vec(),
        left_columns: 2,
        rows: rows.collect(),
        note: "Correlation of logarithms in the posterior.".to_string(),
    })
}

/// Trials by how much they would shrink intervals, mean over participants.
fn next_trials(all: &[IdentifiabilityResult]) -> Result<(TextTable, String), Failure> {
    let mut trials: Vec<(&str, Vec<f64>, Vec<&str>)> = Vec::new();
    for t in all.iter().flat_map(|r| &r.next_trials) {
        match trials.iter_mut().find(|(name, ..)| *name == t.trial) {
            Some(known) => {
                known.1.push(t.mean_shrinkage_percent);
                known.2.push(&t.most);
            }
            None => trials.push((&t.trial, vec![t.mean_shrinkage_percent], vec![&t.most])),
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    trials.sort_by(|a, b| mean(&b.1).total_cmp(&mean(&a.1)).then_with(|| a.0.cmp(b.0)));
    let most = |names: &[&str]| {
        let count = |name: &&str| names.iter().filter(|n| *n == name).count();
        let mut sorted = names.to_vec();
        sorted.sort_unstable();
        sorted.into_iter().max_by_key(count).unwrap_or_default().to_string()
    };
    let rows = trials.iter().take(TRIALS).map(|(name, shrinkage, names)| {
        vec![(*name).to_string(), fixed(mean(shrinkage), 2), most(names), shrinkage.len().to_string()]
    });
    let shown = TextTable {
        title: "Which trial next?".to_string(),
        header: ["trial", "intervals shrink by %", "most for", "participants"].map(String::from).to_vec(),
        left_columns: 1,
        rows: rows.collect(),
        note:
            "One more trial of this kind, expected information with the noise that was found; mean over parameters and \
               participants."
                .to_string(),
    };
    let header = ["participant", "rank", "trial", "mean_shrinkage_percent", "most_for", "most_shrinkage_percent"];
    let rows = all.iter().flat_map(|r| {
        r.next_trials.iter().enumerate().map(move |(i, t)| {
            let mut row = vec![r.participant.clone(), (i + 1).to_string(), t.trial.clone()];
            row.extend([t.mean_shrinkage_percent.to_string(), t.most.clone(), t.most_percent.to_string()]);
            row
        })
    });
    Ok((shown, csv_text(header.iter(), rows)?))
}

/// Noise and the soundness of every participant's intervals.
fn soundness(all: &[IdentifiabilityResult]) -> TextTable {
    let header = [
        "participant",
        "moment noise, white N·m",
        "slow N·m",
        "EMG %",
        "EMG gain %",
        "dispersion",
        "ends off by",
        "largest R̂",
    ];
    let rows = all.iter().map(|r| {
        let (n, s) = (&r.noise, &r.soundness);
        let mut row = vec![r.participant.clone()];
        let short = |v: f64| rounded(v, 3).to_string();
        let slow: Vec<String> = n.slow_n_m.iter().map(|(direction, v)| format!("{} {direction}", short(*v))).collect();
        row.extend([short(n.white_n_m), slow.join(", "), short(n.emg_percent), short(n.emg_gain_percent)]);
        let none = || "–".to_string();
        row.extend(s.map_or_else(
            || [none(), none(), none()],
            |s| [fixed(s.dispersion, 2), fixed(s.largest_deviance_error, 2), fixed(s.largest_r_hat, 3)],
        ));
        row
    });
    TextTable {
        title: "Noise that was found, and how far the intervals can be trusted".to_string(),
        header: header.map(String::from).to_vec(),
        left_columns: 1,
        rows: rows.collect(),
        note: "Dispersion: scatter of trials about the fit over what the noise explains (variance ratio), by which \
               intervals are \
               widened; ends: largest difference of −2 log likelihood from what the level asks for, by simulation (2.7 \
               and more \
               make a 90 % interval). –: lengths and forces are estimated with a discrepancy and a little of every \
               effect, \
               which make their intervals as wide as they need to be."
            .to_string(),
    }
}

fn intervals_csv(all: &[IdentifiabilityResult]) -> Result<String, Failure> {
    let header = std::iter::once("participant").chain(INTERVAL_COLUMNS);
    let rows = all.iter().flat_map(|r| {
        r.parameters
            .iter()
            .map(move |p| std::iter::once(r.participant.clone()).chain(interval_row(p)).collect::<Vec<_>>())
    });
    csv_text(header.collect::<Vec<_>>().iter(), rows)
}
