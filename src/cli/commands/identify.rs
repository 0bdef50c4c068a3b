//! `carpus identify`: intervals of muscle parameters, what the data leave open, and which trial would narrow it down.

use std::path::Path;

use crate::cli::account::{csv_text, warning_result};
use crate::cli::args::{Global, IdentifyArgs, IdentifyOptions};
use crate::cli::failure::{self, Failure, Message};
use crate::cli::provenance::{input_file, provenance};
use crate::cli::study_run::{ParticipantRun, StudyRun, progress, require_memory, simulation_message};
use crate::cli::table::{fixed, table};
use crate::identifiability::{
    ConfidenceInterval, FreeParameter, Identifiability, IdentifiabilityError, Knowledge, MuscleProperty, Prior,
    RecordedTrial, Request, identify, intervals, usual_candidates,
};
use crate::osim::spec::MuscleSpec;
use crate::personalization::BoundHit;
use crate::report::identifiability::{
    CombinationResult, IDENTIFIABILITY_SCHEMA, IdentifiabilityResult, NextTrialResult, NoiseResult, ParameterKnowledge,
    SoundnessResult, render_identifiability,
};
use crate::report::intervals::with_validity;
use crate::report::results::{Provenance, rounded};
use crate::simulation::{Recording, SimulationError};
use crate::study::{FurtherMoment, PriorKnowledge, PriorUnit, TrialUse, read_priors};

/// Said in every report that gives intervals of strength, until these hold the truth as often as their level says
/// (`fixtures/identifiability`).
const TOO_NARROW: &str = "intervals of max_isometric_force are somewhat too narrow: in 24 simulated studies of known truth, 90 % \
                          intervals held it in 85 % of cases (those of lengths in 92 to 96 %)";

/// Level of the intervals of [`usual_intervals`].
pub const INTERVAL_LEVEL: f64 = 0.9;
/// Significant digits of what is written.
const DIGITS: i32 = 7;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the priors, or the output folder.
pub fn run(args: &IdentifyArgs, global: &Global) -> Result<(), Failure> {
    let question = Question::new(&args.options)?;
    let study = StudyRun::prepare(&args.study, "identify")?;
    let bar = progress(global, study.participants.len() as u64, "identifying");
    let outcomes = study.each(|participant| {
        let run = study.participant_to_identify(participant)?;
        let (mut result, found, more) = question.answered(&study, &run, global.seed)?;
        let warnings: Vec<Message> = run.warnings.iter().cloned().chain(more).collect();
        failure::print(&warnings);
        result.warnings = warnings.iter().map(warning_result).collect();
        result.provenance = provenance(global, run.inputs.clone());
        if let Some(path) = &args.options.priors {
            result.provenance.inputs.push(input_file(path, &path.display().to_string(), "priors")?);
        }
        let folder = std::path::PathBuf::from(&result.participant);
        write(&study, &folder, &result)?;
        study.out.write(folder.join("draws.csv"), draws_csv(&result, &found)?.as_bytes())?;
        bar.inc(1);
        Ok(result)
    });
    bar.finish_and_clear();
    let outcomes = outcomes?;
    let text = if global.json {
        serde_json::to_string(&outcomes.done).map_err(|e| Failure::Internal(e.to_string()))?
    } else {
        outcomes.done.iter().map(|r| readable(r, &study)).collect::<Vec<_>>().join("\n\n")
    };
    outcomes.print(&study, "identify", &text)
}

/// What is asked of every participant.
#[derive(Clone, Debug)]
pub struct Question {
    options: IdentifyOptions,
    properties: Vec<MuscleProperty>,
    priors: Vec<PriorKnowledge>,
}

impl Question {
    /// A question as it stands on the command line.
    ///
    /// # Errors
    /// An unknown property; the priors.
    pub fn new(options: &IdentifyOptions) -> Result<Question, Failure> {
        let priors = options.priors.as_deref().map(read_priors).transpose()?.unwrap_or_default();
        Ok(Question { options: options.clone(), properties: properties(&options.properties)?, priors })
    }

