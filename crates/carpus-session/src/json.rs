//! Results as JSON: keys in the order of the alphabet.

use serde::Serialize;
use serde_json::Value;

use super::diagnostic::Failure;

/// A result as JSON.
///
/// # Errors
/// None that input can cause.
pub fn value(of: &impl Serialize) -> Result<Value, Failure> {
    serde_json::to_value(of).map_err(|e| Failure::Internal(e.to_string()))
}

/// A result as the text of a JSON file.
///
/// # Errors
/// None that input can cause.
pub fn pretty(of: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string_pretty(&value(of)?).map_err(|e| Failure::Internal(e.to_string()))
}
