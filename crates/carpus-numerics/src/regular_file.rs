//! Files that come to an end.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// The bytes of a file, or of a pipe that another program writes into (`<(…)` of a shell). A device, which may never
/// end, and a pipe that lies in a folder, into which nobody may ever write, are refused.
///
/// # Errors
/// The file cannot be read, or is a device, a pipe in a folder or a folder.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of such a file.
///
/// # Errors
/// As of [`read`]; text that is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read(path)?).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))
}

/// Such a file, to be read piece by piece.
///
/// # Errors
/// As of [`read`].
pub fn open(path: &Path) -> io::Result<File> {
    let kind = std::fs::metadata(path)?.file_type();
    let refused = |what: &str| Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    if is_device(kind) {
        return refused("it is a device, not a file");
    }
    // A pipe between programs has no place in a file system.
    if is_pipe(kind) && path.canonicalize().is_ok() {
        return refused("it is a pipe, not a file");
    }
    let file = File::open(path)?;
    if kind.is_dir() { Err(io::ErrorKind::IsADirectory.into()) } else { Ok(file) }
}

#[cfg(unix)]
fn is_device(kind: std::fs::FileType) -> bool {
    use std::os::unix::fs::FileTypeExt;
    kind.is_char_device() || kind.is_block_device()
}

#[cfg(unix)]
fn is_pipe(kind: std::fs::FileType) -> bool {
    use std::os::unix::fs::FileTypeExt;
    kind.is_fifo()
}

#[cfg(not(unix))]
fn is_pipe(_: std::fs::FileType) -> bool {
    false
}

#[cfg(not(unix))]
fn is_device(_: std::fs::FileType) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn verif_devices_are_refused() {
        assert_eq!(read(Path::new("/dev/zero")).map_err(|e| e.kind()), Err(io::ErrorKind::InvalidInput));
        let folder = tempfile::tempdir().unwrap_or_else(|e| panic!("{e}"));
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap_or_else(|e| panic!("{e}"));
        assert!(made.success());
        assert_eq!(read_text(&pipe).map_err(|e| e.kind()), Err(io::ErrorKind::InvalidInput));
    }

    #[test]
    fn verif_files_are_read() {
        let folder = tempfile::tempdir().unwrap_or_else(|e| panic!("{e}"));
        let file = folder.path().join("a");
        std::fs::write(&file, b"text").unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(read(&file).ok(), Some(b"text".to_vec()));
        assert!(read(folder.path()).is_err() && read(&folder.path().join("b")).is_err());
    }
}
