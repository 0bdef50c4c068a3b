//! Every format holds what the CSV file holds; files that are cut off or changed are refused or read, never more.

use std::path::{Path, PathBuf};

use super::*;

/// Largest difference to the CSV: formats hold its numbers, multiples of 1/64, exactly; rates make times.
const DIFFERENCE: f64 = 1e-12;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/recordings").join(name)
}

/// Columns of a table: names and samples.
type Columns = Vec<(String, Vec<f64>)>;

fn read(name: &str, table: Option<&str>, columns: &[&str]) -> Result<(Recording, Columns), Vec<Problem>> {
    let path = fixture(name);
    let source = Source { path: &path, table, columns, what: "recording", named_at: None, key: "table" };
    let mut problems = Vec::new();
    let Some(mut recording) = Recording::open(&source, &mut problems) else { return Err(problems) };
    let mut columns: Columns = recording.names.iter().map(|name| (name.clone(), Vec::new())).collect();
    while recording.next(&path, &mut problems).is_some_and(|is_row| is_row) {
        for (i, (_, samples)) in columns.iter_mut().enumerate() {
            samples.extend(recording.number(i));
        }
    }
    if problems.is_empty() { Ok((recording, columns)) } else { Err(problems) }
}

fn column<'c>(columns: &'c Columns, name: &str) -> &'c [f64] {
    let found = columns.iter().find(|(known, _)| known == name);
    &found.unwrap_or_else(|| panic!("{name}: {:?}", columns.iter().map(|c| &c.0).collect::<Vec<_>>())).1
}

/// Compares with the CSV; names are time, angle, torque, ECRL, FCR as the file has them.
fn same(name: &str, table: Option<&str>, names: [&str; 5], sign: f64) {
    let (_, truth) = read("recording.csv", None, &["Time"]).unwrap();
    let wanted: Vec<&str> = names.into_iter().filter(|name| !name.is_empty()).collect();
    let (_, found) = read(name, table, &wanted).unwrap_or_else(|e| panic!("{name}: {e:?}"));
    for (i, wanted) in names.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
        let (truth, found) = (&truth[i].1, column(&found, wanted));
        assert_eq!(truth.len(), found.len(), "{name}: {wanted}");
        for (k, (a, b)) in truth.iter().zip(found).enumerate() {
            let a = if i == 2 { sign * a } else { *a };
            assert!((a - b).abs() <= DIFFERENCE, "{name}: {wanted}: sample {k}: {a} {b}");
        }
    }
}

const USUAL: [&str; 5] = ["Time", "Angle", "Torque", "ECRL", "FCR"];

#[test]
fn verif_every_format_holds_what_the_csv_file_holds() {
    same("recording.sto", None, ["time", "Angle", "Torque", "ECRL", "FCR"], 1.0);
    same("commas.txt", None, USUAL, 1.0);
    same("vectors.mat", None, USUAL, 1.0);
    same("struct.mat", None, ["time", "angle", "torque", "ECRL", "FCR"], 1.0);
    for of_rate in ["acqknowledge.mat", "spike2.mat", "delsys.mat", "recording.edf", "recording.bdf"] {
        same(of_rate, None, ["time_s", "Angle", "Torque", "ECRL", "FCR"], 1.0);
    }
    same("recording.c3d", None, ["time", "Angle", "Torque", "ECRL", "FCR"], 1.0);
    same("recording.xlsx", None, ["Time", "Angle", "Torque", "", ""], 1.0);
    same("recording.xlsx", None, ["Time", "", "", "ECRL [uV]", "FCR [uV]"], 1.0);
}

#[test]
fn verif_a_table_is_chosen_by_title_number_or_columns() {
    for (file, titles) in [
        ("repetitions.csv", ["Repetition 1", "Repetition 2"]),
        ("repetitions.xlsx", ["rep 1", "rep 2"]),
        ("trials.mat", ["trial{1}", "trial{2}"]),
    ] {
        for (k, (title, sign)) in titles.iter().zip([1.0, -1.0]).enumerate() {
            same(file, Some(title), USUAL, sign);
            same(file, Some(&(k + 1).to_string()), USUAL, sign);
        }
        let message = |table, columns: &[&str]| match read(file, table, columns) {
            Ok(_) => panic!("{file}: {table:?}"),
            Err(problems) => problems.iter().map(ToString::to_string).collect::<String>(),
        };
        let several = message(None, &USUAL);
        assert!(several.contains(titles[0]) && several.contains("column table of trials.csv"), "{several}");
        let none = message(Some("rep 3"), &USUAL);
        assert!(none.contains("no table `rep 3`") && none.contains(titles[1]), "{none}");
        let without = message(None, &["Time", "Force"]);
        assert!(without.contains("`Force`") && without.contains("Torque"), "{without}");
    }
    // Other sheets and structs are not read.
    let alone = |file: &str, format, wanted| tables(&fixture(file), format, Some(wanted)).map(|tables| tables.len());
    assert_eq!(alone("repetitions.xlsx", Format::Workbook, "REP 2"), Ok(1));
    assert_eq!(alone("struct.mat", Format::Matlab, "data"), Ok(1));
    assert!(
        alone("struct.mat", Format::Matlab, "other").is_err() && alone("spike2.mat", Format::Matlab, "Ch").is_err()
    );
    same("devices.csv", None, ["Time", "Angle", "Torque", "", ""], 1.0);
    same("devices.csv", None, ["Time", "", "", "ECRL", "FCR"], 1.0);
    let (recording, _) = read("devices.csv", None, &["Time", "FCR"]).unwrap();
    assert_eq!(recording.dialect.units, ["s", "uV", "uV"]);
    let (_, fast) = read("two_rates.edf", None, &["FCR"]).unwrap();
    let (_, slow) = read("two_rates.edf", Some("100 Hz"), &[]).unwrap();
    let (_, truth) = read("recording.csv", None, &["Time"]).unwrap();
    assert_eq!(column(&slow, "Torque"), column(&truth, "Torque"));
    assert!(column(&fast, "FCR").iter().step_by(4).eq(column(&truth, "FCR")));
    assert!((column(&fast, "time_s")[4] - 0.01).abs() < DIFFERENCE);
}

