//! What the report page shows, worked out from the results: sentences, rows and figures, all formatted.

pub(super) mod parameters;

use super::axis_figures::{AxisPanel, axis_panels, repetition_words};
use super::muscle_use::{self, MusclePanels};
use super::number::{percent, plain, quantity, significant};
use super::plot::{self, Curve, CurveFigure};
use super::results::{Condition, Errors, HeldCoordinate, Kind, ModelResult, Results, StageResult, TrialResult, Use};
use super::sentence::within_sentence;
use super::torque_angle::{self, AnglePanel};
use super::warnings::{self, WarningGroup};
use parameters::{ParameterGroup, parameter_groups};

/// A number of the summary.
pub struct Card {
    pub label: &'static str,
    pub value: String,
    pub before: String,
    pub unit: &'static str,
    pub note: String,
    /// `good`, `bad` or empty.
    pub tone: &'static str,
}

/// A short fact of the header: name and value.
pub struct Fact {
    pub name: &'static str,
    pub value: String,
}

/// Trials of one condition.
pub struct Group {
    pub title: String,
    pub note: String,
    /// Columns that the group takes, 1 to 4.
    pub width: usize,
    pub panels: Vec<Panel>,
}

/// One trial: its figure and what stands around it.
pub struct Panel {
    pub id: String,
    pub title: String,
    pub held_out: bool,
    pub svg: String,
    pub before: String,
    pub after: String,
    pub rmse: String,
    /// `good`, `bad` or empty.
    pub tone: &'static str,
}

/// A part of a table: all rows of one use.
pub struct Section<R> {
    pub title: &'static str,
    pub held_out: bool,
    pub rows: Vec<R>,
}

/// A condition in the overview.
pub struct ConditionRow {
    pub condition: String,
    pub trials: usize,
    pub svg: String,
    pub before: String,
    pub after: String,
    pub rmse: String,
    pub r: String,
    pub total: bool,
}

/// A trial in the error table, with one line of errors per model.
pub struct TrialRow {
    pub trial: String,
    pub condition: String,
    pub lines: Vec<TrialLine>,
}

/// Errors of one model in one trial.
pub struct TrialLine {
    pub model: String,
    pub last: bool,
    pub cells: Vec<String>,
}

/// A stage of the fit.
pub struct StageRow {
    pub name: String,
    pub evaluations: String,
    pub before: String,
    pub after: String,
}

/// The whole page.
pub struct View {
    pub kicker: String,
    pub title: String,
    pub headline: String,
    pub lead: String,
    pub facts: Vec<Fact>,
    pub cards: Vec<Card>,
    pub warnings: Vec<WarningGroup>,
    pub has_before: bool,
    pub has_errors: bool,
    pub before_label: String,
    pub after_label: String,
    pub axis_svg: String,
    pub conditions: Vec<Section<ConditionRow>>,
    pub groups: Vec<Group>,
    pub trial_columns: Vec<&'static str>,
    pub trials: Vec<Section<TrialRow>>,
    pub parameters: Vec<ParameterGroup>,
    pub bound_hits: usize,
    /// Level of the parameters' intervals, if they have any.
    pub interval_level: Option<String>,
    pub has_determination: bool,
    /// How far the fitted values are from those before to the fit, if it is not the fit itself.
    pub part_of_the_way: Option<String>,
    pub stages: Vec<StageRow>,
    pub axes: Vec<AxisPanel>,
    pub repetition_noise: String,
    pub angles: Vec<AnglePanel>,
    pub muscles: Vec<MusclePanels>,
}

