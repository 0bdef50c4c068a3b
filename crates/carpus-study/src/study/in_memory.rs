//! A study of arrays: the type, the defaults and the checks of a study on disk, without its files.

use std::path::{Path, PathBuf};

use toml_edit::{DocumentMut, Item, Value};

use super::posture::{POSTURE_EXPECTED, is_posture};
use super::trial_list::{Contraction, Direction, TrialInfo, TrialUse};
use super::{Fault, Participant, Problem, Settings, Study, StudyErrors, Trial};

/// Stands for the folder of a study that has none.
const FOLDER: &str = "<memory>";

impl Settings {
    /// What a `study.toml` says that has nothing but its essential keys.
    ///
    /// - `coordinate`: whose generalized force is measured
    /// - `active_muscles`: that EMG drives
    ///
    /// # Errors
    /// What is wrong with them, together.
    pub fn with_defaults(name: &str, coordinate: &str, active_muscles: &[&str]) -> Result<Settings, StudyErrors> {
        let mut document = DocumentMut::new();
        let sections: [(&str, &[(&str, Value)]); 3] = [
            ("study", &[("name", name.into()), ("model", "model.osim".into())]),
            ("dynamometer", &[("coordinate", coordinate.into())]),
            ("muscles", &[("active", active_muscles.iter().copied().collect())]),
        ];
        for (section, keys) in sections {
            document.insert(section, Item::Table(keys.iter().cloned().collect()));
        }
        let text = document.to_string();
        let mut problems = Vec::new();
        let settings = Settings::parse(&text, &Path::new(FOLDER).join("study.toml"), &mut problems);
        StudyErrors::settle(problems)?;
        // Without settings there was an error.
        let (settings, _) = settings.ok_or_else(StudyErrors::default)?;
        Ok(Settings { model: Path::new(FOLDER).join("model.osim"), ..settings })
    }
}

impl Participant {
    /// A participant of whom nothing but the name is known.
    pub fn named(name: &str) -> Participant {
        Participant {
            name: name.to_owned(),
            line: 0,
            model: Path::new(FOLDER).join("model.osim"),
            own_model: false,
            mass: None,
            height: None,
            sex: None,
            side: None,
            segment_lengths: Vec::new(),
            mvc_flexion: None,
            mvc_extension: None,
            person: None,
            group: None,
            visit: None,
        }
    }
}

impl TrialInfo {
    /// A trial of which nothing else is known.
    ///
    /// - `name`: no other trial of the participant has it
    pub fn new(
        participant: &str,
        name: &str,
        contraction: Contraction,
        direction: Direction,
        usage: TrialUse,
    ) -> TrialInfo {
        TrialInfo {
            index: 0,
            place: 0,
            line: 0,
            name: name.to_owned(),
            participant: participant.to_owned(),
            file: PathBuf::from(format!("{FOLDER}/{participant}/{name}")),
            file_as_written: format!("{participant}/{name}"),
            contraction,
            effort_percent: None,
            direction,
            posture: None,
            held: Vec::new(),
            repetition: None,
            usage,
            start_time: None,
            arm_flipped: false,
            emg_file: None,
            table: None,
            emg_table: None,
        }
    }

    /// A trial of nothing in particular, for tests.
    #[doc(hidden)]
    pub fn example(contraction: Contraction, direction: Direction, usage: TrialUse) -> TrialInfo {
        let (file, file_as_written) = ("trial.csv".into(), "trial.csv".to_owned());
        TrialInfo { line: 2, file, file_as_written, ..TrialInfo::new("P01", "trial", contraction, direction, usage) }
    }
}

