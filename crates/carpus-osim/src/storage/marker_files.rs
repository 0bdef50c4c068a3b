//! Markers from a file of any kind that has them.

use std::path::Path;

use super::c3d::MotionCapture;
use super::error::{StorageError, StorageProblem};
use super::table::Storage;
use super::trc::Markers;
use super::words::extension;

impl Markers {
    /// Reads a `.trc` or `.c3d` file, or a `.sto` file of vectors.
    ///
    /// # Errors
    /// [`StorageError`] with the line.
    pub fn read(path: impl AsRef<Path>) -> Result<Markers, StorageError> {
        let path = path.as_ref();
        match extension(path).as_str() {
            "trc" => {
                let fail = |e| StorageError { file: path.to_owned(), line: 0, problem: StorageProblem::Read(e) };
                Markers::parse(&carpus_numerics::regular_file::read(path).map_err(fail)?, path)
            }
            "sto" => Ok(Markers::from_storage(&Storage::read(path)?)),
            "c3d" => {
                let MotionCapture { markers, warnings, .. } = MotionCapture::read(path)?;
                let none = || StorageError { file: path.to_owned(), line: 0, problem: StorageProblem::NoMarkers };
                if markers.time.is_empty() { Err(none()) } else { Ok(Markers { warnings, ..markers }) }
            }
            found => {
                let problem = StorageProblem::Extension { expected: ".trc, .c3d or .sto", found: found.to_owned() };
                Err(StorageError { file: path.to_owned(), line: 0, problem })
            }
        }
    }
}
