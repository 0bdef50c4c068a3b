//! The extension module `carpus._carpus` of the Python package `carpus`.
//!
//! Everything that people call is in `python/carpus`: typed, documented, made of what is here. This crate passes arrays
//! to the session layer and results back, lets the interpreter go while it works, and turns failures into exceptions.
//!
//! | module | contents |
//! |---|---|
//! | `job` | long work on a thread of its own: progress, Ctrl-C, panics |
//! | `failure` | failures as exceptions |
//! | `study`, `session` | studies and participants; every use case |
//! | `loaded` | what is below them: an open study, a loaded session |
//! | `answer`, `answers`, `cells` | results; what they have in common; results held with what they borrow |
//! | `batch` | moments for many sets of parameters, derivatives |
//! | `model`, `compiled`, `kinematics`, `forward` | models |
//! | `effect` | effects that Python defines |
//! | `tool`, `program` | OpenSim's tools; the program `carpus` |

// Names of poses are those of the field: X_GB.
#![allow(non_snake_case)]

mod answer;
mod answers;
mod batch;
mod cells;
mod compiled;
mod effect;
mod failure;
mod forward;
mod job;
mod kinematics;
mod loaded;
mod model;
mod program;
mod session;
mod study;
mod tool;

use pyo3::prelude::*;

/// The module.
#[pymodule]
mod _carpus {
    #[pymodule_export]
    use super::answer::Answer;
    #[pymodule_export]
    use super::effect::{define_effect, forget_effect};
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::program::{program, set_program};
    #[pymodule_export]
    use super::session::Session;
    #[pymodule_export]
    use super::study::Study;
    #[pymodule_export]
    use super::tool::{catalogue, run_tool};
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
