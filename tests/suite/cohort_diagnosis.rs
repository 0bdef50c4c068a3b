//! Several participants diagnosed together, as a user does it.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use carpus::diagnosis::cohort::{CohortDiagnosis, ParticipantEvidence, pooled};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;

use crate::study_command::{contents, differing};
use crate::user_loop::{carpus, root, small_study};

/// One study of the participants of several bundled ones.
fn joined(folder: &Path, sources: &[&str]) -> PathBuf {
    let read = |source: &str, file: &str| std::fs::read_to_string(root(source).join(file)).unwrap();
    let (mut participants, mut trials) = (String::new(), String::new());
    for (i, source) in sources.iter().enumerate() {
        let name = format!("P{:02}", i + 1);
        let to = folder.join("data").join(&name);
        std::fs::create_dir_all(&to).unwrap();
        for entry in std::fs::read_dir(root(source).join("data/P01")).unwrap() {
            let file = entry.unwrap();
            std::fs::copy(file.path(), to.join(file.file_name())).unwrap();
        }
        for (all, file) in [(&mut participants, "participants.csv"), (&mut trials, "trials.csv")] {
            let skipped = usize::from(i > 0);
            all.extend(read(source, file).lines().skip(skipped).map(|l| l.replace("P01", &name) + "\n"));
        }
    }
    let settings = read(sources[0], "study.toml").replace("../../../models/wrist.osim", "wrist.osim");
    std::fs::write(folder.join("study.toml"), settings).unwrap();
    std::fs::write(folder.join("participants.csv"), participants).unwrap();
    std::fs::write(folder.join("trials.csv"), trials).unwrap();
    std::fs::copy(root("models/wrist.osim"), folder.join("wrist.osim")).unwrap();
    folder.join("study.toml")
}

fn diagnose(study: &Path, out: &Path) -> Command {
    let mut command = carpus();
    command.arg("diagnose").arg(study).args(["--candidates", "coulomb_friction,joint_damping,torque_drift"]);
    command.arg("--out").arg(out);
    command
}

#[test]
fn val_opensim_a_cohort_has_the_effect_of_two_of_its_three_participants() {
    let folder = tempfile::tempdir().unwrap();
    let with = "fixtures/hidden_effects/coulomb_friction";
    let study = joined(folder.path(), &[with, "fixtures/hidden_effects/nothing_hidden", with]);
    let out = folder.path().join("out");
    let said = contains("3 participants together: Dry friction").and(contains("P01 P03")).and(contains("cohort.html"));
    diagnose(&study, &out).assert().success().stdout(said);
    let text = std::fs::read_to_string(out.join("cohort.json")).unwrap();
    let found: CohortDiagnosis = serde_json::from_str(&text).unwrap();
    assert_eq!(found.participants, ["P01", "P02", "P03"]);
    let [friction] = found.effects.as_slice() else { panic!("{:?}", found.effects) };
    assert_eq!((friction.effect.as_str(), friction.group.len()), ("coulomb_friction", 1));
    let has: Vec<bool> = friction.participants.iter().map(|m| m.probability > 0.5).collect();
    assert_eq!(has, [true, false, true], "{friction:?}");
    assert!(friction.participants[0].named_alone && !friction.participants[1].named_alone);
    let truth: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(root(with).join("truth.json")).unwrap()).unwrap();
    let truth = truth["effect_parameters"]["coulomb_friction.friction"].as_f64().unwrap();
    let [low, high] = friction.parameters["friction"].mean.ci95;
    assert!(low <= truth && truth <= high, "{truth} in {low} to {high}");
    // What the participants' files say is all that pooling needs.
    let evidence = |name: &str| -> ParticipantEvidence {
        serde_json::from_str(&std::fs::read_to_string(out.join(name).join("evidence.json")).unwrap()).unwrap()
    };
    assert_eq!(pooled(&["P01", "P02", "P03"].map(evidence)), found);
    let page = std::fs::read_to_string(out.join("cohort.html")).unwrap();
    assert!(page.contains("What the participants have in common") && page.contains("Dry friction"), "{page}");

    // Of one participant there is no cohort.
    let one = folder.path().join("one");
    diagnose(&study, &one).args(["--participant", "P02"]).assert().success();
    assert!(one.join("P02/evidence.json").exists() && !one.join("cohort.json").exists());
}

