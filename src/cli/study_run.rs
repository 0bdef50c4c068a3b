//! What `simulate`, `compare` and `personalize` have in common: read the study, the models and the trials, simulate.

use std::path::{Path, PathBuf};

use indicatif::{ProgressBar, ProgressStyle};

use super::account::ModelRun;
use super::args::{Global, StudyArgs};
use super::failure::{self, Failure, Gravity, Message};
use super::model::{self, LoadedModel, Needs};
use super::output::OutputFolder;
use super::{own_effects, path_check, print_result, provenance};
use crate::diagnosis::export::SideCar;
use crate::diagnosis::fit::memory_of_noise;
use crate::diagnosis::forward_model::{ForwardModel, Setting};
use crate::diagnosis::moments::simulate_all as simulate_effects;
use crate::multibody::Model;
use crate::osim::spec::{ModelSpec, MotionType};
use crate::report::results::InputFile;
use crate::scaling::{ParticipantScaling, ParticipantScalingError, scale_participant};
use crate::simulation::{
    MuscleKinematics, MuscleParameters, MusculoskeletalModel, Options, PreparedTrial, Recording, Setup,
    SimulationError, TrialSimulation,
};
use crate::study::{Contraction, MIN_SAMPLES, MomentPart, Participant, Study, Trial, TrialUse};

/// A study that was read, and the folder that its results go to.
#[derive(Debug)]
pub struct StudyRun {
    /// The study, trials not yet read.
    pub study: Study,
    /// Where results go.
    pub out: OutputFolder,
    /// Participants asked for.
    pub participants: Vec<Participant>,
    /// Model given on the command line, in place of those of the study.
    other_model: Option<PathBuf>,
    /// Effects that the model has beside its file.
    side_car: Option<(PathBuf, SideCar)>,
    allow_unsupported: bool,
    /// Whether models are scaled to the participants as `[scaling]` says.
    scales_models: bool,
}

/// All that is needed to simulate a participant's trials.
#[derive(Debug)]
pub struct ParticipantRun {
    /// The participant.
    pub participant: Participant,
    /// The model.
    pub loaded: LoadedModel,
    /// How the model was scaled to the participant, if it was.
    pub scaling: Option<ParticipantScaling>,
    /// The trials, in the order of recording.
    pub trials: Vec<Trial>,
    /// The model compiled for these trials.
    pub model: MusculoskeletalModel,
    /// The trials prepared, in the same order; with the effects beside the model, if there are any.
    pub prepared: Vec<PreparedTrial>,
    /// Effects that the model has beside its file.
    pub given: Vec<Setting>,
    /// Moments of the model with them [N·m], if there are any.
    recorded: Option<Vec<Vec<f64>>>,
    /// The study's `trials.csv`, for messages.
    pub trials_file: PathBuf,
    /// Every file that was read.
    pub inputs: Vec<InputFile>,
    /// Warnings about the study, the model and the trials.
    pub warnings: Vec<Message>,
}

/// Samples that a diagnosis looks at [Hz].
const DIAGNOSIS_RATE: f64 = 100.0;

/// Trials of which there are at least twice as many samples, averaged to a rate [Hz].
fn averaged(trials: Vec<Trial>, rate: f64, warnings: &mut Vec<Message>) -> Vec<Trial> {
    // However short a trial, samples enough to be simulated are left.
    let most = |t: &Trial| t.len() / MIN_SAMPLES;
    let count = |t: &Trial| (((t.len() - 1) as f64 / (t.duration() * rate) + 1e-6) as usize).min(most(t));
    let most = trials.iter().max_by_key(|t| count(t)).filter(|t| count(t) > 1);
    if let Some(fastest) = most {
        let recorded = (fastest.len() - 1) as f64 / fastest.duration();
        let text = format!("recorded at {recorded:.0} Hz: averaged to {rate:.0} Hz");
        let hint = "a diagnosis needs no more; EMG was filtered as recorded";
        warnings.push(Message::warning(text).in_file(&fastest.info.file).hint(hint));
    }
    trials.into_iter().map(|t| if count(&t) > 1 { t.averaged(count(&t)) } else { t }).collect()
}

