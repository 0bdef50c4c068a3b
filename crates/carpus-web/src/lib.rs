//! A participant's model and trials in a web page: simulated, fitted and exported there by the code of the program.
//!
//! In: a [`case::Case`], which a report carries. Out: a [`workbench::Workbench`], which simulates all trials with any
//! muscle parameters and effects, compares them with what was measured, fits muscles and effects, and writes the model
//! file. For `wasm32-unknown-unknown` there are bindings to JavaScript; the front end that calls them is in `page/`.
//!
//! [`scene::Scene`] is a model in any posture, for drawing it and for reading lengths and moment arms off.
//!
//! `build.sh` compiles this crate and the front end to what reports embed (`crates/carpus-report/src/assets/live`).

#[cfg(target_arch = "wasm32")]
mod bindings;
pub mod case;
mod columns;
mod description;
pub mod fitting;
mod muscles_of_trial;
pub mod scene;
mod scene_description;
pub mod workbench;
