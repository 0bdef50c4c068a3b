//! Global sensitivity: which parameters move a model's response, and through which interactions.
//!
//! In: parameters with bounds and a response, any function of their values that may fail. Out: indices with intervals,
//! and an account of the runs that failed. Runs are spread over threads; results depend on the seed alone.
//!
//! | question | method | runs |
//! |---|---|---|
//! | which parameters matter at all? | [`MorrisSample`]: μ, μ*, σ of elementary effects | r (m + 1) |
//! | what share of variance is theirs, alone and with others? | [`SobolSample`]: first and total order | n (m + 2) |
//!
//! Both come in two steps, so that runs can be made elsewhere and resumed: a sample gives the points, the values at
//! the points give the indices. [`MuscleScreening`] makes a study's trials such a response;
//! [`SensitivityCohort`] tests indices over participants.

mod bootstrap;
mod cohort;
mod error;
mod hypercube;
mod morris;
mod morris_sample;
mod muscle_screening;
mod parameter;
mod sequence;
mod sobol;

pub use cohort::{Cell, CellComparison, CohortIndex, MeanIndex, SensitivityCohort};
pub use error::SensitivityError;
pub use hypercube::{latin_hypercube, maximin_latin_hypercube};
pub use morris::{MorrisConvergence, MorrisIndices, MorrisResult};
pub use morris_sample::{MorrisSample, Move, Start};
pub use muscle_screening::{MuscleScreening, ScreenedProperty, ScreeningError};
pub use parameter::{Parameter, RunFailure, run_all};
pub use sequence::{MOST_DIMENSIONS, sobol_sequence};
pub use sobol::{FirstOrderEstimator, SobolIndices, SobolResult, SobolSample};