/// Memory that the noise of trials may take [bytes]: half of what a laptop of these years has.
const MOST_MEMORY: f64 = 4e9;

/// Fails where the noise of the trials to train on would take more memory than [`MOST_MEMORY`]: it grows with the square of
/// their duration.
///
/// - `muscles`: active ones
/// - `with_envelopes`: whether the true envelopes of the EMG are estimated, as a diagnosis does
pub fn require_memory(
    trials: &[Trial],
    muscles: usize,
    with_envelopes: bool,
    trials_file: &Path,
) -> Result<(), Failure> {
    let trained = || trials.iter().filter(|t| t.info.usage == TrialUse::Train);
    let needed: f64 = trained().map(|t| memory_of_noise(&t.time, muscles, with_envelopes)).sum();
    let longest = trained().max_by(|a, b| a.duration().total_cmp(&b.duration()));
    let Some(longest) = longest.filter(|_| needed > MOST_MEMORY) else { return Ok(()) };
    let text = format!(
        "participant {}: the noise of the trials with use = train would take {:.0} GB of memory; at most {:.0} GB are taken",
        longest.info.participant,
        (needed / 1e9).ceil(),
        MOST_MEMORY / 1e9
    );
    let hint = format!(
        "memory grows with the square of a trial's duration, and {} lasts {:.0} s: cut it into trials of a minute or less",
        longest.info.file.display(),
        longest.duration()
    );
    Err(Message::error(text).in_file(trials_file).hint(hint).into())
}

/// What came of a run over all participants.
pub struct Outcomes<T> {
    /// Of the participants that could be done, in the study's order.
    pub done: Vec<T>,
    /// Why the others could not.
    failed: Vec<Message>,
}

impl<T> Outcomes<T> {
    /// What was done, and why the rest could not be.
    pub fn into_parts(self) -> (Vec<T>, Vec<Message>) {
        (self.done, self.failed)
    }

    /// Closes the output folder, prints the result of those that could be done, then fails with the reasons of those that could
    /// not.
    ///
    /// - `command`: its name
    ///
    /// # Errors
    /// The disk; writing to stdout; any participant that could not be done.
    pub fn print(self, study: &StudyRun, command: &str, text: &str) -> Result<(), Failure> {
        study.close(command)?;
        print_result(text)?;
        if self.failed.is_empty() { Ok(()) } else { Err(Failure::Input(self.failed)) }
    }
}

impl StudyRun {
    /// Does the work for every participant; one that cannot be done does not keep the others from being done.
    ///
    /// # Errors
    /// A fault of this program; no participant that could be done.
    pub fn each<T>(&self, mut work: impl FnMut(&Participant) -> Result<T, Failure>) -> Result<Outcomes<T>, Failure> {
        let mut outcomes = Outcomes { done: Vec::new(), failed: Vec::new() };
        for participant in &self.participants {
            failure::about(&participant.name);
            match work(participant) {
                Ok(done) => outcomes.done.push(done),
                Err(Failure::Input(messages)) => outcomes.failed.extend(messages),
                Err(other) => return Err(other),
            }
        }
        failure::account();
        if outcomes.done.is_empty() && !outcomes.failed.is_empty() {
            return Err(Failure::Input(outcomes.failed));
        }
        Ok(outcomes)
    }

    /// Ends the work in the output folder: what an earlier run of the command left there goes, and is said.
    ///
    /// # Errors
    /// The disk.
    pub fn close(&self, command: &str) -> Result<(), Failure> {
        let is_other = |name: &&str| !self.participants.iter().any(|p| p.name == *name);
        let others: Vec<&str> = self.study.participants.iter().map(|p| p.name.as_str()).filter(is_other).collect();
        failure::print(&self.out.close(command, &others)?);
        Ok(())
    }

