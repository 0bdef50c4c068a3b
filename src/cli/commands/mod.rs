//! One file per command. Each reads what its arguments name, computes through the library, and writes or prints.

pub mod c3d;
pub mod compare;
pub mod demo;
pub mod diagnose;
pub mod dynamometer;
pub mod dynamometer_drag;
pub mod effect;
pub mod effects;
pub mod emg;
pub mod equilibrium;
pub mod evaluate;
pub mod identify;
pub mod info;
pub mod paths;
pub mod personalize;
pub mod plan;
pub mod power;
pub mod run_tool;
pub mod scale;
pub mod sensitivity;
pub mod simulate;
pub mod strength_scale;
pub mod study;
pub mod synth;
pub mod ultrasound;
pub mod upgrade;
