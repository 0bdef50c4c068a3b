//! Motion capture files, `.c3d`: marker trajectories and analog channels.
//!
//! In: bytes, as processors of Intel, DEC and MIPS write them, numbers as integers or reals. Out: [`Markers`] and a
//! [`Storage`] of the analog channels. A file has a header of one block, parameters ([`Parameters`]) and data, frame
//! after frame. What header and parameters both say is taken from the parameters; what parameters do not say from the
//! header. Sizes are those of the data that are there. Force plates, events and rotations are not read.
//!
//! # References
//! The C3D File Format, User Guide (Motion Lab Systems, 2021), <https://www.c3d.org>; OpenSim `C3DFileAdapter`: time
//! begins at 0 with the first frame, a marker that is exactly at the origin or whose residual is −1 was not seen.

mod parameters;

use std::collections::{HashMap, HashSet};
use std::path::Path;

use nalgebra::Vector3;

use super::error::{StorageError, StorageProblem};
use super::table::Storage;
use super::trc::Markers;
use super::words::metres;
use parameters::{Parameters, Processor, broken};

/// Bytes of a block, in which places in the file are counted.
const BLOCK: usize = 512;
/// Second byte of every file.
const KEY: u8 = 0x50;
/// Unit of length where the file says none: that of the format's user guide, and what systems of motion capture write.
const USUAL_UNIT: &str = "mm";
/// Relative difference from which on two statements of the same rate or scale contradict each other: both are reals of
/// four bytes, often printed and read again with five digits.
const SAME: f64 = 1e-4;
/// Largest number of an integer of two bytes, which counts of more than that stop at.
const MOST_OF_A_WORD: usize = 65_535;
/// Numbers and residual of a marker in a frame.
const PER_MARKER: usize = 4;

/// What a motion capture file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionCapture {
    /// Marker trajectories; none if there are none.
    pub markers: Markers,
    /// Analog channels, scaled to their units; none if there are none. A label that was there before gets a number.
    pub analog: Storage,
    /// Unit of every analog channel, as the file has it.
    pub units: Vec<String>,
    /// What was odd about the file, to be told to the user.
    pub warnings: Vec<String>,
}

impl MotionCapture {
    /// Reads a `.c3d` file.
    ///
    /// # Errors
    /// [`StorageError`]; the format has no lines.
    pub fn read(path: impl AsRef<Path>) -> Result<MotionCapture, StorageError> {
        let path = path.as_ref();
        let at = |problem| StorageError { file: path.to_owned(), line: 0, problem };
        let bytes = carpus_numerics::regular_file::read(path).map_err(|e| at(StorageProblem::Read(e)))?;
        MotionCapture::parse(&bytes).map_err(at)
    }

    /// Reads the bytes of a `.c3d` file.
    ///
    /// # Errors
    /// [`StorageProblem`].
    pub fn parse(bytes: &[u8]) -> Result<MotionCapture, StorageProblem> {
        if bytes.len() < 2 * BLOCK {
            return Err(broken("expected at least two blocks of 512 bytes"));
        }
        if bytes[1] != KEY {
            return Err(broken("expected the byte 0x50 in second place"));
        }
        let start = usize::from(bytes[0]).checked_sub(1).filter(|block| *block > 0);
        let start = BLOCK * start.ok_or_else(|| broken(format!("the parameters begin at block {}", bytes[0])))?;
        let found = *bytes.get(start + 3).ok_or_else(|| broken("the file ends before its section of parameters"))?;
        let processor = Processor::of(found).ok_or_else(|| {
            broken(format!("expected processor type 84 (Intel), 85 (DEC) or 86 (MIPS), found {found}"))
        })?;
        let header = Header::of(bytes, processor);
        if BLOCK * header.data.saturating_sub(1) <= start {
            let what = format!("the data begin at block {}, which is before the end of the parameters", header.data);
            return Err(broken(what));
        }
        let data_start = BLOCK * (header.data - 1);
        let data = bytes.get(data_start..).ok_or_else(|| broken("the file ends before its section of data"))?;
        let parameters = Parameters::of(&bytes[start..data_start], processor)?;
        let mut warnings = Vec::new();
        let layout = Layout::of(&header, &parameters, data, &mut warnings)?;
        let markers = layout.markers(&parameters, data, &mut warnings)?;
        let (analog, units) = layout.analog(&parameters, data, &mut warnings)?;
        if markers.time.is_empty() && analog.is_empty() {
            return Err(StorageProblem::NoRows);
        }
        Ok(MotionCapture { markers, analog, units, warnings })
    }
}

