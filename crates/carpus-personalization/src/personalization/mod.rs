//! Fitting muscle parameters to recorded trials, and writing them back into the model file.
//!
//! In: training trials and bounds. Out: fitted parameters, what each stage did, and what the trials say of each
//! parameter. Held-out trials are not seen here.
//!
//! [`personalize`] estimates all parameters together, in the statistical model of a session that the diagnosis has, too
//! ([`carpus_diagnosis::inference`]): a parameter that the data say nothing about stays where anatomy put it, and what
//! is handed over predicts left-out trials no worse than the model as given. [`fit_in_two_stages`] is the procedure of
//! the dissertation (chapter 3): first optimal fibre lengths and tendon slack lengths, then maximum isometric forces,
//! each by a global and a local search of the mean objective J (equation 3.4).
//!
//! ```text
//! let fit = personalize(&problem, &|_| (), &|| true)?;
//! write_parameters(&mut file, &fit.fitted)?;        // only the fitted values' lines change
//! ```
//! [`fit_case`] fits the training cases of the dissertation's table 3.1 by its own optimizer and by exact gradients of
//! J.
//!
//! The result depends on the seed, never on the number of threads.

mod bayesian;
mod cases;
mod error;
mod exact;
mod gaussian_process;
mod joint;
mod minimizers;
mod moments;
mod objective;
mod parameters;
mod problem;
mod result;
mod search;
mod two_stage;
mod write;

pub use carpus_diagnosis::inference::muscles::{MuscleEstimate, MuscleProblem};
pub use carpus_diagnosis::inference::resting_fiber::RestingFiber;
pub use carpus_simulation::simulation::Property;

pub use cases::{CaseFit, CaseKind, CaseOptions, CaseProblem, Optimizer, TrainingCase, fit_case};
pub use error::PersonalizationError;
pub use joint::personalize;
pub use objective::mean_objective;
pub use parameters::{BoundHit, FittedParameter};
pub use problem::{FitOptions, FitProblem, TrainingTrial};
pub use result::{Personalization, Progress, Stage};
pub use two_stage::fit_in_two_stages;
pub use write::{WriteBackError, write_parameters};
