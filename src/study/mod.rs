//! A study on disk: study.toml, participants, trials, and their checks.
