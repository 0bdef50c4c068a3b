//! `carpus c3d`: what a motion capture file holds, as text files.

use serde_json::json;

use crate::args::{C3dArgs, Global};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::print_result;
use carpus_osim::storage::MotionCapture;
use carpus_session::motion_capture::ConvertMotionCapture;

/// Runs the command.
///
/// # Errors
/// A file that cannot be read, or the disk.
pub fn run(args: &C3dArgs, global: &Global) -> Result<(), Failure> {
    let done = ConvertMotionCapture { file: args.file.clone() }.run(&args.out, &Bars::new(global))?;
    let MotionCapture { markers, analog, units, .. } = &done.found;
    let rate = |time: &[f64]| time.get(1).map(|second| 1.0 / (second - time[0]));
    if global.json {
        let files: Vec<String> = done.files.iter().map(|f| f.display().to_string()).collect();
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
    lines.extend(done.files.iter().map(|f| f.display().to_string()));
    print_result(&lines.join("\n"))
}
