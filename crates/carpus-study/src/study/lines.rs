//! Bytes of a text file with every kind of line end brought to one, so that line numbers are those of an editor.

use std::io::{BufRead, Read};

use super::dialect::{Dialect, Separator, joined};

/// Streams a text with `\n` for `\r\n` and `\r`, and a space in every blank line after the first line with content.
///
/// The CSV parser skips empty lines without a word and counts a record from the end of the one before; both make the
/// line it reports differ from the one an editor shows. A line with a space is a record, which the reader skips itself.
///
/// Of a file as a recorder exports it, lines that are neither header nor samples are blank, and cells between spaces
/// are separated by tabs ([`Dialect`]).
pub(crate) struct Lines<R> {
    source: R,
    line: Vec<u8>,
    served: usize,
    content_seen: bool,
    /// Lines that were read.
    count: usize,
    dialect: Dialect,
}

impl<R: BufRead> Lines<R> {
    /// The lines of a file of this layout.
    pub fn of_dialect(source: R, dialect: Dialect) -> Self {
        Self { source, line: Vec::new(), served: 0, content_seen: false, count: 0, dialect }
    }

    /// Fills the buffer with the next line of the source; false at its end.
    fn refill(&mut self) -> std::io::Result<bool> {
        self.line.clear();
        self.served = 0;
        let is_over = self.dialect.last_line.is_some_and(|last| self.count >= last);
        if is_over || self.source.read_until(b'\n', &mut self.line)? == 0 {
            return Ok(false);
        }
        let ended = self.line.ends_with(b"\n");
        while self.line.last().is_some_and(|b| matches!(b, b'\n' | b'\r')) {
            self.line.pop();
        }
        self.line.iter_mut().filter(|b| **b == b'\r').for_each(|b| *b = b'\n');
        self.count += 1;
        if !self.dialect.is_plain() {
            self.rewrite();
        }
        let is_blank = self.line.is_empty();
        if is_blank && self.content_seen {
            self.line.push(b' ');
        }
        self.content_seen |= !is_blank;
        if ended {
            self.line.push(b'\n');
        }
        Ok(true)
    }
}

impl<R> Lines<R> {
    /// Brings a line of an exported file to what the CSV parser reads.
    fn rewrite(&mut self) {
        if self.dialect.is_skipped(self.count) {
            self.line.clear();
        } else if self.dialect.separator == Separator::Spaces {
            self.line = joined(&text_of(&self.line)).into_bytes();
        } else if self.count == self.dialect.header_line {
            self.line = text_of(&self.line).into_bytes();
        }
    }
}

/// Bytes as text: UTF-8, or else one character a byte, as programs of Windows in the west write `°` and `µ`.
pub(crate) fn text_of(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|b| char::from(*b)).collect(),
    }
}

impl<R: BufRead> Read for Lines<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        while self.served == self.line.len() {
            if !self.refill()? {
                return Ok(0);
            }
        }
        let n = out.len().min(self.line.len() - self.served);
        out[..n].copy_from_slice(&self.line[self.served..self.served + n]);
        self.served += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> String {
        let mut out = String::new();
        Lines::of_dialect(text.as_bytes(), Dialect::plain()).read_to_string(&mut out).expect("bytes in memory");
        out
    }

    #[test]
    fn verif_line_ends_become_one() {
        assert_eq!(read("a\r\nb\nc\rd"), "a\nb\nc\nd");
        assert_eq!(read("\r\n\na\n\n\r\nb\n"), "\n\na\n \n \nb\n");
        assert_eq!(read(""), "");
    }
}
