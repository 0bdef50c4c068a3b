//! What is asked, noted and proposed.

use std::path::PathBuf;

use serde::Serialize;

/// Whom to ask what the files do not say.
pub trait Questions {
    /// Which of some answers is right; the one that is proposed comes first.
    fn choose(&self, question: &str, answers: &[String]) -> usize;
    /// A number, if another than the proposed one is right.
    fn number(&self, question: &str, proposed: f64) -> f64;
}

/// Takes what is proposed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Proposed;

impl Questions for Proposed {
    fn choose(&self, _: &str, _: &[String]) -> usize {
        0
    }

    fn number(&self, _: &str, proposed: f64) -> f64 {
        proposed
    }
}

/// Something that was assumed or could not be told.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Note {
    /// What.
    pub what: String,
    /// What to do if it is wrong, or to make it known.
    pub remedy: String,
}

/// A trial as it is proposed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProposedTrial {
    /// The participant.
    pub participant: String,
    /// Its file, relative to the laboratory's folder.
    pub file: String,
    /// The file of its EMG, where that is another.
    pub emg_file: Option<String>,
    /// The table of its file, where that has several.
    pub table: Option<String>,
    /// The table of its EMG's file.
    pub emg_table: Option<String>,
    /// Kind of contraction, as `trials.csv` says it.
    pub contraction: String,
    /// Effort [% of the maximum].
    pub effort_percent: Option<f64>,
    /// Direction, as `trials.csv` says it.
    pub direction: String,
    /// Angle of an isometric trial [deg].
    pub posture_deg: Option<f64>,
    /// Number of the repetition.
    pub repetition: Option<u32>,
    /// What it is for, as `trials.csv` says it.
    #[serde(rename = "use")]
    pub usage: String,
}

/// A study that is proposed.
#[derive(Clone, Debug, Serialize)]
pub struct Proposal {
    /// Name and version of the form.
    pub schema: &'static str,
    /// The study.toml that was written.
    pub study: PathBuf,
    /// What was understood: subject and what of it.
    pub understood: Vec<(String, String)>,
    /// What was assumed.
    pub assumed: Vec<Note>,
    /// What could not be told.
    pub unknown: Vec<Note>,
    /// The trials.
    pub trials: Vec<ProposedTrial>,
}
