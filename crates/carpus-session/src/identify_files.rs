//! Files of an identification: its results, tables, report.

use std::path::Path;

use super::account::csv_text;
use super::diagnostic::Failure;
use super::loading::LoadedParticipant;
use super::output::OutputFolder;
use super::study::Study;
use carpus_identifiability::{Identifiability, Knowledge};
use carpus_personalization::personalization::BoundHit;
use carpus_report::identifiability::{
    CombinationResult, IDENTIFIABILITY_SCHEMA, IdentifiabilityResult, NextTrialResult, NoiseResult, ParameterKnowledge,
    SoundnessResult,
};
use carpus_report::identifiability_page::render_identifiability;
use carpus_report::results::{Provenance, rounded};
use carpus_study::study::TrialUse;

/// Significant digits of what is written.
const DIGITS: i32 = 7;

/// What is written about an identification, without provenance and warnings.
///
/// - `level`: of the intervals
pub fn result(study: &Study, run: &LoadedParticipant, found: &Identifiability, level: f64) -> IdentifiabilityResult {
    let round = |v: f64| rounded(v, DIGITS);
    let percent = |log_sd: f64| rounded(100.0 * log_sd, 4);
    let deviation = |variance: f64| rounded(variance.sqrt(), 4);
    let [envelope, gain, floor] = found.noise.of_emg().map(deviation);
    let training = run.trials.iter().filter(|t| t.info.usage == TrialUse::Train).map(|t| t.info.direction);
    IdentifiabilityResult {
        schema: IDENTIFIABILITY_SCHEMA.to_string(),
        provenance: Provenance::default(),
        study: study.tables.settings.name.clone(),
        participant: run.participant.name.clone(),
        trials: run.trials.iter().filter(|t| t.info.usage == TrialUse::Train).count(),
        level,
        parameters: found.parameters.iter().map(parameter_result).collect(),
        combinations: found
            .combinations
            .iter()
            .map(|c| CombinationResult {
                words: c.words.clone(),
                share_from_data: rounded(c.share_from_data, 6),
                prior_sd_percent: percent(c.prior_log_sd),
                sd_percent: percent(c.log_sd),
            })
            .collect(),
        correlations: (0..found.correlations.nrows())
            .map(|i| found.correlations.row(i).iter().map(|r| rounded(*r, 4)).collect())
            .collect(),
        next_trials: found
            .next_trials
            .iter()
            .map(|t| {
                let most = (0..t.shrinkage.len()).max_by(|a, b| t.shrinkage[*a].total_cmp(&t.shrinkage[*b]));
                let most = most.unwrap_or(0);
                NextTrialResult {
                    trial: t.name.clone(),
                    mean_shrinkage_percent: percent(t.mean_shrinkage),
                    most: found.parameters[most].parameter.words(),
                    most_percent: percent(t.shrinkage[most]),
                }
            })
            .collect(),
        noise: NoiseResult {
            white_n_m: deviation(found.noise.white()),
            slow_n_m: training.map(|d| (d.word().to_string(), deviation(found.noise.slow(d)))).collect(),
            emg_percent: rounded(100.0 * envelope, 3),
            emg_gain_percent: rounded(100.0 * gain, 3),
            emg_floor: floor,
        },
        part_of_the_way: found.part_of_the_way.map(|part| rounded(part, 4)),
        soundness: found.soundness.map(|s| SoundnessResult {
            largest_deviance_error: round(s.largest_deviance_error),
            dispersion: rounded(s.dispersion, 4),
            largest_r_hat: round(s.largest_r_hat),
            fewest_effective_draws: rounded(s.fewest_effective_draws, 4),
            divergent: s.divergent,
            share_outside: round(s.share_outside),
        }),
        warnings: Vec::new(),
    }
}

fn parameter_result(k: &Knowledge) -> ParameterKnowledge {
    let p = &k.parameter;
    let round = |v: f64| rounded(v, DIGITS);
    ParameterKnowledge {
        muscle: p.owner.clone(),
        property: p.property.name().to_string(),
        unit: p.property.unit().to_string(),
        model: p.nominal,
        bounds: [round(p.nominal * p.lower), round(p.nominal * p.upper)],
        most_likely: round(k.most_likely),
        at_bound: k.at_bound.map(|b| if b == BoundHit::Lower { "lower" } else { "upper" }.to_string()),
        interval: k.interval.map(round),
        end_from_data: k.end_from_data,
        leans_on_bounds: k.leans_on_bounds,
        degrees_of_freedom: rounded(k.degrees_of_freedom.min(9999.0), 4),
        posterior_median: round(k.posterior_median),
        credible: k.credible.map(round),
        share_from_data: rounded(k.share_from_data, 6),
        prior_value: round(p.nominal * p.prior.factor),
        prior_log_sd: round(p.prior.log_sd),
        prior_source: p.prior.source.clone().unwrap_or_else(|| "bounds".to_string()),
    }
}

