//! A study with a hidden effect.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::json;

use super::account::csv_text;
use super::candidates::{EffectSize, at_size, known};
use super::diagnostic::{Diagnostic, Failure};
use super::json::pretty;
use super::loading::LoadedParticipant;
use super::output::OutputFolder;
use super::participant::StudyParticipant;
use super::progress::{Progress, go_on};
use super::provenance::{DEFAULT_SEED, hash_of};
use super::study::Study;
use carpus_effects::angle_noise::AngleNoise;
use carpus_effects::forward_model::{ForwardModel, Setting};
use carpus_effects::holds::steadied_trials;
use carpus_effects::own_effect::{definition, registered};
use carpus_effects::synthesis::{RecordingNoise, Synthetic, largest_moments, synthesize};
use carpus_report::results::{InputFile, rounded};
use carpus_study::study::{Participant, Settings, Trial, is_of_a_study, write};

/// What the files say about where they come from.
pub const ORIGIN: &str = "Simulated by Carpus itself, not by OpenSim and not by a person: for teaching and for tests.";

/// A study to be simulated along the recordings of another.
#[derive(Clone, Debug, PartialEq)]
pub struct Synthesize {
    /// Effects to hide, with their sizes.
    pub effects: Vec<EffectSize>,
    /// Noise of the recordings.
    pub noise: RecordingNoise,
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for Synthesize {
    fn default() -> Self {
        Synthesize { effects: Vec::new(), noise: RecordingNoise::REALISTIC, seed: DEFAULT_SEED }
    }
}

/// A participant whose trials were simulated.
#[derive(Clone, Debug)]
pub struct Made {
    /// The participant, with the maximum moments of the simulation.
    pub participant: Participant,
    model: String,
    model_bytes: Vec<u8>,
    /// What is hidden.
    pub effects: Vec<Setting>,
    /// Its sizes as people give them.
    pub reported: Vec<Vec<f64>>,
    /// The trials, and the muscles' parameters behind them.
    pub synthetic: Synthetic,
    /// What is hidden, for programs.
    pub truth: serde_json::Value,
    inputs: Vec<InputFile>,
}

impl Synthesize {
    /// Fails if there is no such effect.
    ///
    /// # Errors
    /// There is none.
    pub fn check(&self) -> Result<(), Failure> {
        self.effects.iter().try_for_each(|asked| known(&asked.id).map(|_| ()))
    }
}

impl Study {
    /// Simulates the trials of every participant with hidden effects and parameters and writes them as a study;
    /// `truth.json` says what is hidden.
    ///
    /// - `out`: [`Study::output_folder`] of `carpus synth`
    ///
    /// # Errors
    /// The models and trials, the effects and their sizes, the disk; a request to stop.
    pub fn synthesize(
        &self,
        request: &Synthesize,
        out: &OutputFolder,
        progress: &dyn Progress,
    ) -> Result<Vec<Made>, Failure> {
        request.check()?;
        let mut made = Vec::new();
        for (done, participant) in self.participants().enumerate() {
            go_on(progress)?;
            progress.at("simulating", done, self.chosen().len());
            let one = make(request, self, &participant, progress)?;
            one.synthetic.trials.iter().try_for_each(holdable)?;
            made.push(one);
        }
        progress.finished();
        write_study(self, &made, request, out)?;
        Ok(made)
    }
}

/// What was made, for programs.
///
/// - `study`: the study.toml that was written
pub fn made_value(study: &Path, made: &[Made]) -> serde_json::Value {
    json!({
        "schema": "carpus.synth/1",
        "study": study,
        "participants": made.iter().map(|m| m.truth.clone()).collect::<Vec<_>>(),
    })
}

fn make(
    request: &Synthesize,
    study: &Study,
    participant: &StudyParticipant<'_>,
    progress: &dyn Progress,
) -> Result<Made, Failure> {
    let run = participant.load()?.data;
    let participant = participant.about();
    progress.warnings(&run.warnings);
    let at_model = |text: String| Diagnostic::error(text).in_file(&run.loaded.path);
    // Where the machine held the joint it was still: what the recorded angle did there was noise.
    let trials = match AngleNoise::of(&run.trials) {
        Some(noise) => steadied_trials(&run.trials, &noise),
        None => run.trials.clone(),
    };
    let forward = ForwardModel::new(&run.loaded.file.spec, &run.model, &trials).map_err(|e| at_model(e.to_string()))?;
    let effects = request
        .effects
        .iter()
        .map(|asked| {
            let (setting, warnings) = at_size(asked, &forward.muscles, &forward.joint)?;
            progress.warnings(&warnings);
            Ok(setting)
        })
        .collect::<Result<Vec<Setting>, Failure>>()?;
    // Every participant has an own seed, the same whoever else is asked for.
    let place = study.tables.participants.iter().position(|p| p.name == participant.name).unwrap_or(0) as u64;
    let seed = request.seed.wrapping_add(place.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let mut synthetic =
        synthesize(&forward, &trials, &effects, &request.noise, seed).map_err(|e| at_model(e.to_string()))?;
    // Noise alone takes no angle beyond the range, or beyond what was recorded outside of it.
    let [low, high] = run.model.skeleton().coordinates[run.model.coordinate().0].range;
    let angles = run.trials.iter().flat_map(|t| &t.angle);
    let [low, high] = angles.fold([low, high], |[low, high], a| [low.min(*a), high.max(*a)]);
    synthetic.trials.iter_mut().flat_map(|t| &mut t.angle).for_each(|a| *a = a.clamp(low, high));
    let [up, down] = largest_moments(&run.trials, &synthetic.true_moment);
    let participant = Participant {
        mvc_flexion: participant.mvc_flexion.map(|_| up).filter(|m| *m > 0.0),
        mvc_extension: participant.mvc_extension.map(|_| down).filter(|m| *m > 0.0),
        ..participant.clone()
    };
    let name = run.loaded.path.file_name().map_or("model.osim".into(), |n| n.to_string_lossy().into_owned());
    let reported = effects.iter().map(|s| s.effect.reported(&s.values, &forward.muscles)).collect::<Vec<_>>();
    let truth = truth(&run, &forward, &effects, &reported, &synthetic);
    Ok(Made {
        model: if participant.own_model { format!("{}_{name}", participant.name) } else { name },
        model_bytes: run.loaded.file.document.bytes().to_vec(),
        participant,
        effects,
        reported,
        synthetic,
        truth,
        inputs: run.inputs,
    })
}

/// What is hidden.
fn truth(
    run: &LoadedParticipant,
    forward: &ForwardModel,
    effects: &[Setting],
    reported: &[Vec<f64>],
    synthetic: &Synthetic,
) -> serde_json::Value {
    let effects = effects.iter().zip(reported).map(|(s, reported)| {
        let description = s.effect.description();
        let parameters: BTreeMap<_, _> = description
            .parameters
            .iter()
            .zip(reported)
            .map(|(p, v)| (p.name, json!({ "value": rounded(*v, 9), "unit": p.unit })))
            .collect();
        match definition(s.effect) {
            Some(own) => json!({ "id": description.id, "parameters": parameters, "definition": own.text }),
            None => json!({ "id": description.id, "parameters": parameters }),
        }
    });
    let muscles: BTreeMap<String, serde_json::Value> = run
        .model
        .muscle_names()
        .zip(synthetic.parameters.iter().zip(forward.nominal_parameters()))
        .map(|(name, (p, nominal))| {
            let values = json!({
                "optimal_fiber_length": rounded(p.optimal_fiber_length, 9),
                "tendon_slack_length": rounded(p.tendon_slack_length, 9),
                "max_isometric_force": rounded(p.max_isometric_force, 9),
                "factors": {
                    "optimal_fiber_length": rounded(p.optimal_fiber_length / nominal.optimal_fiber_length, 6),
                    "tendon_slack_length": rounded(p.tendon_slack_length / nominal.tendon_slack_length, 6),
                    "max_isometric_force": rounded(p.max_isometric_force / nominal.max_isometric_force, 6),
                },
            });
            (name.to_owned(), values)
        })
        .collect();
    json!({ "participant": run.participant.name, "effects": effects.collect::<Vec<_>>(), "muscles": muscles })
}

/// Fails if a study cannot hold a trial's numbers: no command would read what is written.
fn holdable(trial: &Trial) -> Result<(), Failure> {
    let numbers = trial.moment.iter().chain(&trial.angle).chain(trial.excitation.iter().flatten());
    match numbers.copied().find(|v| !is_of_a_study(*v)) {
        Some(number) => {
            let text =
                format!("trial {}: the effects make a number of {number:e}, which no study can hold", trial.info.name);
            Err(Diagnostic::error(text).hint("give the effects smaller sizes").into())
        }
        None => Ok(()),
    }
}

fn write_study(study: &Study, made: &[Made], request: &Synthesize, out: &OutputFolder) -> Result<(), Failure> {
    let settings = &study.tables.settings;
    let mut outputs = BTreeMap::new();
    let mut put = |name: &str, bytes: &[u8]| -> Result<(), Failure> {
        out.write(name, bytes)?;
        outputs.insert(name.to_owned(), hash_of(bytes));
        Ok(())
    };
    let mut listed = Vec::new();
    for one in made {
        for trial in &one.synthetic.trials {
            let file = format!("data/{}/{}.csv", one.participant.name, trial.info.name);
            put(&file, csv(write::trial_rows(trial, &settings.active_muscles))?.as_bytes())?;
            listed.push((trial, file));
        }
        put(&one.model, &one.model_bytes)?;
    }
    // The study needs a model even if every participant has an own one.
    let shared = made.iter().find(|m| !m.participant.own_model).or(made.first());
    let comment = format!("{ORIGIN}\nWritten by carpus synth; manifest.json says how, truth.json what is hidden.");
    let name = format!("{}, simulated", settings.name);
    let model = shared.map_or("", |m| m.model.as_str());
    // Effects beside the catalogue go along: what may be hidden is known, what is hidden is not.
    let mut own_effects = Vec::new();
    for effect in registered() {
        let file = format!("own_effects/{}.toml", effect.defined().id);
        put(&file, effect.defined().text.as_bytes())?;
        own_effects.push(file.into());
    }
    let settings = &Settings { own_effects, ..settings.clone() };
    put("study.toml", write::settings_text(settings, &name, model, &comment).as_bytes())?;
    let participants: Vec<(&Participant, Option<String>)> =
        made.iter().map(|m| (&m.participant, m.participant.own_model.then(|| m.model.clone()))).collect();
    put("participants.csv", csv(write::participant_rows(&participants))?.as_bytes())?;
    let listed: Vec<(&Trial, String)> = listed;
    put("trials.csv", csv(write::trial_list_rows(&listed))?.as_bytes())?;
    let truth = json!({
        "schema": "carpus.truth/1",
        "note": "What is hidden in the study. For judging an analysis afterwards; no command reads it.",
        "simulator": ORIGIN,
        "participants": made.iter().map(|m| &m.truth).collect::<Vec<_>>(),
    });
    put("truth.json", (pretty(&truth)? + "\n").as_bytes())?;
    let mut inputs: Vec<InputFile> = Vec::new();
    for input in made.iter().flat_map(|m| &m.inputs) {
        if !inputs.contains(input) {
            inputs.push(input.clone());
        }
    }
    let manifest = json!({
        "schema": "carpus.manifest/1",
        "simulator": ORIGIN,
        "provenance": study.provenance(request, request.seed, inputs),
        "noise": request.noise,
        "outputs": outputs,
    });
    out.write("manifest.json", (pretty(&manifest)? + "\n").as_bytes())?;
    Ok(())
}

fn csv(rows: Vec<Vec<String>>) -> Result<String, Failure> {
    let mut rows = rows.into_iter();
    let header = rows.next().unwrap_or_default();
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    csv_text(header.iter(), rows)
}
