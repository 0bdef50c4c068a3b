//! Connections between components: sockets by path, bare names of old files.

use super::object::Object;
use super::pending::UnresolvedOffset;
use super::state::Reader;
use crate::osim::document::ElementId;
use crate::osim::error::{ProblemKind, nearest};
use crate::osim::spec::{CoordinateIndex, FrameIndex, FrameKind};

/// The absolute path that `text` means to the component at `owner`.
pub(super) fn absolute(owner: &str, text: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    let base = if text.starts_with('/') { "" } else { owner };
    for part in base.split('/').chain(text.split('/')) {
        match part {
            "" | "." => {}
            ".." => {
                parts.pop();
            }
            part => parts.push(part),
        }
    }
    format!("/{}", parts.join("/"))
}

impl Reader<'_> {
    /// Text of a socket, under its name in any format version.
    pub(super) fn socket(&mut self, object: &Object, socket: &'static str) -> Option<(Option<ElementId>, String)> {
        let names = socket_tags(socket);
        if let Some((element, text)) = self.string(object, &names) {
            return Some((Some(element), text));
        }
        // Formats 30500 to 30507: <connectors><Connector_…_ name="parent_frame"><connectee_name>…
        let connectors = self.property(object, &["connectors"])?;
        let connector = self.document.children(connectors).iter().copied().find(|&child| {
            let name = self.document.attribute(child, "name").unwrap_or_default();
            name == socket || name == socket.replace("_frame", "_body")
        })?;
        let connectee = self.document.child(connector, "connectee_name")?;
        self.mark(connector);
        self.mark(connectee);
        let text = self.document.text(connectee);
        (!text.is_empty()).then_some((Some(connectee), text))
    }

    /// The frame that a socket is connected to; a problem if it is not.
    pub(super) fn frame_socket(&mut self, object: &Object, socket: &'static str) -> Option<FrameIndex> {
        let Some((element, text)) = self.socket(object, socket) else {
            let kind = ProblemKind::Missing { property: format!("socket_{socket}"), expected: "the path of a frame" };
            self.problem(object.line, &object.path, kind);
            return None;
        };
        self.frame_at(object, element, &format!("socket_{socket}"), &text)
    }

    /// The frame at a path; a problem if there is none.
    pub(super) fn frame_at(
        &mut self,
        object: &Object,
        element: Option<ElementId>,
        property: &str,
        text: &str,
    ) -> Option<FrameIndex> {
        let found = self.find_frame(&object.path, text);
        if found.is_none() {
            let kind = match self.unsupported_frame(text) {
                Some(frame) => ProblemKind::UnsupportedFrame {
                    property: property.to_owned(),
                    name: text.to_owned(),
                    class: self.document.tag(frame).to_owned(),
                    line: self.document.line(frame),
                },
                None => self.unknown_path(property, "body or frame", text, self.frames_by_path.keys()),
            };
            let line = element.map_or(object.line, |element| self.document.line(element));
            self.problem(line, &object.path.clone(), kind);
        }
        found
    }

    fn find_frame(&self, owner: &str, text: &str) -> Option<FrameIndex> {
        if let Some(&frame) = self.frames_by_path.get(&absolute(owner, text)) {
            return Some(frame);
        }
        if !self.version.has_bare_names() {
            return None;
        }
        let last = self.reference(text.rsplit('/').next().unwrap_or(text));
        ["/", "/bodyset/"].iter().find_map(|set| self.frames_by_path.get(&format!("{set}{last}")).copied())
    }

    /// The element of the frame that is meant by a path, if its class is not one that is read: the innermost on the
    /// path.
    fn unsupported_frame(&self, text: &str) -> Option<ElementId> {
        text.split('/').rev().filter(|part| !part.is_empty()).find_map(|part| {
            self.document.elements().find(|&element| {
                let tag = self.document.tag(element);
                tag.ends_with("Frame")
                    && !matches!(tag, "PhysicalOffsetFrame" | "StationDefinedFrame")
                    && self.document.attribute(element, "name").is_some_and(|name| self.reference(&name) == part)
            })
        })
    }

    /// A body named as in formats before 30505.
    pub(super) fn body_at(
        &mut self,
        object: &Object,
        element: ElementId,
        property: &str,
        name: &str,
    ) -> Option<FrameIndex> {
        let path = self.body_path(name);
        let found = self.frames_by_path.get(&path).copied();
        if found.is_none() {
            let names: Vec<&str> = self.spec.bodies.iter().map(|body| body.name.as_str()).collect();
            let kind = self.unknown(property, "body", name, &names);
            self.problem(self.document.line(element), &object.path.clone(), kind);
        }
        found
    }

    /// Path of a body, or of ground, by name.
    pub(super) fn body_path(&self, name: &str) -> String {
        match self.reference(name).as_str() {
            "ground" => "/ground".to_owned(),
            name => format!("/bodyset/{name}"),
        }
    }

    /// A name in a reference, as [`Reader::component_name`] gives it to the component.
    pub(super) fn reference(&self, name: &str) -> String {
        if self.version.strips_white_space_from_names() { name.split_whitespace().collect() } else { name.to_owned() }
    }

    fn unknown(&self, property: &str, what: &'static str, name: &str, candidates: &[&str]) -> ProblemKind {
        ProblemKind::UnknownReference {
            property: property.to_owned(),
            what,
            name: name.to_owned(),
            nearest: nearest(name, candidates.iter().copied()),
        }
    }

    /// A reference that leads nowhere, with the path that may be meant: of what has the same name, or a name or path
    /// like it.
    fn unknown_path<'p>(
        &self,
        property: &str,
        what: &'static str,
        text: &str,
        paths: impl Iterator<Item = &'p String>,
    ) -> ProblemKind {
        let last = |path: &str| path.rsplit('/').next().unwrap_or_default().to_owned();
        let mut paths: Vec<&str> = paths.map(String::as_str).collect();
        // Shortest first: a body before frames of its name that joints own.
        paths.sort_by_key(|path| (path.matches('/').count(), path.len(), *path));
        let (name, is_path) = (last(text), text.contains('/'));
        let named = |name: &str| paths.iter().find(|path| last(path) == name).map(|path| (*path).to_owned());
        let like = || match is_path {
            true => nearest(text, paths.iter().copied()),
            false => {
                let names: Vec<String> = paths.iter().map(|path| last(path)).collect();
                nearest(&name, names.iter().map(String::as_str)).and_then(|name| named(&name))
            }
        };
        let nearest = named(&name).or_else(like);
        ProblemKind::UnknownReference { property: property.to_owned(), what, name: text.to_owned(), nearest }
    }

    /// The coordinate with this name anywhere in the model; a problem if there is none.
    pub(super) fn coordinate_named(
        &mut self,
        object: &Object,
        element: Option<ElementId>,
        property: &str,
        name: &str,
    ) -> Option<CoordinateIndex> {
        let wanted = self.reference(name);
        let found = self.spec.coordinates.iter().position(|coordinate| coordinate.name == wanted);
        if found.is_none() {
            let names: Vec<&str> = self.spec.coordinates.iter().map(|coordinate| coordinate.name.as_str()).collect();
            let kind = self.unknown(property, "coordinate", name, &names);
            let line = element.map_or(object.line, |element| self.document.line(element));
            self.problem(line, &object.path.clone(), kind);
        }
        found.map(CoordinateIndex)
    }

    /// The coordinate at a path, or with a bare name in old files; a problem if there is none.
    pub(super) fn coordinate_at(
        &mut self,
        object: &Object,
        element: Option<ElementId>,
        property: &str,
        text: &str,
    ) -> Option<CoordinateIndex> {
        if let Some(&coordinate) = self.coordinates_by_path.get(&absolute(&object.path, text)) {
            return Some(coordinate);
        }
        if self.version.has_bare_names() {
            let last = text.rsplit('/').next().unwrap_or(text).to_owned();
            return self.coordinate_named(object, element, property, &last);
        }
        let kind = self.unknown_path(property, "coordinate", text, self.coordinates_by_path.keys());
        let line = element.map_or(object.line, |element| self.document.line(element));
        self.problem(line, &object.path.clone(), kind);
        None
    }

    /// Connects the offset frames to their parents and refuses circles.
    pub(super) fn resolve_offsets(&mut self) {
        for UnresolvedOffset { frame, object, parent } in std::mem::take(&mut self.unresolved) {
            let Some((element, text)) = parent else {
                let kind =
                    ProblemKind::Missing { property: "socket_parent".to_owned(), expected: "the path of a frame" };
                self.problem(object.line, &object.path, kind);
                continue;
            };
            let found = self.frame_at(&object, element, "socket_parent", &text);
            if let (Some(found), FrameKind::Offset { parent, .. }) = (found, &mut self.spec.frames[frame.0].kind) {
                *parent = found;
            }
        }
        self.refuse_loops();
    }

    fn refuse_loops(&mut self) {
        for start in 0..self.spec.frames.len() {
            let mut at = start;
            let mut steps = 0;
            while let FrameKind::Offset { parent, .. } = self.spec.frames[at].kind {
                at = parent.0;
                steps += 1;
                if steps > self.spec.frames.len() {
                    let line = self.spec.frames[start].at.line;
                    let path = self.spec.frames[start].at.path.clone();
                    // Unresolved parents are reported already and point to ground, so this is a true circle.
                    self.problem(line, &path, ProblemKind::FrameLoop);
                    self.spec.frames[start].kind = FrameKind::Ground;
                    break;
                }
            }
        }
    }
}

