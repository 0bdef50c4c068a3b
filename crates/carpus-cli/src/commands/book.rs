//! `carpus book`: the pages of the book that are made from the program.

use crate::args::BookArgs;
use crate::book;
use crate::failure::Failure;
use crate::stdout::print_result;
use carpus_session::output::OutputFolder;

/// Runs the command.
///
/// # Errors
/// The folder.
pub fn run(args: &BookArgs) -> Result<(), Failure> {
    let folder = OutputFolder::create(&args.out, &[])?;
    let pages = book::pages();
    for (path, text) in &pages {
        folder.write(path, text.as_bytes())?;
    }
    print_result(&format!("{} pages in {}", pages.len(), args.out.display()))
}
