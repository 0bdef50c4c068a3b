//! Tests of `study`: good studies read into internal units, bad ones are refused with file, line and hint.

mod bad_settings;
mod bad_tables;
mod bad_trials;
mod folder;
mod good;
mod implausible;
mod random_bytes;
mod raw_emg;
mod warnings;