/// What the first block says.
struct Header {
    markers: usize,
    /// Analog samples of all channels in a frame.
    analog_samples: usize,
    /// Numbers of the first and last frame; they count to 65535.
    frames: [usize; 2],
    /// Unit of integers [unit of length]; negative: the data are reals.
    scale: f64,
    /// Block at which the data start, from 1.
    data: usize,
    /// Analog samples of a channel in a frame.
    samples_per_channel: usize,
    /// Frames per second [Hz].
    rate: f64,
}

impl Header {
    /// - `bytes`: at least one block
    fn of(bytes: &[u8], processor: Processor) -> Header {
        // The user guide counts words of two bytes from 1.
        let word = |i: usize| usize::from(processor.word([bytes[2 * i - 2], bytes[2 * i - 1]]));
        let real = |i: usize| processor.real([0, 1, 2, 3].map(|k| bytes[2 * i - 2 + k]));
        Header {
            markers: word(2),
            analog_samples: word(3),
            frames: [word(4), word(5)],
            scale: real(7),
            data: word(9),
            samples_per_channel: word(10),
            rate: real(11),
        }
    }
}

/// How the data lie in the file.
struct Layout {
    processor: Processor,
    markers: usize,
    channels: usize,
    /// Analog samples of a channel in a frame.
    per_frame: usize,
    frames: usize,
    /// Unit of integers [unit of length]; `None`: the data are reals.
    scale: Option<f64>,
    /// Frames per second [Hz]; what the file says.
    frame_rate: f64,
    /// Samples per second [Hz]; what the file says.
    sample_rate: f64,
}

impl Layout {
    fn of(
        header: &Header,
        parameters: &Parameters<'_>,
        data: &[u8],
        warnings: &mut Vec<String>,
    ) -> Result<Layout, StorageProblem> {
        let used = |group: &str| parameters.count(group, "USED");
        let markers = used("POINT")?.unwrap_or(header.markers);
        if markers != header.markers {
            return Err(broken(format!("the header counts {} markers, POINT:USED {markers}", header.markers)));
        }
        let (all, mut per_frame) = (header.analog_samples, header.samples_per_channel);
        let channels = match used("ANALOG")? {
            Some(channels) => channels,
            None => all.checked_div(per_frame).unwrap_or(all),
        };
        if per_frame == 0 {
            per_frame = all.checked_div(channels).unwrap_or(0);
        }
        if channels * per_frame != all {
            return Err(broken(format!(
                "analog samples per frame ({all}) are not channels ({channels}, ANALOG:USED) times samples per channel \
                 ({per_frame})"
            )));
        }
        let scale = stated("scale", header.scale, parameters.real("POINT", "SCALE")?, "POINT:SCALE", warnings);
        if (scale < 0.0) != (header.scale < 0.0) || !scale.is_finite() {
            return Err(broken(format!(
                "a scale below 0 says that the data are reals; the header says {}, POINT:SCALE {scale}",
                header.scale
            )));
        }
        let rate = stated(
            "number of frames per second",
            header.rate,
            parameters.real("POINT", "RATE")?,
            "POINT:RATE",
            warnings,
        );
        let sample_rate = match parameters.real("ANALOG", "RATE")? {
            Some(rate) if rate > 0.0 => rate,
            _ => rate * per_frame as f64,
        };
        // Without markers the rate of frames may be left out.
        let frame_rate = if rate == 0.0 && per_frame > 0 { sample_rate / per_frame as f64 } else { rate };
        let mut layout = Layout {
            processor: parameters.processor,
            markers,
            channels,
            per_frame,
            frames: 0,
            scale: (scale >= 0.0).then_some(scale),
            frame_rate,
            sample_rate,
        };
        if channels > 0 && markers > 0 && differ(sample_rate, frame_rate * per_frame as f64) {
            let expected = frame_rate * per_frame as f64;
            warnings.push(format!(
                "ANALOG:RATE is {sample_rate} Hz, but {per_frame} samples in each of {frame_rate} frames per second \
                 are {expected} Hz, which are taken"
            ));
            layout.sample_rate = expected;
        }
        layout.frames = layout.count_of_frames(header, parameters, data, warnings)?;
        Ok(layout)
    }

    /// Bytes of a number.
    fn width(&self) -> usize {
        if self.scale.is_some() { 2 } else { 4 }
    }

    /// Bytes of the markers of a frame.
    fn marker_bytes(&self) -> usize {
        self.width() * PER_MARKER * self.markers
    }

    /// Bytes of a frame.
    fn stride(&self) -> usize {
        self.marker_bytes() + self.width() * self.channels * self.per_frame
    }

