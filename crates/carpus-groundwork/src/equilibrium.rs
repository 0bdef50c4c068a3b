//! Fibre and tendon lengths, forces and moments of muscles at rest in a posture.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Value, json};

use super::account::{csv_text, warning_result};
use super::diagnostic::{Diagnostic, Failure};
use super::model::{self, LoadedModel, Needs};
use super::output::OutputFolder;
use super::path_check;
use super::progress::{Progress, go_on};
use super::quantity::Assignment;
use carpus_multibody::muscles::{EquilibriumStatus, MuscleModel};
use carpus_numerics::printable::{number, visible};
use carpus_osim::osim::spec::{CoordinateIndex, MuscleIndex};

/// Activation of every muscle where none is asked for.
pub const DEFAULT_ACTIVATION: f64 = 0.01;

/// A question for muscles at rest in a posture.
#[derive(Clone, Debug, PartialEq)]
pub struct Equilibrium {
    /// The model.
    pub model: PathBuf,
    /// Coordinates that are held; the others are at their defaults.
    pub set: Vec<Assignment>,
    /// Activation of every muscle, 0 to 1.
    pub activation: f64,
    /// Coordinates about which moments are given; none: those of [`Equilibrium::set`].
    pub moment_about: Vec<String>,
    /// The muscles; none: all.
    pub muscles: Vec<String>,
    /// Whether work goes on without components that are not supported.
    pub allow_unsupported: bool,
}

/// Muscles at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct AtRest {
    /// Name of the model.
    pub model: String,
    /// Activation of every muscle.
    pub activation: f64,
    /// The coordinates that are held.
    pub posture: Vec<String>,
    /// The muscles.
    pub muscles: Vec<MuscleAtRest>,
    /// What a person should know.
    pub warnings: Vec<Diagnostic>,
}

/// One muscle at rest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MuscleAtRest {
    /// The muscle.
    pub muscle: String,
    /// Length of its path.
    pub path_length_m: f64,
    /// Length of its fibre.
    pub fiber_length_m: f64,
    /// Over the optimal length.
    pub normalized_fiber_length: f64,
    /// Length of its tendon.
    pub tendon_length_m: f64,
    /// Active force of the fibre.
    pub active_fiber_force_n: f64,
    /// Passive force of the fibre.
    pub passive_fiber_force_n: f64,
    /// Pennation.
    pub pennation_angle_deg: f64,
    /// Force of the tendon.
    pub tendon_force_n: f64,
    /// How well the equilibrium is determined.
    pub status: &'static str,
    /// About the coordinates asked for.
    pub moments: Vec<Moment>,
}

/// What a muscle exerts about a coordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Moment {
    /// The coordinate.
    pub coordinate: String,
    /// Moment arm.
    pub moment_arm_m: f64,
    /// Moment.
    pub moment_n_m: f64,
}

/// A path at the posture.
struct PathLength {
    muscle: MuscleIndex,
    length: f64,
    polyline: f64,
}

impl Equilibrium {
    /// All muscles of a model in its default posture.
    pub fn new(model: impl Into<PathBuf>) -> Equilibrium {
        Equilibrium {
            model: model.into(),
            set: Vec::new(),
            activation: DEFAULT_ACTIVATION,
            moment_about: Vec::new(),
            muscles: Vec::new(),
            allow_unsupported: false,
        }
    }

    /// Balances every muscle.
    ///
    /// # Errors
    /// The model, a coordinate, a muscle; a request to stop.
    pub fn run(&self, progress: &dyn Progress) -> Result<AtRest, Failure> {
        go_on(progress)?;
        let mut messages = Vec::new();
        let loaded = model::load(&self.model, Needs::Motion, self.allow_unsupported, &mut messages)?;
        self.of_loaded(&loaded, messages)
    }

