//! Muscle models: curves, pennation, activation dynamics, Millard 2012 equilibrium.

pub mod curves;
