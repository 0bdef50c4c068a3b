//! Setup files run by OpenSim 4.6 and by this program: same files, labels, headers; largest differences stated.
//!
//! The setups and motions are made here. They run where Python can import `opensim`; others skip visibly.

use std::path::{Path, PathBuf};

use carpus::multibody::Model;
use carpus::osim::spec::{ModelSpec, MotionType, MuscleKind, MuscleSpec, OtherMuscleSpec};
use carpus::osim::{ComponentSet, OsimFile};
use carpus::storage::Storage;
use carpus::tools::run_tool;

use crate::reference::{lab_models_if_here, opensim_python, run_script, shared, stem};
use crate::validation::{self, Differences, Judge, Row};

/// Numbers are printed with this many digits behind the point.
const PRECISION: usize = 12;

/// Models of which OpenSim's accelerations, and what hangs on them, are left out: nearly massless bodies, so that
/// forces of 1e6 N·m stay unbalanced.
const WITHOUT_ACCELERATIONS: [&str; 1] = ["MOBL_ARMS_41"];
/// What OpenSim's deprecated muscles leave undefined.
const UNDEFINED: &str = "OpenSim's deprecated muscles do not compute these: not a number there, a number here";

/// A folder in which both programs run the same setup.
pub(super) struct Bench {
    folder: tempfile::TempDir,
    python: PathBuf,
}

impl Bench {
    pub(super) fn new() -> Bench {
        Bench { python: opensim_python(), folder: tempfile::tempdir().unwrap() }
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(super) fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    /// Runs a setup whose results go to the folder `RESULTS`; returns rows of the validation table.
    pub(super) fn compare(&self, tool: &str, model: &Path, setup: &str, tolerance: &dyn Fn(&str) -> f64) -> Vec<Row> {
        for (name, results) in [("opensim.xml", "opensim"), ("carpus.xml", "carpus")] {
            // Results of the setup before.
            let _ = std::fs::remove_dir_all(self.path(results));
            self.write(name, &setup.replace("RESULTS", results));
        }
        run_script(&self.python, "scripts/run_tool.py", &[self.path("opensim.xml").as_os_str()]);
        let outcome = run_tool(&self.path("carpus.xml"), None, false).unwrap_or_else(|e| panic!("{e}"));
        for file in &outcome.files {
            std::fs::create_dir_all(file.path.parent().unwrap()).unwrap();
            std::fs::write(&file.path, &file.bytes).unwrap();
        }
        let mut names: Vec<String> = std::fs::read_dir(self.path("opensim"))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        assert!(!names.is_empty());
        let muscles = OsimFile::read(model).unwrap().spec.muscles;
        let strongest = muscles.iter().map(|m| m.max_isometric_force).fold(0.0, f64::max);
        let may_be_undefined = muscles.iter().any(is_deprecated);
        // Files of one analysis share a row.
        let mut found: Vec<(Differences, f64)> = Vec::new();
        for name in names.iter().filter(|n| n.ends_with("sto") || n.ends_with("mot")) {
            let (theirs, ours) = (self.path("opensim").join(name), self.path("carpus").join(name));
            assert!(ours.exists(), "OpenSim writes {name}, carpus does not");
            let short = name.trim_start_matches("run_").trim_end_matches(".sto");
            if hangs_on_accelerations(name) && WITHOUT_ACCELERATIONS.contains(&stem(model).as_str()) {
                continue;
            }
            // OpenSim finds the equilibrium of muscles to 1e-8 of their maximum force.
            let (what, least, unit) = match short {
                _ if hangs_on_accelerations(name) => (", accelerations", 1.0, "value, at least 1"),
                _ if short.contains("Force") => {
                    (", forces", (1e-3 * strongest).max(1.0), "value, at least 1 and Fmax/1000")
                }
                _ => ("", 1.0, "value, at least 1"),
            };
            let quantity = format!("{tool}: {}{what}", short.split('_').next().unwrap_or(short));
            let bar = tolerance(name);
            let known = found.iter().position(|(known, at)| known.quantity == quantity && *at == bar);
            let row = known.unwrap_or_else(|| {
                found.push((Differences::listing_above(quantity, unit, bar), bar));
                found.len() - 1
            });
            compare_files(&theirs, &ours, least, may_be_undefined, &mut found[row].0);
        }
        found.retain(|(differences, _)| differences.count() > 0);
        let row = |(found, bar): &(Differences, f64)| found.row("tools", &name_of(model), *bar, Judge::Max);
        let rows: Vec<Row> = found.iter().map(row).collect();
        validation::write(&format!("tools_{tool}_{}", name_of(model).replace('/', "_")), &rows);
        validation::assert_passed(&rows);
        rows
    }
}

/// A model's name in the table.
fn name_of(model: &Path) -> String {
    if model == bundled() { "models/wrist.osim".to_owned() } else { stem(model) }
}

fn bundled() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("models/wrist.osim")
}

