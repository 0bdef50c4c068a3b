//! Results on stdout.

use std::io::Write;

use super::failure::{Diagnostic, Failure};
use carpus_numerics::printable;

/// Prints a result to stdout, names with characters that would do something to the terminal written out. Whoever reads
/// it (`| head`) may have had enough: the work is done all the same.
pub fn print_result(text: &str) -> Result<(), Failure> {
    let is_json = text.starts_with(['{', '[']);
    let text = if is_json { printable::visible_json(text) } else { printable::visible_lines(text) };
    let mut stdout = std::io::stdout().lock();
    let written = stdout
        .write_all(text.as_bytes())
        .and_then(|()| if text.ends_with('\n') { Ok(()) } else { stdout.write_all(b"\n") });
    match written.and_then(|()| stdout.flush()) {
        Ok(()) => Ok(()),
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Diagnostic::error(format!("cannot write to standard output: {error}")).into()),
    }
}
