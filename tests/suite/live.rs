//! Reports that compute, opened in Chromium: what a person does there gives the numbers and the bytes of the program.

use std::path::Path;
use std::process::Command as Process;

use carpus::osim::OsimFile;
use carpus::report::results::{Results, Use};
use serde_json::{Value, json};

use crate::user_loop::{carpus, column, json as json_of, looped, read, root, small_study};

/// Errors of a page and of the program agree so well, relatively: the two have another maths library.
const SAME: f64 = 1e-9;

/// Errors of a trial agree so well, relatively, where its steps of integration are those of other parameters.
const AS_INTEGRATED: f64 = 1e-4;

/// What a page showed and saved.
fn seen_in_browser(report: &Path, plan: &Value) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    std::fs::write(file("plan.json"), plan.to_string()).unwrap();
    let mut browser = Process::new("node");
    let script = root("crates/carpus-web/page/test/browser.mjs");
    browser.arg(script).arg(report).args([file("plan.json"), file("seen.json")]);
    let output = browser.output().expect("Node is here");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    json_of(file("seen.json"))
}

/// Nothing was asked of any network, nothing went wrong, no name was run.
pub fn assert_calm(seen: &Value) {
    assert_eq!(seen["requests"], json!([]));
    assert_eq!(seen["complaints"], json!([]));
    assert_eq!(seen["executed"], false);
}

pub fn downloaded(seen: &Value, name: &str) -> Vec<u8> {
    let text = seen["downloads"][name].as_str().unwrap_or_else(|| panic!("{name} was not saved"));
    let value =
        |c: u8| b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/".iter().position(|x| *x == c);
    let mut out = Vec::new();
    for four in text.as_bytes().chunks(4) {
        let values: Vec<usize> = four.iter().map_while(|c| value(*c)).collect();
        let word = values.iter().fold(0, |w, v| w << 6 | v) << (6 * (4 - values.len()));
        out.extend((0..values.len() - 1).map(|i| (word >> (16 - 8 * i)) as u8));
    }
    out
}

/// Moments of a trial as the page saved them.
fn moments(seen: &Value, trial: &str, which: &str) -> Vec<f64> {
    let bytes = downloaded(seen, "trials.csv");
    let mut reader = csv::Reader::from_reader(&bytes[..]);
    let at = reader.headers().unwrap().iter().position(|h| h == which).unwrap();
    let rows = reader.records().map(Result::unwrap).filter(|row| &row[0] == trial);
    rows.map(|row| row[at].parse().unwrap()).collect()
}

/// Whether moments are those that the program wrote, to the last of its nine digits.
fn are_as_written(moments: &[f64], written: &[f64]) -> bool {
    let half_a_digit = |v: f64| 0.5001 * 10f64.powf(v.abs().log10().floor() - 8.0);
    moments.len() == written.len() && moments.iter().zip(written).all(|(a, b)| (a - b).abs() <= half_a_digit(*b))
}

/// Mean error (NRMSE) of the training trials with the last model of a folder of results.
fn training_error(folder: &Path) -> f64 {
    let results = Results::parse(&read(folder.join("P01/results.json"))).unwrap();
    results.last_model().unwrap().errors_of(Use::Train).unwrap().nrmse.unwrap()
}

