//! An effect of a laboratory's own, checked as those of the catalogue are, and what it looks like.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::bundled;
use super::diagnostic::{Diagnostic, Failure};
use super::output::OutputFolder;
use super::own_effects;
use super::progress::{Progress, go_on};
use carpus_effects::conformance::{Check, checks};
use carpus_effects::effect::{Effect, Role};
use carpus_effects::forward_model::ForwardModel;
use carpus_effects::own_effect::{DefinedParameter, OwnEffect, Place, Variable};
use carpus_osim::osim::OsimFile;
use carpus_simulation::simulation::{MusculoskeletalModel, Setup};
use carpus_study::study::{Contraction, Study as Tables, Trial, TrialInfo};

/// Trials that an effect is shown on, of each kind of contraction.
const TRIALS_PER_KIND: usize = 2;
/// Points of a curve.
const POINTS: usize = 48;

/// A check of an effect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckEffect {
    /// Its definition.
    pub file: PathBuf,
    /// The study that it is shown on; without one the bundled one.
    pub study: Option<PathBuf>,
    /// The participant; without one the first.
    pub participant: Option<String>,
}

/// What a check found.
#[derive(Clone)]
pub struct CheckedEffect {
    /// The effect.
    pub effect: &'static OwnEffect,
    /// The checks.
    pub checks: Vec<Check>,
    /// The study that it was shown on.
    pub shown_on: String,
    /// The trials.
    pub trials: Vec<String>,
    file: PathBuf,
}

/// The formula at a typical size.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Parameters and their values.
    pub sizes: Vec<(String, f64)>,
    /// Unit of the formula.
    pub unit: &'static str,
    /// The formula with every variable about the middle of its range.
    pub middle: f64,
    /// Over each variable, the others about the middle.
    pub curves: Vec<Curve>,
}

/// The formula over a variable.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// The variable.
    pub variable: String,
    /// From and to.
    pub range: [f64; 2],
    /// The formula, evenly spaced.
    pub values: Vec<f64>,
}

/// Heights of a curve's points.
const HEIGHTS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

impl Curve {
    /// The least and the greatest of its values.
    pub fn reaches(&self) -> [f64; 2] {
        self.values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, m], v| [l.min(*v), m.max(*v)])
    }

    /// The curve in a line of text: a bar for every value.
    pub fn heights(&self) -> String {
        let [least, most] = self.reaches();
        let height = |v: &f64| {
            let share = if most > least { (v - least) / (most - least) } else { 0.5 };
            HEIGHTS[(share * (HEIGHTS.len() - 1) as f64).round() as usize]
        };
        self.values.iter().map(height).collect()
    }
}

impl CheckEffect {
    /// Registers the effect and checks it.
    ///
    /// # Errors
    /// The file, the study, its model and trials; a request to stop.
    pub fn run(&self, progress: &dyn Progress) -> Result<CheckedEffect, Failure> {
        let effect = own_effects::read(&self.file, None)?;
        let folder = tempfile::tempdir().map_err(|e| Failure::Internal(format!("a temporary folder: {e}")))?;
        let (file, shown_on) = match &self.study {
            Some(study) => (study.clone(), study.display().to_string()),
            None => {
                bundled::write_study(&OutputFolder::create(folder.path(), &[])?)?;
                (folder.path().join("study/study.toml"), "the bundled study (--study names another)".to_owned())
            }
        };
        let study = Tables::read_tables(&file)?;
        let unknown = effect.defined().unknown_muscles(&study.settings.active_muscles);
        if !unknown.is_empty() {
            let mut messages: Vec<Diagnostic> = unknown.iter().map(Diagnostic::from).collect();
            if self.study.is_none() {
                let text = "without --study the effect is shown on the bundled study, which has the muscles of a wrist";
                messages.push(Diagnostic::warning(text).hint("--study STUDY/study.toml shows it on yours"));
            }
            return Err(messages.into());
        }
        let forward = forward(&study, self.participant.as_deref())?;
        go_on(progress)?;
        let checks = checks(&forward, effect, effect.has_kinks())
            .map_err(|e| Diagnostic::error(e.to_string()).in_file(&file))?;
        let trials = forward.trials.iter().map(|t| t.info.name.clone()).collect();
        Ok(CheckedEffect { effect, checks, shown_on, trials, file: self.file.clone() })
    }
}

impl CheckedEffect {
    /// What is wrong with it, if a check failed.
    pub fn fault(&self) -> Option<Diagnostic> {
        let failed = self.checks.iter().filter(|c| !c.passed).count();
        let text = format!("{failed} of {} checks failed", self.checks.len());
        let message = Diagnostic::error(text).in_file(&self.file).at_line(self.effect.defined().formula_line);
        (failed > 0).then(|| message.hint(advice(&self.checks, self.effect)))
    }

