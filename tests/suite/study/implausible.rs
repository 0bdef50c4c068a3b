//! Values that no person has, moments that are reversed, channels that were exchanged, names that deceive.

use std::path::Path;

use carpus::study::{Problem, Severity, Study};

use super::folder::{Folder, PARTICIPANTS, TOML, TRIAL_HEADER, list, says};

#[test]
fn verif_a_mass_in_pounds_is_suspected() {
    let folder = Folder::spoilt("participants.csv", "70.5,1.75", "150,1.75");
    says(
        &folder.only_warning("participants.csv", 2),
        "150 kg at a height of 1.75 m",
        "is the mass in pounds? 150 pounds are 68.0 kg",
    );
    let folder = Folder::spoilt("participants.csv", "70.5,1.75", "150,");
    says(&folder.only_warning("participants.csv", 2), "column `mass_kg`: 150 is not plausible in kg", "in pounds?");
    for fine in ["110,1.95", "45,1.6", "20,1.15"] {
        let folder = Folder::spoilt("participants.csv", "70.5,1.75", fine);
        assert_eq!(folder.read().unwrap().warnings, [], "{fine}");
    }
}

#[test]
fn verif_an_effort_as_a_fraction_is_suspected() {
    let folder = Folder::spoilt("trials.csv", "isometric,25,", "isometric,0.25,");
    let warnings = folder.read().unwrap().warnings;
    let found = warnings.iter().find(|w| w.file == folder.path("trials.csv")).expect("a warning");
    says(found, "column `effort_percent`: 0.25 is not plausible in %", "0.25 parts of 1 are 25 %");
    let folder = Folder::spoilt("trials.csv", "isometric,25,", "isometric,0,");
    assert_eq!(folder.read().unwrap().warnings, [], "no effort is none");
}

#[test]
fn verif_bounds_as_fractions_or_without_bounds_are_warned_of() {
    let with = |line: &str| Folder::spoilt("study.toml", "[emg]", &format!("[personalization]\n{line}\n\n[emg]"));
    let folder = with("max_isometric_force = [1, 100000]");
    says(&folder.only_warning("study.toml", 18), "`max_isometric_force`: 100000 is not plausible in %", "Holzbaur");
    let folder = with("optimal_fiber_length = [0.8, 1.2]");
    says(&folder.only_warning("study.toml", 18), "0.8 is not plausible in %", "0.8 parts of 1 are 80 %");
    assert_eq!(with("optimal_fiber_length = [82.2, 117.8]").read().unwrap().warnings, []);
}

#[test]
fn verif_steps_that_no_recorder_has_are_refused() {
    let folder = Folder::good();
    let rows: Vec<String> = (0..50)
        .map(|i| format!("{:e},30,{},{},0.1", 1e-14 * f64::from(i), 0.05 * f64::from(i), 0.1 + 0.01 * f64::from(i)))
        .collect();
    folder.write("data/iso.csv", format!("{TRIAL_HEADER}\n{}\n", rows.join("\n")));
    let refused = folder.read().unwrap_err();
    assert!(
        refused.errors.iter().any(|e| e.fault.to_string().contains("median time step")),
        "{}",
        list(&refused.errors)
    );
}

#[test]
fn verif_a_trial_of_milliseconds_is_suspected() {
    let folder = Folder::good();
    let rows: Vec<String> = (0..350)
        .map(|i| {
            format!("{:e},30,{},{},0.1", 1e-5 * f64::from(i), 0.05 + 0.01 * f64::from(i), 0.1 + 1e-4 * f64::from(i))
        })
        .collect();
    folder.write("data/iso.csv", format!("{TRIAL_HEADER}\n{}\n", rows.join("\n")));
    let warnings = folder.read().unwrap().warnings;
    let found = warnings.iter().find(|w| w.fault.to_string().contains("duration")).expect("a warning");
    says(found, "duration: 0.00349 is not plausible in s (expected 0.05 to 3600)", "voluntary contraction");
}

#[test]
fn verif_a_column_that_states_another_unit_is_warned_of() {
    let folder = Folder::good();
    folder.write("study.toml", format!("{TOML}[columns]\nmoment = \"torque_ft_lb\"\n"));
    for file in ["data/iso.csv", "data/dyn.csv"] {
        folder.spoil(file, "moment_n_m", "torque_ft_lb");
    }
    says(&folder.only_warning("study.toml", 20), "its name states ft·lb", "1 ft·lb is 1.355818 N·m");
}