impl View {
    /// Works out the page of a results file.
    pub fn new(results: &Results) -> View {
        let pair = Pair::of(results);
        let has_errors = results.models.iter().any(|m| !m.errors.is_empty());
        let max = condition_axis(&results.models);
        let groups = groups(results, &pair);
        View {
            kicker: match results.kind {
                Kind::Simulation => "Simulation",
                Kind::Comparison => "Comparison",
                Kind::Personalization => "Personalization",
                Kind::Diagnosis => "Diagnosis",
                Kind::Effects => "Missing effects",
            }
            .to_string(),
            title: format!("{} · {}", results.study.name, results.participant.id),
            headline: headline(results, &pair),
            lead: lead(results, &pair),
            facts: facts(results),
            cards: cards(results, &pair),
            warnings: warnings::groups(&results.warnings),
            has_before: pair.before.is_some(),
            has_errors,
            before_label: pair.before.map(|m| m.label.clone()).unwrap_or_default(),
            after_label: pair.after.map(|m| m.label.clone()).unwrap_or_default(),
            axis_svg: plot::percent_axis(max),
            conditions: if has_errors { condition_sections(&pair, max) } else { Vec::new() },
            groups,
            trial_columns: vec!["NRMSE", "Max. error", "XCorr term", "Sum", "RMSE [N·m]", "r", "R²"],
            trials: if has_errors { trial_sections(results) } else { Vec::new() },
            parameters: parameter_groups(&results.parameters),
            bound_hits: results.parameters.iter().filter(|p| p.at_bound()).count(),
            interval_level: results
                .parameters
                .iter()
                .find_map(|p| p.interval.as_ref())
                .map(|i| format!("{:.0}\u{202f}%", 100.0 * i.level)),
            has_determination: results.parameters.iter().any(|p| p.share_from_data.is_some()),
            part_of_the_way: results.part_of_the_way.filter(|part| *part < 1.0).map(percent),
            stages: results.stages.iter().map(stage_row).collect(),
            axes: axis_panels(None, results.residuals.last(), &[]),
            repetition_noise: repetition_words(results.residuals.last()),
            angles: match pair.after {
                Some(after) => torque_angle::panels(
                    &results.trials,
                    pair.before.map(|m| m.id.as_str()),
                    &after.id,
                    |t: &TrialResult| {
                        let held = t.held.iter().map(|h| format!(" · {}", held_words(h)));
                        condition_title(&t.condition) + &held.collect::<String>()
                    },
                ),
                None => Vec::new(),
            },
            muscles: match (&results.muscles, pair.after) {
                (Some(used), Some(after)) => muscle_use::panels(used, pair.before.map(|m| m.id.as_str()), &after.id),
                _ => Vec::new(),
            },
        }
    }
}

/// The model that the page is about and the one it is compared with.
pub(super) struct Pair<'a> {
    pub(super) before: Option<&'a ModelResult>,
    pub(super) after: Option<&'a ModelResult>,
}

impl<'a> Pair<'a> {
    fn of(results: &'a Results) -> Pair<'a> {
        let before = if results.models.len() > 1 { results.first_model() } else { None };
        Pair { before, after: results.last_model() }
    }

    /// Errors of both models over one use.
    fn errors(&self, trial_use: Use) -> (Option<&'a Errors>, Option<&'a Errors>) {
        let of = |m: Option<&'a ModelResult>| m.and_then(|m| m.errors_of(trial_use));
        (of(self.before), of(self.after))
    }

    /// Held-out errors where there are any, else those of training trials; says which.
    fn judged(&self) -> Option<(Use, Option<&'a Errors>, &'a Errors)> {
        [Use::HeldOut, Use::Train].into_iter().find_map(|u| match self.errors(u) {
            (before, Some(after)) => Some((u, before, after)),
            _ => None,
        })
    }
}

/// The uses of trials in the order of the tables, with their titles.
fn uses() -> [(Use, &'static str); 3] {
    [(Use::HeldOut, "Held out"), (Use::Train, "Training"), (Use::Mvc, "Maximal contractions")]
}

fn use_words(trial_use: Use) -> &'static str {
    match trial_use {
        Use::HeldOut => "held-out trials",
        Use::Train => "training trials",
        Use::Mvc => "maximal contractions",
    }
}

pub(super) fn maybe(value: Option<f64>, show: impl Fn(f64) -> String) -> String {
    value.map_or_else(|| "–".to_string(), show)
}

fn tone(before: Option<f64>, after: Option<f64>) -> &'static str {
    match (before, after) {
        (Some(a), Some(b)) if b < a => "good",
        (Some(a), Some(b)) if b > a => "bad",
        _ => "",
    }
}