    /// What the participant's training trials say, without provenance and warnings of the run; and further warnings.
    ///
    /// # Errors
    /// A prior or group that does not suit the model; a trial that cannot be simulated.
    pub fn answered(
        &self,
        study: &StudyRun,
        run: &ParticipantRun,
        seed: u64,
    ) -> Result<(IdentifiabilityResult, Identifiability, Vec<Message>), Failure> {
        let mut warnings = Vec::new();
        // What cannot be simulated has no intervals: better said at once.
        run.simulate(&run.model.nominal_parameters())?;
        let free = parameters(study, run, &self.properties, &self.priors, &self.options, &mut warnings)?;
        if free.iter().any(|p| p.property == MuscleProperty::MaxIsometricForce) {
            warnings.push(Message::warning(TOO_NARROW));
        }
        let found = identified(run, &study.study.settings.columns.further_moments, free, &self.options, seed)?;
        Ok((result(study, run, &found, &self.options), found, warnings))
    }
}

fn properties(names: &[String]) -> Result<Vec<MuscleProperty>, Failure> {
    if names.is_empty() {
        return Ok(MuscleProperty::USUAL.to_vec());
    }
    names
        .iter()
        .map(|name| {
            MuscleProperty::from_name(name).ok_or_else(|| {
                let message = Message::error(format!("--properties: there is no property `{name}`"));
                let known = MuscleProperty::ALL.map(MuscleProperty::name);
                let hint = match crate::study::nearest(name, known) {
                    Some(nearest) => format!("did you mean `{nearest}`?"),
                    None => format!("there are: {}", known.join(", ")),
                };
                message.hint(hint).into()
            })
        })
        .collect()
}

/// The parameters in question, with their priors.
fn parameters(
    study: &StudyRun,
    run: &ParticipantRun,
    properties: &[MuscleProperty],
    priors: &[PriorKnowledge],
    args: &IdentifyOptions,
    warnings: &mut Vec<Message>,
) -> Result<Vec<FreeParameter>, Failure> {
    let specs = active_specs(run);
    let mut free = Vec::new();
    for property in properties {
        for (name, members) in owners(&specs, args)? {
            let spec = &specs[members[0]];
            match property.of(spec) {
                Some(value) if value > 0.0 => {
                    let bounds = property.usual_bounds(&study.study.settings.bounds);
                    free.push(FreeParameter::new(&name, *property, members, value, bounds));
                }
                _ => {
                    let text = format!("{name}: {} is 0 in the model and has no factor: left out", property.name());
                    warnings.push(Message::warning(text).in_file(&run.loaded.path).at_line(spec.at.line));
                }
            }
        }
    }
    let Some(file) = &args.priors else { return Ok(free) };
    for prior in priors {
        let at = |message: Message| message.in_file(file).at_line(prior.line);
        if MuscleProperty::from_name(&prior.property).is_none() {
            let known = MuscleProperty::ALL.map(MuscleProperty::name);
            let message = at(Message::error(format!("there is no property `{}`", prior.property)));
            return Err(message.hint(format!("there are: {}", known.join(", "))).into());
        }
        let found = free.iter_mut().find(|p| p.owner == prior.muscle && p.property.name() == prior.property);
        let Some(parameter) = found else {
            let name = format!("{}.{}", prior.muscle, prior.property);
            warnings.push(at(Message::warning(format!("{name} is not in question: this prior is not used"))));
            continue;
        };
        let factor = match prior.unit {
            PriorUnit::File => prior.mean / parameter.nominal,
            PriorUnit::Model => prior.mean,
        };
        if !(parameter.lower..=parameter.upper).contains(&factor) {
            let text = format!(
                "{}: the prior's mean is {:.3} times the model's value, outside the bounds {} to {}",
                parameter.name(),
                factor,
                parameter.lower,
                parameter.upper
            );
            return Err(at(Message::error(text))
                .hint("is the mean in the unit of the model file, or in multiples of its value with unit = model?")
                .into());
        }
        let source = prior.source.clone().unwrap_or_else(|| file.display().to_string());
        let log_sd = (1.0 + (prior.sd / prior.mean).powi(2)).ln().sqrt();
        parameter.prior = Prior { factor, log_sd, source: Some(source) };
    }
    Ok(free)
}

