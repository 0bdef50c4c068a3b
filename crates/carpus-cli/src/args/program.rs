//! Arguments of the commands about the program itself.

use std::path::PathBuf;

use clap::Args;

use super::parts::text;

/// `carpus completions`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/completions.txt")))]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_name = "SHELL", value_enum)]
    pub shell: clap_complete::Shell,
}

/// `carpus man`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus man --out ~/.local/share/man/man1\n  man carpus-personalize")]
pub struct ManArgs {
    /// Folder for carpus.1, carpus-demo.1, …
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// `carpus book`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus book --out docs/src\n\nWrites DIR/reference/commands.md and DIR/catalogue/."
)]
pub struct BookArgs {
    /// Folder of the book's sources
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}
