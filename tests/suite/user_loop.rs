//! The loop as a user runs it: a study with a hidden effect, where the model fails, the effect added, the error falls,
//! and a step back.

use std::path::{Path, PathBuf};
use std::process::Command as Process;
use std::sync::OnceLock;

use assert_cmd::Command;
use carpus::report::results::Results;
use predicates::str::contains;
use serde_json::Value;

use crate::reference::opensim_python;

/// Stiffness that is hidden [N·m/rad].
const STIFFNESS: f64 = 1.2;
const KEPT: [&str; 6] = [
    "isometric_25_flexion_-30deg_1",
    "isometric_25_extension_+30deg_1",
    "isotonic_25_flexion_1",
    "isotonic_25_flexion_2",
    "passive_1",
    "passive_2",
];

pub fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

pub fn carpus() -> Command {
    let mut command = Command::cargo_bin("carpus").unwrap();
    command.timeout(std::time::Duration::from_secs(600)).arg("--quiet");
    command
}

/// The bundled study with few trials.
pub fn small_study(folder: &Path) -> PathBuf {
    let source = root("fixtures/demo_study");
    std::fs::create_dir_all(folder.join("data/P01")).unwrap();
    let text = |name: &str| std::fs::read_to_string(source.join(name)).unwrap();
    let settings = text("study.toml").replace("../../models/wrist.osim", "wrist.osim");
    std::fs::write(folder.join("study.toml"), settings).unwrap();
    std::fs::write(folder.join("participants.csv"), text("participants.csv")).unwrap();
    std::fs::copy(root("models/wrist.osim"), folder.join("wrist.osim")).unwrap();
    let list = text("trials.csv");
    let kept =
        list.lines().enumerate().filter(|(i, l)| *i == 0 || KEPT.iter().any(|k| l.contains(&format!("{k}.csv"))));
    std::fs::write(folder.join("trials.csv"), kept.map(|(_, l)| format!("{l}\n")).collect::<String>()).unwrap();
    for name in KEPT {
        let file = format!("data/P01/{name}.csv");
        std::fs::copy(source.join(&file), folder.join(&file)).unwrap();
    }
    folder.join("study.toml")
}

fn synth(study: &Path, effects: &[&str], noise: &str, out: &Path) {
    let mut command = carpus();
    command.arg("synth").arg(study).args(["--seed", "5", "--noise", noise, "--out"]).arg(out);
    for effect in effects {
        command.args(["--effect", effect]);
    }
    command.assert().success();
}

pub fn read(path: PathBuf) -> String {
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

pub fn json(path: PathBuf) -> Value {
    serde_json::from_str(&read(path)).unwrap()
}

pub fn column(path: PathBuf, name: &str) -> Vec<f64> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let at = reader.headers().unwrap().iter().position(|h| h == name).unwrap();
    reader.records().map(|row| row.unwrap()[at].parse().unwrap()).collect()
}

/// A study with a hidden spring, its diagnosis by two candidates, and the model with spring and drift added.
pub struct Looped {
    folder: tempfile::TempDir,
    refused: String,
}

impl Looped {
    pub fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    fn results(&self) -> Results {
        Results::parse(&read(self.path("with/P01/results.json"))).unwrap()
    }
}

pub fn looped() -> &'static Looped {
    static LOOPED: OnceLock<Looped> = OnceLock::new();
    LOOPED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = |relative: &str| folder.path().join(relative);
        let study = small_study(&path("given"));
        synth(&study, &[&format!("joint_stiffness:stiffness={STIFFNESS}")], "small", &path("hidden"));
        let hidden = path("hidden/study.toml");
        carpus()
            .arg("diagnose")
            .arg(&hidden)
            .args(["--candidates", "joint_stiffness,gravity", "--out"])
            .arg(path("with"))
            .assert()
            .success();
        // A diagnosis by the whole catalogue takes long; here it is what it would be if two effects survived.
        let file = path("with/P01/diagnosis.json");
        let mut diagnosis = json(file.clone());
        diagnosis["restricted_to"] = Value::Array(Vec::new());
        diagnosis["verdict"] = "cannot_tell".into();
        std::fs::write(&file, diagnosis.to_string()).unwrap();
        let add = |choose: &[&str]| {
            let mut command = carpus();
            command.args(["effect", "add"]).arg(&hidden).arg("joint_stiffness,torque_drift").args(choose);
            command.arg("--out").arg(path("with")).assert()
        };
        let refused = add(&[]).code(1).stdout("");
        let refused = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
        add(&["--i-choose"]).success().stdout(contains("carpus effect remove"));
        Looped { folder, refused }
    })
}

