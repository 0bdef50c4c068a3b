//! The buffer that a path's evaluation fills.

use super::path::{Path, PathWrap};
use super::wrapping::{Attempt, Wrap, WrapPath};
use crate::multibody::{BaseIndex, Cache};
use carpus_numerics::spatial::Transform;
use carpus_osim::osim::spec::WrapObjectIndex;
use nalgebra::Vector3;

/// Where a point of the current path comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointOrigin {
    /// A path point, by its position in the path's specification.
    Point(usize),
    /// Where the path meets the surface of a wrap, by the wrap's position in the specification.
    WrapStart(usize),
    /// Where it leaves that surface.
    WrapEnd(usize),
}

impl PointOrigin {
    /// A small number that tells most points of a path apart.
    fn number(self) -> usize {
        match self {
            PointOrigin::Point(i) => i,
            PointOrigin::WrapStart(w) => 5 + 2 * w,
            PointOrigin::WrapEnd(w) => 6 + 2 * w,
        }
    }
}

/// A point that the path runs through at the present pose.
#[derive(Clone, Copy, Debug)]
#[allow(non_snake_case)]
pub struct CurrentPoint {
    /// Where it comes from.
    pub origin: PointOrigin,
    /// What it is fixed to.
    pub base: BaseIndex,
    /// Location in the base `p_BS` [m].
    pub p_BS: Vector3<f64>,
    /// Location in ground `p_GS` [m].
    pub p_GS: Vector3<f64>,
    /// Location in ground that straight pieces are measured from and to [m]: `p_GS`, except that a tangent point which
    /// a later pass over several wrap objects has moved is still measured where it was put first.
    ///
    /// OpenSim keeps the ground location of a point until the pose changes and overlooks that its own passes move
    /// tangent points; lengths and directions of such paths are therefore a few millimetres off, in OpenSim and here.
    pub measured_p_GS: Vector3<f64>,
    /// The wrap object that it lies on.
    pub wrap_object: Option<WrapObjectIndex>,
    /// For a [`PointOrigin::WrapEnd`]: length of the curve that ends here [m]; else 0.
    pub wrap_length: f64,
}

/// Number of recent segments whose wrap is remembered, per wrap.
const MEMORY_PER_WRAP: usize = 16;

/// What is known of wrapping one segment.
#[derive(Clone, Copy, Debug)]
struct Remembered {
    p1: Vector3<f64>,
    p2: Vector3<f64>,
    attempt: Attempt,
}

/// Points and length of a path at one pose, and the memory that its evaluation needs. Reused between poses; after the
/// first evaluations nothing is allocated.
///
/// Belongs to one path: made by [`Path::new_geometry`], filled by [`Path::update`].
#[derive(Clone, Debug)]
#[allow(non_snake_case)]
pub struct PathGeometry {
    pub(super) length: f64,
    pub(super) points: Vec<CurrentPoint>,
    /// Pose of every wrap surface in ground.
    pub(super) X_GW: Vec<Transform>,
    pub(super) order: Vec<usize>,
    /// First point of the segment that each wrap took last, which it likely takes again.
    pub(super) favourite: Vec<Option<PointOrigin>>,
    /// Where the tangent points of each wrap were put first at this pose, in ground.
    pub(super) first_tangents_G: Vec<Option<[Vector3<f64>; 2]>>,
    /// The latest wrap of each segment. Wrapping is a pure function of the segment's ends, so that a segment whose ends
    /// have not moved (in a later pass, or at a pose that does not touch it) need not be wrapped again.
    memory: Vec<Remembered>,
}

impl Path {
    /// A buffer for [`Path::update`].
    pub fn new_geometry(&self) -> PathGeometry {
        PathGeometry::new(self)
    }
}

impl PathGeometry {
    pub(super) fn new(path: &Path) -> PathGeometry {
        let nowhere = Vector3::repeat(f64::NAN);
        PathGeometry {
            length: f64::NAN,
            points: Vec::with_capacity(path.points.len() + 2 * path.wraps.len()),
            X_GW: vec![Transform::identity(); path.wraps.len()],
            order: (0..path.wraps.len()).collect(),
            favourite: vec![None; path.wraps.len()],
            first_tangents_G: vec![None; path.wraps.len()],
            memory: vec![
                Remembered { p1: nowhere, p2: nowhere, attempt: Attempt::Done(Wrap::NO_WRAP) };
                path.wraps.len() * MEMORY_PER_WRAP
            ],
        }
    }

