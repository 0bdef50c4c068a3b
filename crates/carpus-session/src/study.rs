//! A study that is open: its tables, the participants that are asked for, and what of their models is simulated.

use std::path::{Path, PathBuf};

use super::diagnostic::{Diagnostic, Failure, Severity};
use super::model::{self, LoadedModel, Needs};
use super::output::OutputFolder;
use super::{own_effects, provenance};
use carpus_effects::export::SideCar;
use carpus_effects::own_effect::definition;
use carpus_multibody::multibody::Model;
use carpus_osim::osim::OsimFile;
use carpus_report::results::{InputFile, Provenance};
use carpus_simulation::scaling::{ParticipantScaling, ParticipantScalingError, scale_participant};
use carpus_simulation::simulation::{Setup, SimulationError};
use carpus_study::study::{Participant, Study as Tables, Trial, write};

/// How a study is opened. The default is what a command does without options.
#[derive(Clone, Debug, Default)]
pub struct Opening {
    /// Participants that are asked for; none: all.
    pub participants: Vec<String>,
    /// A model in place of those that the study names.
    pub model: Option<PathBuf>,
    /// Effects that the model has beside its file, as `carpus effect add` writes them.
    pub effects: Option<PathBuf>,
    /// Whether work goes on without components of a model that would change the result and are not supported.
    pub allow_unsupported: bool,
    /// Whether models are scaled to the participants as `[scaling]` says: all but those that a participant or
    /// [`Opening::model`] names.
    pub scales_models: bool,
    /// Words that results give as what made them; without them the request itself.
    pub command: Option<String>,
}

/// A study that was read. Trials are read participant by participant ([`Study::participants`]).
#[derive(Debug)]
pub struct Study {
    /// What `study.toml` and the tables say.
    pub tables: Tables,
    /// Participants that are asked for, in the order in which they are.
    pub(super) chosen: Vec<Participant>,
    /// How it was opened.
    pub(super) opening: Opening,
    /// Effects that the model has beside its file.
    pub(super) side_car: Option<(PathBuf, SideCar)>,
    /// The model, if it is in no file.
    model: Option<OsimFile>,
}

impl Study {
    /// Opens a study and puts its own effects beside the catalogue.
    ///
    /// - `path`: the study.toml, or the folder it is in
    ///
    /// # Errors
    /// All problems of the study and its tables, together.
    pub fn open(path: impl AsRef<Path>) -> Result<Study, Failure> {
        let path = path.as_ref();
        own_effects::register_all(&[], Some(path))?;
        Study::open_with(path, Opening::default())
    }

    /// Opens a study; effects of a laboratory's own are those that were registered before
    /// ([`own_effects::register_all`]).
    ///
    /// # Errors
    /// All problems of the study and its tables, together; the effects beside the model; an unknown participant.
    pub fn open_with(path: &Path, opening: Opening) -> Result<Study, Failure> {
        let is_wanted = |p: &Participant| opening.participants.is_empty() || opening.participants.contains(&p.name);
        let tables = Tables::read_tables_for(path, |p| opening.model.is_none() && is_wanted(p))?;
        let side_car = opening.effects.as_deref().map(|file| read_side_car(file, &tables)).transpose()?;
        let chosen = wanted(&tables, &opening.participants)?;
        Ok(Study { tables, chosen, opening, side_car, model: None })
    }

    /// A study of arrays and a model in memory; what is done with it is what is done with a study on disk.
    ///
    /// - `tables`: [`Tables::of_trials`]
    /// - `model`: of all participants; [`OsimFile::of_spec`] makes one of a specification
    ///
    /// ```
    /// use carpus_session::{bundled, simulate::Simulate, study::Study};
    /// use carpus_study::study::{Contraction, Direction, Participant, Settings, Study as Tables};
    /// use carpus_study::study::{Trial, TrialInfo, TrialUse};
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let settings = Settings::with_defaults("arrays", "flexion", &["FCR", "ECRB"])?;
    /// let info = TrialInfo::new("P01", "swing", Contraction::Isotonic, Direction::Flexion, TrialUse::Train);
    /// let time: Vec<f64> = (0..200).map(|k| 0.01 * f64::from(k)).collect();
    /// let angle: Vec<f64> = time.iter().map(|t| 0.5 * (3.0 * t).sin()).collect();
    /// let excitation = [0.3, 0.05].map(|e| vec![e; time.len()]).to_vec();
    /// let trial = Trial::from_samples(info, time.clone(), angle, vec![1.0; time.len()], excitation);
    /// let tables = Tables::of_trials(settings, vec![Participant::named("P01")], vec![trial])?;
    ///
    /// let study = Study::from_memory(tables, bundled::model()?);
    /// let session = study.participants().next().unwrap().load()?;
    /// let simulated = session.simulate(&Simulate::default())?;
    /// assert_eq!(simulated.trials[0].moment.len(), 200);
    /// # Ok(())
    /// # }
    /// ```
    pub fn from_memory(tables: Tables, model: OsimFile) -> Study {
        let chosen = tables.participants.clone();
        Study { tables, chosen, opening: Opening::default(), side_car: None, model: Some(model) }
    }

