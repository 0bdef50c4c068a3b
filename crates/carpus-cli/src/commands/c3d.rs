//! `carpus c3d`: what a motion capture file holds, as text files.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::args::{C3dArgs, Global};
use crate::failure::{self, Diagnostic, Failure};
use crate::print_result;
use carpus_osim::storage::{MotionCapture, StorageError};
use carpus_session::account::csv_text;
use carpus_session::output::OutputFolder;

/// Runs the command.
///
/// # Errors
/// A file that cannot be read, or the disk.
pub fn run(args: &C3dArgs, global: &Global) -> Result<(), Failure> {
    let found = MotionCapture::read(&args.file).map_err(|e| unreadable(&e))?;
    let warnings: Vec<Diagnostic> =
        found.warnings.iter().map(|text| Diagnostic::warning(text.as_str()).in_file(&args.file)).collect();
    failure::print(&warnings);
    let folder = OutputFolder::create(&args.out, std::slice::from_ref(&args.file))?.with_results_of(&args.file);
    let stem = args.file.file_stem().map_or_else(|| "c3d".to_owned(), |s| s.to_string_lossy().into_owned());
    let MotionCapture { markers, analog, units, .. } = &found;
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
    failure::print(&folder.close("c3d", &[])?);
    let rate = |time: &[f64]| time.get(1).map(|second| 1.0 / (second - time[0]));
    if global.json {
        let files: Vec<String> = written.iter().map(|f| f.display().to_string()).collect();
        let channels: Vec<_> =
            analog.labels.iter().zip(units).map(|(label, unit)| json!({ "label": label, "unit": unit })).collect();
        let value = json!({
            "schema": "carpus.c3d/1", "files": files,
            "markers": markers.names, "frames": markers.time.len(), "frame_rate_hz": markers.data_rate,
            "channels": channels, "samples": analog.len(), "sample_rate_hz": rate(&analog.time),
        });
        return print_result(&value.to_string());
    }
    let at = |rate: Option<f64>| rate.map_or_else(String::new, |rate| format!(" at {rate:.6} Hz"));
    let markers_of = (!markers.names.is_empty()).then(|| {
        let (n, frames) = (markers.names.len(), markers.time.len());
        format!("{n} markers, {frames} frames at {} Hz: {}", markers.data_rate, markers.names.join(", "))
    });
    let channel = |(label, unit): (&String, &String)| match unit.as_str() {
        "" => label.clone(),
        unit => format!("{label} [{unit}]"),
    };
    let channels: Vec<String> = analog.labels.iter().zip(units).map(channel).collect();
    let channels_of = (!channels.is_empty()).then(|| {
        let (n, samples, rate) = (channels.len(), analog.len(), at(rate(&analog.time)));
        format!("{n} analog channels, {samples} samples{rate}: {}", channels.join(", "))
    });
    let mut lines = vec![
        markers_of.unwrap_or_else(|| "no markers".to_owned()),
        channels_of.unwrap_or_else(|| "no analog channels".to_owned()),
    ];
    lines.extend(written.iter().map(|f| f.display().to_string()));
    print_result(&lines.join("\n"))
}

fn unreadable(error: &StorageError) -> Failure {
    let message = Diagnostic::error(error.problem.to_string()).in_file(&error.file).at_line(error.line);
    match error.hint() {
        Some(hint) => message.hint(hint).into(),
        None => message.into(),
    }
}
