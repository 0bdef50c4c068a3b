//! Motion capture files, `.c3d`: marker trajectories and analog channels.
//!
//! In: bytes. Out: [`Markers`] and a [`Storage`] of the analog channels. The format is read by the crate `c3dio`; what it lets
//! pass is looked for here: files that are cut off, frames without a count, broken sections on which it gives up.
//!
//! # References
//! The C3D File Format, User Guide (Motion Lab Systems, 2021), <https://www.c3d.org>; OpenSim `C3DFileAdapter`: time begins at 0
//! with the first frame, a marker that is exactly at the origin or whose residual is −1 was not seen.

use std::cell::Cell;
use std::path::Path;

use nalgebra::Vector3;

use super::error::{StorageError, StorageProblem};
use super::trc::metres;
use super::{Markers, Storage};

/// Bytes of a block, in which sections of the file are counted.
const BLOCK: usize = 512;
/// Words of the header: analog samples of all channels in a frame, and of one channel.
const ANALOG_SAMPLES: usize = 2;
const SAMPLES_PER_CHANNEL: usize = 9;
/// Second byte of every file.
const KEY: u8 = 0x50;

/// What a motion capture file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionCapture {
    /// Marker trajectories; none if there are none.
    pub markers: Markers,
    /// Analog channels, scaled to their units; none if there are none. A label that was there before gets a number.
    pub analog: Storage,
    /// Unit of every analog channel, as the file has it.
    pub units: Vec<String>,
}

thread_local! {
    static READING: Cell<bool> = const { Cell::new(false) };
}

/// Whether this thread is reading a motion capture file: a panic then is a fault of the file, and will be reported as one.
pub fn reading_motion_capture() -> bool {
    READING.get()
}

impl MotionCapture {
    /// Reads a `.c3d` file.
    ///
    /// # Errors
    /// [`StorageError`]; the format has no lines.
    pub fn read(path: impl AsRef<Path>) -> Result<MotionCapture, StorageError> {
        let path = path.as_ref();
        let at = |problem| StorageError { file: path.to_owned(), line: 0, problem };
        let bytes = std::fs::read(path).map_err(|e| at(StorageProblem::Read(e)))?;
        MotionCapture::parse(&bytes).map_err(at)
    }

    /// Reads the bytes of a `.c3d` file.
    ///
    /// # Errors
    /// [`StorageProblem`].
    pub fn parse(bytes: &[u8]) -> Result<MotionCapture, StorageProblem> {
        let broken = |what: &str| StorageProblem::MotionCapture { what: what.to_owned() };
        if bytes.len() < 2 * BLOCK {
            return Err(broken("expected at least two blocks of 512 bytes"));
        }
        if bytes[1] != KEY {
            return Err(broken("expected the byte 0x50 in second place"));
        }
        let counts = Counts::of(bytes);
        counts.check(bytes)?;
        if counts.analog_samples > 0 || counts.samples_per_channel == 0 {
            return MotionCapture::of(&read_by_library(bytes)?);
        }
        // Without samples the library would still make room for channels.
        let mut bytes = bytes.to_vec();
        bytes[2 * SAMPLES_PER_CHANNEL..][..2].fill(0);
        MotionCapture::of(&read_by_library(&bytes)?)
    }

    fn of(file: &c3dio::C3d) -> Result<MotionCapture, StorageProblem> {
        let frames = usize::from(file.points.last_frame).saturating_sub(usize::from(file.points.first_frame)) + 1;
        let per_frame = usize::from(file.analog.samples_per_channel_per_frame);
        let found = if file.points.cols() > 0 {
            file.points.rows()
        } else {
            file.analog.rows().checked_div(per_frame).unwrap_or_default()
        };
        // The header counts to 65535; longer recordings have their count in the parameters.
        if found < frames {
            return Err(StorageProblem::RowCount { expected: frames, found });
        }
        let out = MotionCapture { markers: markers(&file.points)?, ..analog(&file.analog)? };
        if out.markers.time.is_empty() && out.analog.is_empty() {
            return Err(StorageProblem::NoRows);
        }
        Ok(out)
    }
}

fn read_by_library(bytes: &[u8]) -> Result<c3dio::C3d, StorageProblem> {
    let broken = |what: &str| StorageProblem::MotionCapture { what: what.to_owned() };
    READING.set(true);
    let read = std::panic::catch_unwind(|| c3dio::C3d::from_bytes(bytes));
    READING.set(false);
    read.map_err(|_| broken("sections point to places outside the file, or hold something other than what they say"))?
        .map_err(|e| broken(&words(&e)))
}