/// Every group of tied muscles, and every muscle that is in none.
fn owners(specs: &[MuscleSpec], args: &IdentifyOptions) -> Result<Vec<(String, Vec<usize>)>, Failure> {
    let mut owners: Vec<(String, Vec<usize>)> = Vec::new();
    let mut tied: Vec<usize> = Vec::new();
    for group in &args.tie {
        let mut members = Vec::new();
        for name in &group.muscles {
            let Some(m) = specs.iter().position(|s| s.name == *name) else {
                let message = Message::error(format!("--tie {}: `{name}` is not an active muscle", group.name));
                let known: Vec<&str> = specs.iter().map(|s| s.name.as_str()).collect();
                let hint = match crate::study::nearest(name, known.iter().copied()) {
                    Some(nearest) => format!("did you mean `{nearest}`?"),
                    None => format!("there are: {}", known.join(", ")),
                };
                return Err(message.hint(hint).into());
            };
            if tied.contains(&m) {
                return Err(Message::error(format!("--tie {}: {name} is tied already", group.name)).into());
            }
            tied.push(m);
            members.push(m);
        }
        owners.push((group.name.clone(), members));
    }
    let alone = specs.iter().enumerate().filter(|(m, _)| !tied.contains(m));
    owners.extend(alone.map(|(m, s)| (s.name.clone(), vec![m])));
    Ok(owners)
}

fn active_specs(run: &ParticipantRun) -> Vec<MuscleSpec> {
    let spec = &run.loaded.file.spec;
    run.model.muscle_names().filter_map(|name| spec.muscles.iter().find(|m| m.name == name)).cloned().collect()
}

fn identified(
    run: &ParticipantRun,
    further: &[FurtherMoment],
    parameters: Vec<FreeParameter>,
    args: &IdentifyOptions,
    seed: u64,
) -> Result<Identifiability, Failure> {
    let mut candidates = usual_candidates(&run.model, &run.trials).map_err(|e| failed(run, e.into()))?;
    for candidate in &mut candidates {
        for about in further {
            let trial = candidate.trial.clone();
            let zeros = vec![0.0; trial.time.len()];
            let arms =
                run.model.moment_arms_about(&about.coordinate, &trial.angle).map_err(|e| failed(run, e.into()))?;
            candidate.trial = trial.with_channel(&about.coordinate, &zeros, arms);
        }
    }
    let request = request(run, further, parameters, args, seed)?;
    identify(&Request { candidates, ..request }).map_err(|e| failed(run, e))
}

/// Confidence intervals of what personalization fits, by the training trials alone.
///
/// # Errors
/// A trial that cannot be simulated.
pub fn usual_intervals(study: &StudyRun, run: &ParticipantRun, seed: u64) -> Result<Vec<ConfidenceInterval>, Failure> {
    let options = IdentifyOptions { level: INTERVAL_LEVEL, ..IdentifyOptions::default() };
    let free = parameters(study, run, &MuscleProperty::USUAL, &[], &options, &mut Vec::new())?;
    let request = request(run, &study.study.settings.columns.further_moments, free, &options, seed)?;
    intervals(&request).map_err(|e| failed(run, e))
}

fn failed(run: &ParticipantRun, error: IdentifiabilityError) -> Failure {
    match error {
        IdentifiabilityError::Simulation(error) => simulation_message(&error, &run.loaded).into(),
        other => Message::error(other.to_string()).in_file(&run.loaded.path).into(),
    }
}

/// A request without candidates for the next trial.
fn request(
    run: &ParticipantRun,
    further: &[FurtherMoment],
    parameters: Vec<FreeParameter>,
    args: &IdentifyOptions,
    seed: u64,
) -> Result<Request, Failure> {
    require_memory(&run.trials, run.model.muscle_names().count(), false, &run.trials_file)?;
    let coordinate = &run.model.setup().coordinate;
    let trials = run
        .trials
        .iter()
        .zip(&run.prepared)
        .filter(|(t, _)| t.info.usage == TrialUse::Train)
        .map(|(t, p)| {
            let trial =
                RecordedTrial::new(&t.info.name, t.info.direction, coordinate, &Recording::from(t), &t.moment, p)
                    .sampled_every(t.rows_per_moment());
            further.iter().zip(&t.further_moments).try_fold(trial, |trial, (about, measured)| {
                let arms = run.model.moment_arms_about(&about.coordinate, &t.angle)?;
                Ok(trial.with_channel(&about.coordinate, measured, arms))
            })
        })
        .collect::<Result<Vec<_>, SimulationError>>()
        .map_err(|e| failed(run, e.into()))?;
    Ok(Request {
        model: run.model.clone(),
        muscles: active_specs(run),
        trials,
        parameters,
        level: args.level,
        seed,
        draws: args.draws as usize,
        candidates: Vec::new(),
    })
}

