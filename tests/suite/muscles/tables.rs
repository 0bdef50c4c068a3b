//! Reading the reference tables of `fixtures/muscles/opensim_muscles.py`, and judging differences.

pub use crate::validation::Differences;
use carpus::muscles::Millard2012;
use carpus::osim::spec::{
    ActiveForceLengthSpec, FiberForceLengthSpec, ForceVelocitySpec, Location, Millard2012Spec, MuscleKind, MuscleSpec,
    PathSpec, TendonForceLengthSpec,
};
use serde_json::Value;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

pub fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/muscles")
}

/// A table's rows, each from column name to text.
pub fn rows(path: &Path) -> Vec<HashMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).expect("reference table");
    reader.deserialize().map(|row| row.expect("row")).collect()
}

pub fn number(row: &HashMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column}: {}", row[column]))
}

/// The specifications in a folder's `muscles.json`.
pub fn specs(folder: &Path) -> Vec<MuscleSpec> {
    let text = std::fs::read_to_string(folder.join("muscles.json")).expect("muscles.json");
    let list: Vec<Value> = serde_json::from_str(&text).expect("JSON");
    list.iter().map(spec).collect()
}

/// The muscles in a folder's `muscles.json`, by name.
pub fn muscles(folder: &Path) -> HashMap<String, Millard2012> {
    specs(folder).iter().map(|spec| (spec.name.clone(), Millard2012::from_spec(spec).expect("valid muscle"))).collect()
}

fn spec(json: &Value) -> MuscleSpec {
    let f = |name: &str| json[name].as_f64().unwrap_or_else(|| panic!("{name} in {json}"));
    let flag = |name: &str| json[name].as_bool().unwrap_or_else(|| panic!("{name} in {json}"));
    let of = |curve: &str, name: &str| json[curve][name].as_f64().unwrap_or_else(|| panic!("{curve}/{name}"));
    let optional = |curve: &str, name: &str| json[curve][name].as_f64();
    let (al, fv, pe, te) =
        ("ActiveForceLengthCurve", "ForceVelocityCurve", "FiberForceLengthCurve", "TendonForceLengthCurve");
    let millard = Millard2012Spec {
        fiber_damping: f("fiber_damping"),
        default_fiber_length: f("default_fiber_length"),
        default_activation: f("default_activation"),
        minimum_activation: f("minimum_activation"),
        activation_time_constant: f("activation_time_constant"),
        deactivation_time_constant: f("deactivation_time_constant"),
        maximum_pennation_angle: f("maximum_pennation_angle"),
        active_force_length: ActiveForceLengthSpec {
            min_norm_active_fiber_length: of(al, "min_norm_active_fiber_length"),
            transition_norm_fiber_length: of(al, "transition_norm_fiber_length"),
            max_norm_active_fiber_length: of(al, "max_norm_active_fiber_length"),
            shallow_ascending_slope: of(al, "shallow_ascending_slope"),
            minimum_value: of(al, "minimum_value"),
        },
        force_velocity: ForceVelocitySpec {
            concentric_slope_at_vmax: of(fv, "concentric_slope_at_vmax"),
            concentric_slope_near_vmax: of(fv, "concentric_slope_near_vmax"),
            isometric_slope: of(fv, "isometric_slope"),
            eccentric_slope_at_vmax: of(fv, "eccentric_slope_at_vmax"),
            eccentric_slope_near_vmax: of(fv, "eccentric_slope_near_vmax"),
            max_eccentric_velocity_force_multiplier: of(fv, "max_eccentric_velocity_force_multiplier"),
            concentric_curviness: of(fv, "concentric_curviness"),
            eccentric_curviness: of(fv, "eccentric_curviness"),
        },
        fiber_force_length: FiberForceLengthSpec {
            strain_at_zero_force: of(pe, "strain_at_zero_force"),
            strain_at_one_norm_force: of(pe, "strain_at_one_norm_force"),
            stiffness_at_low_force: optional(pe, "stiffness_at_low_force"),
            stiffness_at_one_norm_force: optional(pe, "stiffness_at_one_norm_force"),
            curviness: optional(pe, "curviness"),
        },
        tendon_force_length: TendonForceLengthSpec {
            strain_at_one_norm_force: of(te, "strain_at_one_norm_force"),
            stiffness_at_one_norm_force: optional(te, "stiffness_at_one_norm_force"),
            norm_force_at_toe_end: optional(te, "norm_force_at_toe_end"),
            curviness: optional(te, "curviness"),
        },
    };
    MuscleSpec {
        name: json["name"].as_str().expect("name").to_owned(),
        at: Location::default(),
        applies_force: true,
        path: PathSpec::default(),
        max_isometric_force: f("max_isometric_force"),
        optimal_fiber_length: f("optimal_fiber_length"),
        tendon_slack_length: f("tendon_slack_length"),
        pennation_angle_at_optimal: f("pennation_angle_at_optimal"),
        max_contraction_velocity: f("max_contraction_velocity"),
        ignore_tendon_compliance: flag("ignore_tendon_compliance"),
        ignore_activation_dynamics: flag("ignore_activation_dynamics"),
        min_control: f("min_control"),
        max_control: f("max_control"),
        kind: MuscleKind::Millard2012Equilibrium(Box::new(millard)),
    }
}
