//! Static optimization where accelerations are not determined: two axes of a joint of a massless body coincide.

use carpus::tools::run_tool;

use super::small_model::{setup, table};

/// A massless base that turns about three axes, and an arm on it; at a middle angle of 90° the outer axes coincide.
const MODEL: &str = r#"<?xml version="1.0"?><OpenSimDocument Version="40600"><Model name="m"><gravity>0 -9.80665 0</gravity>
<BodySet><objects><Body name="base"><mass>0</mass><mass_center>0 0 0</mass_center><inertia>0 0 0 0 0 0</inertia></Body>
<Body name="arm"><mass>2</mass><mass_center>0.2 0.02 0.05</mass_center><inertia>0.02 0.05 0.04 0 0 0</inertia></Body></objects></BodySet>
<JointSet><objects><GimbalJoint name="ball"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/base</socket_child_frame>
<coordinates><Coordinate name="r_x"/><Coordinate name="r_y"/><Coordinate name="r_z"/></coordinates></GimbalJoint>
<PinJoint name="elbow"><socket_parent_frame>/bodyset/base</socket_parent_frame><socket_child_frame>/bodyset/arm</socket_child_frame>
<coordinates><Coordinate name="bend"/></coordinates></PinJoint></objects></JointSet>
<ForceSet><objects>ACTUATORS</objects></ForceSet></Model></OpenSimDocument>"#;

/// Controls of all actuators at one time.
fn controls(middle: f64) -> Vec<f64> {
    let folder = tempfile::tempdir().unwrap();
    let actuator = |(name, coordinate, optimal): &(&str, &str, f64)| {
        format!(
            "<CoordinateActuator \
             name=\"{name}\"><coordinate>{coordinate}</coordinate><optimal_force>{optimal}</optimal_force>\
             </CoordinateActuator>"
        )
    };
    let actuators =
        [("x", "r_x", 20.0), ("y", "r_y", 20.0), ("z", "r_z", 20.0), ("b", "bend", 5.0), ("c", "bend", 3.0)];
    let model = MODEL.replace("ACTUATORS", &actuators.iter().map(actuator).collect::<String>());
    std::fs::write(folder.path().join("small.osim"), model).unwrap();
    let row = |i: usize| format!("{} 0.3 {middle:.17} -0.1 {}\n", 0.1 * i as f64, 0.4 + 0.1 * (i as f64).sin());
    let header = "q\nversion=1\nnRows=8\nnColumns=5\ninDegrees=no\nendheader\ntime r_x r_y r_z bend\n";
    let motion = header.to_owned() + &(0..8).map(row).collect::<String>();
    std::fs::write(folder.path().join("motion.mot"), motion).unwrap();
    let inner = "<final_time>0.7</final_time><coordinates_file>motion.mot</coordinates_file><AnalysisSet><objects>\
                 <StaticOptimization name=\"SO\"/></objects></AnalysisSet>";
    let file = folder.path().join("setup.xml");
    std::fs::write(&file, setup("AnalyzeTool", inner).replace("RESULTS", ".")).unwrap();
    let outcome = run_tool(&file, None, false).unwrap_or_else(|e| panic!("{e}"));
    assert!(outcome.warnings.is_empty(), "{:?}", outcome.warnings);
    table(&outcome, "_SO_activation.sto").rows[3].clone()
}

#[test]
fn verif_static_optimization_goes_on_where_axes_coincide() {
    let quarter = std::f64::consts::FRAC_PI_2;
    let (there, near) = (controls(quarter), controls(quarter - 1e-4));
    assert!(there.iter().any(|x| x.abs() > 0.05), "{there:?}");
    for (at, beside) in there.iter().zip(&near) {
        assert!((at - beside).abs() < 1e-3, "{there:?} {near:?}");
    }
}