fn hangs_on_accelerations(file: &str) -> bool {
    ["dudt", "acc", "Reaction"].iter().any(|part| file.contains(part))
}

/// Everything of the header but numbers has to be the same; differences are relative to what is above `least`.
fn compare_files(theirs: &Path, ours: &Path, least: f64, may_be_undefined: bool, differences: &mut Differences) {
    let header = |path: &Path| {
        let text = std::fs::read_to_string(path).unwrap();
        text.split("endheader").next().unwrap().to_owned()
    };
    assert_eq!(header(theirs), header(ours), "headers of {}", theirs.display());
    let file = theirs.file_stem().unwrap().to_string_lossy();
    let (theirs, ours) = (Storage::read(theirs).unwrap(), Storage::read(ours).unwrap());
    assert_eq!(theirs.labels, ours.labels);
    assert_eq!(theirs.time, ours.time);
    for (k, (a, b)) in theirs.rows.iter().zip(&ours.rows).enumerate() {
        for ((a, b), label) in a.iter().zip(b).zip(&theirs.labels) {
            let undefined = may_be_undefined && a.is_nan() && !b.is_nan();
            assert!(undefined || a.is_nan() == b.is_nan(), "{label}, row {k}: {b} instead of {a}");
            if undefined {
                differences.remark(UNDEFINED);
            } else if !a.is_nan() {
                let difference = if a == b { 0.0 } else { (a - b).abs() / a.abs().max(least) };
                differences.push(difference, || format!("{file}: {label}, row {k}: {b} instead of {a}"));
            }
        }
    }
}

/// A motion of coordinates in radians and metres.
pub(super) fn motion_of(names: &[&str], rows: usize, step: f64, values: impl Fn(f64) -> Vec<f64>) -> String {
    let mut text = format!(
        "motion\nversion=1\nnRows={rows}\nnColumns={}\ninDegrees=no\nendheader\ntime\t{}\n",
        names.len() + 1,
        names.join("\t")
    );
    for row in 0..rows {
        let time = row as f64 * step;
        let values: Vec<String> = values(time).iter().map(|value| format!("{value:.15}")).collect();
        text += &format!("{time:.6}\t{}\n", values.join("\t"));
    }
    text
}

/// A motion of all free coordinates inside their ranges that satisfies the couplers, in degrees where OpenSim has
/// degrees.
fn motion(spec: &ModelSpec, rows: usize, step: f64) -> String {
    let model = Model::compile(spec).unwrap();
    let labels = spec.coordinates.iter().map(|c| c.name.clone()).collect();
    let mut storage = Storage::new("motion", labels);
    storage.in_degrees = true;
    for row in 0..rows {
        let time = row as f64 * step;
        let value = |(i, c): (usize, &carpus::osim::spec::CoordinateSpec)| {
            // OpenSim's assembly moves values that are at the end of a range inward by some 1e-5 rad.
            let [low, high] = c.range.map(|r| r.clamp(-1.0, 1.0));
            let inside = 0.1 * (high - low);
            let middle = c.default_value.clamp(low + inside, high - inside);
            let reach = 0.3 * (high - middle).min(middle - low).clamp(0.0, 0.5);
            if c.locked { c.default_value } else { middle + reach * ((3.0 + 0.7 * i as f64) * time + i as f64).sin() }
        };
        let mut q: Vec<f64> = spec.coordinates.iter().enumerate().map(value).collect();
        model.satisfy_couplers(&mut q);
        let in_file = |(q, c): (&f64, &carpus::osim::spec::CoordinateSpec)| match c.motion_type {
            MotionType::Rotational => q.to_degrees(),
            _ => *q,
        };
        storage.push(time, q.iter().zip(&spec.coordinates).map(in_file).collect());
    }
    storage.text(14)
}

