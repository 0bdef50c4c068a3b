//! Archives (zip) of which a workbook is one: the files in it, by name.
//!
//! # References
//! PKWARE, *APPNOTE.TXT – .ZIP File Format Specification*, 4.3. Files of more than 4 GB and encrypted ones are not
//! read.

use std::io::Read;

use flate2::Crc;
use flate2::read::DeflateDecoder;

use crate::study::recording_file::error::RecordingFileError;
use crate::study::recording_file::format::Format;

/// Bytes of the record at the end of an archive, and of a comment behind it.
const END: usize = 22;
const MOST_COMMENT: usize = 1 << 16;
/// Most bytes that the files of an archive take once unpacked: a gigabyte.
const MOST_BYTES: usize = 1 << 30;

/// An archive in memory.
pub struct Archive<'b> {
    bytes: &'b [u8],
    entries: Vec<Entry>,
    /// Bytes that were unpacked.
    unpacked: usize,
}

struct Entry {
    name: String,
    method: usize,
    checksum: u32,
    packed: usize,
    start: usize,
}

impl<'b> Archive<'b> {
    /// Reads the directory.
    ///
    /// # Errors
    /// Bytes that are no archive.
    pub fn of(bytes: &'b [u8]) -> Result<Archive<'b>, RecordingFileError> {
        let lowest = bytes.len().saturating_sub(END + MOST_COMMENT);
        let is_end = |at: &usize| bytes[*at..].starts_with(b"PK\x05\x06");
        let end = (lowest..bytes.len()).rev().find(is_end);
        let end = end.ok_or_else(|| broken("end", "the directory of an archive", format!("{} bytes", bytes.len())))?;
        let (count, mut at) = (whole(bytes, end + 10, 2)?, whole(bytes, end + 16, 4)?);
        let mut entries = Vec::new();
        for _ in 0..count {
            if bytes.get(at..at.saturating_add(4)) != Some(b"PK\x01\x02") {
                return Err(broken("directory", &format!("{count} entries"), entries.len()));
            }
            let [name, extra, comment] = [28, 30, 32].map(|from| whole(bytes, at + from, 2));
            let (name, extra, comment) = (name?, extra?, comment?);
            let from = at + 46;
            let text = bytes.get(from..from + name).ok_or_else(|| broken("directory", "a name", "the end"))?;
            entries.push(Entry {
                name: String::from_utf8_lossy(text).replace('\\', "/"),
                method: whole(bytes, at + 10, 2)?,
                checksum: whole(bytes, at + 16, 4)? as u32,
                packed: whole(bytes, at + 20, 4)?,
                start: whole(bytes, at + 42, 4)?,
            });
            at = from + name + extra + comment;
        }
        Ok(Archive { bytes, entries, unpacked: 0 })
    }

    /// The text of a file; `None` if there is none of that name.
    ///
    /// # Errors
    /// A file that is damaged, packed otherwise than usual, or no text; more than is read.
    pub fn text(&mut self, name: &str) -> Result<Option<String>, RecordingFileError> {
        let Some(entry) = self.entries.iter().find(|entry| entry.name.eq_ignore_ascii_case(name)) else {
            return Ok(None);
        };
        let start = entry.start;
        let names = whole(self.bytes, start.saturating_add(26), 2)? + whole(self.bytes, start.saturating_add(28), 2)?;
        let from = start + 30 + names;
        let cut = || broken(name, &format!("{} bytes", entry.packed), "the end of the file");
        let packed = self.bytes.get(from..from.saturating_add(entry.packed)).ok_or_else(cut)?;
        let left = (MOST_BYTES - self.unpacked) as u64 + 1;
        let mut bytes = Vec::new();
        let read = match entry.method {
            0 => packed.take(left).read_to_end(&mut bytes),
            8 => DeflateDecoder::new(packed).take(left).read_to_end(&mut bytes),
            other => return Err(broken(name, "a file that is stored or deflated", format!("method {other}"))),
        };
        read.map_err(|e| broken(name, "packed data", e))?;
        self.unpacked += bytes.len();
        if self.unpacked > MOST_BYTES {
            let (format, what, limit) = (Format::Workbook, "bytes once unpacked", MOST_BYTES);
            return Err(RecordingFileError::TooLarge { format, what, limit });
        }
        let mut sum = Crc::new();
        sum.update(&bytes);
        if sum.sum() != entry.checksum {
            return Err(broken(name, &format!("checksum {:08x}", entry.checksum), format!("{:08x}", sum.sum())));
        }
        String::from_utf8(bytes).map(Some).map_err(|e| broken(name, "UTF-8", e))
    }
}

/// A whole number of some bytes, the lowest first.
fn whole(bytes: &[u8], at: usize, length: usize) -> Result<usize, RecordingFileError> {
    let found = bytes.get(at..at.saturating_add(length));
    let found = found.ok_or_else(|| broken("directory", "a record of it", format!("the end, at byte {at}")))?;
    Ok(found.iter().rev().fold(0, |value, byte| value << 8 | usize::from(*byte)))
}

fn broken(place: &str, expected: &str, found: impl std::fmt::Display) -> RecordingFileError {
    RecordingFileError::Broken {
        format: Format::Workbook,
        place: place.to_owned(),
        expected: expected.to_owned(),
        found: found.to_string(),
    }
}
