//! A participant's model from the study's without fitting.

mod linear;
mod strength;