#[test]
fn verif_units_and_places_are_those_of_the_file() {
    let (recording, _) = read("recording.xlsx", None, &["Torque"]).unwrap();
    assert_eq!(recording.dialect.units, ["s", "deg", "N-m"]);
    // Six rows of the sheet are above the forty of numbers.
    let rows = tables(&fixture("recording.xlsx"), Format::Workbook, None).unwrap()[0].places.clone();
    assert_eq!(rows, (7..=46).collect::<Vec<_>>());
    // A table of a text ends before the next one begins.
    let (_, first) = read("repetitions.csv", Some("1"), &[]).unwrap();
    assert_eq!(first[0].1.len(), 40);
    for of_units in ["acqknowledge.mat", "spike2.mat", "recording.edf", "recording.c3d"] {
        let (recording, _) = read(of_units, None, &["Torque"]).unwrap();
        assert_eq!(recording.dialect.units, ["s", "deg", "N-m", "uV", "uV"], "{of_units}");
    }
}

#[test]
fn verif_formats_that_are_not_read_are_told_with_what_to_do() {
    let of = |path: &str, bytes: &[u8]| match format_of(Path::new(path), bytes) {
        Err(error) => format!("{error}: {}", error.hint().unwrap_or_default()),
        Ok(format) => format!("{format:?}"),
    };
    let newer = std::fs::read(fixture("version73.mat")).unwrap();
    assert!(of("a.mat", &newer).contains("7.3 (HDF5), which is not read: save it with save(name, \"-v7\")"));
    assert!(of("a.mat", &newer[512..]).contains("\"-v7\""));
    assert!(of("a.h5", &newer[512..]).contains("HDF5 file"));
    assert!(of("a.mat", b"# Created by Octave 9.2.0").contains("-v7"));
    assert!(of("a.mat", &[0; 600]).contains("level 4"));
    assert!(of("a.xls", b"\xD0\xCF\x11\xE0\xA1\xB1\x1A\xE1").contains(".xlsx"));
    assert!(of("a.tdms", b"TDSm").contains("TDMS"));
    assert!(of("a.ods", b"PK\x03\x04").contains("OpenDocument"));
    assert_eq!(of("a.txt", b"0       ,1\n"), "Text");
    assert_eq!(of("a", &std::fs::read(fixture("recording.edf")).unwrap()[..600]), "Edf");
}

#[test]
fn verif_files_that_are_cut_off_or_changed_do_no_harm() {
    let files: Vec<PathBuf> = std::fs::read_dir(fixture("")).unwrap().map(|entry| entry.unwrap().path()).collect();
    let (mut read, mut refused) = (0, 0);
    for path in files {
        let bytes = std::fs::read(&path).unwrap();
        let Ok(format) = format_of(&path, &bytes[..HEAD.min(bytes.len())]) else { continue };
        if format == Format::Text {
            continue;
        }
        let mut look = |bytes: &[u8]| match tables_of(bytes, format, None) {
            Ok(tables) => {
                assert!(tables.iter().all(|table| table.columns.iter().all(|c| c.len() == table.rows())));
                read += 1;
            }
            Err(error) => {
                assert!(error.to_string().len() < 2000, "{error}");
                refused += 1;
            }
        };
        // Every byte of headers and of small files, and spread ones of the rest.
        let places: Vec<usize> = (0..bytes.len()).filter(|i| *i < 600 || i % 11 == 0).collect();
        for at in places {
            look(&bytes[..at]);
            let mut changed = bytes.clone();
            for value in [changed[at] ^ 0x80, changed[at] ^ 1, 0xff, 0] {
                changed[at] = value;
                look(&changed);
            }
        }
    }
    println!("{read} read, {refused} refused");
    assert!(read > 1000 && refused > 1000);
}

#[test]
fn regress_a_sample_that_was_not_recorded_ends_no_recording() {
    let text = std::fs::read_to_string(fixture("recording.csv")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("missing.csv");
    for missing in ["NaN", "#N/A", "-", "marker"] {
        let lines = text.lines().enumerate().map(|(i, line)| match line.rsplit_once(',') {
            Some((before, _)) if i == 20 => format!("{before},{missing}\n"),
            _ => format!("{line}\n"),
        });
        std::fs::write(&file, lines.collect::<String>()).unwrap();
        match read(file.to_str().unwrap(), None, &["Time"]) {
            Ok((_, columns)) => assert_eq!(columns[0].1.len(), 40, "{missing}"),
            Err(problems) => assert!(problems.iter().any(|p| p.to_string().contains(":21")), "{missing}: {problems:?}"),
        }
    }
    // A text that begins with blank lines is no C3D file.
    std::fs::write(&file, format!("\nPatient: {}\n{text}", "x".repeat(600))).unwrap();
    assert_eq!(format_of(&file, &head(&file)), Ok(Format::Text));
}