/// What the header counts. The library takes memory for as much before it looks whether the file holds it.
struct Counts {
    /// Of the bytes of a word the more significant first, as of MIPS processors.
    big_endian: bool,
    markers: usize,
    frames: usize,
    /// Of all channels in a frame.
    analog_samples: usize,
    /// Of a channel in a frame.
    samples_per_channel: usize,
    /// Block at which the data start, from 1.
    data: usize,
}

impl Counts {
    /// - `bytes`: at least one block
    fn of(bytes: &[u8]) -> Counts {
        let processor = BLOCK * usize::from(bytes[0]).saturating_sub(1) + 3;
        let big_endian = bytes.get(processor) == Some(&86);
        let word = |i: usize| word([bytes[2 * i], bytes[2 * i + 1]], big_endian);
        Counts {
            big_endian,
            markers: word(1).into(),
            frames: word(4).wrapping_sub(word(3)).wrapping_add(1).into(),
            analog_samples: word(ANALOG_SAMPLES).into(),
            samples_per_channel: word(SAMPLES_PER_CHANNEL).into(),
            data: word(8).into(),
        }
    }

    /// Whether the file can hold all that.
    fn check(&self, bytes: &[u8]) -> Result<(), StorageProblem> {
        let &Counts { markers, frames, analog_samples, samples_per_channel, .. } = self;
        let broken = |what| Err(StorageProblem::MotionCapture { what });
        if markers + analog_samples == 0 {
            return Err(StorageProblem::NoRows);
        }
        if self.data < 2 {
            return broken(format!("the data begin at block {}, which is before the end of the header", self.data));
        }
        // Integers of two bytes, four of them per marker.
        if frames * markers * 8 > bytes.len() {
            return broken(format!("the header counts {frames} frames of {markers} markers, more than the file holds"));
        }
        self.check_parameters(bytes)?;
        if samples_per_channel == 0 || analog_samples == 0 {
            return Ok(());
        }
        if analog_samples % samples_per_channel != 0 {
            return broken(words(&c3dio::C3dParseError::AnalogBytesPerFrameMismatch));
        }
        // How many channels there are is told by parameters: asked of the file without its data, one sample per channel.
        let Some(start) = bytes.get(..BLOCK * self.data) else {
            return broken(words(&c3dio::C3dParseError::InsufficientBlocks("data".to_owned())));
        };
        let mut start = start.to_vec();
        for (i, count) in [(ANALOG_SAMPLES, analog_samples / samples_per_channel), (SAMPLES_PER_CHANNEL, 1)] {
            start[2 * i..][..2].copy_from_slice(&pair(count as u16, self.big_endian));
        }
        read_by_library(&start).map(drop)
    }

    /// Whether groups and parameters follow each other and hold no more than their section: the library goes back 128 bytes for a
    /// name of −128 letters, for ever, and does not mind data that overlap.
    fn check_parameters(&self, bytes: &[u8]) -> Result<(), StorageProblem> {
        let broken = |what: &str| Err(StorageProblem::MotionCapture { what: what.to_owned() });
        let end = (BLOCK * self.data.saturating_sub(1)).min(bytes.len());
        let (mut at, mut held) = (BLOCK + 4, 0_usize);
        while at + 1 < end && bytes[at + 1] != 0 {
            let (letters, group) = (bytes[at] as i8, bytes[at + 1] as i8);
            if letters == i8::MIN {
                return broken("a parameter's name has -128 letters");
            }
            let pointer = at + 2 + usize::from(letters.unsigned_abs());
            // Where the section is cut off the library says so.
            let Some(&[a, b, kind, dimensions]) = bytes.get(pointer..pointer + 4) else { return Ok(()) };
            if group > 0 {
                let Some(sizes) = bytes.get(pointer + 4..pointer + 4 + usize::from(dimensions)) else { return Ok(()) };
                let count = sizes.iter().filter(|n| **n > 0).fold(1_usize, |all, n| all.saturating_mul((*n).into()));
                held = held.saturating_add(count.saturating_mul((kind as i8).unsigned_abs().into()));
                if held > end {
                    return broken("parameters hold more than their section");
                }
            }
            at = pointer + usize::from(word([a, b], self.big_endian));
        }
        Ok(())
    }
}

fn word(pair: [u8; 2], big_endian: bool) -> u16 {
    if big_endian { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) }
}

fn pair(word: u16, big_endian: bool) -> [u8; 2] {
    if big_endian { word.to_be_bytes() } else { word.to_le_bytes() }
}

