//! Setups that cannot be run: what is said, and where.

use carpus::tools::run_tool;

fn error_of(setup: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let model = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("models/wrist.osim");
    let path = folder.path().join("setup.xml");
    std::fs::write(&path, setup.replace("MODEL", &model.display().to_string())).unwrap();
    std::fs::write(
        folder.path().join("q.mot"),
        "q\nversion=1\nnRows=2\nnColumns=2\ninDegrees=no\nendheader\ntime flexion\n0 0\n1 0\n",
    )
    .unwrap();
    match run_tool(&path, None, false) {
        Ok(_) => panic!("{setup} ran"),
        Err(error) => format!("{error} | {}", error.hint().unwrap_or_default())
            .replace(&format!("{}/", folder.path().display()), ""),
    }
}

fn tool(class: &str, inner: &str) -> String {
    format!("<OpenSimDocument Version=\"40000\">\n<{class} name=\"t\">\n{inner}\n</{class}>\n</OpenSimDocument>\n")
}

#[test]
fn verif_faults_of_setups_are_told_with_their_line() {
    let model = "<model_file>MODEL</model_file>\n";
    let analyze = |analysis: &str| {
        tool(
            "AnalyzeTool",
            &format!(
                "{model}<coordinates_file>q.mot</coordinates_file>\n<AnalysisSet><objects>\n{analysis}\n</objects></AnalysisSet>"
            ),
        )
    };
    for (setup, expected) in [
        (tool("CMCTool", model), "setup.xml:2: expected a setup of a tool"),
        (
            tool("InverseDynamicsTool", ""),
            "setup.xml:2: model_file is missing: expected a model (.osim) | name the model with --model",
        ),
        (tool("InverseDynamicsTool", model), "setup.xml:2: coordinates_file is missing"),
        (
            tool("InverseDynamicsTool", &format!("{model}<time_range>0 x</time_range>")),
            "setup.xml:4: time_range: expected 2 numbers, found \"0 x\"",
        ),
        (
            tool("InverseKinematicsTool", &format!("{model}<marker_file>gone.trc</marker_file>")),
            "gone.trc: cannot be read",
        ),
        (analyze("<ProbeReporter/>"), "setup.xml:6: ProbeReporter is not supported: analyses are Kinematics"),
        (
            analyze("<PointKinematics><body_name>hnad</body_name></PointKinematics>"),
            "setup.xml:6: the model has no body `hnad` | did you mean `hand`?",
        ),
        (
            analyze("<Kinematics><on>maybe</on></Kinematics>"),
            "setup.xml:6: on: expected true or false, found \"maybe\"",
        ),
        ("<a>\n<b></a>".to_owned(), "setup.xml"),
    ] {
        let error = error_of(&setup);
        assert!(error.contains(expected), "expected {expected}\n   found {error}");
    }
}
