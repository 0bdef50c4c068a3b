//! Error measures between measured and simulated moments, per trial and per condition.
//!
//! In: two moments [N·m] on the same samples. Out: the measures of one trial ([`error_measures`]) and their tables
//! over trials ([`ErrorTable`]), serializable, with units in the names. Bringing both moments onto the same samples is
//! not here; see [`crate::simulation`].

mod cohort;
mod measures;
pub mod residuals;
mod table;

pub use cohort::{Cohort, CohortMeasure, ConditionError, OverParticipants, condition_errors};
pub use measures::{ErrorMeasures, EvaluationError, Measure, Undefined, error_measures};
pub use table::{Condition, ConditionErrors, ErrorSummary, ErrorTable, SetErrors, Spread, TrialErrors};
