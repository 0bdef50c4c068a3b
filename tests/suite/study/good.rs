use approx::assert_relative_eq;
use carpus::study::{AngleUnit, Contraction, Direction, MomentPart, Severity, Sex, Side, Study, TrialUse, write};

use super::folder::{Folder, PARTICIPANTS, SAMPLES, TOML, TRIAL_HEADER, TRIALS};

#[test]
fn verif_a_good_study_is_read_without_a_warning() {
    let folder = Folder::good();
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(study.warnings, []);
    assert_eq!(study.settings.name, "Two muscles");
    assert_eq!(study.settings.model, folder.path("wrist.osim"));
    assert_eq!(study.settings.active_muscles, ["ECRL", "FCR"]);
    assert_eq!(study.settings.columns.emg, ["emg_ECRL", "emg_FCR"]);
    assert_eq!(study.settings.columns.angle_unit, AngleUnit::Degrees);
    assert!(study.settings.dynamometer.includes(MomentPart::Passive));
    assert!(!study.settings.dynamometer.includes(MomentPart::Gravity));
    assert_eq!(Study::read(folder.path("")).unwrap(), study, "the folder stands for its study.toml");
}

#[test]
fn verif_units_are_converted_once_at_the_border() {
    let folder = Folder::good();
    let study = folder.read().unwrap();
    // 0.005 N·m per deg/s, the Biodex motor of the dissertation, is 0.2865 N·m·s/rad.
    assert_relative_eq!(study.settings.dynamometer.damping, 0.005 * 180.0 / std::f64::consts::PI, epsilon = 1e-15);
    let posture = &study.settings.posture;
    assert_eq!(posture[0].coordinate, "elbow_flexion");
    assert_relative_eq!(posture[0].value(false), std::f64::consts::FRAC_PI_2);
    assert_eq!(posture[1].value(true), -12.5);
    assert_relative_eq!(study.trials[0].posture.unwrap(), 30f64.to_radians());
    let trial = study.trial(&study.trials[1]).unwrap();
    assert_relative_eq!(trial.angle[0], -35f64.to_radians());
    assert_relative_eq!(trial.duration(), 0.49, epsilon = 1e-12);
    assert_eq!((trial.len(), trial.excitation.len(), trial.line_of_sample(0)), (SAMPLES, 2, Some(2)));
}

#[test]
fn verif_default_bounds_are_those_of_table_3_2() {
    let bounds = Folder::good().read().unwrap().settings.bounds;
    assert_relative_eq!(bounds.optimal_fiber_length.lower, 0.822);
    assert_relative_eq!(bounds.optimal_fiber_length.upper, 1.178);
    assert_relative_eq!(bounds.tendon_slack_length.lower, 0.868);
    assert_relative_eq!(bounds.tendon_slack_length.upper, 1.132);
    assert_relative_eq!(bounds.max_isometric_force.lower, 0.42);
    assert_relative_eq!(bounds.max_isometric_force.upper, 2.514);
    let folder = Folder::good();
    folder.write("study.toml", format!("{TOML}\n[personalization]\ntendon_slack_length = [90, 110.5]\n"));
    let bounds = folder.read().unwrap().settings.bounds;
    assert_relative_eq!(bounds.tendon_slack_length.upper, 1.105);
    assert_relative_eq!(bounds.max_isometric_force.upper, 2.514);
}

