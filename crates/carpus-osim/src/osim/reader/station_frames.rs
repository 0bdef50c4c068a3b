//! `StationDefinedFrame`: a frame given by four stations of one body, read as an offset frame of that body.

use std::collections::HashMap;

use nalgebra::{Matrix3, Vector3};

use super::object::{Names, Object};
use super::pending::PendingStationFrame;
use super::sockets::absolute;
use super::state::Reader;
use crate::osim::diagnostics::Severity;
use crate::osim::document::ElementId;
use crate::osim::error::{ProblemKind, nearest};
use crate::osim::spec::{FrameIndex, FrameKind, Location};
use carpus_numerics::spatial::{Transform, body_xyz_angles};

/// Sockets of the frame, in the order in which they are used.
const POINTS: [&str; 4] = ["point_a", "point_b", "point_c", "origin_point"];

/// An axis of the frame with a sign.
type Direction = (usize, f64);

impl Reader<'_> {
    /// Stations and the frames given by them among `elements`, which belong to the component at `owner`.
    pub(super) fn read_station_frames(&mut self, elements: &[ElementId], owner: &str, names: &mut Names) {
        for &element in elements {
            match self.document.tag(element) {
                "Station" | "Marker" => {
                    let name = self.component_name(element, names, owner);
                    let path = absolute(owner, &name);
                    self.stations.entry(path).or_insert(element);
                }
                "StationDefinedFrame" => {
                    let name = self.component_name(element, names, owner);
                    let object = self.object(element, owner, &name);
                    self.diagnostics.understood("StationDefinedFrame");
                    // Its place follows from the stations: there is nothing of its own to edit.
                    let at = Location { element: None, ..self.location(&object) };
                    let (translation, orientation) = (Vector3::zeros(), Vector3::zeros());
                    let frame = self.add_frame(
                        &name,
                        at,
                        FrameKind::Offset { parent: FrameIndex(0), translation, orientation },
                    );
                    self.search_order.push(frame);
                    self.pending_station_frames.push(PendingStationFrame { frame, object: object.clone() });
                    self.read_frame_contents(&object, frame);
                }
                _ => {}
            }
        }
    }

    /// Places the frames, those first that others depend on.
    pub(super) fn resolve_station_frames(&mut self) {
        let mut pending = std::mem::take(&mut self.pending_station_frames);
        let mut points = HashMap::new();
        for frame in &pending {
            points.insert(frame.frame, POINTS.map(|socket| self.station_at(&frame.object, socket)));
        }
        while !pending.is_empty() {
            let waiting: Vec<FrameIndex> = pending.iter().map(|frame| frame.frame).collect();
            let depends = |reader: &Self, frame: &PendingStationFrame| {
                points[&frame.frame]
                    .iter()
                    .flatten()
                    .any(|(parent, _)| reader.chain(*parent).any(|link| waiting.contains(&link)))
            };
            let (later, now): (Vec<_>, Vec<_>) = pending.into_iter().partition(|frame| depends(self, frame));
            if now.is_empty() {
                for frame in later {
                    let line = frame.object.line;
                    self.problem(line, &frame.object.path, ProblemKind::FrameLoop);
                }
                return;
            }
            for frame in &now {
                if let [Some(a), Some(b), Some(c), Some(origin)] = points[&frame.frame] {
                    self.place_station_frame(frame, [a, b, c, origin]);
                }
            }
            pending = later;
        }
    }

    /// A frame and the frames that it is fixed in, up to a body or ground.
    fn chain(&self, frame: FrameIndex) -> impl Iterator<Item = FrameIndex> + '_ {
        let next = |at: &FrameIndex| match self.spec.frames[at.0].kind {
            FrameKind::Offset { parent, .. } => Some(parent),
            _ => None,
        };
        std::iter::successors(Some(frame), next).take(self.spec.frames.len() + 1)
    }

    /// Frame and location of the station that a socket names; `None` if there is none (reported).
    fn station_at(&mut self, object: &Object, socket: &'static str) -> Option<(FrameIndex, Vector3<f64>)> {
        let Some((element, text)) = self.socket(object, socket) else {
            let kind = ProblemKind::Missing { property: format!("socket_{socket}"), expected: "the path of a station" };
            self.problem(object.line, &object.path, kind);
            return None;
        };
        let path = absolute(&object.path, &text);
        let Some(&station) = self.stations.get(&path) else {
            let nearest = nearest(&path, self.stations.keys().map(String::as_str));
            let kind = ProblemKind::UnknownReference {
                property: format!("socket_{socket}"),
                what: "station or marker",
                name: text,
                nearest,
            };
            let line = element.map_or(object.line, |element| self.document.line(element));
            self.problem(line, &object.path, kind);
            return None;
        };
        let default = self.defaults.get(self.document.tag(station)).copied();
        self.mark(station);
        let station = Object { element: Some(station), default, path, line: self.document.line(station) };
        let location = self.vector3(&station, &["location"], Vector3::zeros());
        Some((self.point_frame(&station)?, location))
    }

    #[allow(non_snake_case)]
    fn place_station_frame(&mut self, frame: &PendingStationFrame, points: [(FrameIndex, Vector3<f64>); 4]) {
        let base = self.base_frame(points[0].0);
        let refuse = |reader: &mut Self, socket: &str, expected: &'static str, found: String| {
            let kind = ProblemKind::NotReadable { property: format!("socket_{socket}"), expected, found };
            reader.problem(frame.object.line, &frame.object.path, kind);
        };
        for (socket, (parent, _)) in POINTS.iter().zip(&points) {
            let other = self.base_frame(*parent);
            if other != base {
                let found = format!("a station on {}", self.spec.frames[other.0].name);
                return refuse(self, socket, "stations of one body", found);
            }
        }
        let [a, b, c, origin] = points.map(|(parent, location)| self.pose_in_base(parent) * location);
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(&ac);
        if !(normal.norm() > 1e-12 * ab.norm() * ac.norm()) {
            return refuse(self, "point_c", "three points that form a triangle", "points on a line".to_owned());
        }
        let (ab, normal) = (ab.normalize(), normal.normalize());
        let [first, second] = self.directions(&frame.object);
        let third = 3 - first.0 - second.0;
        let handed = if (first.0 + 1) % 3 == second.0 { 1.0 } else { -1.0 };
        let mut R = Matrix3::zeros();
        R.set_column(first.0, &(first.1 * ab));
        R.set_column(second.0, &(second.1 * normal));
        R.set_column(third, &(handed * first.1 * second.1 * ab.cross(&normal)));
        let orientation = body_xyz_angles(&R);
        self.spec.frames[frame.frame.0].kind = FrameKind::Offset { parent: base, translation: origin, orientation };
    }

    #[allow(non_snake_case)]
    fn pose_in_base(&self, frame: FrameIndex) -> Transform {
        let mut X = Transform::identity();
        for link in self.chain(frame) {
            if let FrameKind::Offset { translation, orientation, .. } = self.spec.frames[link.0].kind {
                X = Transform::from_translation_body_xyz(translation, orientation) * X;
            }
        }
        X
    }

    /// `ab_axis` and `ab_x_ac_axis`: +x and +y, or the next axis, where they cannot be read, as in OpenSim.
    fn directions(&mut self, object: &Object) -> [Direction; 2] {
        let mut read = |property: &'static str, default: Direction| {
            let Some((element, text)) = self.string(object, &[property]) else { return default };
            let sign = if text.starts_with('-') { -1.0 } else { 1.0 };
            let axis = text.trim_start_matches(['+', '-']).chars().next().map(|c| c.to_ascii_lowercase());
            match axis.and_then(|c| "xyz".find(c)) {
                Some(axis) => (axis, sign),
                None => {
                    let message = format!("{property} is \"{text}\", expected +x, -x, … or -z; taken as in OpenSim");
                    self.diagnose(Severity::Warning, element, &object.path, message, None);
                    default
                }
            }
        };
        let first = read("ab_axis", (0, 1.0));
        let next = ((first.0 + 1) % 3, 1.0);
        let second = read("ab_x_ac_axis", if first.0 == 1 { next } else { (1, 1.0) });
        [first, if second.0 == first.0 { next } else { second }]
    }
}
