//! Resting muscles of models beside ultrasound images.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::account::{csv_text, warning_result};
use super::diagnostic::{Diagnostic, Failure};
use super::model::{self, LoadedModel, Needs};
use super::output::OutputFolder;
use super::progress::{Progress, go_on};
use super::provenance::{DEFAULT_SEED, input_file, made_by};
use super::report_parts::overview;
use carpus_multibody::multibody::Model;
use carpus_osim::osim::spec::ModelSpec;
use carpus_report::article::{TextTable, p_text};
use carpus_report::results::{InputFile, rounded};
use carpus_report::ultrasound::{
    CaseResult, Point, QuantityResult, ULTRASOUND_SCHEMA, UltrasoundResult, render_ultrasound,
};
use carpus_simulation::imaging::{self, Comparison, Pair, Quantity};
use carpus_study::study::Study as Tables;

/// Significant digits of what is written.
const DIGITS: i32 = 8;
/// Stands for the participant's name in paths of model cases.
const PLACE: &str = "{participant}";

/// A named set of models, one per participant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModelCase {
    /// Its name.
    pub name: String,
    /// Path in which `{participant}` stands for the participant's name.
    pub path: String,
}

impl FromStr for ModelCase {
    type Err = String;

    fn from_str(text: &str) -> Result<ModelCase, String> {
        match text.split_once('=') {
            Some((name, path)) if !name.is_empty() && !path.is_empty() => {
                Ok(ModelCase { name: name.to_string(), path: path.to_string() })
            }
            _ => Err("expected NAME=PATH, as in personalized=results/{participant}/model.osim".to_string()),
        }
    }
}

/// A comparison of models with `ultrasound.csv` of a study; ratios and tension stand in `[ultrasound]` of study.toml.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CompareImages {
    /// The study.toml, or the folder it is in.
    pub study: PathBuf,
    /// Models beside those that the study names.
    pub cases: Vec<ModelCase>,
    /// Whether work goes on without components that are not supported.
    pub allow_unsupported: bool,
    /// Written into the results; nothing in it is random.
    pub seed: u64,
    /// Words that results give as what made them; without them the request itself.
    pub command: Option<String>,
}

impl CompareImages {
    /// The models that the study names.
    pub fn new(study: impl Into<PathBuf>) -> CompareImages {
        CompareImages {
            study: study.into(),
            cases: Vec::new(),
            allow_unsupported: false,
            seed: DEFAULT_SEED,
            command: None,
        }
    }

    /// Reads the study.
    ///
    /// # Errors
    /// The study; no images.
    pub fn read(&self) -> Result<Tables, Failure> {
        let study = Tables::read_tables(&self.study)?;
        if study.ultrasound.is_empty() {
            let message = Diagnostic::error("there are no measurements to compare with").in_file(&table_file(&study));
            return Err(message.hint("columns: participant, muscle, posture_deg, muscle_belly_length_m, …").into());
        }
        Ok(study)
    }

    /// The folder for results of the study.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of the study.
    pub fn output_folder(&self, study: &Tables, path: &Path) -> Result<OutputFolder, Failure> {
        OutputFolder::create(path, &study.input_files())?.claimed_for(&study.settings.name, &study.file, "ultrasound")
    }

    /// Compares every model case with the images of all participants.
    ///
    /// - `study`: [`CompareImages::read`]
    ///
    /// # Errors
    /// A model, a posture or a muscle that it does not have; a request to stop.
    pub fn run(&self, study: &Tables, progress: &dyn Progress) -> Result<UltrasoundResult, Failure> {
        let table_file = table_file(study);
        let mut warnings: Vec<Diagnostic> = study.warnings.iter().map(Diagnostic::from).collect();
        let mut inputs = vec![
            input_file(&study.file, &study.file.display().to_string(), "study")?,
            input_file(&table_file, &table_file.display().to_string(), "ultrasound")?,
        ];
        let mut cases = vec![("as given", None)];
        cases.extend(self.cases.iter().map(|c| (c.name.as_str(), Some(c.path.as_str()))));
        let mut results = Vec::new();
        for (name, pattern) in cases {
            go_on(progress)?;
            let pairs = pairs_of(study, pattern, self.allow_unsupported, &mut warnings, &mut inputs)?;
            results.push(case_result(name, &pairs));
        }
        missing_ratios(study, &results, &mut warnings);
        progress.warnings(&warnings);
        let imaging = &study.settings.imaging;
        Ok(UltrasoundResult {
            schema: ULTRASOUND_SCHEMA.to_string(),
            provenance: made_by(self.command.as_deref(), self, self.seed, inputs),
            study: study.settings.name.clone(),
            activation: imaging.activation,
            specific_tension_n_per_cm2: rounded(imaging.specific_tension / 1e4, DIGITS),
            source: imaging.source.clone(),
            cases: results,
            warnings: warnings.iter().map(warning_result).collect(),
        })
    }
}