    /// As [`Equilibrium::run`], of a model in memory.
    ///
    /// - `messages`: what was said when it was loaded
    ///
    /// # Errors
    /// A coordinate, a muscle.
    pub fn of_loaded(&self, loaded: &LoadedModel, messages: Vec<Diagnostic>) -> Result<AtRest, Failure> {
        let mut messages = messages;
        let muscles = computed_muscles(loaded, self, &mut messages)?;
        let posture = loaded.posture(&self.set, &mut messages)?;
        let about = coordinates(loaded, self)?;
        if !self.moment_about.is_empty() {
            messages.extend(about.iter().filter_map(|coordinate| loaded.ambiguous(*coordinate)));
        }
        let mut paths = Vec::new();
        let rows = rows(loaded, &muscles, &posture, &about, self.activation, &mut paths)?;
        let set: Vec<String> = self.set.iter().map(ToString::to_string).collect();
        let pose = if set.is_empty() { "the default posture".to_string() } else { set.join(", ") };
        messages.extend(paths.iter().filter_map(|p| match path_check::wound_too_far(p.length, p.polyline) {
            true => Some(path_check::wound_message(loaded, p.muscle, p.length, p.polyline, &pose, None)),
            false => path_check::overstretched(loaded, p.muscle, p.length),
        }));
        Ok(AtRest {
            model: loaded.model.name.clone(),
            activation: self.activation,
            posture: set,
            muscles: rows,
            warnings: messages,
        })
    }

    /// The folder and name of a file for the table, found to be writable.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn target(&self, file: &Path) -> Result<(OutputFolder, String), Failure> {
        let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = file.file_name().and_then(|n| n.to_str());
        let name = name.ok_or_else(|| Diagnostic::error("--csv: expected the name of a file").in_file(file))?;
        let folder = OutputFolder::create(folder, std::slice::from_ref(&self.model))?;
        folder.refuse_input(file)?;
        Ok((folder, name.to_string()))
    }
}

impl AtRest {
    /// For programs.
    pub fn value(&self) -> Value {
        let warnings: Vec<_> = self.warnings.iter().map(warning_result).collect();
        json!({
            "schema": "carpus.equilibrium/1", "model": self.model, "activation": self.activation,
            "posture": self.posture, "muscles": self.muscles, "warnings": warnings,
        })
    }
}

/// The muscles asked for whose force is computed. Others are errors, or warnings if allowed.
fn computed_muscles(
    loaded: &LoadedModel,
    request: &Equilibrium,
    messages: &mut Vec<Diagnostic>,
) -> Result<Vec<MuscleIndex>, Failure> {
    let mut computed = Vec::new();
    let mut others = Vec::new();
    for index in loaded.muscles(&request.muscles)? {
        let muscle = &loaded.file.spec.muscles[index.0];
        if muscle.is_computed() {
            computed.push(index);
            continue;
        }
        let text = format!("{}: the force of a {} is not computed", muscle.at.path, muscle.class());
        let message = if request.allow_unsupported { Diagnostic::warning(text) } else { Diagnostic::error(text) };
        let message = message.in_file(&loaded.path).at_line(muscle.at.line);
        others.push(message.hint("--allow-unsupported leaves such muscles out; --muscles picks some"));
    }
    if request.allow_unsupported {
        messages.append(&mut others);
    }
    if others.is_empty() { Ok(computed) } else { Err(others.into()) }
}

/// The coordinates about which moments are given.
fn coordinates(loaded: &LoadedModel, request: &Equilibrium) -> Result<Vec<CoordinateIndex>, Failure> {
    if !request.moment_about.is_empty() {
        return request.moment_about.iter().map(|name| loaded.coordinate(name)).collect();
    }
    request.set.iter().map(|a| loaded.coordinate(&a.coordinate)).collect()
}

fn rows(
    loaded: &LoadedModel,
    muscles: &[MuscleIndex],
    posture: &[f64],
    about: &[CoordinateIndex],
    activation: f64,
    lengths: &mut Vec<PathLength>,
) -> Result<Vec<MuscleAtRest>, Failure> {
    let model = &loaded.model;
    let mut cache = model.new_cache();
    model.update_positions(posture, &mut cache);
    let mut paths = loaded.muscle_paths(muscles)?;
    let mut rows = Vec::with_capacity(muscles.len());
    for (index, (path, geometry)) in muscles.iter().zip(&mut paths) {
        path.update(posture, &cache, geometry);
        let (length, polyline) = (geometry.length(), path.polyline_length(posture, &cache));
        lengths.push(PathLength { muscle: *index, length, polyline });
        rows.push(at_rest(loaded, *index, length, activation)?);
    }
    for coordinate in about {
        model.update_unit_motion(posture, *coordinate, &mut cache);
        for ((path, geometry), row) in paths.iter().zip(&mut rows) {
            let moment_arm_m = path.moment_arm(posture, &cache, geometry);
            row.moments.push(Moment {
                coordinate: model.coordinates[coordinate.0].name.clone(),
                moment_arm_m,
                moment_n_m: moment_arm_m * row.tendon_force_n,
            });
        }
    }
    Ok(rows)
}

