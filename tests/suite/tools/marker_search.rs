//! Inverse kinematics: constraints, minima, ranges of time.

use nalgebra::Vector3;

use super::opensim::Bench;
use super::small_model::{Folder, model, setup, table, warnings};

const NAMES: [&str; 6] = ["U1", "U2", "F1", "F2", "H1", "H2"];

/// Where the markers of the small arm are, its locked coordinate and its coupler given up.
fn places(arm: f64, bend: f64, deviation: f64, flexion: f64) -> [Vector3<f64>; 6] {
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};
    let turn = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
    let upper = Isometry3::from_parts(Translation3::identity(), turn(Vector3::z(), arm));
    let fore = upper * Isometry3::from_parts(Translation3::new(0.0, -0.3, 0.0), turn(Vector3::z(), bend));
    let turned = turn(Vector3::y(), 0.2) * turn(Vector3::x(), deviation) * turn(Vector3::y(), flexion);
    let hand = fore * Isometry3::from_parts(Translation3::new(0.0, -0.25, 0.0), turned);
    let at = |body: &Isometry3<f64>, x: f64, y: f64, z: f64| (body * nalgebra::Point3::new(x, y, z)).coords;
    [
        at(&upper, 0.03, -0.1, 0.01),
        at(&upper, -0.02, -0.28, 0.03),
        at(&fore, 0.02, -0.1, 0.02),
        at(&fore, -0.03, -0.22, 0.0),
        at(&hand, 0.02, -0.05, 0.03),
        at(&hand, 0.0, -0.11, -0.02),
    ]
}

/// Markers over time, as a file; by what each is displaced.
pub fn trc(times: &[f64], displaced: impl Fn(usize, f64) -> Vector3<f64>) -> String {
    let mut text = format!(
        "PathFileType\t4\t(X/Y/Z)\tm.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t\
         OrigDataStartFrame\tOrigNumFrames\n20\t20\t{}\t6\tm\t20\t1\t{}\nFrame#\tTime\t{}\n\t\t{}\n\n",
        times.len(),
        times.len(),
        NAMES.map(|name| format!("{name}\t\t\t")).concat(),
        (1..=6).map(|i| format!("X{i}\tY{i}\tZ{i}\t")).collect::<String>(),
    );
    for (row, t) in times.iter().enumerate() {
        // Deviation and coupler are far from what the model holds.
        let seen = places(0.3 + 0.2 * t, 0.6 + 0.4 * t, 0.25, 0.1);
        let words: Vec<String> = seen
            .iter()
            .enumerate()
            .flat_map(|(i, p)| (p + displaced(i, *t)).iter().map(|x| format!("{x:.9}")).collect::<Vec<_>>())
            .collect();
        text += &format!("{}\t{t:.6}\t{}\n", row + 1, words.join("\t"));
    }
    text
}

fn times(n: usize, step: f64) -> Vec<f64> {
    (0..n).map(|i| step * i as f64).collect()
}

const IK: &str = "<marker_file>m.trc</marker_file><time_range>0 \
                  10</time_range><accuracy>1e-9</accuracy><output_motion_file>RESULTS/ik.mot</output_motion_file>\
                  <report_errors>true</report_errors>";

