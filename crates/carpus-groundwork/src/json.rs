//! Results as JSON.

use serde::Serialize;
use serde_json::Value;

use super::diagnostic::Failure;

/// A result as JSON, keys in the order of the alphabet.
///
/// # Errors
/// None that input can cause.
pub fn value(of: &impl Serialize) -> Result<Value, Failure> {
    serde_json::to_value(of).map_err(|e| Failure::Internal(e.to_string()))
}

/// A result as the text of a JSON file, keys in the order of the alphabet.
///
/// # Errors
/// None that input can cause.
pub fn pretty(of: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string_pretty(&value(of)?).map_err(|e| Failure::Internal(e.to_string()))
}

/// A result in one line of JSON, keys in the order of its fields.
///
/// # Errors
/// None that input can cause.
pub fn line(of: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string(of).map_err(|e| Failure::Internal(e.to_string()))
}

/// A result in JSON that people can read, keys in the order of its fields.
///
/// # Errors
/// None that input can cause.
pub fn readable(of: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string_pretty(of).map_err(|e| Failure::Internal(e.to_string()))
}

/// The text of a file of JSON that people can read: it ends its last line.
///
/// # Errors
/// None that input can cause.
pub fn text(of: &impl Serialize) -> Result<String, Failure> {
    Ok(readable(of)? + "\n")
}