fn headline(results: &Results, pair: &Pair) -> String {
    let Some((trial_use, before, after)) = pair.judged() else {
        let n = results.trials.len();
        return format!("{n} {} simulated", if n == 1 { "trial" } else { "trials" });
    };
    let after_text = maybe(after.nrmse, percent);
    let (Some(a), Some(b)) = (before.and_then(|e| e.nrmse), after.nrmse) else {
        return format!("The simulated moment is {after_text} off on {}", use_words(trial_use));
    };
    let verb = if b < a {
        "fell"
    } else if b > a {
        "rose"
    } else {
        "stayed"
    };
    format!("The error on {} {verb} from {} to {after_text}", use_words(trial_use), percent(a))
}

fn lead(results: &Results, pair: &Pair) -> String {
    let mut text = String::new();
    if pair.judged().is_some() {
        text.push_str(
            "Error: mean distance between measured and simulated moment, in percent of the largest measured moment of \
             the trial (NRMSE).",
        );
        if pair.errors(Use::HeldOut).1.is_some() && results.kind == Kind::Personalization {
            text.push_str(" Held-out trials were never seen by the fit.");
        } else if results.kind == Kind::Personalization {
            text.push_str(
                " No trial was held out: these trials were used for the fit, so the error on new trials is unknown.",
            );
        }
    }
    if let Some(worst) = worst_condition(pair) {
        text.push_str(&worst);
    }
    text
}

/// Where the model still fails most, in one sentence.
fn worst_condition(pair: &Pair) -> Option<String> {
    let (trial_use, _, _) = pair.judged()?;
    let conditions: Vec<_> = pair.after?.conditions.iter().filter(|c| c.trial_use == trial_use).collect();
    if conditions.len() < 2 {
        return None;
    }
    let worst = conditions.iter().max_by(|a, b| {
        let key = |e: &Errors| e.nrmse.unwrap_or(f64::NEG_INFINITY);
        key(&a.errors).total_cmp(&key(&b.errors))
    })?;
    let nrmse = worst.errors.nrmse?;
    let condition = condition_title(&worst.condition).replace(" · ", ", ");
    Some(format!(" The error is largest for “{condition}”: {}.", percent(nrmse)))
}

pub(super) fn facts(results: &Results) -> Vec<Fact> {
    let mut facts = vec![Fact { name: "Participant", value: participant(results) }];
    if let Some(model) = results.first_model() {
        facts.push(Fact { name: "Model", value: format!("{} ({})", model.name, file_name(&model.file)) });
    }
    facts.push(Fact { name: "Moment about", value: results.study.coordinate.clone() });
    facts.push(Fact { name: "Simulated moment sums", value: results.study.moment_includes.join(", ") });
    facts.push(Fact { name: "Active muscles", value: results.study.active_muscles.join(", ") });
    if !results.study.posture.is_empty() {
        let held = results.study.posture.iter().map(held_words);
        facts.push(Fact { name: "Posture", value: held.collect::<Vec<_>>().join(", ") });
    }
    facts
}

fn held_words(h: &HeldCoordinate) -> String {
    format!("{} {}{}", h.coordinate, plain(h.value), if h.unit == "deg" { "°" } else { "\u{202f}m" })
}

