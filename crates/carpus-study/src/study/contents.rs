//! What a study holds: who was measured, how, and which trials there are.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::efforts::{self, Effort};
use super::fault::Fault;
use super::limits::MIN_SAMPLES;
use super::nearest::nearest;
use super::participants::{self, Participant};
use super::plausibility;
use super::problem::{Problem, StudyErrors};
use super::raw_emg::{self, EmgSignal};
use super::settings::{MomentPart, Settings};
use super::table;
use super::trial::Trial;
use super::trial_list::{self, TrialInfo, TrialUse, posture_column};
use super::ultrasound::{self, UltrasoundMeasurement};
use carpus_numerics::signals::EmgProcessing;

/// A study: who was measured, how, and which trials there are. Samples are read trial by trial ([`Study::trial`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// The `study.toml`.
    pub file: PathBuf,
    /// The folder it is in; all paths of a study are relative to it.
    pub folder: PathBuf,
    /// What `study.toml` says.
    pub settings: Settings,
    /// The participants, in the order of `participants.csv`.
    pub participants: Vec<Participant>,
    /// The trials of all participants, in the order of recording, ignored ones included.
    pub trials: Vec<TrialInfo>,
    /// Imaging, if there is any.
    pub ultrasound: Vec<UltrasoundMeasurement>,
    /// What a person should look at.
    pub warnings: Vec<Problem>,
    /// Samples of trials that are not read from files ([`Study::of_trials`]).
    pub(super) in_memory: Vec<Trial>,
}

/// A study as far as it can be read.
struct Parts {
    /// `None` only with at least one error among the problems.
    study: Option<Study>,
    problems: Vec<Problem>,
    /// Whether the names of columns can be trusted; else trial files would only echo the errors of `study.toml`.
    columns_sound: bool,
}

impl Study {
    /// Reads a study and checks all of it, the samples of every trial included (one trial in memory per thread).
    ///
    /// - `path`: the `study.toml`, or the folder it is in
    ///
    /// # Errors
    /// Every problem that makes the study unusable, together.
    pub fn read(path: impl AsRef<Path>) -> Result<Study, StudyErrors> {
        let Parts { study, mut problems, columns_sound } = Self::read_parts(path.as_ref(), |_| true);
        if let Some(study) = study.as_ref().filter(|_| columns_sound) {
            problems.extend(study.check_trials(|_| true));
        }
        Self::settle(study, problems)
    }

    /// What a study's `study.toml` says, as far as it can be read; its problems are told by [`Study::read_tables`].
    ///
    /// - `path`: the `study.toml`, or the folder it is in
    pub fn settings_of(path: &Path) -> Option<(PathBuf, Settings)> {
        let file = if path.is_dir() { path.join("study.toml") } else { path.to_owned() };
        let folder = file.parent().map(Path::to_owned).unwrap_or_default();
        let (settings, _) = read_settings(&file, &folder, &mut Vec::new())?;
        Some((file, settings))
    }

    /// Reads `study.toml` and the tables, not the trials.
    ///
    /// # Errors
    /// Every problem that makes the study unusable, together.
    pub fn read_tables(path: impl AsRef<Path>) -> Result<Study, StudyErrors> {
        Self::read_tables_for(path, |_| true)
    }

    /// As [`Study::read_tables`], for a run that does not need all models.
    ///
    /// - `needs_model`: whether the model of a participant must be there
    ///
    /// # Errors
    /// As there.
    pub fn read_tables_for(
        path: impl AsRef<Path>,
        needs_model: impl Fn(&Participant) -> bool,
    ) -> Result<Study, StudyErrors> {
        let Parts { study, problems, .. } = Self::read_parts(path.as_ref(), needs_model);
        Self::settle(study, problems)
    }

    fn settle(study: Option<Study>, problems: Vec<Problem>) -> Result<Study, StudyErrors> {
        let warnings = StudyErrors::settle(problems)?;
        // Without a study there was an error: see `read_parts`.
        study.map(|study| Study { warnings, ..study }).ok_or_else(StudyErrors::default)
    }

