//! Reading a participant's model and trials, with exactly the checks that every command makes.

use std::path::{Path, PathBuf};

use super::account::ModelRun;
use super::diagnostic::{Diagnostic, Failure, Severity};
use super::model::{LoadedModel, Needs};
use super::path_check;
use super::study::{Study, simulation_message};
use carpus_diagnosis::fit::memory_of_noise;
use carpus_effects::forward_model::{ForwardModel, Setting};
use carpus_effects::moments::simulate_all as simulate_effects;
use carpus_osim::osim::spec::{ModelSpec, MotionType, MuscleSpec};
use carpus_report::results::InputFile;
use carpus_simulation::scaling::ParticipantScaling;
use carpus_simulation::simulation::{
    HeldCoordinate, MuscleKinematics, MuscleParameters, MusculoskeletalModel, Options, PreparedTrial, Recording,
    SimulationError, TrialSimulation,
};
use carpus_study::study::{Contraction, MIN_SAMPLES, MomentPart, Participant, Trial, TrialInfo, TrialUse};

/// What a participant's model and trials are read for: some work needs more memory, or fewer samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Purpose {
    /// Simulation, comparison, personalization: the trials as recorded.
    #[default]
    Simulation,
    /// Fits of muscle parameters with their noise: as [`Purpose::Diagnosis`], without its warning of passive trials.
    Identification,
    /// What compares trials with each other: samples are averaged to [`DIAGNOSIS_RATE`], with a warning where there are
    /// twice as many: neither muscles nor movements are faster, and time and memory grow with them. Another warning
    /// where no trial to train on holds a contraction.
    Diagnosis,
}

/// All that is needed to simulate a participant's trials.
#[derive(Debug)]
pub struct LoadedParticipant {
    /// The participant.
    pub participant: Participant,
    /// The model.
    pub loaded: LoadedModel,
    /// How the model was scaled to the participant, if it was.
    pub scaling: Option<ParticipantScaling>,
    /// The trials, in the order of recording.
    pub trials: Vec<Trial>,
    /// Whether samples were averaged to fewer.
    pub averaged: bool,
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
    pub warnings: Vec<Diagnostic>,
}

/// Samples that a diagnosis looks at [Hz].
pub const DIAGNOSIS_RATE: f64 = 100.0;

/// Trials of which there are at least twice as many samples, averaged to a rate [Hz].
fn averaged(trials: Vec<Trial>, rate: f64, warnings: &mut Vec<Diagnostic>) -> Vec<Trial> {
    // However short a trial, samples enough to be simulated are left.
    let most = |t: &Trial| t.len() / MIN_SAMPLES;
    let count = |t: &Trial| (((t.len() - 1) as f64 / (t.duration() * rate) + 1e-6) as usize).min(most(t));
    let most = trials.iter().max_by_key(|t| count(t)).filter(|t| count(t) > 1);
    if let Some(fastest) = most {
        let recorded = (fastest.len() - 1) as f64 / fastest.duration();
        let text = format!("recorded at {recorded:.0} Hz: averaged to {rate:.0} Hz");
        let hint = "a diagnosis needs no more; EMG was filtered as recorded";
        warnings.push(Diagnostic::warning(text).in_file(&fastest.info.file).hint(hint));
    }
    trials.into_iter().map(|t| if count(&t) > 1 { t.averaged(count(&t)) } else { t }).collect()
}

/// Memory that the noise of trials may take [bytes]: half of what a laptop of these years has.
const MOST_MEMORY: f64 = 4e9;

/// Memory that the noise of the trials to train on takes [bytes].
///
/// - `muscles`, `with_envelopes`: as [`require_memory`]
pub fn memory_needed(trials: &[Trial], muscles: usize, with_envelopes: bool) -> f64 {
    let trained = trials.iter().filter(|t| t.info.usage == TrialUse::Train);
    trained.map(|t| memory_of_noise(&t.time, muscles, with_envelopes)).sum()
}