/// Models: the bundled one, and lab models of different kinds; for the validation table all that are here.
fn models() -> Vec<PathBuf> {
    let some = ["MOBL_ARMS_fixed_41", "Hand_Wrist_Model_for_development", "arm26"];
    let wanted = |model: &PathBuf| validation::folder().is_some() || some.contains(&stem(model).as_str());
    std::iter::once(bundled()).chain(lab_models_if_here().into_iter().filter(wanted)).collect()
}

/// Whether a muscle is of a class that OpenSim has given up.
fn is_deprecated(muscle: &MuscleSpec) -> bool {
    match &muscle.kind {
        MuscleKind::OtherClass { law: Some(law), .. } => matches!(law.as_ref(), OtherMuscleSpec::Deprecated(_)),
        _ => false,
    }
}

pub(super) fn setup(class: &str, model: &Path, inner: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>\n<OpenSimDocument Version=\"40000\">\n<{class} \
         name=\"run\">\n<model_file>{}</model_file>\n<results_directory>RESULTS</results_directory>\n{inner}\n\
         </{class}>\n</OpenSimDocument>\n",
        model.display()
    )
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_inverse_dynamics() {
    let bench = Bench::new();
    for model in models() {
        let spec = OsimFile::read(&model).unwrap().spec;
        bench.write("motion.mot", &motion(&spec, 40, 0.01));
        bench.write(
            "loads.mot",
            "loads\nversion=1\nnRows=4\nnColumns=10\ninDegrees=no\nendheader\ntime f_vx f_vy f_vz \
                                  f_px f_py f_pz m_x m_y m_z\n-1 1 2 3 0.1 0 0.2 0.1 0.2 0\n0 2 2 3 0.1 0.1 0.2 0.1 \
                                  0.2 1\n0.2 3 2 1 0 0.1 0.2 0.3 0.2 1\n1 -1 2 3 0.1 0.1 0.2 0.1 0.4 0\n",
        );
        let body = &spec.bodies.last().unwrap().name;
        bench.write(
            "loads.xml",
            &format!(
                "<?xml version=\"1.0\"?>\n<OpenSimDocument Version=\"40000\"><ExternalLoads \
                                           name=\"l\"><objects><ExternalForce name=\"push\">\
                                           <applied_to_body>{body}</applied_to_body>\
                                           <force_expressed_in_body>{body}</force_expressed_in_body>\
                                           <point_expressed_in_body>ground</point_expressed_in_body>\
                                           <force_identifier>f_v</force_identifier>\
                                           <point_identifier>f_p</point_identifier>\
                                           <torque_identifier>m_</torque_identifier></ExternalForce></objects><groups/>\
                                           <datafile>loads.mot</datafile></ExternalLoads></OpenSimDocument>"
            ),
        );
        let inner = "<time_range>0.05 \
                     0.31</time_range><forces_to_exclude>Muscles</forces_to_exclude>\
                     <external_loads_file>loads.xml</external_loads_file>\
                     <coordinates_file>motion.mot</coordinates_file>\
                     <lowpass_cutoff_frequency_for_coordinates>6</lowpass_cutoff_frequency_for_coordinates>\
                     <output_gen_force_file>id.sto</output_gen_force_file>\
                     <joints_to_report_body_forces>ALL</joints_to_report_body_forces>\
                     <output_body_forces_file>joints.sto</output_body_forces_file>";
        // Printed with 8 digits.
        let found = bench.compare("inverse dynamics", &model, &setup("InverseDynamicsTool", &model, inner), &|_| 1e-6);
        assert_eq!(found.len(), 2);
    }
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_analyses() {
    let bench = Bench::new();
    for model in models() {
        let spec = OsimFile::read(&model).unwrap().spec;
        bench.write("motion.mot", &motion(&spec, 12, 0.02));
        let body = &spec.bodies.last().unwrap().name;
        let analyses = format!(
            "<Kinematics name=\"Kinematics\"><on>true</on><step_interval>2</step_interval></Kinematics>\
             <BodyKinematics name=\"BodyKinematics\"><in_degrees>true</in_degrees></BodyKinematics>\
             <BodyKinematics name=\"Local\"><bodies>{body} \
             center_of_mass</bodies><in_degrees>false</in_degrees>\
             <express_results_in_body_local_frame>true</express_results_in_body_local_frame></BodyKinematics>\
             <PointKinematics name=\"PointKinematics\"><body_name>{body}</body_name><point_name>tip</point_name>\
             <point>0.01 -0.05 0.02</point></PointKinematics>\
             <MuscleAnalysis name=\"MuscleAnalysis\"><muscle_list>all</muscle_list>\
             <moment_arm_coordinate_list>all</moment_arm_coordinate_list><compute_moments>true</compute_moments>\
             </MuscleAnalysis>\
             <StatesReporter name=\"StatesReporter\"/><ForceReporter name=\"ForceReporter\"/><Actuation \
             name=\"Actuation\"/>\
             <JointReaction name=\"JointReaction\"><joint_names>ALL</joint_names>\
             <apply_on_bodies>child</apply_on_bodies>\
             <express_in_frame>ground</express_in_frame></JointReaction>"
        );
        let inner = format!(
            "<output_precision>{PRECISION}</output_precision><initial_time>0</initial_time><final_time>0.2</final_time>\
             <solve_for_equilibrium_for_auxiliary_states>true</solve_for_equilibrium_for_auxiliary_states>\
             <coordinates_file>motion.mot</coordinates_file>\
             <lowpass_cutoff_frequency_for_coordinates>-1</lowpass_cutoff_frequency_for_coordinates><AnalysisSet \
             name=\"Analyses\"><objects>{analyses}</objects><groups/></AnalysisSet>"
        );
        // Light bodies turn errors of forces into large accelerations.
        let tolerance = |name: &str| if hangs_on_accelerations(name) { 1e-4 } else { 1e-5 };
        bench.compare("analyses", &model, &setup("AnalyzeTool", &model, &inner), &tolerance);
    }
}

/// Static optimization stops at OpenSim's convergence criterion of 1e-4; the solution here is exact.
#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_static_optimization() {
    let bench = Bench::new();
    let model = &models()[0];
    let spec = OsimFile::read(model).unwrap().spec;
    bench.write("motion.mot", &motion(&spec, 12, 0.02));
    let reserve = |c: &carpus::osim::spec::CoordinateSpec| {
        format!(
            "<CoordinateActuator \
             name=\"reserve_{0}\"><coordinate>{0}</coordinate><optimal_force>5</optimal_force></CoordinateActuator>",
            c.name
        )
    };
    let reserves: String = spec.coordinates.iter().map(reserve).collect();
    bench.write(
        "reserves.xml",
        &format!(
            "<OpenSimDocument Version=\"40000\"><ForceSet \
                                          name=\"r\"><objects>{reserves}</objects></ForceSet></OpenSimDocument>"
        ),
    );
    let inner = "<force_set_files>reserves.xml</force_set_files><initial_time>0</initial_time>\
                 <final_time>0.2</final_time><coordinates_file>motion.mot</coordinates_file><AnalysisSet \
                 name=\"Analyses\"><objects><StaticOptimization name=\"SO\">\
                 <activation_exponent>2</activation_exponent></StaticOptimization></objects></AnalysisSet>";
    let tolerance = |name: &str| if name.contains("force") { 5e-2 } else { 2e-3 };
    let found = bench.compare("static optimization", model, &setup("AnalyzeTool", model, inner), &tolerance);
    assert_eq!(found.len(), 2);
}

