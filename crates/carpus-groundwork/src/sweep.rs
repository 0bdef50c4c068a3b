//! Muscle lengths and moment arms of a model over a coordinate.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::account::{csv_text, warning_result};
use super::diagnostic::{Diagnostic, Failure};
use super::model::{self, Needs};
use super::output::OutputFolder;
use super::path_check;
use super::progress::{Progress, go_on};
use super::provenance::{DEFAULT_SEED, input_file, made_by};
use super::quantity::{Assignment, Sweep};
use carpus_osim::osim::spec::MotionType;
use carpus_report::sweep::{SweepFigure, SweepMuscle};

/// A sweep of a coordinate of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepPaths {
    /// The model.
    pub model: PathBuf,
    /// The coordinate that moves, and its values.
    pub sweep: Sweep,
    /// Coordinates that are held.
    pub set: Vec<Assignment>,
    /// The muscles; none: all.
    pub muscles: Vec<String>,
    /// Whether work goes on without components that are not supported.
    pub allow_unsupported: bool,
    /// Written into the results; nothing in it is random.
    pub seed: u64,
    /// Words that results give as what made them; without them the request itself.
    pub command: Option<String>,
}

/// Lengths and moment arms.
#[derive(Clone, Debug)]
pub struct SweptPaths {
    /// Lengths [m] and moment arms of every muscle at every value.
    pub figure: SweepFigure,
    /// What a person should know.
    pub warnings: Vec<Diagnostic>,
}

impl SweepPaths {
    /// All muscles, all other coordinates at their defaults.
    pub fn new(model: impl Into<PathBuf>, sweep: Sweep) -> SweepPaths {
        SweepPaths {
            model: model.into(),
            sweep,
            set: Vec::new(),
            muscles: Vec::new(),
            allow_unsupported: false,
            seed: DEFAULT_SEED,
            command: None,
        }
    }

    /// Computes the lengths and the moment arms.
    ///
    /// # Errors
    /// The model, a coordinate, a muscle; a request to stop.
    pub fn run(&self, progress: &dyn Progress) -> Result<SweptPaths, Failure> {
        go_on(progress)?;
        let path = &self.model;
        let mut messages = Vec::new();
        let loaded = model::load(path, Needs::Motion, self.allow_unsupported, &mut messages)?;
        let moved = loaded.check_settable(&self.sweep.coordinate, self.sweep.first())?;
        messages.extend(loaded.ambiguous(moved));
        let muscles = loaded.muscles(&self.muscles)?;
        let posture = loaded.posture(&self.set, &mut messages)?;
        let values = self.sweep.values();
        for end in [values.first(), values.last()].into_iter().flatten() {
            if !loaded.model.coordinates[moved.0].in_range(self.sweep.si(*end)) {
                messages.push(loaded.outside_range(moved, self.sweep.si(*end)));
            }
        }
        let si: Vec<f64> = values.iter().map(|v| self.sweep.si(*v)).collect();
        let translation = loaded.model.coordinates[moved.0].motion_type == MotionType::Translational;
        let samples = path_check::samples(&loaded, &muscles, moved, &posture, &si)?;
        messages.extend(muscles.iter().zip(&samples).flat_map(|(m, s)| path_check::swept(&loaded, *m, moved, s)));
        let swept = muscles.iter().zip(&samples).map(|(m, samples)| SweepMuscle {
            name: loaded.file.spec.muscles[m.0].name.clone(),
            length_m: samples.iter().map(|s| s.length).collect(),
            moment_arm_m: samples.iter().map(|s| s.moment_arm).collect(),
        });
        let figure = SweepFigure {
            model: loaded.model.name.clone(),
            coordinate: self.sweep.coordinate.clone(),
            unit: if translation { "m" } else { "deg" },
            values: if translation { si.clone() } else { si.iter().map(|v| v.to_degrees()).collect() },
            held: self.set.iter().map(ToString::to_string).collect(),
            muscles: swept.collect(),
            warnings: messages.iter().map(warning_result).collect(),
            provenance: made_by(
                self.command.as_deref(),
                self,
                self.seed,
                vec![input_file(path, &path.display().to_string(), "model")?],
            ),
        };
        Ok(SweptPaths { figure, warnings: messages })
    }

    /// A folder of the results of sweeps alone.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds something else.
    pub fn output_folder(&self, path: &Path) -> Result<OutputFolder, Failure> {
        Ok(OutputFolder::create(path, std::slice::from_ref(&self.model))?
            .only_of("paths")?
            .with_results_of(&self.model))
    }
}

impl SweptPaths {
    /// Writes `paths.csv` and `paths.html`, whose paths come back.
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder) -> Result<[PathBuf; 2], Failure> {
        let table = out.write("paths.csv", csv(&self.figure)?.as_bytes())?;
        let page = out.write("paths.html", carpus_report::render_sweep(&self.figure).as_bytes())?;
        Ok([table, page])
    }
}

/// One row per value: the coordinate, all lengths, all moment arms.
///
/// # Errors
/// None that input can cause.
pub fn csv(figure: &SweepFigure) -> Result<String, Failure> {
    let names = figure.muscles.iter().map(|m| &m.name);
    // About a translation the moment arm has no unit.
    let arm = if figure.unit == "deg" { "moment_arm_m" } else { "moment_arm" };
    let header: Vec<String> = std::iter::once(format!("{}_{}", figure.coordinate, figure.unit))
        .chain(names.clone().map(|n| format!("{n}_length_m")))
        .chain(names.map(|n| format!("{n}_{arm}")))
        .collect();
    let rows = figure.values.iter().enumerate().map(|(i, value)| {
        let lengths = figure.muscles.iter().map(|m| m.length_m[i]);
        let arms = figure.muscles.iter().map(|m| m.moment_arm_m[i]);
        let numbers = lengths.chain(arms).map(|v| format!("{v:.9}"));
        std::iter::once(carpus_report::results::rounded(*value, 12).to_string()).chain(numbers).collect()
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    csv_text(header.iter(), rows)
}

/// The sweep, for programs.
pub fn value(figure: &SweepFigure) -> Value {
    let muscles: Vec<_> = figure
        .muscles
        .iter()
        .map(|m| json!({ "name": m.name, "length_m": m.length_m, "moment_arm_m": m.moment_arm_m }))
        .collect();
    let key = format!("values_{}", figure.unit);
    json!({
        "schema": "carpus.paths/1",
        "model": figure.model,
        "coordinate": figure.coordinate,
        key: figure.values,
        "held": figure.held,
        "muscles": muscles,
        "warnings": figure.warnings,
        "provenance": figure.provenance,
    })
}
