//! Where components stand: in a file, and in the lists of a [`ModelSpec`](super::ModelSpec).

/// Declares an index type into one of the vectors of [`ModelSpec`].
macro_rules! index_type {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub struct $name(pub usize);
    };
}
index_type!(
    /// Index into [`ModelSpec::bodies`].
    BodyIndex
);
index_type!(
    /// Index into [`ModelSpec::frames`]; frame 0 is ground.
    FrameIndex
);
index_type!(
    /// Index into [`ModelSpec::joints`].
    JointIndex
);
index_type!(
    /// Index into [`ModelSpec::coordinates`].
    CoordinateIndex
);
index_type!(
    /// Index into [`ModelSpec::wrap_objects`].
    WrapObjectIndex
);
index_type!(
    /// Index into [`ModelSpec::muscles`].
    MuscleIndex
);

/// Where in its source file something stands.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Location {
    /// The file: 0 for the model's own, otherwise the place, counted from 1, among the files of forces that were added
    /// to it ([`crate::osim::OsimFile::with_force_sets`]).
    pub source: usize,
    /// Line of the element's start tag, counted from 1; 0 if the component was not read from a file.
    pub line: usize,
    /// Absolute component path, e.g. `/forceset/ECRL`.
    pub path: String,
    /// The document element (handle used for edits); `None` if the component was not read from a file.
    pub element: Option<usize>,
}

impl Location {
    /// Key that sorts components of one kind in the model's order: those in its own list, in its sets, in its component
    /// set; and within each of these as they were read.
    pub fn order(&self) -> (usize, usize, Option<usize>, usize) {
        let list = match self.path.trim_start_matches('/').split_once('/') {
            None => 0,
            Some(("componentset", _)) => 2,
            Some(_) => 1,
        };
        (list, self.source, self.element, self.line)
    }

    /// Whether it stands in the model's force set: those are the forces and muscles that OpenSim's tools leave out,
    /// control or list by name. Others act all the same.
    pub fn is_in_force_set(&self) -> bool {
        is_in_force_set(&self.path)
    }
}

/// Whether a component's path leads into the model's force set.
pub(in crate::osim) fn is_in_force_set(path: &str) -> bool {
    path.strip_prefix("/forceset").is_some_and(|rest| rest.starts_with('/'))
}
