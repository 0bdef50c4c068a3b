//! What a command contributes to a page about several participants.

use carpus_report::article::Block;

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
    /// For a terminal.
    pub readable: String,
    /// The tests, for programs.
    pub anova: serde_json::Value,
}
