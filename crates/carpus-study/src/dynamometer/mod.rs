//! A dynamometer's recordings before they become a study's: the machine's own drag, the moment of the relaxed limb,
//! repetitions of a long recording, and the delay between two recorders.
//!
//! In: samples \[s, rad, N·m\]. Out: estimates with their intervals, curves, ranges of samples, delays. The measured
//! moment is that of the person minus the machine's drag, positive in the coordinate's positive direction:
//!
//! ```text
//! measured = person − damping·q̇ − friction·sign(q̇) + offset + weight of the attachment
//! ```
//! No files are read here and nothing is printed.

mod alignment;
mod derivative;
mod drag;
mod passive;
mod regression;
mod repetitions;

pub use alignment::{Alignment, AlignmentError, align};
pub use derivative::derivative;
pub use drag::{ConstantVelocityPhase, DragError, DragEstimate, MachineRun, estimate_drag};
pub use passive::{PassiveCurve, PassiveError, PassiveRun, fit_passive};
pub use regression::{ClusteredRegression, RegressionError, clustered_regression};
pub use repetitions::{RepetitionSettings, RepetitionSignal, find_repetitions};
