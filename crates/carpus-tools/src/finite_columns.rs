//! Columns of files that a tool cannot use with gaps.

use std::path::Path;

use super::error::{ToolError, ToolProblem};
use carpus_osim::storage::Storage;

/// Fails where a column of a file holds something else than finite numbers.
///
/// # Errors
/// The first such value, with its line and column.
pub fn require_finite(storage: &Storage, columns: &[usize], file: &Path) -> Result<(), ToolError> {
    let Some((row, column)) = storage.first_not_finite(columns) else { return Ok(()) };
    let problem = ToolProblem::Gap {
        column: storage.labels[column].clone(),
        time: storage.time[row],
        found: storage.rows[row][column],
    };
    Err(ToolError::at(file, storage.lines.get(row).copied().unwrap_or(0), problem))
}
