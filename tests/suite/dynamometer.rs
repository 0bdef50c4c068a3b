//! Dynamometer recordings: drag with its interval, passive curve, repetitions, two recorders; against statsmodels,
//! SciPy, closed forms, and through the program.

use std::f64::consts::PI;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use carpus::dynamometer::*;
use carpus::study::Study;
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

/// Largest relative difference from statsmodels, SciPy and NumPy.
const REFERENCE_TOLERANCE: f64 = 1e-9;

fn reference() -> Value {
    serde_json::from_str(include_str!("../../fixtures/dynamometer/reference_dynamometer.json")).expect("valid JSON")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
}

fn close(ours: &[f64], theirs: &[f64], what: &str) {
    assert_eq!(ours.len(), theirs.len(), "{what}");
    let scale = theirs.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let worst = ours.iter().zip(theirs).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / scale;
    println!("{what}: largest relative difference {worst:e}");
    assert!(worst < REFERENCE_TOLERANCE, "{what}: {worst:e}");
}

/// Standard normal numbers (a sum of twelve uniform ones).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

#[test]
fn val_statsmodels_clustered_regression() {
    let reference = &reference()["regression"];
    let rows: Vec<Vec<f64>> = reference["x"].as_array().unwrap().iter().map(numbers).collect();
    let design = DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j]);
    let cluster: Vec<usize> = numbers(&reference["cluster"]).iter().map(|c| *c as usize).collect();
    let fit = clustered_regression(&design, &numbers(&reference["y"]), &cluster).expect("full rank");
    close(&fit.coefficients, &numbers(&reference["coefficients"]), "coefficients");
    close(&fit.standard_errors, &numbers(&reference["standard_errors"]), "standard errors");
    let intervals: Vec<f64> = (0..3).flat_map(|k| fit.interval(k, 0.95)).collect();
    let theirs: Vec<f64> = reference["interval"].as_array().unwrap().iter().flat_map(numbers).collect();
    close(&intervals, &theirs, "intervals");
    close(&[fit.r_squared], &[reference["r_squared"].as_f64().unwrap()], "R²");
    close(&[fit.residual], &[reference["residual"].as_f64().unwrap()], "residual");
}

#[test]
fn val_numpy_passive_curve_and_derivative() {
    let reference = reference();
    let passive = &reference["passive"];
    let [angle, velocity, moment] = ["angle", "velocity", "moment"].map(|name| numbers(&passive[name]));
    let run = PassiveRun { angle: &angle, velocity: &velocity, moment: &moment };
    let order = passive["order"].as_u64().unwrap() as usize;
    let curve = fit_passive(&[run], order).expect("moving");
    close(&[curve.damping], &[passive["damping"].as_f64().unwrap()], "damping");
    let values: Vec<f64> = numbers(&passive["at"]).iter().map(|q| curve.moment(*q, 0.0)).collect();
    close(&values, &numbers(&passive["value"]), "curve");
    assert!((curve.moment(0.0, 0.7) - curve.moment(0.0, 0.0) + 0.7 * curve.damping).abs() < 1e-12);
    assert!(curve.speed > 0.9 && curve.speed < 0.95 && !curve.drives_the_machine(), "{curve:?}");
    assert_eq!(curve.moment(0.0, 9.0), curve.moment(0.0, curve.speed), "speeds that were not recorded");
    let turned: Vec<f64> = moment.iter().map(|m| -m).collect();
    let turned = fit_passive(&[PassiveRun { moment: &turned, ..run }], order).expect("moving");
    assert!(turned.drives_the_machine(), "moment and angle disagree about what is positive");
    assert_eq!(curve.moment(9.0, 0.0), curve.moment(curve.range[1], 0.0), "the nearest value holds beyond");
    let d = &reference["derivative"];
    close(&derivative(&numbers(&d["time"]), &numbers(&d["x"])), &numbers(&d["y"]), "derivative");
}

/// A recording of a machine that goes back and forth at a constant speed.
struct Machine {
    time: Vec<f64>,
    angle: Vec<f64>,
    moment: Vec<f64>,
}

const DRAG: f64 = 0.3; // N·m·s/rad
const FRICTION: f64 = 0.12;

