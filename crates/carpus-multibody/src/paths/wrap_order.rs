//! Which segment wraps over which object, in which order (OpenSim's `GeometryPath::applyWrapObjects`).

use super::geometry::{CurrentPoint, PathGeometry, PointOrigin};
use super::path::{Path, PathWrap};
use super::wrapping::{Attempt, Wrap, WrapAction, WrapPath};
use crate::multibody::Cache;

/// Passes over several wrap objects, each starting from the result of the one before.
const MAX_PASSES: usize = 8;
/// Passes end when the length changes by less than this [m].
const LENGTH_TOLERANCE: f64 = 0.0005;

/// The wrap chosen for one object.
struct Best {
    path: WrapPath,
    /// Position of the segment's second point among the current points.
    end: usize,
}

/// A wrap's range, or an order to stop.
enum Range {
    /// Positions of its first and last active point among the current points.
    Points(usize, usize),
    /// No active point in it: OpenSim then leaves this and all further wraps alone.
    Empty,
}

impl Path {
    /// Computes the points and the length of the path.
    ///
    /// - `q`: coordinates [rad or m], couplers satisfied, as given to
    ///   [`Model::update_positions`](crate::multibody::Model::update_positions)
    /// - `cache`: poses of the bodies at `q` (at least [`Path::bodies`])
    pub fn update(&self, q: &[f64], cache: &Cache, geometry: &mut PathGeometry) {
        if let Some(functions) = &self.functions {
            geometry.length = functions.length(q);
            return;
        }
        geometry.start(self, q, cache);
        self.apply_wraps(q, cache, geometry);
        geometry.length = geometry.measure();
    }

    fn apply_wraps(&self, q: &[f64], cache: &Cache, geometry: &mut PathGeometry) {
        let n = self.wraps.len();
        for (i, order) in geometry.order.iter_mut().enumerate() {
            *order = i;
        }
        let passes = if n < 2 { n } else { MAX_PASSES };
        let mut last_length = f64::INFINITY;
        for pass in 0..passes {
            // Results of the first two objects decide whether their order is exchanged.
            let mut results = [WrapAction::NoWrap; 2];
            for i in 0..n {
                let w = geometry.order[i];
                let wrap = &self.wraps[w];
                geometry.remove_wrap(w);
                if !wrap.active {
                    continue;
                }
                let Range::Points(start, end) = self.range_of(wrap, q, geometry) else { return };
                let (best, result) = best_wrap(wrap, w, start, end, geometry);
                if i < 2 {
                    results[i] = result;
                }
                if let Some(best) = best {
                    insert_wrap(wrap, w, &best, cache, geometry);
                }
            }
            if n < 2 {
                return;
            }
            let length = geometry.measure();
            if (length - last_length).abs() < LENGTH_TOLERANCE {
                return;
            }
            last_length = length;
            if pass == 0 && results == [WrapAction::NoWrap, WrapAction::InsideRadius] {
                geometry.order.swap(0, 1);
                geometry.remove_wrap(0);
            }
        }
    }

    /// The current points between which a wrap may act.
    fn range_of(&self, wrap: &PathWrap, q: &[f64], geometry: &PathGeometry) -> Range {
        let active = |i: &usize| self.points[*i].is_active(q);
        let first = (wrap.first..=wrap.last).find(active);
        let last = (wrap.first..=wrap.last).rev().find(active);
        let (Some(first), Some(last)) = (first, last) else { return Range::Empty };
        let position = |i: usize| geometry.points.iter().position(|p| p.origin == PointOrigin::Point(i));
        match (position(first), position(last)) {
            (Some(start), Some(end)) => Range::Points(start, end),
            _ => Range::Empty,
        }
    }
}

/// The wrap of the first segment that must wrap, else of the segment whose length changes least; and what the last
/// segment looked at said.
fn best_wrap(
    wrap: &PathWrap,
    w: usize,
    start: usize,
    end: usize,
    geometry: &mut PathGeometry,
) -> (Option<Best>, WrapAction) {
    let mut best = None;
    let mut result = WrapAction::NoWrap;
    let mut least_change = f64::INFINITY;
    // Optional wraps that cost more than the one taken last need not be finished.
    let max_change = change_of_favourite(wrap, w, start, end, geometry);
    for i in start..end {
        let (a, b) = (&geometry.points[i], &geometry.points[i + 1]);
        if a.wrap_object.is_some() && a.wrap_object == b.wrap_object {
            continue;
        }
        // The bound that an unfinished wrap is left for holds between the points' true locations only.
        let is_measured_truly = a.measured_p_GS == a.p_GS && b.measured_p_GS == b.p_GS;
        let max_change = if is_measured_truly { max_change } else { f64::INFINITY };
        let segment = match geometry.wrap_segment(wrap, w, i, max_change) {
            Attempt::Done(segment) => segment,
            Attempt::TooLong { .. } => Wrap { action: WrapAction::Wrapped, path: None },
        };
        result = segment.action;
        match segment.action {
            WrapAction::MandatoryWrap => {
                best = segment.path.map(|path| Best { path, end: i + 1 });
                break;
            }
            WrapAction::Wrapped => {
                if let Some(path) = segment.path {
                    let change = geometry.length_change(i, w, &path);
                    if change < least_change {
                        least_change = change;
                        best = Some(Best { path, end: i + 1 });
                    }
                }
            }
            WrapAction::NoWrap | WrapAction::InsideRadius => {}
        }
    }
    geometry.favourite[w] = best.as_ref().map(|best| geometry.points[best.end - 1].origin);
    (best, result)
}

/// By how much the wrap of the segment that wrap `w` took last changes its length now [m]; infinite if there is none.
fn change_of_favourite(wrap: &PathWrap, w: usize, start: usize, end: usize, geometry: &mut PathGeometry) -> f64 {
    let Some(origin) = geometry.favourite[w] else { return f64::INFINITY };
    let Some(i) = geometry.points[start..end].iter().position(|p| p.origin == origin).map(|i| start + i) else {
        return f64::INFINITY;
    };
    let (a, b) = (&geometry.points[i], &geometry.points[i + 1]);
    if a.wrap_object.is_some() && a.wrap_object == b.wrap_object {
        return f64::INFINITY;
    }
    match geometry.wrap_segment(wrap, w, i, f64::INFINITY) {
        Attempt::Done(Wrap { action: WrapAction::Wrapped, path: Some(path) }) => {
            let change = geometry.length_change(i, w, &path);
            if change.is_nan() { f64::INFINITY } else { change }
        }
        Attempt::Done(_) | Attempt::TooLong { .. } => f64::INFINITY,
    }
}

/// Puts the tangent points of a wrap into the path.
#[allow(non_snake_case)]
fn insert_wrap(wrap: &PathWrap, w: usize, best: &Best, cache: &Cache, geometry: &mut PathGeometry) {
    let X_GB = cache.X_GB(wrap.base);
    let p_B = [wrap.X_BW * best.path.r1, wrap.X_BW * best.path.r2];
    let p_G = p_B.map(|p| X_GB * p);
    let measured = *geometry.first_tangents_G[w].get_or_insert(p_G);
    let tangent = |i: usize, origin: PointOrigin, wrap_length: f64| CurrentPoint {
        origin,
        base: wrap.base,
        p_BS: p_B[i],
        p_GS: p_G[i],
        measured_p_GS: measured[i],
        wrap_object: Some(wrap.object),
        wrap_length,
    };
    let points = [tangent(0, PointOrigin::WrapStart(w), 0.0), tangent(1, PointOrigin::WrapEnd(w), best.path.length)];
    geometry.points.splice(best.end..best.end, points);
}
