//! Simulation of recorded trials with prescribed motion; equilibrium at a posture; path sweeps.
