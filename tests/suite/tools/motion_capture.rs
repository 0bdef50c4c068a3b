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

/// Numbers of a parameter.
enum Values {
    Texts(Vec<String>),
    Bytes(Vec<u8>),
    Words(Vec<u16>),
    Reals(Vec<f32>),
}

/// A recording of known content, written as systems of different makes and ages do.
struct Recording {
    /// 84: Intel, 85: DEC, 86: MIPS.
    processor: u8,
    reals: bool,
    /// Analog samples without a sign.
    unsigned: bool,
    markers: usize,
    channels: usize,
    per_frame: usize,
    frames: usize,
    /// Number of the first frame.
    first: usize,
    /// A parameter that is left out, as `GROUP:NAME`.
    without: &'static str,
}

const RECORDING: Recording = Recording {
    processor: 84,
    reals: false,
    unsigned: false,
    markers: 3,
    channels: 2,
    per_frame: 4,
    frames: 30,
    first: 1,
    without: "",
};
/// Millimetres of an integer.
const PLACE_SCALE: f32 = 0.25;
const RATE: f32 = 50.0;

impl Recording {
    fn word(&self, word: u16) -> [u8; 2] {
        if self.processor == 86 { word.to_be_bytes() } else { word.to_le_bytes() }
    }

    fn real(&self, real: f32) -> [u8; 4] {
        match self.processor {
            84 => real.to_le_bytes(),
            86 => real.to_be_bytes(),
            // DEC's exponent is larger by 2, and its words stand in the other order.
            _ => {
                let [a, b, c, d] = (4.0 * real).to_be_bytes();
                [b, a, d, c]
            }
        }
    }

    /// A coordinate as an integer.
    fn place(marker: usize, frame: usize, axis: usize) -> i16 {
        ((400 * marker + 70 * axis + frame % 97) as i16).wrapping_sub(300)
    }

    /// A sample as an integer: with a sign from −2000, else from 38000.
    fn sample(&self, channel: usize, sample: usize) -> i32 {
        let offset = if self.unsigned { 38_000 } else { -2_000 };
        (37 * channel + 11 * sample) as i32 % 4001 + offset
    }

    fn offset(&self, channel: usize) -> i32 {
        if self.unsigned { 40_000 + channel as i32 } else { 5 - channel as i32 }
    }

    fn scale(channel: usize) -> f32 {
        [0.5, 0.25, 0.125][channel % 3]
    }