    /// Reads the study's tables and makes the output folder.
    ///
    /// - `command`: the command whose results come into the folder
    ///
    /// # Errors
    /// The study; an unknown participant; the output folder.
    pub fn prepare(args: &StudyArgs, command: &str) -> Result<StudyRun, Failure> {
        StudyRun::prepare_with(args, None, command)
    }

    /// As [`StudyRun::prepare`]; the model has the effects of a side-car.
    ///
    /// # Errors
    /// The study; the side-car; an unknown participant; the output folder.
    pub fn prepare_with(args: &StudyArgs, effects: Option<&Path>, command: &str) -> Result<StudyRun, Failure> {
        StudyRun::prepare_for(args, effects, None, command)
    }

    /// As [`StudyRun::prepare`], of a study that was made of another, whose results these are.
    ///
    /// # Errors
    /// As there.
    pub fn prepare_processed(args: &StudyArgs, of: &Study, command: &str) -> Result<StudyRun, Failure> {
        StudyRun::prepare_for(args, None, Some(of), command)
    }

    fn prepare_for(
        args: &StudyArgs,
        effects: Option<&Path>,
        of: Option<&Study>,
        command: &str,
    ) -> Result<StudyRun, Failure> {
        let is_wanted = |p: &Participant| args.participant.is_empty() || args.participant.contains(&p.name);
        let study = Study::read_tables_for(&args.study, |p| args.model.is_none() && is_wanted(p))?;
        let side_car = effects.map(|file| read_side_car(file, &study)).transpose()?;
        let participants = wanted(&study, &args.participant)?;
        let mut inputs = study.input_files();
        inputs.extend(args.model.clone());
        inputs.extend(effects.map(Path::to_owned));
        inputs.extend(own_effects::files(effects));
        let owner = of.unwrap_or(&study);
        let out = OutputFolder::create(&args.out, &inputs)?.claimed_for(&owner.settings.name, &owner.file, command)?;
        for participant in &participants {
            out.refuse_input(&args.out.join(&participant.name).join("model.osim"))?;
        }
        Ok(StudyRun {
            study,
            out,
            participants,
            other_model: args.model.clone(),
            side_car,
            allow_unsupported: args.allow_unsupported,
            scales_models: false,
        })
    }

    /// The same study, with models scaled to the participants where `[scaling]` says how: all but those that a participant
    /// or the command line names.
    pub fn scaling_models(self) -> StudyRun {
        StudyRun { scales_models: true, ..self }
    }

    /// Scales a participant's model in memory, if that is to be done.
    fn scaled_to(
        &self,
        participant: &Participant,
        loaded: &mut LoadedModel,
        warnings: &mut Vec<Message>,
    ) -> Result<Option<ParticipantScaling>, Failure> {
        let settings = self.study.settings.scaling.as_ref();
        if !self.scales_models || settings.is_none() || participant.own_model || self.other_model.is_some() {
            return Ok(None);
        }
        let refused = |e: &ParticipantScalingError| super::commands::scale::refused(e, &self.study.file, &loaded.path);
        let mut file = loaded.file.clone();
        let scaling = scale_participant(&mut file, settings, participant).map_err(|e| refused(&e))?;
        if !scaling.unmeasured.is_empty() {
            let text = format!("{}: no length of {}: left as it is", participant.name, scaling.unmeasured.join(", "));
            let table = self.study.folder.join("participants.csv");
            warnings.push(Message::warning(text).in_file(&table).at_line(participant.line));
        }
        loaded.model = Model::compile(&file.spec)
            .map_err(|e| Failure::from(Message::error(e.to_string()).in_file(&loaded.path).at_line(e.at().line)))?;
        loaded.file = file;
        Ok(Some(scaling))
    }

