//! The training cases of table 3.1, fitted by the dissertation's optimizer and by exact gradients.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::step::{Context, Step, Told};
use crate::account::{csv_text, digits, fixed};
use crate::diagnostic::{Diagnostic, Failure};
use crate::loading::LoadedParticipant;
use crate::personalize::writing_failure;
use crate::report_parts::{ReportParts, overview};
use crate::units::{Unit, value};
use carpus_osim::osim::OsimFile;
use carpus_personalization::personalization::{
    CaseFit, CaseOptions, CaseProblem, FittedParameter, Optimizer, Property, TrainingCase, TrainingTrial, fit_case,
    write_parameters,
};
use carpus_report::article::{Block, TextTable};

/// The step.
pub(super) struct Personalize;

/// A fitted case of a participant, as it is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct FittedCase {
    /// The participant.
    pub participant: String,
    /// Key of the case.
    pub case: String,
    /// Name of the case.
    pub label: String,
    /// Key of the optimizer.
    pub optimizer: String,
    /// Trials that informed the lengths.
    pub length_trials: usize,
    /// Trials that informed the forces.
    pub force_trials: usize,
    /// Parameter sets tried.
    pub evaluations: usize,
    /// Mean J over the case's trials with the model itself.
    pub objective_before: f64,
    /// And with the fitted parameters.
    pub objective: f64,
    /// The stages.
    pub stages: Vec<FittedStage>,
    /// The parameters.
    pub parameters: Vec<FittedValue>,
}

/// A stage of a fit, as it is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct FittedStage {
    /// What was done.
    pub name: String,
    /// Parameter sets tried.
    pub evaluations: usize,
    /// J before.
    pub objective_before: f64,
    /// J after.
    pub objective_after: f64,
}

/// A fitted parameter, as it is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct FittedValue {
    /// The muscle.
    pub muscle: String,
    /// OpenSim property name.
    pub property: String,
    /// The model's value.
    pub before: f64,
    /// The fitted value.
    pub after: f64,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Whether it lies on a bound.
    pub at_bound: bool,
}

/// Where a case is stored.
pub(super) fn place(participant: &str, case: &TrainingCase, optimizer: Optimizer) -> String {
    format!("personalize/{participant}/{}.{}", case.id(), optimizer.id())
}

impl Step for Personalize {
    fn id(&self) -> &'static str {
        "personalize"
    }

    fn title(&self) -> &'static str {
        "Training cases"
    }

    fn units<'a>(&self, context: &'a Context, run: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        let options = CaseOptions {
            seed: context.request.seed,
            bayesian_evaluations: context.request.bayesian_evaluations,
            sqp_iterations: context.request.sqp_iterations,
            ..CaseOptions::default()
        };
        let mut units = Vec::new();
        for case in TrainingCase::of_trials(run.trials.iter().map(|t| &t.info)) {
            for optimizer in Optimizer::ALL {
                units.push(Unit {
                    place: place(&run.participant.name, &case, optimizer),
                    depends_on: format!("{options:?} {:?}", context.study.tables.settings.bounds),
                    work: Box::new(move || value(&fitted(context, run, &case, optimizer, &options)?)),
                });
            }
        }
        Ok(units)
    }

    fn write(&self, context: &Context, run: &LoadedParticipant) -> Result<(), Failure> {
        for (folder, optimizer) in
            [("models", Optimizer::ExactGradients), ("models_bayesian_sqp", Optimizer::BayesianSqp)]
        {
            for (case, file) in files(context, run, optimizer)? {
                let name = format!("{folder}/{}/{}.osim", run.participant.name, case.id());
                context.out.write(name, file.document.bytes())?;
            }
        }
        Ok(())
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let cases = in_order(context, context.store.finished(self.id())?);
        if cases.is_empty() {
            return Ok(Told::NotRun(
                "the study has no isometric or isotonic training trials with an effort".to_string(),
            ));
        }
        report(context, &cases).map(Told::Parts)
    }
}

/// The models of the cases that are finished.
///
/// # Errors
/// A value that cannot be written into the model.
pub(super) fn files(
    context: &Context,
    run: &LoadedParticipant,
    optimizer: Optimizer,
) -> Result<Vec<(TrainingCase, OsimFile)>, Failure> {
    let mut files = Vec::new();
    for case in TrainingCase::of_trials(run.trials.iter().map(|t| &t.info)) {
        let Some(fitted) = context.store.get::<FittedCase>(&place(&run.participant.name, &case, optimizer))? else {
            continue;
        };
        let mut file = run.loaded.file.clone();
        write_parameters(&mut file, &values(&fitted)).map_err(|e| writing_failure(&e, &run.loaded.path))?;
        files.push((case, file));
    }
    Ok(files)
}

