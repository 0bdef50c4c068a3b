//! Parameters of muscles: fits to recorded trials, and how much each one matters.

pub mod personalization;
pub mod sensitivity;