/// Participants that may be worked on at the same time: as many as take no more memory together than one may.
///
/// - `largest`: what one of them takes [bytes]
pub fn participants_at_once(largest: f64) -> usize {
    ((MOST_MEMORY / largest.max(1.0)) as usize).max(1)
}

/// Fails where the noise of the trials to train on would take more memory than `MOST_MEMORY`: it grows with the square
/// of their duration.
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
    let needed = memory_needed(trials, muscles, with_envelopes);
    let longest = trained().max_by(|a, b| a.duration().total_cmp(&b.duration()));
    let Some(longest) = longest.filter(|_| needed > MOST_MEMORY) else { return Ok(()) };
    let text = format!(
        "participant {}: the noise of the trials with use = train would take {:.0} GB of memory; at most {:.0} GB are \
         taken",
        longest.info.participant,
        (needed / 1e9).ceil(),
        MOST_MEMORY / 1e9
    );
    let hint = format!(
        "memory grows with the square of a trial's duration, and {} lasts {:.0} s: cut it into trials of a minute or \
         less",
        longest.info.file.display(),
        longest.duration()
    );
    Err(Diagnostic::error(text).in_file(trials_file).hint(hint).into())
}

impl Study {
    /// Reads a participant's model and trials and does all work that does not depend on muscle parameters.
    ///
    /// # Errors
    /// The model, the trials, or one does not suit the other; trials that are too long for the purpose.
    pub fn load(&self, participant: &Participant, purpose: Purpose) -> Result<LoadedParticipant, Failure> {
        match purpose {
            Purpose::Simulation => self.participant_at(participant, f64::INFINITY, None),
            Purpose::Identification => self.participant_at(participant, DIAGNOSIS_RATE, Some(true)),
            Purpose::Diagnosis => {
                let mut run = self.participant_at(participant, DIAGNOSIS_RATE, Some(true))?;
                run.warnings.extend(only_passive(&run));
                Ok(run)
            }
        }
    }