/// A benchmark of MoBL-ARMS beside its results, in a folder of its own, with a model named in the setup.
fn benchmark(bench: &Bench, setup: &str, model: &str, replace: &[(&str, &str)]) -> String {
    let source = shared(&format!("benchmarks/mobl_arms/{setup}"));
    for file in std::fs::read_dir(source.parent().unwrap()).unwrap().flatten().filter(|f| f.path().is_file()) {
        std::fs::write(bench.path(&file.file_name().to_string_lossy()), std::fs::read(file.path()).unwrap()).unwrap();
    }
    let published = source.parent().unwrap().join("published_results");
    std::fs::create_dir_all(bench.path("published_results")).unwrap();
    for file in std::fs::read_dir(published).unwrap().flatten() {
        let to = bench.path("published_results").join(file.file_name());
        std::fs::write(to, std::fs::read(file.path()).unwrap()).unwrap();
    }
    let mut text = std::fs::read_to_string(source).unwrap();
    for none in ["<model_file />", "<model_file>Unassigned</model_file>"] {
        text = text.replacen(none, &format!("<model_file>{model}</model_file>"), 1);
    }
    for (from, to) in replace {
        assert!(text.contains(from), "{setup} has {from}");
        text = text.replace(from, to);
    }
    text
}

/// A fall of the shoulder, 5 s: OpenSim 4.6 run afresh, and the published result.
#[test]
#[cfg_attr(
    not(all(has_opensim, has_shared_data)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and shared recordings and setups (CARPUS_SHARED)"
)]
fn val_opensim_mobl_arms_forward() {
    let bench = Bench::new();
    let model = "MOBL_ARMS_module1_nomuscles.osim";
    let replace = [("Results-Module_1", "RESULTS")];
    let setup = benchmark(&bench, "MoBL_ARMS_module1_Setup.xml", model, &replace);
    for (name, results) in [("opensim.xml", "opensim"), ("carpus.xml", "carpus")] {
        bench.write(name, &setup.replace("RESULTS", results));
    }
    run_script(&bench.python, "scripts/run_tool.py", &[bench.path("opensim.xml").as_os_str()]);
    let outcome = run_tool(&bench.path("carpus.xml"), None, false).unwrap();
    let ours = outcome.files.iter().find(|f| f.path.ends_with("MoBL_ARMS_module1_nomuscles_states.sto")).unwrap();
    let ours = Storage::parse(&ours.bytes, &ours.path).unwrap();
    let theirs = Storage::read(bench.path("opensim/MoBL_ARMS_module1_nomuscles_states.sto")).unwrap();
    assert_eq!(theirs.labels, ours.labels);
    let shoulder = ours.labels.iter().position(|l| l.ends_with("/shoulder_elv/value")).unwrap();
    let published = Storage::read(bench.path("published_results/Comparison_results_module1shoulder.sto")).unwrap();
    let (mut afresh, mut to_published): (f64, f64) = (0.0, 0.0);
    for (time, row) in theirs.time.iter().zip(&theirs.rows) {
        afresh = afresh.max((row[shoulder] - ours.at(*time)[shoulder]).abs());
    }
    for (time, row) in published.time.iter().zip(&published.rows) {
        to_published = to_published.max((row[0].to_radians() - ours.at(*time)[shoulder]).abs());
    }
    println!("shoulder_elv over 5 s: {afresh:.1e} rad from OpenSim 4.6, {to_published:.1e} rad from the published run");
    // OpenSim integrates to 1e-5; rows are 10 ms apart and compared by straight lines.
    assert!(afresh < 3e-4 && to_published < 3e-4);
}

