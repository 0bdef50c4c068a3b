use carpus::study::{Fault, MAX_LISTED};

use super::folder::{Folder, PARTICIPANTS, TRIALS, list, says};

#[test]
fn verif_missing_tables_are_reported_together() {
    let folder = Folder::good();
    std::fs::remove_file(folder.path("participants.csv")).unwrap();
    std::fs::remove_file(folder.path("trials.csv")).unwrap();
    let errors = folder.errors();
    assert_eq!(errors.len(), 2, "{}", list(&errors));
    assert!(errors.iter().all(|e| matches!(e.fault, Fault::MissingFile { .. })));
}

#[test]
fn verif_unknown_column_is_an_error_with_a_near_name() {
    let folder = Folder::spoilt("participants.csv", "mass_kg", "mas_kg");
    says(&folder.only_error("participants.csv", 1), "unknown column `mas_kg`", "did you mean `mass_kg`?");
    let folder = Folder::spoilt("trials.csv", ",repetition,", ",rep,");
    says(&folder.only_error("trials.csv", 1), "unknown column `rep`", "");
}

#[test]
fn verif_missing_column_lists_those_present() {
    let folder = Folder::spoilt("trials.csv", "contraction", "contractions");
    let errors = folder.errors();
    assert_eq!(errors.len(), 2, "{}", list(&errors));
    says(&errors[0], "no column `contraction`", "did you mean `contractions`?");
    says(&errors[0], "columns present: participant, file, contractions, effort_percent", "");
}

#[test]
fn verif_bad_cells_of_participants() {
    for (from, to, message) in [
        ("70.5", "70,5", "row has 10 fields, the header has 9"),
        ("70.5", "heavy", "column `mass_kg`: expected a positive number, found `heavy`"),
        ("70.5", "-70", "column `mass_kg`: expected a positive number, found `-70`"),
        ("1.75", "175", "column `height_m`: 175 is not plausible in m"),
        ("0.19", "19", "column `hand_length_m`: 19 is not plausible in m"),
        ("0.19", "NaN", "column `hand_length_m`: expected a positive number, found `NaN`"),
        ("female", "femal", "unknown sex `femal`"),
        ("right", "north", "unknown side `north`"),
        ("P01", "P/01", "a name that can name a folder"),
        ("P01", "", "column `participant`: expected a name, found an empty cell"),
    ] {
        let errors = Folder::spoilt("participants.csv", from, to).errors();
        let error = errors.iter().find(|e| e.line == Some(2)).expect("an error on line 2");
        says(error, message, "");
    }
}

#[test]
fn verif_repeated_participant() {
    let folder = Folder::good();
    folder.write("participants.csv", format!("{PARTICIPANTS}\nP01,60,1.6,m,left,0.18,0.25,9,5\n"));
    says(
        &folder.only_error("participants.csv", 4),
        "participant `P01` stands here again; it stands already on line 2",
        "",
    );
}

#[test]
fn verif_bad_cells_of_trials() {
    for (from, to, message, hint) in [
        ("P01,data/iso", "P0l,data/iso", "unknown participant `P0l` (one of: P01)", "did you mean `P01`?"),
        ("isometric,25", "isometrc,25", "unknown contraction `isometrc`", "did you mean `isometric`?"),
        ("isometric,25", ",25", "expected isometric, isotonic, passive, mvc or freehand, found an empty cell", ""),
        ("isometric,25", "isometric,125", "expected 0 to 100 percent, found `125`", ""),
        ("flexion,30", "flexor,30", "unknown direction `flexor`", "did you mean `flexion`?"),
        ("flexion,30", "flexion,thirty", "column `posture_deg`: expected an angle in degrees, found `thirty`", ""),
        ("30,1,train", "30,1.5,train", "column `repetition`: expected 0, 1, 2, 3 …, found `1.5`", ""),
        ("30,1,train", "30,1,trian", "unknown use `trian` (one of: train, test, mvc, ignore)", "`train`"),
    ] {
        says(&Folder::spoilt("trials.csv", from, to).only_error("trials.csv", 2), message, hint);
    }
}

#[test]
fn verif_an_unknown_position_of_the_arm() {
    let folder = Folder::good();
    let trials = TRIALS.replace(",use\n", ",use,arm\n").replace(",train\n", ",train,fliped\n");
    folder.write("trials.csv", trials.replace(",test\n", ",test,\n"));
    says(
        &folder.only_error("trials.csv", 2),
        "`arm`: unknown position of the arm `fliped` (one of: upright, flipped)",
        "did you mean `flipped`?",
    );
}

/// Their folders of results would be one where names of folders have no case.
#[test]
fn verif_participants_that_differ_in_case_alone() {
    let folder = Folder::good();
    folder.write("participants.csv", format!("{PARTICIPANTS}\np01,60,1.6,m,left,0.18,0.25,9,5\n"));
    says(
        &folder.only_error("participants.csv", 4),
        "in other case, participant `p01` stands here again; it stands already on line 2",
        "",
    );
}

#[test]
fn verif_the_same_trial_twice() {
    let folder = Folder::good();
    folder.write("trials.csv", format!("{TRIALS}P01,data/iso.csv,isometric,25,flexion,30,2,test\n"));
    says(
        &folder.only_error("trials.csv", 4),
        "trial file `data/iso.csv` stands here again; it stands already on line 2",
        "",
    );
}