    /// Length of the path [m].
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Points that the path runs through, from origin to insertion.
    pub fn points(&self) -> &[CurrentPoint] {
        &self.points
    }

    /// Fills in the active points and the poses of the wrap surfaces.
    #[allow(non_snake_case)]
    pub(super) fn start(&mut self, path: &Path, q: &[f64], cache: &Cache) {
        self.points.clear();
        self.first_tangents_G.fill(None);
        for (i, point) in path.points.iter().enumerate() {
            if point.is_active(q) {
                let p_BS = point.location(q);
                let p_GS = cache.X_GB(point.base) * p_BS;
                self.points.push(CurrentPoint {
                    origin: PointOrigin::Point(i),
                    base: point.base,
                    p_BS,
                    p_GS,
                    measured_p_GS: p_GS,
                    wrap_object: None,
                    wrap_length: 0.0,
                });
            }
        }
        for (X_GW, wrap) in self.X_GW.iter_mut().zip(&path.wraps) {
            if wrap.active {
                *X_GW = cache.X_GB(wrap.base) * &wrap.X_BW;
            }
        }
    }

    /// Location of a current point in a wrap's frame [m].
    #[inline]
    pub(super) fn in_wrap_frame(&self, point: usize, wrap: &PathWrap, w: usize) -> Vector3<f64> {
        let point = &self.points[point];
        if point.base == wrap.base {
            wrap.X_BW.inverse_transform_point(&point.p_BS)
        } else {
            self.X_GW[w].inverse_transform_point(&point.p_GS)
        }
    }

    /// By how much a wrap changes the length of the segment from current point `i` to the next [m].
    pub(super) fn length_change(&self, i: usize, w: usize, path: &WrapPath) -> f64 {
        let (a, b) = (&self.points[i].measured_p_GS, &self.points[i + 1].measured_p_GS);
        let measured = |p: &Vector3<f64>, r: &Vector3<f64>| (p - &self.X_GW[w] * r).norm();
        measured(a, &path.r1) + path.length + measured(b, &path.r2) - (a - b).norm()
    }

    /// Wraps the segment from current point `i` to the next over wrap `w`, unless it is optional and certainly changes
    /// the length by more than `max_change` [m].
    #[inline]
    pub(super) fn wrap_segment(&mut self, wrap: &PathWrap, w: usize, i: usize, max_change: f64) -> Attempt {
        let (p1, p2) = (self.in_wrap_frame(i, wrap, w), self.in_wrap_frame(i + 1, wrap, w));
        let slot = self.points[i].origin.number() + 2 * self.points[i + 1].origin.number();
        let remembered = &mut self.memory[w * MEMORY_PER_WRAP + slot % MEMORY_PER_WRAP];
        let is_known = remembered.p1 == p1
            && remembered.p2 == p2
            && match remembered.attempt {
                Attempt::Done(_) => true,
                Attempt::TooLong { least_change } => least_change > max_change,
            };
        if !is_known {
            *remembered = Remembered { p1, p2, attempt: wrap.surface.wrap_unless_longer(&p1, &p2, max_change) };
        }
        remembered.attempt
    }

    /// Removes the two points of wrap `w`, if the path has them.
    pub(super) fn remove_wrap(&mut self, w: usize) {
        if let Some(i) = self.points.iter().position(|p| p.origin == PointOrigin::WrapStart(w)) {
            self.points.drain(i..i + 2);
        }
    }

    /// Length of the path through the present points [m].
    pub(super) fn measure(&self) -> f64 {
        let mut length = 0.0;
        for pair in self.points.windows(2) {
            let (a, b) = (&pair[0], &pair[1]);
            if a.wrap_object.is_some() && a.wrap_object == b.wrap_object {
                length += b.wrap_length;
            } else {
                length += (a.measured_p_GS - b.measured_p_GS).norm();
            }
        }
        length
    }
}
