//! Raw EMG: constants, MVC levels, excitations, and what is refused.

use carpus::signals::{EmgProcessing, EnvelopeKind, MvcLevel, SavitzkyGolay};
use carpus::study::{EmgSignal, Study};
use rand::{RngExt, SeedableRng};

use super::folder::{Folder, TOML, TRIAL_HEADER, list, says};

const RATE_HZ: f64 = 1000.0;
const TRIALS: &str = "\
participant,file,contraction,effort_percent,direction,posture_deg,repetition,use
P01,data/mvc.csv,mvc,100,flexion,0,1,mvc
P01,data/mvc_weaker.csv,mvc,100,extension,0,1,mvc
P01,data/iso.csv,isometric,25,flexion,30,1,train
";

/// Noise whose strength rises and falls within a second.
fn burst(seed: u64) -> Vec<f64> {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    (0..1000).map(|i| (random.random::<f64>() - 0.5) * (0.05 + (0.00314 * f64::from(i)).sin().powi(2))).collect()
}

fn write_trial(folder: &Folder, name: &str, rate_hz: f64, moment: f64, angle: f64, emg: [&[f64]; 2]) {
    let mut text = format!("{TRIAL_HEADER}\n");
    for i in 0..emg[0].len() {
        // Rounded as instruments write it.
        text += &format!("{:.4},{angle},{moment},{},{}\n", i as f64 / rate_hz, emg[0][i], emg[1][i]);
    }
    folder.write(name, text);
}

fn scaled(x: &[f64], factor: f64) -> Vec<f64> {
    x.iter().map(|v| v * factor).collect()
}

/// A study with raw EMG: the isometric trial has 0.25 of the MVC's ECRL and 0.4 of its FCR, sample by sample.
fn raw_study(settings: &str) -> Folder {
    let folder = Folder::good();
    folder.write("study.toml", TOML.replace("kind = \"normalized\"", &format!("kind = \"raw\"\n{settings}")));
    folder.write("trials.csv", TRIALS);
    let (ecrl, fcr) = (burst(1), burst(2));
    write_trial(&folder, "data/mvc.csv", RATE_HZ, 10.0, 0.0, [&ecrl, &fcr]);
    write_trial(&folder, "data/mvc_weaker.csv", RATE_HZ, -6.0, 0.0, [&scaled(&ecrl, 0.9), &scaled(&fcr, 0.1)]);
    write_trial(&folder, "data/iso.csv", RATE_HZ, 2.5, 30.0, [&scaled(&ecrl, 0.25), &scaled(&fcr, 0.4)]);
    folder
}

