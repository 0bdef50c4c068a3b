//! European Data Format and its variants: signals of whole numbers, each with a rate of its own.
//!
//! In: bytes of an `.edf` or `.bdf` file. Out: a table of every sampling rate that signals have, with times from 0.
//! Annotations are not read.
//!
//! # References
//! Kemp et al. (1992), Electroencephalogr Clin Neurophysiol 82:391–393, doi:10.1016/0013-4694(92)90009-7; Kemp and
//! Olivan (2003), EDF+, Clin Neurophysiol 114:1755–1761, doi:10.1016/S1388-2457(03)00123-8; BioSemi, "Which file format
//! does BioSemi use?" (numbers of 24 bits).

use super::error::RecordingFileError;
use super::format::Format;
use super::recorded_table::RecordedTable;
use crate::study::limits::MIN_SAMPLES;

/// Bytes of the header, and of each signal in it.
const HEADER: usize = 256;
/// Most numbers of a file: a gigabyte of them.
const MOST_NUMBERS: usize = 1 << 27;

/// A signal as the header describes it.
struct Signal {
    label: String,
    unit: String,
    /// Samples in a record.
    samples: usize,
    /// Physical value of 0, and of one unit of the numbers.
    offset: f64,
    gain: f64,
}

/// The tables of a file.
///
/// # Errors
/// Bytes that are no such file; recordings with pauses; too much.
pub fn tables(bytes: &[u8]) -> Result<Vec<RecordedTable>, RecordingFileError> {
    let is_24_bits = bytes.first() == Some(&0xFF);
    let width = if is_24_bits { 3 } else { 2 };
    let field = |from: usize, length: usize, place: &str| -> Result<String, RecordingFileError> {
        let cut = || broken(place, "a header", format!("{} bytes", bytes.len()));
        let found = bytes.get(from..from + length).ok_or_else(cut)?;
        Ok(found.iter().map(|b| char::from(*b)).collect::<String>().trim().to_owned())
    };
    let number = |from: usize, length: usize, place: &str| -> Result<f64, RecordingFileError> {
        let text = field(from, length, place)?;
        let number = text.parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| broken(place, "a number", format!("`{text}`")))
    };
    let count = |from: usize, length: usize, place: &str| -> Result<usize, RecordingFileError> {
        let value = number(from, length, place)?;
        let is_count = (0.0..=1e9).contains(&value) && value.fract() == 0.0;
        if is_count { Ok(value as usize) } else { Err(broken(place, "a count", value)) }
    };
    if field(192, 44, "reserved part of the header")?.get(1..).is_some_and(|kind| kind.starts_with("DF+D")) {
        let what = "an EDF+ or BDF+ file with pauses (EDF+D, BDF+D)".to_owned();
        return Err(RecordingFileError::NotRead { what, hint: "export the parts as files of their own" });
    }
    let duration = number(244, 8, "duration of a record")?;
    let n = count(252, 4, "number of signals")?;
    let start = HEADER * (n + 1);
    if bytes.len() < start {
        return Err(broken("header", &format!("{start} bytes for {n} signals"), format!("{} bytes", bytes.len())));
    }
    let mut signals = Vec::new();
    for i in 0..n {
        // Of each property, all signals stand together.
        let at = |before: usize, length: usize| HEADER + n * before + i * length;
        let place = |what: &str| format!("{what} of signal {}", i + 1);
        let [low, high] =
            [number(at(104, 8), 8, &place("physical minimum"))?, number(at(112, 8), 8, &place("physical maximum"))?];
        let [first, last] =
            [number(at(120, 8), 8, &place("digital minimum"))?, number(at(128, 8), 8, &place("digital maximum"))?];
        let label = field(at(0, 16), 16, &place("label"))?;
        if first == last {
            return Err(broken(&place("digital minimum"), "less than the digital maximum", first));
        }
        let gain = (high - low) / (last - first);
        let offset = low - gain * first;
        let unit = field(at(96, 8), 8, &place("unit"))?;
        signals.push(Signal { label, unit, samples: count(at(216, 8), 8, &place("samples"))?, offset, gain });
    }
    let in_record: usize = signals.iter().map(|signal| signal.samples).sum();
    let data = &bytes[start..];
    // What a recorder that was switched off could not correct in the header is what is there.
    let records = data.len().checked_div(in_record * width).unwrap_or(0);
    let stated = number(236, 8, "number of records")?;
    if stated >= 0.0 && (records as f64) < stated {
        let (expected, found) = (format!("{stated} records, as the header says"), format!("{records}"));
        return Err(broken("records", &expected, found));
    }
    let records = if stated >= 0.0 { stated as usize } else { records };
    if !(duration > 0.0) {
        return Err(broken("duration of a record", "more than 0 s", duration));
    }
    if records.saturating_mul(in_record) > MOST_NUMBERS {
        return Err(RecordingFileError::TooLarge { format: Format::Edf, what: "samples", limit: MOST_NUMBERS });
    }
    let mut rates: Vec<usize> = Vec::new();
    let mut tables: Vec<RecordedTable> = Vec::new();
    let mut before = 0;
    for signal in &signals {
        let is_read = signal.samples * records >= MIN_SAMPLES && !is_of_annotations(&signal.label);
        if is_read {
            let samples = (0..records).flat_map(|record| {
                let from = (record * in_record + before) * width;
                data[from..from + signal.samples * width].chunks_exact(width)
            });
            let physical = |b: &[u8]| {
                let whole = match is_24_bits {
                    true => i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8,
                    false => i32::from(i16::from_le_bytes([b[0], b[1]])),
                };
                signal.offset + signal.gain * f64::from(whole)
            };
            let samples = samples.map(physical).collect();
            let table = rates.iter().position(|rate| *rate == signal.samples).unwrap_or_else(|| {
                rates.push(signal.samples);
                tables.push(RecordedTable::new(&format!("{} Hz", signal.samples as f64 / duration)));
                tables.len() - 1
            });
            tables[table].push(&signal.label, &signal.unit, samples);
        }
        before += signal.samples;
    }
    if tables.is_empty() {
        let labels: Vec<&str> = signals.iter().map(|signal| signal.label.as_str()).take(12).collect();
        let found =
            format!("{records} records of {}", if labels.is_empty() { "no signal".into() } else { labels.join(", ") });
        return Err(RecordingFileError::NoTable { format: Format::Edf, rows: MIN_SAMPLES, found });
    }
    let with_times = |(table, samples): (RecordedTable, usize)| table.finished().with_rate(samples as f64 / duration);
    Ok(tables.into_iter().zip(rates).map(with_times).collect())
}

fn is_of_annotations(label: &str) -> bool {
    matches!(label, "EDF Annotations" | "BDF Annotations")
}

fn broken(place: &str, expected: &str, found: impl std::fmt::Display) -> RecordingFileError {
    RecordingFileError::Broken {
        format: Format::Edf,
        place: place.to_owned(),
        expected: expected.to_owned(),
        found: found.to_string(),
    }
}
