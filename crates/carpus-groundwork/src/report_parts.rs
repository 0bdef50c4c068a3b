//! What a use case contributes to a page about several participants.

use carpus_report::article::{Block, TextTable};

/// What a report of several participants is made of.
#[derive(Clone, Debug, Default)]
pub struct ReportParts {
    /// What was found.
    pub lead: String,
    /// What the reader must know.
    pub warnings: Vec<String>,
    /// Text, tables and figures.
    pub blocks: Vec<Block>,
    /// Names and texts of CSV files.
    pub tables: Vec<(String, String)>,
    /// The main numbers, where there is no page: title above, note below.
    pub overview: Vec<TextTable>,
    /// The tests, for programs.
    pub anova: serde_json::Value,
}

/// A table for [`ReportParts::overview`].
pub fn overview(title: &str, header: &[impl AsRef<str>], left_columns: usize, rows: Vec<Vec<String>>) -> TextTable {
    TextTable {
        title: title.to_string(),
        header: header.iter().map(|h| h.as_ref().to_string()).collect(),
        left_columns,
        rows,
        note: String::new(),
    }
}
