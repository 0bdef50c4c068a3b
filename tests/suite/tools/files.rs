//! `.sto`, `.mot` and `.trc` files of all ages, and broken ones.

use std::path::Path;

use carpus::storage::{Markers, Storage, printed};

const STO: &str = "Coordinates\nversion=1\nnRows=2\nnColumns=3\ninDegrees=yes\n\nUnits are S.I. \
                   units\n\nendheader\ntime\ta\tb\n      0.00000000\t      1.50000000\t             nan\n      \
                   0.50000000\t     -2.00000000\t             inf\n";

fn parse(text: &str, name: &str) -> Result<Storage, String> {
    Storage::parse(text.as_bytes(), Path::new(name)).map_err(|e| e.to_string())
}

#[test]
fn verif_storage_is_read_and_written() {
    let storage = parse(STO, "x.sto").unwrap();
    assert_eq!((storage.name.as_str(), storage.in_degrees, storage.labels.len()), ("Coordinates", true, 2));
    assert_eq!(storage.time, [0.0, 0.5]);
    assert!(storage.rows[0][1].is_nan() && storage.rows[1][1] == f64::INFINITY);
    let again = Storage { description: "\nUnits are S.I. units\n\n".into(), ..storage };
    assert_eq!(again.text(8), STO);
    assert_eq!(printed(-1.0 / 3.0, 8), "     -0.33333333");
    assert_eq!(printed(0.1, 20), "      0.10000000000000000555");
}

#[test]
fn verif_storages_of_all_ages() {
    // SIMM: no version, in degrees, white space of any kind, rows that do not follow lines.
    let simm = "name walk\ndatacolumns 3\ndatarows 2\notherdata 1\nrange 0.0 0.1\nendheader\n\n time  knee hip \r\n0  \
                1\t2\r\n 0.1 3\n4\n";
    let storage = parse(simm, "walk.mot").unwrap();
    assert!(storage.in_degrees && storage.name == "walk");
    assert_eq!((storage.labels.join(" "), storage.rows[1].clone()), ("knee hip".into(), vec![3.0, 4.0]));
    assert!(!parse(simm, "walk.sto").unwrap().in_degrees);
    // Version 3, with vectors.
    let new =
        "DataRate=100\nDataType=Vec3\nversion=3\nOpenSimVersion=4.6\nendheader\ntime\tm\n0\t1,2,3\n0.1\t4,5,-nan\n";
    let storage = parse(new, "m.sto").unwrap();
    assert_eq!(storage.labels, ["m_1", "m_2", "m_3"]);
    assert!(storage.rows[1][1] == 5.0 && storage.rows[1][2].is_nan());
    // Of rows of one time the last counts.
    let repeated =
        STO.replace("nRows=2", "nRows=3").replace("endheader\ntime\ta\tb\n", "endheader\ntime\ta\tb\n0 7 8\n");
    let storage = parse(&repeated, "x.sto").unwrap();
    assert_eq!((storage.time.as_slice(), storage.rows[0][0], storage.warnings.len()), ([0.0, 0.5].as_slice(), 1.5, 1));
    // Fewer rows than the header says: read, as by OpenSim 4.6. More: in version 1 those that it says, later all.
    let fewer = parse(&STO.replace("nRows=2", "nRows=100"), "x.sto").unwrap();
    assert_eq!((fewer.len(), fewer.warnings.len()), (2, 1));
    assert!(fewer.warnings[0].contains("the header says 100 rows, there are 2"), "{:?}", fewer.warnings);
    let one = STO.replace("nRows=2", "nRows=1");
    let [old, new] = [one.clone(), one.replace("version=1", "version=2")].map(|text| parse(&text, "x.sto").unwrap());
    assert_eq!((old.len(), old.warnings.len(), new.len(), new.warnings.len()), (1, 1, 2, 1));
    // Counts of which OpenSim reads the digits that lead.
    for (said, rows) in [("2.5", 2), ("2,5", 2), ("2.0", 2), ("1e2", 1)] {
        let odd = parse(&STO.replace("nRows=2", &format!("nRows={said}")), "x.sto").unwrap();
        let warning = format!("line 3: nRows is \"{said}\"; {rows} is taken, as in OpenSim");
        assert_eq!((odd.len(), &odd.warnings[0]), (rows, &warning));
    }
    // Numbers of Microsoft's libraries.
    let odd = STO.replace("             nan", "-1.#IND").replace("             inf", "1.#INF");
    assert!(parse(&odd, "x.sto").unwrap().rows[0][1].is_nan());
    // A byte-order mark, and labels that the header counts wrongly.
    let wrong = format!("\u{feff}{}", STO.replace("nColumns=3", "nColumns=7"));
    assert_eq!(parse(&wrong, "x.sto").unwrap().warnings.len(), 1);
}

