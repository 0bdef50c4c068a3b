//! Tests of `simulation`.

use std::path::{Path, PathBuf};

use carpus::osim::OsimFile;
use carpus::simulation::{HeldCoordinate, MusculoskeletalModel, Options, Recording, Setup, TrialSimulation};
use carpus::study::MomentPart;

use crate::reference::shared;

const MUSCLES: [&str; 5] = ["ECRL", "ECRB", "ECU", "FCR", "FCU"];

/// A table of numbers with named columns.
struct Table {
    header: Vec<String>,
    columns: Vec<Vec<f64>>,
}

impl Table {
    fn read(path: &Path) -> Table {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let mut lines = text.lines();
        let header: Vec<String> = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let mut columns = vec![Vec::new(); header.len()];
        for line in lines {
            for (column, cell) in columns.iter_mut().zip(line.split(',')) {
                column.push(cell.parse().unwrap());
            }
        }
        Table { header, columns }
    }

    fn column(&self, name: &str) -> &[f64] {
        &self.columns[self.header.iter().position(|h| h == name).unwrap_or_else(|| panic!("no column {name}"))]
    }

    fn muscle(&self, muscle: &str, quantity: &str) -> &[f64] {
        self.column(&format!("{muscle}_{quantity}"))
    }
}

fn fixture(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn setup(parts: &[MomentPart], posture: &[(&str, f64)]) -> Setup {
    let held = |(name, value): &(&str, f64)| HeldCoordinate { coordinate: (*name).into(), value_deg_or_m: *value };
    Setup {
        coordinate: "flexion".into(),
        posture: posture.iter().map(held).collect(),
        active_muscles: MUSCLES.map(str::to_owned).to_vec(),
        parts: parts.to_vec(),
        dynamometer_damping: 0.0,
        allow_unsupported: false,
    }
}

fn compile(path: &Path, setup: &Setup) -> MusculoskeletalModel {
    let file = OsimFile::read(path).unwrap();
    MusculoskeletalModel::compile(&file.spec, setup).unwrap()
}

fn recording(table: &Table) -> Recording<'_> {
    Recording {
        name: "reference".into(),
        time: table.column("time"),
        angle: table.column("flexion"),
        excitation: MUSCLES.map(|m| table.muscle(m, "excitation")).to_vec(),
    }
}

fn largest(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The bar: forces within 1e-4 of maximum isometric force at every sample.
const FORCE_TOLERANCE: f64 = 1e-4;
/// Activations here are within 1e-6 (brute force in the unit tests); the rest is OpenSim's own error at accuracy 1e-7,
/// whose steps do not stop where the excitation has a kink.
const ACTIVATION_TOLERANCE: f64 = 1e-5;

fn compare_with_opensim(model_path: &Path, table_path: &Path, posture: &[(&str, f64)], passive: bool) {
    let table = Table::read(table_path);
    let parts: &[MomentPart] =
        if passive { &[MomentPart::Muscles, MomentPart::Passive] } else { &[MomentPart::Muscles] };
    let model = compile(model_path, &setup(parts, posture));
    let trial = model.prepare(&recording(&table), &Options::default()).unwrap();
    let parameters = model.nominal_parameters();
    let result: TrialSimulation = trial.simulate(&parameters).unwrap();
    let kinematics = trial.kinematics();
    println!(
        "{}: {} path evaluations, steps {:?}, work {:?}, curves {:.1e}",
        model_path.file_name().unwrap().to_string_lossy(),
        trial.path_evaluations(),
        trial.planned_steps(),
        result.work,
        model.curve_deviation()
    );
    for (i, muscle) in MUSCLES.into_iter().enumerate() {
        let (kin, sim) = (&kinematics.muscles[i], &result.muscles[i]);
        let force =
            largest(&sim.tendon_force, table.muscle(muscle, "tendon_force")) / parameters[i].max_isometric_force;
        let length = largest(&kin.length, table.muscle(muscle, "length"));
        let speed = largest(&kin.lengthening_speed, table.muscle(muscle, "lengthening_speed"));
        let arm = largest(&kin.moment_arm, table.muscle(muscle, "moment_arm"));
        let activation = largest(&kin.activation, table.muscle(muscle, "activation"));
        let fiber = largest(&sim.fiber_length, table.muscle(muscle, "fiber_length"));
        println!(
            "  {muscle}: force {force:.1e}·Fmax, path {length:.1e} m, speed {speed:.1e} m/s, arm {arm:.1e} m, activation {activation:.1e}, fibre {fiber:.1e} m"
        );
        assert!(length < 1e-6 && arm < 1e-5, "{muscle}: {length:e} {arm:e}");
        assert!(activation < ACTIVATION_TOLERANCE, "{muscle}: {activation:e}");
        assert!(force < FORCE_TOLERANCE, "{muscle}: {force:e}");
    }
    let muscle_moment: Vec<f64> =
        (0..trial.len()).map(|k| result.muscles.iter().map(|m| m.moment[k]).sum::<f64>()).collect();
    let moment = largest(&muscle_moment, table.column("muscle_moment"));
    println!("  muscle moment {moment:.1e} N·m");
    assert!(moment < 1e-3);
    if passive {
        let difference = largest(&kinematics.passive_moment, table.column("passive_moment"));
        println!("  passive moment {difference:.1e} N·m");
        assert!(difference < 1e-4);
    }
}

#[test]
fn val_opensim_prescribed_motion_of_the_bundled_wrist() {
    compare_with_opensim(
        &fixture("models/wrist.osim"),
        &fixture("fixtures/prescribed_motion/wrist.csv"),
        &[("elbow_flexion", 90.0), ("pro_sup", 0.0)],
        true,
    );
}

/// Reference tables made from the shared lab models, which are not part of this project: folder
/// `CARPUS_REFERENCE` (made by `fixtures/scripts/prescribed_motion.py`).
fn lab_reference(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("CARPUS_REFERENCE").map(|dir| PathBuf::from(dir).join(name)).filter(|p| p.exists());
    if path.is_none() {
        eprintln!("SKIPPED: no {name} in CARPUS_REFERENCE");
    }
    path
}

#[test]
fn val_opensim_prescribed_motion_of_mcfarland() {
    let (Some(model), Some(table)) =
        (shared("models/Hand_Wrist_Model_for_development.osim"), lab_reference("mcfarland.csv"))
    else {
        return;
    };
    compare_with_opensim(&model, &table, &[], false);
}