#[test]
fn verif_tables_are_read_whole() {
    let folder = Folder::good();
    folder.write(
        "ultrasound.csv",
        "participant,muscle,posture_deg,muscle_belly_length_m,external_tendon_length_m,cross_sectional_area_m2,\
         pennation_angle_deg\nP01,FCR,0,0.16,0.12,0.0002,9\n",
    );
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    let participant = study.participant("P01").unwrap();
    assert_eq!((participant.mass, participant.height), (Some(70.5), Some(1.75)));
    assert_eq!((participant.sex, participant.side), (Some(Sex::Female), Some(Side::Right)));
    assert_eq!(participant.segment_lengths, [("hand".to_owned(), 0.19), ("forearm".to_owned(), 0.26)]);
    assert_eq!((participant.mvc_flexion, participant.mvc_extension), (Some(10.0), Some(6.0)));
    let trial = &study.trials[1];
    assert_eq!((trial.contraction, trial.direction), (Contraction::Isotonic, Direction::Extension));
    assert_eq!((trial.usage, trial.repetition, trial.effort_percent), (TrialUse::Test, Some(1), Some(50.0)));
    assert_eq!((trial.posture, trial.start_time, trial.name.as_str()), (None, None, "dyn"));
    assert_eq!((trial.index, trial.place, trial.arm_flipped), (1, 1, false));
    assert_relative_eq!(study.ultrasound[0].pennation_angle.unwrap(), 9f64.to_radians());
    assert_eq!((study.ultrasound[0].fascicle_length, study.ultrasound[0].line), (None, 2));
    assert_eq!(study.input_files().len(), 7);
}

#[test]
fn verif_a_participant_may_have_an_own_model() {
    let folder = Folder::good();
    folder.write("participants.csv", "participant,model\nP01,scaled/P01.osim\nP02,\n");
    folder.write("scaled/P01.osim", "");
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(study.participants[0].model, folder.path("scaled/P01.osim"));
    assert_eq!(study.participants[1].model, folder.path("wrist.osim"));
    std::fs::remove_file(folder.path("scaled/P01.osim")).unwrap();
    let error = folder.only_error("scaled/P01.osim", None);
    super::folder::says(&error, "model not found", "participants.csv:2");
}

#[test]
fn verif_one_channel_may_drive_several_muscles_and_columns_may_be_renamed() {
    let folder = Folder::good();
    folder.write(
        "study.toml",
        format!(
            "{TOML}\n[columns]\ntime = \"t\"\nangle = \"Position\"\nangle_unit = \"rad\"\nmoment = \"Torque\"\n\
             ignore = [\"Trigger\"]\n[columns.emg]\nECRL = \"Ch 1\"\nFCR = \"Ch 1\"\n"
        ),
    );
    let mut text = "t,Trigger,Ch 1,Torque,Position\r\n".to_owned();
    for i in 0..30 {
        text += &format!("{},x,{},{},{}\r\n", i as f64 * 0.01, 0.1 + 0.001 * i as f64, 2.0, 0.52 + 1e-4 * i as f64);
    }
    folder.write("data/iso.csv", format!("\u{feff}{text}"));
    folder.spoil("trials.csv", "P01,data/dyn.csv,isotonic,50,extension,,1,test\n", "");
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(study.warnings, []);
    let trial = study.trial(&study.trials[0]).unwrap();
    assert_eq!(trial.excitation[0], trial.excitation[1]);
    assert_eq!((trial.angle[0], trial.time[1], trial.velocity.clone()), (0.52, 0.01, None));
}

#[test]
fn verif_velocity_is_read_when_it_is_there() {
    let folder = Folder::good();
    let mut text = format!("{TRIAL_HEADER},velocity_deg_per_s\n");
    for i in 0..SAMPLES {
        let t = i as f64 * 0.01;
        let (angle, velocity) = (-35.0 * (6.0 * t).cos(), 210.0 * (6.0 * t).sin());
        text += &format!("{t},{angle},-3,{},{},{velocity}\n", 0.3 + 0.1 * t, 0.1 + 0.1 * t);
    }
    folder.write("data/dyn.csv", text);
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(study.warnings, []);
    let trial = study.trial(&study.trials[1]).unwrap();
    assert_relative_eq!(trial.velocity.unwrap()[7], (210.0 * 0.42f64.sin()).to_radians(), epsilon = 1e-12);
}

#[test]
fn verif_ignored_trials_are_not_read() {
    let folder = Folder::spoilt("trials.csv", "1,test", "1,ignore");
    std::fs::remove_file(folder.path("data/dyn.csv")).unwrap();
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        (study.trials.len(), study.trials_of("P01").count(), study.load_trials("P01").unwrap().len()),
        (2, 1, 1)
    );
}

