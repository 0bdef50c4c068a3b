//! OpenSim's tools from OpenSim's setup files: the same files as OpenSim writes, within stated differences.

mod components;
mod files;
mod force_sets;
mod model_kinds;
mod motion_capture;
mod odd_models;
mod old_setups;
mod opensim;
mod references;
mod setups;
mod unusual_models;
