//! Joints, coordinates, constraints.

use super::Writer;
use super::xml::numbers;
use crate::osim::spec::{ConstraintKind, CoordinateIndex, JointKind, TransformAxisSpec};

/// Axes of a `SpatialTransform`.
const AXES: [&str; 6] = ["rotation1", "rotation2", "rotation3", "translation1", "translation2", "translation3"];

impl Writer<'_> {
    pub(super) fn joints(&mut self) {
        let spec = self.spec;
        self.xml.open("JointSet", &[("name", "jointset")]);
        self.xml.open("objects", &[]);
        for joint in &spec.joints {
            let class = match &joint.kind {
                JointKind::Weld => "WeldJoint",
                JointKind::Pin => "PinJoint",
                JointKind::Slider => "SliderJoint",
                JointKind::Universal => "UniversalJoint",
                JointKind::Ball => "BallJoint",
                JointKind::Gimbal => "GimbalJoint",
                JointKind::Planar => "PlanarJoint",
                JointKind::Free => "FreeJoint",
                JointKind::Ellipsoid { .. } => "EllipsoidJoint",
                JointKind::Scapulothoracic { .. } => "ScapulothoracicJoint",
                JointKind::ConstantCurvature { .. } => "ConstantCurvatureJoint",
                JointKind::Custom(_) => "CustomJoint",
            };
            self.xml.open(class, &[("name", &joint.name)]);
            let (parent, child) = (self.frame(joint.parent_frame), self.frame(joint.child_frame));
            self.xml.text("socket_parent_frame", &parent);
            self.xml.text("socket_child_frame", &child);
            if !joint.coordinates.is_empty() {
                self.xml.open("coordinates", &[]);
                joint.coordinates.iter().for_each(|c| self.coordinate_element(*c));
                self.xml.close();
            }
            self.owned_frames(&joint.at.path, "frames");
            match &joint.kind {
                JointKind::Ellipsoid { radii_x_y_z } => self.xml.vector("radii_x_y_z", radii_x_y_z),
                JointKind::Scapulothoracic {
                    thoracic_ellipsoid_radii_x_y_z,
                    scapula_winging_axis_origin,
                    scapula_winging_axis_direction,
                } => {
                    self.xml.vector("thoracic_ellipsoid_radii_x_y_z", thoracic_ellipsoid_radii_x_y_z);
                    self.xml.text("scapula_winging_axis_origin", &numbers(scapula_winging_axis_origin));
                    self.xml.number("scapula_winging_axis_direction", *scapula_winging_axis_direction);
                }
                JointKind::ConstantCurvature { neutral_angle_x_z_y, length } => {
                    self.xml.vector("neutral_angle_x_z_y", neutral_angle_x_z_y);
                    self.xml.number("length", *length);
                }
                JointKind::Custom(axes) => self.spatial_transform(axes),
                _ => {}
            }
            self.xml.close();
        }
        self.xml.close();
        self.xml.close();
    }

    fn coordinate_element(&mut self, coordinate: CoordinateIndex) {
        let c = &self.spec.coordinates[coordinate.0];
        self.xml.open("Coordinate", &[("name", &c.name)]);
        self.xml.number("default_value", c.default_value);
        self.xml.number("default_speed_value", c.default_speed_value);
        self.xml.text("range", &numbers(&c.range));
        self.xml.boolean("clamped", c.clamped);
        self.xml.boolean("locked", c.locked);
        if let Some(function) = &c.prescribed_function {
            self.xml.function("prescribed_function", function);
        }
        self.xml.boolean("prescribed", c.prescribed);
        self.xml.boolean("is_free_to_satisfy_constraints", c.is_free_to_satisfy_constraints);
        self.xml.close();
    }

    fn spatial_transform(&mut self, axes: &[TransformAxisSpec; 6]) {
        self.xml.open("SpatialTransform", &[]);
        for (axis, name) in axes.iter().zip(AXES) {
            self.xml.open("TransformAxis", &[("name", name)]);
            let names: Vec<&str> = axis.coordinates.iter().map(|c| self.spec.coordinates[c.0].name.as_str()).collect();
            self.xml.text("coordinates", &names.join(" "));
            self.xml.vector("axis", &axis.axis);
            self.xml.function("function", &axis.function);
            self.xml.close();
        }
        self.xml.close();
    }

    pub(super) fn constraints(&mut self) {
        let spec = self.spec;
        if spec.constraints.is_empty() {
            return;
        }
        self.xml.open("ConstraintSet", &[("name", "constraintset")]);
        self.xml.open("objects", &[]);
        for constraint in &spec.constraints {
            if let ConstraintKind::Unsupported { class } = &constraint.kind {
                self.left_out.push((constraint.at.line, format!("{}: {class}", constraint.at.path)));
                continue;
            }
            self.xml.open(constraint.kind.class(), &[("name", &constraint.name)]);
            self.xml.boolean("isEnforced", constraint.is_enforced);
            match &constraint.kind {
                ConstraintKind::CoordinateCoupler {
                    independent_coordinates,
                    dependent_coordinate,
                    function,
                    scale_factor,
                } => {
                    let name = |c: &CoordinateIndex| spec.coordinates[c.0].name.clone();
                    let names: Vec<String> = independent_coordinates.iter().map(name).collect();
                    self.xml.function("coupled_coordinates_function", function);
                    self.xml.text("independent_coordinate_names", &names.join(" "));
                    self.xml.text("dependent_coordinate_name", &name(dependent_coordinate));
                    self.xml.number("scale_factor", *scale_factor);
                }
                ConstraintKind::Weld { frame1, frame2 } => {
                    self.sockets(&[("frame1", *frame1), ("frame2", *frame2)]);
                    self.owned_frames(&constraint.at.path, "frames");
                }
                ConstraintKind::Point { body_1, body_2, location_body_1, location_body_2 } => {
                    self.sockets(&[("body_1", *body_1), ("body_2", *body_2)]);
                    self.xml.vector("location_body_1", location_body_1);
                    self.xml.vector("location_body_2", location_body_2);
                }
                ConstraintKind::ConstantDistance {
                    body_1,
                    body_2,
                    location_body_1,
                    location_body_2,
                    constant_distance,
                } => {
                    self.sockets(&[("body_1", *body_1), ("body_2", *body_2)]);
                    self.xml.vector("location_body_1", location_body_1);
                    self.xml.vector("location_body_2", location_body_2);
                    self.xml.number("constant_distance", *constant_distance);
                }
                ConstraintKind::PointOnLine {
                    line_body,
                    follower_body,
                    line_direction_vec,
                    point_on_line,
                    point_on_follower,
                } => {
                    self.sockets(&[("line_body", *line_body), ("follower_body", *follower_body)]);
                    self.xml.vector("line_direction_vec", line_direction_vec);
                    self.xml.vector("point_on_line", point_on_line);
                    self.xml.vector("point_on_follower", point_on_follower);
                }
                ConstraintKind::Unsupported { .. } => {}
            }
            self.xml.close();
        }
        self.xml.close();
        self.xml.close();
    }

    pub(super) fn sockets(&mut self, sockets: &[(&str, crate::osim::spec::FrameIndex)]) {
        for (socket, frame) in sockets {
            let path = self.frame(*frame);
            self.xml.text(&format!("socket_{socket}"), &path);
        }
    }
}