#[test]
fn verif_synth_hides_exactly_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = |relative: &str| folder.path().join(relative);
    let study = small_study(&path("given"));
    synth(&study, &["joint_stiffness:stiffness=1.2"], "none", &path("with"));
    synth(&study, &["joint_stiffness:stiffness=1.2"], "none", &path("again"));
    synth(&study, &[], "none", &path("without"));
    for name in KEPT {
        let file = format!("data/P01/{name}.csv");
        assert_eq!(read(path("with").join(&file)), read(path("again").join(&file)), "the same seed, the same bytes");
        let angle = column(path("with").join(&file), "angle_deg");
        let with = column(path("with").join(&file), "moment_n_m");
        let without = column(path("without").join(&file), "moment_n_m");
        for k in 0..angle.len() {
            let spring = -1.2 * angle[k].to_radians();
            // Moments are written with five decimals, angles with four.
            assert!((with[k] - without[k] - spring).abs() < 2e-5, "{name} at {k}");
        }
    }
    let truth = json(path("with/truth.json"));
    let hidden = &truth["participants"][0]["effects"][0];
    assert_eq!(hidden["id"], "joint_stiffness");
    assert_eq!(hidden["parameters"]["stiffness"]["value"], 1.2);
    let manifest = json(path("with/manifest.json"));
    assert!(manifest["simulator"].as_str().unwrap().contains("by Carpus itself, not by OpenSim"));
    assert_eq!(manifest["outputs"].as_object().unwrap().len(), KEPT.len() + 5);
    // The true parameters give what was recorded.
    let factor = truth["participants"][0]["muscles"]["FCU"]["factors"]["max_isometric_force"].as_f64().unwrap();
    assert!((0.7..=1.5).contains(&factor));
}

#[test]
fn verif_synth_refuses_what_it_does_not_know() {
    let folder = tempfile::tempdir().unwrap();
    let study = small_study(&folder.path().join("given"));
    let refused = |effect: &str, says: &str| {
        let mut command = carpus();
        command.arg("synth").arg(&study).args(["--effect", effect, "--out"]).arg(folder.path().join("out"));
        command.assert().code(1).stdout("").stderr(contains(says));
    };
    refused("joint_stifness", "did you mean `joint_stiffness`?");
    refused("joint_stiffness:k=2", "it has stiffness, rest_angle");
    refused("joint_stiffness:stiffness=much", "expected a number");
    refused("tendon_compliance:strain_at_one_norm_force=-1", "cannot be reached");
}

#[test]
fn verif_an_effect_that_the_diagnosis_cannot_tell_is_refused_without_i_choose() {
    let found = looped();
    assert!(found.refused.contains("cannot tell") && found.refused.contains("--i-choose"), "{}", found.refused);
    assert!(!found.refused.contains("diagnosed anew"), "the diagnosis of the same files is used");
    let ledger = json(found.path("with/P01/ledger.json"));
    assert_eq!(ledger["choice"]["i_choose"], true);
    assert_eq!(ledger["choice"]["verdict"], "cannot_tell");
    assert_eq!(ledger["choice"]["supported"], false);
}

#[test]
fn verif_the_added_effect_lowers_the_error_and_is_of_the_hidden_size() {
    let found = looped();
    let results = found.results();
    let ledger = results.ledger.as_ref().unwrap();
    let ids: Vec<&str> = ledger.steps.iter().map(|s| s.id.as_str()).collect();
    assert_eq!(ids, ["0_base", "1_refit", "2_joint_stiffness", "3_torque_drift"]);
    let held_out: Vec<f64> = ledger.steps.iter().map(|s| s.held_out.unwrap()).collect();
    println!("held out {held_out:?}, noise floor {}", ledger.noise_floor);
    assert!(held_out[2] < held_out[1] && held_out[3] < 0.7 * held_out[1], "{held_out:?}");
    let estimate = &ledger.steps[2].parameters["joint_stiffness.stiffness"];
    println!("stiffness {} {:?}", estimate.value, estimate.ci95);
    assert!((estimate.value - STIFFNESS).abs() < 0.15, "{}", estimate.value);
    for step in &ledger.steps[1..] {
        // Springs are exact; paths and forces are tabulated anew.
        assert!(step.written_differs_n_m.unwrap() < 1e-3, "{step:?}");
    }
    assert!(ledger.steps[3].side_car.is_some() && ledger.steps[2].side_car.is_none());
    let page = read(found.path("with/P01/report.html"));
    assert_eq!(page, carpus::report::render_report(&results), "the report is a function of its results file");
    assert!(page.contains("noise floor") && !page.contains("proved") && page.contains("a person chose"));
}