fn participant(results: &Results) -> String {
    let p = &results.participant;
    let mut parts = vec![p.id.clone()];
    parts.extend(p.sex.clone());
    parts.extend(p.side.clone().map(|s| format!("{s} side")));
    parts.extend(p.height_m.map(|h| format!("{h:.2}\u{202f}m")));
    parts.extend(p.mass_kg.map(|m| format!("{}\u{202f}kg", significant(m, 3))));
    parts.join(", ")
}

fn file_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

fn cards(results: &Results, pair: &Pair) -> Vec<Card> {
    let mut cards = Vec::new();
    if let Some((trial_use, before, after)) = pair.judged() {
        let words = use_words(trial_use);
        let card = |label, a: Option<f64>, b: Option<f64>, unit, show: fn(f64) -> String, note: &str| {
            let (before, value) = (a.map(show).unwrap_or_default(), maybe(b, show));
            // What reads the same is neither better nor worse.
            let tone = if before == value { "" } else { tone(a, b) };
            Card { label, before, value, unit, note: note.to_string(), tone }
        };
        let hundredth: fn(f64) -> String = |v| format!("{:.1}", 100.0 * v).replace('-', "−");
        let pick = |of: fn(&Errors) -> Option<f64>| (before.and_then(of), of(after));
        let (a, b) = pick(|e| e.nrmse);
        let label = if trial_use == Use::HeldOut { "Held-out error" } else { "Training error" };
        cards.push(card(label, a, b, "%", hundredth, "NRMSE"));
        let (a, b) = pick(|e| e.rmse_n_m);
        cards.push(card("RMS error", a, b, "N·m", |v| significant(v, 3), words));
        let (a, b) = pick(|e| e.pearson_r);
        let mut correlation = card("Correlation r", a, b, "", |v| format!("{v:.3}").replace('-', "−"), words);
        correlation.tone = if correlation.before == correlation.value { "" } else { tone(b, a) };
        cards.push(correlation);
        if let (Use::HeldOut, (before, Some(train))) = (trial_use, pair.errors(Use::Train)) {
            let before = before.and_then(|e| e.nrmse);
            cards.push(card("Training error", before, train.nrmse, "%", hundredth, "NRMSE"));
        }
    }
    let mut noise: Vec<f64> = results.trials.iter().filter_map(|t| t.moment_noise_n_m).collect();
    noise.sort_by(f64::total_cmp);
    if let Some(median) = noise.get(noise.len() / 2) {
        cards.push(Card {
            label: "Moment noise",
            value: significant(*median, 2),
            before: String::new(),
            unit: "N·m",
            note: "sample to sample".to_string(),
            tone: "",
        });
    }
    cards
}

/// End of the axis of the condition overview.
fn condition_axis(models: &[ModelResult]) -> f64 {
    let all = models.iter().flat_map(|m| {
        let conditions = m.conditions.iter().map(|c| &c.errors);
        conditions.chain(m.errors.iter().map(|e| &e.errors)).filter_map(|e| e.nrmse)
    });
    let high = plot::extent(all).map_or(0.1, |[_, high]| high.max(1e-3));
    let step = plot::ticks(0.0, high, 4).get(1).copied().unwrap_or(high);
    (high / step).ceil() * step
}

fn condition_title(condition: &Condition) -> String {
    let mut parts = Vec::new();
    let mut contraction = condition.contraction.clone();
    if contraction == "mvc" {
        contraction = "MVC".to_string();
    } else if let Some(first) = contraction.get(..1) {
        contraction = first.to_uppercase() + &contraction[1..];
    }
    parts.push(contraction);
    // A maximum voluntary contraction is 100 % by definition.
    let effort = condition.effort_percent.filter(|_| condition.contraction != "mvc");
    parts.extend(effort.map(|e| format!("{}\u{202f}% MVC", plain(e))));
    if condition.direction != "none" && !condition.direction.is_empty() {
        parts.push(condition.direction.clone());
    }
    parts.join(" · ")
}