/// Markers of a reach, and scaling to a static trial. OpenSim's search ends early where the fit is flat: here the fit
/// has to be at least as good, and nearly the same.
#[test]
#[cfg_attr(
    not(all(has_opensim, has_shared_data)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and shared recordings and setups (CARPUS_SHARED)"
)]
fn val_opensim_mobl_arms_inverse_kinematics() {
    let bench = Bench::new();
    let model = "published_results/MoBL_ARMS_module5_scaled.osim";
    let replace = [(" 0 4.995", "0 0.05"), ("<results_directory>./", "<results_directory>RESULTS")];
    let setup = benchmark(&bench, "MoBL_ARMS_module5_IK_Setup.xml", model, &replace);
    for (name, results) in [("opensim.xml", "opensim"), ("carpus.xml", "carpus")] {
        bench.write(name, &setup.replace("RESULTS", results));
    }
    run_script(&bench.python, "scripts/run_tool.py", &[bench.path("opensim.xml").as_os_str()]);
    let outcome = run_tool(&bench.path("carpus.xml"), None, false).unwrap();
    let ours = outcome.files.iter().find(|f| f.path.ends_with("_ik_marker_errors.sto")).unwrap();
    let ours = Storage::parse(&ours.bytes, &ours.path).unwrap();
    let theirs = Storage::read(bench.path("opensim/_ik_marker_errors.sto")).unwrap();
    assert_eq!((&theirs.labels, &theirs.time), (&ours.labels, &ours.time));
    for (ours, theirs) in ours.rows.iter().zip(&theirs.rows) {
        println!("squared error {:.3e} m², OpenSim {:.3e} m²", ours[0], theirs[0]);
        assert!(ours[0] <= theirs[0] + 1e-8 && ours[1] > 0.9 * theirs[1]);
    }
}

