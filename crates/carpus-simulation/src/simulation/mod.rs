//! Simulation of recorded trials with prescribed motion; equilibrium at a posture; path sweeps.
//!
//! ```text
//! let model = MusculoskeletalModel::compile(&spec, &Setup::from_settings(&settings))?;   // once per model
//! let trials = model.prepare_all(&recordings, &Options::default())?;                     // once per study
//! let simulations = simulate_all(&trials, &model.nominal_parameters())?;                 // per parameter set
//! ```
//!
//! One coordinate follows the recorded angle, couplers follow it, all others are held: no mass matrix is needed and
//! massless bodies are no obstacle. Paths, moment arms, passive forces and activations do not depend on the muscles'
//! lengths and forces, so they are computed once per study or trial; a further parameter set costs only the fibres'
//! differential equations. Deliberately not here: reading files, comparing with measured moments, choosing parameters.

mod activation_dynamics;
mod activation_trajectory;
mod closed_loops;
mod error;
mod excitation_tangent;
mod fiber;
mod model;
mod moment_arms;
mod motion;
mod path_table;
mod piecewise;
mod prepare;
mod property;
mod response;
mod sensitivity;
mod single_jump;
mod tables;
mod trial;
mod variation;

pub use error::SimulationError;
pub use excitation_tangent::{ExcitationTangent, ForceChange};
pub use fiber::at_rest::FiberAtRest;
pub use fiber::radau::Work;
pub use fiber::step::FiberAccuracy;
pub use model::{
    HeldCoordinate, MuscleParameters, MusculoskeletalModel, Setup, check_muscles, posture, skeleton_in_posture,
};
pub use motion::{MotionInterpolation, speed_and_acceleration};
pub use property::Property;
pub use response::{AngleResponse, ExcitationResponse, RestResponse};
pub use sensitivity::MuscleSolution;
pub use trial::{
    MIN_RECORDING_SAMPLES, MuscleKinematics, MuscleSimulation, Options, PreparedTrial, Recording, TrialKinematics,
    TrialSimulation, UnitMoment, simulate_all,
};