    fn write(&self) -> Vec<u8> {
        use Values::{Bytes, Reals, Texts, Words};
        let numbered = |letter: &str, n: usize| Texts((1..=n).map(|i| format!("{letter}{i}")).collect());
        let long = |n: usize| Words(vec![(n & 0xffff) as u16, (n >> 16) as u16]);
        let last = self.first + self.frames - 1;
        let scale = if self.reals { -PLACE_SCALE } else { PLACE_SCALE };
        let channels = || 0..self.channels;
        let parameters = [
            (1, "POINT:USED", Words(vec![self.markers as u16])),
            (1, "POINT:SCALE", Reals(vec![scale])),
            (1, "POINT:RATE", Reals(vec![RATE])),
            (1, "POINT:FRAMES", Words(vec![self.frames.min(65_535) as u16])),
            (1, "POINT:UNITS", Texts(vec!["mm".to_owned()])),
            (1, "POINT:LABELS", numbered("M", self.markers)),
            (2, "ANALOG:USED", Bytes(vec![self.channels.min(255) as u8])),
            (2, "ANALOG:RATE", Reals(vec![RATE * self.per_frame as f32])),
            (2, "ANALOG:FORMAT", Texts(vec![if self.unsigned { "UNSIGNED" } else { "SIGNED" }.to_owned()])),
            (2, "ANALOG:GEN_SCALE", Reals(vec![2.0])),
            (2, "ANALOG:SCALE", Reals(channels().map(Recording::scale).collect())),
            (2, "ANALOG:OFFSET", Words(channels().map(|c| self.offset(c) as u16).collect())),
            (2, "ANALOG:UNITS", Texts(channels().map(|c| ["V", "mV"][c % 2].to_owned()).collect())),
            (2, "ANALOG:LABELS", numbered("A", self.channels)),
            (3, "TRIAL:ACTUAL_START_FIELD", long(self.first)),
            (3, "TRIAL:ACTUAL_END_FIELD", long(last)),
        ];
        let mut section = vec![0, 0, 0, self.processor];
        let mut record = |name: &str, group: i8, content: &[u8]| {
            section.extend([name.len() as u8, group as u8]);
            section.extend(name.as_bytes());
            section.extend(self.word(content.len() as u16 + 3));
            section.extend(content);
            section.push(0);
        };
        for (number, group) in [(-1, "POINT"), (-2, "ANALOG"), (-3, "TRIAL")] {
            record(group, number, &[]);
        }
        for (group, name, values) in parameters.iter().filter(|(_, name, _)| *name != self.without) {
            let name = name.rsplit(':').next().unwrap();
            let (kind, items): (i8, Vec<Vec<u8>>) = match values {
                Texts(texts) => {
                    let width = texts.iter().map(String::len).max().unwrap_or(0);
                    (-1, texts.iter().map(|text| format!("{text:width$}").into_bytes()).collect())
                }
                Bytes(bytes) => (1, bytes.iter().map(|byte| vec![*byte]).collect()),
                Words(words) => (2, words.iter().map(|word| self.word(*word).to_vec()).collect()),
                Reals(reals) => (4, reals.iter().map(|real| self.real(*real).to_vec()).collect()),
            };
            // A size has one byte: what goes on is NAME2, NAME3, ….
            for (i, part) in items.chunks(255).enumerate() {
                let name = if i == 0 { name.to_owned() } else { format!("{name}{}", i + 1) };
                let width = (kind == -1).then(|| part[0].len() as u8);
                let sizes: Vec<u8> = width.into_iter().chain([part.len() as u8]).collect();
                record(&name, *group, &[&[kind as u8, sizes.len() as u8], sizes.as_slice(), &part.concat()].concat());
            }
        }
        section.extend([0, 0]);
        section.resize(section.len().div_ceil(512) * 512, 0);
        let mut bytes = vec![2, 0x50];
        for word in [self.markers, self.channels * self.per_frame, self.first, last, 0] {
            bytes.extend(self.word(word.min(65_535) as u16));
        }
        bytes.extend(self.real(scale));
        bytes.extend(self.word((2 + section.len() / 512) as u16));
        bytes.extend(self.word(self.per_frame as u16));
        bytes.extend(self.real(RATE));
        bytes.resize(512, 0);
        bytes.extend(section);
        for frame in 0..self.frames {
            for marker in 0..self.markers {
                let hidden = marker == 1 && frame % 10 == 3;
                for axis in 0..3 {
                    let place = Recording::place(marker, frame, axis);
                    if self.reals {
                        bytes.extend(self.real(f32::from(place) * PLACE_SCALE));
                    } else {
                        bytes.extend(self.word(place as u16));
                    }
                }
                let residual: i16 = if hidden { -1 } else { 0x0302 };
                if self.reals {
                    bytes.extend(self.real(residual.into()));
                } else {
                    bytes.extend(self.word(residual as u16));
                }
            }
            for sample in frame * self.per_frame..(frame + 1) * self.per_frame {
                for channel in 0..self.channels {
                    let value = self.sample(channel, sample);
                    if self.reals {
                        bytes.extend(self.real(value as f32));
                    } else {
                        bytes.extend(self.word(value as u16));
                    }
                }
            }
        }
        bytes.resize(bytes.len().div_ceil(512) * 512, 0);
        bytes
    }

    /// Compares every number with what was written.
    fn check(&self, found: &MotionCapture) {
        let Recording { processor, reals, .. } = self;
        let samples = if self.channels == 0 { 0 } else { self.frames * self.per_frame };
        let what = format!("processor {processor}, reals {reals}, without {:?}", self.without);
        assert_eq!((found.markers.names.len(), found.markers.rows.len()), (self.markers, self.frames), "{what}");
        assert_eq!((found.analog.labels.len(), found.analog.len()), (self.channels, samples), "{what}");
        for (frame, row) in found.markers.rows.iter().enumerate() {
            for (marker, place) in row.iter().enumerate() {
                let hidden = marker == 1 && frame % 10 == 3;
                for axis in 0..3 {
                    let expected = f64::from(Recording::place(marker, frame, axis)) * f64::from(PLACE_SCALE) / 1000.0;
                    let right = if hidden { place[axis].is_nan() } else { (place[axis] - expected).abs() < 1e-12 };
                    assert!(right, "{what}: marker {marker}, frame {frame}: {place}, expected {expected}");
                }
            }
        }
        for (sample, row) in found.analog.rows.iter().enumerate() {
            for (channel, value) in row.iter().enumerate() {
                let offset = if self.without == "ANALOG:OFFSET" { 0 } else { self.offset(channel) };
                let scale = if self.without == "ANALOG:SCALE" { 1.0 } else { f64::from(Recording::scale(channel)) };
                let general = if self.without == "ANALOG:GEN_SCALE" { 1.0 } else { 2.0 };
                let expected = f64::from(self.sample(channel, sample) - offset) * scale * general;
                assert!((value - expected).abs() < 1e-9, "{what}: channel {channel}: {value}, expected {expected}");
            }
        }
        let step = 1.0 / f64::from(RATE);
        assert!((found.markers.time[1] - step).abs() < 1e-12, "{what}");
        assert!(self.channels == 0 || (found.analog.time[self.per_frame] - step).abs() < 1e-12, "{what}");
    }
}

