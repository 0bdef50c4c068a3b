//! The effects, one file each, and the one list of them.

use crate::effect::Effect;

mod activation_dependent_length;
mod activation_dynamics;
mod active_force_width;
mod angle_offset;
mod axis_misalignment;
mod coulomb_friction;
mod electromechanical_delay;
mod emg_crosstalk;
pub mod emg_floor;
mod emg_gain;
mod emg_gain_drift;
mod emg_nonlinearity;
mod end_range_spring;
mod fatigue;
mod gravity;
mod history_dependence;
mod inertia;
mod joint_compliance;
mod joint_damping;
mod joint_stiffness;
mod ligament_stop;
mod max_contraction_velocity;
mod moment_arm_shift;
mod moment_arm_slope;
mod passive_fiber_force;
mod potentiation;
mod power_law_damping;
mod sensor_bandwidth;
mod stretch_reflex;
mod tendon_compliance;
mod thixotropy;
mod time_shift;
mod torque_drift;
mod torque_gain;
mod torque_offset;
mod unmodelled_muscles;

/// The catalogue. The order of this list is that of tables; effects act in the order that each states
/// (`Description::order`).
pub static CATALOGUE: &[&dyn Effect] = &[
    &joint_stiffness::JointStiffness,
    &end_range_spring::EndRangeSpring,
    &ligament_stop::LigamentStop,
    &joint_damping::JointDamping,
    &power_law_damping::PowerLawDamping,
    &coulomb_friction::CoulombFriction,
    &thixotropy::Thixotropy,
    &stretch_reflex::StretchReflex,
    &gravity::Gravity,
    &inertia::Inertia,
    &moment_arm_shift::MomentArmShift,
    &moment_arm_slope::MomentArmSlope,
    &angle_offset::AngleOffset,
    &joint_compliance::JointCompliance,
    &axis_misalignment::AxisMisalignment,
    &tendon_compliance::TendonCompliance,
    &max_contraction_velocity::MaxContractionVelocity,
    &active_force_width::ActiveForceWidth,
    &passive_fiber_force::PassiveFiberForce,
    &activation_dependent_length::ActivationDependentLength,
    &history_dependence::HistoryDependence,
    &unmodelled_muscles::UnmodelledMuscles,
    &activation_dynamics::ActivationDynamics,
    &emg_floor::EmgFloor,
    &emg_crosstalk::EmgCrosstalk,
    &emg_gain::EmgGain,
    &emg_gain_drift::EmgGainDrift,
    &electromechanical_delay::ElectromechanicalDelay,
    &emg_nonlinearity::EmgNonlinearity,
    &potentiation::Potentiation,
    &fatigue::Fatigue,
    &time_shift::TimeShift,
    &sensor_bandwidth::SensorBandwidth,
    &torque_gain::TorqueGain,
    &torque_offset::TorqueOffset,
    &torque_drift::TorqueDrift,
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{Stage, lacks_property};
    use carpus_osim::osim::OsimFile;

    #[test]
    fn verif_every_file_here_is_an_effect_of_the_catalogue() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/effects");
        let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut files: Vec<String> = names.filter_map(|n| n.strip_suffix(".rs").map(str::to_owned)).collect();
        files.retain(|name| name != "mod");
        files.sort_unstable();
        let mut listed: Vec<&str> = CATALOGUE.iter().map(|e| e.description().id).collect();
        listed.sort_unstable();
        assert_eq!(files, listed);
    }

    /// EMG loses baseline and cross-talk before its gain is corrected; a sensor delays and filters before it scales and
    /// shifts.
    #[test]
    fn verif_effects_that_do_not_commute_have_an_order() {
        for stage in [Stage::Excitation, Stage::Sensor] {
            let here = || CATALOGUE.iter().map(|e| e.description()).filter(|d| d.stage == stage);
            let mut orders: Vec<u8> = here().map(|d| d.order).collect();
            orders.sort_unstable();
            orders.dedup();
            assert_eq!(orders.len(), here().count(), "{stage:?}");
        }
    }

    /// A prior is made of what is reported of an effect that is absent: it has to be a positive, usual number for
    /// muscles of every class.
    #[test]
    fn verif_what_is_reported_of_muscles_without_the_property_is_a_factor() {
        let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        for class in [
            "Thelen2003Muscle",
            "DeGrooteFregly2016Muscle",
            "RigidTendonMuscle",
            "Schutte1993Muscle_Deprecated",
            "Delp1990Muscle_Deprecated",
        ] {
            let spec = OsimFile::read(root.join(format!("fixtures/muscle_laws/{class}.osim"))).unwrap().spec;
            for effect in CATALOGUE.iter().filter(|effect| !effect.muscle_properties().is_empty()) {
                let d = effect.description();
                for value in effect.reported(&d.absent(), &spec.muscles) {
                    assert!(value > 1e-3 && value < 1e2, "{class} {}: {value}", d.id);
                }
                let moved = vec![0.1; d.parameters.len()];
                let lacks = lacks_property(*effect, &spec.muscles).is_some();
                assert_eq!(effect.change_muscles(&moved, &mut spec.muscles.clone()), !lacks, "{class} {}", d.id);
            }
        }
    }
}
