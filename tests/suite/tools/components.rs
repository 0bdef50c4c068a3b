//! Forces, actuators and muscles of many classes: what OpenSim's tools write for a model of them
//! (`fixtures/components`).

use super::references::References;

/// Largest difference, relative to what is above 1.
const TOLERANCE: f64 = 1e-9;
/// The same where there are constraints: OpenSim's assembly, which made the states, leaves violations of up to 1e-9,
/// which are removed here before anything is computed.
const CONSTRAINED: f64 = 1e-7;

const COMPONENTS: References = References {
    folder: "components",
    about: "forces, actuators and muscles of many classes",
    files: &["forces.osim", "extra_actuators.xml", "../dynamics/constraints.osim"],
    // Of Delp's OpenSim reports none but the actuation.
    partly_undefined: &["rigid", "schutte", "schutte_passive", "delp"],
};

#[test]
fn val_opensim_forces_actuators_and_muscles_of_many_classes() {
    COMPONENTS.compare("analyze.xml", "analyze", TOLERANCE);
}

#[test]
fn val_opensim_actuators_with_defaults_and_controllers_of_many_kinds() {
    COMPONENTS.compare("controllers.xml", "controllers", TOLERANCE);
}

#[test]
fn val_opensim_equilibrium_of_muscles_of_many_classes() {
    COMPONENTS.compare("equilibrate.xml", "equilibrate", TOLERANCE);
}

#[test]
fn val_opensim_loads_of_joints_and_forces_of_constraints() {
    COMPONENTS.compare("constraints.xml", "constraints", CONSTRAINED);
}

#[test]
fn val_opensim_forward_with_forces_actuators_and_muscles_of_many_classes() {
    COMPONENTS.compare_forward("forward", &[], 1e-4);
}

#[test]
fn val_opensim_forward_with_constraints_between_bodies() {
    COMPONENTS.compare_forward("forward_constrained", &[], 1e-4);
}
