//! Forces from data: OpenSim's `ExternalLoads`.

use std::path::Path;

use nalgebra::Vector3;

use super::error::{ToolError, ToolProblem};
use super::motion::require_finite;
use super::setup::{Properties, Setup};
use super::system::{Actor, System};
use carpus_multibody::forces::AppliedForces;
use carpus_multibody::multibody::{Cache, Model};
use carpus_numerics::spatial::SpatialForce;
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{FrameIndex, FunctionSpec};
use carpus_osim::storage::Storage;

/// A force or torque from data.
#[derive(Clone, Debug)]
pub struct ExternalForce {
    /// Name.
    pub name: String,
    /// Name of the body as the file gives it, for labels.
    pub applied_to_body: String,
    applied_to: FrameIndex,
    force_expressed_in: FrameIndex,
    point_expressed_in: FrameIndex,
    force: Option<[Function; 3]>,
    point: Option<[Function; 3]>,
    torque: Option<[Function; 3]>,
}

fn at(functions: &Option<[Function; 3]>, time: f64) -> Option<Vector3<f64>> {
    functions.as_ref().map(|f| Vector3::new(f[0].value(time), f[1].value(time), f[2].value(time)))
}

impl ExternalForce {
    /// Force, point in ground and torque at a time, force and torque expressed in ground.
    #[allow(non_snake_case)]
    fn in_ground(&self, model: &Model, cache: &Cache, time: f64) -> [Option<Vector3<f64>>; 3] {
        let R = cache.X_GF(model, self.force_expressed_in).R;
        let point = match at(&self.point, time) {
            Some(point) => cache.X_GF(model, self.point_expressed_in) * point,
            None => cache.X_GF(model, self.applied_to).p,
        };
        [at(&self.force, time).map(|f| R * f), Some(point), at(&self.torque, time).map(|t| R * t)]
    }

    /// Adds what it does.
    pub fn apply(&self, model: &Model, cache: &Cache, time: f64, applied: &mut AppliedForces) {
        let base = model.frame(self.applied_to).base;
        let [force, point, torque] = self.in_ground(model, cache, time);
        if let (Some(force), Some(point)) = (force, point) {
            applied.add_at_point(cache, base, &point, &force);
        }
        if let Some(moment) = torque {
            applied.bodies[base.0] += SpatialForce { moment, force: Vector3::zeros() };
        }
    }

    /// Labels of what is reported (`ExternalForce::getRecordLabels`).
    pub fn labels(&self) -> Vec<String> {
        let mut labels = Vec::new();
        let mut add = |kind: &str| {
            ["x", "y", "z"]
                .iter()
                .for_each(|k| labels.push(format!("{}_{}_{kind}{k}", self.applied_to_body, self.name)));
        };
        if self.force.is_some() {
            add("F");
            if self.point.is_some() {
                add("p");
            }
        }
        if self.torque.is_some() {
            add("T");
        }
        labels
    }

    /// Values of what is reported: force in ground, point in the body, torque in ground.
    pub fn record(&self, model: &Model, cache: &Cache, time: f64) -> Vec<f64> {
        let [force, point, torque] = self.in_ground(model, cache, time);
        let mut values = Vec::new();
        if let Some(force) = force {
            values.extend(force.iter());
            if let (Some(_), Some(point)) = (&self.point, point) {
                let local = cache.X_GF(model, self.applied_to).inverse_transform_point(&point);
                values.extend(local.iter());
            }
        }
        if let Some(torque) = torque {
            values.extend(torque.iter());
        }
        values
    }
}