#[test]
#[cfg_attr(not(has_browser), ignore = "needs Chromium (CARPUS_CHROMIUM), Node and npm ci in crates/carpus-web/page")]
fn verif_a_slider_gives_the_curve_and_the_file_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let path = |relative: &str| folder.path().join(relative);
    let study = small_study(&path("given"));
    let compare = |model: Option<&Path>, out: &str| {
        let mut command = carpus();
        command.arg("compare").arg(&study).arg("--out").arg(path(out));
        if let Some(model) = model {
            command.arg("--model").arg(model);
        }
        command.assert().success();
    };
    compare(None, "compared");
    let plan = json!({
        "fields": [["ECRB", 1, 0.0601], ["FCU", 2, 0.2402], ["FCR", 0, 512.5]], "motion": true,
    });
    let seen = seen_in_browser(&path("compared/P01/report.html"), &plan);
    assert_calm(&seen);

    // The same change made by the program.
    let mut file = OsimFile::read(root("models/wrist.osim")).unwrap();
    let changes = [
        ("ECRB", "optimal_fiber_length", 0.0601),
        ("FCU", "tendon_slack_length", 0.2402),
        ("FCR", "max_isometric_force", 512.5),
    ];
    file.set_muscle_properties(&changes).unwrap();
    assert_eq!(downloaded(&seen, "model.osim"), file.document.bytes(), "model.osim");
    std::fs::write(path("changed.osim"), file.document.bytes()).unwrap();
    compare(Some(&path("changed.osim")), "changed");
    for (which, errors, out) in [("as_given_n_m", "asGiven", "compared"), ("now_n_m", "dragged", "changed")] {
        for trial in ["isometric_25_flexion_-30deg_1", "isotonic_25_flexion_2", "passive_2"] {
            let of_program = column(path(&format!("{out}/P01/series/{trial}.csv")), "simulated_n_m");
            assert!(are_as_written(&moments(&seen, trial, which), &of_program), "{trial}, {which}");
        }
        let differ = (seen[errors]["train"].as_f64().unwrap() / training_error(&path(out)) - 1.0).abs();
        assert!(differ < SAME, "{errors}: {differ:.1e}");
    }
    assert_the_model_moves(&seen, &path("changed/P01/series"));
}

/// The model in the chosen trial plays, follows the pointer, and its muscles do what those of the program do.
///
/// - `series`: of the program with the same parameters
fn assert_the_model_moves(seen: &Value, series: &Path) {
    /// Moments and forces are as accurate as a fit needs them, relative to the largest.
    const AS_FITTED: f64 = 2e-3;
    let motion = &seen["motion"];
    let sample = |which: &str| motion[which].as_u64().unwrap();
    assert!(sample("after") > sample("before") && sample("pointed") < sample("before"), "{motion}");
    assert_eq!(motion["lit"], json!([1, 1]), "its curve and its sliders");
    let trial = motion["trial"].as_str().unwrap().split(',').next().unwrap();
    let bytes = downloaded(seen, &format!("{trial}_muscles.csv"));
    let mut reader = csv::Reader::from_reader(&bytes[..]);
    let heads: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    let rows: Vec<Vec<f64>> =
        reader.records().map(|r| r.unwrap().iter().map(|v| v.parse().unwrap()).collect()).collect();
    for (at, head) in heads.iter().enumerate().skip(1) {
        let name = head.replace("_force_n", "_tendon_force_n");
        let of_program = column(series.join(format!("{trial}.csv")), &name);
        let largest = of_program.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        assert_eq!(of_program.len(), rows.len());
        let differ = rows.iter().zip(&of_program).fold(0.0f64, |m, (row, v)| m.max((row[at] - v).abs()));
        assert!(differ < AS_FITTED * largest, "{head}: {differ:.1e} of {largest:.1e}");
    }
    let starts = |file: String, start: &str| String::from_utf8_lossy(&downloaded(seen, &file)).starts_with(start);
    assert!(starts(format!("{trial}_muscles.svg"), "<svg") && starts(format!("{trial}_muscles.png"), "\u{fffd}PNG"));
    assert!(downloaded(seen, &format!("{trial}.png")).len() > 5_000, "a picture");
    assert_eq!(seen["nameless"], json!([]), "controls without a name");
}