    /// The study and its tables.
    fn read_parts(path: &Path, needs_model: impl Fn(&Participant) -> bool) -> Parts {
        let mut problems = Vec::new();
        let file = if path.is_dir() { path.join("study.toml") } else { path.to_owned() };
        let folder = file.parent().map(Path::to_owned).unwrap_or_default();
        let settings = read_settings(&file, &folder, &mut problems);
        let no_study = problems.iter().any(|p| matches!(p.fault, Fault::NotAStudy { .. })) || !file.exists();
        if settings.is_none() && no_study {
            // A wrong path: complaints about its neighbours would only hide that.
            return Parts { study: None, problems, columns_sound: false };
        }
        let study_model = settings.as_ref().map(|(s, _)| s.model.clone()).unwrap_or_default();
        let participants = participants::read(&folder.join("participants.csv"), &folder, &study_model, &mut problems);
        let stated = settings.as_ref().map(|(settings, _)| settings.recordings.as_path());
        let recordings = stated.filter(|stated| !stated.as_os_str().is_empty()).unwrap_or(&folder);
        let place = trial_list::Place { folder: &folder, recordings };
        let trials = trial_list::read(&folder.join("trials.csv"), place, &participants, &mut problems);
        let names: Vec<&str> = participants.iter().map(|p| p.name.as_str()).collect();
        let ultrasound = ultrasound::read(&folder.join("ultrasound.csv"), &names, &mut problems);
        let Some((settings, columns_sound)) = settings else {
            return Parts { study: None, problems, columns_sound: false };
        };
        let study = Study {
            file,
            folder,
            settings,
            participants,
            trials,
            ultrasound,
            warnings: Vec::new(),
            in_memory: Vec::new(),
        };
        study.check_models(needs_model, &mut problems);
        study.check_trial_list(&mut problems);
        Parts { study: Some(study), problems, columns_sound }
    }

    /// The participant of that name.
    pub fn participant(&self, name: &str) -> Option<&Participant> {
        self.participants.iter().find(|p| p.name == name)
    }

    /// The trials of a participant that are not ignored, in the order of recording.
    pub fn trials_of<'a>(&'a self, participant: &'a str) -> impl Iterator<Item = &'a TrialInfo> {
        self.trials.iter().filter(move |t| t.participant == participant && t.usage != TrialUse::Ignore)
    }

    /// Reads and checks one trial.
    ///
    /// # Errors
    /// Every problem of the file, together.
    pub fn trial(&self, info: &TrialInfo) -> Result<Trial, StudyErrors> {
        self.trial_with(info, self.mvc_levels(&info.participant)?.as_deref())
    }

    /// Each channel's level at maximum voluntary contraction, in the channel's unit and the order of the active
    /// muscles: the largest envelope over the participant's trials of contraction or use `mvc`. `None` if the study's
    /// EMG is normalized already.
    ///
    /// # Errors
    /// No such trial; the problems of their files; channels that are silent in all of them.
    pub fn mvc_levels(&self, participant: &str) -> Result<Option<Vec<f64>>, StudyErrors> {
        let EmgSignal::Raw(emg) = &self.settings.emg else { return Ok(None) };
        let trials_file = self.folder.join("trials.csv");
        let infos: Vec<&TrialInfo> = self.trials_of(participant).filter(|t| t.is_mvc()).collect();
        let results = infos.into_par_iter().map(|info| self.samples(info, &trials_file, None));
        let trials = gather(results.collect())?;
        let mut problems = Vec::new();
        let columns = &self.settings.columns;
        let levels = raw_emg::mvc_levels(&trials, emg, columns, participant, &trials_file, &mut problems);
        StudyErrors::settle(problems)?;
        Ok(Some(levels))
    }