    /// Reads a participant's model and trials and does all work that does not depend on muscle parameters.
    ///
    /// # Errors
    /// The model, the trials, or one does not suit the other.
    pub fn participant(&self, participant: &Participant) -> Result<ParticipantRun, Failure> {
        self.participant_at(participant, f64::INFINITY, None)
    }

    /// As [`StudyRun::participant`], for an identification: fails early where it would take too much memory.
    ///
    /// # Errors
    /// As there; trials that are too long.
    pub fn participant_to_identify(&self, participant: &Participant) -> Result<ParticipantRun, Failure> {
        self.participant_at(participant, f64::INFINITY, Some(false))
    }

    /// As [`StudyRun::participant`], for what compares trials with each other: samples are averaged to [`DIAGNOSIS_RATE`], with a
    /// warning where there are twice as many: neither muscles nor movements are faster, and time and memory grow with them. Another warning
    /// where no trial to train on holds a contraction.
    ///
    /// # Errors
    /// As there.
    pub fn participant_to_diagnose(&self, participant: &Participant) -> Result<ParticipantRun, Failure> {
        let mut run = self.participant_at(participant, DIAGNOSIS_RATE, Some(true))?;
        let mut trained = run.trials.iter().filter(|t| t.info.usage == TrialUse::Train).peekable();
        if trained.peek().is_some() && trained.all(|t| t.info.contraction == Contraction::Passive) {
            let text = format!(
                "participant {}: every trial with use = train is passive: p-values are not calibrated",
                participant.name
            );
            let hint = "of eight clean studies of six passive trials five raised an alarm; add trials in which muscles contract";
            run.warnings.push(Message::warning(text).in_file(&run.trials_file).hint(hint));
        }
        Ok(run)
    }

    /// - `rate`: that samples are averaged to, where there are twice as many [Hz]
    /// - `noise`: whether envelopes are a part of the noise that is estimated; `None` where none is
    fn participant_at(
        &self,
        participant: &Participant,
        rate: f64,
        noise: Option<bool>,
    ) -> Result<ParticipantRun, Failure> {
        let settings = &self.study.settings;
        let mut warnings: Vec<Message> = self.study.warnings.iter().map(Message::from).collect();
        let needs = if settings.dynamometer.includes(MomentPart::Passive) { Needs::Forces } else { Needs::Motion };
        let mut loaded = self.load_model(participant, needs, &mut warnings)?;
        let scaling = self.scaled_to(participant, &mut loaded, &mut warnings)?;
        let model = MusculoskeletalModel::compile(&loaded.file.spec, &self.setup())
            .map_err(|e| self.compile_message(&e, &loaded))?;
        let at_study = |e: SimulationError| Failure::from(simulation_message(&e, &loaded));
        let left_out = model.left_out().iter().map(|(name, class)| format!("{name} ({class})")).collect::<Vec<_>>();
        if !left_out.is_empty() {
            warnings.push(Message::warning(format!("left out: {}", left_out.join(", "))).in_file(&loaded.path));
        }
        let trials = self.study.load_trials(&participant.name)?;
        warnings.extend(trials.iter().flat_map(|t| t.warnings.iter().map(Message::from)));
        warnings.extend(self.check_trials(participant, &trials, &model)?);
        let trials = averaged(trials, rate, &mut warnings);
        let trials_file = self.study.folder.join("trials.csv");
        if let Some(with_envelopes) = noise {
            require_memory(&trials, model.muscle_names().count(), with_envelopes, &trials_file)?;
        }
        let recordings: Vec<Recording> = trials.iter().map(Recording::from).collect();
        let mut prepared = model.prepare_all(&recordings, &checked_angles()).map_err(at_study)?;
        let given = self.side_car.as_ref().map(|(_, s)| s.effects.clone()).unwrap_or_default();
        let mut recorded = None;
        if self.side_car.is_some() {
            let forward = ForwardModel::new(&loaded.file.spec, &model, &trials).map_err(at_study)?;
            let forward = forward.with_given(given.clone());
            let simulated = simulate_effects(&forward, &model.nominal_parameters(), &[]).map_err(at_study)?;
            (prepared, recorded) = {
                let (prepared, moments) = simulated.into_iter().map(|t| (t.core.prepared, t.moment)).unzip();
                (prepared, Some(moments))
            };
        } else if let Some(beside) = beside(&loaded.path) {
            let text = format!("{} lies beside it and is not used", beside.display());
            let hint = format!("--effects {} makes it part of the model", beside.display());
            warnings.push(Message::warning(text).in_file(&loaded.path).hint(hint));
        }
        warnings.extend(path_warnings(&loaded, &model, &trials)?);
        let strengths: Vec<Vec<Vec<f64>>> = prepared.iter().map(|trial| strengths(trial, &model)).collect();
        warnings.extend(self.study.check_channels(&trials, &strengths).iter().map(Message::from));
        let inputs = self.inputs(participant, &loaded.path, &trials)?;
        Ok(ParticipantRun {
            participant: participant.clone(),
            loaded,
            scaling,
            trials,
            model,
            prepared,
            given,
            recorded,
            trials_file,
            inputs,
            warnings,
        })
    }