/// What is to be written into the model.
fn values(case: &FittedCase) -> Vec<FittedParameter> {
    let of = |v: &FittedValue| {
        let property = Property::ALL.into_iter().find(|p| p.name() == v.property)?;
        Some(FittedParameter {
            muscle: v.muscle.clone(),
            property,
            before: v.before,
            after: v.after,
            lower: v.lower,
            upper: v.upper,
            at_bound: None,
            estimate: None,
        })
    };
    case.parameters.iter().filter_map(of).collect()
}

fn fitted(
    context: &Context,
    run: &LoadedParticipant,
    case: &TrainingCase,
    optimizer: Optimizer,
    options: &CaseOptions,
) -> Result<FittedCase, Failure> {
    let chosen = |informs: &dyn Fn(&TrainingCase, usize) -> bool| {
        let all = (0..run.trials.len()).filter(|&i| informs(case, i));
        all.map(|i| TrainingTrial { prepared: &run.prepared[i], measured: &run.trials[i].moment }).collect::<Vec<_>>()
    };
    let problem = CaseProblem {
        lengths: chosen(&|case, i| case.informs_lengths(&run.trials[i].info)),
        forces: chosen(&|case, i| case.informs_forces(&run.trials[i].info)),
        muscles: run.model.muscle_names().map(String::from).collect(),
        nominal: run.model.nominal_parameters(),
        bounds: context.study.tables.settings.bounds,
    };
    let fit = fit_case(&problem, optimizer, options).map_err(|e| {
        let text = format!("participant {}, {}: {e}", run.participant.name, case.label());
        Failure::from(Diagnostic::error(text).in_file(&context.study.tables.folder.join("trials.csv")))
    })?;
    Ok(stored(run, case, optimizer, &problem, &fit))
}

fn stored(
    run: &LoadedParticipant,
    case: &TrainingCase,
    optimizer: Optimizer,
    problem: &CaseProblem,
    fit: &CaseFit,
) -> FittedCase {
    let stage = |s: &carpus_personalization::personalization::Stage| FittedStage {
        name: s.name.to_string(),
        evaluations: s.evaluations,
        objective_before: s.objective_before,
        objective_after: s.objective_after,
    };
    let parameter = |p: &FittedParameter| FittedValue {
        muscle: p.muscle.clone(),
        property: p.property.name().to_string(),
        before: p.before,
        after: p.after,
        lower: p.lower,
        upper: p.upper,
        at_bound: p.at_bound.is_some(),
    };
    FittedCase {
        participant: run.participant.name.clone(),
        case: case.id(),
        label: case.label(),
        optimizer: optimizer.id().to_string(),
        length_trials: problem.lengths.len(),
        force_trials: problem.forces.len(),
        evaluations: fit.evaluations,
        objective_before: fit.objective_before,
        objective: fit.objective,
        stages: fit.stages.iter().map(stage).collect(),
        parameters: fit.fitted.iter().map(parameter).collect(),
    }
}

/// In the order of participants and cases.
fn in_order(context: &Context, mut cases: Vec<FittedCase>) -> Vec<FittedCase> {
    let order = |c: &FittedCase| {
        let participant = context.study.chosen().iter().position(|p| p.name == c.participant);
        let kind =
            carpus_personalization::personalization::CaseKind::ALL.iter().position(|k| c.case.starts_with(k.word()));
        (participant, kind, c.case.clone(), c.optimizer.clone())
    };
    cases.sort_by_key(order);
    cases
}

/// What an optimizer did in a case, over participants.
#[derive(Default)]
struct Sums {
    participants: usize,
    before: f64,
    after: f64,
    evaluations: usize,
}

