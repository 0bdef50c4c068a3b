use carpus::study::Fault;

use super::folder::{Folder, TOML, TRIAL_HEADER, list, says};

const FILE: &str = "data/iso.csv";

#[test]
fn verif_missing_trial_file_is_named_with_the_row_that_names_it() {
    let folder = Folder::good();
    std::fs::remove_file(folder.path(FILE)).unwrap();
    says(&folder.only_error(FILE, None), "trial file not found", "trials.csv:2; paths are relative");
}

#[test]
fn verif_missing_column_lists_those_present_and_the_nearest() {
    let folder = Folder::spoilt(FILE, "emg_FCR", "EMG FCR");
    let errors = folder.errors();
    assert_eq!(errors.len(), 2, "{}", list(&errors));
    says(&errors[0], "no column `emg_FCR` (EMG of FCR, 0 to 1); columns present: time_s, angle_deg", "`EMG FCR`");
    assert!(matches!(errors[1].fault, Fault::UnknownColumn { .. }));
    let folder = Folder::good();
    folder.write("study.toml", format!("{TOML}[columns]\nvelocity = \"speed\"\n"));
    assert!(folder.errors().iter().all(|e| e.to_string().contains("no column `speed`")), "a named column is required");
}

#[test]
fn verif_unknown_column_in_a_trial() {
    let folder = Folder::spoilt(FILE, TRIAL_HEADER, "time_s,angle_deg,moment_n_m,emg_ECRL,emg_FCR,trigger");
    let text = std::fs::read_to_string(folder.path(FILE)).unwrap();
    let rows: Vec<String> =
        text.lines().enumerate().map(|(i, l)| if i == 0 { l.into() } else { format!("{l},1") }).collect();
    folder.write(FILE, rows.join("\n"));
    says(&folder.only_error(FILE, 1), "unknown column `trigger`", "[columns] ignore");
}

#[test]
fn verif_duplicate_column() {
    let folder = Folder::spoilt(FILE, "emg_FCR", "emg_ECRL");
    says(&folder.only_error(FILE, 1), "column `emg_ECRL` stands twice", "");
}

#[test]
fn verif_time_must_increase() {
    let folder = Folder::spoilt(FILE, "0.100,", "0.085,");
    says(&folder.only_error(FILE, 12), "time does not increase: 0.085 s after 0.09 s", "sort the rows");
    let folder = Folder::spoilt(FILE, "0.100,", "0.090,");
    says(&folder.only_error(FILE, 12), "time 0.09 s stands twice", "delete one");
}

/// Work and memory grow with a trial's duration: in another unit than seconds it is refused, and the unit named.
#[test]
fn verif_time_in_another_unit_is_refused() {
    let times = |factor: f64, gap: f64| {
        let folder = Folder::good();
        let text = std::fs::read_to_string(folder.path(FILE)).unwrap();
        let scaled = text.lines().enumerate().map(|(i, line)| match line.split_once(',') {
            Some((time, rest)) if i > 0 => {
                let late = if i > 10 { gap } else { 0.0 };
                format!("{},{rest}", factor * time.parse::<f64>().unwrap() + late)
            }
            _ => line.to_owned(),
        });
        folder.write(FILE, scaled.collect::<Vec<_>>().join("\n"));
        folder
    };
    says(&times(1e3, 0.0).only_error(FILE, None), "median time step 10 s", "are these milliseconds?");
    says(&times(1e6, 0.0).only_error(FILE, None), "median time step 10000 s", "are these microseconds?");
    says(
        &times(2e3, 0.0).only_error(FILE, None),
        "s to 0.4 s and a trial of at most 3600 s",
        "are these milliseconds?",
    );
    says(&times(1e-5, 0.0).only_error(FILE, None), "expected steps of 0.000001 s to 0.4 s", "are these hours?");
    says(&times(1e-12, 0.0).only_error(FILE, None), "expected steps of 0.000001 s", "time is read in seconds");
    // A gap that is allowed, of a size that no trial has.
    let folder = times(1.0, 1e9);
    folder.write("study.toml", format!("{TOML}[checks]\nmax_gap_s = 1e10\n"));
    says(&folder.only_error(FILE, None), "a trial of at most 3600 s", "cut a long recording");
}

#[test]
fn verif_more_samples_than_memory_holds_are_refused() {
    let folder = Folder::good();
    let mut text = format!("{TRIAL_HEADER}\n");
    for i in 0..=carpus::study::MAX_SAMPLES {
        text.push_str(&format!("{},0,1,0,0\n", i as f64 * 1e-3));
    }
    folder.write(FILE, text);
    let found = folder.only_error(FILE, carpus::study::MAX_SAMPLES + 2);
    says(&found, "more than 1000000 samples in one trial", "average it to fewer samples per second");
}

