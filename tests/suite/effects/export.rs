//! Effects written into a model file and read again.

use std::path::Path;

use carpus::effects::export::{self, SideCar};
use carpus::effects::forward_model::Setting;
use carpus::study::MomentPart;

use super::*;

fn setup() -> Setup {
    let mut setup = Setup::from_settings(&study().0.settings);
    setup.parts = vec![MomentPart::Muscles, MomentPart::Passive, MomentPart::Inertia];
    setup
}

#[test]
fn verif_every_effect_goes_where_its_description_says() {
    let (_, file, _) = study();
    for effect in CATALOGUE.iter().copied() {
        let d = effect.description();
        let mut copy = file.clone();
        let report = export::write(&mut copy, &setup(), &[sized(effect, 1.0)]).unwrap_or_else(|e| panic!("{e}"));
        let native = matches!(d.osim_form, carpus::effects::effect::OsimForm::Native(_));
        assert_eq!(
            (report.native.len(), report.side_car.effects.len()),
            if native { (1, 0) } else { (0, 1) },
            "{}",
            d.id
        );
        assert_eq!(report.reasons.len(), report.side_car.effects.len());
        assert_eq!(copy.document.bytes() != file.document.bytes(), native, "{}", d.id);
    }
}

#[test]
fn verif_absent_effects_leave_the_file_as_it_is() {
    let (_, file, _) = study();
    let mut copy = file.clone();
    let absent: Vec<Setting> = CATALOGUE.iter().map(|e| Setting::absent(*e)).collect();
    let report = export::write(&mut copy, &setup(), &absent).unwrap();
    assert!(report.native.is_empty() && report.side_car.effects.is_empty());
    assert_eq!(copy.document.bytes(), file.document.bytes());
}

#[test]
fn verif_model_and_side_car_together_simulate_as_the_effects() {
    /// Passive forces are tabulated to 1e-5 N·m; formulas are computed.
    const TOLERANCE: f64 = 2e-5;
    let (study, file, _) = study();
    let setup = setup();
    let info: Vec<_> =
        TRIALS.iter().map(|stem| study.trials_of("P01").find(|t| t.file_as_written.contains(stem)).unwrap()).collect();
    let trials: Vec<Trial> = info.iter().map(|info| study.trial(info).unwrap()).collect();
    let forward = |file: &OsimFile| {
        let model = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
        ForwardModel::new(&file.spec, &model, &trials).unwrap()
    };
    let base = forward(file);
    let mut worst = (0.0_f64, "");
    let mut cases: Vec<(&str, Vec<Setting>)> =
        CATALOGUE.iter().map(|e| (e.description().id, vec![sized(*e, 1.0)])).collect();
    let of = |ids: &[&str]| ids.iter().map(|id| sized(named(id), 0.5)).collect::<Vec<_>>();
    cases.push((
        "several",
        of(&["joint_stiffness", "tendon_compliance", "fatigue", "coulomb_friction", "torque_offset"]),
    ));
    for (id, effects) in &cases {
        let mut copy = file.clone();
        let report = export::write(&mut copy, &setup, effects).unwrap();
        // Both files go through their text.
        let copy = OsimFile::parse(copy.document.bytes().to_vec(), "exported.osim").unwrap();
        assert_eq!(copy.diagnostics.of(carpus::osim::Severity::Unsupported).count(), 0, "{id}");
        let side_car = SideCar::parse(&report.side_car.to_toml(), Path::new("effects.toml")).unwrap();
        assert_eq!(side_car, report.side_car, "{id}");
        let exported = forward(&copy);
        for trial in 0..TRIALS.len() {
            let ours = moment(&base, trial, effects);
            let theirs = moment(&exported, trial, &side_car.effects);
            let off = largest(difference(&ours, &theirs));
            assert!(off < TOLERANCE, "{id}, trial {trial}: {off:.1e} N·m");
            worst = if off > worst.0 { (off, *id) } else { worst };
        }
    }
    println!("exported and read again: {:.1e} N·m ({})", worst.0, worst.1);
}

