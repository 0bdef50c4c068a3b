//! Loops of joints that the default pose or a states file leaves open: what OpenSim does with them
//! (`fixtures/open_loops`).

use super::references::References;

/// Largest difference of a motion of 0.1 s, relative to what is above 1, from OpenSim's integrator at an accuracy of
/// 1e-9; the state from which it starts agrees to rounding.
const IN_MOTION: f64 = 1e-6;
/// The same of accelerations, which are written with 14 digits.
const OF_ACCELERATIONS: f64 = 1e-11;

const LOOPS: References =
    References { folder: "open_loops", about: "open loops of joints", files: &[], partly_undefined: &[] };

/// Where the integrator closes a loop that is far open, with whole steps of Newton's method, decides on the motion.
#[test]
fn val_opensim_open_loops_are_closed_where_a_simulation_starts() {
    for name in ["far", "pins", "with_speed", "ball", "weld", "locked"] {
        LOOPS.compare_forward(name, &[], IN_MOTION);
    }
}

#[test]
fn val_opensim_accelerations_where_a_loop_is_open() {
    for name in ["ball", "weld"] {
        LOOPS.compare(&format!("{name}_open.xml"), &format!("{name}_open"), OF_ACCELERATIONS);
    }
}
