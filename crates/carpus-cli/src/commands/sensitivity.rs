//! `carpus sensitivity`: which muscle parameters the trials of each condition respond to.

use crate::args::{Global, SensitivityArgs};
use crate::failure::{self, Failure};
use crate::provenance::provenance;
use crate::sensitivity_report;
use crate::study_run::{StudyRun, progress};
use carpus_personalization::sensitivity::MuscleScreening;
use carpus_report::article::{Article, Section};
use carpus_report::render_article;
use carpus_report::results::InputFile;
use carpus_session::screening::{ConditionSensitivity, ScreeningOptions, conditions, refused, screened};

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, a screening of which every run fails, or the output folder.
pub fn run(args: &SensitivityArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study, "sensitivity")?;
    let options = ScreeningOptions {
        starts: args.starts as usize,
        sobol: args.sobol.map(|n| n as usize),
        resamples: args.resamples as usize,
        seed: global.seed,
    };
    let bar = progress(global, study.participants().len() as u64, "screening");
    let mut inputs: Vec<InputFile> = Vec::new();
    let outcomes = study.each(|participant| {
        let run = study.participant(participant)?;
        failure::print(&run.warnings);
        let found: Result<Vec<_>, Failure> =
            conditions(&run)?.into_iter().map(|condition| screened(&run, condition, &options)).collect();
        inputs.extend(run.inputs.iter().filter(|file| !inputs.contains(file)).cloned().collect::<Vec<_>>());
        bar.inc(1);
        found
    });
    bar.finish_and_clear();
    let outcomes = outcomes?;
    let all: Vec<ConditionSensitivity> = outcomes.done.iter().flatten().cloned().collect();
    let report = sensitivity_report::report(&all)?;
    let provenance = provenance(global, inputs);
    let results = serde_json::json!({
        "schema": "carpus.sensitivity/1",
        "provenance": provenance,
        "starts": args.starts,
        "bounds_fraction_of_model": MuscleScreening::parameters(&["MUSCLE"]).map_err(refused)?,
        "conditions": all,
        "anova": report.anova,
    });
    let json = serde_json::to_string_pretty(&results).map_err(|e| Failure::Internal(e.to_string()))?;
    study.out.write("sensitivity.json", json.as_bytes())?;
    for (name, text) in &report.tables {
        study.out.write(name, text.as_bytes())?;
    }
    let article = Article {
        title: "What the trials respond to".to_string(),
        kicker: format!("Sensitivity · {}", study.study.tables.settings.name),
        lead: report.lead.clone(),
        facts: vec![("participants".to_string(), outcomes.done.len().to_string())],
        warnings: report.warnings.clone(),
        sections: vec![Section {
            id: "sensitivity".to_string(),
            title: "Sensitivity".to_string(),
            blocks: report.blocks.clone(),
        }],
        provenance,
    };
    let page = study.out.write("report.html", render_article(&article).as_bytes())?;
    let text = if global.json { results.to_string() } else { format!("{}\n\n{}", report.readable, page.display()) };
    outcomes.print(&study, "sensitivity", &text)
}
