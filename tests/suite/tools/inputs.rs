//! What a setup names: files that no result replaces, settings that nothing can work with, values that are none.

use super::small_model::{Folder, muscle, table};

const ID: &str = "<coordinates_file>motion.mot</coordinates_file>\
                  <lowpass_cutoff_frequency_for_coordinates>-1</lowpass_cutoff_frequency_for_coordinates>";
const ANALYSIS: &str = "<coordinates_file>motion.mot</coordinates_file><AnalysisSet><objects><Kinematics \
                        name=\"K\"/></objects></AnalysisSet>";

fn loads(data: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<OpenSimDocument Version=\"40500\"><ExternalLoads name=\"l\"><objects><ExternalForce \
         name=\"push\"><applied_to_body>hand</applied_to_body><force_expressed_in_body>ground</force_expressed_in_body>\
         <point_expressed_in_body>ground</point_expressed_in_body><force_identifier>f_v</force_identifier>\
         <point_identifier>f_p</point_identifier><torque_identifier></torque_identifier></ExternalForce></objects>\
         <datafile>{data}</datafile></ExternalLoads></OpenSimDocument>\n"
    )
}

const LOADS: &str = "loads\nversion=1\nnRows=4\nnColumns=8\ninDegrees=no\nendheader\ntime f_vx f_vy f_vz f_px f_py \
                     f_pz other\n0 1 2 3 0.1 0 0.2 0\n0.4 2 2 3 0.1 0.1 0.2 nan\n0.8 3 2 1 0 0.1 0.2 0\n1 -1 2 3 0.1 \
                     0.1 0.2 0\n";

#[test]
fn verif_no_result_takes_the_place_of_a_file_that_is_read() {
    let folder = Folder::new(&muscle("Millard2012EquilibriumMuscle", "m", ""));
    folder.write("loads.xml", &loads("loads.sto"));
    folder.write("loads.sto", LOADS);
    folder.write("m.trc", &markers(&[0.0]));
    folder.write("unused.mot", "never read");
    let refused = |class: &str, inner: &str, file: &str| {
        let error = folder.error(class, inner);
        let expected = format!("{file}: this is one of the files that are read; it is not overwritten | name another");
        assert!(error.contains(&expected), "{inner}: {error}");
    };
    let with_loads = format!("{ID}<external_loads_file>loads.xml</external_loads_file>");
    refused(
        "InverseDynamicsTool",
        &format!("{ID}<output_gen_force_file>motion.mot</output_gen_force_file>"),
        "motion.mot",
    );
    // What a file names that the setup names, and what names it is not the setup itself.
    for file in ["loads.sto", "loads.xml", "small.osim", "setup.xml"] {
        let inner = format!("{with_loads}<output_gen_force_file>{file}</output_gen_force_file>");
        refused("InverseDynamicsTool", &inner, file);
    }
    // A file that another tool would read.
    let inner =
        format!("{ID}<speeds_file>unused.mot</speeds_file><output_gen_force_file>unused.mot</output_gen_force_file>");
    refused("InverseDynamicsTool", &inner, "unused.mot");
    // A result whose name follows from that of the tool.
    std::fs::copy(folder.path("motion.mot"), folder.path("run_K_q.sto")).unwrap();
    refused("AnalyzeTool", &ANALYSIS.replace("motion.mot", "run_K_q.sto"), "run_K_q.sto");
    let ik = "<marker_file>m.trc</marker_file><output_motion_file>m.trc</output_motion_file>";
    refused("InverseKinematicsTool", ik, "m.trc");
    let scale = "<GenericModelMaker><model_file>small.osim</model_file></GenericModelMaker><ModelScaler>\
                 <output_model_file>small.osim</output_model_file></ModelScaler>";
    refused("ScaleTool", scale, "small.osim");
    // By way of a link.
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(folder.path("motion.mot"), folder.path("link.sto")).unwrap();
        refused(
            "InverseDynamicsTool",
            &format!("{ID}<output_gen_force_file>link.sto</output_gen_force_file>"),
            "link.sto",
        );
    }
    // Results of a run before are no inputs.
    let inner = format!("{ID}<output_gen_force_file>id.sto</output_gen_force_file>");
    for _ in 0..2 {
        let outcome = folder.run("InverseDynamicsTool", &inner).unwrap();
        std::fs::write(&outcome.files[0].path, &outcome.files[0].bytes).unwrap();
    }
}