#[test]
#[cfg_attr(
    not(all(has_opensim, has_shared_data)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and shared recordings and setups (CARPUS_SHARED)"
)]
fn val_opensim_mobl_arms_scale() {
    let bench = Bench::new();
    let setup = "MoBL_ARMS_module5_Scale_Setup.xml";
    let replace = [("<output_model_file>Unassigned", "<output_model_file>scaled.osim")];
    let text = benchmark(&bench, setup, "MOBL_ARMS_module5_scaleIK.osim", &replace);
    bench.write("scale.xml", &text);
    let outcome = run_tool(&bench.path("scale.xml"), None, false).unwrap();
    let ours = outcome.files.iter().rfind(|f| f.path.ends_with("scaled.osim")).unwrap();
    let ours = OsimFile::parse(ours.bytes.clone(), "scaled.osim").unwrap().spec;
    let theirs = OsimFile::read(bench.path("published_results/MoBL_ARMS_module5_scaled.osim")).unwrap().spec;
    assert_eq!(ours.name, theirs.name);
    for (a, b) in ours.bodies.iter().zip(&theirs.bodies) {
        assert!(
            (a.mass - b.mass).abs() < 1e-7 * b.mass.max(1e-3),
            "{}: {} kg, published {} kg",
            a.name,
            a.mass,
            b.mass
        );
    }
    for (a, b) in ours.muscles.iter().zip(&theirs.muscles) {
        let [fiber, tendon] =
            [(a.optimal_fiber_length, b.optimal_fiber_length), (a.tendon_slack_length, b.tendon_slack_length)]
                .map(|(a, b)| (a / b - 1.0).abs());
        // The published run had OpenSim 3.3's wrapping.
        assert!(fiber < 2e-3 && tendon < 2e-3, "{}: {fiber:.1e}, {tendon:.1e}", a.name);
    }
    // Markers that the static trial lacks are removed, as by OpenSim.
    assert_eq!(ours.markers.len(), theirs.markers.len());
    let mut largest: f64 = 0.0;
    for marker in &ours.markers {
        let published = theirs.markers.iter().find(|m| m.name == marker.name).unwrap();
        largest = largest.max((marker.location - published.location).norm());
    }
    println!("markers: {:.2} mm at most from the published model", 1e3 * largest);
    assert!(largest < 3e-3);
}

