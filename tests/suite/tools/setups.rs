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
                "{model}<coordinates_file>q.mot</coordinates_file>\n<AnalysisSet><objects>\n{analysis}\n</objects>\
                 </AnalysisSet>"
            ),
        )
    };
    for (setup, expected) in [
        (tool("CMCTool", model), "setup.xml:2: expected a setup of a tool"),
        (
            tool("InverseDynamicsTool", ""),
            "setup.xml:2: model_file is missing: expected a model (.osim) | name the model with --model",
        ),
        (
            tool("InverseKinematicsTool", "<model_file></model_file>"),
            "model_file is missing: expected a model (.osim) | name the model with --model",
        ),
        (tool("InverseDynamicsTool", model), "setup.xml:2: coordinates_file is missing"),
        (
            tool("InverseDynamicsTool", &format!("{model}<time_range>0 x</time_range>")),
            "setup.xml:4: time_range: expected 2 numbers, the first and the last time, found \"0 x\"",
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

/// Speeds of a `speeds_file` take the place of those of the motion.
#[test]
fn verif_speeds_file() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let model = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/components/forces.osim");
    let header = "x\nversion=1\nnRows=8\nnColumns=2\ninDegrees=no\nendheader\n";
    let rows = |value: f64| (0..8).map(|i| format!("{}\t{}\n", 0.1 * f64::from(i), value)).collect::<String>();
    write("q.mot", &format!("{header}time\tq1\n{}", rows(0.3)));
    write("u.sto", &format!("{header}time\t/jointset/one/q1/speed\n{}", rows(1.25)));
    let inner = format!(
        "<model_file>{}</model_file><results_directory>.</results_directory><initial_time>0</initial_time>\
         <final_time>0.7</final_time><coordinates_file>q.mot</coordinates_file><speeds_file>u.sto</speeds_file>\
         <AnalysisSet><objects><Kinematics><coordinates>q1</coordinates><in_degrees>false</in_degrees></Kinematics>\
         </objects></AnalysisSet>",
        model.display()
    );
    write("setup.xml", &tool("AnalyzeTool", &inner));
    let outcome = run_tool(&folder.path().join("setup.xml"), None, false).unwrap_or_else(|e| panic!("{e}"));
    let file = outcome.files.iter().find(|f| f.path.to_string_lossy().ends_with("_u.sto")).expect("speeds");
    let speeds = carpus::storage::Storage::parse(&file.bytes, &file.path).unwrap();
    assert!(!speeds.is_empty());
    assert!(speeds.rows.iter().all(|row| row[0] == 1.25), "{:?}", speeds.rows);
}
