//! Keys of `[processing]`.

use crate::dynamometer::{RepetitionSettings, RepetitionSignal};
use crate::study::problem::Problem;
use crate::study::toml_section::{Sections, TomlSection};
use crate::study::trial_list::Contraction;
use carpus_numerics::signals::{Band, Butterworth};

/// Everything `[processing]` says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProcessingSettings {
    /// Zero-phase low-pass of angle, velocity and moment; `None`: as recorded.
    pub filter: Option<Butterworth>,
    /// Whether the machine's drag (`[dynamometer] damping_n_m_s_per_deg`) is added to the measured moment.
    pub remove_drag: bool,
    /// Order of the polynomial of the relaxed limb's moment that is subtracted; `None`: nothing is subtracted.
    pub passive_order: Option<usize>,
    /// Recordings of the machine without a participant, relative to study.toml.
    pub drag_runs: Vec<String>,
    /// How long recordings are cut, and which.
    pub repetitions: Option<(RepetitionSettings, Vec<Contraction>)>,
}

/// Reads `[processing]`.
pub(crate) fn settings(sections: &Sections<'_>, problems: &mut Vec<Problem>) -> ProcessingSettings {
    let mut section = sections.section("processing");
    let whole = |v: f64, from: f64, to: f64| (from..=to).contains(&v) && v.fract() == 0.0;
    let cutoff =
        section.optional_number("filter_hz", "a positive frequency in Hz, 0.1 to 1000", |v| (0.1..=1e3).contains(&v));
    let order = section.optional_number("filter_order", "1 to 20", |v| whole(v, 1.0, 20.0));
    let passive = section.optional_bool("subtract_passive").unwrap_or(false);
    let passive_order = section.optional_number("passive_order", "1 to 9", |v| whole(v, 1.0, 9.0)).unwrap_or(5.0);
    let found = ProcessingSettings {
        filter: cutoff
            .map(|cutoff_hz| Butterworth { order: order.unwrap_or(4.0) as usize, band: Band::LowPass { cutoff_hz } }),
        remove_drag: section.optional_bool("remove_drag").unwrap_or(false),
        passive_order: passive.then_some(passive_order as usize),
        drag_runs: section.optional_strings("drag_runs", "list of files").unwrap_or_default(),
        repetitions: section.optional_table("repetitions", "a table", repetitions),
    };
    section.finish(problems);
    found
}

fn repetitions(table: &mut TomlSection<'_>) -> (RepetitionSettings, Vec<Contraction>) {
    let words = [("moment", RepetitionSignal::Moment), ("movement", RepetitionSignal::Movement)];
    let seconds = "a number of seconds, 0 or more";
    let settings = RepetitionSettings {
        signal: table.optional_word("by", "signal", &words).unwrap_or(RepetitionSignal::Moment),
        threshold: table
            .optional_number("threshold", "more than 0, less than 1", |v| v > 0.0 && v < 1.0)
            .unwrap_or(0.2),
        min_duration: table.optional_number("min_duration_s", seconds, |v| v >= 0.0).unwrap_or(0.5),
        max_pause: table.optional_number("max_pause_s", seconds, |v| v >= 0.0).unwrap_or(0.3),
        margin: table.optional_number("margin_s", seconds, |v| v >= 0.0).unwrap_or(0.25),
    };
    let contractions = table.optional_words("contractions", "contraction", &Contraction::WORDS);
    (
        settings,
        contractions.unwrap_or_else(|| vec![Contraction::Isometric, Contraction::Isotonic, Contraction::Passive]),
    )
}