fn rate_of(rate: f32, what: &str) -> Result<f64, StorageProblem> {
    let rate = f64::from(rate);
    let what = format!("expected a positive rate of {what}, found {rate}");
    if rate.is_finite() && rate > 0.0 { Ok(rate) } else { Err(StorageProblem::MotionCapture { what }) }
}

fn markers(points: &c3dio::Points) -> Result<Markers, StorageProblem> {
    if points.cols() == 0 || points.rows() == 0 {
        return Ok(Markers::default());
    }
    let data_rate = rate_of(points.frame_rate, "markers")?;
    let unit: String = points.units.iter().collect();
    let unit = unit.trim_matches(|c: char| c.is_whitespace() || c == '\0').to_owned();
    let factor = metres(&unit).ok_or(StorageProblem::Units { found: unit })?;
    let names: Vec<String> = (0..points.cols()).map(|i| label(&points.labels, i, "marker")).collect();
    if let Some((_, name)) = names.iter().enumerate().find(|(i, n)| names[..*i].contains(n)) {
        return Err(StorageProblem::SameLabel { label: name.clone() });
    }
    let place = |p: &c3dio::MarkerPoint| {
        let seen = p.residual >= 0.0 && p.point != [0.0; 3] && p.point.iter().all(|v| v.is_finite());
        if seen { Vector3::from(p.point.map(f64::from)) * factor } else { Vector3::from_element(f64::NAN) }
    };
    let rows = (0..points.rows()).map(|i| points.iter_row(i).map(place).collect()).collect();
    let time = (0..points.rows()).map(|i| i as f64 / data_rate).collect();
    Ok(Markers { names, time, rows, data_rate })
}

fn analog(analog: &c3dio::Analog) -> Result<MotionCapture, StorageProblem> {
    if analog.cols() == 0 || analog.rows() == 0 {
        return Ok(MotionCapture::default());
    }
    let rate = rate_of(analog.rate, "analog channels")?;
    let mut storage = Storage::new("analog channels", Vec::new());
    for i in 0..analog.cols() {
        let given = label(&analog.labels, i, "channel");
        let taken = |name: &String| storage.labels.contains(name);
        let name = std::iter::once(given.clone()).chain((2..).map(|k| format!("{given}_{k}"))).find(|n| !taken(n));
        let name = name.unwrap_or_default();
        if name != given {
            storage.warnings.push(format!("a further channel `{given}` is called `{name}`"));
        }
        storage.labels.push(name);
    }
    for i in 0..analog.rows() {
        storage.push(i as f64 / rate, analog.iter_row(i).copied().collect());
    }
    let unit = |i: usize| analog.units.get(i).map_or("", |u| u.trim()).trim_matches('\0').to_owned();
    Ok(MotionCapture { units: (0..analog.cols()).map(unit).collect(), analog: storage, ..MotionCapture::default() })
}

/// A label without its padding; with its number where there is none.
fn label(labels: &[String], i: usize, what: &str) -> String {
    let text = labels.get(i).map_or("", |l| l.trim_matches(|c: char| c.is_whitespace() || c == '\0'));
    if text.is_empty() { format!("{what}_{}", i + 1) } else { text.to_owned() }
}

/// What the library says, in words.
fn words(error: &c3dio::C3dParseError) -> String {
    use c3dio::C3dParseError as E;
    match error {
        E::InsufficientBlocks(section) => format!("the file ends before its section of {section}"),
        E::InvalidProcessorType => "expected processor type 84 (Intel), 85 (DEC) or 86 (MIPS)".to_owned(),
        E::RequiredParameterNotFound(name) => format!("no parameter {name}"),
        E::ParameterNotFound(group, name) => format!("no parameter {group}:{name}"),
        E::AnalogOffsetScaleMismatch | E::InsufficientAnalogOffsets => {
            "ANALOG:OFFSET and ANALOG:SCALE do not have one number per channel".to_owned()
        }
        E::AnalogBytesPerFrameMismatch => {
            "analog samples per frame are not channels (ANALOG:USED) times samples per channel".to_owned()
        }
        E::InvalidData(_, kind) => {
            format!("a parameter holds other data than {kind} (ANALOG:OFFSET has to be integers, for OpenSim too)")
        }
        E::FrameRateMismatch(header, parameter) => {
            format!("the header says {header} frames per second, POINT:RATE {parameter}")
        }
        E::ScaleFactorMismatch(header, parameter) => {
            format!("the header says a scale of {header}, POINT:SCALE {parameter}")
        }
        other => format!("{other:?}"),
    }
}