impl Study {
    /// A study of arrays.
    ///
    /// - `settings`: [`Settings::with_defaults`], and what is changed of them
    /// - `participants`: [`Participant::named`], and what is known of them
    /// - `trials`: [`Trial::from_samples`] of [`TrialInfo::new`], in the order of recording; each gets the checks of a
    ///   trial's file
    ///
    /// # Errors
    /// Every problem that makes the study unusable, together.
    pub fn of_trials(
        settings: Settings,
        participants: Vec<Participant>,
        mut trials: Vec<Trial>,
    ) -> Result<Study, StudyErrors> {
        let folder = PathBuf::from(FOLDER);
        let mut problems = Vec::new();
        let mut refuse = |at: &Path, key: &str, expected: &str, found: &str| {
            let fault = Fault::BadValue { key: key.to_owned(), expected: expected.to_owned(), found: found.to_owned() };
            problems.push(Problem::error(at, None, fault));
        };
        for i in 0..participants.len() {
            if participants[..i].iter().any(|p| p.name == participants[i].name) {
                refuse(&folder, "name", "a name that no other participant has", &participants[i].name);
            }
        }
        for i in 0..trials.len() {
            let info = &trials[i].info;
            if !participants.iter().any(|p| p.name == info.participant) {
                refuse(&info.file, "participant", "one of the participants", &info.participant);
            }
            for held in info.held.iter().filter(|held| !is_posture(held.value_deg_or_m)) {
                let found = format!("{} of {}", held.value_deg_or_m, held.coordinate);
                refuse(&info.file, "held", &format!("{POSTURE_EXPECTED}, up to 360 either way"), &found);
            }
            let is_same = |other: &Trial| other.info.participant == info.participant && other.info.name == info.name;
            if trials[..i].iter().any(is_same) {
                refuse(&info.file, "name", "a name that no other trial of the participant has", &info.name);
            }
        }
        for i in 0..trials.len() {
            let place = trials[..i].iter().filter(|t| t.info.participant == trials[i].info.participant).count();
            (trials[i].info.index, trials[i].info.place) = (i, place);
        }
        let infos = trials.iter().map(|t| t.info.clone()).collect();
        let study = Study {
            file: folder.join("study.toml"),
            folder,
            settings,
            participants,
            trials: infos,
            ultrasound: Vec::new(),
            warnings: Vec::new(),
            in_memory: trials,
        };
        study.check_trial_list(&mut problems);
        problems.extend(study.check_trials(|_| true).into_iter().filter(|p| p.severity == super::Severity::Error));
        let warnings = StudyErrors::settle(problems)?;
        Ok(Study { warnings, ..study })
    }

    /// The samples of a trial that was not read from a file.
    pub(super) fn held(&self, info: &TrialInfo) -> Option<&Trial> {
        self.in_memory.iter().find(|trial| trial.info == *info)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::PostureCoordinate;

    fn trial(name: &str, moment: Vec<f64>) -> Trial {
        let info = TrialInfo::new("P01", name, Contraction::Isotonic, Direction::Flexion, TrialUse::Train);
        let time: Vec<f64> = (0..50).map(|k| 0.01 * f64::from(k)).collect();
        let angle: Vec<f64> = time.iter().map(|t| 0.3 * t).collect();
        Trial::from_samples(info, time.clone(), angle, moment, vec![time])
    }

    fn study(trials: Vec<Trial>) -> Result<Study, StudyErrors> {
        let settings = Settings::with_defaults("arrays", "flexion", &["FCR"]).unwrap();
        Study::of_trials(settings, vec![Participant::named("P01")], trials)
    }

    #[test]
    fn verif_arrays_come_back_as_they_were() {
        let moment: Vec<f64> = (0..50).map(|k| (0.7 * f64::from(k)).sin()).collect();
        let study = study(vec![trial("a", moment.clone()), trial("b", moment.clone())]).unwrap();
        let trials = study.load_trials("P01").unwrap();
        assert_eq!((trials.len(), trials[1].info.place), (2, 1));
        assert_eq!((&trials[0].moment, trials[0].excitation[0].len()), (&moment, 50));
        // A key that is not written means what it means in a file.
        assert!(study.settings.dynamometer.includes(super::super::MomentPart::Passive));
    }

    #[test]
    fn verif_a_posture_that_is_no_number_is_refused() {
        for (value, word) in [(f64::NAN, "NaN of wrist"), (400.0, "400 of wrist")] {
            let mut bent = trial("a", vec![1.0; 50]);
            let coordinate = "wrist".to_owned();
            bent.info.held = vec![PostureCoordinate { coordinate, line: 0, value_deg_or_m: value }];
            let said = study(vec![bent]).unwrap_err().to_string();
            assert!(said.contains("held") && said.contains(word), "{said}");
        }
    }

    #[test]
    fn verif_arrays_get_the_checks_of_files() {
        let moment = vec![1.0; 50];
        let refused = |trials: Vec<Trial>| study(trials).unwrap_err().to_string();
        assert!(refused(vec![trial("a", vec![1.0; 49])]).contains("50 values"));
        assert!(refused(vec![trial("a", moment.clone()), trial("a", moment.clone())]).contains("no other trial"));
        let mut backwards = trial("a", moment.clone());
        backwards.time[20] = 0.1;
        assert!(!refused(vec![backwards]).is_empty());
        let mut loud = trial("a", moment.clone());
        loud.excitation[0][3] = 7.0;
        assert!(refused(vec![loud]).contains('7'));
        let mut nan = trial("a", moment);
        nan.angle[3] = f64::NAN;
        assert!(refused(vec![nan]).contains("NaN"));
    }
}
