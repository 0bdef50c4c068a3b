//! Forces from data: OpenSim's `ExternalLoads`.

use std::path::Path;

use super::error::{ToolError, ToolProblem};
use super::external_force::ExternalForce;
use super::finite_columns::require_finite;
use super::setup::{Properties, Setup};
use super::system::{Actor, System};
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{FrameIndex, FunctionSpec};
use carpus_osim::storage::Storage;

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
