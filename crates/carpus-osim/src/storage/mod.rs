//! Files of numbers over time: OpenSim's `.sto` and `.mot` storages and `.trc` marker trajectories, and `.c3d` of
//! motion capture.
//!
//! In: text. Out: a [`Storage`] (time and named columns) or [`Markers`]; and back, in the format that OpenSim 4.6
//! writes. What OpenSim's tools do with a storage before they use it (padding, filtering, splines) is here, too. Which
//! column is which coordinate, and its unit, is not known here.

mod c3d;
mod error;
mod marker_files;
mod process;
mod read;
mod table;
mod trc;
mod words;
mod write;

pub use c3d::MotionCapture;
pub use error::{StorageError, StorageProblem};
pub use process::spline;
pub use table::Storage;
pub use trc::Markers;
pub use write::printed;
