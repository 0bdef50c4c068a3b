//! What can be found in a study before a run, in one screen: green, amber, red, with a remedy each.
//!
//! Every finding is one of the checks that other commands make when they read the study
//! ([`Study::check_trials`](carpus_study::study::Study::check_trials),
//! [`StudyParticipant::load`](super::participant::StudyParticipant::load)); here they are gathered by subject. Beside
//! them stand what only a person can judge: the lead of the EMG over the moment, the posture, the conditions.
//! Which parameters and effects the trials can determine at all is expected of the model as given with usual noise; what
//! they do determine takes a fit (`carpus identify`).

use std::collections::BTreeMap;
use std::mem::{Discriminant, discriminant};
use std::path::Path;

use serde::Serialize;

use super::account::fixed;
use super::determines::Determines;
use super::diagnostic::{Diagnostic, Failure, Severity};
use super::init::crossed;
use super::loading::{LoadedParticipant, strengths};
use super::own_effects;
use super::participant::Session;
use super::progress::Progress;
use super::study::{Opening, Study};
use carpus_report::next_steps::{NextStep, command, quoted};
use carpus_study::dynamometer::align;
use carpus_study::study::{Contraction, Fault, Problem, Trial, TrialUse};

/// EMG leads the moment by the electromechanical delay and the rise of force, some 0.03 to 0.2 s (Cavanagh and Komi
/// 1979; Winter and Brookes 1991); beyond these bounds the clocks differ [s].
const PLAUSIBLE_LEAD: [f64; 2] = [-0.03, 0.25];
/// Delays that are looked at [s].
const MOST_LEAD: f64 = 0.8;
/// A correlation of EMG and moment from which on their delay means something.
const LEAST_CORRELATION: f64 = 0.6;
/// Angles that differ by less are one posture [deg].
const SAME_POSTURE_DEG: f64 = 5.0;

/// How grave a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// As it should be.
    Green,
    /// A person should look.
    Amber,
    /// The study cannot be used, or its results would be wrong.
    Red,
}

/// What a finding is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Subject {
    /// Files, tables, keys.
    Files,
    /// Units and sizes.
    Units,
    /// Signs and zeros.
    Signs,
    /// Times, rates, clocks of recorders.
    Timing,
    /// Channels of EMG.
    Emg,
    /// The model, its posture and its paths.
    Posture,
    /// Conditions, and what is held out.
    Trials,
}

impl Subject {
    /// All of them, in the order in which they are shown.
    pub const ALL: [Subject; 7] = [
        Subject::Files,
        Subject::Units,
        Subject::Signs,
        Subject::Timing,
        Subject::Emg,
        Subject::Posture,
        Subject::Trials,
    ];

    /// Its name on the screen.
    pub fn word(self) -> &'static str {
        match self {
            Subject::Files => "files",
            Subject::Units => "units",
            Subject::Signs => "signs",
            Subject::Timing => "timing",
            Subject::Emg => "EMG",
            Subject::Posture => "posture",
            Subject::Trials => "trials",
        }
    }

    /// What is said where nothing was found.
    fn all_clear(self) -> &'static str {
        match self {
            Subject::Files => "all tables and recordings can be read",
            Subject::Units => "sizes are those of the stated units",
            Subject::Signs => "efforts, angles and speeds have the stated signs",
            Subject::Timing => "times, rates and clocks agree",
            Subject::Emg => "no channel is silent, clipped, noisy or exchanged",
            Subject::Posture => "paths of the muscles are smooth over the recorded angles",
            Subject::Trials => "conditions, repetitions and held-out trials are there",
        }
    }
}

/// A finding.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How grave it is.
    pub level: Level,
    /// What it is about.
    pub subject: Subject,
    /// What was found.
    pub text: String,
    /// File, and line where it is known.
    pub place: Option<String>,
    /// Further places with the same finding.
    pub also: usize,
    /// What to do.
    pub remedy: Option<String>,
}

