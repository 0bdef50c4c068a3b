//! The page of what trials say about muscle parameters.

use std::fmt::Write;

use askama::Template;

use super::identifiability::{CombinationResult, IdentifiabilityResult, ParameterKnowledge};
use super::intervals::with_validity;
use super::next_steps::{NextStep, after_identification};
use super::number::significant;
use super::page::finished;
use super::plot::{Scale, escape};
use super::policy::{SCRIPT, STYLE, content_security_policy};

struct Row {
    name: String,
    property: String,
    unit: String,
    likely: String,
    interval: String,
    credible: String,
    share: String,
    verdict: &'static str,
    note: String,
    figure: String,
}

#[derive(Template)]
#[template(path = "identifiability.html")]
struct Page<'a> {
    policy: String,
    style: &'a str,
    script: &'a str,
    result: &'a IdentifiabilityResult,
    level: String,
    lead: String,
    warnings: Vec<String>,
    rows: Vec<Row>,
    fixed: Vec<[String; 3]>,
    free: Vec<[String; 3]>,
    trials: Vec<[String; 4]>,
    next: Vec<NextStep>,
    pairs: Vec<[String; 2]>,
    noise: String,
    trust: String,
}

/// The page of a result: one self-contained HTML page.
pub fn render_identifiability(result: &IdentifiabilityResult) -> String {
    let determined = result.parameters.iter().filter(|p| p.is_determined()).count();
    let percent = |v: f64| format!("{} %", significant(v, 2));
    let combination = |c: &CombinationResult| {
        [in_superscript(&c.words), format!("±{}", percent(c.sd_percent)), format!("±{}", percent(c.prior_sd_percent))]
    };
    let shown = result.combinations.len().min(6);
    let slow: Vec<String> = (result.noise.slow_n_m.iter())
        .map(|(direction, v)| format!("{} N·m (direction: {direction})", significant(*v, 2)))
        .collect();
    let page = Page {
        policy: content_security_policy(),
        style: STYLE,
        script: SCRIPT,
        result,
        level: format!("{} %", 100.0 * result.level),
        lead: format!(
            "{determined} of {} parameters are bounded by the data from both sides. Intervals rest on {} training \
             trials and \
             hold if nothing is missing in the model's structure.",
            result.parameters.len(),
            result.trials
        ),
        warnings: result.warnings.iter().map(|w| sentence(&w.message)).collect(),
        rows: result.parameters.iter().map(row).collect(),
        fixed: result.combinations.iter().filter(|c| c.share_from_data >= 0.5).take(shown).map(combination).collect(),
        free: result
            .combinations
            .iter()
            .rev()
            .filter(|c| c.share_from_data < 0.5)
            .take(shown)
            .map(combination)
            .collect(),
        trials: result
            .next_trials
            .iter()
            .take(12)
            .map(|t| {
                let [mean, most] = [t.mean_shrinkage_percent, t.most_percent].map(|v| format!("{v:.1} %"));
                [t.trial.clone(), mean, t.most.clone(), most]
            })
            .collect(),
        next: after_identification(result),
        pairs: pairs(result),
        noise: format!(
            "Moment {} N·m from sample to sample, slowly {}; EMG {:.0} % of itself, {:.0} % from trial to trial.",
            significant(result.noise.white_n_m, 2),
            slow.join(", "),
            result.noise.emg_percent,
            result.noise.emg_gain_percent
        ),
        trust: result.soundness.map_or_else(String::new, |s| format!(
            "Trials scatter about the fit {:.1} times as much (variance) as the noise explains; intervals are widened \
             accordingly. −2 log likelihood at the ends of intervals, by simulation, is within {:.2} of what the level \
             asks for. Largest R̂ {:.3}, \
             at least {:.0} independent draws, {} divergent paths.",
            s.dispersion, s.largest_deviance_error, s.largest_r_hat, s.fewest_effective_draws, s.divergent
        )),
    };
    finished(&page)
}

/// A message as a sentence of its own.
fn sentence(message: &str) -> String {
    let mut letters = message.chars();
    let first: String = letters.next().into_iter().flat_map(char::to_uppercase).collect();
    let end = if message.ends_with(['.', '!', '?']) { "" } else { "." };
    format!("{first}{}{end}", letters.as_str())
}