    /// The samples of a trial, from its file or from memory, as far as they can be checked by themselves.
    pub(super) fn samples(
        &self,
        info: &TrialInfo,
        trials_file: &Path,
        levels: Option<&[f64]>,
    ) -> Result<Trial, StudyErrors> {
        match self.held(info) {
            Some(trial) => trial.checked(&self.settings, levels),
            None => Trial::read(info, &self.settings, trials_file, levels),
        }
    }

    fn trial_with(&self, info: &TrialInfo, mvc_levels: Option<&[f64]>) -> Result<Trial, StudyErrors> {
        let mut trial = self.samples(info, &self.folder.join("trials.csv"), mvc_levels)?;
        let mut problems = Vec::new();
        raw_emg::to_trial_times(&mut trial, &mut problems);
        StudyErrors::settle(problems)?;
        if let EmgSignal::Raw(EmgProcessing { resample_hz: Some(rate), .. }) = self.settings.emg {
            let recorded = (trial.len() - 1) as f64 / trial.duration();
            // However short a trial, samples enough to be simulated are left.
            let count = ((recorded / rate + 1e-6) as usize).min(trial.len() / MIN_SAMPLES);
            if count > 1 && mvc_levels.is_some() {
                trial = trial.averaged(count);
            }
        }
        let doubtful = plausibility::check(&trial, &self.settings, self.participant(&info.participant));
        trial.warnings.extend(doubtful);
        Ok(trial)
    }

    /// Reads and checks all trials of a participant that are not ignored.
    ///
    /// # Errors
    /// The problems of all files, together.
    pub fn load_trials(&self, participant: &str) -> Result<Vec<Trial>, StudyErrors> {
        let levels = self.mvc_levels(participant)?;
        let infos: Vec<&TrialInfo> = self.trials_of(participant).collect();
        let mut trials = gather(infos.into_par_iter().map(|info| self.trial_with(info, levels.as_deref())).collect())?;
        let efforts: Vec<Effort> = trials.iter().map(|trial| Effort::of(trial, &self.settings)).collect();
        let doubtful = StudyErrors::settle(efforts::check(
            &efforts,
            &self.participants,
            &self.settings,
            &self.file,
            &self.folder,
        ))?;
        for problem in doubtful {
            // What concerns no trial's file is said with the first trial.
            let place = trials.iter().position(|trial| trial.info.file == problem.file).unwrap_or(0);
            trials[place].warnings.push(problem);
        }
        Ok(trials)
    }

    /// Reads every trial that is not ignored and passes `wanted`, keeps nothing, and returns the findings in the
    /// order of the trials.
    pub fn check_trials(&self, wanted: impl Fn(&TrialInfo) -> bool + Sync) -> Vec<Problem> {
        let all = |e: StudyErrors| e.errors.into_iter().chain(e.warnings).collect::<Vec<Problem>>();
        let infos: Vec<&TrialInfo> =
            self.trials.iter().filter(|info| info.usage != TrialUse::Ignore && wanted(info)).collect();
        let mut problems = Vec::new();
        let mut levels: HashMap<&str, Option<Vec<f64>>> = HashMap::new();
        for info in &infos {
            // Levels that cannot be had are reported once; the participant's trials are then checked as far as they go.
            levels.entry(&info.participant).or_insert_with(|| {
                self.mvc_levels(&info.participant).unwrap_or_else(|errors| {
                    problems.extend(all(errors));
                    None
                })
            });
        }
        let check = |info: &&TrialInfo| {
            let levels = levels.get(info.participant.as_str()).and_then(|levels| levels.as_deref());
            let read = self.trial_with(info, levels);
            read.map_or_else(
                |e| (all(e), None),
                |trial| (trial.warnings.clone(), Some(Effort::of(&trial, &self.settings))),
            )
        };
        let (findings, efforts): (Vec<Vec<Problem>>, Vec<Option<Effort>>) = infos.par_iter().map(check).unzip();
        let efforts: Vec<Effort> = efforts.into_iter().flatten().collect();
        for problem in findings.into_iter().flatten().chain(efforts::check(
            &efforts,
            &self.participants,
            &self.settings,
            &self.file,
            &self.folder,
        )) {
            // A bad MVC file was read twice.
            if self.settings.emg == EmgSignal::Normalized || !problems.contains(&problem) {
                problems.push(problem);
            }
        }
        problems
    }