/// `noise`: standard deviation of noise that is correlated over 0.1 s.
fn machine(speed: f64, noise: f64, rng: &mut ChaCha8Rng) -> Machine {
    let (step, half) = (0.005, 0.6);
    let quarter = half / speed;
    let mut run = Machine { time: Vec::new(), angle: Vec::new(), moment: Vec::new() };
    let mut error = 0.0;
    for i in 0..(8.0 * quarter / step) as usize {
        let t = i as f64 * step;
        let phase = (t / quarter) % 4.0;
        let (q, v) = if phase < 2.0 { (half * (phase - 1.0), speed) } else { (half * (3.0 - phase), -speed) };
        error = 0.95 * error + (1.0f64 - 0.95 * 0.95).sqrt() * noise * normal(rng);
        run.time.push(t);
        run.angle.push(q);
        run.moment.push(-DRAG * v - FRICTION * v.signum() + 0.4 + 0.9 * q.cos() - 0.2 * q.sin() + error);
    }
    run
}

fn estimate(runs: &[Machine]) -> Result<DragEstimate, DragError> {
    let borrowed: Vec<MachineRun<'_>> =
        runs.iter().map(|r| MachineRun { time: &r.time, angle: &r.angle, velocity: None, moment: &r.moment }).collect();
    estimate_drag(&borrowed)
}

#[test]
fn verif_drag_is_found_exactly_without_noise() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let runs: Vec<Machine> = [0.5, 1.0, 2.0].map(|speed| machine(speed, 0.0, &mut rng)).into();
    let found = estimate(&runs).expect("three speeds");
    assert!((found.damping - DRAG).abs() < 1e-9, "{found:?}");
    assert!((found.friction.unwrap().0 - FRICTION).abs() < 1e-9);
    assert!((found.weight[1] + 0.2).abs() < 1e-9);
    assert_eq!(found.phases.len(), 3 * 4);
    // One speed: friction cannot be told from drag, and it is said.
    let found = estimate(&runs[..1]).expect("two directions");
    assert!(found.friction.is_none());
    assert!((found.damping - DRAG - FRICTION / 0.5).abs() < 1e-9);
    let standing =
        Machine { time: runs[0].time.clone(), angle: vec![0.1; runs[0].time.len()], moment: runs[0].moment.clone() };
    assert_eq!(estimate(&[standing]), Err(DragError::NoPhase));
}

/// The interval of the drag contains the truth about as often as it says, although the noise is correlated.
#[test]
fn verif_interval_of_the_drag_is_honest() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let studies = 200;
    let mut covered = 0;
    for _ in 0..studies {
        let runs: Vec<Machine> = [0.4, 0.8, 1.2, 1.6, 2.0].map(|speed| machine(speed, 0.05, &mut rng)).into();
        let [low, high] = estimate(&runs).expect("five speeds").interval;
        covered += usize::from((low..=high).contains(&DRAG));
    }
    println!("95 % intervals that contain the drag: {covered} of {studies}");
    assert!((178..=199).contains(&covered), "{covered} of {studies}");
}

#[test]
fn verif_repetitions_are_found_in_noise() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let time: Vec<f64> = (0..3000).map(|i| 0.01 * f64::from(i)).collect();
    // Five efforts of 2 s every 6 s on a resting moment of −1.5, alternating in direction.
    let effort = |t: f64| {
        let phase = t % 6.0;
        let inside = (2.0..4.0).contains(&phase);
        if inside {
            (PI * (phase - 2.0) / 2.0).sin().powf(0.3) * if (t / 6.0) as i32 % 2 == 0 { 5.0 } else { -4.0 }
        } else {
            0.0
        }
    };
    let moment: Vec<f64> = time.iter().map(|t| -1.5 + effort(*t) + 0.15 * normal(&mut rng)).collect();
    let settings = RepetitionSettings {
        signal: RepetitionSignal::Moment,
        threshold: 0.2,
        min_duration: 0.5,
        max_pause: 0.3,
        margin: 0.25,
    };
    let found = find_repetitions(&time, &moment, &settings);
    assert_eq!(found.len(), 5, "{found:?}");
    for (i, range) in found.iter().enumerate() {
        let start = 6.0 * i as f64 + 2.0 - 0.25;
        assert!((time[range.start] - start).abs() < 0.1, "{i}: {}", time[range.start]);
        assert!((time[range.end - 1] - start - 2.5).abs() < 0.15, "{i}: {}", time[range.end - 1]);
    }
    assert!(found.windows(2).all(|pair| pair[0].end <= pair[1].start));
    // Movements: every direction is one.
    let velocity: Vec<f64> = time.iter().map(|t| (2.0 * PI * t / 5.0).sin() + 0.02 * normal(&mut rng)).collect();
    let settings = RepetitionSettings { signal: RepetitionSignal::Movement, ..settings };
    assert_eq!(find_repetitions(&time, &velocity, &settings).len(), 12);
    assert!(find_repetitions(&time, &[0.0; 3000], &settings).is_empty());
}