#[test]
fn verif_columns_of_any_quantity_that_state_another_unit_are_warned_of() {
    let says_of = |key: &str, from: &str, name: &str| {
        let folder = Folder::good();
        folder.write("study.toml", format!("{TOML}[columns]\n{key} = \"{name}\"\n"));
        for file in ["data/iso.csv", "data/dyn.csv"] {
            folder.spoil(file, from, name);
        }
        folder.read().unwrap().warnings
    };
    for (key, from, name, what, hint) in [
        ("time", "time_s", "time_ms", "states ms; its numbers are taken as s", "1 ms is 0.001 s"),
        ("time", "time_s", "Zeit [ms]", "states ms", "multiply the column"),
        ("angle", "angle_deg", "Winkel [rad]", "states rad; its numbers are taken as deg", "1 rad is 57.29578 deg"),
        ("angle", "angle_deg", "Winkel [rad]", "states rad", "angle_unit = \"rad\""),
        ("moment", "moment_n_m", "torque_mV", "states mV, a voltage; its numbers are taken as N·m", "calibration"),
        ("moment", "moment_n_m", "M (Nm/kg)", "states N·m/kg, a moment per body mass", "body mass"),
    ] {
        let warnings = says_of(key, from, name);
        assert_eq!(warnings.len(), 1, "{name}: {}", list(&warnings));
        says(&warnings[0], what, hint);
    }
    for (key, from, name) in [
        ("time", "time_s", "Zeit [s]"),
        ("time", "time_s", "t"),
        ("angle", "angle_deg", "Winkel (°)"),
        ("moment", "moment_n_m", "Moment [N·m]"),
        ("moment", "moment_n_m", "torque_2"),
    ] {
        assert_eq!(says_of(key, from, name), [], "{name}");
    }
}

#[test]
fn verif_a_drag_that_no_machine_has_is_warned_of() {
    let with = |value: &str| Folder::spoilt("study.toml", "_per_deg = 0.005", &format!("_per_deg = {value}"));
    for (value, hint) in [("1e9", "check the unit"), ("20", "20 N·m·s/rad are 0.3491 N·m·s/deg")] {
        let warnings = with(value).read().unwrap().warnings;
        let found = warnings.iter().find(|w| w.fault.to_string().contains("damping_n_m_s_per_deg")).expect("a warning");
        says(found, "is not plausible in N·m·s/deg (expected 0 to 1)", hint);
    }
    assert_eq!(with("0.01").read().unwrap().warnings, []);
}

#[test]
fn verif_an_mvc_that_the_mvc_trial_does_not_show_is_warned_of() {
    // The trial's largest moment is 1.225 N·m.
    let mvc = |stated: f64| {
        let folder = Folder::spoilt("participants.csv", ",10,6", &format!(",{stated},6"));
        folder.spoil("trials.csv", "isometric,25,", "mvc,100,");
        folder.read().unwrap().warnings
    };
    assert_eq!(mvc(1.225), []);
    assert_eq!(mvc(1.3), []);
    let warnings = mvc(1.225 * 1.3558);
    assert_eq!(warnings.len(), 1, "{}", list(&warnings));
    says(
        &warnings[0],
        "the largest moment of the MVC trial data/iso.csv is 1.23 N·m",
        "is the moment of the trials in ft·lb?",
    );
    says(&mvc(1.225 / 1.3558)[0], "column `mvc_flexion_n_m`", "is the MVC in ft·lb?");
    says(&mvc(1.9)[0], "column `mvc_flexion_n_m`: 1.9 N·m", "the trial was not maximal");
}

/// The demo's study with its moment times `factor`, and two columns of EMG exchanged.
fn demo(factor: f64, exchanged: Option<[&str; 2]>) -> (tempfile::TempDir, Study) {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/demo_study");
    let folder = tempfile::tempdir().unwrap();
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/wrist.osim");
    std::fs::create_dir_all(folder.path().join("data/P01")).unwrap();
    let toml = std::fs::read_to_string(source.join("study.toml")).unwrap();
    std::fs::write(
        folder.path().join("study.toml"),
        toml.replace("../../models/wrist.osim", &model.display().to_string()),
    )
    .unwrap();
    for table in ["participants.csv", "trials.csv"] {
        std::fs::copy(source.join(table), folder.path().join(table)).unwrap();
    }
    for entry in std::fs::read_dir(source.join("data/P01")).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        let (header, rows) = text.split_once('\n').unwrap();
        let mut header = header.to_owned();
        if let Some([a, b]) = exchanged {
            header = header.replace(a, "other").replace(b, a).replace("other", b);
        }
        let place = header.split(',').position(|c| c == "moment_n_m").unwrap();
        let row = |row: &str| {
            let mut cells: Vec<String> = row.split(',').map(str::to_owned).collect();
            cells[place] = (factor * cells[place].parse::<f64>().unwrap()).to_string();
            cells.join(",")
        };
        let rows: Vec<String> = rows.lines().map(row).collect();
        let target = folder.path().join("data/P01").join(path.file_name().unwrap());
        std::fs::write(target, format!("{header}\n{}\n", rows.join("\n"))).unwrap();
    }
    let study = Study::read_tables(folder.path()).unwrap();
    (folder, study)
}

#[test]
fn verif_weak_efforts_against_a_passive_moment_are_not_called_reversed() {
    let (_folder, study) = demo(1.0, None);
    let problems = study.check_trials(|_| true);
    assert!(problems.is_empty(), "{}", list(&problems));
}

