//! Where the model fails, and which physical effect is missing.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use super::account::ModelRun;
use super::candidates::{candidates, without_property};
use super::diagnosis_file::{self, KnownDiagnosis, definitions, proposal_file};
use super::diagnostic::{Diagnostic, Failure};
use super::images::images;
use super::json;
use super::live_case::state;
use super::loading::{LoadedParticipant, Purpose};
use super::output::OutputFolder;
use super::participant::Session;
use super::prepared::{forward_model_of, laboratory, largest_moment};
use super::provenance::DEFAULT_SEED;
use super::residuals::residual_result;
use super::result_files::{account, write_results};
use carpus_diagnosis::baselines::Ingredients;
use carpus_diagnosis::cohort::ParticipantEvidence;
use carpus_diagnosis::diagnose::{Diagnosis, Outcome, PHASES, Request, diagnose};
use carpus_effects::effect::Effect;
use carpus_effects::forward_model::{ForwardModel, Setting};
use carpus_effects::moments::simulate_all;
use carpus_report::results::{Kind, Results, rounded};
use carpus_simulation::simulation::MuscleParameters;
use carpus_study::study::TrialUse;

/// Key of what simpler methods need, in `diagnosis.json`.
pub(super) const BASELINES: &str = "baselines";

/// A diagnosis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnose {
    /// Seed of everything random; the same seed gives the same bytes.
    pub seed: u64,
    /// Identifiers of the effects that may be named; none, or `all`: the whole catalogue and the laboratory's own. The
    /// others are taken to be as small as everything in a laboratory.
    pub candidates: Vec<String>,
    /// Whether what simpler methods need to compare themselves is written, too.
    pub baselines: bool,
}

impl Default for Diagnose {
    fn default() -> Self {
        Diagnose { seed: DEFAULT_SEED, candidates: Vec::new(), baselines: false }
    }
}

/// A diagnosis of a participant's trials.
pub struct Diagnosed<'a> {
    session: &'a Session<'a>,
    /// Verdict, explanations, effects, errors.
    pub diagnosis: Diagnosis,
    /// What is written as `diagnosis.json`, but for baselines.
    pub known: KnownDiagnosis,
    /// What is written as `results.json`: the model as given, with its muscles refitted, and with the best explanation.
    pub results: Results,
    /// What is written as `evidence.json`: a cohort is pooled from it.
    pub evidence: ParticipantEvidence,
    baselines: Option<Ingredients>,
}

impl Session<'_> {
    /// Diagnoses which physical effects are missing. Held-out trials (use = test) are never fitted. Trials that were
    /// not read for this purpose are read again for it.
    ///
    /// # Errors
    /// An unknown effect; fewer than two trials to train on; a trial that cannot be simulated.
    pub fn diagnose(&self, request: &Diagnose) -> Result<Diagnosed<'_>, Failure> {
        let again = self.read_for(Purpose::Diagnosis)?;
        let session = again.as_ref().unwrap_or(self);
        let forward = forward_model(&session.data)?;
        session.diagnosed(&forward, request).map(|found| found.of(self))
    }

    /// As [`Session::diagnose`], of trials that were read for the purpose.
    ///
    /// - `forward`: [`forward_model`] of the session
    ///
    /// # Errors
    /// As there.
    pub fn diagnosed(&self, forward: &ForwardModel, request: &Diagnose) -> Result<Diagnosed<'_>, Failure> {
        let progress = self.progress()?;
        let run = &self.data;
        let candidates = candidates(&request.candidates)?;
        for warning in without_property(&candidates, run) {
            progress.warning(&warning);
        }
        let asked = self.estimation(forward, candidates, request.seed)?;
        let name = &run.participant.name;
        let at = |phase: usize| progress.at(&format!("{name}: {}", PHASES[phase]), phase, PHASES.len());
        let outcome = diagnose(&asked, &at)
            .map_err(|e| Failure::from(Diagnostic::error(e.to_string()).in_file(&run.loaded.path)))?;
        progress.finished();
        let restricted: &[String] = if request.candidates == ["all"] { &[] } else { &request.candidates };
        let provenance = self.study.provenance(request, request.seed, run.inputs.clone());
        let value = diagnosis_file::value(&outcome, &provenance, restricted)?;
        let results = with_models(self, request, forward, &outcome, &value)?;
        let known = KnownDiagnosis { result: diagnosis_file::result(&value)?, value };
        let baselines = request.baselines.then_some(outcome.ingredients);
        let Outcome { diagnosis, evidence, .. } = outcome;
        Ok(Diagnosed { session: self, diagnosis, known, results, evidence, baselines })
    }

    /// What is asked of the one estimator.
    ///
    /// # Errors
    /// An image in which the model has no such muscle.
    pub(super) fn estimation<'a>(
        &'a self,
        forward: &'a ForwardModel,
        candidates: Vec<&'static dyn Effect>,
        seed: u64,
    ) -> Result<Request<'a>, Failure> {
        let run = &self.data;
        Ok(Request {
            participant: run.participant.name.clone(),
            forward,
            laboratory: Some(laboratory(run)),
            bounds: self.study.tables.settings.bounds,
            images: images(self.study, run)?,
            candidates,
            mvc: largest_moment(run),
            seed,
        })
    }

    /// The diagnosis of these files by the whole catalogue: the one in the folder of results if it is of the same
    /// bytes, else a new one, which is written there.
    ///
    /// # Errors
    /// A trial that cannot be simulated; the disk.
    pub fn known_or_made(
        &self,
        out: &OutputFolder,
        forward: &ForwardModel,
        seed: u64,
    ) -> Result<KnownDiagnosis, Failure> {
        let folder = Path::new(&self.data.participant.name);
        let file = out.path().join(folder).join("diagnosis.json");
        if let Some(known) = diagnosis_file::read(&file, &self.data.inputs, seed) {
            for file in ["diagnosis.json", "evidence.json", "results.json", "report.html", "error.svg"] {
                out.keep(folder.join(file));
            }
            for (i, _) in definitions(&known.value).enumerate() {
                out.keep(folder.join(proposal_file(i)));
            }
            return Ok(known);
        }
        if file.exists() {
            let text = "is of other files, another seed or another version, or leaves effects out: the data are \
                        diagnosed anew";
            self.progress()?.warning(&Diagnostic::warning(text).in_file(&file));
        }
        let made = self.diagnosed(forward, &Diagnose { seed, ..Diagnose::default() })?;
        made.write_to(out, folder)?;
        Ok(made.known)
    }
}