    /// Reads a participant's model and checks the names that the study uses.
    ///
    /// # Errors
    /// The model, or names that it does not have.
    pub fn load_model(
        &self,
        participant: &Participant,
        needs: Needs,
        warnings: &mut Vec<Message>,
    ) -> Result<LoadedModel, Failure> {
        let path = self.other_model.as_ref().unwrap_or(&participant.model);
        let loaded = model::load(path, needs, self.allow_unsupported, warnings)?;
        self.check_names(&loaded)?;
        Ok(loaded)
    }

    /// What of a model the study simulates.
    fn setup(&self) -> Setup {
        Setup { allow_unsupported: self.allow_unsupported, ..Setup::from_settings(&self.study.settings) }
    }

    /// Simulates a participant's trials with an edited model, just as a later run with that file does.
    ///
    /// # Errors
    /// The edited model cannot be simulated.
    pub fn simulate_edited(&self, run: &ParticipantRun, spec: &ModelSpec) -> Result<Vec<TrialSimulation>, Failure> {
        self.simulate_some(run, spec, &(0..run.trials.len()).collect::<Vec<_>>())
    }

    /// Simulates some of a participant's trials with another model.
    ///
    /// - `chosen`: positions among the participant's trials
    ///
    /// # Errors
    /// The model cannot be simulated.
    pub fn simulate_some(
        &self,
        run: &ParticipantRun,
        spec: &ModelSpec,
        chosen: &[usize],
    ) -> Result<Vec<TrialSimulation>, Failure> {
        let recordings: Vec<Recording> = chosen.iter().map(|&i| Recording::from(&run.trials[i])).collect();
        let failed = |e: SimulationError| Failure::from(simulation_message(&e, &run.loaded));
        let model = MusculoskeletalModel::compile(spec, &self.setup()).map_err(failed)?;
        // Another model may have another range.
        check_angles(chosen.iter().map(|&i| &run.trials[i]), &model)?;
        let prepared = model.prepare_all(&recordings, &checked_angles()).map_err(failed)?;
        crate::simulation::simulate_all(&prepared, &model.nominal_parameters()).map_err(failed)
    }

    /// Checks the names that the study uses against the model.
    fn check_names(&self, loaded: &LoadedModel) -> Result<(), Failure> {
        let spec = &loaded.file.spec;
        let coordinates: Vec<&str> = spec.coordinates.iter().map(|c| c.name.as_str()).collect();
        let muscles: Vec<&str> = spec.muscles.iter().map(|m| m.name.as_str()).collect();
        let problems = self.study.check_names(&loaded.path, &coordinates, &muscles);
        let messages: Vec<Message> = problems.iter().map(Message::from).collect();
        if messages.is_empty() { Ok(()) } else { Err(messages.into()) }
    }