#[test]
fn verif_the_same_condition_and_repetition_twice_is_a_warning() {
    let folder = Folder::good();
    std::fs::copy(folder.path("data/iso.csv"), folder.path("data/iso2.csv")).unwrap();
    folder.write("trials.csv", format!("{TRIALS}P01,data/iso2.csv,isometric,25,flexion,30,1,test\n"));
    says(
        &folder.only_warning("trials.csv", 4),
        "same participant, condition and repetition as the trial on line 2",
        "",
    );
    // With the arm turned over it is another condition.
    let trials = TRIALS.replace(",use\n", ",use,arm\n").replace(",train\n", ",train,\n").replace(",test\n", ",test,\n");
    folder.write("trials.csv", format!("{trials}P01,data/iso2.csv,isometric,25,flexion,30,1,test,flipped\n"));
    assert_eq!(folder.read().unwrap_or_else(|e| panic!("{e}")).warnings, []);
}

#[test]
fn verif_ultrasound_of_a_stranger() {
    let folder = Folder::good();
    folder.write("ultrasound.csv", "participant,muscle,muscle_belly_length_m\nP9,FCR,0.1\nP01,FCR,160\n");
    let errors = folder.errors();
    assert_eq!(errors.len(), 2, "{}", list(&errors));
    says(&errors[0], "unknown participant `P9`", "");
    says(&errors[1], "160 is not plausible in m", "check the unit");
}

#[test]
fn verif_empty_tables_and_wrong_separators() {
    let folder = Folder::good();
    folder.write("trials.csv", "");
    says(&folder.only_error("trials.csv", None), "trials.csv is empty", "");
    folder.write("trials.csv", TRIALS.replace(',', ";"));
    says(&folder.only_error("trials.csv", 1), "separated by semicolons; expected commas", "points as decimal marks");
    folder
        .write("trials.csv", "<?xml version=\"1.0\"?>\n<OpenSimDocument>\n<Model name=\"a,b\"/>\n</OpenSimDocument>\n");
    says(
        &folder.only_error("trials.csv", 1),
        "this is XML, as a model or a setup; expected a table",
        "models are named",
    );
    folder.write("trials.csv", "[study]\nname = \"x\"\n");
    says(&folder.only_error("trials.csv", 1), "this is a file of settings; expected a table", "");
    folder.write("trials.csv", TRIALS.lines().next().unwrap());
    says(&folder.only_error("trials.csv", None), "trials.csv is empty", "");
}

#[test]
fn verif_all_problems_come_together_and_the_list_is_cut() {
    let folder = Folder::spoilt("study.toml", "damping_n_m_s_per_deg", "damping");
    folder.spoil("participants.csv", "70.5", "x");
    folder.spoil("trials.csv", "isotonic", "isotonik");
    folder.spoil("data/iso.csv", "0.020,", "0.010,");
    let errors = folder.errors();
    let files: Vec<_> = errors.iter().map(|e| e.file.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(files, ["study.toml", "participants.csv", "trials.csv", "iso.csv"], "{}", list(&errors));

    let folder = Folder::good();
    let many: String =
        (0..MAX_LISTED + 5).map(|i| format!("P01,data/none{i}.csv,isometric,25,flexion,0,,\n")).collect();
    folder.write("trials.csv", format!("{TRIALS}{many}"));
    let errors = folder.read().unwrap_err();
    assert_eq!(errors.errors.len(), MAX_LISTED + 5);
    let text = errors.to_string();
    assert_eq!(text.matches("trial file not found").count(), MAX_LISTED);
    assert!(text.ends_with("… and 5 further errors"), "{text}");
}

#[test]
fn verif_trials_stand_in_the_order_of_recording() {
    let folder = Folder::good();
    let trials =
        TRIALS.replace(",use", ",use,start_time_s").replace(",train", ",train,60").replace(",test", ",test,20");
    folder.write("trials.csv", trials);
    says(&folder.only_error("trials.csv", 3), "trial starts at 20 s, before the one on line 2", "");
}

#[test]
fn verif_names_are_checked_against_the_model() {
    let folder = Folder::good();
    folder.write("ultrasound.csv", "participant,muscle\nP01,FCU\n");
    let study = folder.read().unwrap();
    let model = folder.path("wrist.osim");
    let coordinates = ["flexion", "deviation", "elbow_flexion", "pro_sup"];
    assert_eq!(study.check_names(&model, &coordinates, &["ECRL", "FCR", "FCU"]), []);
    let problems = study.check_names(&model, &["wrist_flexion", "pro_sup"], &["ECRB", "FCR"]);
    let lines: Vec<_> = problems.iter().map(|p| p.line).collect();
    assert_eq!(lines, [Some(6), Some(11), Some(15), Some(2)], "{}", list(&problems));
    says(&problems[2], "muscle `ECRL` is not in the model", "did you mean `ECRB`?");
    let json = serde_json::to_value(&problems[2]).unwrap();
    assert_eq!((json["severity"].as_str(), json["line"].as_u64()), (Some("error"), Some(15)));
    assert_eq!(json["hint"], "did you mean `ECRB`?");
}
