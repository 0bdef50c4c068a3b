//! OpenSim's tools from OpenSim's setup files: the same files as OpenSim writes, within stated differences.

mod components;
mod files;
mod motion_capture;
mod opensim;
mod setups;
