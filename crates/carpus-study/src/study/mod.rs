//! A study on disk: `study.toml`, participants, trials, and their checks.
//!
//! In: a folder as a lab keeps it. Out: a typed [`Study`] in SI units and radians, and one [`Trial`] at a time with
//! its samples. Every key and column is either read or reported; all problems of a study are collected and returned
//! together, each with file, line and, where there is one, a hint. Raw EMG becomes excitation here, by
//! [`carpus_numerics::signals`] and the participant's MVC trials; nothing else is filtered or resampled. What needs the
//! model is checked by those who have it: [`Study::check_names`], [`Trial::check_against_range`].
//!
//! | file | what is in it | optional keys beyond the essential ones |
//! |---|---|---|
//! | `study.toml` | `[study]`, `[dynamometer]`, `[posture_deg]` | `[columns] ignore = [..]`: columns left unused |
//! | | `[muscles]`, `[emg]`, `[columns]` | `[columns] angle_unit = "rad"`; `[checks] max_gap_s` |
//! | | `[personalization]`, `[ultrasound]` | `[processing]`, `[scaling]` and `[strength_scaling]` |
//! | | | `[dynamometer] further_moments = { deviation = "column" }`: moments measured about coordinates that are held |
//! | | | `[ultrasound]`: [`ImagingSettings`] |
//! | | | `[effects] own = ["my_effect.toml"]`: effects beside the catalogue (`carpus::effects::own_effect`) |
//! | `participants.csv` | [`Participant`] | any `<segment>_length_m` |
//! | `trials.csv` | [`TrialInfo`] | `start_time_s`; `arm`: `upright` or `flipped`; `table`, `emg_table` |
//! | `ultrasound.csv` | [`UltrasoundMeasurement`] | the file itself |
//! | trial files | time, angle, moment, EMG, perhaps velocity: [`Trial`] | |

mod channels;
mod column_settings;
mod columns;
mod contents;
mod dialect;
mod efforts;
mod emg_recorder;
mod exported;
mod fault;
mod fault_hint;
mod fault_words;
mod imaging_settings;
mod in_memory;
mod limits;
mod lines;
mod nearest;
mod participants;
mod plausibility;
mod posture;
mod priors;
mod problem;
mod processed_emg;
mod processing;
mod raw_emg;
mod recording_file;
mod scaling;
mod settings;
mod table;
mod times;
mod toml_section;
mod trial;
mod trial_checks;
mod trial_file;
mod trial_list;
mod ultrasound;
pub mod write;

pub use columns::{AngleUnit, Columns, Conversion, Conversions, FurtherMoment};
pub use contents::Study;
pub use dialect::{Dialect, Separator, is_time_name};
pub use emg_recorder::{EmgClock, EmgRecorder};
pub use exported::Exported;
pub use fault::Fault;
pub use fault_words::outside_range;
pub use imaging_settings::{FascicleUse, ImagingSettings};
pub use limits::{
    ANGLE_RANGE_TOLERANCE, ANGLE_RANGE_WARNING, EMG_NOISE_ABOVE, EMG_NOISE_BELOW, GAP_IN_MEDIAN_STEPS, MAX_SAMPLES,
    MIN_SAMPLES, POSITION_RANGE_WARNING,
};
pub use nearest::nearest;
pub use participants::{Participant, Sex, Side};
pub use posture::{PostureCoordinate, is_same_posture};
pub use priors::{PriorKnowledge, PriorUnit, read_priors};
pub use problem::{MAX_LISTED, Problem, Severity, StudyErrors};
pub use processed_emg::{ParticipantEmg, ProcessedEmg};
pub use processing::{DelayFound, ProcessedTrial, ProcessingError, ProcessingResult, ProcessingSettings, Recorded};
pub use raw_emg::EmgSignal;
pub use recording_file::{Format, RecordingFileError};
pub use scaling::{FinalMass, ModelLength, ScalingSettings, SegmentScaling, StrengthSettings};
pub use settings::{Dynamometer, MomentPart, ParameterBounds, RelativeBounds, Settings};
pub use table::{file_fault, is_of_a_study, named_file};
pub use toml_section::{Sections, TomlSection};
pub use trial::Trial;
pub use trial_list::{Contraction, Direction, TrialInfo, TrialUse, held_coordinates, posture_column};
pub use ultrasound::UltrasoundMeasurement;