/// How many trials there are of a condition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Condition {
    /// The participant.
    pub participant: String,
    /// Kind of contraction.
    pub contraction: &'static str,
    /// Direction of the effort.
    pub direction: &'static str,
    /// Efforts that were asked for [% of the maximum], each once.
    pub efforts_percent: Vec<f64>,
    /// Least and greatest angle that was recorded [deg].
    pub angle_deg: Option<[f64; 2]>,
    /// Other coordinates that trials hold at values of their own [deg, or m], each value once.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub held: BTreeMap<String, Vec<f64>>,
    /// Largest moment that was recorded [N·m].
    pub largest_moment_n_m: Option<f64>,
    /// Trials that are fitted.
    pub fitted: usize,
    /// Trials that are held out.
    pub held_out: usize,
    /// Trials that set the level of EMG or strength.
    pub mvc: usize,
}

/// What was found in a study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Checked {
    /// Name and version of the form.
    pub schema: &'static str,
    /// The study.
    pub study: String,
    /// The gravest level of all findings.
    pub level: Level,
    /// Trials by condition; empty where they could not be read.
    pub conditions: Vec<Condition>,
    /// The findings, those of a subject together; a subject without any is green.
    pub findings: Vec<Finding>,
    /// What the trials of every participant can determine at all.
    pub determines: Vec<Determines>,
    /// What to do next.
    pub next: Vec<NextStep>,
}

/// A check of a study.
#[derive(Clone, Debug, Default)]
pub struct Check {
    /// How the study is opened.
    pub opening: Opening,
}

impl Checked {
    /// How many findings keep commands from working.
    pub fn red(&self) -> usize {
        self.findings.iter().filter(|f| f.level == Level::Red).count()
    }
}

impl Check {
    /// Checks a study.
    ///
    /// - `path`: the study.toml, or the folder it is in
    ///
    /// # Errors
    /// A fault of this program; a request to stop. What is wrong with the study is in the result.
    pub fn run(&self, path: &Path, progress: &dyn Progress) -> Result<Checked, Failure> {
        let mut found = Findings::default();
        let (mut conditions, mut determines) = (Vec::new(), Vec::new());
        match own_effects::register_all(&[], Some(path)) {
            Ok(()) => {}
            Err(Failure::Input(messages)) => found.add_diagnostics(&messages, Subject::Files),
            Err(other) => return Err(other),
        }
        match Study::open_with(path, self.opening.clone()) {
            Ok(study) => {
                let problems = study
                    .tables
                    .check_trials(|info| study.chosen().iter().any(|participant| participant.name == info.participant));
                found.add_problems(study.tables.warnings.iter().chain(&problems));
                for (done, participant) in study.participants().enumerate() {
                    progress.at("checking", done, study.chosen().len());
                    match participant.load() {
                        Ok(session) => {
                            found.add_diagnostics(&session.data.warnings, Subject::Posture);
                            look(&session, &mut found)?;
                            conditions.extend(of_participant(&session.data));
                            match session.determines() {
                                Ok(expected) => determines.extend(expected),
                                Err(Failure::Input(messages)) => found.add_diagnostics(&messages, Subject::Posture),
                                Err(other) => return Err(other),
                            }
                        }
                        Err(Failure::Input(messages)) => found.add_diagnostics(&messages, Subject::Posture),
                        Err(other) => return Err(other),
                    }
                }
                progress.finished();
            }
            Err(Failure::Input(messages)) => found.add_diagnostics(&messages, Subject::Files),
            Err(other) => return Err(other),
        }
        Ok(found.into_checked(path, conditions, determines))
    }
}

/// Findings as they come in.
#[derive(Default)]
struct Findings {
    list: Vec<Finding>,
    kinds: Vec<(Discriminant<Fault>, Severity, usize)>,
    /// Texts and places of all problems: commands say them once more with the model.
    said: Vec<Diagnostic>,
}

