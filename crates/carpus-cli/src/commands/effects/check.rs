//! `carpus effects check`: an effect of a laboratory's own, checked as those of the catalogue are, and shown.

use serde_json::json;

use super::details;
use crate::args::Global;
use crate::args_diagnosis::EffectsCheckArgs;
use crate::commands::demo;
use crate::failure::{Diagnostic, Failure};
use crate::print_result;
use crate::table::table;
use carpus_diagnosis::conformance::{Check, checks};
use carpus_diagnosis::effect::{Effect, Role};
use carpus_diagnosis::forward_model::ForwardModel;
use carpus_diagnosis::own_effect::{OwnEffect, Place, Variable};
use carpus_osim::osim::OsimFile;
use carpus_report::significant;
use carpus_session::output::OutputFolder;
use carpus_session::own_effects;
use carpus_simulation::simulation::{MusculoskeletalModel, Setup};
use carpus_study::study::{Contraction, Study, Trial, TrialInfo};

/// Trials that an effect is shown on, of each kind of contraction.
const TRIALS_PER_KIND: usize = 2;
/// Points of a curve.
const POINTS: usize = 48;
/// Heights of a curve's points.
const HEIGHTS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// Runs the command.
///
/// # Errors
/// The file, the study, its model and trials; an effect that fails a check.
pub fn run(args: &EffectsCheckArgs, global: &Global) -> Result<(), Failure> {
    let effect = own_effects::read(&args.file, None)?;
    let bundled = tempfile::tempdir().map_err(|e| Failure::Internal(format!("a temporary folder: {e}")))?;
    let (file, shown) = match &args.study {
        Some(study) => (study.clone(), study.display().to_string()),
        None => {
            demo::write_study(&OutputFolder::create(bundled.path(), &[])?)?;
            (bundled.path().join("study/study.toml"), "the bundled study (--study names another)".to_owned())
        }
    };
    let study = Study::read_tables(&file)?;
    let unknown = effect.defined().unknown_muscles(&study.settings.active_muscles);
    if !unknown.is_empty() {
        let mut messages: Vec<Diagnostic> = unknown.iter().map(Diagnostic::from).collect();
        if args.study.is_none() {
            let text = "without --study the effect is shown on the bundled study, which has the muscles of a wrist";
            messages.push(Diagnostic::warning(text).hint("--study STUDY/study.toml shows it on yours"));
        }
        return Err(messages.into());
    }
    let forward = forward(&study, args.participant.as_deref())?;
    let found =
        checks(&forward, effect, effect.has_kinks()).map_err(|e| Diagnostic::error(e.to_string()).in_file(&file))?;
    let failed = found.iter().filter(|c| !c.passed).count();
    if global.json {
        let value = json!({
            "schema": "carpus.effect_check/1", "effect": effect.description(), "passed": failed == 0, "checks": found,
        });
        print_result(&value.to_string())?;
    } else {
        let trials = forward.trials.iter().map(|t| t.info.name.as_str()).collect::<Vec<_>>().join(", ");
        let text = format!(
            "{}\n\n{}\n\nshown on trials of {shown}: {trials}\n\n{}",
            details(effect.description()),
            curves(effect),
            readable(&found)
        );
        print_result(&text)?;
    }
    match failed {
        0 => Ok(()),
        _ => {
            let text = format!("{failed} of {} checks failed", found.len());
            let message = Diagnostic::error(text).in_file(&args.file).at_line(effect.defined().formula_line);
            Err(message.hint(advice(&found, effect)).into())
        }
    }
}

/// What to do about the first check that failed.
fn advice(found: &[Check], effect: &OwnEffect) -> &'static str {
    let failed = |what: &str| found.iter().any(|c| !c.passed && c.what.contains(what));
    match () {
        () if failed("shows in these trials") => {
            "nothing that the formula reads varies in these trials, or it is too small: give a larger `typical`, or --study with \
             trials that show it"
        }
        () if failed("moments that a joint has") => "narrow the plausible ranges",
        () if failed("three times") => {
            "multiply the formula by its amplitude, and let what shapes it be a parameter with role = \"shape\""
        }
        () if effect.has_kinks() => {
            "a parameter that moves a step has no derivative and cannot be fitted: write tanh((q-q0)/0.02) for sign(q-q0), and \
             0.5+0.5*tanh((q-q0)/0.02) for step(q-q0)"
        }
        () => "a smaller `typical` where the formula is steep in the parameter",
    }
}

fn readable(found: &[Check]) -> String {
    let row = |c: &Check| {
        let mark = if c.passed { "ok" } else { "FAILED" };
        vec![mark.to_owned(), c.what.clone(), c.found.clone(), c.expected.clone()]
    };
    table(&["", "check", "found", "expected"], 4, found.iter().map(row))
}

/// The first trials of each kind, prepared.
fn forward(study: &Study, participant: Option<&str>) -> Result<ForwardModel, Failure> {
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

/// The formula over each of its variables, all else in the middle, at a typical size.
fn curves(effect: &OwnEffect) -> String {
    let d = effect.defined();
    let typical = |p: &carpus_diagnosis::own_effect::DefinedParameter| match p.role {
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
    let unit = match d.place {
        Place::Joint => "N·m",
        Place::Muscles => "of the moment",
    };
    let mut rows = Vec::new();
    for (i, variable) in d.variables.iter().enumerate() {
        let [low, high] = range(variable);
        let at = |k: usize| {
            let mut values = base.clone();
            values[i] = low + (high - low) * k as f64 / (POINTS - 1) as f64;
            effect.value_at(&values)
        };
        let curve: Vec<f64> = (0..POINTS).map(at).collect();
        let [least, most] = curve.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, m], v| [l.min(*v), m.max(*v)]);
        let height = |v: &f64| {
            let share = if most > least { (v - least) / (most - least) } else { 0.5 };
            HEIGHTS[(share * (HEIGHTS.len() - 1) as f64).round() as usize]
        };
        let drawn: String = curve.iter().map(height).collect();
        let ends = format!("{} to {}", significant(low, 3), significant(high, 3));
        rows.push(vec![
            variable.word(),
            ends,
            drawn,
            format!("{} to {} {unit}", significant(least, 3), significant(most, 3)),
        ]);
    }
    let sizes = d.parameters.iter().map(|p| format!("{} = {}", p.name, significant(typical(p), 3)));
    let title = format!("what it looks like at {}", sizes.collect::<Vec<_>>().join(", "));
    match rows.is_empty() {
        true => format!("{title}: {} {unit} throughout", significant(effect.value_at(&base), 3)),
        false => format!("{title}\n{}", table(&["over", "from", "", "the formula is"], 4, rows)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    use carpus_diagnosis::own_effect::{Definition, register};

    #[test]
    fn verif_a_curve_shows_each_variable() {
        let text = "[effect]\nid = \"shown_drag\"\nname = \"Drag\"\nstage = \"joint\"\nformula = \"-b*qdot*(1+q)\"\n\n\
                    [parameters.b]\nunit = \"N·m·s/rad\"\nrole = \"amplitude\"\nplausible = [0, 1]\nsource = \"a guess\"\n";
        let definition = Definition::parse(text, Path::new("drag.toml")).unwrap();
        let shown = curves(register(definition).unwrap());
        let lines: Vec<&str> = shown.lines().collect();
        assert!(lines.len() == 4 && lines[2].starts_with("qdot") && lines[3].starts_with('q'), "{shown}");
        assert!(lines[2].contains("█") && lines[2].contains("▁"), "{shown}");
    }
}
