//! What trials say about muscle parameters: the results file and its page.

use std::collections::BTreeMap;
use std::fmt::Write;

use askama::Template;
use serde::{Deserialize, Serialize};

use super::intervals::{NOT_VALID, holds, with_validity};
use super::number::significant;
use super::page::finished;
use super::plot::{Scale, escape};
use super::policy::{SCRIPT, STYLE, content_security_policy};
use super::results::{Provenance, WarningResult};

/// Name and version of the schema.
pub const IDENTIFIABILITY_SCHEMA: &str = "carpus.identifiability/1";

/// What a participant's trials say. Values are in the unit of the property.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdentifiabilityResult {
    /// [`IDENTIFIABILITY_SCHEMA`].
    pub schema: String,
    /// Program, command, seed and inputs.
    pub provenance: Provenance,
    /// The study.
    pub study: String,
    /// The participant.
    pub participant: String,
    /// Training trials.
    pub trials: usize,
    /// Level of all intervals.
    pub level: f64,
    /// The parameters.
    pub parameters: Vec<ParameterKnowledge>,
    /// Combinations of parameters, from the best known to the least known.
    pub combinations: Vec<CombinationResult>,
    /// Correlations of logarithms in the posterior, in the order of the parameters.
    pub correlations: Vec<Vec<f64>>,
    /// Further trials, the most informative first.
    pub next_trials: Vec<NextTrialResult>,
    /// What the fit found of noise.
    pub noise: NoiseResult,
    /// How far personalization goes from the model as given (0) to the most likely values (1), as left-out training
    /// trials are predicted best; of lengths and forces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_of_the_way: Option<f64>,
    /// How far to trust the numbers, where they are from profiles and draws of a likelihood.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub soundness: Option<SoundnessResult>,
    /// What the reader must know.
    pub warnings: Vec<WarningResult>,
}

/// A parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterKnowledge {
    /// Muscle or group of tied muscles.
    pub muscle: String,
    /// OpenSim's property.
    pub property: String,
    /// Unit.
    pub unit: String,
    /// Value in the model (of the first muscle of a group).
    pub model: f64,
    /// Bounds.
    pub bounds: [f64; 2],
    /// Value that the data make most likely within the bounds.
    pub most_likely: f64,
    /// `lower` or `upper`, if it stands there.
    pub at_bound: Option<String>,
    /// Interval of lengths and forces: given the trials, with prior knowledge; of other parameters: from data and
    /// bounds alone (profile likelihood).
    pub interval: [f64; 2],
    /// Whether the data set each end.
    pub end_from_data: [bool; 2],
    /// Whether another parameter stands at its bound at an end.
    pub leans_on_bounds: bool,
    /// Degrees of freedom of the noise as far as the interval rests on it, at most 9999.
    pub degrees_of_freedom: f64,
    /// Median of the posterior: data and prior knowledge.
    pub posterior_median: f64,
    /// Its credible interval.
    pub credible: [f64; 2],
    /// Share of the prior variance that the data removed.
    pub share_from_data: f64,
    /// Prior: most probable value and standard deviation of its logarithm.
    pub prior_value: f64,
    /// Standard deviation of the logarithm before the data.
    pub prior_log_sd: f64,
    /// Where the prior is from.
    pub prior_source: String,
}

impl ParameterKnowledge {
    /// Whether its interval holds the most likely value.
    pub fn is_valid(&self) -> bool {
        holds(self.interval, self.most_likely)
    }

    /// Whether the data set both ends of a valid interval.
    pub fn is_determined(&self) -> bool {
        self.end_from_data == [true, true] && self.is_valid()
    }

    /// What the data do for it.
    pub fn verdict(&self) -> &'static str {
        match self.end_from_data {
            _ if !self.is_valid() => NOT_VALID,
            [true, true] => "determined",
            [true, false] => "only bounded below",
            [false, true] => "only bounded above",
            [false, false] => "open",
        }
    }
}

/// A combination.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CombinationResult {
    /// In words.
    pub words: String,
    /// Share of the prior variance that the data removed.
    pub share_from_data: f64,
    /// Standard deviation before the data, in percent.
    pub prior_sd_percent: f64,
    /// And after.
    pub sd_percent: f64,
}

/// A trial that could be recorded next.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NextTrialResult {
    /// What it is.
    pub trial: String,
    /// By how much intervals would shrink, in percent, mean over parameters.
    pub mean_shrinkage_percent: f64,
    /// The parameter that gains most.
    pub most: String,
    /// And its gain.
    pub most_percent: f64,
}

/// Standard deviations of the noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseResult {
    /// From sample to sample [N·m].
    pub white_n_m: f64,
    /// Slow disturbances, by the direction of effort (`flexion`, `extension`, `none`) [N·m].
    pub slow_n_m: BTreeMap<String, f64>,
    /// EMG envelope, percent of itself.
    pub emg_percent: f64,
    /// EMG gain from trial to trial, percent.
    pub emg_gain_percent: f64,
    /// EMG that adds, share of MVC.
    pub emg_floor: f64,
}

/// How far the numbers can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoundnessResult {
    /// Largest difference of −2 log likelihood from what the level asks for, by simulation at ends of intervals.
    pub largest_deviance_error: f64,
    /// How much more trials scatter about the fit than the noise explains (variance ratio, at least 1).
    pub dispersion: f64,
    /// Largest split R̂.
    pub largest_r_hat: f64,
    /// Fewest independent draws of any parameter.
    pub fewest_effective_draws: f64,
    /// Paths of the sampler that went astray.
    pub divergent: usize,
    /// Share of draws beyond the polynomials' region.
    pub share_outside: f64,
}

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
    next: Vec<[String; 4]>,
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
        next: result
            .next_trials
            .iter()
            .take(12)
            .map(|t| {
                let [mean, most] = [t.mean_shrinkage_percent, t.most_percent].map(|v| format!("{v:.1} %"));
                [t.trial.clone(), mean, t.most.clone(), most]
            })
            .collect(),
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
