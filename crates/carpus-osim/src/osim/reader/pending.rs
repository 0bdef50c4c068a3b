//! What is read and cannot be placed before everything is.

use super::object::Object;
use crate::osim::document::ElementId;
use crate::osim::spec::FrameIndex;

/// An offset frame whose parent is known by name only.
#[derive(Clone, Debug)]
pub(super) struct UnresolvedOffset {
    pub frame: FrameIndex,
    pub object: Object,
    /// Element and text of the socket; `None` if there is none.
    pub parent: Option<(Option<ElementId>, String)>,
}

/// A frame whose stations are not resolved yet.
pub(super) struct PendingStationFrame {
    pub(super) frame: FrameIndex,
    pub(super) object: Object,
}

/// A joint whose frames are not resolved yet.
pub(super) struct PendingJoint {
    pub(super) object: Object,
    /// In formats that nest joints in bodies: the child body.
    pub(super) child: Option<String>,
}