fn result(
    study: &StudyRun,
    run: &ParticipantRun,
    found: &Identifiability,
    args: &IdentifyOptions,
) -> IdentifiabilityResult {
    let round = |v: f64| rounded(v, DIGITS);
    let percent = |log_sd: f64| rounded(100.0 * log_sd, 4);
    let deviation = |variance: f64| rounded(variance.sqrt(), 4);
    let [envelope, gain, floor] = found.noise.of_emg().map(deviation);
    let training = run.trials.iter().filter(|t| t.info.usage == TrialUse::Train).map(|t| t.info.direction);
    let s = &found.soundness;
    IdentifiabilityResult {
        schema: IDENTIFIABILITY_SCHEMA.to_string(),
        provenance: Provenance::default(),
        study: study.study.settings.name.clone(),
        participant: run.participant.name.clone(),
        trials: run.trials.iter().filter(|t| t.info.usage == TrialUse::Train).count(),
        level: args.level,
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
        soundness: SoundnessResult {
            largest_deviance_error: round(s.largest_deviance_error),
            dispersion: rounded(s.dispersion, 4),
            largest_r_hat: round(s.largest_r_hat),
            fewest_effective_draws: rounded(s.fewest_effective_draws, 4),
            divergent: s.divergent,
            share_outside: round(s.share_outside),
        },
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
pub fn write(study: &StudyRun, folder: &Path, result: &IdentifiabilityResult) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(result).map_err(|e| Failure::Internal(e.to_string()))?;
    study.out.write(folder.join("identifiability.json"), (json + "\n").as_bytes())?;
    study.out.write(
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
    study.out.write(folder.join("combinations.csv"), combinations.as_bytes())?;
    let names: Vec<String> = result.parameters.iter().map(|p| format!("{}.{}", p.muscle, p.property)).collect();
    let header: Vec<&str> = std::iter::once("parameter").chain(names.iter().map(String::as_str)).collect();
    let rows = names
        .iter()
        .zip(&result.correlations)
        .map(|(name, row)| std::iter::once(name.clone()).chain(row.iter().map(f64::to_string)).collect::<Vec<_>>());
    study.out.write(folder.join("correlations.csv"), csv_text(header.iter(), rows)?.as_bytes())?;
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
    study.out.write(folder.join("next_trials.csv"), csv_text(header.iter(), rows)?.as_bytes())?;
    study.out.write(folder.join("report.html"), render_identifiability(result).as_bytes())?;
    Ok(())
}

fn draws_csv(result: &IdentifiabilityResult, found: &Identifiability) -> Result<String, Failure> {
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

fn readable(r: &IdentifiabilityResult, study: &StudyRun) -> String {
    let level = format!("{} %", 100.0 * r.level);
    let mut text = format!("{}: {} training trials, {level} intervals\n", r.participant, r.trials);
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
    text.push_str(&table(&header, 3, rows));
    text.push_str("\n[ ]: the bound, which the data do not reach\n\nthe data fix            known to\n");
    let line = |c: &CombinationResult| format!("  ±{:.2} %  {}\n", c.sd_percent, c.words);
    r.combinations.iter().filter(|c| c.share_from_data >= 0.5).take(3).for_each(|c| text.push_str(&line(c)));
    text.push_str("the data leave free     known to\n");
    r.combinations.iter().rev().filter(|c| c.share_from_data < 0.5).take(3).for_each(|c| text.push_str(&line(c)));
    text.push_str("\nnext trial              intervals shrink by\n");
    for t in r.next_trials.iter().take(3) {
        text.push_str(&format!(
            "  {:.1} %  {} (most: {} {:.0} %)\n",
            t.mean_shrinkage_percent, t.trial, t.most, t.most_percent
        ));
    }
    text.push_str(&format!("\n{}\n", study.out.path().join(&r.participant).join("report.html").display()));
    text
}
