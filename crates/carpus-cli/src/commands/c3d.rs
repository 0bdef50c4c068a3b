//! `carpus c3d`: what a motion capture file holds, as text files.

use crate::args::{C3dArgs, Global};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::stdout::print_result;
use carpus_osim::storage::MotionCapture;
use carpus_session::motion_capture::ConvertMotionCapture;
use carpus_session::output::shown;

/// Runs the command.
///
/// # Errors
/// A file that cannot be read, or the disk.
pub fn run(args: &C3dArgs, global: &Global) -> Result<(), Failure> {
    let done = ConvertMotionCapture { file: args.file.clone() }.run(&args.out, &Bars::new(global))?;
    if global.json {
        return print_result(&done.value().to_string());
    }
    let MotionCapture { markers, analog, units, .. } = &done.found;
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
        let (n, samples) = (channels.len(), analog.len());
        let rate = done.sample_rate().map_or_else(String::new, |rate| format!(" at {rate:.6} Hz"));
        format!("{n} analog channels, {samples} samples{rate}: {}", channels.join(", "))
    });
    let mut lines = vec![
        markers_of.unwrap_or_else(|| "no markers".to_owned()),
        channels_of.unwrap_or_else(|| "no analog channels".to_owned()),
    ];
    lines.extend(shown(&done.files));
    print_result(&lines.join("\n"))
}
