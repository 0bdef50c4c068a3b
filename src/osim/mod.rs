//! OpenSim `.osim` files: lossless document, typed specification, edits and diagnostics.
//!
//! In: the bytes of an `.osim` file. Out: a [`spec::ModelSpec`] (typed, faithful, OpenSim's property names) and a
//! list of diagnostics saying what was understood, approximated, ignored or unsupported, with file and line.
//! Writing goes the other way: an edit of the specification is a splice into the original bytes, so bytes that were
//! not edited stay as they were. This is the only module that knows XML.

pub mod spec;