fn socket_tags(socket: &'static str) -> [&'static str; 3] {
    match socket {
        "parent" => ["socket_parent", "socket_parent_connectee_name", "connector_parent_connectee_name"],
        "parent_frame" => {
            ["socket_parent_frame", "socket_parent_frame_connectee_name", "connector_parent_frame_connectee_name"]
        }
        "child_frame" => {
            ["socket_child_frame", "socket_child_frame_connectee_name", "connector_child_frame_connectee_name"]
        }
        "frame1" => ["socket_frame1", "socket_frame1_connectee_name", "connector_frame1_connectee_name"],
        "frame2" => ["socket_frame2", "socket_frame2_connectee_name", "connector_frame2_connectee_name"],
        "body1" => ["socket_body1", "socket_body1_connectee_name", "connector_body1_connectee_name"],
        "body2" => ["socket_body2", "socket_body2_connectee_name", "connector_body2_connectee_name"],
        "frame" => ["socket_frame", "socket_frame_connectee_name", "connector_frame_connectee_name"],
        "point_a" => ["socket_point_a", "socket_point_a_connectee_name", "connector_point_a_connectee_name"],
        "point_b" => ["socket_point_b", "socket_point_b_connectee_name", "connector_point_b_connectee_name"],
        "point_c" => ["socket_point_c", "socket_point_c_connectee_name", "connector_point_c_connectee_name"],
        "origin_point" => {
            ["socket_origin_point", "socket_origin_point_connectee_name", "connector_origin_point_connectee_name"]
        }
        "body_1" => ["socket_body_1", "socket_body_1_connectee_name", "connector_body_1_connectee_name"],
        "body_2" => ["socket_body_2", "socket_body_2_connectee_name", "connector_body_2_connectee_name"],
        "line_body" => ["socket_line_body", "socket_line_body_connectee_name", "connector_line_body_connectee_name"],
        "follower_body" => {
            ["socket_follower_body", "socket_follower_body_connectee_name", "connector_follower_body_connectee_name"]
        }
        "x_coordinate" => {
            ["socket_x_coordinate", "socket_x_coordinate_connectee_name", "connector_x_coordinate_connectee_name"]
        }
        "y_coordinate" => {
            ["socket_y_coordinate", "socket_y_coordinate_connectee_name", "connector_y_coordinate_connectee_name"]
        }
        "z_coordinate" => {
            ["socket_z_coordinate", "socket_z_coordinate_connectee_name", "connector_z_coordinate_connectee_name"]
        }
        _ => ["socket_coordinate", "socket_coordinate_connectee_name", "connector_coordinate_connectee_name"],
    }
}

#[cfg(test)]
mod tests {
    use super::absolute;

    #[test]
    fn verif_relative_paths_resolve_as_in_open_sim() {
        assert_eq!(absolute("/jointset/wrist", "radius_offset"), "/jointset/wrist/radius_offset");
        assert_eq!(absolute("/bodyset/radius/frame", ".."), "/bodyset/radius");
        assert_eq!(absolute("/jointset/wrist", "../../bodyset/radius"), "/bodyset/radius");
        assert_eq!(absolute("/jointset/wrist", "/ground"), "/ground");
        assert_eq!(absolute("/a", "../../../b"), "/b");
    }
}