    /// The participants that are asked for.
    pub fn chosen(&self) -> &[Participant] {
        &self.chosen
    }

    /// Participants of the study that are not asked for.
    pub fn others(&self) -> Vec<&str> {
        let is_other = |name: &&str| !self.chosen.iter().any(|p| p.name == *name);
        self.tables.participants.iter().map(|p| p.name.as_str()).filter(is_other).collect()
    }

    /// The folder for results of this study, found to be writable and taken for them.
    ///
    /// - `command`: the command that makes them
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of the study and the command.
    pub fn output_folder(&self, path: &Path, command: &str) -> Result<OutputFolder, Failure> {
        self.output_folder_of(self, path, command)
    }

    /// As [`Study::output_folder`], of a study that was made of another, whose results these are.
    ///
    /// # Errors
    /// As there.
    pub fn output_folder_of(&self, owner: &Study, path: &Path, command: &str) -> Result<OutputFolder, Failure> {
        let owner = &owner.tables;
        let out = OutputFolder::create(path, &self.files())?.claimed_for(&owner.settings.name, &owner.file, command)?;
        for participant in &self.chosen {
            out.refuse_input(&path.join(&participant.name).join("model.osim"))?;
        }
        Ok(out)
    }

    /// Writes results of the participants that are asked for into a folder of results, as the command does. Returns
    /// what a person should know about files of earlier runs.
    ///
    /// - `command`: the command that makes such results
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of the study and the command.
    pub(super) fn write_results(
        &self,
        path: &Path,
        command: &str,
        write: impl FnOnce(&OutputFolder) -> Result<(), Failure>,
    ) -> Result<Vec<Diagnostic>, Failure> {
        let out = self.output_folder(path, command)?;
        write(&out)?;
        out.close(command, &self.others())
    }

    /// The same study, with models scaled to the participants ([`Opening::scales_models`]).
    pub fn scaling_models(mut self) -> Study {
        self.opening.scales_models = true;
        self
    }

    /// Files that are read, or may be: results never take their place.
    pub fn files(&self) -> Vec<PathBuf> {
        let (model, effects) = (&self.opening.model, &self.opening.effects);
        let mut files = self.tables.input_files();
        files.extend(model.clone());
        files.extend(effects.clone());
        files.extend(own_effects::files(effects.as_deref()));
        files
    }

    /// What says how results were made.
    ///
    /// - `request`: stands for the command where there is none
    pub(super) fn provenance(&self, request: &impl std::fmt::Debug, seed: u64, inputs: Vec<InputFile>) -> Provenance {
        provenance::made_by(self.opening.command.as_deref(), request, seed, inputs)
    }

    /// Scales a participant's model in memory, if that is to be done.
    pub(super) fn scaled_to(
        &self,
        participant: &Participant,
        loaded: &mut LoadedModel,
        warnings: &mut Vec<Diagnostic>,
    ) -> Result<Option<ParticipantScaling>, Failure> {
        let settings = self.tables.settings.scaling.as_ref();
        let opening = &self.opening;
        if !opening.scales_models || settings.is_none() || participant.own_model || opening.model.is_some() {
            return Ok(None);
        }
        let refused = |e: &ParticipantScalingError| scaling_refused(e, &self.tables.file, &loaded.path);
        let mut file = loaded.file.clone();
        let scaling = scale_participant(&mut file, settings, participant).map_err(|e| refused(&e))?;
        if !scaling.unmeasured.is_empty() {
            let text = format!("{}: no length of {}: left as it is", participant.name, scaling.unmeasured.join(", "));
            let table = self.tables.folder.join("participants.csv");
            warnings.push(Diagnostic::warning(text).in_file(&table).at_line(participant.line));
        }
        loaded.model = Model::compile(&file.spec)
            .map_err(|e| Failure::from(Diagnostic::error(e.to_string()).in_file(&loaded.path).at_line(e.at().line)))?;
        loaded.file = file;
        Ok(Some(scaling))
    }