/// Whatever weight constraints are given, locked coordinates and couplers are exact.
#[test]
fn verif_constraints_hold_at_every_weight() {
    let folder = Folder::new("");
    folder.write("m.trc", &trc(&times(11, 0.05), |_, _| Vector3::zeros()));
    let solved = |weight: &str| {
        let inner = IK.replace("RESULTS", ".");
        let outcome = folder
            .run("InverseKinematicsTool", &format!("{inner}<constraint_weight>{weight}</constraint_weight>"))
            .unwrap();
        let has_note = warnings(&outcome).contains("has no effect, as in OpenSim 4.6: constraints hold");
        assert_eq!(has_note, weight != "Inf");
        assert!(!warnings(&outcome).contains("converge"), "{}", warnings(&outcome));
        table(&outcome, "ik.mot")
    };
    let strict = solved("Inf");
    for row in &strict.rows {
        let [_, bend, deviation, flexion] = row[..] else { panic!("four coordinates") };
        // Printed in degrees with 8 digits.
        assert!((deviation.to_radians() - 0.1).abs() < 1e-9, "{deviation}");
        assert!((flexion - 0.5 * bend - 0.1_f64.to_degrees()).abs() < 3e-8, "{flexion} {bend}");
    }
    for weight in ["0", "0.01", "1", "20", "1000"] {
        assert_eq!(solved(weight).rows, strict.rows, "{weight}");
    }
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_marker_search_with_soft_constraints() {
    let bench = Bench::new();
    bench.write("small.osim", &model(""));
    bench.write("m.trc", &trc(&times(11, 0.05), |i, t| Vector3::new(0.01 * (i as f64 + 7.0 * t).sin(), 0.0, 0.005)));
    for weight in ["0", "0.01", "20"] {
        let inner = format!("{IK}<constraint_weight>{weight}</constraint_weight>");
        let bar = |_: &str| 1e-5;
        bench.compare(
            "marker search, soft constraints",
            &bench.path("small.osim"),
            &setup("InverseKinematicsTool", &inner),
            &bar,
        );
    }
}

/// A coordinate that no marker determines stays where it is, and none winds up.
#[test]
fn verif_what_no_marker_determines_stays() {
    let folder = Folder::new("");
    folder.write("m.trc", &trc(&times(21, 0.05), |i, t| Vector3::new(0.0, 0.0, 0.02 * (9.0 * t + i as f64).cos())));
    let tasks: String = NAMES[..2]
        .iter()
        .map(|name| format!("<IKMarkerTask name=\"{name}\"><apply>true</apply><weight>1</weight></IKMarkerTask>"))
        .collect();
    let inner = format!("{}<IKTaskSet><objects>{tasks}</objects></IKTaskSet>", IK.replace("RESULTS", "."));
    let outcome = folder.run("InverseKinematicsTool", &inner).unwrap();
    assert!(!warnings(&outcome).contains("converge"), "{}", warnings(&outcome));
    let found = table(&outcome, "ik.mot");
    assert_eq!(found.len(), 21);
    assert!(found.rows.iter().all(|row| row[1].abs() < 1e-4 && row[0].abs() < 180.0), "{:?}", found.rows);
}

/// As in OpenSim, whose default end of the range is 2 s.
#[test]
fn verif_without_a_range_of_time_frames_after_two_seconds_are_left_out() {
    let folder = Folder::new("");
    folder.write("m.trc", &trc(&times(31, 0.1), |_, _| Vector3::zeros()));
    let rows = |range: &str| {
        let inner = format!("<marker_file>m.trc</marker_file><output_motion_file>ik.mot</output_motion_file>{range}");
        let outcome = folder.run("InverseKinematicsTool", &inner).unwrap();
        (table(&outcome, "ik.mot").len(), warnings(&outcome))
    };
    let (n, said) = rows("");
    assert_eq!(n, 21);
    assert!(said.contains("no time_range: as in OpenSim 4.6 frames after 2 s are left out, of data to 3 s"), "{said}");
    let (n, said) = rows("<time_range>0 3</time_range>");
    assert!(n == 31 && said.is_empty(), "{said}");
}

#[test]
fn verif_a_coordinate_file_that_is_not_there_is_reported() {
    let folder = Folder::new("");
    folder.write("m.trc", &trc(&times(11, 0.1), |_, _| Vector3::zeros()));
    let placer = "<GenericModelMaker><model_file>small.osim</model_file></GenericModelMaker><MarkerPlacer>\
                  <marker_file>m.trc</marker_file><time_range>0 1</time_range>\
                  <coordinate_file>gone.mot</coordinate_file><output_model_file>placed.osim</output_model_file>\
                  </MarkerPlacer>";
    for (class, inner) in [
        ("ScaleTool", placer),
        ("InverseKinematicsTool", "<marker_file>m.trc</marker_file><coordinate_file>gone.mot</coordinate_file>"),
    ] {
        let error = folder.error(class, inner);
        assert!(error.contains("gone.mot: cannot be read"), "{error}");
    }
    folder.run("ScaleTool", &placer.replace("gone.mot", "motion.mot")).unwrap();
}