#[test]
fn verif_reading_is_the_same_at_any_number_of_threads() {
    let folder = Folder::good();
    folder.write("participants.csv", PARTICIPANTS.replace("P01", "P1"));
    folder.write("data/iso.csv", "a\n1\n");
    let read = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| folder.read().unwrap_err())
    };
    assert_eq!(read(1), read(4));
}

#[test]
fn verif_the_arm_may_be_flipped() {
    let folder = Folder::good();
    for (words, expected) in [(["", "flipped"], [false, true]), (["Upright", "upright"], [false, false])] {
        let [first, second] = words.map(|word| format!(",{word}\n"));
        let trials = TRIALS.replace(",use\n", ",use,arm\n").replace(",train\n", &format!(",train{first}"));
        folder.write("trials.csv", trials.replace(",test\n", &format!(",test{second}")));
        let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(study.trials.iter().map(|t| t.arm_flipped).collect::<Vec<_>>(), expected, "{words:?}");
        assert_eq!(study.warnings, []);
        // What is written is read again.
        let trials = study.load_trials("P01").unwrap();
        let listed: Vec<_> = trials.iter().map(|t| (t, t.info.file_as_written.clone())).collect();
        let rows: Vec<String> = write::trial_list_rows(&listed).iter().map(|row| row.join(",")).collect();
        folder.write("trials.csv", rows.join("\n"));
        let again = folder.read().unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(again.trials, study.trials);
    }
}

#[test]
fn verif_places_are_counted_per_participant_and_ignored_rows_keep_theirs() {
    let folder = Folder::good();
    folder.spoil("participants.csv", "P01,", "P02,70,1.7,m,right,0.19,0.26,10,6\nP01,");
    for name in ["a", "b"] {
        std::fs::copy(folder.path("data/iso.csv"), folder.path(&format!("data/{name}.csv"))).unwrap();
    }
    let header = TRIALS.lines().next().unwrap();
    folder.write(
        "trials.csv",
        format!(
            "{header}\nP01,data/iso.csv,isometric,25,flexion,30,0,train\nP02,data/a.csv,isometric,25,flexion,30,0,\
             train\n\
             P01,data/b.csv,isometric,25,flexion,30,1,ignore\nP01,data/dyn.csv,isotonic,50,extension,,0,test\n"
        ),
    );
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(study.trials_of("P01").map(|t| (t.index, t.place)).collect::<Vec<_>>(), [(0, 0), (3, 2)]);
    assert_eq!(study.trials_of("P02").map(|t| (t.index, t.place)).collect::<Vec<_>>(), [(1, 0)]);
    assert_eq!(study.trials[0].repetition, Some(0), "a lab may count from 0");
}

#[test]
fn verif_a_model_that_is_not_needed_may_be_missing() {
    let folder = Folder::good();
    folder.write("participants.csv", "participant,model\nP01,scaled/P01.osim\nP02,\n");
    let needing = |name: &str| Study::read_tables_for(folder.path("study.toml"), |p| p.name == name);
    assert!(needing("P02").is_ok() && needing("nobody").is_ok());
    let errors = needing("P01").unwrap_err().errors;
    assert_eq!((errors.len(), errors[0].file.clone()), (1, folder.path("scaled/P01.osim")));
    std::fs::remove_file(folder.path("wrist.osim")).unwrap();
    assert!(needing("nobody").is_ok());
    super::folder::says(&needing("P02").unwrap_err().errors[0], "model not found", "study.toml:3");
}

