//! Why a recording that is no text cannot be read.

use super::format::Format;

/// Why a recording cannot be read: where, what was expected, what was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RecordingFileError {
    /// The bytes are not those of the format.
    #[error("{}, {place}: expected {expected}, found {found}", .format.words())]
    Broken {
        /// The format.
        format: Format,
        /// Where in the file.
        place: String,
        /// What should stand there.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// A variant of a format, or a format, that is known and not read.
    #[error("this is {what}, which is not read")]
    NotRead {
        /// What it is, with its article.
        what: String,
        /// How to save it as something that is read.
        hint: &'static str,
    },
    /// More than is read of one file.
    #[error("{}: more than {limit} {what}", .format.words())]
    TooLarge {
        /// The format.
        format: Format,
        /// Of what.
        what: &'static str,
        /// How many are read.
        limit: usize,
    },
    /// No table of numbers.
    #[error("{}: no table of numbers with at least {rows} rows: found {found}", .format.words())]
    NoTable {
        /// The format.
        format: Format,
        /// Fewest rows of a table.
        rows: usize,
        /// What is in the file.
        found: String,
    },
    /// A table that is named and not there.
    #[error("there is no table `{wanted}`; the file has {}", listed(.present))]
    NoSuchTable {
        /// The name.
        wanted: String,
        /// Titles of the tables that are there.
        present: Vec<String>,
        /// The one whose title is most like it.
        nearest: Option<String>,
    },
    /// Several tables that could be meant.
    #[error("several tables have the columns that are looked for: {}", listed(.fitting))]
    SeveralTables {
        /// Their titles.
        fitting: Vec<String>,
        /// The column of trials.csv that says which.
        key: &'static str,
    },
    /// Several tables, none of which has the columns that are looked for.
    #[error("none of the tables has the columns {}; the file has {}", listed(.wanted), listed(.present))]
    NoTableWith {
        /// Columns that are looked for.
        wanted: Vec<String>,
        /// Titles of the tables with their columns.
        present: Vec<String>,
    },
}

impl RecordingFileError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        let text = match self {
            RecordingFileError::Broken { .. } => {
                "the file may be cut off or damaged: export it again, or as CSV".to_owned()
            }
            RecordingFileError::NotRead { hint, .. } => (*hint).to_owned(),
            RecordingFileError::TooLarge { .. } => "export one file a trial".to_owned(),
            RecordingFileError::NoTable { format, .. } => format.expected().to_owned(),
            RecordingFileError::NoSuchTable { nearest: Some(nearest), .. } => format!("did you mean `{nearest}`?"),
            RecordingFileError::NoSuchTable { .. } => "a table is named by its title or its number, from 1".to_owned(),
            RecordingFileError::SeveralTables { key, .. } => {
                format!("name one of them in the column {key} of trials.csv, by its title or its number, from 1")
            }
            RecordingFileError::NoTableWith { .. } => "column names are set in [columns] of study.toml".to_owned(),
        };
        Some(text)
    }
}

/// Most names that a message lists.
const MOST_LISTED: usize = 12;

fn listed(names: &[String]) -> String {
    let mut shown: Vec<String> = names.iter().take(MOST_LISTED).map(|name| format!("`{name}`")).collect();
    if names.len() > MOST_LISTED {
        shown.push(format!("… ({} more)", names.len() - MOST_LISTED));
    }
    shown.join(", ")
}
