//! Wrapping a line segment over a surface, in the surface's own frame.