impl Findings {
    fn add_problems<'p>(&mut self, problems: impl Iterator<Item = &'p Problem>) {
        for problem in problems {
            let message = Diagnostic::from(problem);
            if self.said.contains(&message) {
                continue;
            }
            let kind = discriminant(&problem.fault);
            let known = self.kinds.iter().find(|(k, severity, _)| *k == kind && *severity == problem.severity);
            match known {
                Some((_, _, place)) => self.list[*place].also += 1,
                None => {
                    self.kinds.push((kind, problem.severity, self.list.len()));
                    self.list.push(finding(&message, subject(&problem.fault)));
                }
            }
            self.said.push(message);
        }
    }

    fn add_diagnostics(&mut self, messages: &[Diagnostic], about: Subject) {
        for message in messages {
            if !self.said.contains(message) {
                self.list.push(finding(message, about));
                self.said.push(message.clone());
            }
        }
    }

    fn add(&mut self, level: Level, subject: Subject, text: String, remedy: &str) {
        let remedy = Some(remedy.to_owned()).filter(|text| !text.is_empty());
        let new = Finding { level, subject, text, place: None, also: 0, remedy };
        if !self.list.contains(&new) {
            self.list.push(new);
        }
    }

    fn into_checked(mut self, path: &Path, conditions: Vec<Condition>, determines: Vec<Determines>) -> Checked {
        for subject in Subject::ALL {
            let is_read = !conditions.is_empty();
            if is_read && self.list.iter().all(|f| f.subject != subject || f.level == Level::Green) {
                let is_said = self.list.iter().any(|f| f.subject == subject);
                if !is_said {
                    self.add(Level::Green, subject, subject.all_clear().to_owned(), "");
                }
            }
        }
        self.list.sort_by(|a, b| (a.subject, b.level).cmp(&(b.subject, a.level)));
        let level = self.list.iter().map(|f| f.level).max().unwrap_or(Level::Green);
        let shown = path.display();
        let next = next_steps(level, &quoted(&shown.to_string()));
        Checked {
            schema: "carpus.check/1",
            study: shown.to_string(),
            level,
            conditions,
            findings: self.list,
            determines,
            next,
        }
    }
}

/// What to do after a check of a study.
fn next_steps(level: Level, study: &str) -> Vec<NextStep> {
    let again = command("Mend what is red, and check again.", format!("carpus check {study}"));
    let compare = command("See how far the model as given is off.", format!("carpus compare {study} --out compared"));
    let fit = command("Fit the muscles to the trials.", format!("carpus personalize {study} --out personalized"));
    let look = "Look at what is amber: it may be right, or a slip of unit, sign or channel.";
    match level {
        Level::Red => vec![again],
        Level::Amber => vec![NextStep { what: look.to_owned(), command: None }, compare, fit],
        Level::Green => vec![compare, fit],
    }
}

fn finding(message: &Diagnostic, subject: Subject) -> Finding {
    Finding {
        level: if message.severity == Severity::Error { Level::Red } else { Level::Amber },
        subject,
        text: message.text.clone(),
        place: message.place(),
        also: 0,
        remedy: message.hint.clone(),
    }
}

