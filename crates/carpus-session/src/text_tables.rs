//! Tables of results, for terminals and pages.

use std::collections::BTreeMap;

use super::account::fixed;
use super::diagnosis_file::proposal_file;
use super::equilibrium::MuscleAtRest;
use super::errors::ErrorOverview;
use carpus_diagnosis::diagnose::{Diagnosis, NamedEffect, ParameterEstimate, Verdict};
use carpus_diagnosis::separation::{Separation, best_of_pairs};
use carpus_diagnosis::what_remains::ProposedFormula;
use carpus_effects::answers::{SEPARABLE_Z, is_determined};
use carpus_effects::catalogue::effect;
use carpus_report::article::TextTable;
use carpus_report::identifiability::IdentifiabilityResult;
use carpus_report::intervals::with_validity;
use carpus_report::results::{Errors, Results};

/// Axes along which residuals are shown.
const SHOWN_AXES: usize = 6;

/// What a diagnosis found: errors, effects or explanations, proposals, what cannot be tested.
pub fn of_diagnosis(diagnosis: &Diagnosis) -> Vec<TextTable> {
    let mut tables = vec![errors(diagnosis)];
    if matches!(diagnosis.verdict, Verdict::Dominant | Verdict::Several) {
        tables.push(effects(diagnosis));
    } else if !diagnosis.explanations.is_empty() {
        let rows = diagnosis.explanations.iter().flat_map(|e| estimate_rows(&e.parameters, &fixed(e.p_value, 3)));
        let header = ["parameter", "estimate, 95 % interval", "plausible", "p"];
        tables.push(TextTable::titled("Explanations that leave nothing", &header, 2, rows));
        if !diagnosis.separating_experiments.is_empty() {
            let title =
                format!("Further trials that would tell (z: standard deviations; told apart from {SEPARABLE_Z})");
            tables.push(of_separations(title, best_of_pairs(&diagnosis.separating_experiments)));
        }
    } else if diagnosis.verdict == Verdict::NothingDetectable {
        tables.push(detectable_sizes(diagnosis));
    }
    if !diagnosis.proposals.is_empty() {
        let row = |(i, p): (usize, &ProposedFormula)| {
            vec![p.formula.clone(), fixed(100.0 * p.share_of_error, 0), proposal_file(i)]
        };
        let title = "What remains looks like this moment [N·m]; share of its mean square in trials that were left out";
        let rows = diagnosis.proposals.iter().enumerate().map(row);
        tables.push(TextTable::titled(title, &["formula", "%", "as an effect of your own"], 1, rows));
    }
    tables
}

/// Root mean square errors of training and held-out trials, step by step.
fn errors(diagnosis: &Diagnosis) -> TextTable {
    let percent = |v: Option<f64>| v.map_or("–".to_string(), |v| fixed(100.0 * v, 2));
    let error = &diagnosis.error;
    let row = |(name, steps): (&str, Option<_>)| {
        let s: carpus_diagnosis::diagnose::Steps = steps?;
        let errors = [Some(s.base), Some(s.refit_only), s.with_effect, Some(error.noise_floor)];
        Some(std::iter::once(name.to_owned()).chain(errors.map(percent)).collect())
    };
    let rows = [("training", Some(error.train)), ("held out", error.held_out)].into_iter().filter_map(row);
    let header = ["trials", "as given", "muscles refitted", "with effect", "noise floor"];
    TextTable::titled("RMSE in % of the session's MVC moment", &header, 1, rows)
}