/// Writes a participant's results and page.
///
/// # Errors
/// The disk.
pub fn write(out: &OutputFolder, folder: &Path, result: &IdentifiabilityResult) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(result).map_err(|e| Failure::Internal(e.to_string()))?;
    out.write(folder.join("identifiability.json"), (json + "\n").as_bytes())?;
    out.write(
        folder.join("intervals.csv"),
        csv_text(INTERVAL_COLUMNS.iter(), result.parameters.iter().map(interval_row))?.as_bytes(),
    )?;
    let rows = result.combinations.iter().map(|c| {
        vec![
            c.words.clone(),
            rounded(100.0 * c.share_from_data, 4).to_string(),
            c.prior_sd_percent.to_string(),
            c.sd_percent.to_string(),
        ]
    });
    let combinations =
        csv_text(["combination", "share_from_data_percent", "prior_sd_percent", "sd_percent"].iter(), rows)?;
    out.write(folder.join("combinations.csv"), combinations.as_bytes())?;
    let names: Vec<String> = result.parameters.iter().map(|p| format!("{}.{}", p.muscle, p.property)).collect();
    let header: Vec<&str> = std::iter::once("parameter").chain(names.iter().map(String::as_str)).collect();
    let rows = names
        .iter()
        .zip(&result.correlations)
        .map(|(name, row)| std::iter::once(name.clone()).chain(row.iter().map(f64::to_string)).collect::<Vec<_>>());
    out.write(folder.join("correlations.csv"), csv_text(header.iter(), rows)?.as_bytes())?;
    let header = ["rank", "trial", "mean_shrinkage_percent", "most_for", "most_shrinkage_percent"];
    let rows = result.next_trials.iter().enumerate().map(|(i, t)| {
        vec![
            (i + 1).to_string(),
            t.trial.clone(),
            t.mean_shrinkage_percent.to_string(),
            t.most.clone(),
            t.most_percent.to_string(),
        ]
    });
    out.write(folder.join("next_trials.csv"), csv_text(header.iter(), rows)?.as_bytes())?;
    out.write(folder.join("report.html"), render_identifiability(result).as_bytes())?;
    Ok(())
}

/// Draws from the posterior, a column per parameter.
///
/// # Errors
/// None that input can cause.
pub fn draws_csv(result: &IdentifiabilityResult, found: &Identifiability) -> Result<String, Failure> {
    let names: Vec<String> = result.parameters.iter().map(|p| format!("{}.{}", p.muscle, p.property)).collect();
    let header: Vec<&str> = names.iter().map(String::as_str).collect();
    let rows = (0..found.draws.nrows()).map(|r| {
        let value = |i: usize| rounded(result.parameters[i].model * found.draws[(r, i)].exp(), DIGITS).to_string();
        (0..names.len()).map(value).collect::<Vec<_>>()
    });
    csv_text(header.iter(), rows)
}

/// Columns of a parameter's interval in a table.
pub const INTERVAL_COLUMNS: [&str; 18] = [
    "muscle",
    "property",
    "unit",
    "model",
    "most_likely",
    "lower",
    "upper",
    "lower_from_data",
    "upper_from_data",
    "at_bound",
    "leans_on_bounds",
    "degrees_of_freedom",
    "posterior_median",
    "credible_lower",
    "credible_upper",
    "share_from_data_percent",
    "prior_source",
    "valid",
];

/// A parameter's row of [`INTERVAL_COLUMNS`].
pub fn interval_row(p: &ParameterKnowledge) -> Vec<String> {
    let mut row = vec![p.muscle.clone(), p.property.clone(), p.unit.clone()];
    row.extend([p.model, p.most_likely, p.interval[0], p.interval[1]].map(|v| v.to_string()));
    row.extend(p.end_from_data.map(|v| v.to_string()));
    row.push(p.at_bound.clone().unwrap_or_default());
    row.push(p.leans_on_bounds.to_string());
    row.push(p.degrees_of_freedom.to_string());
    let percent = rounded(100.0 * p.share_from_data, 4);
    row.extend([p.posterior_median, p.credible[0], p.credible[1], percent].map(|v| v.to_string()));
    row.push(p.prior_source.clone());
    row.push(p.is_valid().to_string());
    row
}