impl Diagnosed<'_> {
    /// The same diagnosis, as a result of the session that it was asked of.
    fn of<'t>(self, session: &'t Session<'t>) -> Diagnosed<'t> {
        let Diagnosed { diagnosis, known, results, evidence, baselines, .. } = self;
        Diagnosed { session, diagnosis, known, results, evidence, baselines }
    }

    /// Writes `diagnosis.json`, proposed formulas as effects' files, `evidence.json`, `results.json` and its report.
    ///
    /// - `folder`: the participant's, in the folder of the results
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder, folder: &Path) -> Result<(), Failure> {
        diagnosis_file::write(out, folder, &self.written()?)?;
        out.write(folder.join("evidence.json"), json::text(&self.evidence)?.as_bytes())?;
        write_results(out, folder, &self.results)
    }

    /// What is written as `diagnosis.json`, with baselines if they were asked for.
    pub(super) fn written(&self) -> Result<Value, Failure> {
        let mut value = self.known.value.clone();
        if let Some(ingredients) = &self.baselines {
            value[BASELINES] = serde_json::to_value(ingredients).map_err(|e| Failure::Internal(e.to_string()))?;
        }
        Ok(value)
    }

    /// Writes the files of `carpus diagnose` into a folder of results. Returns what a person should know about files of
    /// earlier runs.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of this study and command.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<Vec<Diagnostic>, Failure> {
        self.session.write_results(path.as_ref(), "diagnose", |out, folder| self.write_to(out, folder))
    }
}

/// The results of a diagnosis: the model as given, with its muscles refitted, and with the best explanation.
///
/// # Errors
/// A trial that cannot be simulated.
fn with_models(
    session: &Session<'_>,
    request: &Diagnose,
    forward: &ForwardModel,
    outcome: &Outcome,
    value: &Value,
) -> Result<Results, Failure> {
    let run = &session.data;
    let nominal = forward.nominal_parameters();
    let refitted = &outcome.recalibrated.parameters;
    let mut fitted: Vec<(&str, String, &[MuscleParameters], &[Setting])> =
        vec![("base", "As given".to_owned(), &nominal, &[]), ("refit", "Muscles refitted".to_owned(), refitted, &[])];
    let (parameters, effects) = (&outcome.handed_over.parameters, &outcome.handed_over.effects);
    if !effects.is_empty() {
        let names = effects.iter().map(|s| s.effect.description().name).collect::<Vec<_>>().join(" + ");
        fitted.push(("with_effect", format!("With {names}"), parameters, effects));
    }
    let mut models = Vec::new();
    let mut residuals = Vec::new();
    for (id, label, parameters, effects) in fitted {
        let simulated = simulate_all(forward, parameters, effects)
            .map_err(|e| Diagnostic::error(e.to_string()).in_file(&run.loaded.path))?;
        let moments: Vec<Vec<f64>> = simulated.into_iter().map(|t| t.moment).collect();
        residuals.push(residual_result(run, id, &moments));
        let file = run.loaded.path.display().to_string();
        let name = run.loaded.model.name.clone();
        models.push(ModelRun { id: id.to_owned(), label, name, file, moments });
    }
    let mut results = account(Kind::Diagnosis, session, request, request.seed, &models)?;
    results.residuals = residuals;
    results.parameters = super::personalize::parameters(run, &outcome.muscles, true);
    results.part_of_the_way = Some(rounded(outcome.recalibrated.part, 4));
    results.diagnosis = Some(diagnosis_file::result(value)?);
    let mut states = vec![state("Muscles refitted", refitted, &outcome.muscles, &[], &BTreeMap::new())];
    if !effects.is_empty() {
        let names = effects.iter().map(|s| s.effect.description().name).collect::<Vec<_>>().join(" + ");
        states.push(state(&format!("With {names}"), parameters, &[], effects, &BTreeMap::new()));
    }
    results.live = session.live_case(request.seed, false, states)?;
    Ok(results)
}

/// The trials of a participant, ready to be diagnosed.
///
/// # Errors
/// A trial that cannot be simulated; nothing to train on.
pub fn forward_model(run: &LoadedParticipant) -> Result<ForwardModel, Failure> {
    let forward = forward_model_of(run)?;
    let found = forward.trials_for(TrialUse::Train).len();
    if found < 2 {
        let name = &run.participant.name;
        let text = format!("participant {name}: expected at least two trials with use = train, found {found}");
        let message = Diagnostic::error(text).in_file(&run.trials_file);
        return Err(message.hint("a diagnosis compares trials with each other").into());
    }
    Ok(forward)
}