/// A row per effect that is missing where many things are a little wrong: probability, share of the error, parameters.
fn effects(diagnosis: &Diagnosis) -> TextTable {
    let percent = |shares: [f64; 3]| {
        let [value, low, high] = shares.map(|share| fixed(100.0 * share, 0));
        format!("{value} [{low}, {high}]")
    };
    let parameter = |(name, p): (&String, &ParameterEstimate)| {
        let unit = if p.unit == "1" { "" } else { p.unit };
        let text = format!("{name} {:.4} [{:.4}, {:.4}] {unit}", p.value, p.ci95[0], p.ci95[1]);
        text.trim_end().to_owned()
    };
    let row = |e: &NamedEffect| {
        vec![
            e.effect.to_owned(),
            fixed(e.probability, 2),
            percent(e.share_of_error.train),
            percent(e.unique_share.train),
            e.share_of_error.held_out.map_or("–".to_owned(), percent),
            e.parameters.iter().map(parameter).collect::<Vec<_>>().join("\n"),
        ]
    };
    let title = "Missing effects: probability, share of the model's mean squared error that each takes, and the part of \
                 it that nothing else takes";
    let header = ["effect", "probability", "training %", "unique %", "held out %", "parameters, 95 % intervals"];
    TextTable::titled(title, &header, 5, diagnosis.effects.iter().map(row))
}

/// A row per parameter: name, estimate, what is plausible, and one more column.
fn estimate_rows(parameters: &BTreeMap<String, ParameterEstimate>, last: &str) -> Vec<Vec<String>> {
    let row = |(name, p): (&String, &ParameterEstimate)| {
        let interval = match is_determined(p.ci95) {
            true => with_validity(format!("[{:.4}, {:.4}]", p.ci95[0], p.ci95[1]), p.ci95, p.value),
            false => "(not determined)".to_owned(),
        };
        vec![
            name.clone(),
            format!("{:.4} {interval} {}", p.value, p.unit),
            format!("{} to {}", p.plausible[0], p.plausible[1]),
            last.to_owned(),
        ]
    };
    parameters.iter().map(row).collect()
}

/// Smallest sizes of every candidate that would have been found.
fn detectable_sizes(diagnosis: &Diagnosis) -> TextTable {
    let rows = diagnosis.candidates.iter().flat_map(|c| {
        let unit = |name: &str| {
            let description = effect(c.effect).map(|e| e.description());
            description.and_then(|d| d.parameters.iter().find(|p| p.name == name)).map_or("", |p| p.unit)
        };
        c.detectable_size.iter().map(move |(name, size)| {
            vec![c.effect.to_string(), (*name).to_string(), format!("{size:.4}"), unit(name).to_owned()]
        })
    });
    let title = format!("p = {:.3}. Smallest sizes that would have been found:", diagnosis.null_p_value);
    TextTable::titled(title, &["effect", "parameter", "size", "unit"], 2, rows)
}

/// A row for every experiment that would tell explanations apart.
pub fn of_separations<'a>(
    title: impl Into<String>,
    separations: impl IntoIterator<Item = &'a Separation>,
) -> TextTable {
    let rows = separations.into_iter().map(|s| {
        let told = if s.z_then >= SEPARABLE_Z { "yes" } else { "no" };
        vec![s.separates.join(" | "), s.trials.to_owned(), fixed(s.z_now, 1), fixed(s.z_then, 1), told.to_owned()]
    });
    TextTable::titled(title, &["tell apart", "record", "z now", "z then", "told apart"], 2, rows)
}

/// The axes along which a model fails most, and the noise that repetitions show; `None` where nothing was compared.
pub fn where_it_fails(results: &Results) -> Option<TextTable> {
    let found = results.residuals.last()?;
    let rows = found.axes_by_share().into_iter().take(SHOWN_AXES).map(|a| {
        let (at, mean, interval) = a.largest();
        let band = interval.map_or(String::new(), |[low, high]| format!(" [{}, {}]", fixed(low, 2), fixed(high, 2)));
        vec![
            carpus_report::axis_name(&a.axis),
            fixed(100.0 * a.share_of_error, 0),
            format!("{}{band} at {} {}", fixed(mean, 2), carpus_report::plain(at), a.unit),
        ]
    });
    let note = match found.repetition_noise_n_m {
        Some(noise) => format!(
            "Repetitions of a condition differ by {} N·m ({} pairs): no model that knows only the condition does \
             better.",
            fixed(noise, 3),
            found.repetition_pairs
        ),
        None => "No condition was repeated: the noise is not known from repetitions.".to_owned(),
    };
    let title = format!("{}: where the error of {} N·m is", results.participant.id, fixed(found.rms_n_m, 3));
    let header = ["along", "% of the error", "largest mean residual, N·m [95 %]"];
    Some(TextTable { note, ..TextTable::titled(title, &header, 1, rows) })
}

