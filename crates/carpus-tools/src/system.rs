//! A model with all that acts in it, evaluated at given states.

mod actor;
mod compiled;
mod evaluate;
mod finite;
mod joint_forces;
mod states;

pub use actor::{Actor, SystemMuscle};
pub use compiled::{Evaluation, System, SystemState, SystemWork};
pub use evaluate::apply_tension;
pub use finite::NotFinite;
