//! The application as a library: what the command line does, for programs.
//!
//! In: the path of a study. [`study::Study::open`] tells all problems of its tables at once;
//! [`participant::StudyParticipant::load`] reads a participant's model and trials with exactly the checks of the
//! command line: a component of the model that matters and is not supported is an error. Each use case is one file with
//! a typed request, whose default is what the command does without options, and a typed result. Files and reports are
//! made from results.
//!
//! [`study::Study::from_memory`] makes a study of arrays and a model that are in no file.
//!
//! Nothing here prints. Progress and warnings on the way go to a [`progress::Progress`], which may stop the work.
//! What is wrong, wherever it is found, is a [`diagnostic::Diagnostic`]: place, text, hint, severity.
//!
//! | use case | request | result |
//! |---|---|---|
//! | [`init`] | [`init::Init`] | a study from a folder of exported files |
//! | [`check`] | [`check::Check`] | what can be found before a run, in one screen |
//! | [`simulate`] | [`simulate::Simulate`] | moments, fibre lengths and forces over time |
//! | [`compare`] | [`compare::Compare`] | errors of the model as it is, and where they are |
//! | [`personalize`] | [`personalize::Personalize`] | fitted muscle parameters, the model that has them |
//! | [`identify`] | [`identify::Identify`] | intervals and posterior of muscle parameters |
//! | [`diagnose`], [`diagnose_study`] | [`diagnose::Diagnose`] | which physical effects are missing |
//! | [`effect_steps`] | [`effect_steps::AddEffects`] | the model with effects, step by step |
//! | [`plan`] | [`plan::Plan`] | further trials that tell explanations apart |
//! | [`remove_effects`] | [`remove_effects::RemoveEffects`] | a step back in the ledger of effects |
//! | [`check_effect`] | [`check_effect::CheckEffect`] | an effect of one's own, checked and shown |
//! | [`evaluate`] | [`evaluate::Evaluate`] | models on held-out trials, over participants |
//! | [`sensitivity`] | [`screening::ScreeningOptions`] | which parameters the trials respond to |
//! | [`whole_study`] | [`whole_study::WholeStudy`] | all steps of a study and one report |
//! | [`groups`] | [`groups::CompareGroups`] | what differs between groups of participants, or before and after |
//! | [`priors`] | [`priors::LearnPriors`] | what earlier fits say about the next participant |
//! | [`ultrasound`] | [`ultrasound::CompareImages`] | resting muscles beside ultrasound images |
//! | [`power`] | [`power::Power`] | power of a test, and the participants it needs |
//! | [`synth`] | [`synth::Synthesize`] | a study with a hidden effect |
//! | [`emg`] | [`emg::Emg`] | raw EMG to excitations |
//! | [`dynamometer`] | [`dynamometer::Processing`] | recordings to the trials of a new study |
//! | [`drag`] | [`drag::MachineDrag`] | the machine's own damping |
//! | [`motion_capture`] | [`motion_capture::ConvertMotionCapture`] | markers and channels as text files |
//! | [`scale`] | [`scale::ScaleModel`], [`scale::ScaleStudy`] | models scaled by factors, or to participants |
//! | [`strength`] | [`strength::StrengthScale`] | forces scaled to the maximum voluntary moments |
//! | [`sweep`] | [`sweep::SweepPaths`] | muscle lengths and moment arms over a coordinate |
//! | [`view`] | [`view::ViewModel`] | a page that shows a model in three dimensions |
//! | [`equilibrium`] | [`equilibrium::Equilibrium`] | fibre lengths and forces at rest in a posture |
//! | [`audit`] | [`audit::AuditModel`] | what no body has, over the ranges of a model's coordinates |
//! | [`info`] | [`info::Info`] | what is in a model, and what of it a study can use ([`info_study`]) |
//! | [`upgrade`] | [`upgrade::Upgrade`] | an old model in the current format |
//! | [`run_tool`] | [`run_tool::RunTool`] | what OpenSim's tool of a setup file writes |

pub mod candidates;
pub mod catalogue_pages;
pub mod check;
pub mod check_effect;
pub mod cohort_diagnosis;
pub mod cohort_intervals;
pub mod compare;
pub mod determines;
pub mod diagnose;
pub mod diagnose_study;
pub mod diagnosis_file;
pub mod dynamometer;
pub mod effect_choice;
pub mod effect_steps;
pub mod effect_words;
pub mod emg;
pub mod evaluate;
pub mod evaluation_report;
pub mod groups;
pub mod identify;
pub mod identify_files;
mod images;
mod live_case;
pub mod loading;
mod muscle_use;
pub mod outcomes;
pub mod own_effects;
pub mod participant;
pub mod personalize;
pub mod plan;
mod prepared;
pub mod remove_effects;
pub mod residuals;
pub mod result_files;
pub mod scale;
pub mod screening;
pub mod sensitivity;
pub mod sensitivity_report;
pub mod simulate;
pub mod strength;
pub mod study;
pub mod synth;
pub mod text_tables;
pub mod verdict_words;
pub mod view;
pub mod whole_study;

pub use carpus_groundwork::{
    account, anova, audit, bundled, diagnostic, drag, equilibrium, errors, geometry, info, info_study, init, json,
    model, motion_capture, output, path_check, power, priors, processed_study, progress, progress_lines, provenance,
    quantity, report_parts, run_tool, said, series, shared_arguments, shared_work, sweep, task, ultrasound, units,
    upgrade,
};