    /// - `rate`: that samples are averaged to, where there are twice as many [Hz]
    /// - `noise`: whether envelopes are a part of the noise that is estimated; `None` where none is
    fn participant_at(
        &self,
        participant: &Participant,
        rate: f64,
        noise: Option<bool>,
    ) -> Result<LoadedParticipant, Failure> {
        let settings = &self.tables.settings;
        let mut warnings: Vec<Diagnostic> = self.tables.warnings.iter().map(Diagnostic::from).collect();
        let needs = Needs::Trials { passive: settings.dynamometer.includes(MomentPart::Passive) };
        let mut loaded = self.load_model(participant, needs, &mut warnings)?;
        let scaling = self.scaled_to(participant, &mut loaded, &mut warnings)?;
        let model = MusculoskeletalModel::compile(&loaded.file.spec, &self.setup())
            .map_err(|e| self.compile_message(&e, &loaded))?;
        if model.closes_loops() {
            loaded.model = model.skeleton().clone();
        }
        self.check_postures(participant, &model)?;
        let left_out = model.left_out().iter().map(|(name, class)| format!("{name} ({class})")).collect::<Vec<_>>();
        if !left_out.is_empty() {
            warnings.push(Diagnostic::warning(format!("left out: {}", left_out.join(", "))).in_file(&loaded.path));
        }
        let at_study = |e: SimulationError| Failure::from(simulation_message(&e, &loaded));
        let trials = self.tables.load_trials(&participant.name)?;
        warnings.extend(trials.iter().flat_map(|t| t.warnings.iter().map(Diagnostic::from)));
        warnings.extend(self.check_trials(participant, &trials, &model)?);
        let samples: usize = trials.iter().map(Trial::len).sum();
        let trials = averaged(trials, rate, &mut warnings);
        let is_averaged = trials.iter().map(Trial::len).sum::<usize>() < samples;
        let trials_file = self.tables.folder.join("trials.csv");
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
            warnings.push(Diagnostic::warning(text).in_file(&loaded.path).hint(hint));
        }
        warnings.extend(path_warnings(&loaded, &model, &trials)?);
        warnings.extend(masses_left_out(&loaded, &model));
        let strengths: Vec<Vec<Vec<f64>>> = prepared.iter().map(|trial| strengths(trial, &model)).collect();
        warnings.extend(self.tables.check_channels(&trials, &strengths).iter().map(Diagnostic::from));
        let inputs = self.inputs(participant, &loaded.path, &trials)?;
        Ok(LoadedParticipant {
            participant: participant.clone(),
            loaded,
            scaling,
            trials,
            averaged: is_averaged,
            model,
            prepared,
            given,
            recorded,
            trials_file,
            inputs,
            warnings,
        })
    }

    /// Simulates a participant's trials with an edited model, just as a later run with that file does.
    ///
    /// # Errors
    /// The edited model cannot be simulated.
    pub fn simulate_edited(&self, run: &LoadedParticipant, spec: &ModelSpec) -> Result<Vec<TrialSimulation>, Failure> {
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
        run: &LoadedParticipant,
        spec: &ModelSpec,
        chosen: &[usize],
    ) -> Result<Vec<TrialSimulation>, Failure> {
        let recordings: Vec<Recording> = chosen.iter().map(|&i| Recording::from(&run.trials[i])).collect();
        let failed = |e: SimulationError| Failure::from(simulation_message(&e, &run.loaded));
        let model = MusculoskeletalModel::compile(spec, &self.setup()).map_err(failed)?;
        // Another model may have another range.
        check_angles(chosen.iter().map(|&i| &run.trials[i]), &model)?;
        let prepared = model.prepare_all(&recordings, &checked_angles()).map_err(failed)?;
        carpus_simulation::simulation::simulate_all(&prepared, &model.nominal_parameters()).map_err(failed)
    }

    /// Checks the postures that trials have of their own.
    fn check_postures(&self, of: &Participant, model: &MusculoskeletalModel) -> Result<(), Failure> {
        let trials = self.tables.trials_of(&of.name).filter(|t| t.usage != TrialUse::Ignore);
        let wrong = |info: &TrialInfo| {
            let held: Vec<HeldCoordinate> = info.held.iter().map(HeldCoordinate::from).collect();
            let error = model.posture_with(&held).err()?;
            let message = Diagnostic::error(error.to_string()).in_file(&self.tables.folder.join("trials.csv"));
            let message = message.at_line(info.line);
            Some(match error.hint() {
                Some(hint) => message.hint(hint),
                None => message,
            })
        };
        let wrong: Vec<Diagnostic> = trials.filter_map(wrong).collect();
        if wrong.is_empty() { Ok(()) } else { Err(wrong.into()) }
    }

    /// Checks the recorded angles against the range of the coordinate. Returns warnings of angles a little outside.
    fn check_trials(
        &self,
        of: &Participant,
        trials: &[Trial],
        model: &MusculoskeletalModel,
    ) -> Result<Vec<Diagnostic>, Failure> {
        if trials.is_empty() {
            let message = Diagnostic::error(format!("participant {} has no trials to simulate", of.name));
            return Err(message.in_file(&self.tables.folder.join("trials.csv")).into());
        }
        check_angles(trials, model)
    }
}

