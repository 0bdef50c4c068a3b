//! Small models for tests of errors and edits.

/// A forearm that flexes at the elbow, with one muscle over a wrap cylinder, in format 4.0.
pub const FORMAT_40000: &str = r#"<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40000">
	<Model name="small">
		<!--Credits & a raw ampersand.-->
		<credits>A & B</credits>
		<gravity>0 -9.80665 0</gravity>
		<Ground name="ground">
			<WrapObjectSet name="wrapobjectset">
				<objects>
					<WrapCylinder name="epicondyle">
						<xyz_body_rotation>0 0 0</xyz_body_rotation>
						<translation>0 0 0</translation>
						<quadrant>-y</quadrant>
						<radius>0.01</radius>
						<length>0.1</length>
					</WrapCylinder>
				</objects>
				<groups />
			</WrapObjectSet>
		</Ground>
		<BodySet name="bodyset">
			<objects>
				<Body name="forearm">
					<mass>1.5</mass>
					<mass_center>0.12 0 0</mass_center>
					<inertia>0.001 0.01 0.01 0 0 0</inertia>
				</Body>
			</objects>
			<groups />
		</BodySet>
		<JointSet name="jointset">
			<objects>
				<CustomJoint name="elbow">
					<socket_parent_frame>ground_offset</socket_parent_frame>
					<socket_child_frame>/bodyset/forearm</socket_child_frame>
					<coordinates>
						<Coordinate name="elbow_flexion">
							<default_value>0.1</default_value>
							<range>0 2.5</range>
							<clamped>true</clamped>
						</Coordinate>
					</coordinates>
					<frames>
						<PhysicalOffsetFrame name="ground_offset">
							<socket_parent>/ground</socket_parent>
							<translation>0 -0.01 0</translation>
							<orientation>0 0 0</orientation>
						</PhysicalOffsetFrame>
					</frames>
					<SpatialTransform>
						<TransformAxis name="rotation1">
							<coordinates>elbow_flexion</coordinates>
							<axis>0 0 1</axis>
							<LinearFunction name="function">
								<coefficients>1 0</coefficients>
							</LinearFunction>
						</TransformAxis>
						<TransformAxis name="rotation2">
							<axis>0 1 0</axis>
						</TransformAxis>
						<TransformAxis name="rotation3">
							<axis>1 0 0</axis>
						</TransformAxis>
					</SpatialTransform>
				</CustomJoint>
			</objects>
			<groups />
		</JointSet>
		<ForceSet name="forceset">
			<objects>
				<Millard2012EquilibriumMuscle name="BRD">
					<GeometryPath name="geometrypath">
						<PathPointSet>
							<objects>
								<PathPoint name="BRD-P1">
									<socket_parent_frame>/ground</socket_parent_frame>
									<location>0.01 0.1 0</location>
								</PathPoint>
								<PathPoint name="BRD-P2">
									<socket_parent_frame>/bodyset/forearm</socket_parent_frame>
									<location>0.2 0.01 0</location>
								</PathPoint>
							</objects>
							<groups />
						</PathPointSet>
						<PathWrapSet>
							<objects>
								<PathWrap name="pathwrap">
									<wrap_object>epicondyle</wrap_object>
									<method>hybrid</method>
									<range>-1 -1</range>
								</PathWrap>
							</objects>
							<groups />
						</PathWrapSet>
					</GeometryPath>
					<max_isometric_force>250</max_isometric_force>
					<optimal_fiber_length>0.16</optimal_fiber_length>
					<tendon_slack_length>0.13</tendon_slack_length>
					<FiberForceLengthCurve name="BRD_FiberForceLengthCurve">
						<strain_at_one_norm_force>0.6</strain_at_one_norm_force>
						<curviness />
					</FiberForceLengthCurve>
				</Millard2012EquilibriumMuscle>
				<CoordinateLimitForce name="elbow_limit">
					<coordinate>elbow_flexion</coordinate>
					<upper_limit>140</upper_limit>
				</CoordinateLimitForce>
			</objects>
			<groups />
		</ForceSet>
	</Model>
</OpenSimDocument>
"#;

/// The same forearm in format 3.0, with CRLF line ends.
pub fn format_30000() -> String {
    let text = r#"<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="30000">
  <Model name="small old">
    <BodySet>
      <objects>
        <Body name="ground">
          <mass>0</mass>
          <Joint />
        </Body>
        <Body name="fore arm">
          <mass>1.5</mass>
          <mass_center> 0.12 0 0</mass_center>
          <inertia_xx>0.0012345678</inertia_xx>
          <inertia_yy>0.01</inertia_yy>
          <inertia_zz>0.01</inertia_zz>
          <inertia_xy>0</inertia_xy>
          <inertia_xz>0</inertia_xz>
          <inertia_yz>0</inertia_yz>
          <Joint>
            <PinJoint name="elbow">
              <parent_body>ground</parent_body>
              <location_in_parent>0 -0.01 0</location_in_parent>
              <orientation_in_parent>0.123456789 0 0</orientation_in_parent>
              <location>0 0 0</location>
              <orientation>0 0 0</orientation>
              <CoordinateSet>
                <objects>
                  <Coordinate name="elbow_flexion">
                    <motion_type>rotational</motion_type>
                    <default_value>0.1</default_value>
                    <range>0 2.5</range>
                    <prescribed_function />
                  </Coordinate>
                </objects>
              </CoordinateSet>
              <reverse>false</reverse>
            </PinJoint>
          </Joint>
        </Body>
      </objects>
    </BodySet>
    <ForceSet>
      <objects>
        <Thelen2003Muscle name="BRD">
          <isDisabled>true</isDisabled>
          <min_control>0</min_control>
          <GeometryPath>
            <PathPointSet>
              <objects>
                <PathPoint name="P1"><location>0.01 0.1 0</location><body>ground</body></PathPoint>
                <PathPoint name="P1"><location>0.2 0.01 0</location><body>fore arm</body></PathPoint>
              </objects>
            </PathPointSet>
          </GeometryPath>
          <max_isometric_force>250</max_isometric_force>
        </Thelen2003Muscle>
      </objects>
    </ForceSet>
  </Model>
</OpenSimDocument>
"#;
    text.replace('\n', "\r\n")
}
