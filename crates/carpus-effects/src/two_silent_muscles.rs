//! For tests: a participant of whom two muscles were not recorded.

use super::forward_model::ForwardModel;
use carpus_osim::osim::OsimFile;
use carpus_simulation::simulation::{MusculoskeletalModel, Setup};
use carpus_study::study::Study;

/// A held and a moving trial of the bundled study, as were two of its five muscles not recorded.
pub(crate) fn with_two_silent_muscles() -> ForwardModel {
    const SILENT: [&str; 2] = ["ECRB", "FCU"];
    const TRIALS: [&str; 2] = ["isometric_50_flexion_+30deg_1", "isotonic_50_extension_1"];
    let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let study = Study::read(root.join("fixtures/demo_study/study.toml")).unwrap();
    let file = OsimFile::read(root.join("models/wrist.osim")).unwrap();
    let mut setup = Setup::from_settings(&study.settings);
    let mut recorded: Vec<bool> = Vec::new();
    setup.active_muscles.retain(|name| {
        recorded.push(!SILENT.contains(&name.as_str()));
        !SILENT.contains(&name.as_str())
    });
    let model = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
    let chosen = study.trials_of("P01").filter(|info| TRIALS.iter().any(|name| info.file_as_written.contains(name)));
    let mut trials: Vec<_> = chosen.map(|info| study.trial(info).unwrap()).collect();
    for trial in &mut trials {
        let mut kept = recorded.iter();
        trial.excitation.retain(|_| *kept.next().unwrap());
    }
    let forward = ForwardModel::new(&file.spec, &model, &trials).unwrap();
    assert_eq!((forward.trials.len(), forward.muscles.len()), (2, 3));
    forward
}
