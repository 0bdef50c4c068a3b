//! Whatever a file of OpenSim's holds, reading it returns: shipped files with bytes changed, taken out, put in or cut
//! off.
//!
//! `CARPUS_FUZZ_SECONDS=3600 cargo test --release --test suite mutations` goes on for so long with every file, with
//! other changes each time; the file that was being read when a test fails is `target/mutations/` + the name of the
//! file. A text that is not done with after five minutes is a failure.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use carpus::osim::{Document, OsimFile};
use carpus::storage::{Markers, MotionCapture, Storage};
use carpus::tools::{System, run_tool};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What is put in: pieces that decide how text is read.
const PIECES: [&str; 22] = [
    "<",
    ">",
    "</",
    "/>",
    "\"",
    "&",
    "&#0;",
    "<!--",
    "]]>",
    "\0",
    "\u{ff}",
    "nan",
    "-1e999",
    "1e308",
    "0",
    "-",
    "..",
    "/ground",
    "\n",
    "\t",
    "99999999999",
    "true",
];

/// A text that is not done with for so long hangs.
const LONGEST: Duration = Duration::from_secs(300);

fn fixture(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn mutated(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..rng.random_range(1..6) {
        if out.is_empty() {
            break;
        }
        let at = rng.random_range(0..out.len());
        let to = (at + rng.random_range(1..40)).min(out.len());
        let piece = PIECES[rng.random_range(0..PIECES.len())].bytes();
        match rng.random_range(0..6) {
            0 => out[at] = rng.random(),
            1 => drop(out.drain(at..to)),
            2 => drop(out.splice(at..at, piece)),
            3 => drop(out.splice(at..to, piece)),
            4 => {
                let copy = out[at..to].to_vec();
                let elsewhere = rng.random_range(0..=out.len());
                drop(out.splice(elsewhere..elsewhere, copy));
            }
            _ if rng.random_range(0..4) == 0 => out.truncate(at),
            _ => {
                // A digit becomes another: numbers stay numbers.
                let digit = (at..out.len()).find(|i| out[*i].is_ascii_digit());
                digit.into_iter().for_each(|i| out[i] = b'0' + rng.random_range(0..10) as u8);
            }
        }
    }
    out
}

fn for_each_mutation(file: &str, n: usize, visit: impl FnMut(Vec<u8>)) {
    let bytes = std::fs::read(fixture(file)).unwrap();
    mutations_of(&bytes, file, n, visit);
}

/// Calls for changed texts of a file: `n` always the same ones, or as many as there is time for.
pub fn mutations_of(bytes: &[u8], name: &str, n: usize, mut visit: impl FnMut(Vec<u8>)) {
    let seconds = std::env::var("CARPUS_FUZZ_SECONDS").ok().map(|text| text.parse().expect("seconds"));
    let Some(seconds) = seconds else {
        let mut rng = ChaCha8Rng::seed_from_u64(bytes.len() as u64);
        return (0..n).for_each(|_| visit(mutated(bytes, &mut rng)));
    };
    let folder = fixture("target/mutations");
    std::fs::create_dir_all(&folder).unwrap();
    let place = folder.join(name.replace('/', "_"));
    let seed = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
    let (mut rng, started) = (ChaCha8Rng::seed_from_u64(seed), Instant::now());
    let (done, each_done) = channel();
    let watched = place.clone();
    std::thread::spawn(move || {
        loop {
            match each_done.recv_timeout(LONGEST) {
                Ok(()) => {}
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => {
                    eprintln!("{}: not done with after {LONGEST:?}", watched.display());
                    std::process::abort();
                }
            }
        }
    });
    let mut count = 0_usize;
    while started.elapsed() < Duration::from_secs(seconds) {
        let changed = mutated(bytes, &mut rng);
        std::fs::write(&place, &changed).unwrap();
        visit(changed);
        done.send(()).unwrap();
        count += 1;
    }
    println!("{name}: {count} texts in {seconds} s");
}

#[test]
fn verif_mutated_models_never_panic() {
    let files = [
        "fixtures/components/forces.osim",
        "fixtures/dynamics/constraints.osim",
        "fixtures/dynamics/ellipsoids.osim",
        "fixtures/multibody/joints.osim",
        "fixtures/curvature/spine.osim",
        "models/wrist.osim",
        "fixtures/upgrade/arm_20302.osim",
        "fixtures/upgrade/arm_30000.osim",
    ];
    let (mut read, mut refused) = (0, 0);
    for file in files {
        for_each_mutation(file, 120, |bytes| match OsimFile::parse(bytes, file) {
            Ok(model) => {
                read += 1;
                let _ = model.upgraded();
                if let Ok(system) = System::of_spec(Path::new(file), model.spec)
                    && let Ok(state) = system.default_state()
                {
                    let mut work = system.new_work();
                    let _ = system.evaluate(&mut work, &state, &|_| true);
                }
            }
            Err(error) => {
                refused += 1;
                assert!(!error.to_string().is_empty());
            }
        });
    }
    assert!(read > 20 && refused > 20, "{read} read, {refused} refused");
}

#[test]
fn verif_mutated_storages_and_markers_never_panic() {
    for_each_mutation("fixtures/components/states.sto", 300, |bytes| {
        let _ = Storage::parse(&bytes, Path::new("states.sto"));
        let _ = Storage::parse(&bytes, Path::new("states.mot"));
        let _ = Markers::parse(&bytes, Path::new("states.trc"));
    });
    let markers = "PathFileType\t4\t(X/Y/Z)\tm.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t\
                   OrigDataStartFrame\tOrigNumFrames\n100\t100\t2\t2\tmm\t100\t1\t2\nFrame#\tTime\ta\t\t\tb\t\t\n\t\t\
                   X1\tY1\tZ1\tX2\tY2\tZ2\n\n1\t0.0\t1\t2\t3\t4\t5\t6\n2\t0.01\t1\t2\t3\t\t\t\n";
    mutations_of(markers.as_bytes(), "markers.trc", 500, |bytes| {
        let _ = Markers::parse(&bytes, Path::new("m.trc"));
    });
}

#[test]
fn verif_mutated_motion_capture_files_never_panic() {
    let mut refused = 0;
    for name in ["float.c3d", "integer.c3d", "dec.c3d"] {
        let file = format!("fixtures/motion_capture/{name}");
        for_each_mutation(&file, 400, |bytes| refused += usize::from(MotionCapture::parse(&bytes).is_err()));
    }
    assert!(refused > 20, "{refused} refused");
}

#[test]
fn verif_mutated_files_of_forces_never_panic() {
    let model = OsimFile::read(fixture("fixtures/components/forces.osim")).unwrap();
    let mut read = 0;
    for file in ["fixtures/force_sets/forces.xml", "fixtures/force_sets/old_forces.xml"] {
        for_each_mutation(file, 240, |bytes| {
            let Ok(document) = Document::parse(bytes, file) else { return };
            if let Ok((spec, _)) = model.with_force_sets(&[document], false) {
                read += 1;
                let _ = System::of_files(Path::new("forces.osim"), &[PathBuf::from(file)], spec);
            }
        });
    }
    assert!(read > 20, "{read} read");
}

const SCALING: &str = "<OpenSimDocument Version=\"40000\">
<ScaleTool name=\"arm\">
<mass>3.1</mass><height>1.8</height><age>30</age>
<GenericModelMaker><model_file>arm.osim</model_file></GenericModelMaker>
<ModelScaler><apply>true</apply><scaling_order>measurements manualScale</scaling_order>
<MeasurementSet><objects><Measurement name=\"forearm\"><apply>true</apply>
<MarkerPairSet><objects><MarkerPair><markers>M3 M4</markers></MarkerPair></objects></MarkerPairSet>
<BodyScaleSet><objects><BodyScale name=\"lower\"><axes>X Y Z</axes></BodyScale></objects></BodyScaleSet>
</Measurement></objects></MeasurementSet>
<ScaleSet><objects><Scale><scales>1.1 1.2 0.9</scales><segment>upper</segment><apply>true</apply></Scale>\
</objects></ScaleSet>
<marker_file>markers.trc</marker_file><time_range>0 0.1</time_range>
<preserve_mass_distribution>true</preserve_mass_distribution>\
<output_model_file>scaled.osim</output_model_file></ModelScaler>
<MarkerPlacer><apply>true</apply><IKTaskSet><objects><IKMarkerTask name=\"M1\"><weight>1</weight></IKMarkerTask>
<IKCoordinateTask name=\"q2\"><weight>2</weight><value_type>manual_value</value_type>\
<value>0.3</value></IKCoordinateTask>
</objects></IKTaskSet><marker_file>markers.trc</marker_file><time_range>0 0.1</time_range>
<output_model_file>placed.osim</output_model_file></MarkerPlacer></ScaleTool></OpenSimDocument>";

const INVERSE_DYNAMICS: &str = "<OpenSimDocument Version=\"40000\">
<InverseDynamicsTool name=\"arm\"><model_file>arm.osim</model_file><time_range>0 0.15</time_range>
<forces_to_exclude>Muscles</forces_to_exclude><coordinates_file>states.sto</coordinates_file>
<lowpass_cutoff_frequency_for_coordinates>6</lowpass_cutoff_frequency_for_coordinates>
<output_gen_force_file>forces.sto</output_gen_force_file></InverseDynamicsTool></OpenSimDocument>";

/// What the setups of a folder read; paths are of `fixtures`.
const ARM: [&str; 5] = ["arm.osim", "controls.xml", "extra_actuator.xml", "states.sto", "markers.trc"];
const COMPONENTS: [&str; 6] = [
    "forces.osim",
    "states.sto",
    "forward_start.sto",
    "extra_actuators.xml",
    "extra_controls.xml",
    "extra_controls.sto",
];
const FORCE_SETS: [&str; 5] =
    ["../../models/wrist.osim", "wrist_forces.xml", "wrist_motion.sto", "../components/forces.osim", "old_forces.xml"];

#[test]
fn verif_mutated_setups_never_panic() {
    let old = ["analyze.xml", "forward.xml", "inverse_kinematics.xml", "inverse_kinematics_20201.xml"];
    old.iter().for_each(|setup| run_mutations("old_setups", &ARM, setup, None, 30));
    run_mutations("old_setups", &ARM, "scaling.xml", Some(SCALING), 60);
    run_mutations("old_setups", &ARM, "inverse_dynamics.xml", Some(INVERSE_DYNAMICS), 60);
    run_mutations("components", &COMPONENTS, "analyze.xml", None, 60);
    run_mutations("components", &COMPONENTS, "forward.xml", None, 8);
    run_mutations("components", &COMPONENTS, "controllers.xml", None, 30);
    run_mutations("force_sets", &FORCE_SETS, "optimized.xml", None, 8);
}

/// Runs changed texts of a setup, of a folder of `fixtures` unless given, among copies of what it reads; unchanged it
/// must run.
fn run_mutations(folder: &str, inputs: &[&str], setup: &str, text: Option<&str>, n: usize) {
    let root = tempfile::tempdir().unwrap();
    let (of, place) = (fixture("fixtures").join(folder), root.path().join("fixtures").join(folder));
    for name in ["../../models", "../components", "."] {
        std::fs::create_dir_all(place.join(name)).unwrap();
    }
    for name in inputs {
        std::fs::copy(of.join(name), place.join(name)).unwrap();
    }
    let bytes = text.map_or_else(|| std::fs::read(of.join(setup)).unwrap(), |text| text.as_bytes().to_vec());
    let changed = place.join("setup.xml");
    let run = |bytes: &[u8]| {
        std::fs::write(&changed, bytes).unwrap();
        run_tool(&changed, None, false)
    };
    run(&bytes).unwrap_or_else(|error| panic!("{setup}: {error}"));
    mutations_of(&bytes, &format!("fixtures/{folder}/{setup}"), n, |bytes| drop(run(&bytes)));
}

/// A number whose products overflow: decompositions of what is not finite would not end.
#[test]
fn verif_a_number_that_overflows_ends_in_an_error() {
    let text = std::fs::read_to_string(fixture("fixtures/dynamics/constraints.osim")).unwrap();
    let text = text.replacen("<translation>0 0.05 0<", "<translation>0 0.05 01e308<", 1);
    let model = OsimFile::parse(text, "constraints.osim").unwrap();
    let system = System::of_spec(Path::new("constraints.osim"), model.spec).unwrap();
    assert!(system.default_state().is_err());
}
