use super::folder::{Folder, SAMPLES, TOML, TRIAL_HEADER, TRIALS, list, says};

/// Rewrites a trial with each row passed through `change`: time, angle, moment, two EMGs.
fn rewritten(file: &str, change: impl Fn([f64; 5]) -> [f64; 5]) -> Folder {
    let folder = Folder::good();
    let text = std::fs::read_to_string(folder.path(file)).unwrap();
    let mut out = format!("{TRIAL_HEADER}\n");
    for line in text.lines().skip(1) {
        let cells: Vec<f64> = line.split(',').map(|c| c.parse().unwrap()).collect();
        let row = change([cells[0], cells[1], cells[2], cells[3], cells[4]]);
        out += &(row.map(|v| v.to_string()).join(",") + "\n");
    }
    folder.write(file, out);
    folder
}

#[test]
fn verif_radians_in_a_degrees_column_are_warned_of() {
    let moving = rewritten("data/dyn.csv", |[t, q, m, a, b]| [t, q.to_radians(), m, a, b]);
    says(&moving.only_warning("data/dyn.csv", None), "`angle_deg` looks like radians: an isotonic trial", "angle_unit");
    let held = rewritten("data/iso.csv", |[t, q, m, a, b]| [t, q.to_radians(), m, a, b]);
    says(&held.only_warning("data/iso.csv", None), "looks like radians: mean 0.52", "180/π");
}

#[test]
fn verif_degrees_in_a_radians_column_are_warned_of() {
    let folder = Folder::good();
    folder.write("study.toml", format!("{TOML}[columns]\nangle = \"angle_deg\"\nangle_unit = \"rad\"\n"));
    let warnings = folder.read().unwrap().warnings;
    assert_eq!(warnings.len(), 2, "{}", list(&warnings));
    says(&warnings[0], "looks like degrees: its name ends in _deg", "angle_unit = \"deg\"");
    let folder = Folder::good();
    folder.write("study.toml", format!("{TOML}[columns]\nangle = \"angle\"\nangle_unit = \"rad\"\n"));
    folder.spoil("data/iso.csv", "angle_deg", "angle");
    folder.spoil("data/dyn.csv", "angle_deg", "angle");
    let warnings = folder.read().unwrap().warnings;
    assert_eq!(warnings.len(), 2, "{}", list(&warnings));
    says(&warnings[1], "it reaches 35.00, more than a full turn", "");
}

#[test]
fn verif_a_posture_in_radians_is_warned_of() {
    let folder = Folder::spoilt("study.toml", "elbow_flexion = 90", "elbow_flexion = 1.5708");
    says(&folder.only_warning("study.toml", 11), "`elbow_flexion` looks like radians: 1.5708 rad are 90°", "180/π");
    for fine in ["1.5", "0", "-2", "0.25", "5"] {
        let folder = Folder::spoilt("study.toml", "elbow_flexion = 90", &format!("elbow_flexion = {fine}"));
        assert_eq!(folder.read().unwrap().warnings, [], "{fine}");
    }
}

#[test]
fn verif_a_posture_not_held_is_warned_of() {
    let folder = rewritten("data/iso.csv", |[t, q, m, a, b]| [t, -q, m, a, b]);
    says(&folder.only_warning("data/iso.csv", None), "mean angle is -30.", "sign of the angle");
    let folder = rewritten("data/iso.csv", |[t, q, m, a, b]| [t, q + 40.0 * (t - 0.245), m, a, b]);
    says(&folder.only_warning("data/iso.csv", None), "in an isometric trial", "");
}

#[test]
fn verif_constant_emg_is_warned_of_once_per_channel() {
    let folder = rewritten("data/iso.csv", |[t, q, m, a, _]| [t, q, m, a, 0.3]);
    says(&folder.only_warning("data/iso.csv", None), "column `emg_FCR` is 0.3 in every sample", "");
    // A relaxed muscle of a passive trial may well be exactly silent.
    let folder = rewritten("data/iso.csv", |[t, q, _, _, _]| [t, q, 0.0, 0.0, 0.0]);
    folder.spoil("trials.csv", "isometric,25,flexion,30", "passive,,none,");
    assert_eq!(folder.read().unwrap().warnings, []);
}

