//! A case as bytes, and what is made of bytes that are none.

use carpus_osim::osim::OsimFile;
use carpus_simulation::simulation::{MusculoskeletalModel, Setup};
use carpus_study::study::{Contraction, Direction, MomentPart, ParameterBounds, Trial, TrialInfo, TrialUse};
use carpus_web::case::{CASE_SCHEMA, Case, EffectOfCase, Header, SetupOfCase, TrialOfCase, three};
use carpus_web::workbench::{Workbench, WorkbenchError};

fn case() -> Case {
    let model = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/wrist.osim")).unwrap();
    let trial = |place: usize, usage: TrialUse| {
        let info = TrialInfo { place, ..TrialInfo::example(Contraction::Isotonic, Direction::Flexion, usage) };
        let time: Vec<f64> = (0..120).map(|k| 0.01 * f64::from(k)).collect();
        let angle: Vec<f64> = time.iter().map(|t| 0.4 * (3.0 * t).sin()).collect();
        let excitation = vec![vec![0.05; 120], time.iter().map(|t| 0.3 + 0.2 * (5.0 * t).sin()).collect()];
        Trial::from_samples(info, time, angle.clone(), angle, excitation)
    };
    let trials = vec![trial(0, TrialUse::Train), trial(1, TrialUse::Test)];
    let setup = Setup {
        coordinate: "flexion".to_owned(),
        posture: Vec::new(),
        active_muscles: vec!["ECRB".to_owned(), "FCR".to_owned()],
        parts: vec![MomentPart::Muscles, MomentPart::Passive],
        dynamometer_damping: 0.1,
        allow_unsupported: false,
    };
    let header = Header {
        schema: CASE_SCHEMA.to_owned(),
        study: "a \u{202e} study".to_owned(),
        participant: "P01".to_owned(),
        model_bytes: model.len(),
        geometry_bytes: 3,
        setup: SetupOfCase::of(&setup),
        bounds: ParameterBounds::default(),
        mvc: 10.0,
        seed: 1,
        own_effects: Vec::new(),
        side_car: String::new(),
        images: Vec::new(),
        plain: false,
        averaged: false,
        trials: trials.iter().map(TrialOfCase::of).collect(),
        states: Vec::new(),
    };
    Case { header, model, trials, geometry: vec![1, 2, 3] }
}

#[test]
fn verif_a_case_comes_back_to_the_last_bit() {
    let given = case();
    let read = Case::parse(&given.to_bytes()).unwrap();
    assert_eq!((&read.header, &read.model, &read.geometry), (&given.header, &given.model, &given.geometry));
    for (a, b) in read.trials.iter().zip(&given.trials) {
        assert_eq!((&a.time, &a.angle, &a.moment, &a.excitation), (&b.time, &b.angle, &b.moment, &b.excitation));
        assert_eq!((a.info.usage, a.info.place, &a.info.name), (b.info.usage, b.info.place, &b.info.name));
    }
}

#[test]
fn verif_bytes_that_end_early_are_refused() {
    let bytes = case().to_bytes();
    for end in (0..bytes.len()).step_by(97).chain([bytes.len() - 1]) {
        assert!(Case::parse(&bytes[..end]).is_err(), "{end} of {}", bytes.len());
    }
    let mut other = bytes.clone();
    let at = other.windows(CASE_SCHEMA.len()).position(|w| w == CASE_SCHEMA.as_bytes()).unwrap();
    other[at + CASE_SCHEMA.len() - 1] = b'9';
    assert!(Case::parse(&other).unwrap_err().to_string().contains("carpus.case/9"));
}

#[test]
fn verif_a_workbench_simulates_and_writes_as_the_program() {
    let given = case();
    let bench = Workbench::open(&given.to_bytes()).unwrap();
    let spec = OsimFile::parse(given.model.clone(), "model.osim").unwrap().spec;
    let model = MusculoskeletalModel::compile(&spec, &given.header.setup.setup()).unwrap();
    let nominal = model.nominal_parameters();
    let values: Vec<[f64; 3]> = nominal.iter().map(three).collect();
    let muscles = bench.parameters(&values).unwrap();
    assert_eq!(muscles, nominal);
    // Nothing changed: the file stays as it is, to the byte.
    let exported = bench.export(&muscles, &[]).unwrap();
    assert_eq!((exported.model, exported.side_car), (given.model.clone(), None));
    let as_given = bench.simulate(&muscles, &[]).unwrap();
    let spring = EffectOfCase { id: "joint_stiffness".into(), values: vec![1.0, 0.0], intervals: Vec::new() };
    let with = bench.simulate(&muscles, &bench.settings(std::slice::from_ref(&spring)).unwrap()).unwrap();
    for (trial, (a, b)) in given.trials.iter().zip(as_given.moments.iter().zip(&with.moments)) {
        for (k, angle) in trial.angle.iter().enumerate() {
            assert!((b[k] - a[k] + angle).abs() < 1e-9, "a spring of 1 N·m/rad about 0");
        }
    }
    let refused = |effects: &[EffectOfCase]| bench.settings(effects).unwrap_err();
    let unknown = EffectOfCase { id: "none".into(), ..spring.clone() };
    let short = EffectOfCase { values: vec![1.0], ..spring };
    assert!(matches!(refused(&[unknown]), WorkbenchError::Effect { expected: 0, .. }));
    assert!(matches!(refused(&[short]), WorkbenchError::Effect { expected: 2, found: 1, .. }));
    assert!(matches!(bench.parameters(&values[..1]), Err(WorkbenchError::Muscles { expected: 2, found: 1 })));
}
