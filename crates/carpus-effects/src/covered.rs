//! What a session covers: the units of columns along an axis.

use super::trial_record::TrialRecord;
use carpus_study::study::TrialUse;

/// What a session covers: the units of columns along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covered {
    /// Largest moment recorded [N·m], either way.
    pub moment: f64,
    /// Least and largest angle [rad].
    pub angle: [f64; 2],
}

impl Covered {
    /// By trials that are not held out.
    ///
    /// - `strength`: of the joint beside a wrist, the largest moment where none was recorded
    pub fn by(trials: &[TrialRecord], strength: f64) -> Covered {
        let seen = || trials.iter().filter(|t| t.info.usage != TrialUse::Test);
        let moments = || seen().flat_map(|t| &t.moment);
        let angles = || seen().flat_map(|t| &t.angle).copied();
        let largest = moments().fold(0.0_f64, |most, m| most.max(m.abs()));
        Covered {
            moment: if largest > 0.0 { largest } else { strength },
            angle: [angles().fold(f64::INFINITY, f64::min), angles().fold(f64::NEG_INFINITY, f64::max)],
        }
    }
}
