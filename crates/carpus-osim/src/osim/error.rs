//! What can be wrong with an `.osim` file: data first, message second, hint apart.
//!
//! Messages read `file:line: /object/path: what is wrong`; the hint says what to do.

use thiserror::Error;

use carpus_numerics::printable::{number, number_of, visible};

/// Why a file could not be turned into a model.
#[derive(Debug, Error)]
pub enum OsimError {
    /// The file could not be read at all.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// File name.
        file: String,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The text is not a well-formed document.
    #[error(transparent)]
    Document(#[from] DocumentError),
    /// Well-formed, but something else than an OpenSim model.
    #[error(
        "{file}:{line}: not an OpenSim model: expected <OpenSimDocument Version=\"…\"> with a <Model>, found {found}"
    )]
    NotAModel {
        /// File name.
        file: String,
        /// Line of the element found instead.
        line: usize,
        /// What was found.
        found: String,
    },
    /// Well-formed, but something else than a file of forces.
    #[error("{file}:{line}: not a set of forces: expected <ForceSet>, found {found}")]
    NotAForceSet {
        /// File name.
        file: String,
        /// Line of the element found instead.
        line: usize,
        /// What was found.
        found: String,
    },
    /// A file of a format that is not understood.
    #[error("{file}:{line}: file format version {found} is not supported; expected {oldest} to {newest}")]
    UnsupportedVersion {
        /// File name.
        file: String,
        /// Line of the version.
        line: usize,
        /// The version as the file gives it.
        found: String,
        /// Oldest version that is read.
        oldest: u32,
        /// Newest version that is read.
        newest: u32,
    },
    /// The model contains values or references that cannot be used.
    #[error("{}{}", .problems.first().map_or_else(String::new, ToString::to_string), more(.problems.len()))]
    Invalid {
        /// Everything found, in the order of the file.
        problems: Vec<Problem>,
    },
}

fn more(count: usize) -> String {
    match count {
        0 | 1 => String::new(),
        n => format!(" (and {} more)", n - 1),
    }
}

impl OsimError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            OsimError::Read { .. } => None,
            OsimError::Document(error) => error.hint(),
            OsimError::NotAForceSet { .. } => {
                Some("force_set_files names files with <OpenSimDocument><ForceSet><objects>…".to_owned())
            }
            OsimError::NotAModel { .. } => {
                Some("give the path of a model (.osim), not of a setup file, motion or geometry".to_owned())
            }
            OsimError::UnsupportedVersion { found, oldest, .. } => Some(match found.parse::<u32>() {
                Ok(version) if version < *oldest => {
                    "open the model in OpenSim 3.3 and save it to bring it to a newer format".to_owned()
                }
                _ => "save the model with OpenSim 4.6 or older".to_owned(),
            }),
            OsimError::Invalid { problems } => problems.first().and_then(|problem| problem.hint()),
        }
    }

    /// The file that it is about; of several, the first.
    pub fn file(&self) -> &str {
        match self {
            OsimError::Read { file, .. }
            | OsimError::NotAModel { file, .. }
            | OsimError::NotAForceSet { file, .. }
            | OsimError::UnsupportedVersion { file, .. } => file,
            OsimError::Document(error) => &error.file,
            OsimError::Invalid { problems } => problems.first().map_or("", |problem| &problem.file),
        }
    }

    /// All problems of an invalid model; empty for other errors.
    pub fn problems(&self) -> &[Problem] {
        match self {
            OsimError::Invalid { problems } => problems,
            _ => &[],
        }
    }
}

/// A document that is not well-formed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{file}:{line}: {kind}")]
pub struct DocumentError {
    /// File name.
    pub file: String,
    /// Line, counted from 1.
    pub line: usize,
    /// What is wrong.
    pub kind: DocumentErrorKind,
}

impl DocumentError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match &self.kind {
            DocumentErrorKind::NotClosed { .. } => {
                Some("the file seems to be cut off: copy or export it again".to_owned())
            }
            DocumentErrorKind::NoElement => Some("the file is empty or not an .osim file".to_owned()),
            DocumentErrorKind::MismatchedEnd { expected, opened_line, .. } => {
                Some(format!("<{expected}> was opened in line {opened_line} and has to be closed first"))
            }
            _ => None,
        }
    }
}

/// Ways in which a document is not well-formed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum DocumentErrorKind {
    /// Nothing in it.
    #[error("no element: expected <OpenSimDocument>, found an empty document")]
    NoElement,
    /// The end of the file came first.
    #[error("the file ends inside <{tag}> (opened in line {opened_line}); expected </{tag}>")]
    NotClosed {
        /// The innermost open element.
        tag: String,
        /// Where it was opened.
        opened_line: usize,
    },
    /// Wrong nesting.
    #[error("wrong nesting: expected </{expected}> (opened in line {opened_line}), found </{found}>")]
    MismatchedEnd {
        /// The innermost open element.
        expected: String,
        /// The end tag found.
        found: String,
        /// Where the innermost open element was opened.
        opened_line: usize,
    },
    /// An end tag while nothing is open.
    #[error("</{found}> closes nothing")]
    UnexpectedEnd {
        /// The end tag.
        found: String,
    },
    /// A second element beside the root.
    #[error("second root element <{tag}>: expected one")]
    SecondRoot {
        /// Its tag.
        tag: String,
    },
    /// Text before or after the root element.
    #[error("text outside the root element")]
    TextOutsideRoot,
    /// Nesting beyond any real model.
    #[error("elements are nested deeper than {limit} levels")]
    TooDeep {
        /// The limit.
        limit: usize,
    },
    /// Broken markup.
    #[error("broken markup: {message}")]
    Markup {
        /// The XML reader's words.
        message: String,
    },
}