fn subject(fault: &Fault) -> Subject {
    match fault {
        Fault::UnitInName { .. }
        | Fault::LooksLikeRadians { .. }
        | Fault::LooksLikeDegrees { .. }
        | Fault::MomentScale { .. }
        | Fault::Implausible { .. }
        | Fault::ImplausibleBuild { .. }
        | Fault::MvcDisagrees { .. } => Subject::Units,
        Fault::MomentReversed { .. }
        | Fault::MomentSign { .. }
        | Fault::VelocityDisagrees { .. }
        | Fault::AngleOutOfRange { .. }
        | Fault::PostureMismatch { .. } => Subject::Signs,
        Fault::ImplausibleTime { .. }
        | Fault::CoarseSampling { .. }
        | Fault::TimeNotIncreasing { .. }
        | Fault::TimeRepeated { .. }
        | Fault::UnequalSteps { .. }
        | Fault::Gap { .. }
        | Fault::MomentResampled { .. }
        | Fault::ColumnResampled { .. }
        | Fault::OtherTimes { .. }
        | Fault::EmgClock { .. }
        | Fault::EmgClockDoubtful { .. }
        | Fault::LittleInCommon { .. } => Subject::Timing,
        Fault::RawEmg { .. }
        | Fault::EmgChannel { .. }
        | Fault::NoMvcTrial { .. }
        | Fault::EmgOutOfRange { .. }
        | Fault::ConstantEmg { .. }
        | Fault::ChannelsExchanged { .. } => Subject::Emg,
        Fault::IsometricMoves { .. }
        | Fault::NothingToTrain
        | Fault::NoTrials { .. }
        | Fault::DuplicateCondition { .. }
        | Fault::SomeStartTimes { .. }
        | Fault::OwnGravityNotTurned => Subject::Trials,
        Fault::NotInModel { .. } => Subject::Posture,
        _ => Subject::Files,
    }
}

/// What no other command says of a participant.
fn look(session: &Session<'_>, found: &mut Findings) -> Result<(), Failure> {
    let data = &session.data;
    let settings = &session.study.tables.settings;
    lead(data, found);
    let chosen = data.model.coordinate();
    for (name, default_deg, muscles) in crossed(&data.loaded, &settings.active_muscles, chosen)? {
        let stated = settings.posture.iter().any(|held| held.coordinate == name)
            || data.trials.iter().all(|t| t.info.held_at(&name).is_some());
        if !stated {
            let text =
                format!("{name} stays at the model's {}°, and {} cross it", fixed(default_deg, 0), muscles.join(", "));
            found.add(Level::Amber, Subject::Posture, text, &format!("set {name} in [posture_deg] of study.toml"));
        }
    }
    let name = &data.participant.name;
    let trained = || data.trials.iter().filter(|t| t.info.usage == TrialUse::Train);
    if !data.trials.iter().any(|t| t.info.usage == TrialUse::Test) {
        let text = format!("no trial of {name} is held out: nothing says how good a fit is");
        found.add(Level::Amber, Subject::Trials, text, "set use = test for one repetition of every condition");
    }
    let angles: Vec<f64> = trained()
        .filter(|t| t.info.contraction != Contraction::Passive)
        .flat_map(|t| t.angle.iter().map(|a| a.to_degrees()))
        .collect();
    let (low, high) = angles.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), a| (l.min(*a), h.max(*a)));
    if !angles.is_empty() && high - low < SAME_POSTURE_DEG {
        let text = format!("all efforts of {name} are at one angle: lengths of muscles are hardly determined");
        found.add(Level::Amber, Subject::Trials, text, "record efforts at three angles or more, or in motion");
    }
    if !trained().any(|t| t.info.contraction == Contraction::Passive) {
        let text =
            format!("no passive trial of {name} is fitted: passive moments and lengths are told apart less well");
        found.add(Level::Amber, Subject::Trials, text, "record the relaxed limb moved by the machine");
    }
    Ok(())
}