#[test]
fn verif_broken_storages_are_refused_with_their_line() {
    for (change, to, expected) in [
        ("1.50000000", "1,50000000", "x.sto:11: column `a`: expected a number, found \"1,50000000\""),
        ("     -2.00000000", "", "x.sto:13: expected 3 values"),
        ("endheader\n", "", "x.sto: expected a line `endheader`"),
        ("nRows=2", "nRows=two", "x.sto:3: expected nRows to be a whole number, found \"two\""),
        ("time\ta", "t\ta", "x.sto:10: expected a column `time`"),
        ("      0.50000000", "     -0.50000000", "expected times that ascend, found -0.5 s after 0 s"),
    ] {
        let error = parse(&STO.replacen(change, to, 1), "x.sto").unwrap_err();
        assert!(error.contains(expected), "{change} -> {to}: {error}");
    }
    let quaternions = "DataType=Quaternion\nversion=3\nendheader\ntime\tm\n0\t1,2,3,4\n";
    assert!(parse(quaternions, "q.sto").unwrap_err().contains("q.sto:1: expected DataType"));
    assert!(parse("", "x.sto").is_err());
    assert!(Storage::read("/nowhere/x.sto").is_err());
}

/// Where a step is too small for a number as large as the time to change by it, resampling ends all the same.
#[test]
fn verif_resampling_is_bound() {
    let mut storage = Storage::new("late", vec!["a".to_owned()]);
    for i in 0..8 {
        storage.push(1e15 + f64::from(i), vec![f64::from(i)]);
    }
    storage.resample(1e-4, 3).unwrap();
    assert!(storage.len() <= 100_001, "{}", storage.len());
}

const TRC: &str = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t\
                   OrigDataStartFrame\tOrigNumFrames\n100.00\t100.00\t2\t2\tmm\t100.00\t1\t2\nFrame#\tTime\tR.Hand\t\t\
                   \tC7\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n1\t0.000\t1000\t2000\t3000\t\t\t\t\n2\t0.010\t1\t2\t3\t4\t\
                   5\t6\n";

#[test]
fn verif_marker_files_are_read_and_written() {
    let markers = Markers::parse(TRC.as_bytes(), Path::new("a.trc")).unwrap();
    assert_eq!(markers.names, ["R.Hand", "C7"]);
    assert!(markers.rows[0][0].y == 2.0 && markers.rows[0][1].x.is_nan());
    assert!((markers.rows[1][1].z - 0.006).abs() < 1e-15);
    let again = Markers::parse(markers.text("b.trc").as_bytes(), Path::new("b.trc")).unwrap();
    assert_eq!((again.names, again.time), (markers.names.clone(), markers.time.clone()));
    assert_eq!(again.rows[1], markers.rows[1]);
    assert_eq!((markers.nearest(-1.0), markers.nearest(0.006), markers.nearest(9.0)), (0, 1, 1));
}

#[test]
fn verif_broken_marker_files_are_refused_with_their_line() {
    for (change, to, expected) in [
        ("\tmm\t", "\tfurlong\t", "a.trc:3: expected Units m, cm or mm, found \"furlong\""),
        ("\t2\tmm", "\t3\tmm", "a.trc:4: expected a header"),
        ("C7", "R.Hand", "a.trc:4: two columns are called `R.Hand`"),
        ("3000", "3OOO", "a.trc:7: column `R.Hand`: expected a number"),
        ("2\t0.010", "2\t0.000", "a.trc:8: expected times that ascend"),
        ("PathFileType", "Storage", "a.trc:1: expected a header"),
        ("4\t5\t6", "4\t5\t6\t7", "a.trc:8: expected 8 values"),
    ] {
        let error = Markers::parse(TRC.replacen(change, to, 1).as_bytes(), Path::new("a.trc")).unwrap_err().to_string();
        assert!(error.contains(expected), "{change} -> {to}: {error}");
    }
}

proptest::proptest! {
    /// Whatever stands in a file: numbers or an error, never a panic.
    #[test]
    fn verif_no_text_panics(
        bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..60),
        at in 0usize..400,
        length in 0usize..20,
    ) {
        for text in [STO, TRC] {
            let at = at.min(text.len());
            let end = (at + length).min(text.len());
            let mixed = [&text.as_bytes()[..at], &bytes, &text.as_bytes()[end..]].concat();
            for input in [&bytes, &mixed] {
                let _ = Storage::parse(input, Path::new("x.mot"));
                let _ = Markers::parse(input, Path::new("x.trc"));
            }
        }
    }
}
