//! Rotations, rigid transforms and spatial velocities.