    /// How many frames there are. The header counts to 65535, TRIAL in numbers of 32 bits; programs that cut a
    /// recording
    /// correct the one or the other. The largest count that the file can hold is right.
    fn count_of_frames(
        &self,
        header: &Header,
        parameters: &Parameters<'_>,
        data: &[u8],
        warnings: &mut Vec<String>,
    ) -> Result<usize, StorageProblem> {
        if self.stride() == 0 {
            return Err(StorageProblem::NoRows);
        }
        let held = data.len() / self.stride();
        let from_to = |first: usize, last: usize| last.checked_sub(first).map(|n| n + 1);
        let first = parameters.long_count("TRIAL", "ACTUAL_START_FIELD")?;
        let last = parameters.long_count("TRIAL", "ACTUAL_END_FIELD")?;
        let long = first.zip(last).and_then(|(first, last)| from_to(first, last));
        // Where a count of two bytes ends it says no more than "many".
        let exact = |n: &usize| *n < MOST_OF_A_WORD || long.is_none();
        let [first, last] = header.frames;
        let counts = [
            ("TRIAL", long),
            ("the header", Some(last).filter(exact).and_then(|last| from_to(first, last))),
            ("POINT:LONG_FRAMES", parameters.count("POINT", "LONG_FRAMES")?),
            ("POINT:FRAMES", parameters.count("POINT", "FRAMES")?.filter(exact)),
        ];
        let said: Vec<(&str, usize)> =
            counts.iter().filter_map(|(who, n)| Some((*who, n.filter(|n| *n > 0)?))).collect();
        let Some(&(who, frames)) = said.iter().filter(|(_, n)| *n <= held).max_by_key(|(_, n)| *n) else {
            let &(_, expected) = said.first().ok_or(StorageProblem::NoRows)?;
            return Err(StorageProblem::RowCount { expected, found: held });
        };
        if let Some((first, n)) = said.first().filter(|(first, n)| *n != frames && *first == "TRIAL") {
            warnings
                .push(format!("{first} counts {n} frames, {who} {frames}; the file holds {held}: {frames} are read"));
        }
        // The last block is filled up.
        if data.len() - frames * self.stride() >= BLOCK.max(self.stride()) {
            warnings.push(format!("{frames} frames are read, as {who} counts; the file has room for {held}"));
        }
        Ok(frames)
    }

    /// The `i`-th number of some bytes, as it is written.
    fn number(&self, bytes: &[u8], i: usize, signed: bool) -> f64 {
        if self.scale.is_none() {
            return self.processor.real([0, 1, 2, 3].map(|k| bytes[4 * i + k]));
        }
        let word = self.processor.word([bytes[2 * i], bytes[2 * i + 1]]);
        if signed { f64::from(word as i16) } else { f64::from(word) }
    }

    fn markers(
        &self,
        parameters: &Parameters<'_>,
        data: &[u8],
        warnings: &mut Vec<String>,
    ) -> Result<Markers, StorageProblem> {
        if self.markers == 0 {
            return Ok(Markers::default());
        }
        let data_rate = positive(self.frame_rate, "markers")?;
        let unit = parameters.texts("POINT", "UNITS")?.into_iter().next().filter(|unit| !unit.is_empty());
        let unit = unit.unwrap_or_else(|| {
            warnings.push(format!("no POINT:UNITS: places of markers are taken to be in {USUAL_UNIT}"));
            USUAL_UNIT.to_owned()
        });
        let factor = self.scale.unwrap_or(1.0) * metres(&unit).ok_or(StorageProblem::Units { found: unit })?;
        let names = labels(&parameters.texts("POINT", "LABELS")?, self.markers, "marker");
        let mut taken = HashSet::new();
        if let Some(name) = names.iter().find(|name| !taken.insert(name.as_str())) {
            return Err(StorageProblem::SameLabel { label: name.clone() });
        }
        if parameters.texts("POINT", "LABELS")?.is_empty() {
            warnings.push("no POINT:LABELS: markers are numbered".to_owned());
        }
        let place = |bytes: &[u8]| {
            let [x, y, z, residual] = [0, 1, 2, 3].map(|k| self.number(bytes, k, true));
            let place = Vector3::new(x, y, z);
            let seen = residual >= 0.0 && place != Vector3::zeros() && place.iter().all(|v| v.is_finite());
            if seen { place * factor } else { Vector3::from_element(f64::NAN) }
        };
        let frames = data.chunks_exact(self.stride()).take(self.frames);
        let row =
            |frame: &[u8]| frame[..self.marker_bytes()].chunks_exact(self.width() * PER_MARKER).map(place).collect();
        let rows = frames.map(row).collect();
        let time = (0..self.frames).map(|i| i as f64 / data_rate).collect();
        Ok(Markers { names, time, rows, data_rate, ..Markers::default() })
    }

