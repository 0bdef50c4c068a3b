//! `.c3d` files of known content, as an independent reader (ezc3d) finds it, and broken ones.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use carpus::storage::{Markers, MotionCapture};
use serde_json::Value;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/motion_capture")
}

fn expected() -> Value {
    serde_json::from_str(&std::fs::read_to_string(folder().join("expected.json")).unwrap()).unwrap()
}

#[test]
fn verif_markers_and_channels_are_those_of_an_independent_reader() {
    for (name, expected) in expected()["files"].as_object().unwrap() {
        let found = MotionCapture::read(folder().join(name)).unwrap();
        let names: Vec<&str> = expected["markers"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
        assert_eq!(found.markers.names, names, "{name}");
        assert_eq!(found.analog.labels, ["ECRL", "FCU", "Torque"], "{name}");
        assert_eq!(found.units, ["V", "V", "Nm"], "{name}");
        assert_eq!(Some(found.markers.data_rate), expected["frame_rate_hz"].as_f64());
        assert!((found.analog.time[1] * expected["sample_rate_hz"].as_f64().unwrap() - 1.0).abs() < 1e-12);
        let mut unseen = 0;
        for (m, frames) in expected["places_mm"].as_array().unwrap().iter().enumerate() {
            assert_eq!(frames.as_array().unwrap().len(), found.markers.time.len());
            for (place, row) in frames.as_array().unwrap().iter().zip(&found.markers.rows) {
                for k in 0..3 {
                    match place[k].as_f64() {
                        Some(mm) => assert!((1000.0 * row[m][k] - mm).abs() < 1e-6 * (1.0 + mm.abs()), "{name}"),
                        None => unseen += usize::from(row[m][k].is_nan()),
                    }
                }
            }
        }
        assert_eq!(unseen, 4 * 3, "{name}");
        for (c, samples) in expected["samples"].as_array().unwrap().iter().enumerate() {
            assert_eq!(samples.as_array().unwrap().len(), found.analog.len());
            for (value, row) in samples.as_array().unwrap().iter().zip(&found.analog.rows) {
                assert!((row[c] - value.as_f64().unwrap()).abs() < 2e-6, "{name}: {} and {value}", row[c]);
            }
        }
    }
}

/// The library would take memory for what the header counts before it looks.
#[test]
fn verif_counts_that_no_file_holds_are_refused() {
    let bytes = std::fs::read(folder().join("float.c3d")).unwrap();
    let with = |words: &[(usize, u16)]| {
        let mut bytes = bytes.clone();
        words.iter().for_each(|(i, value)| bytes[2 * i..][..2].copy_from_slice(&value.to_le_bytes()));
        MotionCapture::parse(&bytes)
    };
    for (words, expected) in [
        (vec![(1, 24770), (4, 6401)], "6401 frames of 24770 markers, more than the file holds"),
        (vec![(1, 0), (2, 0)], "found none"),
        (vec![(2, 65535), (9, 65535)], "not channels (ANALOG:USED) times samples per channel"),
        (vec![(8, 0)], "the data begin at block 0"),
        (vec![(2, 30), (9, 7)], "not channels (ANALOG:USED) times samples per channel"),
    ] {
        let error = with(&words).expect_err(expected).to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    let mut loops = bytes.clone();
    loops[512 + 4] = 0x80;
    let error = MotionCapture::parse(&loops).expect_err("a name of no length").to_string();
    assert!(error.contains("-128 letters"), "{error}");
    // No analog samples, whatever is said of channels.
    let found = with(&[(2, 0), (9, 65535)]).unwrap();
    assert!(found.analog.is_empty() && !found.markers.time.is_empty());
}

#[test]
fn verif_files_that_are_cut_off_are_refused() {
    let bytes = std::fs::read(folder().join("float.c3d")).unwrap();
    for length in [0, 100, 512, 1023, 1500, bytes.len() / 2, bytes.len() - 1024] {
        let error = MotionCapture::parse(&bytes[..length]).expect_err("a part of a file").to_string();
        assert!(!error.is_empty() && !error.contains("panic"), "{length}: {error}");
    }
    let half = MotionCapture::parse(&bytes[..bytes.len() - 1024]).expect_err("frames are missing").to_string();
    assert!(half.contains("expected 25 rows") && half.contains("cut off"), "{half}");
    let text = MotionCapture::parse(&vec![b'a'; 2000]).expect_err("no c3d file").to_string();
    assert!(text.contains("not a .c3d file"), "{text}");
}

#[test]
fn verif_the_command_writes_what_other_commands_read() {
    let out = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let mut command = Command::cargo_bin("carpus").unwrap();
        command.args(arguments).arg(folder().join("integer.c3d")).arg("--out").arg(out.path()).assert()
    };
    let shown = String::from_utf8(run(&["c3d"]).success().get_output().stdout.clone()).unwrap();
    assert!(shown.contains("3 markers, 25 frames at 100 Hz: RADIUS, ULNA, MCP3"), "{shown}");
    assert!(shown.contains("ECRL [V], FCU [V], Torque [Nm]") && shown.contains("250 samples at 1000"), "{shown}");
    let written = Markers::read(out.path().join("integer_markers.trc")).unwrap();
    let direct = Markers::read(folder().join("integer.c3d")).unwrap();
    assert_eq!((&written.names, &written.time), (&direct.names, &direct.time));
    let same = |(a, b): (f64, f64)| a == b || (a.is_nan() && b.is_nan());
    for (row, other) in written.rows.iter().zip(&direct.rows) {
        assert!(row.iter().zip(other).all(|(a, b)| a.iter().copied().zip(b.iter().copied()).all(same)));
    }
    let csv = std::fs::read_to_string(out.path().join("integer_analog.csv")).unwrap();
    assert!(csv.starts_with("time_s,ECRL,FCU,Torque\n0,") && csv.lines().count() == 251);
    let json: Value = serde_json::from_slice(&run(&["--json", "c3d"]).success().get_output().stdout).unwrap();
    assert_eq!((json["frames"].as_u64(), json["channels"][2]["unit"].as_str()), (Some(25), Some("Nm")));
}
