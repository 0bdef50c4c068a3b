//! `carpus scale`: linear scaling of a model, by factors or to the participants of a study.

use std::path::Path;

use crate::args::{Global, ScaleArgs, StudyArgs, StudyInput};
use crate::bars::Bars;
use crate::failure::{self, Diagnostic, Failure};
use crate::provenance::command_line;
use crate::stdout::print_result;
use crate::study_run::StudyRun;
use crate::table::{fixed, table};
use carpus_session::output::OutputFolder;
use carpus_session::scale::{ScaleModel, ScaleStudy, Scaled, ScaledModel};

/// Runs the command.
///
/// # Errors
/// The model or the study, names that the model does not have, or the output folder.
pub fn run(args: &ScaleArgs, global: &Global) -> Result<(), Failure> {
    let is_model = args.input.extension().is_some_and(|e| e.eq_ignore_ascii_case("osim"));
    if is_model { scale_model(args, global) } else { scale_study(args, global) }
}

fn scale_model(args: &ScaleArgs, global: &Global) -> Result<(), Failure> {
    if !args.participant.is_empty() || args.model.is_some() {
        let text = "--participant and --model go with a study; a model is scaled by --factor";
        return Err(Diagnostic::error(text).hint("carpus scale STUDY/study.toml --participant P01 --out DIR").into());
    }
    if args.factor.is_empty() && args.mass.is_none() {
        let text = "nothing to scale by";
        return Err(Diagnostic::error(text).hint("--factor BODY=FACTOR, or --mass KG").into());
    }
    let out = OutputFolder::create(&args.out, std::slice::from_ref(&args.input))?.only_of("scale")?;
    let out = out.with_results_of(&args.input);
    let request = ScaleModel {
        factors: args.factor.iter().map(|f| (f.body.clone(), f.factors)).collect(),
        mass: args.mass,
        preserve_mass_distribution: args.preserve_mass_distribution,
        allow_unsupported: args.allow_unsupported,
        seed: global.seed,
        command: Some(command_line()),
        ..ScaleModel::new(&args.input)
    };
    let scaled = request.run(&out, &Bars::new(global))?;
    failure::print(&out.close("scale", &[])?);
    print_result(&text(&scaled, out.path(), global))
}

fn scale_study(args: &ScaleArgs, global: &Global) -> Result<(), Failure> {
    if !args.factor.is_empty() || args.mass.is_some() || args.preserve_mass_distribution {
        let text = "--factor, --mass and --preserve-mass-distribution go with a model; a study says it in [scaling]";
        return Err(Diagnostic::error(text).into());
    }
    let input =
        StudyInput { study: args.input.clone(), participant: args.participant.clone(), model: args.model.clone() };
    let study = StudyArgs { input, out: args.out.clone(), allow_unsupported: args.allow_unsupported };
    let study = StudyRun::prepare(&study, "scale")?;
    let scaled = study.study.scale(&ScaleStudy { seed: global.seed }, &study.out, &Bars::new(global))?;
    let text = text(&scaled, study.out.path(), global);
    study.print("scale", &text, scaled.failed)
}

fn text(scaled: &Scaled, folder: &Path, global: &Global) -> String {
    if global.json { scaled.value.to_string() } else { readable(&scaled.models, folder) }
}

fn readable(outcomes: &[ScaledModel], folder: &Path) -> String {
    let header = ["participant", "body", "x", "y", "z"];
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.bodies.iter().map(move |b| {
            let mut row = vec![outcome.participant.clone(), b.body.clone()];
            row.extend(b.factors.map(|f| fixed(f, 4)));
            row
        })
    });
    let mut text = table(&header, 2, rows);
    text.push_str("\n\n");
    for outcome in outcomes {
        let ratios = outcome.lengths.iter().map(|l| l.ratio);
        let (low, high) = ratios.fold((f64::INFINITY, 0.0), |(low, high), r| (f64::min(low, r), f64::max(high, r)));
        let mass = format!("mass {} → {} kg", fixed(outcome.mass_before_kg, 3), fixed(outcome.mass_kg, 3));
        let lengths = match outcome.lengths.is_empty() {
            true => String::new(),
            false => format!(", lengths of muscles × {low:.3} to {high:.3}"),
        };
        text.push_str(&format!("{}: {mass}{lengths}\n", folder.join(&outcome.model).display()));
    }
    text
}
