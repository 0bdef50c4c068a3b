//! Indices, and whether they lead somewhere.

use super::error::CompileError;
use carpus_osim::osim::spec::{BodyIndex, CoordinateIndex, Location, ModelSpec};

/// What a frame is rigidly fixed to: ground (0) or a body (its [`BodyIndex`] + 1). OpenSim's "base frame".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BaseIndex(pub usize);

impl BaseIndex {
    /// Ground.
    pub const GROUND: BaseIndex = BaseIndex(0);

    /// The body; `None` for ground.
    pub fn body(self) -> Option<BodyIndex> {
        self.0.checked_sub(1).map(BodyIndex)
    }
}

impl From<BodyIndex> for BaseIndex {
    fn from(body: BodyIndex) -> Self {
        BaseIndex(body.0 + 1)
    }
}

/// `coordinate` if the specification has it.
pub(super) fn coordinate_in(
    spec: &ModelSpec,
    coordinate: CoordinateIndex,
    at: &Location,
) -> Result<CoordinateIndex, CompileError> {
    if coordinate.0 < spec.coordinates.len() {
        Ok(coordinate)
    } else {
        Err(CompileError::BadReference {
            at: at.clone(),
            what: "coordinate",
            index: coordinate.0,
            count: spec.coordinates.len(),
        })
    }
}
