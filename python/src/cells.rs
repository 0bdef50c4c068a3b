//! Results that borrow the session or the study which they are of, held together with it.

use std::sync::Arc;

use carpus::session::compare::Comparison;
use carpus::session::diagnose::Diagnosed;
use carpus::session::evaluate::Evaluation;
use carpus::session::identify::Identified;
use carpus::session::personalize::Personalized;
use carpus::session::sensitivity::Sensitivity;
use carpus::session::simulate::Simulated;
use self_cell::self_cell;

use crate::loaded::{LoadedSession, Opened};

/// A result and what it borrows.
macro_rules! cell {
    ($(#[$doc:meta])* $name:ident, $owner:ty, $dependent:ident) => {
        self_cell!(
            $(#[$doc])*
            pub struct $name {
                owner: Arc<$owner>,
                #[covariant]
                dependent: $dependent,
            }
        );
    };
}

cell!(
    /// A simulation.
    SimulationCell,
    LoadedSession,
    Simulated
);
cell!(
    /// A comparison.
    ComparisonCell,
    LoadedSession,
    Comparison
);
cell!(
    /// A personalization.
    PersonalizationCell,
    LoadedSession,
    Personalized
);
cell!(
    /// An identification.
    IdentificationCell,
    LoadedSession,
    Identified
);
cell!(
    /// A diagnosis.
    DiagnosisCell,
    LoadedSession,
    Diagnosed
);
cell!(
    /// An evaluation.
    EvaluationCell,
    Opened,
    Evaluation
);
cell!(
    /// A sensitivity analysis.
    SensitivityCell,
    Opened,
    Sensitivity
);
