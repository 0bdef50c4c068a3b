//! OpenSim's tools from OpenSim's setup files: the same files as OpenSim writes, within stated differences.

mod assembly;
mod coinciding_axes;
mod components;
mod files;
mod finite_forces;
mod force_sets;
mod inputs;
mod marker_search;
mod model_kinds;
mod motion_capture;
mod names;
mod odd_models;
mod old_setups;
mod open_loops;
mod opensim;
mod references;
mod setups;
mod small_model;
mod unusual_models;