fn trials(folder: &Folder) -> Vec<carpus::study::Trial> {
    let study = Study::read(folder.path("study.toml")).unwrap_or_else(|e| panic!("{e}"));
    assert!(study.warnings.is_empty(), "{}", list(&study.warnings));
    study.load_trials("P01").unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn verif_excitation_is_the_envelope_over_the_largest_of_the_mvc_trials() {
    let folder = raw_study("");
    let trials = trials(&folder);
    for (muscle, (fraction, seed)) in [(0.25, 1), (0.4, 2)].into_iter().enumerate() {
        let envelope = EmgProcessing::default().envelope(&burst(seed), RATE_HZ).expect("valid");
        let level = envelope.iter().copied().fold(0.0, f64::max);
        let peak = trials[0].excitation[muscle].iter().copied().fold(0.0, f64::max);
        assert!((peak - 1.0).abs() < 1e-12, "the MVC itself reaches 1: {peak}");
        for (i, e) in trials[2].excitation[muscle].iter().enumerate() {
            assert!((e - fraction * envelope[i] / level).abs() < 1e-9, "sample {i}");
        }
    }
    let study = Study::read_tables(folder.path("study.toml")).expect("readable");
    let one = study.trial(&study.trials[2]).expect("readable");
    assert_eq!(one.excitation, trials[2].excitation, "read alone or with the others");
}

#[test]
fn verif_every_constant_can_be_set() {
    let settings = "band_pass_hz = [20, 400]\nfilter_order = 2\nrms_window_s = 0.05\nmvc_window_s = 0.2\nresample_hz = \
                    100\n\
                    envelope = \"moving_mean_of_rectified\"\nsavitzky_golay = { order = 2, window_s = 0.03 }";
    let folder = raw_study(settings);
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    let expected = EmgProcessing {
        band_pass_hz: Some([20.0, 400.0]),
        filter_order: 2,
        envelope: EnvelopeKind::MovingMeanOfRectified,
        rms_window_s: 0.05,
        savitzky_golay: Some(SavitzkyGolay { order: 2, window_s: 0.03 }),
        mvc_level: MvcLevel::LargestMean { window_s: 0.2 },
        resample_hz: Some(100.0),
    };
    assert_eq!(study.settings.emg, EmgSignal::Raw(expected.clone()));
    let levels = study.mvc_levels("P01").expect("MVC trials").expect("raw");
    let envelope = expected.envelope(&burst(1), RATE_HZ).expect("valid");
    let mean = |w: &[f64]| w.iter().sum::<f64>() / w.len() as f64;
    let level = envelope.windows(201).map(mean).fold(0.0, f64::max);
    assert!((levels[0] / level - 1.0).abs() < 1e-9, "{levels:?} {level}");

    for (bad, line, message) in [
        ("band_pass_hz = [250, 30]", 19, "[lower, upper] in Hz"),
        ("filter_order = 2.5", 19, "1 to 20"),
        ("rms_window_s = 0", 19, "a positive number of seconds"),
        ("savitzky_golay = 3", 19, "a table { order"),
        ("savitzky_golay = { order = 3, window = 1 }", 19, "unknown key `window`"),
        ("rms_window = 0.1", 19, "unknown key `rms_window`"),
    ] {
        says(&raw_study(bad).only_error("study.toml", line), message, "");
    }
}

#[test]
fn verif_without_mvc_trials_there_is_nothing_to_normalize_by() {
    let folder = raw_study("");
    folder.write("trials.csv", TRIALS.lines().filter(|l| !l.contains("mvc")).collect::<Vec<_>>().join("\n"));
    says(&folder.only_error("trials.csv", None), "participant `P01` has no trial of contraction or use `mvc`", "");
}

#[test]
fn verif_silent_channel_slow_recording_and_unequal_steps_are_errors() {
    let folder = raw_study("");
    let (ecrl, silent) = (burst(1), vec![0.01; 1000]);
    for mvc in ["data/mvc.csv", "data/mvc_weaker.csv"] {
        write_trial(&folder, mvc, RATE_HZ, 10.0, 0.0, [&ecrl, &silent]);
    }
    let errors = folder.errors();
    assert_eq!(errors.len(), 1, "{}", list(&errors));
    says(&errors[0], "column `emg_FCR`, raw EMG: no activity in the maximum voluntary contractions", "electrode");

    let folder = raw_study("");
    write_trial(&folder, "data/iso.csv", 400.0, 2.5, 30.0, [&ecrl, &ecrl]);
    let errors = folder.errors();
    assert_eq!(errors.len(), 2, "both channels:\n{}", list(&errors));
    says(&errors[0], "column `emg_ECRL`, raw EMG: cutoff 250 Hz", "below half the sample rate");

    let folder = raw_study("");
    let text = std::fs::read_to_string(folder.path("data/iso.csv")).expect("read");
    let lines: Vec<&str> = text.lines().collect();
    folder.write("data/iso.csv", [&lines[..100], &lines[102..]].concat().join("\n"));
    says(&folder.only_error("data/iso.csv", 101), "raw EMG needs equal steps", "resample");
}

#[test]
fn verif_doubtful_channels_are_warned_of() {
    let folder = raw_study("");
    let (ecrl, fcr) = (burst(1), burst(2));
    write_trial(&folder, "data/iso.csv", RATE_HZ, 2.5, 30.0, [&scaled(&ecrl, 1.5), &fcr]);
    says(&folder.only_warning("data/iso.csv", None), "above MVC, the highest 1.50 of it", "held at 1");
    let study = folder.read().expect("readable");
    let trials = study.load_trials("P01").expect("readable");
    assert!(trials[2].excitation[0].iter().all(|e| (0.0..=1.0).contains(e)));

    let folder = raw_study("");
    write_trial(&folder, "data/iso.csv", RATE_HZ, 2.5, 30.0, [&ecrl, &vec![0.0; 1000]]);
    says(&folder.only_warning("data/iso.csv", None), "column `emg_FCR`: the channel is 0 in every sample", "");
}