#[test]
fn verif_trial_out_of_range_of_its_coordinate_is_a_warning_and_far_out_of_it_an_error() {
    let folder = Folder::good();
    let study = folder.read().unwrap();
    let trial = study.trial(&study.trials[1]).unwrap();
    let range = |deg: f64| trial.check_against_range("flexion", false, [-deg.to_radians(), deg.to_radians()]);
    assert_eq!(range(35.0), None);
    assert_eq!(range(34.95), None, "an encoder's noise is allowed");
    for (deg, severity) in [(34.0, Severity::Warning), (23.1, Severity::Warning), (22.9, Severity::Error)] {
        let problem = range(deg).expect("35° is outside");
        assert_eq!(problem.severity, severity, "±{deg}°");
        assert_eq!((problem.file.clone(), problem.line), (folder.path("data/dyn.csv"), Some(2)));
        super::folder::says(&problem, &format!("-{deg:.2}° to {deg:.2}°; farthest: -35.00°"), "zero and the sign");
    }
    // The same numbers as metres.
    let farthest = trial.angle.iter().fold(0.0_f64, |most, q| most.max(q.abs()));
    for (beyond, severity) in [(0.019, Severity::Warning), (0.021, Severity::Error)] {
        let [lower, upper] = [beyond - farthest, farthest - beyond];
        let problem = trial.check_against_range("slide", true, [lower, upper]).expect("outside");
        assert_eq!(problem.severity, severity, "{beyond} m");
        let said = format!("a position outside the range of coordinate `slide`, {lower:.4} m to");
        super::folder::says(&problem, &said, "");
    }
}

/// Names of the trials of these rows, `participant,file`.
fn names_of(rows: &[&str]) -> Vec<String> {
    let folder = Folder::good();
    let trial = std::fs::read_to_string(folder.path("data/iso.csv")).unwrap();
    let mut table = "participant,file,contraction,effort_percent,direction\n".to_owned();
    for row in rows {
        table += &format!("{row},isometric,25,flexion\n");
        folder.write(row.split_once(',').unwrap().1, &trial);
    }
    folder.write("participants.csv", "participant\nP01\nP02\n");
    folder.write("trials.csv", table);
    folder.read().unwrap_or_else(|e| panic!("{e}")).trials.into_iter().map(|t| t.name).collect()
}

#[test]
fn verif_a_trial_is_its_row_and_not_its_files_name() {
    assert_eq!(names_of(&["P01,P01/t.csv", "P01,P01/day2/t.csv", "P01,a.csv"]), ["P01_t", "day2_t", "a"]);
    assert_eq!(names_of(&["P01,P01/t.csv", "P02,P02/t.csv"]), ["t", "t"], "participants have folders of their own");
    // Other case is the same file on some disks; another extension is the same name.
    assert_eq!(names_of(&["P01,x/T.csv", "P01,y/t.csv"]), ["x_T", "y_t"]);
    assert_eq!(names_of(&["P01,x/t.csv", "P01,x/t.txt"]), ["x_t_row_2", "x_t_row_3"]);
    // Folders that make the same name again.
    let names = names_of(&["P01,a/b/t.csv", "P01,c/b/t.csv", "P01,b_t.csv", "P01,b/t.csv"]);
    let mut different = names.clone();
    different.sort();
    different.dedup();
    assert_eq!(different.len(), 4, "{names:?}");
    assert_eq!(names[..2], ["a_b_t", "c_b_t"]);
}

#[test]
fn verif_backslashes_between_folders_are_read_as_windows_does() {
    let folder = Folder::spoilt("trials.csv", "data/iso.csv", r"data\iso.csv");
    folder.spoil("study.toml", "\"wrist.osim\"", r"'models\wrist.osim'");
    folder.write("models/wrist.osim", "<OpenSimDocument Version=\"40000\"/>");
    folder.write("participants.csv", "participant,model\nP01,models\\wrist.osim\n");
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(study.trials[0].file, folder.path("data/iso.csv"));
    assert_eq!(study.settings.model, folder.path("models/wrist.osim"));
    assert_eq!(study.participants[0].model, folder.path("models/wrist.osim"));
    // A file whose very name has one is that file.
    if cfg!(unix) {
        folder.write(r"data\iso.csv", std::fs::read(folder.path("data/dyn.csv")).unwrap());
        assert_eq!(folder.read().unwrap().trials[0].file, folder.path(r"data\iso.csv"));
    }
    // One file under two spellings is one file.
    let twice = Folder::spoilt("trials.csv", "data/dyn.csv", r"data\iso.csv");
    assert!(twice.errors()[0].to_string().contains("stands here again"), "{}", twice.errors()[0]);
}