fn report(context: &Context, cases: &[FittedCase]) -> Result<ReportParts, Failure> {
    let mut labels: Vec<(String, String)> = Vec::new();
    let mut sums: BTreeMap<(String, String), Sums> = BTreeMap::new();
    for c in cases {
        if !labels.iter().any(|(id, _)| *id == c.case) {
            labels.push((c.case.clone(), c.label.clone()));
        }
        let sum = sums.entry((c.case.clone(), c.optimizer.clone())).or_default();
        sum.participants += 1;
        sum.before += c.objective_before;
        sum.after += c.objective;
        sum.evaluations += c.evaluations;
    }
    let seconds = context.store.seconds();
    let time = |case: &str, optimizer: Optimizer| {
        let suffix = format!("/{case}.{}", optimizer.id());
        seconds
            .iter()
            .filter(|(place, _)| place.starts_with("personalize/") && place.ends_with(&suffix))
            .map(|(_, s)| s)
            .sum::<f64>()
    };
    let (mut rows, mut terminal) = (Vec::new(), Vec::new());
    for (id, label) in &labels {
        let of = |optimizer: Optimizer| sums.get(&(id.clone(), optimizer.id().to_string()));
        let mean = |s: Option<&Sums>, what: fn(&Sums) -> f64| {
            s.map_or("–".to_string(), |s| fixed(what(s) / s.participants as f64, 4))
        };
        let count =
            |s: Option<&Sums>| s.map_or("–".to_string(), |s| fixed(s.evaluations as f64 / s.participants as f64, 0));
        let (theirs, ours) = (of(Optimizer::BayesianSqp), of(Optimizer::ExactGradients));
        let mut row = vec![label.clone(), mean(ours.or(theirs), |s| s.before)];
        row.extend([mean(theirs, |s| s.after), count(theirs), mean(ours, |s| s.after), count(ours)]);
        let mut with_time = row.clone();
        let per = |s: Option<&Sums>, optimizer| {
            s.map_or("–".to_string(), |s| fixed(time(id, optimizer) / s.participants as f64, 2))
        };
        with_time.insert(4, per(theirs, Optimizer::BayesianSqp));
        with_time.push(per(ours, Optimizer::ExactGradients));
        terminal.push(with_time);
        rows.push(row);
    }
    let lower = |a: &FittedCase| {
        cases.iter().any(|b| {
            a.participant == b.participant
                && a.case == b.case
                && b.optimizer == Optimizer::BayesianSqp.id()
                && a.objective <= b.objective
        })
    };
    let ours = || cases.iter().filter(|c| c.optimizer == Optimizer::ExactGradients.id());
    let (all, better) = (ours().count(), ours().filter(|c| lower(c)).count());
    let on_bound = ours().flat_map(|c| &c.parameters).filter(|p| p.at_bound).count();
    let parameters = ours().map(|c| c.parameters.len()).sum::<usize>();
    let table_block = TextTable {
        title: "Two optimizers side by side, mean over participants".to_string(),
        header: ["case", "J of the model", "J, Bayesian + SQP", "evaluations", "J, exact gradients", "evaluations"]
            .map(String::from)
            .to_vec(),
        left_columns: 1,
        rows,
        note: "J = NRMSE + MaxErr + XCorr (equation 3.4), mean over all trials of the case. Processor seconds are in \
               timings.csv."
            .to_string(),
    };
    let header =
        ["case", "J of the model", "J, Bayesian + SQP", "evaluations", "s", "J, exact gradients", "evaluations", "s"];
    Ok(ReportParts {
        lead: format!(
            "{all} training cases were fitted; exact gradients reached an objective lower than or equal to that of \
             Bayesian \
             optimization with SQP in {better} of them."
        ),
        blocks: vec![
            Block::Text(
                "Cases of table 3.1: isometric and isotonic trials inform all parameters, cross takes lengths from \
                 isotonic \
                 and forces from isometric trials, combined takes both. Bounds of study.toml (table 3.2 by default)."
                    .to_string(),
            ),
            Block::Table(table_block),
            Block::Text(format!("{on_bound} of {parameters} parameters fitted by exact gradients lie on a bound.")),
        ],
        tables: vec![
            ("cases.csv".to_string(), cases_csv(cases)?),
            ("case_stages.csv".to_string(), stages_csv(cases)?),
            ("case_parameters.csv".to_string(), parameters_csv(cases)?),
        ],
        overview: vec![TextTable {
            note: format!(
                "exact gradients reached J lower than or equal to Bayesian optimization with SQP in {better} of {all}"
            ),
            ..overview("mean over participants; seconds are of one processor", &header, 1, terminal)
        }],
        ..ReportParts::default()
    })
}

fn cases_csv(cases: &[FittedCase]) -> Result<String, Failure> {
    let header = [
        "participant",
        "case",
        "optimizer",
        "length_trials",
        "force_trials",
        "evaluations",
        "objective_before",
        "objective",
    ];
    let rows = cases.iter().map(|c| {
        let mut row = vec![c.participant.clone(), c.case.clone(), c.optimizer.clone()];
        row.extend([c.length_trials, c.force_trials, c.evaluations].map(|n| n.to_string()));
        row.extend([c.objective_before, c.objective].map(digits));
        row
    });
    csv_text(header.iter(), rows)
}

fn stages_csv(cases: &[FittedCase]) -> Result<String, Failure> {
    let header = ["participant", "case", "optimizer", "stage", "evaluations", "objective_before", "objective_after"];
    let rows = cases.iter().flat_map(|c| {
        c.stages.iter().map(move |s| {
            let mut row = vec![c.participant.clone(), c.case.clone(), c.optimizer.clone(), s.name.clone()];
            row.push(s.evaluations.to_string());
            row.extend([s.objective_before, s.objective_after].map(digits));
            row
        })
    });
    csv_text(header.iter(), rows)
}

fn parameters_csv(cases: &[FittedCase]) -> Result<String, Failure> {
    let header =
        ["participant", "case", "optimizer", "muscle", "property", "before", "after", "lower", "upper", "at_bound"];
    let rows = cases.iter().flat_map(|c| {
        c.parameters.iter().map(move |p| {
            let mut row = vec![c.participant.clone(), c.case.clone(), c.optimizer.clone()];
            row.extend([p.muscle.clone(), p.property.clone()]);
            row.extend([p.before, p.after, p.lower, p.upper].map(digits));
            row.push(p.at_bound.to_string());
            row
        })
    });
    csv_text(header.iter(), rows)
}