#[test]
fn verif_a_moment_reversed_in_all_trials_is_one_error_with_its_remedy() {
    let (_folder, study) = demo(-1.0, None);
    let problems = study.check_trials(|_| true);
    let errors: Vec<&Problem> = problems.iter().filter(|p| p.severity == Severity::Error).collect();
    assert_eq!((problems.len(), errors.len()), (1, 1), "{}", list(&problems));
    says(errors[0], "the moment is reversed: in all 26 trials", "multiply `moment_n_m` by -1");
    assert_eq!(errors[0].line, Some(7), "the coordinate's line");
    let refused = study.load_trials("P01").unwrap_err();
    assert_eq!(refused.errors.len(), 1, "{refused}");
}

#[test]
fn verif_exchanged_channels_are_suspected() {
    // Moment arms of the wrist's muscles times their forces, constant: flexors positive.
    let strengths = |study: &Study, trials: &[carpus::study::Trial]| -> Vec<Vec<Vec<f64>>> {
        let of = |muscle: &String| if muscle.starts_with("FC") { 6.0 } else { -3.0 };
        let muscle = |n: usize| study.settings.active_muscles.iter().map(|m| vec![of(m); n]).collect();
        trials.iter().map(|t| muscle(t.len())).collect()
    };
    for (exchanged, expected) in [(None, 0), (Some(["emg_FCR", "emg_ECRB"]), 1), (Some(["emg_ECU", "emg_FCU"]), 1)] {
        let (_folder, study) = demo(1.0, exchanged);
        let trials = study.load_trials("P01").unwrap();
        let problems = study.check_channels(&trials, &strengths(&study, &trials));
        assert_eq!(problems.len(), expected, "{}", list(&problems));
        if let Some([a, b]) = exchanged {
            let text = problems[0].fault.to_string();
            assert!(text.contains(&a[4..]) && text.contains(&b[4..]) && text.contains("looks exchanged"), "{text}");
            assert!(text.contains("times as well"), "{text}");
        }
    }
}

#[test]
fn verif_names_that_deceive_are_refused() {
    for (bad, number) in
        [("P\u{1b}[2J", "U+001B"), ("P\u{202e}10", "U+202E"), ("P\u{feff}01", "U+FEFF"), ("\"P\n01\"", "U+000A")]
    {
        let folder = Folder::good();
        folder.write("participants.csv", PARTICIPANTS.replace("P01", bad));
        let errors = folder.errors();
        let found = errors.iter().find(|e| e.file == folder.path("participants.csv")).expect("an error");
        says(found, &format!("column `participant` has the character {number}"), "write the name anew");
        let shown: String = errors.iter().map(ToString::to_string).collect();
        assert!(!shown.contains(['\u{1b}', '\u{202e}', '\u{feff}']), "{shown:?}");
    }
    let folder = Folder::spoilt("study.toml", "\"Two muscles\"", "\"Two\\u202Emuscles\"");
    says(&folder.only_error("study.toml", 2), "`name` has the character U+202E", "");
    let folder = Folder::spoilt("data/iso.csv", "emg_FCR", "emg_FCR,emg\u{200e}X");
    assert!(list(&folder.errors()).contains("U+200E"), "{}", list(&folder.errors()));
}

#[test]
fn verif_a_participant_named_as_a_formula_is_read_as_text_is_written() {
    let folder = Folder::good();
    folder.write("participants.csv", PARTICIPANTS.replace("P01", "'=1+1"));
    let trials = std::fs::read_to_string(folder.path("trials.csv")).unwrap().replace("P01", "=1+1");
    folder.write("trials.csv", trials);
    assert_eq!(folder.read().unwrap().participants[0].name, "=1+1");
}

#[test]
fn verif_a_trial_outside_the_study_is_said_to_be() {
    let folder = Folder::good();
    let elsewhere = tempfile::tempdir().unwrap();
    let file = elsewhere.path().join("iso.csv");
    std::fs::copy(folder.path("data/iso.csv"), &file).unwrap();
    folder.spoil("trials.csv", "data/iso.csv", &file.display().to_string());
    says(&folder.only_warning("trials.csv", 2), "is outside the study's folder", "lacks it");
}

#[cfg(unix)]
#[test]
fn verif_what_is_no_file_is_no_trial() {
    let folder = Folder::spoilt("trials.csv", "data/iso.csv", "/dev/zero");
    let errors = folder.errors();
    assert!(list(&errors).contains("trial file is no regular file"), "{}", list(&errors));
    // A link to the outside is outside.
    let folder = Folder::good();
    let elsewhere = tempfile::tempdir().unwrap();
    std::fs::rename(folder.path("data/iso.csv"), elsewhere.path().join("iso.csv")).unwrap();
    std::os::unix::fs::symlink(elsewhere.path().join("iso.csv"), folder.path("data/iso.csv")).unwrap();
    says(&folder.only_warning("trials.csv", 2), "`data/iso.csv` is outside", "");
}
