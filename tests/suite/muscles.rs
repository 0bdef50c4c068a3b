//! Tests of `muscles`: against OpenSim (`fixtures/muscles`, or live on the lab models), and of exact derivatives.

mod bad_input;
mod derivatives;
mod opensim;
mod tables;
mod thelen;