    /// Checks the names that the study takes from a model: coordinates, active muscles, imaged muscles.
    ///
    /// - `model`: the model's file, for messages
    /// - `coordinates`, `muscles`: the names in the model
    pub fn check_names(&self, model: &Path, coordinates: &[&str], muscles: &[&str]) -> Vec<Problem> {
        let mut problems = Vec::new();
        let mut check = |what: &'static str, name: &str, known: &[&str], file: &Path, line: usize| {
            if !known.contains(&name) {
                let nearest = nearest(name, known.iter().copied());
                let fault = Fault::NotInModel { what, name: name.to_owned(), model: model.to_owned(), nearest };
                problems.push(Problem::error(file, line, fault));
            }
        };
        let mut named = HashSet::new();
        let dynamometer = &self.settings.dynamometer;
        check("coordinate", &dynamometer.coordinate, coordinates, &self.file, dynamometer.coordinate_line);
        for further in &self.settings.columns.further_moments {
            check("coordinate", &further.coordinate, coordinates, &self.file, further.line);
        }
        for held in &self.settings.posture {
            check("coordinate", &held.coordinate, coordinates, &self.file, held.line);
        }
        let list = self.folder.join("trials.csv");
        for held in self.trials.iter().filter(|t| t.usage != TrialUse::Ignore).flat_map(|t| &t.held) {
            // One message for a column.
            if named.insert(held.coordinate.as_str()) {
                check("coordinate", &held.coordinate, coordinates, &list, held.line);
            }
        }
        for muscle in &self.settings.active_muscles {
            check("muscle", muscle, muscles, &self.file, self.settings.active_line);
        }
        let imaging = &self.settings.imaging;
        for held in imaging.posture.iter().chain(imaging.muscle_posture.iter().flat_map(|(_, held)| held)) {
            check("coordinate", &held.coordinate, coordinates, &self.file, held.line);
        }
        for muscle in imaging.muscles() {
            check("muscle", muscle, muscles, &self.file, imaging.line);
        }
        let ultrasound = self.folder.join("ultrasound.csv");
        for imaged in &self.ultrasound {
            check("muscle", &imaged.muscle, muscles, &ultrasound, imaged.line);
        }
        problems
    }

    /// Every file the study is made of (tables, models, trials not ignored), each once, for checksums.
    pub fn input_files(&self) -> Vec<PathBuf> {
        let tables = ["participants.csv", "trials.csv"].map(|name| self.folder.join(name));
        let ultrasound = Some(self.folder.join("ultrasound.csv")).filter(|path| path.exists());
        let used = || self.trials.iter().filter(|t| t.usage != TrialUse::Ignore);
        let recorder = self.settings.emg_recorder.as_ref();
        let emg = used().filter_map(|t| recorder?.file_of(t));
        let trials = used().map(|t| t.file.clone()).chain(emg);
        let models = self.participants.iter().map(|p| p.model.clone());
        let mut files = vec![self.file.clone()];
        for path in tables.into_iter().chain(ultrasound).chain(models).chain(trials) {
            if !files.contains(&path) {
                files.push(path);
            }
        }
        files
    }

    fn check_models(&self, needed: impl Fn(&Participant) -> bool, problems: &mut Vec<Problem>) {
        let mut seen: Vec<&Path> = Vec::new();
        let study_line = (&self.file, self.settings.model_line);
        let table = self.folder.join("participants.csv");
        let participants: Vec<&Participant> = self.participants.iter().filter(|p| needed(p)).collect();
        let study_model = self.participants.is_empty() || participants.iter().any(|p| !p.own_model);
        let models = study_model
            .then_some((self.settings.model.as_path(), study_line))
            .into_iter()
            .chain(participants.iter().filter(|p| p.own_model).map(|p| (p.model.as_path(), (&table, p.line))));
        for (model, (file, line)) in models {
            if !model.is_file() && !seen.contains(&model) {
                let named_at = Some(format!("{}:{line}", file.display()));
                problems.push(Problem::error(model, None, Fault::MissingFile { what: "model", named_at }));
                seen.push(model);
            }
        }
    }

    pub(super) fn check_trial_list(&self, problems: &mut Vec<Problem>) {
        let trials_file = self.folder.join("trials.csv");
        for participant in &self.participants {
            if !self.trials.is_empty() && self.trials_of(&participant.name).next().is_none() {
                let fault = Fault::NoTrials { participant: participant.name.clone() };
                problems.push(Problem::warning(&trials_file, None, fault));
            }
            let untimed: Vec<&TrialInfo> =
                self.trials_of(&participant.name).filter(|t| t.start_time.is_none()).collect();
            let trials = self.trials_of(&participant.name).count();
            if let Some(first) = untimed.first().filter(|_| untimed.len() < trials) {
                let (participant, without) = (participant.name.clone(), untimed.len());
                let fault = Fault::SomeStartTimes { participant, without, trials };
                problems.push(Problem::warning(&trials_file, first.line, fault));
            }
        }
        let driven = &self.settings.dynamometer.coordinate;
        let moves = |t: &&TrialInfo| t.held.iter().any(|held| held.coordinate == *driven);
        if let Some(first) = self.trials.iter().find(moves) {
            let column = posture_column(driven);
            let expected = "a column of a coordinate other than the dynamometer's, which follows the recorded angle";
            let fault =
                Fault::BadValue { key: column.clone(), expected: expected.to_owned(), found: format!("`{column}`") };
            problems.push(Problem::error(&trials_file, first.line, fault));
        }
        let has_weight = self.settings.dynamometer.includes(MomentPart::Gravity);
        let turned = |t: &&TrialInfo| t.usage != TrialUse::Ignore && t.arm_flipped;
        if let Some(first) = self.trials.iter().find(turned).filter(|_| has_weight) {
            problems.push(Problem::warning(&trials_file, first.line, Fault::OwnGravityNotTurned));
        }
        if !self.trials.is_empty() && self.trials.iter().all(|t| t.usage != TrialUse::Train) {
            problems.push(Problem::warning(&trials_file, None, Fault::NothingToTrain));
        }
    }
}