/// Markers of a file, one of them moved to another body, and scale factors given by hand, some of a body that there is
/// not.
#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_manual_scale_with_a_marker_set_file() {
    let bench = Bench::new();
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/wrist.osim");
    let body = OsimFile::read(&model).unwrap().spec.bodies.last().unwrap().name.clone();
    // OpenSim looks for the model beside the setup, whatever its path.
    let mut generic = OsimFile::read(&model).unwrap();
    let marker = "<Marker name=\"knuckle\"><socket_parent_frame>/ground</socket_parent_frame><location>1 2 \
                  3</location><fixed>true</fixed></Marker>";
    generic.add_component(ComponentSet::Markers, marker).unwrap();
    bench.write("generic.osim", std::str::from_utf8(generic.document.bytes()).unwrap());
    bench.write(
        "markers.xml",
        &format!(
            "<?xml version=\"1.0\"?>\n<OpenSimDocument Version=\"40000\"><MarkerSet \
                                         name=\"m\"><objects><Marker name=\"knuckle\">\
                                         <socket_parent_frame>/bodyset/{body}</socket_parent_frame>\
                                         <location>0.01 -0.07 0.02</location><fixed>false</fixed></Marker></objects>\
                                         <groups/></MarkerSet></OpenSimDocument>"
        ),
    );
    let setup = |output: &str| {
        format!(
            "<?xml version=\"1.0\"?>\n<OpenSimDocument Version=\"40000\"><ScaleTool \
             name=\"scaled\"><mass>-1</mass><GenericModelMaker><model_file>generic.osim</model_file>\
             <marker_set_file>markers.xml</marker_set_file></GenericModelMaker><ModelScaler><apply>true</apply>\
             <scaling_order>manualScale</scaling_order><ScaleSet><objects><Scale><scales>1.1 1.05 0.9</scales>\
             <segment>{body}</segment><apply>true</apply></Scale><Scale><scales>2 2 2</scales>\
             <segment>patella_r</segment><apply>true</apply></Scale></objects><groups/></ScaleSet>\
             <preserve_mass_distribution>false</preserve_mass_distribution>\
             <output_model_file>{output}</output_model_file></ModelScaler><MarkerPlacer><apply>false</apply>\
             </MarkerPlacer></ScaleTool></OpenSimDocument>"
        )
    };
    bench.write("theirs.xml", &setup("theirs.osim"));
    bench.write("ours.xml", &setup("ours.osim"));
    run_script(&bench.python, "scripts/run_tool.py", &[bench.path("theirs.xml").as_os_str()]);
    let outcome = run_tool(&bench.path("ours.xml"), None, false).unwrap_or_else(|e| panic!("{e}"));
    assert!(outcome.warnings.iter().any(|(_, _, text)| text.contains("no body `patella_r`")), "{:?}", outcome.warnings);
    let ours = outcome.files.iter().find(|f| f.path.ends_with("ours.osim")).expect("a model");
    let ours = OsimFile::parse(ours.bytes.clone(), "ours.osim").unwrap().spec;
    let theirs = OsimFile::read(bench.path("theirs.osim")).unwrap().spec;
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-7 * b.abs().max(1e-3);
    for (a, b) in ours.bodies.iter().zip(&theirs.bodies) {
        assert!(close(a.mass, b.mass) && (a.mass_center - b.mass_center).norm() < 1e-9, "{}", a.name);
        assert!((a.inertia - b.inertia).norm() <= 1e-7 * b.inertia.norm(), "{}", a.name);
    }
    for (a, b) in ours.muscles.iter().zip(&theirs.muscles) {
        assert!(close(a.optimal_fiber_length, b.optimal_fiber_length), "{}", a.name);
        assert!(close(a.tendon_slack_length, b.tendon_slack_length), "{}", a.name);
    }
    let of = |s: &ModelSpec| {
        let found: Vec<_> = s.markers.iter().filter(|m| m.name == "knuckle").collect();
        let [marker] = found[..] else { panic!("{found:?}") };
        (marker.location, s.frames[marker.frame.0].name.clone(), marker.fixed)
    };
    let ((a, body_a, fixed_a), (b, body_b, fixed_b)) = (of(&ours), of(&theirs));
    assert_eq!((body_a, fixed_a), (body_b, fixed_b));
    assert!((a - b).norm() < 1e-9, "{a} and {b}");
    assert!((a - nalgebra::Vector3::new(0.011, -0.0735, 0.018)).norm() < 1e-9);
}