/// A smooth signal without period.
fn quantity(t: f64) -> f64 {
    (1.3 * t).sin()
        + 0.6 * (2.9 * t + 0.4).sin()
        + 0.3 * (7.1 * t).sin()
        + if (4.0..5.0).contains(&t) { 1.0 - (PI * (t - 4.5) * 2.0).cos().abs() } else { 0.0 }
}

#[test]
fn verif_two_recorders_are_aligned_to_a_fraction_of_a_sample() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for (delay, noise, tolerance) in
        [(0.0, 0.0, 2e-5), (0.73137, 0.0, 2e-5), (-1.20419, 0.0, 2e-5), (0.73137, 0.05, 1e-3)]
    {
        let first: Vec<f64> = (0..1000).map(|i| 0.01 * f64::from(i)).collect();
        let second: Vec<f64> = (0..14000).map(|i| f64::from(i) / 1500.0).collect();
        let x: Vec<f64> = first.iter().map(|t| quantity(*t) + noise * normal(&mut rng)).collect();
        // The second clock reads t − delay, in volts.
        let y: Vec<f64> =
            second.iter().map(|t| 0.2 * quantity(t + delay) - 3.0 + 0.2 * noise * normal(&mut rng)).collect();
        let found = align((&first, &x), (&second, &y), 2.0).expect("overlap");
        println!(
            "delay {delay} s, noise {noise}: off by {:e} s, correlation {}",
            found.shift - delay,
            found.correlation
        );
        assert!((found.shift - delay).abs() < tolerance, "{found:?}");
        assert!(found.correlation > if noise > 0.0 { 0.97 } else { 0.9999 });
    }
    let time: Vec<f64> = (0..500).map(|i| 0.01 * f64::from(i)).collect();
    let x: Vec<f64> = time.iter().map(|t| quantity(*t)).collect();
    assert_eq!(align((&time, &x), (&time, &vec![1.0; 500]), 1.0), Err(AlignmentError::Flat));
    let later: Vec<f64> = time.iter().map(|t| t + 100.0).collect();
    assert!(matches!(align((&time, &x), (&later, &x), 1.0), Err(AlignmentError::NoOverlap { .. })));
}

/// Two clocks in different units, or lags longer than both recordings, take no more memory than the recordings.
#[test]
fn verif_recorders_of_absurd_steps_are_refused() {
    let time = |step: f64| -> Vec<f64> { (0..500).map(|k| f64::from(k) * step).collect() };
    let values: Vec<f64> = time(0.01).into_iter().map(quantity).collect();
    let (slow, fast) = (time(0.01), time(1e-8));
    let error = align((&slow, &values), (&fast, &values), 2.0).unwrap_err();
    assert!(matches!(error, AlignmentError::Steps { .. }), "{error}");
    let same = align((&slow, &values), (&slow, &values), 1e12).unwrap();
    assert!(same.shift.abs() < 1e-6, "{same:?}");
}

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn carpus(arguments: &[&std::ffi::OsStr]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("carpus").expect("the program").args(arguments).assert()
}

/// A study of one or more recordings.
fn study(folder: &Path, processing: &str, trials: &str) -> PathBuf {
    std::fs::copy(root("models/wrist.osim"), folder.join("wrist.osim")).unwrap();
    let toml = format!(
        "[study]\nname = \"recorded\"\nmodel = \"wrist.osim\"\n\n[dynamometer]\ncoordinate \
         = \"flexion\"\ndamping_n_m_s_per_deg = 0.005\n\n[posture_deg]\nelbow_flexion = 90\n\n[muscles]\nactive = \
         [\"FCR\"]\n\n{processing}"
    );
    std::fs::write(folder.join("study.toml"), toml).unwrap();
    std::fs::write(folder.join("participants.csv"), "participant,mass_kg\nP01,70\n").unwrap();
    std::fs::write(
        folder.join("trials.csv"),
        format!("participant,file,contraction,effort_percent,direction\n{trials}"),
    )
    .unwrap();
    folder.join("study.toml")
}