#[test]
fn verif_every_processor_and_width_of_number_is_read() {
    for processor in [84, 85, 86] {
        for (reals, unsigned) in [(false, false), (false, true), (true, false), (true, true)] {
            let recording = Recording { processor, reals, unsigned, ..RECORDING };
            let found = MotionCapture::parse(&recording.write()).unwrap();
            recording.check(&found);
            assert_eq!(found.markers.names, ["M1", "M2", "M3"]);
            assert_eq!((found.analog.labels.join(" "), found.units.join(" ")), ("A1 A2".into(), "V mV".into()));
            assert!(found.warnings.is_empty(), "{:?}", found.warnings);
        }
    }
}

/// What no instrument records is missing, and what would make every sample so is refused.
#[test]
fn verif_numbers_that_are_not_finite_are_told() {
    let bytes = Recording { reals: true, channels: 3, ..RECORDING }.write();
    let with = |number: f32, other: f32| {
        let mut bytes = bytes.clone();
        let at = bytes.windows(4).position(|four| four == number.to_le_bytes()).unwrap();
        bytes[at..][..4].copy_from_slice(&other.to_le_bytes());
        MotionCapture::parse(&bytes)
    };
    let first = RECORDING.sample(1, 0) as f32;
    let found = with(first, f32::INFINITY).unwrap();
    assert!(found.analog.rows[0][1].is_nan() && found.analog.rows[1][1].is_finite());
    assert_eq!(found.warnings, ["channel `A2`: 1 samples are not finite: missing"]);
    let error = with(Recording::scale(2), f32::NAN).unwrap_err().to_string();
    assert!(error.contains("expected a finite ANALOG:SCALE, found NaN"), "{error}");
}

/// A parameter's sizes have one byte: with more than 255 entries it goes on in the next, LABELS2.
#[test]
fn verif_parameters_go_on_in_further_ones() {
    let recording =
        Recording { markers: 70, channels: 600, per_frame: 1, frames: 4, without: "ANALOG:USED", ..RECORDING };
    let found = MotionCapture::parse(&recording.write()).unwrap();
    recording.check(&found);
    assert_eq!((found.analog.labels[255].as_str(), found.analog.labels[599].as_str()), ("A256", "A600"));
    assert_eq!((found.units[298].as_str(), found.units[599].as_str()), ("V", "mV"));
    let recording = Recording { markers: 300, channels: 0, frames: 4, ..RECORDING };
    let found = MotionCapture::parse(&recording.write()).unwrap();
    recording.check(&found);
    assert_eq!((found.markers.names[255].as_str(), found.markers.names[299].as_str()), ("M256", "M300"));
}

/// Numbers of frames in the header have two bytes; those of TRIAL four.
#[test]
fn verif_long_recordings_are_read_whole() {
    for (first, frames) in
        [(1, 65_535), (1, 65_536), (1, 70_000), (1, 140_000), (70_001, 40), (65_530, 10), (60_000, 6_000)]
    {
        let recording = Recording { markers: 1, channels: 1, per_frame: 1, first, frames, ..RECORDING };
        let mut bytes = recording.write();
        let found = MotionCapture::parse(&bytes).unwrap();
        recording.check(&found);
        assert!(found.warnings.is_empty(), "{:?}", found.warnings);
        // Some programs write what is left of a number that does not fit.
        for (word, number) in [(3, first), (4, first + frames - 1)] {
            bytes[2 * word..][..2].copy_from_slice(&(number as u16).to_le_bytes());
        }
        recording.check(&MotionCapture::parse(&bytes).unwrap());
        let cut = MotionCapture::parse(&bytes[..bytes.len() - 512]);
        assert!(cut.is_err() || frames > 40 && !cut.unwrap().warnings.is_empty(), "{first}, {frames}");
    }
    // Without TRIAL the header's numbers count; what lies behind is told of.
    let recording = Recording { markers: 1, channels: 0, frames: 200, ..RECORDING };
    let mut bytes = Recording { without: "TRIAL:ACTUAL_END_FIELD", ..recording }.write();
    bytes[8] = 100;
    let place = bytes.windows(6).position(|six| six == b"FRAMES").unwrap() + 6 + 5;
    bytes[place] = 100;
    let found = MotionCapture::parse(&bytes).unwrap();
    assert_eq!(found.markers.rows.len(), 100);
    assert!(found.warnings[0].contains("100 frames are read"), "{:?}", found.warnings);
}

