//! The folder that a command writes into.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::failure::{Failure, Message};
use crate::printable::{deceptive_in, number_of};

/// A folder that was found to be writable before anything was computed. Files appear in it whole or not at all.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    /// Files that must not be overwritten, as canonical paths.
    inputs: Vec<PathBuf>,
}

impl OutputFolder {
    /// Makes the folder if it is missing and tries to write into it.
    ///
    /// - `inputs`: files that were or will be read; writing over one of them is refused
    ///
    /// # Errors
    /// The folder cannot be made or written to.
    pub fn create(path: &Path, inputs: &[PathBuf]) -> Result<OutputFolder, Failure> {
        let unwritable = |error: std::io::Error| {
            Message::error(format!("cannot write results here: {}", reason(&error)))
                .in_file(path)
                .hint("choose another folder with --out, or change its permissions")
        };
        std::fs::create_dir_all(path).map_err(unwritable)?;
        tempfile::Builder::new().prefix(".carpus-").tempfile_in(path).map_err(unwritable)?;
        let inputs = inputs.iter().filter_map(|file| file.canonicalize().ok()).collect();
        Ok(OutputFolder { path: path.to_owned(), inputs })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a file, by way of a temporary one, making the folders above it.
    ///
    /// # Errors
    /// The disk; or the file is one of the inputs.
    pub fn write(&self, relative: impl AsRef<Path>, bytes: &[u8]) -> Result<PathBuf, Failure> {
        let target = self.path.join(&relative);
        if let Some(found) = deceptive_in(&relative.as_ref().to_string_lossy()) {
            let text =
                format!("the name of this file has the character {}, which does not show as it is", number_of(found));
            return Err(Message::error(text)
                .in_file(&target)
                .hint("change the name that the file is made from")
                .into());
        }
        self.refuse_input(&target)?;
        let unwritable =
            |error: std::io::Error| Message::error(format!("cannot be written: {}", reason(&error))).in_file(&target);
        let folder = target.parent().unwrap_or(&self.path);
        std::fs::create_dir_all(folder).map_err(unwritable)?;
        let mut file = tempfile::Builder::new().prefix(".carpus-").tempfile_in(folder).map_err(unwritable)?;
        file.write_all(bytes).map_err(unwritable)?;
        allow_reading(file.as_file()).map_err(unwritable)?;
        file.persist(&target).map_err(|e| unwritable(e.error))?;
        Ok(target)
    }

    /// Fails if `target` is one of the files that were read.
    pub fn refuse_input(&self, target: &Path) -> Result<(), Failure> {
        match target.canonicalize() {
            Ok(found) if self.inputs.contains(&found) => {
                Err(Message::error("this is one of the files that are read; it is not overwritten")
                    .in_file(target)
                    .hint("choose another folder with --out")
                    .into())
            }
            _ => Ok(()),
        }
    }
}

/// Temporary files are private to the user; results are not.
#[cfg(unix)]
fn allow_reading(file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn allow_reading(_: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}

/// The operating system's words without its error number.
fn reason(error: &std::io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error").next().unwrap_or(&text).to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_inputs_are_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("model.osim");
        std::fs::write(&model, "mine").unwrap();
        let out = OutputFolder::create(folder.path(), std::slice::from_ref(&model)).unwrap();
        assert!(matches!(out.write("model.osim", b"theirs"), Err(Failure::Input(_))));
        assert_eq!(std::fs::read_to_string(&model).unwrap(), "mine");
        out.write("a/b/other.txt", b"text").unwrap();
        assert_eq!(std::fs::read_to_string(folder.path().join("a/b/other.txt")).unwrap(), "text");
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 2, "no temporary file stays behind");
    }

    #[test]
    fn verif_a_file_in_place_of_the_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("results");
        std::fs::write(&file, "").unwrap();
        assert!(matches!(OutputFolder::create(&file, &[]), Err(Failure::Input(_))));
        assert!(matches!(OutputFolder::create(&file.join("below"), &[]), Err(Failure::Input(_))));
    }
}