fn columns(path: &Path, names: &[&str]) -> Vec<Vec<f64>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header = reader.headers().unwrap().clone();
    let at: Vec<usize> = names.iter().map(|name| header.iter().position(|h| h == *name).expect("column")).collect();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    at.iter().map(|i| rows.iter().map(|row| row[*i].parse().unwrap()).collect()).collect()
}

#[test]
fn val_scipy_processed_trial_through_the_program() {
    let reference = &reference()["trial"];
    let folder = tempfile::tempdir().unwrap();
    let [time, angle, moment] = ["time", "angle_deg", "moment_n_m"].map(|name| numbers(&reference[name]));
    let mut text = "time_s,angle_deg,moment_n_m,emg_FCR\n".to_owned();
    (0..time.len()).for_each(|i| writeln!(text, "{},{},{},0.3", time[i], angle[i], moment[i]).unwrap());
    std::fs::write(folder.path().join("a.csv"), text).unwrap();
    let study = study(
        folder.path(),
        "[processing]\nfilter_hz = 6\nfilter_order = 4\nremove_drag = true\n",
        "P01,a.csv,isotonic,25,flexion\n",
    );
    let out = folder.path().join("out");
    carpus(&["dynamometer".as_ref(), study.as_ref(), "--out".as_ref(), out.as_ref()]).success();
    let found = columns(&out.join("data/P01/a.csv"), &["angle_deg", "velocity_deg_per_s", "moment_n_m", "emg_FCR"]);
    for (ours, name) in found.iter().zip(["angle_deg", "velocity_deg_per_s", "moment_n_m"]) {
        close(ours, &numbers(&reference[format!("processed_{name}")]), name);
    }
    assert!(found[3].iter().all(|e| *e == 0.3), "EMG is left alone");
    // The new study reads, and has nothing left to remove.
    let new = Study::read(out.join("study.toml")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(new.settings.dynamometer.damping, 0.0);
    assert_eq!(new.settings.posture.len(), 1);
    assert_eq!(new.settings.processing, Default::default());
}

/// A long recording with known parts: the relaxed limb, four efforts, and EMG on another clock.
#[test]
fn verif_a_recorded_session_becomes_a_study() {
    let folder = tempfile::tempdir().unwrap();
    let drag = 0.005; // N·m·s/deg
    let relaxed = |q: f64| 0.3 + 0.02 * q + 1e-5 * q.powi(3); // q in degrees
    let mut passive = "time_s,angle_deg,velocity_deg_per_s,moment_n_m\n".to_owned();
    let mut session = passive.clone();
    let mut emg = "t,volts,emg_FCR\n".to_owned();
    let angle = |t: f64| [40.0 * (0.5 * t).sin(), 20.0 * (0.5 * t).cos()];
    let effort =
        |t: f64| if (2.0..4.0).contains(&(t % 6.0)) { 3.0 * (PI * ((t % 6.0) - 2.0) / 2.0).sin().powi(2) } else { 0.0 };
    let measured = |t: f64| effort(t) + relaxed(angle(t)[0]) - drag * angle(t)[1];
    for i in 0..2400 {
        let t = 0.01 * f64::from(i);
        let [q, v] = angle(t);
        writeln!(passive, "{t},{q},{v},{}", relaxed(q) - drag * v).unwrap();
        writeln!(session, "{t},{q},{v},{}", measured(t)).unwrap();
    }
    let delay = 0.4137;
    for i in 0..23000 {
        let t = f64::from(i) / 1000.0;
        // The second clock reads 0.4137 s less.
        writeln!(emg, "{t},{},{}", 0.5 * measured(t + delay) + 1.0, 0.2 * effort(t + delay)).unwrap();
    }
    std::fs::write(folder.path().join("passive.csv"), &passive).unwrap();
    std::fs::write(folder.path().join("session.csv"), session).unwrap();
    std::fs::write(folder.path().join("session_emg.csv"), &emg).unwrap();
    // The passive recording has EMG as well: nothing but zeros after the same clock.
    let mut silent = "t,volts,emg_FCR\n".to_owned();
    for i in 0..23000 {
        let t = f64::from(i) / 1000.0;
        let [q, v] = angle(t + delay);
        writeln!(silent, "{t},{},0", relaxed(q) - drag * v).unwrap();
    }
    std::fs::write(folder.path().join("passive_emg.csv"), silent).unwrap();
    let processing = "[processing]\nremove_drag = true\nsubtract_passive = true\npassive_order = \
                      3\n[processing.repetitions]\nthreshold = 0.1\ncontractions = \
                      [\"isotonic\"]\n[emg_recorder]\nfile = \"{trial}_emg.csv\"\ntime = \"t\"\nshared \
                      = \"volts\"\nshared_with = \"moment_n_m\"\n";
    let trials = "P01,passive.csv,passive,,none\nP01,session.csv,isotonic,25,flexion\n";
    let study = study(folder.path(), processing, trials);
    let out = folder.path().join("out");
    carpus(&["dynamometer".as_ref(), study.as_ref(), "--out".as_ref(), out.as_ref()]).success();
    let text = std::fs::read_to_string(out.join("dynamometer.json")).unwrap();
    let results: Value = serde_json::from_str(&text).unwrap();
    let trials = results["participants"][0]["trials"].as_array().unwrap();
    assert_eq!(trials.len(), 1 + 4, "{text}");
    for trial in trials {
        let shift = trial["second_recorder"]["shift_s"].as_f64().unwrap();
        assert!((shift - delay).abs() < 1e-4, "{trial}");
    }
    // What is left of the moment is the effort, at the EMG's instants.
    for repetition in 1..=4 {
        let names = ["time_s", "moment_n_m", "emg_FCR"];
        let found = columns(&out.join(format!("data/P01/session_{repetition}.csv")), &names);
        let effort_in = found[0].iter().map(|t| effort(*t)).fold(0.0, f64::max);
        assert!(effort_in > 2.9, "repetition {repetition}");
        for i in 0..found[0].len() {
            let expected = effort(found[0][i]);
            // Linear between the dynamometer's samples, 10 ms apart: 3/8·π²·h² at most.
            assert!((found[1][i] - expected).abs() < 5e-4, "{repetition}, {i}: {} {expected}", found[1][i]);
            assert!((found[2][i] - 0.2 * expected).abs() < 1e-4, "{repetition}, {i}");
        }
    }
    let new = Study::read(out.join("study.toml")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(new.trials_of("P01").count(), 4, "the passive recording is kept and ignored");
    let include: Vec<_> = new.settings.dynamometer.include.iter().map(|part| format!("{part:?}")).collect();
    assert_eq!(include, ["Muscles"]);
    assert!(std::fs::read_to_string(out.join("reports/P01.html")).unwrap().contains("<polyline"));
}

#[test]
fn verif_drag_through_the_program() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for (i, speed) in [0.5, 1.0, 1.5].into_iter().enumerate() {
        let run = machine(speed, 0.02, &mut rng);
        let mut text = "time_s,angle_deg,moment_n_m\n".to_owned();
        (0..run.time.len())
            .for_each(|k| writeln!(text, "{},{},{}", run.time[k], run.angle[k].to_degrees(), run.moment[k]).unwrap());
        let name = format!("run_{i}.csv");
        std::fs::write(folder.path().join(&name), text).unwrap();
        files.push(name);
    }
    let per_degree = DRAG.to_radians();
    let check = |inputs: &[PathBuf]| {
        let mut arguments: Vec<&std::ffi::OsStr> = vec!["dynamometer-drag".as_ref(), "--json".as_ref()];
        arguments.extend(inputs.iter().map(|path| path.as_os_str()));
        let done = carpus(&arguments).success();
        let found: Value = serde_json::from_slice(&done.get_output().stdout).unwrap();
        let [low, high] = [0, 1].map(|i| found["interval_95_n_m_s_per_deg"][i].as_f64().unwrap());
        assert!(low < per_degree && per_degree < high && high - low < 0.5 * per_degree, "{found}");
        found["damping_n_m_s_per_deg"].as_f64().unwrap()
    };
    let paths: Vec<PathBuf> = files.iter().map(|name| folder.path().join(name)).collect();
    let of_files = check(&paths);
    std::fs::write(folder.path().join("t.csv"), "").unwrap();
    let study =
        study(folder.path(), &format!("[processing]\ndrag_runs = {files:?}\n"), "P01,t.csv,isotonic,25,flexion\n");
    assert_eq!(of_files, check(&[study]));
    let says = |inputs: &[&Path], words: &[&str]| {
        let mut arguments: Vec<&std::ffi::OsStr> = vec!["dynamometer-drag".as_ref()];
        arguments.extend(inputs.iter().map(|path| path.as_os_str()));
        let text = String::from_utf8(carpus(&arguments).code(1).get_output().stderr.clone()).unwrap();
        words.iter().for_each(|word| assert!(text.contains(word), "expected `{word}` in:\n{text}"));
    };
    says(&[Path::new("nowhere.csv")], &["nowhere.csv", "not found"]);
    std::fs::write(folder.path().join("bad.csv"), "time_s,angle_deg,moment_n_m\n0,1,x\n").unwrap();
    says(&[&folder.path().join("bad.csv")], &["bad.csv:2", "moment_n_m", "a number"]);
}

#[test]
fn verif_one_passive_curve_is_not_subtracted_in_several_postures() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = "time_s,angle_deg,velocity_deg_per_s,moment_n_m,emg_FCR\n".to_owned();
    for i in 0..1200 {
        let t = 0.01 * f64::from(i);
        let [q, v] = [30.0 * (0.9 * t).sin(), 27.0 * (0.9 * t).cos()];
        // As the machine reads it: the relaxed limb, less the drag.
        writeln!(text, "{t},{q},{v},{},0.1", -0.01 * q - 0.005 * v).unwrap();
    }
    ["a.csv", "b.csv"].iter().for_each(|name| std::fs::write(folder.path().join(name), &text).unwrap());
    let processed = |processing: &str, of_passive: &str, of_moving: &str| {
        let study = study(folder.path(), processing, "");
        let header = "participant,file,contraction,effort_percent,direction,posture_elbow_flexion_deg";
        let rows = format!("P01,a.csv,passive,,none,{of_passive}\nP01,b.csv,isotonic,25,flexion,{of_moving}\n");
        std::fs::write(folder.path().join("trials.csv"), format!("{header}\n{rows}")).unwrap();
        let out = tempfile::tempdir().unwrap();
        carpus(&["dynamometer".as_ref(), study.as_ref(), "--out".as_ref(), out.path().join("out").as_ref()])
    };
    let subtract = "[processing]\nremove_drag = true\nsubtract_passive = true\npassive_order = 1\n";
    for (of_passive, of_moving) in [("90", "45"), ("", "45"), ("45", "")] {
        let failed = processed(subtract, of_passive, of_moving).code(1);
        let said = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        for words in ["trials.csv:3", "not held as in line 2", "leave out subtract_passive"] {
            assert!(said.contains(words), "expected `{words}` in:\n{said}");
        }
    }
    // The same posture, written or that of study.toml; and several where nothing is subtracted.
    processed(subtract, "45", "45").success();
    processed(subtract, "", "90").success();
    processed("[processing]\nremove_drag = true\n", "90", "45").success();
}