#[test]
fn verif_passive_effects_lie_about_the_middle_of_a_range_that_zero_is_not_in_the_middle_of() {
    const TOLERANCE: f64 = 2e-5;
    let (study, file, _) = study();
    let info = study.trials_of("P01").find(|t| t.file_as_written.contains(TRIALS[0])).unwrap();
    let trials = [study.trial(info).unwrap()];
    let text = String::from_utf8(file.document.bytes().to_vec()).unwrap();
    let coordinate = text.find("<Coordinate name=\"flexion\">").unwrap();
    let (from, to) = ["<range>", "</range>"].map(|tag| coordinate + text[coordinate..].find(tag).unwrap()).into();
    let one_sided = format!("{}<range>-0.2 1.8{}", &text[..from], &text[to..]);
    let file = OsimFile::parse(one_sided.into_bytes(), "one_sided.osim").unwrap();
    let forward = |file: &OsimFile| {
        let model = MusculoskeletalModel::compile(&file.spec, &setup()).unwrap();
        ForwardModel::new(&file.spec, &model, &trials).unwrap()
    };
    let base = forward(&file);
    assert!((base.joint.neutral_angle - 0.8).abs() < 1e-12);
    let mut spring = base.joint.absent(named("end_range_spring"));
    assert_eq!(spring.values, [0.0, 0.0, 4.0, 4.0]);
    (spring.values[0], spring.values[1]) = (0.6, 0.3);
    let added = difference(&moment(&base, 0, std::slice::from_ref(&spring)), &moment(&base, 0, &[]));
    for (k, q) in base.trials[0].angle.iter().enumerate() {
        let quarter_turn = std::f64::consts::FRAC_PI_2;
        let from_neutral = q - 0.8;
        let below = 0.6 * (-4.0 * (from_neutral + quarter_turn)).exp();
        let above = 0.3 * (4.0 * (from_neutral - quarter_turn)).exp();
        assert!((added[k] - (below - above)).abs() < 1e-12);
    }
    let mut stop = base.joint.absent(named("ligament_stop"));
    assert!((stop.values[1] - 1.2).abs() < 1e-12 && (stop.values[2] + 0.4).abs() < 1e-12, "{:?}", stop.values);
    stop.values[0] = 1.0;
    for effect in [spring, stop] {
        let mut copy = file.clone();
        export::write(&mut copy, &setup(), std::slice::from_ref(&effect)).unwrap();
        let copy = OsimFile::parse(copy.document.bytes().to_vec(), "exported.osim").unwrap();
        let off = largest(difference(&moment(&base, 0, &[effect]), &moment(&forward(&copy), 0, &[])));
        assert!(off < TOLERANCE, "{off:.1e} N·m");
    }
}

#[test]
fn verif_forces_stay_beside_the_model_when_the_study_does_not_count_them() {
    let (_, file, _) = study();
    let mut setup = setup();
    setup.parts = vec![MomentPart::Muscles];
    let effects =
        [sized(named("joint_stiffness"), 1.0), sized(named("inertia"), 1.0), sized(named("tendon_compliance"), 1.0)];
    let mut copy = file.clone();
    let report = export::write(&mut copy, &setup, &effects).unwrap();
    assert_eq!(report.side_car.effects, effects[..2]);
    assert!(
        report.reasons[0].contains("\"passive\"") && report.reasons[1].contains("\"inertia\""),
        "{:?}",
        report.reasons
    );
    assert_eq!(report.native.len(), 1);
}

#[test]
fn verif_two_exports_add_two_forces() {
    let (_, file, _) = study();
    let mut copy = file.clone();
    let effect = [sized(named("joint_stiffness"), 1.0)];
    export::write(&mut copy, &setup(), &effect).unwrap();
    export::write(&mut copy, &setup(), &effect).unwrap();
    let names: Vec<&str> =
        copy.spec.forces.iter().map(|f| f.name.as_str()).filter(|n| n.starts_with("carpus_")).collect();
    assert_eq!(names, ["carpus_joint_stiffness", "carpus_joint_stiffness_2"]);
}

#[test]
fn verif_errors_leave_the_file_as_it_was_and_say_what_is_wrong() {
    let (_, file, _) = study();
    let mut copy = file.clone();
    let good = sized(named("joint_stiffness"), 1.0);
    let bad = Setting { effect: named("gravity"), values: vec![f64::NAN, 0.0] };
    assert!(export::write(&mut copy, &setup(), &[good, bad]).is_err());
    assert_eq!(copy.document.bytes(), file.document.bytes());
    let head = "schema = \"carpus.effects/1\"\ncoordinate = \"flexion\"\n";
    let error = |text: &str| SideCar::parse(text, Path::new("effects.toml")).unwrap_err();
    let unknown = error(&format!("{head}[[effect]]\nid = \"fatige\"\n"));
    assert_eq!(unknown.hint().as_deref(), Some("did you mean \"fatigue\"?"));
    for (text, expected) in [
        ("schema = \"x\"\n", "schema"),
        (&format!("{head}[[effect]]\nid = \"emg_floor\"\n"), "emg_floor.baseline"),
        (
            &format!("{head}[[effect]]\nid = \"emg_floor\"\nbaseline = {{ value = 0.1, unit = \"s\" }}\n"),
            "emg_floor.baseline.unit",
        ),
        (
            &format!("{head}[[effect]]\nid = \"emg_floor\"\nbaseline = {{ value = nan, unit = \"1\" }}\n"),
            "a finite number",
        ),
        (&format!("{head}[[effect]]\nid = \"emg_floor\"\nbase = 1\n"), "only id, baseline"),
        ("schema = ", "effects.toml"),
    ] {
        let message = error(text).to_string();
        assert!(message.contains(expected), "{message}");
    }
}