#[test]
#[cfg_attr(not(has_browser), ignore = "needs Chromium (CARPUS_CHROMIUM), Node and npm ci in crates/carpus-web/page")]
fn verif_an_effect_switched_on_lowers_the_error_as_the_ledger_says() {
    let report = looped().path("with/P01/report.html");
    let results = Results::parse(&read(looped().path("with/P01/results.json"))).unwrap();
    let step = &results.ledger.as_ref().unwrap().steps[2];
    let stiffness = step.parameters["joint_stiffness.stiffness"].value;
    let label = &results.ledger.as_ref().unwrap().steps[3].label;
    let plan = json!({
        "fields": [], "effect": "joint_stiffness", "values": [stiffness], "model": label, "files": 2,
        "last": "torque_drift", "fit": true,
    });
    let seen = seen_in_browser(&report, &plan);
    assert_calm(&seen);
    let of = |which: &str, use_of: &str| seen[which][use_of].as_f64().unwrap();
    assert!(of("withEffect", "train") < 0.9 * of("asGiven", "train"), "{}", seen["withEffect"]);
    for (which, model) in [("asGiven", 0), ("ofModel", 3)] {
        let of_program = results.models[model].errors_of(Use::Train).unwrap().nrmse.unwrap();
        let differ = (of(which, "train") / of_program - 1.0).abs();
        assert!(differ < SAME, "{which}: {differ:.1e}");
    }
    // The waterfall ends where the errors are, and its steps are what is left without those after them.
    let fall = |which: &str| -> Vec<f64> {
        seen[which].as_array().unwrap().iter().map(|step| step[0].as_f64().unwrap()).collect()
    };
    let given = of("asGiven", "train");
    let of_effect = [given, given, of("withEffect", "train")];
    assert_eq!(fall("fallOfEffect"), of_effect);
    let of_model = fall("fallOfModel");
    assert_eq!(of_model.len(), 4, "as given, muscles, two effects: {of_model:?}");
    assert_eq!([of_model[0], of_model[3]], [given, of("ofModel", "train")]);
    let differ = (of_model[2] / of("withoutLast", "train") - 1.0).abs();
    assert!(differ < AS_INTEGRATED, "{differ:.1e}");
    assert_eq!(downloaded(&seen, "model.osim"), std::fs::read(looped().path("with/P01/model.osim")).unwrap());
    assert_eq!(downloaded(&seen, "effects.toml"), std::fs::read(looped().path("with/P01/effects.toml")).unwrap());
    // A fit of the muscles in the page is that of the program.
    let of_program = results.models[1].errors_of(Use::Train).unwrap().nrmse.unwrap();
    let differ = (of("fitted", "train") / of_program - 1.0).abs();
    assert!(differ < 1e-5, "fitted in the page: {differ:.1e}");
}

#[test]
#[cfg_attr(not(has_browser), ignore = "needs Chromium (CARPUS_CHROMIUM), Node and npm ci in crates/carpus-web/page")]
fn verif_a_hostile_name_is_only_text() {
    const NAME: &str = "<img src=x onerror=window.executed=1>";
    let folder = tempfile::tempdir().unwrap();
    let study = small_study(&folder.path().join("given"));
    let given = study.parent().unwrap();
    let change = |file: &Path, from: &str, to: &str| {
        let text = read(file.to_owned());
        assert!(text.contains(from), "{}: {from}", file.display());
        std::fs::write(file, text.replace(from, to)).unwrap();
    };
    let escaped = NAME.replace('<', "&lt;").replace('>', "&gt;");
    change(&given.join("wrist.osim"), "\"FCR\"", &format!("\"{escaped}\""));
    change(&study, "\"FCR\"", &format!("\"{NAME}\""));
    change(&study, "name = \"Carpus demo\"", "name = \"</script><script>window.executed=1</script>\"");
    for file in std::fs::read_dir(given.join("data/P01")).unwrap() {
        change(&file.unwrap().path(), "emg_FCR", &format!("emg_{NAME}"));
    }
    carpus().arg("compare").arg(&study).arg("--out").arg(folder.path().join("out")).assert().success();
    let plan = json!({ "fields": [] });
    let seen = seen_in_browser(&folder.path().join("out/P01/report.html"), &plan);
    assert_calm(&seen);
    assert!(seen["text"].as_str().unwrap().contains(NAME));
}
