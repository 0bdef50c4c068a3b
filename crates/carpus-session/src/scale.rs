//! Linear scaling of a model, by factors or to the participants of a study.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::Serialize;
use serde_json::{Value, json};

use super::account::{csv_text, warning_result};
use super::diagnostic::{Diagnostic, Failure};
use super::json::{pretty, value};
use super::model::{self, Needs};
use super::output::OutputFolder;
use super::progress::Progress;
use super::provenance::{DEFAULT_SEED, input_file, made_by};
use super::study::{Study, scaling_refused};
use carpus_report::results::{InputFile, Provenance, WarningResult};
use carpus_simulation::scaling::{LinearScaling, ScaleRequest, SegmentFactor, scale, scale_participant};
use carpus_study::study::Participant;

/// A scaling of a model by factors.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleModel {
    /// The model.
    pub model: PathBuf,
    /// Bodies and their factors along x, y, z.
    pub factors: Vec<(String, [f64; 3])>,
    /// Mass of the scaled model [kg]; without it masses grow with volumes.
    pub mass: Option<f64>,
    /// Whether bodies keep their share of the mass.
    pub preserve_mass_distribution: bool,
    /// Whether work goes on without components that are not supported.
    pub allow_unsupported: bool,
    /// Written into the results; nothing in it is random.
    pub seed: u64,
    /// Words that results give as what made them; without them the request itself.
    pub command: Option<String>,
}

/// A body and its scale factors, as typed: `hand=1.05`, `radius=1,1.08,1`.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyFactor {
    /// The body.
    pub body: String,
    /// Factors along x, y, z.
    pub factors: [f64; 3],
}

impl FromStr for BodyFactor {
    type Err = String;

    fn from_str(text: &str) -> Result<BodyFactor, String> {
        let expected = || "expected BODY=FACTOR or BODY=X,Y,Z with positive numbers, e.g. hand=1.05".to_string();
        let (body, numbers) = text.rsplit_once('=').ok_or_else(expected)?;
        let positive = |word: &str| word.trim().parse().ok().filter(|factor: &f64| *factor > 0.0 && factor.is_finite());
        let numbers: Vec<f64> = numbers.split(',').map(positive).collect::<Option<_>>().ok_or_else(expected)?;
        let factors = match numbers[..] {
            [all] => [all; 3],
            [x, y, z] => [x, y, z],
            _ => return Err(expected()),
        };
        if body.is_empty() { Err(expected()) } else { Ok(BodyFactor { body: body.to_string(), factors }) }
    }
}

/// A scaling of the models of a study to its participants, as `[scaling]` says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScaleStudy {
    /// Written into the results; nothing in it is random.
    pub seed: u64,
}

impl Default for ScaleStudy {
    fn default() -> Self {
        ScaleStudy { seed: DEFAULT_SEED }
    }
}

/// Scaled models.
#[derive(Clone, Debug)]
pub struct Scaled {
    /// One for every participant, or one.
    pub models: Vec<ScaledModel>,
    /// What is written as `scale.json`.
    pub value: Value,
    /// Why models could not be scaled to participants.
    pub failed: Vec<Diagnostic>,
}

/// A scaled model.
#[derive(Clone, Debug, Serialize)]
pub struct ScaledModel {
    /// The participant; empty where there is none.
    pub participant: String,
    /// The file, in the folder of the results.
    pub model: String,
    /// Measured lengths.
    pub segments: Vec<Segment>,
    /// Factors of the bodies.
    pub bodies: Vec<Body>,
    /// Mass of the model before.
    pub mass_before_kg: f64,
    /// Mass of the scaled model.
    pub mass_kg: f64,
    /// Lengths of the paths of muscles and forces.
    pub lengths: Vec<Length>,
    /// What a person should know.
    pub warnings: Vec<WarningResult>,
    #[serde(skip)]
    inputs: Vec<InputFile>,
}

/// A measured length.
#[derive(Clone, Debug, Serialize)]
pub struct Segment {
    /// Its name in `[scaling]`.
    pub segment: String,
    /// Of the participant.
    pub participant_m: f64,
    /// In the model.
    pub model_m: f64,
    /// One over the other.
    pub factor: f64,
}

/// The factors of a body.
#[derive(Clone, Debug, Serialize)]
pub struct Body {
    /// Its name.
    pub body: String,
    /// Along x, y, z.
    pub factors: [f64; 3],
}

/// A path's length in the default pose.
#[derive(Clone, Debug, Serialize)]
pub struct Length {
    /// Muscle or force.
    pub name: String,
    /// Before.
    pub before_m: f64,
    /// In the scaled model.
    pub after_m: f64,
    /// One over the other.
    pub ratio: f64,
}

impl ScaleModel {
    /// No factors yet.
    pub fn new(model: impl Into<PathBuf>) -> ScaleModel {
        ScaleModel {
            model: model.into(),
            factors: Vec::new(),
            mass: None,
            preserve_mass_distribution: false,
            allow_unsupported: false,
            seed: DEFAULT_SEED,
            command: None,
        }
    }