#[test]
fn verif_a_gap_is_an_error_at_the_row_after_it_unless_allowed() {
    let folder = Folder::good();
    let text = std::fs::read_to_string(folder.path(FILE)).unwrap();
    let kept: Vec<&str> = text.lines().enumerate().filter(|(i, _)| !(10..16).contains(i)).map(|(_, l)| l).collect();
    folder.write(FILE, kept.join("\n"));
    says(
        &folder.only_error(FILE, 11),
        "gap of 0.0700 s before this row; expected at most 0.0500 s (median step 0.0100 s)",
        "max_gap_s",
    );
    folder.write("study.toml", format!("{TOML}[checks]\nmax_gap_s = 0.08\n"));
    assert!(folder.read().is_ok());
}

#[test]
fn verif_cells_that_are_not_numbers() {
    for (cell, message, hint) in [
        ("NaN", "expected a finite number, found `NaN`", "does not guess"),
        ("", "expected a finite number, found an empty cell", "does not guess"),
        ("n/a", "expected a finite number, found `n/a`", ""),
        ("inf", "expected a finite number, found `inf`", ""),
        ("-1.7e308", "expected a number of at most 1e12 in size, found `-1.7e308`", ""),
        ("\"2,5\"", "expected a finite number, found `2,5`", "point as decimal mark"),
    ] {
        let folder = Folder::with_line(FILE, 7, &format!("0.05,30,{cell},0.05,0.01"));
        let error = folder.only_error(FILE, 7);
        says(&error, message, hint);
        says(&error, "column `moment_n_m`", "");
    }
}

#[test]
fn verif_bad_cells_of_a_column_are_counted() {
    let folder = Folder::good();
    let text = std::fs::read_to_string(folder.path(FILE)).unwrap();
    let spoilt: Vec<String> = text
        .lines()
        .enumerate()
        .map(|(i, l)| if i >= 5 { l.rsplit_once(',').unwrap().0.to_owned() + ",x" } else { l.to_owned() })
        .collect();
    folder.write(FILE, spoilt.join("\n"));
    says(&folder.only_error(FILE, 6), "column `emg_FCR`: expected a finite number, found `x` (and 45 more)", "");
}

#[test]
fn verif_line_numbers_survive_blank_lines_and_windows_ends() {
    let folder = Folder::good();
    let text = std::fs::read_to_string(folder.path(FILE)).unwrap().replace('\n', "\r\n");
    let (head, tail) = text.split_once("0.030,").unwrap();
    folder.write(FILE, format!("{head}\r\n\r\n0.020,{tail}"));
    // Header, 0.00, 0.01, 0.02, two blank lines, then the repeated time.
    says(&folder.only_error(FILE, 7), "time 0.02 s stands twice", "");
}

#[test]
fn verif_emg_far_outside_is_an_error() {
    let folder = Folder::with_line(FILE, 9, "0.07,30,1,0.05,1.2");
    let error = folder.only_error(FILE, 9);
    says(&error, "column `emg_FCR`: 1 of 50 samples are above 1, highest 1.2000; expected 0 to 1", "percent or mV");
    let folder = Folder::with_line(FILE, 9, "0.07,30,1,-0.3,0.1");
    says(&folder.only_error(FILE, 9), "1 of 50 samples are below 0, lowest -0.3000", "rectified");
}

#[test]
fn verif_emg_outside_by_noise_is_clamped_and_warned_of() {
    let folder = Folder::with_line(FILE, 9, "0.07,30,1,-0.01,1.04");
    let study = folder.read().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(study.warnings.len(), 2, "{}", list(&study.warnings));
    says(&study.warnings[0], "lowest -0.0100; expected 0 to 1 (part of MVC); clamped", "");
    says(&study.warnings[1], "highest 1.0400; expected 0 to 1 (part of MVC); clamped", "");
    let trial = study.trial(&study.trials[0]).unwrap();
    assert_eq!((trial.excitation[0][7], trial.excitation[1][7]), (0.0, 1.0));
}

#[test]
fn verif_too_few_samples_and_empty_files() {
    let folder = Folder::good();
    folder.write(FILE, format!("{TRIAL_HEADER}\n0,30,1,0.1,0.1\n0.01,30,1,0.1,0.1\n"));
    says(&folder.only_error(FILE, None), "only 2 samples; expected at least 10", "");
    folder.write(FILE, "");
    says(&folder.only_error(FILE, None), "trial file is empty", "");
    folder.write(FILE, TRIAL_HEADER);
    says(&folder.only_error(FILE, None), "only 0 samples", "");
}

#[test]
fn verif_ragged_rows_are_counted() {
    let folder = Folder::with_line(FILE, 20, "0.18,30");
    says(&folder.only_error(FILE, 20), "row has 2 fields, the header has 5", "");
}

#[test]
fn verif_a_folder_or_other_bytes_instead_of_a_file() {
    let folder = Folder::spoilt("trials.csv", FILE, "data");
    assert!(matches!(folder.only_error("data", None).fault, Fault::Unreadable { .. }));
    let folder = Folder::good();
    folder.write(FILE, b"time_s,\xff\xfe\n1,2\n");
    says(&folder.only_error(FILE, 1), "not UTF-8", "UTF-8");
}
