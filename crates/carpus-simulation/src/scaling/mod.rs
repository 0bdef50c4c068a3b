//! From a study's model to a participant's without fitting: linear scaling by lengths of segments as OpenSim's Scale
//! Tool does it, and strength scaling by maximum voluntary moments.
//!
//! In: a model file, a study and a participant. Out: the same file with the changed values spliced in, and an account
//! of every factor. Nothing is read from disk except the trials that a study names.

mod linear;
mod segments;
mod strength;
mod strength_error;
mod strength_target;

pub use linear::{LinearScaling, LinearScalingError, ScaleRequest, ScaledLength, scale};
pub use segments::{ParticipantScaling, ParticipantScalingError, SegmentFactor, marker_distance, scale_participant};
pub use strength::{GroupScaling, ScaledMuscle, StrengthScaling, strength_scale, strength_scaling};
pub use strength_error::StrengthError;
pub use strength_target::{StrengthTarget, TargetSource, strength_targets};
