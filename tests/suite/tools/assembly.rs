//! Assembly where coordinates are free to satisfy constraints, and joints that are not computed.

use super::small_model::{Folder, table};

/// Two knees in a row and a foot that is welded to the second shank: the structure of opensim-core's test of moment
/// arms with coupled coordinates, where the knees follow half the foot's angle.
const LEGS: &str = r#"<?xml version="1.0"?><OpenSimDocument Version="40600"><Model name="legs"><gravity>0 -9.80665 0</gravity>
<BodySet><objects>
<Body name="shank_1"><mass>3</mass><mass_center>0 -0.2 0</mass_center><inertia>0.05 0.005 0.05 0 0 0</inertia></Body>
<Body name="shank_2"><mass>3</mass><mass_center>0 -0.2 0</mass_center><inertia>0.05 0.005 0.05 0 0 0</inertia></Body>
<Body name="foot"><mass>1</mass><mass_center>0.05 0 0</mass_center><inertia>0.001 0.004 0.004 0 0 0</inertia></Body>
</objects></BodySet>
<JointSet><objects>
<PinJoint name="knee_1"><socket_parent_frame>hip_1</socket_parent_frame><socket_child_frame>/bodyset/shank_1</socket_child_frame><coordinates><Coordinate name="knee_angle_1"><default_value>0.3</default_value>FREE</Coordinate></coordinates>
<frames><PhysicalOffsetFrame name="hip_1"><socket_parent>/ground</socket_parent><translation>0 1 0</translation><orientation>0 0 0</orientation></PhysicalOffsetFrame></frames></PinJoint>
<PinJoint name="knee_2"><socket_parent_frame>thigh_2</socket_parent_frame><socket_child_frame>/bodyset/shank_2</socket_child_frame><coordinates><Coordinate name="knee_angle_2"><default_value>0.1</default_value>FREE</Coordinate></coordinates>
<frames><PhysicalOffsetFrame name="thigh_2"><socket_parent>/bodyset/shank_1</socket_parent><translation>0 -0.4 0</translation><orientation>0 0 0</orientation></PhysicalOffsetFrame></frames></PinJoint>
<PlanarJoint name="sole"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/foot</socket_child_frame><coordinates>
<Coordinate name="foot_angle"><default_value>0.2</default_value></Coordinate><Coordinate name="foot_x">FREE</Coordinate><Coordinate name="foot_y">FREE</Coordinate></coordinates></PlanarJoint>
</objects></JointSet>
<ConstraintSet><objects>
<WeldConstraint name="ankle"><socket_frame1>/bodyset/foot</socket_frame1><socket_frame2>ankle_2</socket_frame2><frames><PhysicalOffsetFrame name="ankle_2"><socket_parent>/bodyset/shank_2</socket_parent><translation>0 -0.45 0</translation><orientation>0 0 0</orientation></PhysicalOffsetFrame></frames></WeldConstraint>
<CoordinateCouplerConstraint name="c1"><coupled_coordinates_function><LinearFunction><coefficients>0.5 0</coefficients></LinearFunction></coupled_coordinates_function><independent_coordinate_names>foot_angle</independent_coordinate_names><dependent_coordinate_name>knee_angle_1</dependent_coordinate_name></CoordinateCouplerConstraint>
<CoordinateCouplerConstraint name="c2"><coupled_coordinates_function><LinearFunction><coefficients>0.5 0</coefficients></LinearFunction></coupled_coordinates_function><independent_coordinate_names>foot_angle</independent_coordinate_names><dependent_coordinate_name>knee_angle_2</dependent_coordinate_name></CoordinateCouplerConstraint>
</objects></ConstraintSet></Model></OpenSimDocument>"#;
/// What OpenSim 4.6's `initSystem` gives: knees, angle and place of the foot [rad, m].
const ASSEMBLED: [f64; 5] = [0.1, 0.1, 0.2, 0.129_334_565_5, 0.160_968_373_9];
/// OpenSim assembles to 1e-10 in what constraints say.
const TOLERANCE: f64 = 1e-8;

#[test]
fn val_opensim_what_is_free_to_satisfy_constraints_gives_way() {
    let folder = Folder::new("");
    folder.write(
        "small.osim",
        &LEGS.replace("FREE", "<is_free_to_satisfy_constraints>true</is_free_to_satisfy_constraints>"),
    );
    let outcome = folder.run("ForwardTool", "<final_time>1e-5</final_time>").unwrap_or_else(|e| panic!("{e}"));
    let states = table(&outcome, "_states.sto");
    let names = ["knee_1/knee_angle_1", "knee_2/knee_angle_2", "sole/foot_angle", "sole/foot_x", "sole/foot_y"];
    for (name, expected) in names.iter().zip(ASSEMBLED) {
        let found = states.rows[0][states.find(&format!("/jointset/{name}/value")).unwrap()];
        assert!((found - expected).abs() < TOLERANCE, "{name}: {found} instead of {expected}");
    }
}