/// All trials, or the problems of all that could not be read.
pub(super) fn gather(results: Vec<Result<Trial, StudyErrors>>) -> Result<Vec<Trial>, StudyErrors> {
    let mut trials = Vec::with_capacity(results.len());
    let mut failed = StudyErrors::default();
    for result in results {
        match result {
            Ok(trial) => trials.push(trial),
            Err(mut errors) => {
                failed.errors.append(&mut errors.errors);
                failed.warnings.append(&mut errors.warnings);
            }
        }
    }
    if failed.errors.is_empty() { Ok(trials) } else { Err(failed) }
}

fn read_settings(file: &Path, folder: &Path, problems: &mut Vec<Problem>) -> Option<(Settings, bool)> {
    let bytes = match carpus_numerics::regular_file::read(file) {
        Ok(bytes) => bytes,
        Err(error) => {
            problems.push(Problem::error(file, None, table::file_fault(&error, "study.toml", None)));
            return None;
        }
    };
    let Ok(text) = String::from_utf8(bytes) else {
        problems.push(Problem::error(file, None, Fault::NotText));
        return None;
    };
    let (mut settings, columns_sound) = Settings::parse(&text, file, problems)?;
    settings.model = table::named_file(folder, &settings.model.to_string_lossy());
    if !settings.recordings.as_os_str().is_empty() {
        settings.recordings = table::named_file(folder, &settings.recordings.to_string_lossy());
    }
    for own in &mut settings.own_effects {
        *own = table::named_file(folder, &own.to_string_lossy());
    }
    Some((settings, columns_sound))
}