    /// Scales the model and writes it with its tables: `model.osim`, `path_lengths.csv`, `scale.json`.
    ///
    /// - `out`: a folder of the results of this command alone
    ///
    /// # Errors
    /// The model, names that it does not have, or the disk.
    pub fn run(&self, out: &OutputFolder, progress: &dyn Progress) -> Result<Scaled, Failure> {
        let mut warnings = Vec::new();
        let loaded = model::load(&self.model, Needs::Motion, self.allow_unsupported, &mut warnings)?;
        let request = ScaleRequest {
            factors: self.factors.clone(),
            preserve_mass_distribution: self.preserve_mass_distribution,
            final_mass: self.mass,
        };
        let mut file = loaded.file.clone();
        let scaling = scale(&mut file, &request).map_err(|e| {
            let message = Diagnostic::error(e.to_string()).in_file(&loaded.path);
            Failure::from(e.hint().into_iter().fold(message, Diagnostic::hint))
        })?;
        warnings.extend(remarks(&scaling, &loaded.path));
        progress.warnings(&warnings);
        out.write("model.osim", file.document.bytes())?;
        let inputs = vec![input_file(&self.model, &self.model.display().to_string(), "model")?];
        let model = outcome("", "model.osim".to_owned(), &[], scaling, &warnings, inputs.clone());
        let provenance = made_by(self.command.as_deref(), self, self.seed, inputs);
        written(out, vec![model], provenance, Vec::new())
    }
}

impl Study {
    /// Scales the model of every participant to the participant's lengths and writes it: `P01/model.osim`, and
    /// `path_lengths.csv` and `scale.json` of all.
    ///
    /// - `out`: [`Study::output_folder`] of `carpus scale`
    ///
    /// # Errors
    /// No participant whose model could be scaled; the disk; a request to stop.
    pub fn scale(&self, request: &ScaleStudy, out: &OutputFolder, progress: &dyn Progress) -> Result<Scaled, Failure> {
        let outcomes = self.each("scaling", progress, |p| scaled(self, p.about(), out, progress))?;
        let mut inputs: Vec<InputFile> = Vec::new();
        for file in outcomes.done.iter().flat_map(|outcome| &outcome.inputs) {
            if !inputs.contains(file) {
                inputs.push(file.clone());
            }
        }
        written(out, outcomes.done, self.provenance(request, request.seed, inputs), outcomes.failed)
    }
}

fn scaled(
    study: &Study,
    participant: &Participant,
    out: &OutputFolder,
    progress: &dyn Progress,
) -> Result<ScaledModel, Failure> {
    let mut warnings: Vec<Diagnostic> = study.tables.warnings.iter().map(Diagnostic::from).collect();
    let loaded = study.load_model(participant, Needs::Motion, &mut warnings)?;
    let mut file = loaded.file.clone();
    let settings = study.tables.settings.scaling.as_ref();
    let scaled = scale_participant(&mut file, settings, participant)
        .map_err(|e| scaling_refused(&e, &study.tables.file, &loaded.path))?;
    if !scaled.unmeasured.is_empty() {
        let text = format!("{}: no length of {}: left as it is", participant.name, scaled.unmeasured.join(", "));
        let table = study.tables.folder.join("participants.csv");
        warnings.push(Diagnostic::warning(text).in_file(&table).at_line(participant.line));
    }
    warnings.extend(remarks(&scaled.scaling, &loaded.path));
    progress.warnings(&warnings);
    let name = Path::new(&participant.name).join("model.osim");
    out.write(&name, file.document.bytes())?;
    let inputs = study.inputs(participant, &loaded.path, &[])?;
    let name = name.display().to_string();
    Ok(outcome(&participant.name, name, &scaled.segments, scaled.scaling, &warnings, inputs))
}

/// What was not scaled, and what is doubtful about the scaling.
fn remarks(scaling: &LinearScaling, model: &Path) -> Vec<Diagnostic> {
    let warning =
        |(path, why): &(String, String)| Diagnostic::warning(format!("{path}: not scaled: {why}")).in_file(model);
    let doubtful = |(what, hint): (String, String)| Diagnostic::warning(what).in_file(model).hint(hint);
    scaling.left.iter().map(warning).chain(scaling.doubts().into_iter().map(doubtful)).collect()
}

fn outcome(
    participant: &str,
    model: String,
    segments: &[SegmentFactor],
    scaling: LinearScaling,
    warnings: &[Diagnostic],
    inputs: Vec<InputFile>,
) -> ScaledModel {
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
    ScaledModel {
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

/// Writes the tables.
fn written(
    out: &OutputFolder,
    models: Vec<ScaledModel>,
    provenance: Provenance,
    failed: Vec<Diagnostic>,
) -> Result<Scaled, Failure> {
    let value = value(&json!({ "schema": "carpus.scale/1", "provenance": provenance, "models": models }))?;
    let header = ["participant", "muscle_or_force", "path_length_before_m", "path_length_m", "ratio"];
    let rows = models.iter().flat_map(|outcome| {
        outcome.lengths.iter().map(|l| {
            let mut row = vec![outcome.participant.clone(), l.name.clone()];
            row.extend([l.before_m, l.after_m, l.ratio].map(|v| v.to_string()));
            row
        })
    });
    out.write("path_lengths.csv", csv_text(header.iter(), rows)?.as_bytes())?;
    out.write("scale.json", pretty(&value)?.as_bytes())?;
    Ok(Scaled { models, value, failed })
}
