//! What is written into the three files of a proposed study.

use super::piece::Pieces;
use super::proposal::ProposedTrial;
use carpus_study::study::Participant;

/// What is written into the three files.
pub(super) struct Draft {
    pub name: String,
    /// Paths relative to the study's folder.
    pub model: String,
    pub recordings: String,
    pub coordinate: String,
    pub posture: Vec<Held>,
    pub pieces: Pieces,
    pub moment_sign: f64,
    pub velocity_used: bool,
    pub people: Vec<Participant>,
    pub trials: Vec<ProposedTrial>,
}

/// A coordinate that is held.
#[derive(Clone, Debug)]
pub struct Held {
    /// Its name.
    pub name: String,
    /// Its value [deg].
    pub value_deg: f64,
    /// Whether the model's default is left as it is.
    pub is_default: bool,
    /// Muscles that cross it.
    pub muscles: Vec<String>,
}