/// What a file lacks stands in the header, or has a usual value, and is told of.
#[test]
fn verif_parameters_that_are_missing_have_defaults() {
    for (without, warnings) in [
        ("POINT:USED", 0),
        ("POINT:SCALE", 0),
        ("POINT:RATE", 0),
        ("POINT:FRAMES", 0),
        ("POINT:UNITS", 1),
        ("POINT:LABELS", 1),
        ("ANALOG:USED", 0),
        ("ANALOG:RATE", 0),
        ("ANALOG:FORMAT", 0),
        ("ANALOG:GEN_SCALE", 1),
        ("ANALOG:SCALE", 1),
        ("ANALOG:OFFSET", 1),
        ("ANALOG:UNITS", 0),
        ("ANALOG:LABELS", 1),
        ("TRIAL:ACTUAL_START_FIELD", 0),
        ("TRIAL:ACTUAL_END_FIELD", 0),
    ] {
        let recording = Recording { without, ..RECORDING };
        let found = MotionCapture::parse(&recording.write()).unwrap();
        recording.check(&found);
        assert_eq!(found.warnings.len(), warnings, "{without}: {:?}", found.warnings);
        let markers = if without == "POINT:LABELS" { "marker_1" } else { "M1" };
        let channels = if without == "ANALOG:LABELS" { "channel_1" } else { "A1" };
        assert_eq!((found.markers.names[0].as_str(), found.analog.labels[0].as_str()), (markers, channels));
        assert_eq!(found.units.len(), 2);
    }
}

#[test]
#[cfg_attr(not(has_shared_data), ignore = "needs shared recordings and setups (CARPUS_SHARED)")]
fn verif_shared_recordings_are_read_whole() {
    let folder = crate::reference::shared("faults");
    let read = |file: &str| MotionCapture::read(folder.join(file)).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(read("bug-03-c3d-long-recordings-cut/70000.c3d").markers.rows.len(), 70_000);
    assert_eq!(read("bug-11-c3d-first-frame-beyond-65535/x.c3d").markers.rows.len(), 40);
    for missing in [
        "ANALOG_GEN_SCALE",
        "ANALOG_LABELS",
        "ANALOG_OFFSET",
        "ANALOG_RATE",
        "ANALOG_SCALE",
        "ANALOG_UNITS",
        "POINT_LABELS",
        "POINT_UNITS",
    ] {
        let found = read(&format!("bug-10-c3d-without-an-analog-parameter/no_{missing}.c3d"));
        assert_eq!(
            (found.markers.rows.len(), found.markers.names.len(), found.analog.len()),
            (40, 4, 400),
            "{missing}"
        );
        assert!(
            (found.markers.time[1] - 0.01).abs() < 1e-12 && (found.analog.time[1] - 0.001).abs() < 1e-12,
            "{missing}"
        );
    }
}

/// Sizes are those of the data that are there, whatever is counted.
#[test]
fn verif_counts_that_contradict_the_data_are_refused() {
    let bytes = std::fs::read(folder().join("float.c3d")).unwrap();
    let with = |words: &[(usize, u16)]| {
        let mut bytes = bytes.clone();
        words.iter().for_each(|(i, value)| bytes[2 * i..][..2].copy_from_slice(&value.to_le_bytes()));
        MotionCapture::parse(&bytes)
    };
    for (words, expected) in [
        (vec![(1, 24770), (4, 6401)], "the header counts 24770 markers, POINT:USED 3"),
        (vec![(1, 0), (2, 0)], "the header counts 0 markers, POINT:USED 3"),
        (vec![(2, 65535), (9, 65535)], "are not channels (3, ANALOG:USED) times samples per channel"),
        (vec![(2, 0)], "analog samples per frame (0) are not channels"),
        (vec![(8, 0)], "the data begin at block 0"),
        (vec![(8, 60_000)], "the file ends before its section of data"),
        (vec![(2, 30), (9, 7)], "are not channels (3, ANALOG:USED) times samples per channel"),
    ] {
        let error = with(&words).expect_err(expected).to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
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
