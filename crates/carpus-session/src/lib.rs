//! The application as a library: what the command line does, for programs.
//!
//! In: the path of a study. [`study::Study::open`] tells all problems of its tables at once; [`participant::StudyParticipant::load`]
//! reads a participant's model and trials with exactly the checks of the command line: a component of the model that matters
//! and is not supported is an error. Each use case is one file with a typed request, whose default is what the command does
//! without options, and a typed result. Files and reports are made from results.
//!
//! Nothing here prints. Progress and warnings on the way go to a [`progress::Progress`], which may stop the work.
//! What is wrong, wherever it is found, is a [`diagnostic::Diagnostic`]: place, text, hint, severity.
//!
//! | use case | request | result |
//! |---|---|---|
//! | [`simulate`] | [`simulate::Simulate`] | moments, fibre lengths and forces over time |
//! | [`compare`] | [`compare::Compare`] | errors of the model as it is, and where they are |
//! | [`personalize`] | [`personalize::Personalize`] | fitted muscle parameters, the model that has them |
//! | [`identify`] | [`identify::Identify`] | intervals and posterior of muscle parameters |
//! | [`diagnose`] | [`diagnose::Diagnose`] | which physical effects are missing |
//! | [`effect_steps`] | [`effect_steps::AddEffects`] | the model with effects, step by step |
//! | [`plan`] | [`plan::Plan`] | further trials that tell explanations apart |

pub mod account;
pub mod candidates;
pub mod compare;
pub mod diagnose;
pub mod diagnosis_file;
pub mod diagnostic;
pub mod effect_choice;
pub mod effect_steps;
pub mod errors;
pub mod identify;
pub mod identify_files;
pub mod loading;
pub mod model;
pub mod output;
pub mod own_effects;
pub mod participant;
pub mod path_check;
pub mod personalize;
pub mod plan;
pub mod processed_study;
pub mod progress;
pub mod provenance;
pub mod quantity;
pub mod residuals;
pub mod result_files;
pub mod screening;
pub mod series;
pub mod simulate;
pub mod study;
pub mod units;