    /// Why a model does not suit the study: where `study.toml` asks for what it does not have, that line; else its own.
    fn compile_message(&self, error: &SimulationError, loaded: &LoadedModel) -> Message {
        let message = simulation_message(error, loaded);
        let settings = &self.study.settings;
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
            Some(line) => message.in_file(&self.study.file).at_line(line),
            None => message,
        }
    }

    /// Checks the recorded angles against the range of the coordinate. Returns warnings of angles a little outside.
    fn check_trials(
        &self,
        of: &Participant,
        trials: &[Trial],
        model: &MusculoskeletalModel,
    ) -> Result<Vec<Message>, Failure> {
        if trials.is_empty() {
            let message = Message::error(format!("participant {} has no trials to simulate", of.name));
            return Err(message.in_file(&self.study.folder.join("trials.csv")).into());
        }
        check_angles(trials, model)
    }

    /// The files that the results of a participant depend on, with their hashes.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn inputs(&self, participant: &Participant, model: &Path, trials: &[Trial]) -> Result<Vec<InputFile>, Failure> {
        let tables = [("participants.csv", "participants"), ("trials.csv", "trials"), ("ultrasound.csv", "ultrasound")];
        let shown = |path: &Path| path.strip_prefix(&self.study.folder).unwrap_or(path).display().to_string();
        let mut inputs = vec![
            provenance::input_file(model, &shown(model), "model")?,
            provenance::input_file(&self.study.file, &shown(&self.study.file), "study")?,
        ];
        if let Some((file, _)) = &self.side_car {
            inputs.push(provenance::input_file(file, &shown(file), "effects")?);
        }
        for file in own_effects::files(self.side_car.as_ref().map(|(file, _)| file.as_path())) {
            inputs.push(provenance::input_file(&file, &shown(&file), "own_effect")?);
        }
        for (name, role) in tables {
            let path = self.study.folder.join(name);
            if path.exists() {
                inputs.push(provenance::input_file(&path, name, role)?);
            }
        }
        for trial in trials.iter().filter(|t| t.info.participant == participant.name) {
            inputs.push(provenance::input_file(&trial.info.file, &trial.info.file_as_written, "trial")?);
        }
        Ok(inputs)
    }
}

impl ParticipantRun {
    /// Simulates all trials with the given parameters of the active muscles.
    ///
    /// # Errors
    /// A muscle whose forces cannot be balanced.
    pub fn simulate(&self, parameters: &[MuscleParameters]) -> Result<Vec<TrialSimulation>, Failure> {
        crate::simulation::simulate_all(&self.prepared, parameters)
            .map_err(|e| simulation_message(&e, &self.loaded).into())
    }

    /// Simulates all trials with the model as it is: its own parameters, and the effects beside it.
    ///
    /// # Errors
    /// A muscle whose forces cannot be balanced.
    pub fn simulate_model(&self) -> Result<Vec<TrialSimulation>, Failure> {
        let mut simulations = self.simulate(&self.model.nominal_parameters())?;
        for (simulation, moment) in simulations.iter_mut().zip(self.recorded.iter().flatten()) {
            simulation.moment.clone_from(moment);
        }
        Ok(simulations)
    }

    /// A model and its moments, for the account.
    pub fn model_run(&self, id: &str, label: &str, file: String, simulations: &[TrialSimulation]) -> ModelRun {
        ModelRun {
            id: id.to_string(),
            label: label.to_string(),
            name: self.loaded.model.name.clone(),
            file,
            moments: simulations.iter().map(|s| s.moment.clone()).collect(),
        }
    }
}

