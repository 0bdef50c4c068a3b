//! OpenSim's functions of one variable, with derivatives.
