//! What is needed to run work again: its words, the program's version, the seed, and hashes of its input.

use std::fmt::Write;
use std::io::Read;
use std::path::Path;

use sha2::{Digest, Sha256};

use super::diagnostic::{Diagnostic, Failure};
use carpus_report::results::{InputFile, Provenance};

/// Seed of everything random where none is asked for.
pub const DEFAULT_SEED: u64 = 1;

/// Provenance of a run that read `inputs`.
///
/// - `command`: the words that it was asked for with
pub fn provenance(command: &str, seed: u64, inputs: Vec<InputFile>) -> Provenance {
    Provenance {
        program: "carpus".to_string(),
        version: env!("CARGO_PKG_VERSION").to_string(),
        command: command.to_string(),
        seed,
        inputs,
    }
}

/// Provenance of work on files that are of no open study.
///
/// - `command`: the words that it was asked for with; without them the request itself
pub fn made_by(command: Option<&str>, request: &impl std::fmt::Debug, seed: u64, inputs: Vec<InputFile>) -> Provenance {
    match command {
        Some(command) => provenance(command, seed, inputs),
        None => provenance(&format!("library: {request:?}"), seed, inputs),
    }
}

/// A command as it is typed, quoted for a shell where needed.
///
/// - `words`: the arguments, without the name of the program
pub fn command_line(words: impl IntoIterator<Item = String>) -> String {
    let quoted = |word: String| {
        let plain = |c: char| c.is_alphanumeric() || "-_./=:,+%@".contains(c);
        if !word.is_empty() && word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    };
    std::iter::once("carpus".to_owned()).chain(words.into_iter().map(quoted)).collect::<Vec<_>>().join(" ")
}

/// A file and its hash.
///
/// # Errors
/// The file cannot be read.
pub fn input_file(path: &Path, shown: &str, role: &str) -> Result<InputFile, Failure> {
    let unreadable = |error: std::io::Error| Diagnostic::error(format!("cannot be read: {error}")).in_file(path);
    let mut file = carpus_numerics::regular_file::open(path).map_err(unreadable)?;
    let mut hasher = Sha256::new();
    let mut buffer = [0; 1 << 16];
    loop {
        match file.read(&mut buffer).map_err(unreadable)? {
            0 => break,
            n => hasher.update(&buffer[..n]),
        }
    }
    Ok(InputFile { path: shown.to_string(), role: role.to_string(), sha256: hexadecimal(&hasher.finalize()) })
}

/// What passes bytes on and knows their SHA-256.
pub struct Hashed<W> {
    to: W,
    hasher: Sha256,
}

impl<W: std::io::Write> Hashed<W> {
    /// Nothing was written yet.
    pub fn new(to: W) -> Hashed<W> {
        Hashed { to, hasher: Sha256::new() }
    }

    /// Of what was written, hexadecimal.
    pub fn hash(self) -> String {
        hexadecimal(&self.hasher.finalize())
    }
}

impl<W: std::io::Write> std::io::Write for Hashed<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let count = self.to.write(bytes)?;
        self.hasher.update(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.to.flush()
    }
}

/// SHA-256 of bytes, hexadecimal.
pub fn hash_of(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// SHA-256 of texts, hexadecimal; where one text ends and the next begins counts.
pub fn hash(texts: &[&str]) -> String {
    let mut hasher = Sha256::new();
    for text in texts {
        hasher.update((text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    }
    hexadecimal(&hasher.finalize())
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