/// Reads the effects beside a model.
fn read_side_car(file: &Path, study: &Study) -> Result<(PathBuf, SideCar), Failure> {
    let side_car = SideCar::read(file).map_err(|e| {
        let message = Message::error(e.to_string());
        Failure::from(e.hint().into_iter().fold(message, Message::hint))
    })?;
    let expected = &study.settings.dynamometer.coordinate;
    if side_car.coordinate != *expected {
        let text =
            format!("the effects are about the coordinate `{}`, the study about `{expected}`", side_car.coordinate);
        return Err(Message::error(text).in_file(file).into());
    }
    for definition in side_car.effects.iter().filter_map(|s| s.effect.definition()) {
        let unknown = definition.unknown_muscles(&study.settings.active_muscles);
        if !unknown.is_empty() {
            return Err(unknown
                .iter()
                .map(|p| Message::from(p).in_file(file).at_line(None))
                .collect::<Vec<_>>()
                .into());
        }
    }
    Ok((file.to_owned(), side_car))
}

/// Effects that lie beside a model.
fn beside(model: &Path) -> Option<PathBuf> {
    let file = model.parent()?.join("effects.toml");
    file.is_file().then_some(file)
}

/// Moment arm times maximum isometric force [N·m], per active muscle and sample of a trial.
fn strengths(trial: &PreparedTrial, model: &MusculoskeletalModel) -> Vec<Vec<f64>> {
    let parameters = model.nominal_parameters();
    let of = |(muscle, p): (&MuscleKinematics, &MuscleParameters)| {
        muscle.moment_arm.iter().map(|arm| arm * p.max_isometric_force).collect()
    };
    trial.kinematics().muscles.iter().zip(&parameters).map(of).collect()
}

/// Warnings about the active muscles' paths over all angles that were recorded.
fn path_warnings(
    loaded: &LoadedModel,
    model: &MusculoskeletalModel,
    trials: &[Trial],
) -> Result<Vec<Message>, Failure> {
    let angles = trials.iter().flat_map(|t| &t.angle);
    let range = angles.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], a| [low.min(*a), high.max(*a)]);
    let names: Vec<String> = model.muscle_names().map(String::from).collect();
    path_check::over_range(loaded, &loaded.muscles(&names)?, model.coordinate(), &model.posture, range)
}

/// The participants of these names, or all.
fn wanted(study: &Study, names: &[String]) -> Result<Vec<Participant>, Failure> {
    if names.is_empty() {
        return Ok(study.participants.clone());
    }
    let find = |name: &String| {
        study.participant(name).cloned().ok_or_else(|| {
            let known: Vec<&str> = study.participants.iter().map(|p| p.name.as_str()).collect();
            let message = Message::error(format!("there is no participant `{name}`"));
            let hint = match crate::study::nearest(name, known.iter().copied()) {
                Some(nearest) => format!("did you mean `{nearest}`?"),
                None => format!("there are: {}", known.join(", ")),
            };
            Failure::from(message.in_file(&study.folder.join("participants.csv")).hint(hint))
        })
    };
    names.iter().map(find).collect()
}

/// Checks recorded angles against the range of the coordinate. Returns warnings of those a little outside.
fn check_angles<'a>(
    trials: impl IntoIterator<Item = &'a Trial>,
    model: &MusculoskeletalModel,
) -> Result<Vec<Message>, Failure> {
    let coordinate = &model.skeleton().coordinates[model.coordinate().0];
    let is_translation = coordinate.motion_type == MotionType::Translational;
    let problems: Vec<Message> = trials
        .into_iter()
        .filter_map(|t| t.check_against_range(&coordinate.name, is_translation, coordinate.range))
        .map(|p| Message::from(&p))
        .collect();
    if problems.iter().any(|p| p.gravity == Gravity::Error) { Err(problems.into()) } else { Ok(problems) }
}

/// How trials are simulated whose angles were checked against the coordinate's range: a little outside is allowed.
fn checked_angles() -> Options {
    Options { allow_angle_outside_range: true, ..Options::default() }
}