/// Reads a file of external loads and adds them to a system.
///
/// # Errors
/// The file, its data file, or names that the model does not have.
pub fn add_external_loads(path: &Path, system: &mut System) -> Result<Vec<String>, ToolError> {
    let setup = Setup::read(path)?;
    let loads = setup.object();
    if loads.class() != "ExternalLoads" {
        let problem = ToolProblem::NotATool { expected: "ExternalLoads".into(), found: loads.class().into() };
        return Err(ToolError::at(path, loads.line(), problem));
    }
    if !loads.string("external_loads_model_kinematics_file").is_empty() {
        // OpenSim says so and goes on.
    }
    loads.ignore_all(&["lowpass_cutoff_frequency_for_load_kinematics"]);
    let (data, file) = match loads.file("datafile") {
        Some(file) => (Storage::read(&file)?, file),
        None => return Err(loads.missing("datafile", "a .sto or .mot file with the forces")),
    };
    let mut warnings = data.warnings.clone();
    for force in loads.objects("") {
        if force.class() != "ExternalForce" {
            return Err(force.unsupported(force.class(), "expected ExternalForce (format 20301 or later)"));
        }
        if let Some(force) = read_force(&force, (&data, &file), system, &mut warnings)? {
            system.actors.push(Actor::External(Box::new(force)));
        }
    }
    warnings.extend(setup.unread().into_iter().map(|(line, tag, one_more)| {
        let what = if one_more { "stands here again and was not used" } else { "is not known" };
        format!("{}:{line}: <{tag}> {what}", path.display())
    }));
    Ok(warnings)
}

fn read_force(
    force: &Properties,
    (data, file): (&Storage, &Path),
    system: &System,
    warnings: &mut Vec<String>,
) -> Result<Option<ExternalForce>, ToolError> {
    let applies = force.boolean("appliesForce", true)? && !force.boolean("isDisabled", false)?;
    force.ignore_all(&["data_source_name"]);
    let frame = |property: &str| system.frame(&force.string(property));
    let unknown = |property: &str| {
        let name = force.string(property);
        let names = system.spec.bodies.iter().map(|b| b.name.as_str());
        let nearest = carpus_osim::osim::error::nearest(&name, names);
        force.error_at(property, ToolProblem::Unknown { kind: "body", name, nearest })
    };
    let applied_to = frame("applied_to_body").ok_or_else(|| unknown("applied_to_body"))?;
    let mut expressed = |property: &str| {
        if force.text(property).is_none() {
            return FrameIndex(0);
        }
        frame(property).unwrap_or_else(|| {
            let name = force.string(property);
            warnings.push(format!("{}: {property} `{name}` is no body of the model: taken as ground", force.name()));
            FrameIndex(0)
        })
    };
    let force_expressed_in = expressed("force_expressed_in_body");
    let point_expressed_in = expressed("point_expressed_in_body");
    let functions = |property: &str| -> Result<Option<[Function; 3]>, ToolError> {
        let identifier = force.string(property);
        if identifier.is_empty() {
            return Ok(None);
        }
        let columns = data.find_vector(&identifier);
        let Ok(columns) = <[usize; 3]>::try_from(columns.as_slice()) else {
            let what = format!("{} columns of the data begin with \"{identifier}\"", columns.len());
            return Err(force.bad_value(property, "the beginning of the labels of three columns", &what));
        };
        if !applies {
            return Ok(None);
        }
        require_finite(data, &columns, file)?;
        let function = |column: usize| function_of(&data.time, &data.column(column));
        let made = columns.map(function);
        let [x, y, z] = made;
        let wrap =
            |f: Result<Function, _>| f.map_err(|e: carpus_osim::functions::FunctionError| ToolError::new(file, e));
        Ok(Some([wrap(x)?, wrap(y)?, wrap(z)?]))
    };
    let made = ExternalForce {
        name: force.name(),
        applied_to_body: force.string("applied_to_body"),
        applied_to,
        force_expressed_in,
        point_expressed_in,
        force: functions("force_identifier")?,
        point: functions("point_identifier")?,
        torque: functions("torque_identifier")?,
    };
    if applies && made.force.is_none() && made.torque.is_none() {
        return Err(force.missing("force_identifier", "a force_identifier or a torque_identifier"));
    }
    Ok(applies.then_some(made))
}

/// Data over time as `ExternalForce` makes functions of them.
fn function_of(time: &[f64], values: &[f64]) -> Result<Function, carpus_osim::functions::FunctionError> {
    match time.len() {
        0 | 1 => Ok(Function::constant(values.first().copied().unwrap_or(0.0))),
        2 | 3 => Function::compile(&FunctionSpec::PiecewiseLinear { x: time.to_vec(), y: values.to_vec() }),
        _ => carpus_osim::storage::spline(3, time, values),
    }
}
