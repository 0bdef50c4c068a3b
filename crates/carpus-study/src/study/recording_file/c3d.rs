//! Motion capture files: their analog channels, as a table.

use carpus_osim::storage::MotionCapture;

use super::error::RecordingFileError;
use super::format::Format;
use super::recorded_table::RecordedTable;
use crate::study::limits::MIN_SAMPLES;

/// The table of analog channels.
///
/// # Errors
/// Bytes that are no such file; no channels.
pub fn tables(bytes: &[u8]) -> Result<Vec<RecordedTable>, RecordingFileError> {
    let found = MotionCapture::parse(bytes).map_err(|error| RecordingFileError::Broken {
        format: Format::C3d,
        place: "header, parameters or data".to_owned(),
        expected: "a C3D file".to_owned(),
        found: error.to_string(),
    })?;
    let analog = found.analog;
    if analog.len() < MIN_SAMPLES {
        let found = format!("{} markers, {} analog samples", found.markers.names.len(), analog.len());
        return Err(RecordingFileError::NoTable { format: Format::C3d, rows: MIN_SAMPLES, found });
    }
    let mut table = RecordedTable::new("analog channels");
    table.push("time", "s", analog.time.clone());
    for (i, label) in analog.labels.iter().enumerate() {
        table.push(label, found.units.get(i).map_or("", String::as_str), analog.column(i));
    }
    Ok(vec![table.finished()])
}