/// By how much the EMG leads the moment: median over the efforts in which one follows the other.
fn lead(data: &LoadedParticipant, found: &mut Findings) {
    let of_trial = |(i, trial): (usize, &Trial)| {
        if trial.info.contraction == Contraction::Passive {
            return None;
        }
        let strengths = strengths(&data.prepared[i], &data.model);
        let along = |k: usize| -> f64 { trial.excitation.iter().zip(&strengths).map(|(e, s)| e[k] * s[k]).sum() };
        let expected: Vec<f64> = (0..trial.len()).map(along).collect();
        let found = align((&trial.time, &trial.moment), (&trial.time, &expected), MOST_LEAD).ok()?;
        (found.correlation > LEAST_CORRELATION).then_some(found.shift)
    };
    let mut leads: Vec<f64> = data.trials.iter().enumerate().filter_map(of_trial).collect();
    leads.sort_by(f64::total_cmp);
    let Some(&median) = leads.get(leads.len() / 2) else { return };
    let name = &data.participant.name;
    let [low, high] = PLAUSIBLE_LEAD;
    let milliseconds = fixed(1e3 * median, 0);
    if (low..=high).contains(&median) {
        let text = format!("EMG of {name} leads the moment by {milliseconds} ms (median of {} efforts)", leads.len());
        found.add(Level::Green, Subject::Timing, text, "");
    } else {
        let text = format!(
            "EMG of {name} leads the moment by {milliseconds} ms (median of {} efforts): expected {} to {} ms",
            leads.len(),
            fixed(1e3 * low, 0),
            fixed(1e3 * high, 0)
        );
        let remedy = "the recorders' clocks differ: set delay_s in [emg_recorder], or a shared quantity; EMG that was \
                      smoothed forward only lags, too";
        found.add(Level::Amber, Subject::Timing, text, remedy);
    }
}

fn of_participant(data: &LoadedParticipant) -> Vec<Condition> {
    let mut conditions: BTreeMap<(Contraction, u8), Condition> = BTreeMap::new();
    for trial in &data.trials {
        let info = &trial.info;
        let condition = conditions.entry((info.contraction, info.direction as u8)).or_insert_with(|| Condition {
            participant: data.participant.name.clone(),
            contraction: info.contraction.word(),
            direction: info.direction.word(),
            efforts_percent: Vec::new(),
            angle_deg: None,
            held: BTreeMap::new(),
            largest_moment_n_m: None,
            fitted: 0,
            held_out: 0,
            mvc: 0,
        });
        for effort in info.effort_percent.into_iter().filter(|_| info.contraction != Contraction::Mvc) {
            if !condition.efforts_percent.contains(&effort) {
                condition.efforts_percent.push(effort);
                condition.efforts_percent.sort_by(f64::total_cmp);
            }
        }
        for own in &info.held {
            let values = condition.held.entry(own.coordinate.clone()).or_default();
            if !values.contains(&own.value_deg_or_m) {
                values.push(own.value_deg_or_m);
                values.sort_by(f64::total_cmp);
            }
        }
        let [low, high] = condition.angle_deg.unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
        let range = trial.angle.iter().fold([low, high], |[l, h], a| [l.min(a.to_degrees()), h.max(a.to_degrees())]);
        condition.angle_deg = Some(range);
        condition.largest_moment_n_m = Some(condition.largest_moment_n_m.unwrap_or(0.0).max(trial.max_abs_moment()));
        match info.usage {
            TrialUse::Train => condition.fitted += 1,
            TrialUse::Test => condition.held_out += 1,
            TrialUse::Mvc => condition.mvc += 1,
            TrialUse::Ignore => {}
        }
    }
    conditions.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_findings_of_one_kind_stand_once_and_red_is_the_gravest() {
        let mut found = Findings::default();
        let reversed = Fault::MomentSign { effort_n_m: -1.0, direction: "flexion" };
        for file in ["a.csv", "b.csv", "a.csv"] {
            found.add_problems([Problem::warning(Path::new(file), None, reversed.clone())].iter());
        }
        found.add_problems([Problem::error(Path::new("c.csv"), 3, Fault::NotText)].iter());
        let checked = found.into_checked(Path::new("study"), Vec::new(), Vec::new());
        assert_eq!(checked.level, Level::Red);
        assert_eq!(checked.findings.len(), 2);
        let signs = checked.findings.iter().find(|f| f.subject == Subject::Signs).unwrap();
        assert_eq!((signs.also, signs.level), (1, Level::Amber));
        assert_eq!(checked.findings[0].place.as_deref(), Some("c.csv:3"));
    }
}
