//! `carpus scale`: linear scaling of a model, by factors or to the participants of a study.

use std::path::Path;

use serde::Serialize;

use crate::args::{Global, ScaleArgs, StudyArgs};
use crate::failure::{self, Diagnostic, Failure};
use crate::print_result;
use crate::provenance::provenance;
use crate::study_run::StudyRun;
use crate::table::{fixed, table};
use carpus_report::results::{InputFile, WarningResult};
use carpus_session::account::{csv_text, warning_result};
use carpus_session::model::{self, Needs};
use carpus_session::output::OutputFolder;
use carpus_session::provenance::input_file;
use carpus_session::study::scaling_refused;
use carpus_simulation::scaling::{LinearScaling, ScaleRequest, SegmentFactor, scale, scale_participant};
use carpus_study::study::Participant;

/// A scaled model.
#[derive(Serialize)]
struct Outcome {
    participant: String,
    model: String,
    segments: Vec<Segment>,
    bodies: Vec<Body>,
    mass_before_kg: f64,
    mass_kg: f64,
    lengths: Vec<Length>,
    warnings: Vec<WarningResult>,
    #[serde(skip)]
    inputs: Vec<InputFile>,
}

#[derive(Serialize)]
struct Segment {
    segment: String,
    participant_m: f64,
    model_m: f64,
    factor: f64,
}

#[derive(Serialize)]
struct Body {
    body: String,
    factors: [f64; 3],
}

#[derive(Serialize)]
struct Length {
    name: String,
    before_m: f64,
    after_m: f64,
    ratio: f64,
}

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
    let mut warnings = Vec::new();
    let loaded = model::load(&args.input, Needs::Motion, args.allow_unsupported, &mut warnings)?;
    let request = ScaleRequest {
        factors: args.factor.iter().map(|f| (f.body.clone(), f.factors)).collect(),
        preserve_mass_distribution: args.preserve_mass_distribution,
        final_mass: args.mass,
    };
    let mut file = loaded.file.clone();
    let scaling = scale(&mut file, &request).map_err(|e| {
        let hint = e.hint();
        Failure::from(hint.into_iter().fold(Diagnostic::error(e.to_string()).in_file(&loaded.path), Diagnostic::hint))
    })?;
    warnings.extend(left(&scaling, &loaded.path));
    failure::print(&warnings);
    out.write("model.osim", file.document.bytes())?;
    let shown = args.input.display().to_string();
    let inputs = vec![input_file(&args.input, &shown, "model")?];
    let outcome = outcome("", "model.osim".to_owned(), &[], scaling, &warnings, inputs);
    let text = finish(&out, std::slice::from_ref(&outcome), global)?;
    failure::print(&out.close("scale", &[])?);
    print_result(&text)
}

fn scale_study(args: &ScaleArgs, global: &Global) -> Result<(), Failure> {
    if !args.factor.is_empty() || args.mass.is_some() || args.preserve_mass_distribution {
        let text = "--factor, --mass and --preserve-mass-distribution go with a model; a study says it in [scaling]";
        return Err(Diagnostic::error(text).into());
    }
    let study = StudyArgs {
        study: args.input.clone(),
        participant: args.participant.clone(),
        model: args.model.clone(),
        out: args.out.clone(),
        allow_unsupported: args.allow_unsupported,
    };
    let study = StudyRun::prepare(&study, "scale")?;
    let outcomes = study.each(|participant| scaled(&study, participant))?;
    let text = finish(&study.out, &outcomes.done, global)?;
    outcomes.print(&study, "scale", &text)
}

fn scaled(study: &StudyRun, participant: &Participant) -> Result<Outcome, Failure> {
    let mut warnings: Vec<Diagnostic> = study.study.tables.warnings.iter().map(Diagnostic::from).collect();
    let loaded = study.study.load_model(participant, Needs::Motion, &mut warnings)?;
    let mut file = loaded.file.clone();
    let settings = study.study.tables.settings.scaling.as_ref();
    let scaled = scale_participant(&mut file, settings, participant)
        .map_err(|e| scaling_refused(&e, &study.study.tables.file, &loaded.path))?;
    if !scaled.unmeasured.is_empty() {
        let text = format!("{}: no length of {}: left as it is", participant.name, scaled.unmeasured.join(", "));
        let table = study.study.tables.folder.join("participants.csv");
        warnings.push(Diagnostic::warning(text).in_file(&table).at_line(participant.line));
    }
    warnings.extend(left(&scaled.scaling, &loaded.path));
    failure::print(&warnings);
    let name = Path::new(&participant.name).join("model.osim");
    study.out.write(&name, file.document.bytes())?;
    let inputs = study.study.inputs(participant, &loaded.path, &[])?;
    let name = name.display().to_string();
    Ok(outcome(&participant.name, name, &scaled.segments, scaled.scaling, &warnings, inputs))
}

fn left(scaling: &LinearScaling, model: &Path) -> Vec<Diagnostic> {
    let warning =
        |(path, why): &(String, String)| Diagnostic::warning(format!("{path}: not scaled: {why}")).in_file(model);
    scaling.left.iter().map(warning).collect()
}

fn outcome(
    participant: &str,
    model: String,
    segments: &[SegmentFactor],
    scaling: LinearScaling,
    warnings: &[Diagnostic],
    inputs: Vec<InputFile>,
) -> Outcome {
    let length = |l: &carpus_simulation::scaling::ScaledLength| Length {
        name: l.name.clone(),
        before_m: l.before,
        after_m: l.after,
        ratio: l.ratio(),
    };
    let segment = |s: &SegmentFactor| Segment {
        segment: s.segment.clone(),
        participant_m: s.participant,
        model_m: s.model,
        factor: s.factor,
    };
    Outcome {
        participant: participant.to_owned(),
        model,
        segments: segments.iter().map(segment).collect(),
        mass_before_kg: scaling.mass[0],
        mass_kg: scaling.mass[1],
        lengths: scaling.lengths.iter().map(length).collect(),
        bodies: scaling.factors.into_iter().map(|(body, factors)| Body { body, factors }).collect(),
        warnings: warnings.iter().map(warning_result).collect(),
        inputs,
    }
}

/// Writes the tables; what to print.
fn finish(out: &OutputFolder, outcomes: &[Outcome], global: &Global) -> Result<String, Failure> {
    let mut inputs: Vec<InputFile> = Vec::new();
    for file in outcomes.iter().flat_map(|outcome| &outcome.inputs) {
        if !inputs.contains(file) {
            inputs.push(file.clone());
        }
    }
    let results = serde_json::json!({
        "schema": "carpus.scale/1",
        "provenance": provenance(global, inputs),
        "models": outcomes,
    });
    let json = serde_json::to_string_pretty(&results).map_err(|e| Failure::Internal(e.to_string()))?;
    let header = ["participant", "muscle_or_force", "path_length_before_m", "path_length_m", "ratio"];
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.lengths.iter().map(|l| {
            let mut row = vec![outcome.participant.clone(), l.name.clone()];
            row.extend([l.before_m, l.after_m, l.ratio].map(|v| v.to_string()));
            row
        })
    });
    out.write("path_lengths.csv", csv_text(header.iter(), rows)?.as_bytes())?;
    out.write("scale.json", json.as_bytes())?;
    if global.json {
        return Ok(results.to_string());
    }
    Ok(readable(outcomes, out.path()))
}

fn readable(outcomes: &[Outcome], folder: &Path) -> String {
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
