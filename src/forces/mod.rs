//! Generalized forces that are not muscles.
