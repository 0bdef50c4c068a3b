//! Filters, smoothing and EMG against SciPy; checks of channels against signals with known faults.

use carpus::signals::*;
use rand::{RngExt, SeedableRng};
use serde_json::Value;

/// Largest difference from SciPy, relative to the largest value of the signal: the bar.
const SCIPY_TOLERANCE: f64 = 1e-9;

fn reference() -> Value {
    serde_json::from_str(include_str!("../../fixtures/signals/reference_signals.json")).expect("valid JSON")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

/// Largest difference relative to the largest reference value.
fn residual(ours: &[f64], reference: &[f64]) -> f64 {
    assert_eq!(ours.len(), reference.len());
    let scale = reference.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    ours.iter().zip(reference).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / scale
}

fn design(case: &Value) -> SecondOrderSections {
    let cutoffs = numbers(&case["cutoffs_hz"]);
    let band = match case["kind"].as_str().expect("a kind") {
        "bandpass" => Band::BandPass { low_hz: cutoffs[0], high_hz: cutoffs[1] },
        "lowpass" => Band::LowPass { cutoff_hz: cutoffs[0] },
        _ => Band::HighPass { cutoff_hz: cutoffs[0] },
    };
    let order = case["order"].as_u64().expect("an order") as usize;
    Butterworth { order, band }.design(number(&case["sample_rate_hz"])).expect("a valid design")
}

#[test]
fn val_scipy_butterworth_filters() {
    let mut worst = [0.0f64; 3];
    for case in reference()["filters"].as_array().expect("cases") {
        let filter = design(case);
        let x = numbers(&case["x"]);
        let rate = number(&case["sample_rate_hz"]);
        let gain: Vec<f64> = numbers(&case["frequencies_hz"]).iter().map(|f| filter.gain(*f, rate)).collect();
        let zero_phase = filter.filter_zero_phase(&x).expect("long enough");
        let residuals = [
            residual(&filter.filter(&x), &numbers(&case["forward"])),
            residual(&zero_phase, &numbers(&case["zero_phase"])),
            residual(&gain, &numbers(&case["gain"])),
        ];
        for (worst, r) in worst.iter_mut().zip(residuals) {
            assert!(r < SCIPY_TOLERANCE, "{} order {}: {residuals:?}", case["kind"], case["order"]);
            *worst = worst.max(r);
        }
    }
    println!("largest relative residuals: forward, zero phase, gain: {worst:?}");
}

#[test]
fn val_scipy_smoothing_and_interpolation() {
    let reference = &reference()["smoothing"];
    let x = numbers(&reference["x"]);
    let mut worst = 0.0f64;
    let mut check = |ours: Vec<f64>, theirs: &Value| {
        let r = residual(&ours, &numbers(theirs));
        assert!(r < SCIPY_TOLERANCE, "{r:e}");
        worst = worst.max(r);
    };
    for case in reference["savitzky_golay"].as_array().expect("cases") {
        let (order, window) = (number(&case["order"]) as usize, number(&case["window"]) as usize);
        check(savitzky_golay(&x, order, window).expect("valid"), &case["y"]);
    }
    for case in reference["moving"].as_array().expect("cases") {
        let window = number(&case["window"]) as usize;
        check(moving_mean(&x, window).expect("odd"), &case["mean"]);
        check(moving_rms(&x, window).expect("odd"), &case["rms"]);
    }
    let case = &reference["interpolation"];
    check(interpolate_linear(&numbers(&case["time"]), &x, &numbers(&case["at"])).expect("increasing"), &case["y"]);
    println!("largest relative residual {worst:.1e}");
}

#[test]
fn val_scipy_emg_envelope() {
    let case = &reference()["emg"];
    let rate = number(&case["sample_rate_hz"]);
    let envelope = EmgProcessing::default().envelope(&numbers(&case["raw"]), rate).expect("valid");
    let every = number(&case["every"]) as usize;
    let ours: Vec<f64> = envelope.iter().copied().step_by(every).collect();
    let r = residual(&ours, &numbers(&case["envelope"]));
    let peak = mvc_level(&[(&envelope, rate)], MvcLevel::Peak).expect("active");
    println!("envelope {r:.1e}, peak {:.1e}", (peak / number(&case["peak"]) - 1.0).abs());
    assert!(r < SCIPY_TOLERANCE);
    assert!((peak / number(&case["peak"]) - 1.0).abs() < SCIPY_TOLERANCE);
}

#[test]
fn verif_gain_at_cutoff_and_closed_form() {
    // Low-pass after bilinear warping: |H|² = 1 / (1 + (tan(πf/fs)/tan(πfc/fs))^(2N)).
    let (order, cutoff_hz, rate) = (5, 12.0, 200.0);
    let filter = Butterworth { order, band: Band::LowPass { cutoff_hz } }.design(rate).expect("valid");
    for f in [0.0, 3.0, 12.0, 20.0, 60.0] {
        let w = |f: f64| (std::f64::consts::PI * f / rate).tan();
        let exact = (1.0 + (w(f) / w(cutoff_hz)).powi(2 * order as i32)).recip().sqrt();
        assert!((filter.gain(f, rate) - exact).abs() < 1e-12, "{f} Hz");
    }
}

#[test]
fn verif_zero_phase_keeps_a_sinusoid_in_place() {
    let rate = 1500.0;
    let filter = Butterworth { order: 4, band: Band::BandPass { low_hz: 30.0, high_hz: 250.0 } };
    let filter = filter.design(rate).expect("valid");
    let x: Vec<f64> = (0..3000).map(|i| (2.0 * std::f64::consts::PI * 90.0 * i as f64 / rate).sin() + 2.0).collect();
    let y = filter.filter_zero_phase(&x).expect("long enough");
    let gain = filter.gain(90.0, rate).powi(2);
    for i in 1000..2000 {
        assert!((y[i] - gain * (x[i] - 2.0)).abs() < 1e-6, "sample {i}");
    }
}

#[test]
fn verif_savitzky_golay_reproduces_cubics_ends_included() {
    let x: Vec<f64> = (0..50).map(|i| f64::from(i) / 10.0).map(|t| 2.0 - t + 3.0 * t * t - 0.7 * t * t * t).collect();
    let y = savitzky_golay(&x, 3, 21).expect("valid");
    assert!(residual(&y, &x) < 1e-12);
}

#[test]
fn verif_resampling_keeps_slow_signals_and_removes_fast_ones() {
    let (from, to) = (1500.0, 100.0);
    let tone = |f: f64, rate: f64, n: usize| -> Vec<f64> {
        (0..n).map(|i| (2.0 * std::f64::consts::PI * f * i as f64 / rate).sin()).collect()
    };
    let slow = resample(&tone(2.0, from, 6001), from, to).expect("valid");
    assert_eq!(slow.len(), 401);
    let exact = tone(2.0, to, 401);
    let inner = |v: &[f64]| v[50..350].to_vec();
    assert!(residual(&inner(&slow), &inner(&exact)) < 1e-4, "{:e}", residual(&inner(&slow), &inner(&exact)));
    let fast = resample(&tone(70.0, from, 6001), from, to).expect("valid");
    assert!(inner(&fast).iter().all(|v| v.abs() < 1e-2), "would fold to 30 Hz");
    let up = resample(&[0.0, 1.0, 4.0], 1.0, 2.0).expect("valid");
    assert_eq!(up, [0.0, 0.5, 1.0, 2.5, 4.0]);
    let rate = sample_rate(&[0.0, 0.1, 0.2, 0.30001, 0.7]).expect("increasing");
    assert!((rate - 10.0).abs() < 1e-3);
}

#[test]
fn verif_odd_window_is_the_nearest() {
    for (duration, samples) in [(0.1, 151), (0.0999, 149), (1e-5, 1), (0.002, 3), (0.0026, 3)] {
        assert_eq!(odd_window(duration, 1500.0), Ok(samples), "{duration}");
    }
    assert!(matches!(odd_window(0.0, 1500.0), Err(SignalError::WindowDuration { .. })));
}

/// Sizes follow from the data, not from a quotient of two numbers that somebody wrote.
#[test]
fn verif_absurd_windows_and_rates_are_refused() {
    for (duration, rate) in [(1e9, 1500.0), (1e300, 1e300), (0.1, f64::INFINITY), (f64::NAN, 1.0)] {
        assert!(
            matches!(odd_window(duration, rate), Err(SignalError::WindowDuration { .. })),
            "{duration} s, {rate} Hz"
        );
    }
    let faster = resample(&[0.0, 1.0, 4.0], 1e-6, 1e9);
    assert_eq!(faster, Err(SignalError::NewRate { from_hz: 1e-6, to_hz: 1e9, most: 100.0 }));
    assert_eq!(resample(&[0.0, 1.0], 1.0, 100.0).map(|x| x.len()), Ok(101));
}

#[test]
fn verif_faults_of_use_are_errors_with_fields() {
    let band = |low_hz, high_hz| Butterworth { order: 4, band: Band::BandPass { low_hz, high_hz } };
    assert_eq!(
        band(30.0, 250.0).design(400.0),
        Err(SignalError::Cutoff { found_hz: 250.0, above_hz: 30.0, nyquist_hz: 200.0 })
    );
    assert!(matches!(band(250.0, 30.0).design(1500.0), Err(SignalError::Cutoff { .. })));
    assert!(matches!(band(30.0, 250.0).design(f64::NAN), Err(SignalError::SampleRate { .. })));
    let filter = band(30.0, 250.0).design(1500.0).expect("valid");
    assert_eq!(filter.filter_zero_phase(&[0.0; 27]), Err(SignalError::TooShort { found: 27, expected: 28 }));
    let mut broken = vec![0.0; 100];
    broken[7] = f64::INFINITY;
    assert!(matches!(filter.filter_zero_phase(&broken), Err(SignalError::NotFinite { index: 7, .. })));
    assert!(matches!(savitzky_golay(&[0.0; 10], 3, 4), Err(SignalError::Window { .. })));
    assert!(matches!(mvc_level(&[(&[0.0, 0.0], 100.0)], MvcLevel::Peak), Err(SignalError::NoMvc { .. })));
}

/// Two seconds of noise-like EMG at 1500 Hz.
fn clean_channel() -> Vec<f64> {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    // A sum of twelve uniform numbers is close to normal.
    let noise: Vec<f64> = (0..6000).map(|_| (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0).collect();
    let band = Band::BandPass { low_hz: 20.0, high_hz: 400.0 };
    Butterworth { order: 2, band }.design(1500.0).expect("valid").filter_zero_phase(&noise).expect("long enough")
}

#[test]
fn verif_quality_clean_channel_is_clean() {
    assert_eq!(check_channel(&clean_channel(), 1500.0, &QualityLimits::default()), []);
}

#[test]
fn verif_quality_finds_what_was_put_in() {
    let limits = QualityLimits::default();
    assert_eq!(check_channel(&[], 1500.0, &limits), [Finding::Missing]);
    assert_eq!(check_channel(&[0.2; 500], 1500.0, &limits), [Finding::Flat { value: 0.2 }]);
    assert_eq!(check_channel(&[0.0, f64::NAN], 1500.0, &limits), [Finding::NotFinite { count: 1 }]);

    let clipped: Vec<f64> = clean_channel().iter().map(|v| v.clamp(-0.3, 5.0)).collect();
    let exact = clipped.iter().filter(|v| **v == -0.3).count() as f64 / clipped.len() as f64;
    match check_channel(&clipped, 1500.0, &limits)[..] {
        [Finding::Clipped { level: -0.3, fraction }] => assert!(fraction <= exact && fraction > 0.3 * exact),
        ref other => panic!("{other:?}"),
    }

    for mains in MAINS_FREQUENCIES_HZ {
        let clean = clean_channel();
        let power = clean.iter().map(|v| v * v).sum::<f64>() / clean.len() as f64;
        // A line 0.1 Hz off its nominal frequency with a quarter of the power of the rest: a fifth of the whole.
        let amplitude = (2.0 * 0.25 * power).sqrt();
        let w = 2.0 * std::f64::consts::PI * (mains - 0.1) / 1500.0;
        let hum: Vec<f64> = clean.iter().enumerate().map(|(i, v)| v + amplitude * (w * i as f64).sin()).collect();
        match check_channel(&hum, 1500.0, &limits)[..] {
            [Finding::MainsHum { frequency_hz, fraction }] if frequency_hz == mains => {
                assert!((fraction - 0.2).abs() < 0.04, "{fraction}");
            }
            ref other => panic!("{mains} Hz: {other:?}"),
        }
    }

    assert_eq!(check_excitation(&[0.1, 1.04], &limits), None);
    let finding = check_excitation(&[0.1, 1.5, 0.2, 0.3], &limits);
    assert_eq!(finding, Some(Finding::AboveMvc { highest: 1.5, fraction: 0.25 }));
}

#[test]
fn verif_an_artefact_that_is_an_excitation_is_found() {
    let limits = QualityLimits::default();
    let clean = clean_channel();
    let effort = vec![0.5; clean.len()];
    assert_eq!(check_artefact(&clean, &effort, 1500.0, &limits), None);
    let size = clean.iter().fold(0.0, |max: f64, v| max.max(v.abs()));
    for (width, times) in [(1, 860.0), (1, 20.0), (5, 30.0)] {
        // Wherever it stands, also on drift that is larger.
        for at in [0, 2100, clean.len() - width] {
            let mut spoilt: Vec<f64> =
                clean.iter().enumerate().map(|(k, v)| v + 50.0 * size * (1e-3 * k as f64).sin()).collect();
            assert_eq!(check_artefact(&spoilt, &effort, 1500.0, &limits), None);
            spoilt[at..at + width].iter_mut().for_each(|v| *v += times * size);
            match check_artefact(&spoilt, &effort, 1500.0, &limits) {
                Some(Finding::Artefact { after_s, ratio }) => {
                    assert!((after_s - at as f64 / 1500.0).abs() <= width as f64 / 1500.0, "{after_s}");
                    assert!(ratio > times, "{ratio}: the largest of a thousand is beyond the quantile");
                }
                other => panic!("{width} {times} {at}: {other:?}"),
            }
            // A single motor unit in silence stands out as far, and excites nothing.
            assert_eq!(check_artefact(&spoilt, &vec![0.05; clean.len()], 1500.0, &limits), None);
        }
    }
}