/// Errors of every participant, use of its trials and model.
pub fn of_errors(outcomes: &[Results]) -> TextTable {
    let header = ["participant", "trials", "model", "n", "NRMSE %", "max. error %", "XCorr", "sum", "RMSE N·m", "r"];
    let mut rows = Vec::new();
    for results in outcomes {
        for found in ErrorOverview::of(results).rows {
            let mut row = vec![results.participant.id.clone(), found.use_label.to_string(), found.model];
            row.push(found.trials.to_string());
            row.extend(cells(&found.errors));
            rows.push(row);
        }
    }
    TextTable::titled("", &header, 3, rows)
}

fn cells(e: &Errors) -> [String; 6] {
    let number = |v: Option<f64>, factor: f64, decimals| v.map_or("–".to_string(), |v| fixed(factor * v, decimals));
    [
        number(e.nrmse, 100.0, 2),
        number(e.max_error, 100.0, 1),
        number(e.xcorr, 1.0, 4),
        number(e.objective, 1.0, 4),
        number(e.rmse_n_m, 1.0, 3),
        number(e.pearson_r, 1.0, 4),
    ]
}

/// Muscles in equilibrium, and what they do to the coordinates.
pub fn of_equilibrium(rows: &[MuscleAtRest]) -> TextTable {
    let mut header: Vec<String> = [
        "muscle",
        "path mm",
        "fibre mm",
        "l/l_opt",
        "tendon mm",
        "pennation °",
        "active N",
        "passive N",
        "tendon force N",
    ]
    .map(String::from)
    .to_vec();
    if let Some(first) = rows.first() {
        header.extend(
            first
                .moments
                .iter()
                .flat_map(|m| [format!("arm({}) mm", m.coordinate), format!("moment({}) N·m", m.coordinate)]),
        );
    }
    header.push("note".to_string());
    let body = rows.iter().map(|r| {
        let mut cells = vec![
            r.muscle.clone(),
            fixed(1e3 * r.path_length_m, 1),
            fixed(1e3 * r.fiber_length_m, 2),
            fixed(r.normalized_fiber_length, 3),
            fixed(1e3 * r.tendon_length_m, 1),
            fixed(r.pennation_angle_deg, 1),
            fixed(r.active_fiber_force_n, 2),
            fixed(r.passive_fiber_force_n, 2),
            fixed(r.tendon_force_n, 2),
        ];
        for m in &r.moments {
            cells.extend([fixed(1e3 * m.moment_arm_m, 2), fixed(m.moment_n_m, 4)]);
        }
        cells.push(if r.status == "converged" { String::new() } else { r.status.replace('_', " ") });
        cells
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    TextTable::titled("", &header, 1, body)
}

/// What trials say of muscle parameters: a row each, ends that the data do not reach in brackets.
pub fn of_identification(r: &IdentifiabilityResult) -> TextTable {
    let level = format!("{} %", 100.0 * r.level);
    let title = format!("{}: {} training trials, {level} intervals", r.participant, r.trials);
    let rows = r.parameters.iter().map(|p| {
        let (scale, unit, decimals) = match p.unit.as_str() {
            "m" => (1e3, "mm", 1),
            "rad" => (1f64.to_degrees(), "°", 1),
            "N" => (1.0, "N", 0),
            other => (1.0, other, 3),
        };
        let number = |v: f64| fixed(scale * v, decimals);
        let end =
            |i: usize| if p.end_from_data[i] { number(p.interval[i]) } else { format!("[{}]", number(p.interval[i])) };
        vec![
            p.muscle.clone(),
            p.property.clone(),
            unit.to_string(),
            number(p.model),
            number(p.most_likely),
            end(0),
            with_validity(end(1), p.interval, p.most_likely),
            format!("{} … {}", number(p.credible[0]), number(p.credible[1])),
            format!("{:.0} %", 100.0 * p.share_from_data),
        ]
    });
    let header = ["muscle", "property", "", "model", "most likely", "from", "to", "with prior", "from data"];
    TextTable::titled(title, &header, 3, rows)
}
