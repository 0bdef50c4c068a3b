//! Why a file of numbers cannot be read.

use std::path::PathBuf;

/// Why a file of numbers cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{}{}: {problem}", .file.display(), if *.line > 0 { format!(":{}", .line) } else { String::new() })]
pub struct StorageError {
    /// The file.
    pub file: PathBuf,
    /// Line, counted from 1; 0: the file as a whole.
    pub line: usize,
    /// What is wrong.
    pub problem: StorageProblem,
}

/// What is wrong with a file of numbers.
#[derive(Debug, thiserror::Error)]
pub enum StorageProblem {
    /// The disk.
    #[error("cannot be read: {0}")]
    Read(#[from] std::io::Error),
    /// The name ends in something else.
    #[error("expected a file whose name ends in {expected}, found \"{found}\"")]
    Extension {
        /// What is read here.
        expected: &'static str,
        /// What the name ends in.
        found: String,
    },
    /// No `endheader`.
    #[error("expected a line `endheader` after the header, found the end of the file")]
    NoEndOfHeader,
    /// A count in the header that is no count.
    #[error("expected {key} to be a whole number, found \"{found}\"")]
    Count {
        /// Key in the header.
        key: String,
        /// What stands there.
        found: String,
    },
    /// No labels.
    #[error("expected a line with the labels of the columns, found the end of the file")]
    NoLabels,
    /// No column for time.
    #[error("expected a column `time`, found {}", .found.join(", "))]
    NoTime {
        /// First labels.
        found: Vec<String>,
    },
    /// A label twice.
    #[error("two columns are called `{label}`")]
    SameLabel {
        /// The label.
        label: String,
    },
    /// Something that is no number.
    #[error("column `{column}`: expected a number, found \"{found}\"")]
    NotANumber {
        /// Label.
        column: String,
        /// What stands there.
        found: String,
    },
    /// A row of another length.
    #[error("expected {expected} values, as there are columns; found {found}")]
    RowLength {
        /// Number of columns.
        expected: usize,
        /// Number of values.
        found: usize,
    },
    /// Fewer frames of a recording than the header says.
    #[error("expected {expected} rows, as the header says; found {found}: the file may be cut off")]
    RowCount {
        /// Rows in the header.
        expected: usize,
        /// Rows found.
        found: usize,
    },
    /// No rows.
    #[error("expected rows of numbers, found none")]
    NoRows,
    /// Times that do not ascend.
    #[error("expected times that ascend, found {next} s after {previous} s")]
    TimeOrder {
        /// Time before.
        previous: f64,
        /// Time.
        next: f64,
    },
    /// Numbers of a kind that is not read.
    #[error("expected DataType=double or DataType=Vec3, found \"{found}\"")]
    DataType {
        /// What the header says.
        found: String,
    },
    /// A unit of length that is not known.
    #[error("expected Units m, cm or mm, found \"{found}\"")]
    Units {
        /// What stands there.
        found: String,
    },
    /// Not a motion capture file, or a broken one.
    #[error("not a .c3d file that can be read: {what}")]
    MotionCapture {
        /// What is wrong.
        what: String,
    },
    /// A motion capture file without markers.
    #[error("expected markers, found none")]
    NoMarkers,
    /// No marker trajectories.
    #[error(
        "expected a header of five lines as .trc files have it: PathFileType, names, values, markers, X1 Y1 Z1; {what}"
    )]
    TrcHeader {
        /// What is missing.
        what: String,
    },
}

impl StorageError {
    /// What to do, where that is known.
    pub fn hint(&self) -> Option<String> {
        let text = match &self.problem {
            StorageProblem::RowCount { .. } => "export the recording again",
            StorageProblem::SameLabel { .. } => "rename one of them: forces and markers are found by label",
            StorageProblem::NotANumber { .. } => "decimal point, not comma; a missing value is NaN",
            _ => return None,
        };
        Some(text.to_owned())
    }
}