/// Powers as `<sup>`, all else as text: `FCU strength^-0.99 × …`.
fn in_superscript(words: &str) -> String {
    let factor = |factor: &str| match factor.rsplit_once('^') {
        Some((name, power)) if power.parse::<f64>().is_ok() => {
            format!("{}<sup>{}</sup>", escape(name), power.replace('-', "−"))
        }
        _ => escape(factor),
    };
    words.split(" × ").map(factor).collect::<Vec<_>>().join(" × ")
}

/// The most correlated pairs.
fn pairs(result: &IdentifiabilityResult) -> Vec<[String; 2]> {
    let name = |i: usize| {
        let p = &result.parameters[i];
        format!("{} {}", p.muscle, p.property.replace('_', " "))
    };
    let mut all: Vec<(usize, usize, f64)> = result
        .correlations
        .iter()
        .enumerate()
        .flat_map(|(i, row)| row.iter().enumerate().take(i).map(move |(j, r)| (i, j, *r)))
        .filter(|(_, _, r)| r.abs() >= 0.5)
        .collect();
    all.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
    let line =
        |(i, j, r): &(usize, usize, f64)| [format!("{} – {}", name(*j), name(*i)), format!("{r:.2}").replace('-', "−")];
    all.iter().take(12).map(line).collect()
}

fn row(p: &ParameterKnowledge) -> Row {
    let (scale, unit) = match p.unit.as_str() {
        "m" => (1e3, "mm"),
        "rad" => (1f64.to_degrees(), "°"),
        other => (1.0, other),
    };
    let number = |v: f64| significant(v * scale, 4);
    let mut notes = Vec::new();
    if let Some(bound) = &p.at_bound {
        notes.push(format!("at its {bound} bound"));
    }
    if p.leans_on_bounds {
        notes.push("rests on another bound".to_string());
    }
    if p.degrees_of_freedom < 30.0 {
        notes.push(format!("its noise is known from few trials (ν = {:.0})", p.degrees_of_freedom));
    }
    if p.prior_source != "bounds" {
        notes.push(format!("prior: {}", p.prior_source));
    }
    let end = |i: usize| {
        let value = number(p.interval[i]);
        if p.end_from_data[i] { value } else { format!("{value} (bound)") }
    };
    Row {
        name: p.muscle.clone(),
        property: p.property.replace('_', " "),
        unit: unit.to_string(),
        likely: number(p.most_likely),
        interval: format!("{} … {}", end(0), end(1)),
        credible: with_validity(
            format!("{} … {}", number(p.credible[0]), number(p.credible[1])),
            p.credible,
            p.posterior_median,
        ),
        share: format!("{:.0} %", 100.0 * p.share_from_data),
        verdict: p.verdict(),
        note: notes.join("; "),
        figure: figure(p),
    }
}

/// Interval and credible interval between the bounds, on a logarithmic axis; a tick at the model's value.
fn figure(p: &ParameterKnowledge) -> String {
    let [width, height] = super::plot::ROW_SIZE;
    let x = Scale { data: [p.bounds[0].ln(), p.bounds[1].ln()], drawn: [6.0, width - 6.0] };
    let at = |v: f64| x.at(v.max(1e-300).ln());
    let description = format!("{} {}: {} to {}", p.muscle, p.property, p.interval[0], p.interval[1]);
    let mut w =
        format!(r#"<svg class="row" viewBox="0 0 {width} {height}" role="img" aria-label="{}">"#, escape(&description));
    let model = at(p.model);
    let _ = write!(w, r#"<line class="grid" x1="6" x2="{}" y1="11" y2="11"/>"#, width - 6.0);
    let _ = write!(w, r#"<line class="zero" x1="{model:.1}" x2="{model:.1}" y1="2" y2="20"/>"#);
    let [a, b] = p.interval.map(at);
    let _ = write!(w, r#"<line class="link rose" x1="{a:.1}" x2="{b:.1}" y1="8" y2="8"/>"#);
    let [a, b] = p.credible.map(at);
    let _ = write!(w, r#"<line class="link fell" x1="{a:.1}" x2="{b:.1}" y1="14" y2="14"/>"#);
    let _ = write!(w, r#"<circle class="dot after" cx="{:.1}" cy="8" r="4"/>"#, at(p.most_likely));
    w.push_str("</svg>");
    w
}