/// A value or reference of a model that cannot be used.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{file}:{line}: {path}: {kind}")]
pub struct Problem {
    /// File name.
    pub file: String,
    /// Line, counted from 1.
    pub line: usize,
    /// Absolute path of the component.
    pub path: String,
    /// What is wrong.
    pub kind: ProblemKind,
}

/// Kinds of [`Problem`].
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ProblemKind {
    /// A name of several lines or columns, which would tear apart every table that it stands in.
    #[error("name \"{}\": expected a name in one line, found {}", visible(.name), number_of(*.found))]
    NameOfLines {
        /// The name.
        name: String,
        /// The first character that begins a line or column.
        found: char,
    },
    /// Text that is not what the property needs.
    #[error("{property}: expected {expected}, found \"{found}\"")]
    NotReadable {
        /// Property name.
        property: String,
        /// What is needed.
        expected: &'static str,
        /// What the file has.
        found: String,
    },
    /// A number outside its allowed range.
    #[error("{property}: expected {expected}, found {}", number(*found))]
    OutOfRange {
        /// Property name.
        property: String,
        /// What is allowed, with unit.
        expected: &'static str,
        /// The value.
        found: f64,
    },
    /// A property without which the component means nothing.
    #[error("{property} is missing: expected {expected}")]
    Missing {
        /// Property or element name.
        property: String,
        /// What is needed.
        expected: &'static str,
    },
    /// A reference to something that the model does not have.
    #[error("{property}: no {what} named \"{name}\" in this model")]
    UnknownReference {
        /// Property or socket name.
        property: String,
        /// What kind of component is needed.
        what: &'static str,
        /// The name or path as the file gives it.
        name: String,
        /// The most similar name in the model.
        nearest: Option<String>,
    },
    /// A reference to a frame of a class that is not implemented.
    #[error("{property}: \"{name}\" is a {class} (line {line}), a frame that is not supported")]
    UnsupportedFrame {
        /// Property or socket name.
        property: String,
        /// The name or path as the file gives it.
        name: String,
        /// OpenSim class name.
        class: String,
        /// Line of the frame.
        line: usize,
    },
    /// A path that cannot be one.
    #[error("path has {found} points: expected at least two")]
    TooFewPathPoints {
        /// Number of points.
        found: usize,
    },
    /// Frames that are fixed to one another in a circle.
    #[error("the frame is fixed to itself through its parents")]
    FrameLoop,
    /// Number of coordinates that the joint class cannot have.
    #[error("expected {expected} coordinates, found {found}")]
    WrongCoordinateCount {
        /// What the class needs.
        expected: usize,
        /// What the file has.
        found: usize,
    },
    /// A coordinate that no axis of the joint uses.
    #[error("coordinate \"{name}\" is not used by any axis of the joint")]
    UnusedCoordinate {
        /// Its name.
        name: String,
    },
    /// A class that exists in OpenSim but is not implemented, in a place where leaving it out would give wrong motion.
    #[error("{class} is not supported here")]
    UnsupportedClass {
        /// OpenSim class name.
        class: String,
    },
}

impl Problem {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match &self.kind {
            ProblemKind::UnknownReference { nearest: Some(nearest), .. } => {
                Some(format!("did you mean \"{nearest}\"?"))
            }
            ProblemKind::NameOfLines { .. } => {
                Some("OpenSim 4.6 refuses line breaks and tabs in names, too: write the name anew".to_owned())
            }
            ProblemKind::UnsupportedFrame { .. } => Some(
                "put a PhysicalOffsetFrame on the same body in its place: OpenSim's findTransformInBaseFrame() gives \
                 its translation and orientation"
                    .to_owned(),
            ),
            ProblemKind::TooFewPathPoints { .. } => {
                Some("add the points in <GeometryPath><PathPointSet><objects>".to_owned())
            }
            _ => None,
        }
    }
}

/// A file that could not be written; what was there before is untouched.
#[derive(Debug, Error)]
#[error("{file}: cannot be written: {source}")]
pub struct WriteError {
    /// File name.
    pub file: String,
    /// The operating system's reason.
    pub source: std::io::Error,
}

impl WriteError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self.source.kind() {
            std::io::ErrorKind::NotFound => Some("the folder does not exist: create it first".to_owned()),
            std::io::ErrorKind::PermissionDenied => Some("choose a folder that you may write to with --out".to_owned()),
            _ => None,
        }
    }
}

/// The candidate most similar to `name`, if any is similar enough to be a slip of the pen.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let limit = (name.chars().count() / 3).max(2);
    candidates
        .into_iter()
        .filter(|candidate| *candidate != name)
        .map(|candidate| (strsim::levenshtein(&name.to_lowercase(), &candidate.to_lowercase()), candidate))
        .filter(|&(distance, _)| distance <= limit)
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, candidate)| candidate.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_nearest_prefers_the_smallest_distance_and_refuses_strangers() {
        assert_eq!(nearest("wrist_flexon", ["elbow_flexion", "wrist_flexion"]), Some("wrist_flexion".to_owned()));
        assert_eq!(nearest("ECRL", ["thorax", "humerus"]), None);
    }
}