fn condition_sections(pair: &Pair, max: f64) -> Vec<Section<ConditionRow>> {
    let row = |condition: String, trials, before: Option<&Errors>, after: &Errors, total| ConditionRow {
        condition,
        trials,
        svg: plot::dumbbell(before.and_then(|e| e.nrmse), after.nrmse, max),
        before: maybe(before.and_then(|e| e.nrmse), percent),
        after: maybe(after.nrmse, percent),
        rmse: maybe(after.rmse_n_m, |v| quantity(v, "N·m")),
        r: maybe(after.pearson_r, |v| format!("{v:.3}").replace('-', "−")),
        total,
    };
    let Some(after) = pair.after else { return Vec::new() };
    let section = |(trial_use, title)| {
        let of_use = after.conditions.iter().filter(|c| c.trial_use == trial_use);
        let mut rows: Vec<_> = of_use
            .map(|c| {
                let before = pair
                    .before
                    .and_then(|m| m.conditions.iter().find(|b| b.condition == c.condition && b.trial_use == trial_use));
                row(condition_title(&c.condition), c.trials, before.map(|b| &b.errors), &c.errors, false)
            })
            .collect();
        let total = after.errors.iter().find(|e| e.trial_use == trial_use)?;
        rows.push(row("All".to_string(), total.trials, pair.errors(trial_use).0, &total.errors, true));
        Some(Section { title, held_out: trial_use == Use::HeldOut, rows })
    };
    uses().into_iter().filter_map(section).collect()
}

pub(super) fn groups(results: &Results, pair: &Pair) -> Vec<Group> {
    let mut conditions: Vec<&Condition> = Vec::new();
    for trial in &results.trials {
        if !conditions.contains(&&trial.condition) {
            conditions.push(&trial.condition);
        }
    }
    let group = |condition: &Condition| {
        let trials: Vec<_> = results.trials.iter().filter(|t| t.condition == *condition).collect();
        let ranges = PanelRanges::of(&trials);
        let held_out = trials.iter().filter(|t| t.trial_use == Use::HeldOut).count();
        let mut note = format!("{} {}", trials.len(), if trials.len() == 1 { "trial" } else { "trials" });
        if held_out > 0 {
            note.push_str(&format!(", {held_out} held out"));
        }
        Group {
            title: condition_title(condition),
            note,
            width: trials.len().clamp(1, 4),
            panels: trials.iter().map(|t| panel(t, pair, &ranges)).collect(),
        }
    };
    // Maximal contractions come last: they are neither fitted nor judged.
    conditions.sort_by_key(|c| c.contraction == "mvc");
    conditions.into_iter().map(group).collect()
}

/// Axes shared by all panels of a condition, so that they can be compared by eye.
struct PanelRanges {
    time: [f64; 2],
    moment: [f64; 2],
    angle: Option<[f64; 2]>,
}

/// Angles that change less than this [deg] are a held posture: no strip is drawn.
const HELD_ANGLE_DEG: f64 = 4.0;

impl PanelRanges {
    fn of(trials: &[&TrialResult]) -> PanelRanges {
        let time = plot::extent(trials.iter().flat_map(|t| t.series.time_s.iter().copied()));
        let moments = trials.iter().flat_map(|t| {
            let simulated = t.series.simulated_n_m.values().flatten();
            t.series.measured_n_m.iter().chain(simulated).copied()
        });
        let moment = plot::extent(moments.chain([0.0])).unwrap_or([0.0, 1.0]);
        let moves = |t: &&&TrialResult| {
            plot::extent(t.series.angle_deg.iter().copied()).is_some_and(|[a, b]| b - a > HELD_ANGLE_DEG)
        };
        let moving = trials.iter().filter(moves).flat_map(|t| t.series.angle_deg.iter().copied());
        PanelRanges {
            time: time.unwrap_or([0.0, 1.0]),
            moment: plot::padded(moment, 0.06),
            angle: plot::extent(moving),
        }
    }
}