#[test]
fn verif_the_page_says_which_effects_are_not_ruled_out_beside_an_explanation() {
    let mut results = looped().results();
    let diagnosis = results.diagnosis.as_mut().unwrap();
    diagnosis.verdict = "identified".to_owned();
    diagnosis.explanations.truncate(1);
    diagnosis.explanations[0].effects = vec!["joint_stiffness".to_owned()];
    diagnosis.explanations[0].p_value = Some(0.4);
    diagnosis.less_likely.clear();
    assert!(carpus::report::render_report(&results).contains("all others are ruled out"));
    results.diagnosis.as_mut().unwrap().less_likely = vec!["gravity".to_owned()];
    let page = carpus::report::render_report(&results);
    assert!(page.contains("the most likely to be missing beside it: weight of the hand"));
}

#[test]
fn verif_the_written_model_closes_the_loop() {
    let found = looped();
    let results = found.results();
    let compare = |extra: &[&Path], out: &str| {
        let mut command = carpus();
        command
            .arg("compare")
            .arg(found.path("hidden/study.toml"))
            .arg("--model")
            .arg(found.path("with/P01/model.osim"));
        if let [effects] = extra {
            command.arg("--effects").arg(effects);
        }
        let run = command.arg("--out").arg(found.path(out)).assert().success();
        let stderr = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        (Results::parse(&read(found.path(out).join("P01/results.json"))).unwrap(), stderr)
    };
    let (with, quiet) = compare(&[&found.path("with/P01/effects.toml")], "compared");
    let last = results.models.last().unwrap();
    for (ours, theirs) in with.models[0].errors.iter().zip(&last.errors) {
        let (a, b) = (ours.errors.rmse_n_m.unwrap(), theirs.errors.rmse_n_m.unwrap());
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
    assert!(!quiet.contains("is not used"), "{quiet}");
    assert!(with.provenance.inputs.iter().any(|i| i.role == "effects"));
    // The residual is accounted for along every axis, and repetitions give a noise floor.
    let residual = &with.residuals[0];
    assert!(["angle", "velocity", "muscle:FCU"].iter().all(|a| residual.axis(a).is_some()));
    assert!(residual.repetition_pairs == 2 && residual.repetition_noise_n_m.unwrap() > 0.0);
    let share: f64 = residual.bands.iter().map(|b| b.share_of_error).sum();
    assert!((share - 1.0).abs() < 1e-4);
    // Without the side-car it is said that something is left out.
    let (_, warned) = compare(&[], "bare");
    assert!(warned.contains("effects.toml lies beside it and is not used") && warned.contains("--effects"), "{warned}");
}

#[test]
fn verif_every_step_can_be_gone_back() {
    let found = looped();
    let folder = tempfile::tempdir().unwrap();
    let copied = folder.path().join("P01");
    copy(&found.path("with/P01"), &copied);
    let remove = |to: &[&str]| carpus().args(["effect", "remove"]).arg(&copied).args(to).assert();
    let bytes = |name: &str| std::fs::read(copied.join(name)).unwrap();
    assert!(copied.join("effects.toml").exists());
    remove(&[]).success();
    assert_eq!(bytes("model.osim"), bytes("steps/2_joint_stiffness/model.osim"));
    assert!(!copied.join("effects.toml").exists(), "the spring needs no side-car");
    assert_eq!(json(copied.join("ledger.json"))["current"], 2);
    remove(&["--to", "0"]).success();
    assert_eq!(bytes("model.osim"), std::fs::read(found.path("hidden/wrist.osim")).unwrap(), "the lab's own bytes");
    remove(&[]).code(1).stderr(contains("nothing to remove"));
    remove(&["--to", "4"]).code(1).stderr(contains("there is no step 4"));
    remove(&["--to", "3"]).success();
    assert_eq!(bytes("model.osim"), bytes("steps/3_torque_drift/model.osim"));
    assert!(copied.join("effects.toml").exists());
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

#[test]
fn verif_the_written_model_is_the_labs_file_with_splices() {
    let found = looped();
    let before = read(found.path("hidden/wrist.osim"));
    let after = read(found.path("with/P01/steps/2_joint_stiffness/model.osim"));
    let lost = before.lines().filter(|l| !after.contains(l)).count();
    assert!((1..=15).contains(&lost), "three values of five muscles change, {lost} lines did");
    assert!(after.contains("<SpringGeneralizedForce name=\"carpus_joint_stiffness\">"));
}

#[test]
fn verif_further_trials_never_lose_information_and_a_flipped_arm_tells_a_spring_from_weight() {
    let found = looped();
    let out = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(out.path().join("P01")).unwrap();
    for name in ["P01/diagnosis.json", "P01/results.json", "carpus-output.json"] {
        std::fs::copy(found.path("with").join(name), out.path().join(name)).unwrap();
    }
    let mut command = carpus();
    command.arg("plan").arg(found.path("hidden/study.toml")).args(["--candidates", "joint_stiffness,gravity", "--out"]);
    command.arg(out.path()).assert().success().stdout(contains("arm flipped"));
    let plan = json(out.path().join("P01/plan.json"));
    let z = |trials: &str| {
        let all = plan["experiments"].as_array().unwrap();
        let one = all.iter().find(|e| e["trials"] == trials).unwrap_or_else(|| panic!("{trials}"));
        one["z_then"].as_f64().unwrap()
    };
    for e in plan["experiments"].as_array().unwrap() {
        assert!(e["z_then"].as_f64().unwrap() > 0.999 * e["z_now"].as_f64().unwrap(), "{e}");
    }
    let (plain, flipped) = (z("3 relaxed slow sweeps"), z("3 relaxed slow sweeps, arm flipped"));
    println!("spring | weight: z {plain} with sweeps, {flipped} with the arm flipped");
    assert!(flipped > 2.0 * plain);
    let listed = json(out.path().join("P01/diagnosis.json"));
    assert_eq!(listed["separating_experiments"][0]["separates"].as_array().unwrap().len(), 2);
    assert!(read(out.path().join("P01/report.html")).contains("Further trials that would tell"));
}

#[test]
fn verif_what_the_data_could_tell_of_an_effect_grows_with_its_size() {
    let found = looped();
    let from_none = |stiffness: f64| {
        let out = tempfile::tempdir().unwrap();
        let mut command = carpus();
        command.arg("plan").arg(found.path("hidden/study.toml")).arg("--out").arg(out.path());
        command.arg("--effect").arg(format!("joint_stiffness:stiffness={stiffness}"));
        command.assert().success().stdout(contains("Joint stiffness of this size"));
        let file = json(out.path().join("P01/separability.json"));
        assert_eq!(file["size"]["stiffness"], stiffness);
        let distances = file["distances"].as_array().unwrap();
        assert!(distances.iter().any(|d| d["rival"] == "gravity"));
        distances.iter().find(|d| d["rival"].is_null()).unwrap()["z"].as_f64().unwrap()
    };
    let (small, large) = (from_none(0.3), from_none(3.0));
    println!("from none: z {small} at 0.3 N·m/rad, {large} at 3");
    assert!(large > 2.0 * small);
    let mut command = carpus();
    command.arg("plan").arg(found.path("hidden/study.toml")).args(["--effect", "joint_stifness", "--out", "nowhere"]);
    command.assert().failure().stderr(contains("did you mean `joint_stiffness`?"));
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_the_model_of_effect_add_gives_the_moment_that_carpus_reports() {
    let python = opensim_python();
    let found = looped();
    let model = found.path("with/P01/steps/2_joint_stiffness/model.osim");
    let out = found.path("simulated");
    let mut command = carpus();
    command.arg("simulate").arg(found.path("hidden/study.toml")).arg("--model").arg(&model).arg("--out").arg(&out);
    command.assert().success();
    for trial in ["isotonic_25_flexion_2", "passive_1"] {
        let output = Process::new(&python)
            .arg(root("fixtures/effects/opensim_trial.py"))
            .arg(&model)
            .arg(found.path(&format!("hidden/data/P01/{trial}.csv")))
            .args(["--coordinate", "flexion", "--posture", "elbow_flexion=90", "pro_sup=0"])
            .args(["--muscles", "ECRL", "ECRB", "ECU", "FCR", "FCU"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8_lossy(&output.stdout);
        let theirs: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
        assert!(theirs["passive_forces"].as_array().unwrap().iter().any(|f| f == "carpus_joint_stiffness"));
        let series = out.join(format!("P01/series/{trial}.csv"));
        let ours = column(series.clone(), "simulated_n_m");
        let drag = column(series, "dynamometer_damping_n_m");
        let (mut worst, mut peak) = (0.0_f64, 0.0_f64);
        for k in 0..ours.len() {
            let at = |key: &str| theirs[key][k].as_f64().unwrap();
            let moment = at("muscle_moment") + at("passive_moment");
            worst = worst.max((ours[k] - drag[k] - moment).abs());
            peak = peak.max(moment.abs());
        }
        println!("{trial}: largest difference {worst:.1e} N·m, peak {peak:.2} N·m");
        // At an accuracy of 1e-6 OpenSim's own error is 3e-3 N·m where muscles set in; at 1e-8 1e-5 N·m are left.
        assert!(worst < 1e-4 * peak.max(1.0), "{trial}: {worst}");
    }
}