    /// Reads a participant's model and checks the names that the study uses.
    ///
    /// # Errors
    /// The model, or names that it does not have.
    pub fn load_model(
        &self,
        participant: &Participant,
        needs: Needs,
        warnings: &mut Vec<Diagnostic>,
    ) -> Result<LoadedModel, Failure> {
        let path = self.opening.model.as_ref().unwrap_or(&participant.model);
        let allow = self.opening.allow_unsupported;
        let loaded = match &self.model {
            Some(file) => model::compiled(path, file.clone(), needs, allow, warnings)?,
            None => model::load(path, needs, allow, warnings)?,
        };
        self.check_names(&loaded)?;
        Ok(loaded)
    }

    /// What of a model the study simulates.
    pub(super) fn setup(&self) -> Setup {
        Setup { allow_unsupported: self.opening.allow_unsupported, ..Setup::from_settings(&self.tables.settings) }
    }

    /// Refuses active muscles whose paths are not computed, which stand among the model's other forces.
    fn check_paths(&self, loaded: &LoadedModel) -> Result<(), Failure> {
        let file = &loaded.file;
        let not_computed = |name: &String| {
            let mut forces = file.spec.forces.iter();
            let force = forces.find(|force| force.name == *name && force.is_muscle_without_path())?;
            let found = file.diagnostics.items.iter().find(|d| d.path == force.at.path)?;
            let hint = "leave it out of [muscles] active in study.toml, or give it a GeometryPath or FunctionBasedPath";
            Some(model::finding(&loaded.path, found, Severity::Error).hint(hint))
        };
        let messages: Vec<Diagnostic> = self.tables.settings.active_muscles.iter().filter_map(not_computed).collect();
        if messages.is_empty() { Ok(()) } else { Err(messages.into()) }
    }

    /// Checks the names that the study uses against the model.
    fn check_names(&self, loaded: &LoadedModel) -> Result<(), Failure> {
        let spec = &loaded.file.spec;
        self.check_paths(loaded)?;
        let coordinates: Vec<&str> = spec.coordinates.iter().map(|c| c.name.as_str()).collect();
        let muscles: Vec<&str> = spec.muscles.iter().map(|m| m.name.as_str()).collect();
        let problems = self.tables.check_names(&loaded.path, &coordinates, &muscles);
        let messages: Vec<Diagnostic> = problems.iter().map(Diagnostic::from).collect();
        if messages.is_empty() { Ok(()) } else { Err(messages.into()) }
    }

    /// Why a model does not suit the study: where `study.toml` asks for what it does not have, that line; else its own.
    pub(super) fn compile_message(&self, error: &SimulationError, loaded: &LoadedModel) -> Diagnostic {
        let message = simulation_message(error, loaded);
        let settings = &self.tables.settings;
        let line = match error {
            SimulationError::PostureOutOfRange { name, .. } | SimulationError::DependentCoordinate { name, .. } => {
                let held = settings.posture.iter().find(|p| p.coordinate == *name).map(|p| p.line);
                held.or(Some(settings.dynamometer.coordinate_line).filter(|_| settings.dynamometer.coordinate == *name))
            }
            SimulationError::RepeatedMuscle { .. } | SimulationError::AppliesNoForce { .. } => {
                Some(settings.active_line)
            }
            _ => None,
        };
        match line {
            Some(line) => message.in_file(&self.tables.file).at_line(line),
            None => message,
        }
    }

    /// What the results of a participant depend on where nothing is in files, with the hashes of what files would hold.
    fn hashes_of(
        &self,
        file: &OsimFile,
        participant: &Participant,
        model: &Path,
        trials: &[Trial],
    ) -> Result<Vec<InputFile>, Failure> {
        let input = |path: String, role: &str, bytes: &[u8]| InputFile {
            path,
            role: role.to_string(),
            sha256: provenance::hash_of(bytes),
        };
        let mut inputs = vec![input(model.display().to_string(), "model", file.document.bytes())];
        let of_participant = || trials.iter().filter(|t| t.info.participant == participant.name);
        let text = |rows: Vec<Vec<String>>| rows.iter().map(|row| row.join(",") + "\n").collect::<String>();
        // Conditions of the trials, with the postures of other joints and whether the arm is turned over.
        let list: Vec<(&Trial, String)> = of_participant().map(|t| (t, t.info.file_as_written.clone())).collect();
        inputs.push(input("trials.csv".to_owned(), "trials", text(write::trial_list_rows(&list)).as_bytes()));
        for trial in of_participant() {
            let rows = write::trial_rows(trial, &self.tables.settings.active_muscles);
            inputs.push(input(trial.info.file_as_written.clone(), "trial", text(rows).as_bytes()));
        }
        Ok(inputs)
    }

