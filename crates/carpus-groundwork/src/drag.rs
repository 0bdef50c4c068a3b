//! The machine's own damping from runs at constant velocity without a participant.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::diagnostic::{Diagnostic, Failure};
use super::provenance::{DEFAULT_SEED, input_file, made_by};
use carpus_report::results::rounded;
use carpus_study::dynamometer::{DragError, DragEstimate, MachineRun, estimate_drag};
use carpus_study::study::{AngleUnit, Conversion, Conversions, Recorded, Study, named_file};

/// A question for the machine's own drag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MachineDrag {
    /// Recordings of the machine alone, with columns `time_s`, `angle_deg`, `moment_n_m` and perhaps
    /// `velocity_deg_per_s`; or one study, which names its own.
    pub input: Vec<PathBuf>,
    /// Written into the results; nothing in it is random.
    pub seed: u64,
    /// Words that results give as what made them; without them the request itself.
    pub command: Option<String>,
}

impl Default for MachineDrag {
    fn default() -> Self {
        MachineDrag { input: Vec::new(), seed: DEFAULT_SEED, command: None }
    }
}

/// The machine's own drag.
#[derive(Clone, Debug)]
pub struct FoundDrag {
    /// Drag, friction, and the phases that they rest on.
    pub drag: DragEstimate,
    /// The recordings.
    pub files: Vec<PathBuf>,
    request: MachineDrag,
}

/// A machine's recording, in radians.
struct Run {
    time: Vec<f64>,
    angle: Vec<f64>,
    velocity: Option<Vec<f64>>,
    moment: Vec<f64>,
}

/// Names of columns.
struct Names {
    table: Option<String>,
    time: String,
    angle: String,
    velocity: String,
    moment: String,
    unit: AngleUnit,
    conversions: Conversions,
}

impl MachineDrag {
    /// Estimates the drag.
    ///
    /// # Errors
    /// The files, or runs that do not tell the drag.
    pub fn run(&self) -> Result<FoundDrag, Failure> {
        let (files, names) = files(&self.input)?;
        Ok(FoundDrag { drag: estimated(&files, &names)?, files, request: self.clone() })
    }
}

impl FoundDrag {
    /// What a study.toml says of the drag; `None` where it is negative: the sign of moment or angle is turned.
    pub fn for_study(&self) -> Option<String> {
        let damping = rounded(self.drag.damping * 1f64.to_radians(), 4);
        (!(damping < 0.0)).then(|| format!("[dynamometer]\ndamping_n_m_s_per_deg = {damping}\n"))
    }

    /// The estimate, for programs.
    ///
    /// # Errors
    /// A recording that cannot be read any more.
    pub fn value(&self) -> Result<Value, Failure> {
        let (drag, files) = (&self.drag, &self.files);
        let per_degree = 1f64.to_radians();
        let shown = |file: &PathBuf| input_file(file, &file.display().to_string(), "machine run");
        let inputs = files.iter().map(shown).collect::<Result<Vec<_>, _>>()?;
        let phases: Vec<_> = drag
            .phases
            .iter()
            .map(|p| {
                json!({
                    "file": files[p.run].display().to_string(), "start_s": p.time[0], "end_s": p.time[1],
                    "velocity_deg_per_s": p.velocity.to_degrees(), "mean_moment_n_m": p.moment,
                })
            })
            .collect();
        Ok(json!({
            "schema": "carpus.dynamometer_drag/1",
            "damping_n_m_s_per_deg": drag.damping * per_degree,
            "interval_95_n_m_s_per_deg": drag.interval.map(|v| v * per_degree),
            "friction_n_m": drag.friction.map(|f| f.0),
            "friction_interval_95_n_m": drag.friction.map(|f| f.1),
            "offset_n_m": drag.offset,
            "weight_cos_sin_n_m": drag.weight,
            "residual_n_m": drag.residual,
            "phases": phases,
            "provenance": made_by(self.request.command.as_deref(), &self.request, self.request.seed, inputs),
        }))
    }
}

/// The drag from the recordings that a study names; `None` if it names none.
///
/// # Errors
/// The files, or runs that do not tell the drag.
pub fn of_study(study: &Study) -> Result<Option<DragEstimate>, Failure> {
    let (files, names) = named_by(study);
    if files.is_empty() { Ok(None) } else { estimated(&files, &names).map(Some) }
}

fn estimated(files: &[PathBuf], names: &Names) -> Result<DragEstimate, Failure> {
    let runs = files.iter().map(|file| read(file, names)).collect::<Result<Vec<_>, _>>()?;
    let machine: Vec<MachineRun<'_>> = runs
        .iter()
        .map(|r| MachineRun { time: &r.time, angle: &r.angle, velocity: r.velocity.as_deref(), moment: &r.moment })
        .collect();
    estimate_drag(&machine).map_err(|e| {
        let message = Diagnostic::error(e.to_string());
        Failure::from(match e {
            DragError::OneVelocity { .. } => message.hint("add runs at other velocities, or in the other direction"),
            DragError::Regression(_) => message.hint("at least two phases of constant velocity are needed"),
            _ => message,
        })
    })
}

/// The machine's recordings that a study names, and how their columns are called.
fn named_by(study: &Study) -> (Vec<PathBuf>, Names) {
    let columns = study.settings.columns.clone();
    let files = study.settings.processing.drag_runs.iter().map(|file| named_file(&study.folder, file)).collect();
    let names = Names {
        table: columns.table,
        time: columns.time,
        angle: columns.angle,
        velocity: columns.velocity,
        moment: columns.moment,
        unit: columns.angle_unit,
        conversions: columns.conversions,
    };
    (files, names)
}

fn read(file: &Path, names: &Names) -> Result<Run, Failure> {
    let recorded = Recorded::read(
        file,
        names.table.as_deref(),
        None,
        Some(&names.time),
        &[&names.angle, &names.moment],
        &[&names.velocity],
    )?;
    let column = |name: &str, conversion: Conversion| {
        recorded.column(name).map(|x| x.iter().map(|v| conversion.of(*v)).collect::<Vec<f64>>())
    };
    let conversions = &names.conversions;
    let radians = |x: Vec<f64>| x.into_iter().map(|v| names.unit.to_radians(v)).collect::<Vec<f64>>();
    Ok(Run {
        angle: radians(column(&names.angle, conversions.angle).unwrap_or_default()),
        velocity: column(&names.velocity, conversions.velocity).map(radians),
        moment: column(&names.moment, conversions.moment).unwrap_or_default(),
        time: recorded.time.iter().map(|t| conversions.time.of(*t)).collect(),
    })
}

/// The recordings and how their columns are called.
fn files(input: &[PathBuf]) -> Result<(Vec<PathBuf>, Names), Failure> {
    let is_study = |path: &PathBuf| path.is_dir() || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    if let [only] = input
        && is_study(only)
    {
        let study = Study::read_tables(only)?;
        let (files, names) = named_by(&study);
        if files.is_empty() {
            let message = Diagnostic::error("the study names no recordings of the machine alone").in_file(&study.file);
            return Err(message.hint("[processing] drag_runs = [\"machine/run_1.csv\", …]").into());
        }
        return Ok((files, names));
    }
    let text = String::from;
    let names = Names {
        table: None,
        time: text("time_s"),
        angle: text("angle_deg"),
        velocity: text("velocity_deg_per_s"),
        moment: text("moment_n_m"),
        unit: AngleUnit::Degrees,
        conversions: Conversions::default(),
    };
    Ok((input.to_vec(), names))
}
