//! OpenSim's tools, run from OpenSim's own setup files: same files, headers, columns and units.
//!
//! In: a setup file and what it names. Out: an [`Outcome`]: files to be written, warnings, a summary. Nothing is
//! written or printed here. Each tool is one file; all evaluate a [`System`], a model with everything that acts in it.

mod analysis;
mod analyze;
mod controls;
mod correction;
mod correction_setup;
mod error;
mod external_force;
mod external_loads;
mod finite_columns;
mod force_analyses;
mod force_sets;
mod forward;
mod ik_solver;
mod inputs;
mod inverse_dynamics;
mod inverse_kinematics;
mod kinematics;
mod motion;
mod muscle_analysis;
mod result;
mod scale;
mod setup;
mod static_optimization;
mod system;
mod upgrade;

use std::path::Path;

pub use error::{ToolError, ToolProblem};
pub use ik_solver::{CoordinateGoal, InverseKinematics, MarkerGoal};
pub use motion::Motion;
pub use result::{Outcome, ResultFile};
pub use system::{Actor, Evaluation, System, SystemMuscle, SystemState, SystemWork};

use carpus_osim::osim::OsimFile;
use setup::{Properties, Setup};

/// Tools that are run.
const TOOLS: [&str; 5] = ["AnalyzeTool", "ForwardTool", "InverseDynamicsTool", "InverseKinematicsTool", "ScaleTool"];

/// Runs the tool of a setup file.
///
/// - `model`: model to use instead of the one that the setup names
/// - `allow_unsupported`: leave out forces that are not computed, instead of refusing them
///
/// # Errors
/// The setup, the files that it names, what it asks for, or a result that would take the place of a file that is read.
pub fn run_tool(setup: &Path, model: Option<&Path>, allow_unsupported: bool) -> Result<Outcome, ToolError> {
    let setup = Setup::read(setup)?;
    let tool = setup.object();
    let mut outcome = Outcome::default();
    let system_of = |outcome: &mut Outcome, takes_forces: bool| {
        let (path, file) = model_of(&tool, model, outcome)?;
        let mut system = match takes_forces {
            true => force_sets::system_with(&tool, &path, &file, outcome)?,
            false => System::of_spec(&path, file.spec)?,
        };
        system.allow_unsupported = allow_unsupported;
        if allow_unsupported {
            let left_out = system.forces_not_computed(&|_| false);
            if !left_out.is_empty() {
                outcome.warn(&path, 0, format!("forces that are not computed are left out: {}", left_out.join(", ")));
            }
        }
        let has_accelerations = !matches!(tool.class(), "InverseKinematicsTool" | "IKTool");
        let joints = system.model.contradictory_joints().map(|joint| &system.spec.joints[joint.0]);
        for joint in joints.filter(|_| has_accelerations) {
            let text = format!(
                "{}: one coordinate turns several axes; accelerations are OpenSim's, which contradict its velocities \
                 there by a term in the square of the speed",
                joint.name
            );
            outcome.warn(&path, joint.at.line, text);
        }
        Ok::<_, ToolError>((system, file.document))
    };
    match tool.class() {
        "AnalyzeTool" => {
            let (system, document) = system_of(&mut outcome, true)?;
            analyze::run(&tool, system, document, &mut outcome)?;
        }
        "ForwardTool" => {
            let (system, document) = system_of(&mut outcome, true)?;
            forward::run(&tool, system, document, &mut outcome)?;
        }
        "ScaleTool" => {
            let maker = tool.child("GenericModelMaker").unwrap_or(tool);
            let (path, file) = model_of(&maker, model, &mut outcome)?;
            scale::run(&tool, path, file, &mut outcome)?;
        }
        "InverseDynamicsTool" => {
            let (system, document) = system_of(&mut outcome, false)?;
            inverse_dynamics::run(&tool, system, document, &mut outcome)?;
        }
        "InverseKinematicsTool" | "IKTool" => {
            inverse_kinematics::run(&tool, system_of(&mut outcome, false)?.0, &mut outcome)?;
        }
        other => {
            let problem = ToolProblem::NotATool { expected: TOOLS.join(", "), found: other.to_owned() };
            return Err(ToolError::at(setup.path(), tool.line(), problem));
        }
    }
    for (line, tag, one_more) in setup.unread() {
        let text = if one_more {
            format!("<{tag}> stands here again and was not used: the first counts, as in OpenSim")
        } else {
            format!("<{tag}> is no property of {} and was not used", tool.class())
        };
        outcome.warn(setup.path(), line, text);
    }
    inputs::refuse_to_overwrite(setup.path(), model, &mut outcome)?;
    Ok(outcome)
}

/// The model that a setup names, or another one.
fn model_of(
    tool: &Properties,
    model: Option<&Path>,
    outcome: &mut Outcome,
) -> Result<(std::path::PathBuf, OsimFile), ToolError> {
    let named = tool.file("model_file");
    let path = match (model, named) {
        (Some(model), _) => model.to_owned(),
        (None, Some(named)) => named,
        (None, None) => return Err(tool.missing("model_file", "a model (.osim)")),
    };
    let mut file = OsimFile::read(&path).map_err(|e| ToolError::new(&path, e))?;
    if let Some((setup, owner)) = tool.setup().with_defaults() {
        match file.with_defaults_of(setup, owner) {
            Ok(with) => file = with,
            Err(error) => {
                let text = format!("<defaults> do not hold for the model, which could not be read with them: {error}");
                outcome.warn(tool.setup().path(), setup.line(owner), text);
            }
        }
    }
    outcome.warn_of_diagnostics(&path, &file.diagnostics);
    Ok((path, file))
}