#[test]
fn verif_bad_processing_is_explained() {
    let refused = |processing: &str, words: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        let mut text = "time_s,angle_deg,moment_n_m,emg_FCR\n".to_owned();
        (0..200).for_each(|i| writeln!(text, "{},{},1,0.1", 0.01 * f64::from(i), i % 7).unwrap());
        std::fs::write(folder.path().join("a.csv"), text).unwrap();
        let study = study(folder.path(), processing, "P01,a.csv,isotonic,25,flexion\n");
        let out = folder.path().join("out");
        let failed = carpus(&["dynamometer".as_ref(), study.as_ref(), "--out".as_ref(), out.as_ref()]).code(1);
        let text = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        words.iter().for_each(|word| assert!(text.contains(word), "expected `{word}` in:\n{text}"));
    };
    refused("", &["no [processing]", "filter_hz"]);
    refused("[processing]\nfilter = 6\n", &["study.toml:", "unknown", "filter_hz"]);
    refused("[processing]\nfilter_hz = 80\n", &["a.csv", "80 Hz"]);
    refused("[processing]\nfilter_hz = 1e-9\n", &["study.toml:", "filter_hz", "0.1 to 1000"]);
    refused("[processing]\nsubtract_passive = true\n", &["P01", "no passive trial", "contraction passive"]);
    refused("[processing.repetitions]\nby = \"torque\"\n", &["study.toml:", "movement"]);
    refused("[processing.repetitions]\nmin_duration_s = 50\n", &["a.csv", "no repetition found", "min_duration_s"]);
    refused(
        "[emg_recorder]\nfile = \"emg.csv\"\nshared = \"v\"\nshared_with = \"moment_n_m\"\n",
        &["study.toml:", "{trial}"],
    );
    refused(
        "[emg_recorder]\nfile = \"{trial}_x.csv\"\nshared = \"v\"\nshared_with = \"moment_n_m\"\n",
        &["a_x.csv", "not found"],
    );
}