    /// The channels and their units.
    fn analog(
        &self,
        parameters: &Parameters<'_>,
        data: &[u8],
        warnings: &mut Vec<String>,
    ) -> Result<(Storage, Vec<String>), StorageProblem> {
        if self.channels == 0 {
            return Ok(Default::default());
        }
        let rate = positive(self.sample_rate, "analog channels")?;
        let unsigned =
            parameters.texts("ANALOG", "FORMAT")?.first().is_some_and(|f| f.eq_ignore_ascii_case("unsigned"));
        let mut per_channel = |name: &str, signed: bool, otherwise: f64| {
            let values = parameters.numbers("ANALOG", name, signed)?;
            match values.len() {
                0 => {
                    warnings.push(format!("no ANALOG:{name}: {otherwise} is taken"));
                    Ok(vec![otherwise; self.channels])
                }
                found if found < self.channels => {
                    Err(broken(format!("ANALOG:{name} has {found} numbers for {} channels", self.channels)))
                }
                _ => Ok(values),
            }
        };
        let scales = per_channel("SCALE", true, 1.0)?;
        let offsets = per_channel("OFFSET", !unsigned, 0.0)?;
        let scale = parameters.real("ANALOG", "GEN_SCALE")?.unwrap_or_else(|| {
            warnings.push("no ANALOG:GEN_SCALE: 1 is taken".to_owned());
            1.0
        });
        for (name, numbers) in [("SCALE", &scales[..]), ("OFFSET", &offsets), ("GEN_SCALE", &[scale])] {
            if let Some(wrong) = numbers.iter().take(self.channels).find(|number| !number.is_finite()) {
                return Err(broken(format!("expected a finite ANALOG:{name}, found {wrong}")));
            }
        }
        let given = parameters.texts("ANALOG", "LABELS")?;
        if given.is_empty() {
            warnings.push("no ANALOG:LABELS: channels are numbered".to_owned());
        }
        let mut storage = Storage::new("analog channels", Vec::new());
        let (mut taken, mut times) = (HashSet::new(), HashMap::<String, usize>::new());
        for given in labels(&given, self.channels, "channel") {
            let mut name = given.clone();
            while !taken.insert(name.clone()) {
                let time = times.entry(given.clone()).or_insert(1);
                *time += 1;
                name = format!("{given}_{time}");
            }
            if name != given {
                warnings.push(format!("a further channel `{given}` is called `{name}`"));
            }
            storage.labels.push(name);
        }
        for frame in data.chunks_exact(self.stride()).take(self.frames) {
            for sample in frame[self.marker_bytes()..].chunks_exact(self.width() * self.channels) {
                let value = |i: usize| (self.number(sample, i, !unsigned) - offsets[i]) * scales[i] * scale;
                storage.push(storage.len() as f64 / rate, (0..self.channels).map(value).collect());
            }
        }
        for i in 0..self.channels {
            let mut missing = 0;
            for row in storage.rows.iter_mut().filter(|row| !row[i].is_finite()) {
                row[i] = f64::NAN;
                missing += 1;
            }
            if missing > 0 {
                warnings.push(format!("channel `{}`: {missing} samples are not finite: missing", storage.labels[i]));
            }
        }
        let mut units = parameters.texts("ANALOG", "UNITS")?;
        units.resize(self.channels, String::new());
        Ok((storage, units))
    }
}

/// What header and parameter say of the same: the parameter's, and a warning if the header says otherwise.
fn stated(what: &str, header: f64, parameter: Option<f64>, name: &str, warnings: &mut Vec<String>) -> f64 {
    let Some(parameter) = parameter else { return header };
    if differ(header, parameter) {
        warnings.push(format!("the header says a {what} of {header}, {name} {parameter}, which is taken"));
    }
    parameter
}

fn differ(a: f64, b: f64) -> bool {
    !((a - b).abs() <= SAME * a.abs().max(b.abs()))
}

fn positive(rate: f64, what: &str) -> Result<f64, StorageProblem> {
    let wrong = || broken(format!("expected a positive rate of {what}, found {rate}"));
    if rate.is_finite() && rate > 0.0 { Ok(rate) } else { Err(wrong()) }
}

/// Labels of all columns; with its number where there is none.
fn labels(given: &[String], n: usize, what: &str) -> Vec<String> {
    let label = |i: usize| given.get(i).filter(|text| !text.is_empty()).cloned();
    (0..n).map(|i| label(i).unwrap_or_else(|| format!("{what}_{}", i + 1))).collect()
}