/// A muscle at rest, without its moments.
fn at_rest(
    loaded: &LoadedModel,
    index: MuscleIndex,
    path_length: f64,
    activation: f64,
) -> Result<MuscleAtRest, Failure> {
    let spec = &loaded.file.spec.muscles[index.0];
    let unusable = |text: String| Diagnostic::error(text).in_file(&loaded.path).at_line(spec.at.line);
    let muscle = MuscleModel::from_spec(spec).map_err(|e| unusable(e.to_string()))?;
    let (state, status) = muscle.at_rest(path_length, activation).map_err(|e| unusable(e.to_string()))?;
    let numbers = [state.fiber_length, state.tendon_length, state.active_fiber_force, state.passive_fiber_force];
    if !numbers.iter().chain([&state.pennation_angle, &state.tendon_force]).all(|v| v.is_finite()) {
        let path_length = number(path_length);
        let text = format!("{}: forces at a path of {path_length} m are not finite: a property is absurd", spec.name);
        return Err(unusable(text).into());
    }
    let acts = if spec.applies_force { 1.0 } else { 0.0 };
    Ok(MuscleAtRest {
        muscle: visible(&spec.name).into_owned(),
        path_length_m: path_length,
        fiber_length_m: state.fiber_length,
        normalized_fiber_length: state.normalized_fiber_length,
        tendon_length_m: state.tendon_length,
        active_fiber_force_n: acts * state.active_fiber_force,
        passive_fiber_force_n: acts * state.passive_fiber_force,
        pennation_angle_deg: state.pennation_angle.to_degrees(),
        tendon_force_n: acts * state.tendon_force,
        status: match status {
            _ if !spec.applies_force => "applies_no_force",
            EquilibriumStatus::Converged => "converged",
            EquilibriumStatus::WeaklyDetermined => "weakly_determined",
            EquilibriumStatus::FiberAtLowerBound => "fiber_at_lower_bound",
            EquilibriumStatus::RigidTendon => "rigid_tendon",
        },
        moments: Vec::new(),
    })
}

/// The muscles as CSV.
///
/// # Errors
/// None that input can cause.
pub fn csv(rows: &[MuscleAtRest]) -> Result<String, Failure> {
    let mut header: Vec<String> = [
        "muscle",
        "path_length_m",
        "fiber_length_m",
        "normalized_fiber_length",
        "tendon_length_m",
        "active_fiber_force_n",
        "passive_fiber_force_n",
        "pennation_angle_deg",
        "tendon_force_n",
        "status",
    ]
    .map(String::from)
    .to_vec();
    if let Some(first) = rows.first() {
        let names = first.moments.iter().map(|m| &m.coordinate);
        header.extend(names.flat_map(|n| [format!("{n}_moment_arm_m"), format!("{n}_moment_n_m")]));
    }
    let cells = rows.iter().map(|r| {
        let numbers = [
            r.path_length_m,
            r.fiber_length_m,
            r.normalized_fiber_length,
            r.tendon_length_m,
            r.active_fiber_force_n,
            r.passive_fiber_force_n,
            r.pennation_angle_deg,
            r.tendon_force_n,
        ];
        let mut cells = vec![r.muscle.clone()];
        cells.extend(numbers.map(|v| format!("{v:.9}")));
        cells.push(r.status.to_string());
        cells.extend(r.moments.iter().flat_map(|m| [m.moment_arm_m, m.moment_n_m]).map(|v| format!("{v:.9}")));
        cells
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    csv_text(header.iter(), cells)
}