/// Writes `ultrasound.json`, the tables and the page.
///
/// # Errors
/// The disk.
pub fn write(out: &OutputFolder, result: &UltrasoundResult) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(result).map_err(|e| Failure::Internal(e.to_string()))?;
    out.write(Path::new("ultrasound.json"), (json + "\n").as_bytes())?;
    for (name, text) in tables(&result.cases)? {
        out.write(name, text.as_bytes())?;
    }
    out.write("report.html", render_ultrasound(result).as_bytes())?;
    Ok(())
}

fn table_file(study: &Tables) -> PathBuf {
    study.folder.join("ultrasound.csv")
}

/// All images beside the models of one case.
fn pairs_of(
    study: &Tables,
    pattern: Option<&str>,
    allow_unsupported: bool,
    warnings: &mut Vec<Diagnostic>,
    inputs: &mut Vec<InputFile>,
) -> Result<Vec<Pair>, Failure> {
    let mut pairs = Vec::new();
    for participant in &study.participants {
        if !study.ultrasound.iter().any(|m| m.participant == participant.name) {
            continue;
        }
        let path = match pattern {
            Some(pattern) => PathBuf::from(pattern.replace(PLACE, &participant.name)),
            None => participant.model.clone(),
        };
        let mut found = Vec::new();
        let loaded = model::load(&path, Needs::Trials { passive: false }, allow_unsupported, &mut found)?;
        // The same model serves several participants: what is said of it is said once.
        found.retain(|m| !warnings.contains(m));
        warnings.extend(found);
        check_names(study, &loaded)?;
        let shown = path.display().to_string();
        if !inputs.iter().any(|i| i.path == shown) {
            inputs.push(input_file(&path, &shown, "model")?);
        }
        pairs.extend(pairs_with(study, &participant.name, &loaded.file.spec, &loaded.model)?);
    }
    Ok(pairs)
}

/// All images of a participant beside a model.
///
/// # Errors
/// A posture or a muscle that the model does not have; a muscle that has no equilibrium.
pub fn pairs_with(study: &Tables, participant: &str, spec: &ModelSpec, skeleton: &Model) -> Result<Vec<Pair>, Failure> {
    let mut pairs = Vec::new();
    for image in study.ultrasound.iter().filter(|m| m.participant == participant) {
        let muscle = imaging::at_rest(spec, skeleton, study, image).map_err(|e| {
            let message = Diagnostic::error(format!("{participant} {}: {e}", image.muscle));
            message.in_file(&study.folder.join("ultrasound.csv")).at_line(image.line)
        })?;
        pairs.extend(imaging::pairs(image, &muscle, &study.settings.imaging));
    }
    Ok(pairs)
}

fn check_names(study: &Tables, loaded: &LoadedModel) -> Result<(), Failure> {
    let spec = &loaded.file.spec;
    let coordinates: Vec<&str> = spec.coordinates.iter().map(|c| c.name.as_str()).collect();
    let muscles: Vec<&str> = spec.muscles.iter().map(|m| m.name.as_str()).collect();
    let problems = study.check_names(&loaded.path, &coordinates, &muscles);
    let messages: Vec<Diagnostic> = problems.iter().map(Diagnostic::from).collect();
    if messages.is_empty() { Ok(()) } else { Err(messages.into()) }
}

/// Says once which ratios the study would have to give.
pub fn missing_ratios(study: &Tables, cases: &[CaseResult], warnings: &mut Vec<Diagnostic>) {
    let unconverted = |q: Quantity| {
        let key = key(q);
        cases.iter().flat_map(|c| &c.quantities).any(|r| r.quantity == key && r.unconverted > 0)
    };
    let sources = [
        (Quantity::BellyLength, "fiber_to_belly_length", "Lieber et al. 1990, J Hand Surg 15A:244"),
        (Quantity::TendonLength, "external_to_total_tendon_length", "Loren & Lieber 1995"),
    ];
    for (quantity, name, source) in sources {
        if unconverted(quantity) {
            let text =
                format!("[ultrasound] {name} is not given for every muscle: no limits of agreement for the others");
            let hint = format!("the dissertation took it from {source}: {name} = {{ MUSCLE = fraction, … }}");
            warnings.push(Diagnostic::warning(text).in_file(&study.file).hint(hint));
        }
    }
}

fn key(quantity: Quantity) -> String {
    serde_json::to_value(quantity).ok().and_then(|v| v.as_str().map(String::from)).unwrap_or_default()
}

/// A model case's comparison, rounded for files.
pub fn case_result(name: &str, pairs: &[Pair]) -> CaseResult {
    let quantities = imaging::compare(pairs).iter().map(|c| quantity_result(c, pairs)).collect();
    CaseResult { case: name.to_string(), quantities }
}