#[test]
fn verif_moments_of_odd_sign_or_size_are_warned_of() {
    let file = "data/iso.csv";
    for (factor, message, hint) in [
        (-1.0, "in a trial of direction `flexion`; expected the opposite sign", "the person exerts"),
        (1000.0, "expected at most 120 N·m", "N·m?"),
        (30.0, "the maximum voluntary moment is 10 N·m", "N·m?"),
        (0.001, "expected about 2.50 N·m", "N·m?"),
        (0.0, "zero throughout", "N·m?"),
    ] {
        let folder = rewritten(file, |[t, q, m, a, b]| [t, q, factor * m, a, b]);
        says(&folder.only_warning(file, None), message, hint);
    }
}

#[test]
fn verif_a_velocity_that_is_not_the_derivative_is_warned_of() {
    for (factor, hint) in [(-1.0, "sign is turned"), (1f64.to_radians(), "rad/s")] {
        let folder = Folder::good();
        let mut text = format!("{TRIAL_HEADER},velocity_deg_per_s\n");
        for i in 0..SAMPLES {
            let t = i as f64 * 0.01;
            let (angle, velocity) = (-35.0 * (6.0 * t).cos(), 210.0 * (6.0 * t).sin());
            text += &format!("{t},{angle},-3,{},{},{}\n", 0.3 + 0.1 * t, 0.1 + 0.1 * t, factor * velocity);
        }
        folder.write("data/dyn.csv", text);
        says(&folder.only_warning("data/dyn.csv", None), "times the derivative of the angle; expected 1", hint);
    }
}

#[test]
fn verif_coarse_sampling_is_warned_of() {
    let folder = rewritten("data/iso.csv", |[t, q, m, a, b]| [10.0 * t, q, m, a, b]);
    says(&folder.only_warning("data/iso.csv", None), "median time step is 0.1000 s; expected at most 0.02 s", "");
}

#[test]
fn verif_nothing_to_train_and_participants_without_trials_are_warned_of() {
    let folder = Folder::spoilt("trials.csv", "1,train", "1,test");
    says(&folder.only_warning("trials.csv", None), "no trial has use `train`", "");
    let folder = Folder::good();
    folder.spoil("participants.csv", "P01,", "P02,70,1.7,m,right,0.19,0.26,10,6\nP01,");
    says(&folder.only_warning("trials.csv", None), "participant `P02` has no trial", "");
}

#[test]
fn verif_start_times_of_some_trials_only_are_warned_of() {
    let folder = Folder::good();
    let trials = TRIALS.replace(",use\n", ",use,start_time_s\n").replace(",train\n", ",train,\n");
    folder.write("trials.csv", trials.replace(",test\n", ",test,20\n"));
    says(
        &folder.only_warning("trials.csv", 2),
        "1 of 2 trials of participant `P01` have no `start_time_s`: all are taken by their order",
        "in every row",
    );
    // A trial that is not read needs none.
    folder.spoil("trials.csv", "1,train", "1,ignore");
    let warnings = folder.read().unwrap().warnings;
    assert_eq!(warnings.len(), 1, "{}", list(&warnings));
    says(&warnings[0], "no trial has use `train`", "");
}

#[test]
fn verif_the_models_own_weight_under_a_flipped_arm_is_warned_of() {
    let folder = Folder::spoilt("study.toml", "\"passive\"]", "\"passive\", \"gravity\"]");
    let trials = TRIALS.replace(",use\n", ",use,arm\n").replace(",train\n", ",train,\n");
    folder.write("trials.csv", trials.replace(",test\n", ",test,flipped\n"));
    says(&folder.only_warning("trials.csv", 3), "the weight of the model's own bodies is not turned", "out of include");
}