#[test]
fn verif_settings_that_nothing_can_work_with_are_refused() {
    let folder = Folder::new(&muscle("Millard2012EquilibriumMuscle", "m", ""));
    folder.write("m.trc", &markers(&[0.0]));
    let ik = "<marker_file>m.trc</marker_file>";
    let task = "<IKTaskSet><objects><IKMarkerTask \
                name=\"U1\"><apply>true</apply><weight>VALUE</weight></IKMarkerTask></objects></IKTaskSet>";
    let of_property = |property: &str| format!("<{property}>VALUE</{property}>");
    let analysis = ANALYSIS.replace(
        "<Kinematics name=\"K\"/>",
        "<Kinematics name=\"K\"><step_interval>VALUE</step_interval></Kinematics>",
    );
    let fault = |class: &str, inner: String, values: &[&str], expected: &str| {
        for value in values {
            let error = folder.error(class, &inner.replace("VALUE", value));
            assert!(error.contains(expected) && error.contains("setup.xml:"), "{value}: {error}");
            assert!(error.contains(&format!("found \"{value}\"")), "{value}: {error}");
        }
    };
    for class in ["ForwardTool", "AnalyzeTool"] {
        let inner = |property: &str| format!("{ANALYSIS}{}", of_property(property));
        let accuracy = "integrator_error_tolerance: expected a number above 0 and below 1";
        fault(class, inner("integrator_error_tolerance"), &["-1", "0", "nan", "1e300", "inf", "1"], accuracy);
        let steps = "maximum_number_of_integrator_steps: expected a whole number from 1 on";
        fault(class, inner("maximum_number_of_integrator_steps"), &["0", "-5", "1.5", "nan"], steps);
        fault(class, inner("maximum_integrator_step_size"), &["0", "-1", "nan"], "expected a time above 0 s");
        fault(class, inner("minimum_integrator_step_size"), &["-1e-8", "2", "nan"], "expected a time from 0 s to");
        fault(class, inner("output_precision"), &["-1", "100"], "expected a whole number from 0 to 40");
        fault(class, inner("initial_time"), &["nan", "soon"], "initial_time: expected a time");
        fault(class, inner("final_time"), &["-1", "nan"], "final_time: expected a time");
    }
    for value in ["inf", "-inf"] {
        fault("ForwardTool", of_property("initial_time"), &[value], "initial_time: expected a finite time");
    }
    // A bound that is named has few digits, however small.
    let tiny = of_property("maximum_integrator_step_size").replace("VALUE", "1e-300");
    let least = format!("{tiny}{}", of_property("minimum_integrator_step_size"));
    fault("ForwardTool", least, &["1"], "expected a time from 0 s to maximum_integrator_step_size (1e-300 s)");
    fault("AnalyzeTool", analysis, &["0", "-1", "x"], "step_interval: expected a whole number from 1 on");
    let cutoff = of_property("lowpass_cutoff_frequency_for_coordinates");
    fault("AnalyzeTool", format!("{ANALYSIS}{cutoff}"), &["nan", "inf"], "expected a number");
    let range = of_property("time_range");
    fault(
        "InverseDynamicsTool",
        format!("{ID}{range}").replacen("<low", "<low", 1),
        &["0 nan", "1 0"],
        "expected 2 numbers, the first and the last time",
    );
    fault("InverseKinematicsTool", format!("{ik}{range}"), &["nan 1", "0.5 0.2"], "time_range: expected 2 numbers");
    fault(
        "InverseKinematicsTool",
        format!("{ik}{}", of_property("accuracy")),
        &["0", "-1e-5", "2"],
        "accuracy: expected",
    );
    fault(
        "InverseKinematicsTool",
        format!("{ik}{}", of_property("constraint_weight")),
        &["-1", "nan"],
        "expected a number from 0 on, or Inf",
    );
    fault(
        "InverseKinematicsTool",
        format!("{ik}{task}"),
        &["-1", "nan", "inf"],
        "weight: expected a weight of 0 or more",
    );
    let scales = "<GenericModelMaker><model_file>small.osim</model_file></GenericModelMaker><ModelScaler>\
                  <scaling_order>manualScale</scaling_order><ScaleSet><objects><Scale><segment>hand</segment>\
                  <scales>VALUE</scales></Scale></objects></ScaleSet></ModelScaler>";
    fault(
        "ScaleTool",
        scales.to_owned(),
        &["0 1 1", "1 -1 1", "1 nan 1", "inf 1 1"],
        "scales: expected 3 numbers above 0",
    );
    // What the defaults of OpenSim say is fine, empty or not.
    for value in ["", "1e-5", "0.5"] {
        let inner = format!("{ANALYSIS}<integrator_error_tolerance>{value}</integrator_error_tolerance>");
        folder.run("AnalyzeTool", &inner).unwrap();
    }
}

