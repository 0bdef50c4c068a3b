//! Several participants diagnosed together, as a user does it.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use carpus::diagnosis::cohort::{CohortDiagnosis, ParticipantEvidence, pooled};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;

use crate::user_loop::{carpus, root};

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