    /// For programs.
    pub fn value(&self) -> Value {
        json!({
            "schema": "carpus.effect_check/1", "effect": self.effect.description(), "passed": self.fault().is_none(),
            "checks": self.checks,
        })
    }
}

/// The formula over each of its variables, all else about the middle, at a typical size.
pub fn shape(effect: &OwnEffect) -> Shape {
    let d = effect.defined();
    let typical = |p: &DefinedParameter| match p.role {
        Role::Amplitude => p.typical,
        Role::Shape => p.start,
    };
    let range = |v: &Variable| {
        let values = v.usual_values();
        [values.first().copied().unwrap_or(0.0), values.last().copied().unwrap_or(1.0)]
    };
    // Not 0: what is a product of two variables would not show.
    let middle = |v: &Variable| range(v)[0] + 0.65 * (range(v)[1] - range(v)[0]);
    let base: Vec<f64> = d.variables.iter().map(middle).chain(d.parameters.iter().map(typical)).collect();
    let curve = |(i, variable): (usize, &Variable)| {
        let [low, high] = range(variable);
        let at = |k: usize| {
            let mut values = base.clone();
            values[i] = low + (high - low) * k as f64 / (POINTS - 1) as f64;
            effect.value_at(&values)
        };
        Curve { variable: variable.word(), range: [low, high], values: (0..POINTS).map(at).collect() }
    };
    Shape {
        sizes: d.parameters.iter().map(|p| (p.name.to_string(), typical(p))).collect(),
        unit: match d.place {
            Place::Joint => "N·m",
            Place::Muscles => "of the moment",
        },
        middle: effect.value_at(&base),
        curves: d.variables.iter().enumerate().map(curve).collect(),
    }
}

/// What to do about the first check that failed.
fn advice(found: &[Check], effect: &OwnEffect) -> &'static str {
    let failed = |what: &str| found.iter().any(|c| !c.passed && c.what.contains(what));
    match () {
        () if failed("shows in these trials") => {
            "nothing that the formula reads varies in these trials, or it is too small: give a larger `typical`, or \
             --study with \
             trials that show it"
        }
        () if failed("moments that a joint has") => "narrow the plausible ranges",
        () if failed("three times") => {
            "multiply the formula by its amplitude, and let what shapes it be a parameter with role = \"shape\""
        }
        () if effect.has_kinks() => {
            "a parameter that moves a step has no derivative and cannot be fitted: write tanh((q-q0)/0.02) for \
             sign(q-q0), and \
             0.5+0.5*tanh((q-q0)/0.02) for step(q-q0)"
        }
        () => "a smaller `typical` where the formula is steep in the parameter",
    }
}

/// The first trials of each kind, prepared.
fn forward(study: &Tables, participant: Option<&str>) -> Result<ForwardModel, Failure> {
    let name = participant.map(str::to_owned).or_else(|| study.participants.first().map(|p| p.name.clone()));
    let participant = name.as_deref().and_then(|name| study.participant(name)).ok_or_else(|| {
        let known: Vec<&str> = study.participants.iter().map(|p| p.name.as_str()).collect();
        let text = format!("there is no participant `{}`", name.as_deref().unwrap_or_default());
        Diagnostic::error(text).in_file(&study.file).hint(format!("there are: {}", known.join(", ")))
    })?;
    let at_model = |text: String| Diagnostic::error(text).in_file(&participant.model);
    let file = OsimFile::read(&participant.model).map_err(|e| at_model(e.to_string()))?;
    let model = MusculoskeletalModel::compile(&file.spec, &Setup::from_settings(&study.settings))
        .map_err(|e| at_model(e.to_string()))?;
    let of_kind = |kind: Contraction| {
        let infos = study.trials_of(&participant.name).filter(move |t| t.contraction == kind && !t.is_mvc());
        infos.take(TRIALS_PER_KIND)
    };
    let kinds = [Contraction::Isometric, Contraction::Isotonic, Contraction::Passive];
    let mut infos: Vec<&TrialInfo> = kinds.into_iter().flat_map(of_kind).collect();
    if infos.is_empty() {
        infos = study.trials_of(&participant.name).take(2 * TRIALS_PER_KIND).collect();
    }
    let trials = infos.into_iter().map(|info| study.trial(info)).collect::<Result<Vec<Trial>, _>>()?;
    ForwardModel::new(&file.spec, &model, &trials).map_err(|e| at_model(e.to_string()).into())
}