#[test]
fn verif_an_axis_of_several_coordinates_is_refused_by_name() {
    let folder = Folder::new("");
    let axis = |name: &str, coordinates: &str, function: &str| {
        let direction = ["1 0 0", "0 1 0", "0 0 1"][usize::from(name.as_bytes()[name.len() - 1] - b'1')];
        format!(
            "<TransformAxis \
             name=\"{name}\"><coordinates>{coordinates}</coordinates><axis>{direction}</axis>{function}</TransformAxis>"
        )
    };
    let one = "<LinearFunction><coefficients>1 0</coefficients></LinearFunction>";
    let none = "<Constant><value>0</value></Constant>";
    let model = |third: &str, coordinates: &str| {
        let axes = [
            axis("rotation1", "a", one),
            axis("rotation2", "b", one),
            axis("rotation3", coordinates, third),
            axis("translation1", "", none),
            axis("translation2", "", none),
            axis("translation3", "", none),
        ];
        format!(
            "<OpenSimDocument Version=\"40600\"><Model name=\"m\"><BodySet><objects><Body \
             name=\"body\"><mass>1</mass><mass_center>0 0 0</mass_center>\
             <inertia>0.1 0.1 0.1 0 0 0</inertia></Body></objects></BodySet><JointSet><objects><CustomJoint name=\"j\">\
             <socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/body</socket_child_frame>\
             <coordinates>\
             <Coordinate name=\"a\"/><Coordinate \
             name=\"b\"/></coordinates><SpatialTransform>{}</SpatialTransform></CustomJoint></objects></JointSet>\
             </Model></OpenSimDocument>",
            axes.concat()
        )
    };
    let polynomial = "<MultivariatePolynomialFunction><coefficients>0 1 \
                      2</coefficients><dimension>2</dimension><order>1</order>\
                      </MultivariatePolynomialFunction>";
    let linear = "<LinearFunction><coefficients>1 2 0</coefficients></LinearFunction>";
    for function in [polynomial, linear] {
        folder.write("small.osim", &model(function, "a b"));
        let error = folder.error("ForwardTool", "<final_time>1e-5</final_time>");
        let expected = "/jointset/j: rotation3 of the SpatialTransform is a function of several coordinates (a, b), \
                        which is not supported";
        assert!(error.contains(expected), "{error}");
    }
    // A constant takes none of them.
    folder.write("small.osim", &model(none, "a b"));
    folder.run("ForwardTool", "<final_time>1e-5</final_time>").unwrap_or_else(|e| panic!("{e}"));
}

/// Largest error of a coupler along a simulation to which errors of 1e-7 are allowed [rad].
const HELD: f64 = 1e-5;

/// Couplers of two coordinates hold while the model moves, also where the function bends.
#[test]
fn verif_couplers_of_two_coordinates_hold_in_motion() {
    let body = |name: &str| {
        format!(
            "<Body name=\"{name}\"><mass>1</mass><mass_center>0 -0.2 0</mass_center><inertia>0.02 0.001 0.02 0 0 \
             0</inertia></Body>"
        )
    };
    let pin = |name: &str, parent: &str, at: &str, body: &str, value: &str| {
        format!(
            "<PinJoint \
             name=\"pin_{name}\"><socket_parent_frame>at</socket_parent_frame>\
             <socket_child_frame>/bodyset/{body}</socket_child_frame>\
             <coordinates><Coordinate \
             name=\"{name}\"><default_value>{value}</default_value></Coordinate></coordinates><frames>\
             <PhysicalOffsetFrame \
             name=\"at\"><socket_parent>{parent}</socket_parent><translation>{at}</translation><orientation>0 0 \
             0</orientation>\
             </PhysicalOffsetFrame></frames></PinJoint>"
        )
    };
    for (order, coefficients) in [(1, [0.1, 0.3, 0.2, 0.0, 0.0, 0.0]), (2, [0.1, 0.3, 0.0, 0.2, 0.4, 0.5])] {
        let used = if order == 1 { 3 } else { 6 };
        let written: Vec<String> = coefficients[..used].iter().map(f64::to_string).collect();
        let model = format!(
            "<OpenSimDocument Version=\"40600\"><Model name=\"m\"><gravity>0 -9.80665 \
             0</gravity><BodySet><objects>{}{}{}</objects></BodySet>\
             <JointSet><objects>{}{}{}</objects></JointSet><ConstraintSet><objects><CoordinateCouplerConstraint \
             name=\"k\">\
             <coupled_coordinates_function><MultivariatePolynomialFunction><coefficients>{}</coefficients>\
             <dimension>2</dimension>\
             <order>{order}</order></MultivariatePolynomialFunction></coupled_coordinates_function>\
             <independent_coordinate_names>x \
             y</independent_coordinate_names><dependent_coordinate_name>z</dependent_coordinate_name>\
             </CoordinateCouplerConstraint></objects></ConstraintSet></Model></OpenSimDocument>",
            body("a"),
            body("b"),
            body("c"),
            pin("x", "/ground", "0 1 0", "a", "0.5"),
            pin("y", "/bodyset/a", "0 -0.4 0", "b", "0.3"),
            pin("z", "/bodyset/b", "0 -0.4 0", "c", "0"),
            written.join(" ")
        );
        let folder = Folder::new("");
        folder.write("small.osim", &model);
        let setup = "<final_time>0.3</final_time><integrator_error_tolerance>1e-7</integrator_error_tolerance>";
        let outcome = folder.run("ForwardTool", setup).unwrap_or_else(|e| panic!("{e}"));
        let states = table(&outcome, "_states.sto");
        let of = |row: &[f64], name: &str| row[states.find(&format!("/jointset/pin_{name}/{name}/value")).unwrap()];
        let mut moved = 0.0_f64;
        for row in &states.rows {
            let (x, y) = (of(row, "x"), of(row, "y"));
            let [c00, c01, ..] = coefficients;
            let expected = match order {
                1 => c00 + c01 * y + coefficients[2] * x,
                _ => {
                    c00 + c01 * y
                        + coefficients[2] * y * y
                        + coefficients[3] * x
                        + coefficients[4] * x * y
                        + coefficients[5] * x * x
                }
            };
            assert!((of(row, "z") - expected).abs() < HELD, "order {order}: {} instead of {expected}", of(row, "z"));
            moved = moved.max((x - 0.5).abs());
        }
        assert!(moved > 0.1, "the model moves: {moved}");
    }
}
