//! Which format a file has, by its first bytes and the end of its name.

use std::path::Path;

use super::error::RecordingFileError;
use super::format::Format;

/// Bytes that are looked at: a header of EDF, and more.
pub(super) const HEAD: usize = 512;

/// The format of a file; what is neither another format nor known to be unreadable is text.
///
/// - `head`: the first bytes, at least [`HEAD`] where there are as many
///
/// # Errors
/// A format that is known and not read.
pub(super) fn format_of(path: &Path, head: &[u8]) -> Result<Format, RecordingFileError> {
    let not_read = |what: &str, hint| Err(RecordingFileError::NotRead { what: what.to_owned(), hint });
    let end = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let begins = |with: &[u8]| head.starts_with(with);
    let later = |at: usize, with: &[u8]| head.get(at..).is_some_and(|rest| rest.starts_with(with));
    if begins(b"\x89HDF\r\n\x1a\n") || begins(b"MATLAB 7.3") || later(512, b"\x89HDF\r\n\x1a\n") {
        return match end.as_str() {
            "mat" => not_read("a MATLAB file of version 7.3 (HDF5)", "save it with save(name, \"-v7\")"),
            _ => not_read("an HDF5 file", "export it as CSV, or as .mat with save(name, \"-v7\")"),
        };
    }
    if begins(b"MATLAB 5.0 MAT-file") || (end == "mat" && (later(126, b"IM") || later(126, b"MI"))) {
        return Ok(Format::Matlab);
    }
    if begins(b"# Created by Octave") {
        return not_read("a text file of Octave", "save it with save(\"-v7\", name)");
    }
    if begins(b"PK\x03\x04") {
        return match end.as_str() {
            "ods" => not_read("an OpenDocument spreadsheet", "save it as .xlsx or as CSV"),
            "xlsb" => not_read("a binary workbook (.xlsb)", "save it as .xlsx or as CSV"),
            _ => Ok(Format::Workbook),
        };
    }
    if begins(b"\xD0\xCF\x11\xE0\xA1\xB1\x1A\xE1") {
        return not_read("a workbook of Excel before 2007 (.xls)", "save it as .xlsx or as CSV");
    }
    if begins(b"TDSm") {
        return not_read("a TDMS file of LabVIEW", "export it as CSV, or as .mat with save(name, \"-v7\")");
    }
    if begins(b"\xFFBIOSEMI") || is_edf(head) {
        return Ok(Format::Edf);
    }
    if end == "c3d" || (head.len() >= HEAD && head[1] == 0x50 && is_c3d(head[0])) {
        return Ok(Format::C3d);
    }
    match end.as_str() {
        "mat" => not_read("a MATLAB file of level 4, or none", "save it with save(name, \"-v7\")"),
        "xlsx" => Ok(Format::Workbook),
        "edf" | "bdf" => Ok(Format::Edf),
        _ => Ok(Format::Text),
    }
}

/// Whether the first byte of C3D may be this: the block of its parameters, behind that of the header. Blank space is the
/// beginning of a text.
fn is_c3d(first: u8) -> bool {
    first > 1 && first < 0x20 && !first.is_ascii_whitespace()
}

/// Whether a header of EDF begins here: version 0, and its own length, 256 bytes more than 256 a signal.
fn is_edf(head: &[u8]) -> bool {
    let number = |range| head.get(range).and_then(|b| std::str::from_utf8(b).ok()?.trim().parse::<usize>().ok());
    let (length, signals) = (number(184..192), number(252..256));
    head.starts_with(b"0       ") && length.zip(signals).is_some_and(|(length, n)| length == 256 * n.saturating_add(1))
}