fn quantity_result(c: &Comparison, pairs: &[Pair]) -> QuantityResult {
    let round = |v: f64| rounded(v, DIGITS);
    let (measured_unit, measured_scale) = c.quantity.measured_unit();
    let (model_unit, model_scale) = c.quantity.agreement_unit();
    let correlation = c.correlation.as_ref().ok();
    let regression = c.regression.as_ref().ok();
    let agreement = c.agreement.as_ref().and_then(|a| a.as_ref().ok());
    let reasons = [c.correlation.as_ref().err(), c.agreement.as_ref().and_then(|a| a.as_ref().err())];
    QuantityResult {
        quantity: key(c.quantity),
        words: c.quantity.words().to_string(),
        n: c.measurements,
        participants: c.participants,
        r: correlation.map(|r| round(r.r)),
        p: correlation.map(|r| round(r.p_value)),
        slope: regression.map(|l| round(l.slope * model_scale / measured_scale)),
        intercept: regression.map(|l| round(l.intercept * model_scale)),
        measured_unit: measured_unit.to_string(),
        model_unit: model_unit.to_string(),
        bias: agreement.map(|a| round(a.bias * model_scale)),
        limit: agreement.map(|a| round(0.5 * (a.limits[1] - a.limits[0]) * model_scale)),
        unconverted: c.unconverted,
        note: reasons.into_iter().flatten().next().map(ToString::to_string),
        points: pairs
            .iter()
            .filter(|p| p.quantity == c.quantity)
            .map(|p| Point {
                participant: p.participant.clone(),
                muscle: p.muscle.clone(),
                posture_deg: rounded(p.posture.to_degrees(), DIGITS),
                measured: round(p.measured * measured_scale),
                model: round(p.modelled * model_scale),
                converted: p.comparable.map(|pair| pair.map(|v| round(v * model_scale))),
            })
            .collect(),
    }
}

/// Names and texts of the CSV tables.
///
/// # Errors
/// None that input can cause.
pub fn tables(cases: &[CaseResult]) -> Result<[(&'static str, String); 3], Failure> {
    let text = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
    let each = || cases.iter().flat_map(|c| c.quantities.iter().map(move |q| (c, q)));
    let header = [
        "case",
        "quantity",
        "measurements",
        "participants",
        "r",
        "p",
        "slope",
        "intercept",
        "measured_unit",
        "model_unit",
    ];
    let rows = each().map(|(c, q)| {
        let mut row = vec![c.case.clone(), q.quantity.clone(), q.n.to_string(), q.participants.to_string()];
        row.extend([q.r, q.p, q.slope, q.intercept].map(text));
        row.extend([q.measured_unit.clone(), q.model_unit.clone()]);
        row
    });
    let correlations = csv_text(header.iter(), rows)?;
    let header = ["case", "quantity", "unit", "mean_difference", "limit_of_agreement", "without_ratio"];
    let rows = each().map(|(c, q)| {
        let mut row = vec![c.case.clone(), q.quantity.clone(), q.model_unit.clone()];
        row.extend([text(q.bias), text(q.limit), q.unconverted.to_string()]);
        row
    });
    let agreement = csv_text(header.iter(), rows)?;
    let header = [
        "case",
        "quantity",
        "participant",
        "muscle",
        "posture_deg",
        "measured",
        "measured_unit",
        "model",
        "model_unit",
        "model_converted",
        "measured_converted",
    ];
    let rows = each().flat_map(|(c, q)| {
        q.points.iter().map(move |p| {
            let mut row = vec![c.case.clone(), q.quantity.clone(), p.participant.clone(), p.muscle.clone()];
            row.extend([p.posture_deg.to_string(), p.measured.to_string(), q.measured_unit.clone()]);
            row.extend([p.model.to_string(), q.model_unit.clone()]);
            row.extend([0, 1].map(|i| p.converted.map_or(String::new(), |v| v[i].to_string())));
            row
        })
    });
    let measurements = csv_text(header.iter(), rows)?;
    Ok([("correlations.csv", correlations), ("agreement.csv", agreement), ("measurements.csv", measurements)])
}

/// Correlation and agreement of every case and quantity.
pub fn agreement(cases: &[CaseResult]) -> TextTable {
    let rows = cases.iter().flat_map(|c| {
        c.quantities.iter().map(move |q| {
            let agreement = match (q.bias, q.limit) {
                (Some(bias), Some(limit)) => format!("{bias:.2} (±{limit:.2}) {}", q.model_unit),
                _ => "–".to_string(),
            };
            vec![
                c.case.clone(),
                q.words.clone(),
                q.n.to_string(),
                q.r.map_or("–".to_string(), |r| format!("{r:.2}")),
                q.p.map_or("–".to_string(), p_text),
                agreement,
            ]
        })
    });
    overview("", &["case", "model – measurement", "n", "r", "p", "bias (limits)"], 2, rows.collect())
}
