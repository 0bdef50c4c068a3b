//! Residuals of a model along axes, for a terminal.

use super::table::{fixed, table};
use carpus_report::results::Results;

/// Axes that a terminal shows.
const SHOWN_AXES: usize = 6;

/// The axes along which the model fails most, and the noise that repetitions show, for a terminal.
pub fn where_it_fails(results: &Results) -> String {
    let Some(found) = results.residuals.last() else { return String::new() };
    let rows = found.axes_by_share().into_iter().take(SHOWN_AXES).map(|a| {
        let (at, mean, interval) = a.largest();
        let band = interval.map_or(String::new(), |[low, high]| format!(" [{}, {}]", fixed(low, 2), fixed(high, 2)));
        vec![
            carpus_report::axis_name(&a.axis),
            fixed(100.0 * a.share_of_error, 0),
            format!("{}{band} at {} {}", fixed(mean, 2), carpus_report::plain(at), a.unit),
        ]
    });
    let noise = match found.repetition_noise_n_m {
        Some(noise) => format!(
            "Repetitions of a condition differ by {} N·m ({} pairs): no model that knows only the condition does \
             better.",
            fixed(noise, 3),
            found.repetition_pairs
        ),
        None => "No condition was repeated: the noise is not known from repetitions.".to_owned(),
    };
    format!(
        "\n\n{}: where the error of {} N·m is\n{}\n{noise}",
        results.participant.id,
        fixed(found.rms_n_m, 3),
        table(&["along", "% of the error", "largest mean residual, N·m [95 %]"], 1, rows)
    )
}