    /// The files that the results of a participant depend on, with their hashes.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn inputs(&self, participant: &Participant, model: &Path, trials: &[Trial]) -> Result<Vec<InputFile>, Failure> {
        if let Some(file) = &self.model {
            return self.hashes_of(file, participant, model, trials);
        }
        let tables = [("participants.csv", "participants"), ("trials.csv", "trials"), ("ultrasound.csv", "ultrasound")];
        let shown = |path: &Path| path.strip_prefix(&self.tables.folder).unwrap_or(path).display().to_string();
        let mut inputs = vec![
            provenance::input_file(model, &shown(model), "model")?,
            provenance::input_file(&self.tables.file, &shown(&self.tables.file), "study")?,
        ];
        if let Some((file, _)) = &self.side_car {
            inputs.push(provenance::input_file(file, &shown(file), "effects")?);
        }
        for file in own_effects::files(self.side_car.as_ref().map(|(file, _)| file.as_path())) {
            inputs.push(provenance::input_file(&file, &shown(&file), "own_effect")?);
        }
        for (name, role) in tables {
            let path = self.tables.folder.join(name);
            if path.exists() {
                inputs.push(provenance::input_file(&path, name, role)?);
            }
        }
        let recorder = self.tables.settings.emg_recorder.as_ref();
        // Several trials may be in one file, and EMG in the file of its trial.
        let mut known: Vec<PathBuf> = Vec::new();
        for info in trials.iter().map(|trial| &trial.info).filter(|info| info.participant == participant.name) {
            let emg = recorder.and_then(|recorder| recorder.file_of(info)).map(|file| (shown(&file), file, "emg"));
            let own = (info.file_as_written.clone(), info.file.clone(), "trial");
            for (written, file, role) in std::iter::once(own).chain(emg) {
                if !known.contains(&file) {
                    inputs.push(provenance::input_file(&file, &written, role)?);
                    known.push(file);
                }
            }
        }
        Ok(inputs)
    }
}

/// Reads the effects beside a model.
fn read_side_car(file: &Path, study: &Tables) -> Result<(PathBuf, SideCar), Failure> {
    let side_car = SideCar::read(file).map_err(|e| {
        let message = Diagnostic::error(e.to_string());
        Failure::from(e.hint().into_iter().fold(message, Diagnostic::hint))
    })?;
    let expected = &study.settings.dynamometer.coordinate;
    if side_car.coordinate != *expected {
        let text =
            format!("the effects are about the coordinate `{}`, the study about `{expected}`", side_car.coordinate);
        return Err(Diagnostic::error(text).in_file(file).into());
    }
    for definition in side_car.effects.iter().filter_map(|s| definition(s.effect)) {
        let unknown = definition.unknown_muscles(&study.settings.active_muscles);
        if !unknown.is_empty() {
            return Err(unknown
                .iter()
                .map(|p| Diagnostic::from(p).in_file(file).at_line(None))
                .collect::<Vec<_>>()
                .into());
        }
    }
    Ok((file.to_owned(), side_car))
}

/// The participants of these names, or all.
fn wanted(study: &Tables, names: &[String]) -> Result<Vec<Participant>, Failure> {
    if names.is_empty() {
        return Ok(study.participants.clone());
    }
    let find = |name: &String| {
        study.participant(name).cloned().ok_or_else(|| {
            let known: Vec<&str> = study.participants.iter().map(|p| p.name.as_str()).collect();
            let message = Diagnostic::error(format!("there is no participant `{name}`"));
            let hint = match carpus_study::study::nearest(name, known.iter().copied()) {
                Some(nearest) => format!("did you mean `{nearest}`?"),
                None => format!("there are: {}", known.join(", ")),
            };
            Failure::from(message.in_file(&study.folder.join("participants.csv")).hint(hint))
        })
    };
    names.iter().map(find).collect()
}

/// What to tell about a scaling that failed.
///
/// - `study`: the study.toml
pub fn scaling_refused(error: &ParticipantScalingError, study: &Path, model: &Path) -> Failure {
    let of_model = matches!(error, ParticipantScalingError::Scaling(_) | ParticipantScalingError::Compile(_));
    let message = Diagnostic::error(error.to_string()).in_file(if of_model { model } else { study });
    error.hint().into_iter().fold(message.at_line(error.line()), Diagnostic::hint).into()
}

/// Why a trial cannot be simulated: at the line of the muscle, where one is at fault.
pub fn simulation_message(error: &SimulationError, loaded: &LoadedModel) -> Diagnostic {
    let muscle = error.muscle().and_then(|name| loaded.file.spec.muscles.iter().find(|m| m.name == name));
    let message = Diagnostic::error(error.to_string()).in_file(&loaded.path).at_line(muscle.map(|m| m.at.line));
    match error.hint() {
        Some(hint) => message.hint(hint),
        None => message,
    }
}
