//! Files that come to an end.

use std::io;
use std::path::Path;

/// The bytes of a file, or of a pipe; a device, which may never end, is refused.
///
/// # Errors
/// The file cannot be read, or is a device or a folder.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let kind = std::fs::metadata(path)?.file_type();
    if is_device(kind) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is a device, not a file"));
    }
    std::fs::read(path)
}

#[cfg(unix)]
fn is_device(kind: std::fs::FileType) -> bool {
    use std::os::unix::fs::FileTypeExt;
    kind.is_char_device() || kind.is_block_device()
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