fn panel(trial: &TrialResult, pair: &Pair, ranges: &PanelRanges) -> Panel {
    let mut curves =
        vec![Curve { class: "measured".to_string(), name: "measured".to_string(), values: &trial.series.measured_n_m }];
    for (model, class) in [(pair.before, "before"), (pair.after, "after")] {
        let Some(model) = model else { continue };
        if let Some(values) = trial.series.simulated_n_m.get(&model.id) {
            curves.push(Curve { class: class.to_string(), name: within_sentence(&model.label), values });
        }
    }
    let figure = CurveFigure {
        description: format!("Measured and simulated moment of trial {} over time", trial.id),
        x: &trial.series.time_s,
        x_name: ("t", "s"),
        unit: "N·m",
        curves,
        x_range: ranges.time,
        y_range: ranges.moment,
        strip: ranges.angle.map(|range| (trial.series.angle_deg.as_slice(), range, "angle")),
        size: [320.0, if ranges.angle.is_some() { 206.0 } else { 172.0 }],
        ticks: [5, 4],
    };
    let error = |m: Option<&ModelResult>| m.and_then(|m| trial.errors.get(&m.id));
    let (before, after) = (error(pair.before), error(pair.after));
    let held = trial.posture_deg.filter(|_| ranges.angle.is_none());
    let mut parts: Vec<String> = held.map(|p| format!("{}°", plain(p))).into_iter().collect();
    parts.extend(trial.held.iter().map(held_words));
    parts.extend(trial.repetition.map(|r| format!("repetition {r}")));
    let title = parts.join(", ");
    Panel {
        title: if title.is_empty() { trial.id.replace('_', " ") } else { title },
        id: trial.id.clone(),
        held_out: trial.trial_use == Use::HeldOut,
        svg: figure.svg(),
        before: before.map(|e| maybe(e.nrmse, percent)).unwrap_or_default(),
        after: after.map(|e| maybe(e.nrmse, percent)).unwrap_or_default(),
        rmse: after.map(|e| maybe(e.rmse_n_m, |v| quantity(v, "N·m"))).unwrap_or_default(),
        tone: tone(before.and_then(|e| e.nrmse), after.and_then(|e| e.nrmse)),
    }
}

fn trial_sections(results: &Results) -> Vec<Section<TrialRow>> {
    let cells = |e: &Errors| {
        let three = |v: f64| significant(v, 3);
        vec![
            maybe(e.nrmse, percent),
            maybe(e.max_error, percent),
            maybe(e.xcorr, three),
            maybe(e.objective, three),
            maybe(e.rmse_n_m, three),
            maybe(e.pearson_r, |v| format!("{v:.3}").replace('-', "−")),
            maybe(e.r_squared, |v| format!("{v:.3}").replace('-', "−")),
        ]
    };
    let row = |trial: &TrialResult| {
        let count = results.models.len();
        let line = |(i, model): (usize, &ModelResult)| {
            trial.errors.get(&model.id).map(|e| TrialLine {
                model: model.label.clone(),
                last: i + 1 == count,
                cells: cells(e),
            })
        };
        TrialRow {
            trial: trial.id.clone(),
            condition: condition_title(&trial.condition),
            lines: results.models.iter().enumerate().filter_map(line).collect(),
        }
    };
    let section = |(trial_use, title)| {
        let rows: Vec<_> = results.trials.iter().filter(|t| t.trial_use == trial_use).map(row).collect();
        (!rows.is_empty()).then_some(Section { title, held_out: trial_use == Use::HeldOut, rows })
    };
    uses().into_iter().filter_map(section).collect()
}

fn stage_row(stage: &StageResult) -> StageRow {
    StageRow {
        name: stage.name.clone(),
        evaluations: stage.evaluations.to_string(),
        before: significant(stage.objective_before, 3),
        after: significant(stage.objective_after, 3),
    }
}
