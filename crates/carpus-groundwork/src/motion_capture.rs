//! What a motion capture file holds, as text files.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::account::csv_text;
use super::diagnostic::{Diagnostic, Failure};
use super::output::{OutputFolder, shown};
use super::progress::Progress;
use carpus_osim::storage::{MotionCapture, StorageError};

/// A motion capture file to be written as text: markers (.trc) and analog channels (CSV).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConvertMotionCapture {
    /// The file (.c3d).
    pub file: PathBuf,
}

/// What it holds.
#[derive(Clone, Debug)]
pub struct ConvertedMotionCapture {
    /// Markers and channels.
    pub found: MotionCapture,
    /// The files that were written.
    pub files: Vec<PathBuf>,
}

impl ConvertedMotionCapture {
    /// Samples of the channels in a second; `None` where there are fewer than two.
    pub fn sample_rate(&self) -> Option<f64> {
        let time = &self.found.analog.time;
        time.get(1).map(|second| 1.0 / (second - time[0]))
    }

    /// For programs.
    pub fn value(&self) -> Value {
        let MotionCapture { markers, analog, units, .. } = &self.found;
        let channel = |(label, unit): (&String, &String)| json!({ "label": label, "unit": unit });
        json!({
            "schema": "carpus.c3d/1", "files": shown(&self.files),
            "markers": markers.names, "frames": markers.time.len(), "frame_rate_hz": markers.data_rate,
            "channels": analog.labels.iter().zip(units).map(channel).collect::<Vec<_>>(),
            "samples": analog.len(), "sample_rate_hz": self.sample_rate(),
        })
    }
}

impl ConvertMotionCapture {
    /// Reads the file and writes what it holds.
    ///
    /// - `path`: the folder to write into
    ///
    /// # Errors
    /// A file that cannot be read, or the disk.
    pub fn run(&self, path: &Path, progress: &dyn Progress) -> Result<ConvertedMotionCapture, Failure> {
        let found = MotionCapture::read(&self.file).map_err(|e| unreadable(&e))?;
        let warnings: Vec<Diagnostic> =
            found.warnings.iter().map(|text| Diagnostic::warning(text.as_str()).in_file(&self.file)).collect();
        progress.warnings(&warnings);
        let folder = OutputFolder::create(path, std::slice::from_ref(&self.file))?.with_results_of(&self.file);
        let stem = self.file.file_stem().map_or_else(|| "c3d".to_owned(), |s| s.to_string_lossy().into_owned());
        let MotionCapture { markers, analog, .. } = &found;
        let mut written: Vec<PathBuf> = Vec::new();
        if !markers.time.is_empty() {
            let name = format!("{stem}_markers.trc");
            written.push(folder.write(Path::new(&name), markers.text(&name).as_bytes())?);
        }
        if !analog.is_empty() {
            let header: Vec<&str> = std::iter::once("time_s").chain(analog.labels.iter().map(String::as_str)).collect();
            let row = |(time, row): (&f64, &Vec<f64>)| std::iter::once(time).chain(row).map(f64::to_string).collect();
            let text = csv_text(header.iter(), analog.time.iter().zip(&analog.rows).map(row))?;
            written.push(folder.write(format!("{stem}_analog.csv"), text.as_bytes())?);
        }
        progress.warnings(&folder.close("c3d", &[])?);
        Ok(ConvertedMotionCapture { files: written, found })
    }
}

fn unreadable(error: &StorageError) -> Failure {
    let message = Diagnostic::error(error.problem.to_string()).in_file(&error.file).at_line(error.line);
    match error.hint() {
        Some(hint) => message.hint(hint).into(),
        None => message.into(),
    }
}
