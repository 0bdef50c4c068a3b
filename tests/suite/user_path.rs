//! Tests of `user_path`.