impl LoadedParticipant {
    /// Simulates all trials with the given parameters of the active muscles.
    ///
    /// # Errors
    /// A muscle whose forces cannot be balanced.
    pub fn simulate(&self, parameters: &[MuscleParameters]) -> Result<Vec<TrialSimulation>, Failure> {
        carpus_simulation::simulation::simulate_all(&self.prepared, parameters)
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

/// The warning that no trial to train on holds a contraction.
fn only_passive(run: &LoadedParticipant) -> Option<Diagnostic> {
    let mut trained = run.trials.iter().filter(|t| t.info.usage == TrialUse::Train).peekable();
    if trained.peek().is_none() || !trained.all(|t| t.info.contraction == Contraction::Passive) {
        return None;
    }
    let text = format!(
        "participant {}: every trial with use = train is passive: p-values are not calibrated",
        run.participant.name
    );
    let hint =
        "of eight clean studies of six passive trials five raised an alarm; add trials in which muscles contract";
    Some(Diagnostic::warning(text).in_file(&run.trials_file).hint(hint))
}

/// The warning that muscles have a mass between fibre and tendon, without which they are simulated.
fn masses_left_out(loaded: &LoadedModel, model: &MusculoskeletalModel) -> Option<Diagnostic> {
    let is_active = |muscle: &&MuscleSpec| model.muscle_names().any(|name| name == muscle.name);
    let massive =
        loaded.file.spec.muscles.iter().filter(is_active).filter(|m| m.class() == "Delp1990Muscle_Deprecated");
    let names: Vec<&str> = massive.map(|m| m.name.as_str()).collect();
    (!names.is_empty()).then(|| {
        let text = format!("simulated without their mass between fibre and tendon: {}", names.join(", "));
        let hint = "in wrist movements forces are within 1e-4 of the maximum isometric force after the first 0.1 s";
        Diagnostic::warning(text).in_file(&loaded.path).hint(hint)
    })
}

/// Effects that lie beside a model.
fn beside(model: &Path) -> Option<PathBuf> {
    let file = model.parent()?.join("effects.toml");
    file.is_file().then_some(file)
}

/// Moment arm times maximum isometric force [N·m], per active muscle and sample of a trial.
pub(super) fn strengths(trial: &PreparedTrial, model: &MusculoskeletalModel) -> Vec<Vec<f64>> {
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
) -> Result<Vec<Diagnostic>, Failure> {
    let names: Vec<String> = model.muscle_names().map(String::from).collect();
    let muscles = loaded.muscles(&names)?;
    let mut postures: Vec<(Vec<HeldCoordinate>, [f64; 2])> = Vec::new();
    for trial in trials {
        let held: Vec<HeldCoordinate> = trial.info.held.iter().map(HeldCoordinate::from).collect();
        let [low, high] =
            trial.angle.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], a| [l.min(*a), h.max(*a)]);
        match postures.iter_mut().find(|(known, _)| *known == held) {
            Some((_, range)) => *range = [range[0].min(low), range[1].max(high)],
            None => postures.push((held, [low, high])),
        }
    }
    let mut found: Vec<Diagnostic> = Vec::new();
    for (held, range) in postures {
        let posture = model.posture_with(&held).map_err(|e| Failure::from(simulation_message(&e, loaded)))?;
        let new = path_check::over_range(loaded, &muscles, model.coordinate(), &posture, range)?;
        // A path that is wrong in several postures is named once.
        found.extend(new.into_iter().filter(|d| !found.contains(d)).collect::<Vec<_>>());
    }
    Ok(found)
}

/// Checks recorded angles against the range of the coordinate. Returns warnings of those a little outside.
fn check_angles<'a>(
    trials: impl IntoIterator<Item = &'a Trial>,
    model: &MusculoskeletalModel,
) -> Result<Vec<Diagnostic>, Failure> {
    let coordinate = &model.skeleton().coordinates[model.coordinate().0];
    let is_translation = coordinate.motion_type == MotionType::Translational;
    let problems: Vec<Diagnostic> = trials
        .into_iter()
        .filter_map(|t| t.check_against_range(&coordinate.name, is_translation, coordinate.range))
        .map(|p| Diagnostic::from(&p))
        .collect();
    if problems.iter().any(|p| p.severity == Severity::Error) { Err(problems.into()) } else { Ok(problems) }
}

/// How trials are simulated whose angles were checked against the coordinate's range: a little outside is allowed.
fn checked_angles() -> Options {
    Options { allow_angle_outside_range: true, ..Options::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_study::study::{Contraction, Direction, TrialInfo, TrialUse};

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
