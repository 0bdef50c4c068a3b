//! What a model, a trial or an argument with a fault is answered with.

use super::*;

/// The bundled model, spoilt, through `info`: exit code 1 and a message with file and line.
fn model_refused(change: impl Fn(&str) -> String, line_of: &str, says: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("spoilt.osim");
    let text = std::fs::read_to_string(model()).unwrap();
    let spoilt = change(&text);
    assert_ne!(text, spoilt, "the edit does something");
    let line = spoilt.lines().position(|l| l.contains(line_of)).map(|i| i + 1);
    let line = line.unwrap_or_else(|| panic!("the spoilt model contains {line_of}"));
    std::fs::write(&file, &spoilt).unwrap();
    let failed = carpus().arg("info").arg(&file).assert().code(1).stdout("");
    let text = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
    let place = format!("error: {}:{line}: ", file.display());
    assert!(text.contains(&place), "expected `{place}` in:\n{text}");
    for words in says {
        assert!(text.contains(words), "expected `{words}` in:\n{text}");
    }
    assert!(!text.contains("panicked") && !text.contains("internal error"), "{text}");
}

// Bad input: models.

#[test]
fn verif_truncated_model() {
    let text = std::fs::read_to_string(model()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cut.osim");
    let refused = |length: usize, says: &str| {
        std::fs::write(&file, &text[..length]).unwrap();
        let place = predicates::str::is_match(r"error: \S*cut\.osim:\d+: ").unwrap();
        carpus().arg("info").arg(&file).assert().code(1).stdout("").stderr(place.and(contains(says)));
    };
    refused(text.find("</BodySet>").unwrap(), "the file ends inside <BodySet>");
    refused(text.find("<JointSet").unwrap() + 4, "broken markup");
    refused(0, "empty");
}

#[test]
fn verif_wrong_nesting() {
    model_refused(
        |t| t.replacen("</BodySet>", "</JointSet>", 1),
        "</JointSet>",
        &["expected </BodySet>", "found </JointSet>"],
    );
}

#[test]
fn verif_text_in_a_number() {
    let edit = |t: &str| replace_value(t, "max_isometric_force", "strong");
    model_refused(edit, ">strong<", &["max_isometric_force", "\"strong\""]);
}

#[test]
fn verif_not_a_number() {
    let edit = |t: &str| replace_value(t, "tendon_slack_length", "NaN");
    model_refused(edit, ">NaN<", &["tendon_slack_length"]);
}

#[test]
fn verif_negative_fibre_length() {
    let edit = |t: &str| replace_value(t, "optimal_fiber_length", "-0.08");
    model_refused(edit, ">-0.08<", &["optimal_fiber_length", "-0.08"]);
}

#[test]
fn verif_muscle_without_path() {
    let edit = |t: &str| {
        let start = t.find("<GeometryPath").expect("a path");
        let end = start + t[start..].find("</GeometryPath>").expect("its end") + "</GeometryPath>".len();
        format!("{}{}", &t[..start], &t[end..])
    };
    model_refused(edit, "<Millard2012EquilibriumMuscle name=", &["path has 0 points", "PathPointSet"]);
}

#[test]
fn verif_unknown_body_in_a_socket() {
    let edit = |t: &str| t.replacen("<socket_parent_frame>/bodyset/hand</", "<socket_parent_frame>/bodyset/hnad</", 1);
    model_refused(edit, "/bodyset/hnad<", &["hnad", "did you mean"]);
}

#[test]
fn verif_missing_model() {
    carpus().args(["info", "no_such.osim"]).assert().code(1).stderr(contains("no_such.osim: cannot be read"));
}

#[test]
fn verif_a_file_that_is_no_model() {
    let run = carpus().arg("info").arg(root("Cargo.toml")).assert().code(1);
    run.stderr(contains("Cargo.toml").and(contains("panicked").not()));
}

/// Replaces the first value of a property.
fn replace_value(text: &str, property: &str, value: &str) -> String {
    let open = format!("<{property}>");
    let start = text.find(&open).unwrap() + open.len();
    let end = start + text[start..].find('<').unwrap();
    format!("{}{value}{}", &text[..start], &text[end..])
}

// Bad input: studies. Line numbers count the header as 1, so row n of a table stands in line n + 1.

#[test]
fn verif_missing_column() {
    let study = StudyCopy::new();
    study.edit(TRAIN, |t| t.replacen("moment_n_m", "momnt_n_m", 1));
    study.refused(&format!("{}:1", study.path(TRAIN).display()), &["moment_n_m", "did you mean `momnt_n_m`?"]);
}

#[test]
fn verif_unsorted_time() {
    let study = StudyCopy::new();
    study.edit_row(7, |f| f[0] = "0.001".into());
    study.refused(&format!("{}:8", study.path(TRAIN).display()), &["hint: sort the rows"]);
}

#[test]
fn verif_duplicate_time() {
    let study = StudyCopy::new();
    study.edit_row(7, |f| f[0] = "0.05".into());
    study.refused(&format!("{}:8", study.path(TRAIN).display()), &["hint: delete one of the two rows"]);
}

#[test]
fn verif_gap() {
    let study = StudyCopy::new();
    study.edit(TRAIN, |t| {
        let kept = |(i, line): (usize, &str)| (!(100..160).contains(&i)).then(|| format!("{line}\n"));
        t.lines().enumerate().filter_map(kept).collect()
    });
    study.refused(&format!("{}:101", study.path(TRAIN).display()), &["hint: split the trial"]);
}

#[test]
fn verif_emg_above_one_and_below_zero() {
    let study = StudyCopy::new();
    study.edit_row(9, |f| f[3] = "1.7".into());
    study.refused(&format!("{}:10", study.path(TRAIN).display()), &["1.7", "hint: is it in percent or mV"]);
    let study = StudyCopy::new();
    study.edit_row(9, |f| f[4] = "-0.4".into());
    study.refused(&format!("{}:10", study.path(TRAIN).display()), &["-0.4", "hint: an envelope is never negative"]);
}

#[test]
fn verif_nan_in_a_trial() {
    let study = StudyCopy::new();
    study.edit_row(9, |f| f[2] = "NaN".into());
    study.refused(&format!("{}:10", study.path(TRAIN).display()), &["hint: cut the samples off"]);
}

#[test]
fn verif_angle_outside_the_range() {
    let study = StudyCopy::new();
    study.edit_row(9, |f| f[1] = "95".into());
    study.refused(&format!("{}:10", study.path(TRAIN).display()), &["95", "hint: check the zero"]);
}

#[test]
fn verif_angle_a_little_outside_the_range_is_warned_of() {
    let study = StudyCopy::new();
    let limits = narrowed(&study, 30.0);
    let shown = study.run("compare").success();
    let text = String::from_utf8(shown.get_output().stderr.clone()).unwrap();
    for trial in [TRAIN, TEST] {
        assert_eq!(text.lines().filter(|l| l.contains(trial) && l.contains(&limits)).count(), 1, "{trial}:\n{text}");
    }
    assert!(text.contains("warning: ") && text.contains("hint: check the zero"), "{text}");
    // More than 12° is no warning any more.
    let study = StudyCopy::new();
    let limits = narrowed(&study, 15.0);
    study.refused(&format!("{}:", study.path(TRAIN).display()), &[&limits, "hint: check the zero"]);
}

/// Narrows the range of flexion in the study's model to ± so many degrees. Returns how messages write it.
fn narrowed(study: &StudyCopy, deg: f64) -> String {
    study.edit("wrist.osim", |text| {
        let from = text.find("<Coordinate name=\"flexion\">").unwrap();
        let from = from + text[from..].find("<range>").unwrap();
        let to = from + text[from..].find("</range>").unwrap();
        format!("{}<range>{} {}{}", &text[..from], -deg.to_radians(), deg.to_radians(), &text[to..])
    });
    format!("`flexion`, -{deg:.2}° to {deg:.2}°")
}

#[test]
fn verif_a_posture_outside_the_range_is_told_in_degrees() {
    let study = StudyCopy::new();
    study.edit("study.toml", |t| t.replace("elbow_flexion = 90", "elbow_flexion = 200"));
    let line = std::fs::read_to_string(study.path("study.toml")).unwrap();
    let line = 1 + line.lines().position(|l| l.contains("elbow_flexion")).unwrap();
    study.refused(&format!("study.toml:{line}: "), &["`elbow_flexion` is held at 200.00°", "hint: posture values are"]);
}

#[test]
fn verif_an_active_muscle_of_a_class_without_force_is_told_with_its_line() {
    let study = StudyCopy::new();
    study.edit("wrist.osim", |text| {
        let end = text.find("</Millard2012EquilibriumMuscle>").unwrap();
        // The other class has no such curve.
        let curve = text.find("<TendonForceLengthCurve").unwrap();
        assert!(curve < end);
        format!("{}{}", &text[..curve], &text[end..])
            .replacen("<Millard2012EquilibriumMuscle ", "<Millard2012AccelerationMuscle ", 1)
            .replacen("</Millard2012EquilibriumMuscle>", "</Millard2012AccelerationMuscle>", 1)
    });
    let line = std::fs::read_to_string(study.path("wrist.osim")).unwrap();
    let line = 1 + line.lines().position(|l| l.contains("<Millard2012AccelerationMuscle ")).unwrap();
    let says = ["force of a Millard2012AccelerationMuscle is not computed", "hint: leave it out of [muscles]"];
    study.refused(&format!("wrist.osim:{line}: "), &says);
}

#[test]
fn verif_the_studys_model_may_be_missing_where_another_is_given() {
    let study = StudyCopy::new();
    std::fs::rename(study.path("wrist.osim"), study.path("other.osim")).unwrap();
    study.run("simulate").code(1).stderr(contains("wrist.osim: model not found"));
    let mut command = carpus();
    command.arg("simulate").arg(study.path("study.toml")).arg("--out").arg(study.path("out"));
    command.arg("--model").arg(study.path("other.osim")).assert().success();
}

#[test]
fn verif_a_diagnosis_of_one_trial_is_refused_with_the_table() {
    let study = StudyCopy::new();
    let failed = study.run("diagnose").code(1);
    failed.stderr(contains("trials.csv: participant P01: expected at least two trials with use = train, found 1"));
}

#[test]
fn verif_a_diagnosis_of_passive_trials_alone_says_that_it_is_not_calibrated() {
    let study = StudyCopy::new();
    let warns = |yes: bool| {
        let mut command = carpus();
        command.arg("diagnose").arg(study.path("study.toml")).args(["--candidates", "gravity", "--out"]);
        let done = command.arg(study.path("out")).assert().success();
        let text = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
        let says = text.contains("trials.csv: participant P01: every trial with use = train is passive");
        assert_eq!(says, yes, "{text}");
    };
    study.edit("trials.csv", |text| text.replace(",test", ",train"));
    warns(false);
    let passive = |line: &str| {
        line.split(',')
            .enumerate()
            .map(|(i, cell)| match i {
                2 => "passive",
                3 => "",
                4 => "none",
                _ => cell,
            })
            .collect::<Vec<_>>()
            .join(",")
    };
    study.edit("trials.csv", |text| {
        let rows = text.lines().enumerate().map(|(i, line)| if i == 0 { line.to_owned() } else { passive(line) });
        rows.map(|line| line + "\n").collect()
    });
    warns(true);
}

#[test]
fn verif_one_participant_that_cannot_be_done_does_not_keep_the_others_from_it() {
    let study = StudyCopy::new();
    study.edit("participants.csv", |text| format!("{}\nP02,60,1.65,female,right,7,5\n", text.trim_end()));
    study.edit("trials.csv", |text| {
        let others = text.lines().skip(1).map(|line| line.replace("P01", "P02") + "\n").collect::<String>();
        format!("{}\n{others}", text.trim_end())
    });
    std::fs::create_dir_all(study.path("data/P02")).unwrap();
    for name in [TRAIN, TEST] {
        std::fs::copy(study.path(name), study.path(&name.replace("P01", "P02"))).unwrap();
    }
    let spoilt = TRAIN.replace("P01", "P02");
    study.edit(&spoilt, |text| text.replacen(",-3", ",-95", 1));
    study.run("compare").code(1).stdout(contains("P01")).stderr(contains("error: ").and(contains(spoilt.as_str())));
    assert!(study.path("out/P01/results.json").is_file());
}

#[test]
fn verif_radians_given_as_degrees_are_warned_of() {
    let study = StudyCopy::new();
    study.edit(TRAIN, |t| {
        let row = |(i, line): (usize, &str)| {
            let mut fields: Vec<String> = line.split(',').map(String::from).collect();
            if i > 0 {
                fields[1] = format!("{:.5}", fields[1].parse::<f64>().unwrap().to_radians());
            }
            fields.join(",") + "\n"
        };
        t.lines().enumerate().map(row).collect()
    });
    study.run("compare").success().stderr(contains("warning: ").and(contains("rad")).and(contains(TRAIN)));
    let page = std::fs::read_to_string(study.path("out/P01/report.html")).unwrap();
    assert!(page.contains("Read this first"), "the report repeats the warning");
}

#[test]
fn verif_missing_files() {
    let study = StudyCopy::new();
    std::fs::remove_file(study.path(TEST)).unwrap();
    study.refused(&study.path(TEST).display().to_string(), &["trials.csv:"]);
    let study = StudyCopy::new();
    std::fs::remove_file(study.path("wrist.osim")).unwrap();
    study.refused("wrist.osim", &["study.toml:"]);
    let run = carpus().args(["compare", "nowhere/study.toml", "--out", "x"]).assert().code(1);
    run.stderr(contains("nowhere/study.toml"));
    assert!(!Path::new("x").exists(), "nothing is made for a study that cannot be read");
}

#[test]
fn verif_misspelt_names_in_the_study() {
    let study = StudyCopy::new();
    study.edit("study.toml", |t| t.replacen("coordinate = \"flexion\"", "coordinate = \"flexon\"", 1));
    study.refused("study.toml:", &["flexon", "did you mean `flexion`?"]);
    let study = StudyCopy::new();
    study.edit("study.toml", |t| t.replacen("\"FCU\"", "\"FCUU\"", 1));
    study.refused("study.toml:", &["FCUU", "FCU"]);
}

#[test]
fn verif_unwritable_output_is_found_before_computing() {
    let study = StudyCopy::new();
    // A file in place of the folder cannot be written into by anyone, not even by root.
    std::fs::write(study.path("out"), "").unwrap();
    study.refused(
        &study.path("out").display().to_string(),
        &["cannot write results here", "hint: choose another folder"],
    );
}

#[test]
fn verif_a_muscle_without_force_model_is_refused_or_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("acceleration.osim");
    let text = std::fs::read_to_string(model()).unwrap();
    let start = text.find("<Millard2012EquilibriumMuscle").unwrap();
    let end = start
        + text[start..].find("</Millard2012EquilibriumMuscle>").unwrap()
        + "</Millard2012EquilibriumMuscle>".len();
    let changed = text[start..end].replace("Millard2012EquilibriumMuscle", "Millard2012AccelerationMuscle");
    std::fs::write(&file, format!("{}{changed}{}", &text[..start], &text[end..])).unwrap();
    let run = || {
        let mut command = carpus();
        command.arg("equilibrium").arg(&file);
        command
    };
    run().assert().code(1).stderr(
        contains("force of a Millard2012AccelerationMuscle is not computed").and(contains("acceleration.osim:")),
    );
    let shown = run().arg("--allow-unsupported").assert().success();
    shown.stderr(contains("warning: ")).stdout(contains("FCU").and(contains("ECRL").not()));
}

#[test]
fn verif_a_name_of_several_coordinates_is_ambiguous() {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/model_kinds/equal_names.osim");
    let says = "coordinate `q` is ambiguous: /jointset/j1/q is taken, as in OpenSim, not /jointset/j2/q";
    carpus().args(["equilibrium", "--set", "q=10deg"]).arg(file).assert().code(0).stderr(contains(says));
}