#[test]
fn verif_a_value_that_is_none_is_located() {
    let folder = Folder::new("");
    let motion = super::small_model::motion();
    let row = motion.lines().nth(11).unwrap().to_owned();
    let mut words: Vec<&str> = row.split('\t').collect();
    let time: f64 = words[0].parse().unwrap();
    words[2] = "nan";
    folder.write("gap.mot", &motion.replace(&row, &words.join("\t")));
    let expected = format!("gap.mot:12: column `bend` at t = {time} s: expected a finite number, found NaN | a gap");
    for (class, inner) in [
        ("InverseDynamicsTool", ID),
        ("AnalyzeTool", ANALYSIS),
        (
            "AnalyzeTool",
            &format!(
                "{ANALYSIS}<lowpass_cutoff_frequency_for_coordinates>6</lowpass_cutoff_frequency_for_coordinates>"
            ),
        ),
    ] {
        let error = folder.error(class, &inner.replace("motion.mot", "gap.mot"));
        assert!(error.contains(&expected), "{error}");
    }
    // In the file of the loads, not in the one that names it; and not in columns that nothing uses.
    folder.write("loads.xml", &loads("loads.sto"));
    let id = format!("{ID}<external_loads_file>loads.xml</external_loads_file>");
    folder.write("loads.sto", LOADS);
    folder.run("InverseDynamicsTool", &id).unwrap();
    folder.write("loads.sto", &LOADS.replace("3 2 1 0 0.1", "3 inf 1 0 0.1"));
    let error = folder.error("InverseDynamicsTool", &id);
    assert!(error.contains("loads.sto:10: column `f_vy` at t = 0.8 s: expected a finite number, found inf"), "{error}");
}

/// The motion of a model whose force set is empty lacks the loads, with or without the word.
#[test]
fn verif_external_loads_are_no_forces_of_the_model() {
    let folder = Folder::new(&muscle("Millard2012EquilibriumMuscle", "m", ""));
    folder.write("loads.xml", &loads("loads.sto"));
    folder.write("loads.sto", LOADS);
    let moments = |excluded: &str, loads: &str| {
        let inner = format!(
            "{ID}<forces_to_exclude>{excluded}</forces_to_exclude><external_loads_file>{loads}</external_loads_file>"
        );
        table(&folder.run("InverseDynamicsTool", &inner).unwrap(), "inverse_dynamics.sto").rows.concat()
    };
    let (loaded, unloaded) = (moments("", "loads.xml"), moments("", ""));
    // Inverse dynamics is linear in forces: what loads add is the same without muscles.
    for excluded in ["All", "Muscles", "push Muscles", "m"] {
        let (with, without) = (moments(excluded, "loads.xml"), moments(excluded, ""));
        assert!((0..with.len()).any(|i| (with[i] - without[i]).abs() > 0.1), "{excluded}");
        for i in 0..with.len() {
            let difference = (with[i] - without[i]) - (loaded[i] - unloaded[i]);
            assert!(difference.abs() < 5e-8, "{excluded}: {difference}");
        }
    }
}

/// Markers of the model at rest, seen at times.
pub fn markers(times: &[f64]) -> String {
    super::marker_search::trc(times, |_, _| nalgebra::Vector3::zeros())
}

#[test]
fn verif_times_in_another_unit_are_suspected() {
    let warned = |step: f64| {
        let rows: String = (0..6).map(|i| format!("{}\t0\n", step * f64::from(i))).collect();
        let text = format!("m\nversion=1\nnRows=6\nnColumns=2\ninDegrees=no\nendheader\ntime\tq\n{rows}");
        let storage = carpus::storage::Storage::parse(text.as_bytes(), std::path::Path::new("m.sto")).unwrap();
        storage.warnings.join(" ")
    };
    assert_eq!((warned(0.01), warned(0.5)), (String::new(), String::new()));
    assert!(warned(10.0).contains("the median step of `time` is 10 s: are these milliseconds?"), "{}", warned(10.0));
    assert!(warned(1e4).contains("are these microseconds?"), "{}", warned(1e4));
    assert!(warned(1e-9).contains("times are in seconds"), "{}", warned(1e-9));
}

#[test]
fn verif_a_row_with_too_few_values_is_named_not_the_next_one() {
    let text = "m\nversion=1\nnRows=3\nnColumns=3\nendheader\ntime\ta\tb\n0 1 2\n0.1 1\n0.2 1 2\n";
    let error =
        carpus::storage::Storage::parse(text.as_bytes(), std::path::Path::new("m.sto")).unwrap_err().to_string();
    assert!(error.contains("m.sto:8: expected 3 values, as there are columns; found 2"), "{error}");
}