/// Why a trial cannot be simulated: at the line of the muscle, where one is at fault.
pub fn simulation_message(error: &SimulationError, loaded: &LoadedModel) -> Message {
    let muscle = error.muscle().and_then(|name| loaded.file.spec.muscles.iter().find(|m| m.name == name));
    let message = Message::error(error.to_string()).in_file(&loaded.path).at_line(muscle.map(|m| m.at.line));
    match error.hint() {
        Some(hint) => message.hint(hint),
        None => message,
    }
}

/// A progress bar on stderr; nothing where stderr is no terminal or silence was asked for.
pub fn progress(global: &Global, steps: u64, what: &str) -> ProgressBar {
    if global.quiet || global.json {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(steps).with_message(what.to_string());
    if let Ok(style) = ProgressStyle::with_template("{msg:<28} {wide_bar} {pos}/{len} {elapsed}") {
        bar.set_style(style);
    }
    bar
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::{Contraction, Direction, TrialInfo, TrialUse};

    fn trial(rate: f64) -> Trial {
        let info = TrialInfo::example(Contraction::Isotonic, Direction::Flexion, TrialUse::Train);
        let time: Vec<f64> = (0..=(2.0 * rate) as usize).map(|k| 1.0 + k as f64 / rate).collect();
        let angle: Vec<f64> = time.iter().map(|t| 0.3 * t).collect();
        let moment = vec![2.0; time.len()];
        Trial::from_samples(info, time.clone(), angle, moment, vec![time])
    }

    #[test]
    fn verif_what_would_take_too_much_memory_is_refused_with_its_longest_trial() {
        let lasting = |seconds: usize| {
            let info = TrialInfo::example(Contraction::Isotonic, Direction::Flexion, TrialUse::Train);
            let time: Vec<f64> = (0..=100 * seconds).map(|k| 0.01 * k as f64).collect();
            let zeros = vec![0.0; time.len()];
            Trial::from_samples(info, time, zeros.clone(), zeros, Vec::new())
        };
        let check =
            |trials: &[Trial], with_envelopes| require_memory(trials, 5, with_envelopes, Path::new("trials.csv"));
        let session: Vec<Trial> = (0..20).map(|_| lasting(20)).collect();
        assert!(check(&session, true).is_ok() && check(&session, false).is_ok());
        // An hour: 90,000 knots, of which a covariance alone takes 65 GB.
        let Err(Failure::Input(messages)) = check(&[lasting(20), lasting(3600)], true) else { panic!("an hour") };
        assert!(messages[0].text.contains("GB of memory; at most 4 GB"), "{}", messages[0].text);
        assert!(messages[0].hint.as_ref().unwrap().contains("lasts 3600 s: cut it"), "{:?}", messages[0].hint);
        assert!(check(&[lasting(3600)], false).is_err());
        // Held out, it is not fitted.
        let mut held_out = lasting(3600);
        held_out.info.usage = TrialUse::Test;
        assert!(check(&[lasting(20), held_out], true).is_ok());
    }

    #[test]
    fn verif_samples_are_averaged_from_twice_the_rate_on() {
        let mut warnings = Vec::new();
        let slow = averaged(vec![trial(199.0), trial(100.0)], DIAGNOSIS_RATE, &mut warnings);
        assert_eq!((slow[0].len(), slow[1].len(), warnings.len()), (399, 201, 0));
        let fast = averaged(vec![trial(1000.0), trial(200.0)], DIAGNOSIS_RATE, &mut warnings);
        assert_eq!((fast[0].len(), fast[1].len(), warnings.len()), (200, 200, 1));
        for t in &fast {
            for k in 0..t.len() {
                assert!((t.angle[k] - 0.3 * t.time[k]).abs() < 1e-12 && (t.excitation[0][k] - t.time[k]).abs() < 1e-12);
                assert!((t.moment[k] - 2.0).abs() < 1e-12);
            }
        }
    }
}
