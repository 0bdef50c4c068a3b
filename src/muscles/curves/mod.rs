//! The Millard 2012 muscle curves.