/// Two participants with few trials each, not the same ones.
fn two(folder: &Path) -> PathBuf {
    let study = small_study(folder);
    let list = std::fs::read_to_string(folder.join("trials.csv")).unwrap();
    let of_second = list.lines().skip(1).filter(|l| !l.contains("passive_2")).map(|l| l.replace("P01", "P02"));
    let rows: String = list.lines().map(str::to_owned).chain(of_second).map(|l| l + "\n").collect();
    std::fs::write(folder.join("trials.csv"), rows).unwrap();
    std::fs::create_dir(folder.join("data/P02")).unwrap();
    for entry in std::fs::read_dir(folder.join("data/P01")).unwrap() {
        let file = entry.unwrap();
        std::fs::copy(file.path(), folder.join("data/P02").join(file.file_name())).unwrap();
    }
    let participants = std::fs::read_to_string(folder.join("participants.csv")).unwrap();
    let second = participants.lines().nth(1).unwrap().replacen("P01", "P02", 1);
    std::fs::write(folder.join("participants.csv"), format!("{}\n{second}\n", participants.trim_end())).unwrap();
    study
}

#[test]
fn verif_diagnoses_of_several_machines_are_merged_to_the_bytes_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let study = two(&folder.path().join("study"));
    let [whole, shared] = ["whole", "shared"].map(|name| folder.path().join(name));
    for path in [&whole, &shared] {
        std::fs::create_dir(path).unwrap();
    }
    let run = |place: &Path, more: &[&str]| {
        let mut command = Command::cargo_bin("carpus").unwrap();
        command.current_dir(place).arg("diagnose").arg(&study).args(["--out", "done"]);
        command.args(["--candidates", "joint_damping,torque_drift"]).args(more).assert()
    };
    run(&whole, &[]).success();
    run(&shared, &["--task", "2/2"]).success().stdout(contains("carpus merge done"));
    assert!(!shared.join("done/cohort.json").exists() && !shared.join("done/P02").exists());
    let shown = carpus().current_dir(&shared).args(["units", "done"]).assert().success();
    shown.stdout(contains("diagnose  P02                 1        0        0").and(contains("P01").not()));
    run(&shared, &["--task", "1/2"]).success().stdout(contains("0 units were finished before, 1 were computed"));
    let merged = carpus().current_dir(&shared).args(["merge", "done"]).assert().success();
    merged.stdout(contains("P01: ").and(contains("2 participants together")).and(contains("cohort.html")));
    let of = |place: &Path| {
        let mut found = contents(&place.join("done"));
        found.retain(|name, _| !name.starts_with("tasks"));
        found
    };
    let (one, other) = (of(&whole), of(&shared));
    for name in ["cohort.json", "cohort.html", "P01/diagnosis.json", "P02/report.html", "units/diagnose/P02.json"] {
        assert!(one.contains_key(Path::new(name)), "{name}");
    }
    assert_eq!(differing(&one, &other), Vec::<PathBuf>::new());

    // What is finished is found, by the command itself, too; other options are other work.
    let unit =
        |place: &Path| std::fs::metadata(place.join("done/units/diagnose/P01.json")).unwrap().modified().unwrap();
    let stored = unit(&whole);
    run(&whole, &[]).success().stdout(contains("2 participants together"));
    assert_eq!(unit(&whole), stored, "not computed again");
    assert_eq!(differing(&one, &of(&whole)), Vec::<PathBuf>::new());
    run(&whole, &["--seed", "2"]).success();
    assert_ne!(unit(&whole), stored);
}
