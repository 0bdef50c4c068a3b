//! Why a tool cannot run.

use std::path::{Path, PathBuf};

use carpus_multibody::dynamics::{ConstraintError, DynamicsError, PlantError};
use carpus_multibody::forces::ForceError;
use carpus_multibody::multibody::CompileError;
use carpus_multibody::muscles::{EquilibriumError, MuscleError};
use carpus_multibody::paths::PathError;
use carpus_osim::functions::FunctionError;
use carpus_osim::osim::{DocumentError, OsimError};
use carpus_osim::storage::StorageError;

/// Why a tool cannot run: where, and what.
#[derive(Debug, thiserror::Error)]
#[error("{}{}: {problem}", .file.display(), if *.line > 0 { format!(":{}", .line) } else { String::new() })]
pub struct ToolError {
    /// The file.
    pub file: PathBuf,
    /// Line, counted from 1; 0: the file as a whole.
    pub line: usize,
    /// What is wrong.
    pub problem: Box<ToolProblem>,
}

/// What is wrong with a setup, or with what it names.
#[derive(Debug, thiserror::Error)]
pub enum ToolProblem {
    /// The setup file is no XML.
    #[error(transparent)]
    Document(#[from] DocumentError),
    /// The setup file cannot be read.
    #[error("cannot be read: {0}")]
    Read(std::io::Error),
    /// Not a setup file of a tool.
    #[error("expected a setup of a tool ({expected}), found <{found}>")]
    NotATool {
        /// Tools that there are.
        expected: String,
        /// Root or its child.
        found: String,
    },
    /// A property whose value cannot be used.
    #[error("{property}: expected {expected}, found \"{found}\"")]
    Value {
        /// Property.
        property: String,
        /// What it has to be.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// A result that would take the place of a file that is read.
    #[error("this is one of the files that are read; it is not overwritten")]
    Overwrites,
    /// A property that has to be given.
    #[error("{property} is missing: expected {expected}")]
    Missing {
        /// Property.
        property: String,
        /// What it has to be.
        expected: String,
    },
    /// Something that this program does not do.
    #[error("{what} is not supported: {instead}")]
    Unsupported {
        /// Class or property.
        what: String,
        /// What that means.
        instead: String,
    },
    /// A name that the model does not have.
    #[error("the model has no {kind} `{name}`")]
    Unknown {
        /// Kind of component.
        kind: &'static str,
        /// Name.
        name: String,
        /// The nearest name there is.
        nearest: Option<String>,
    },
    /// A value in a file of numbers that is none.
    #[error("column `{column}` at t = {time} s: expected a finite number, found {found}")]
    Gap {
        /// Label of the column.
        column: String,
        /// Time of the row [s].
        time: f64,
        /// What stands there.
        found: f64,
    },
    /// A result that is not finite.
    #[error("{owner}: {quantity} is {value} at t = {time} s, at {pose}{cause}")]
    NotFinite {
        /// Muscle or other force.
        owner: String,
        /// What of it.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// The first time [s].
        time: f64,
        /// Coordinates on which it depends.
        pose: String,
        /// Why, where that is known, after a semicolon.
        cause: String,
    },
    /// Data that do not belong to the model.
    #[error("{what}")]
    Data {
        /// What is wrong with the data.
        what: String,
    },
    /// A model cannot be read.
    #[error(transparent)]
    Osim(#[from] OsimError),
    /// A model cannot be compiled.
    #[error(transparent)]
    Compile(#[from] CompileError),
    /// A file of numbers cannot be read.
    #[error(transparent)]
    Storage(#[from] StorageError),
    /// A spline through data cannot be made.
    #[error(transparent)]
    Function(#[from] FunctionError),
    /// A force cannot be built.
    #[error(transparent)]
    Force(#[from] ForceError),
    /// A path cannot be built.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A muscle cannot be built.
    #[error(transparent)]
    Muscle(#[from] MuscleError),
    /// A muscle cannot be balanced.
    #[error(transparent)]
    Equilibrium(#[from] EquilibriumError),
    /// A constraint cannot be built.
    #[error(transparent)]
    Constraint(#[from] ConstraintError),
    /// The equations of motion have no solution.
    #[error("at t = {time} s: {source}")]
    Dynamics {
        /// Time [s].
        time: f64,
        /// Why.
        source: DynamicsError,
    },
    /// A forward simulation that cannot be made.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// A change of the model that cannot be made.
    #[error(transparent)]
    Edit(#[from] carpus_osim::osim::EditError),
    /// Scaling that cannot be made.
    #[error(transparent)]
    Scale(#[from] carpus_osim::osim::ScaleError),
}

impl ToolError {
    /// A problem in a file as a whole.
    pub fn new(file: &Path, problem: impl Into<ToolProblem>) -> ToolError {
        ToolError::at(file, 0, problem)
    }

    /// A problem at a line of a file.
    pub fn at(file: &Path, line: usize, problem: impl Into<ToolProblem>) -> ToolError {
        ToolError { file: file.to_owned(), line, problem: Box::new(problem.into()) }
    }

    /// What to do, where that is known.
    pub fn hint(&self) -> Option<String> {
        match &*self.problem {
            ToolProblem::Unknown { nearest, .. } => nearest.as_ref().map(|name| format!("did you mean `{name}`?")),
            ToolProblem::Storage(error) => error.hint(),
            ToolProblem::Osim(error) => error.hint(),
            ToolProblem::Plant(PlantError::StepLimit { .. }) => Some(
                "a control, a load or a muscle that changes very fast needs many steps; \
                 maximum_number_of_integrator_steps of the setup allows more"
                    .to_owned(),
            ),
            ToolProblem::Gap { .. } => {
                Some("a gap has to be filled, or the rows left out, before it is read here".to_owned())
            }
            ToolProblem::Overwrites => {
                Some("name another results_directory, tool name or output file in the setup".to_owned())
            }
            ToolProblem::Missing { property, .. } if property == "model_file" => {
                Some("name the model with --model MODEL.osim, or in the setup's <model_file>".to_owned())
            }
            _ => None,
        }
    }
}

impl From<StorageError> for ToolError {
    fn from(error: StorageError) -> ToolError {
        ToolError { file: error.file.clone(), line: error.line, problem: Box::new(ToolProblem::Storage(error)) }
    }
}
