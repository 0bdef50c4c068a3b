//! Effects added to a model step by step: every step's model as it is written, the ledger, results.

use std::path::Path;

use super::account::{ModelRun, warning_result};
use super::candidates::{candidates, without_property};
use super::diagnosis_file::KnownDiagnosis;
use super::diagnostic::{Diagnostic, Failure, Severity};
use super::effect_choice::is_supported;
use super::live_case::state;
use super::loading::LoadedParticipant;
use super::output::OutputFolder;
use super::participant::Session;
use super::personalize::parameters;
use super::provenance::DEFAULT_SEED;
use super::residuals::residual_result;
use super::result_files::{account, write_results};
use carpus_diagnosis::addition::{FittedStep, fit_steps};
use carpus_diagnosis::diagnose::rmse;
use carpus_effects::effect::Effect;
use carpus_effects::export::{self, SideCar};
use carpus_effects::forward_model::{ForwardModel, Setting};
use carpus_effects::moments::simulate_all;
use carpus_osim::osim::OsimFile;
use carpus_report::ledger::{Choice, Estimate, LEDGER_SCHEMA, Ledger, Step};
use carpus_report::results::{Kind, Results, rounded};
use carpus_simulation::simulation::{MuscleParameters, MusculoskeletalModel};
use carpus_study::study::TrialUse;

/// Effects that are added to a participant's model, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AddEffects {
    /// Seed of everything random.
    pub seed: u64,
    /// Whether a person insists on effects that the diagnosis does not support; this is recorded.
    pub i_choose: bool,
}

impl Default for AddEffects {
    fn default() -> Self {
        AddEffects { seed: DEFAULT_SEED, i_choose: false }
    }
}

/// A model with effects.
pub struct WithEffects {
    /// What is written as `results.json`, with the ledger.
    pub results: Results,
    steps: Vec<Written>,
}

impl Session<'_> {
    /// Fits the muscles, then with one effect after the other.
    ///
    /// - `out`: the folder of results where steps are going to be written, for warnings
    /// - `forward`: [`super::diagnose::forward_model`] of the session, whose trials were read for a diagnosis
    /// - `effects`: [`super::effect_choice`] says which
    ///
    /// # Errors
    /// A trial that cannot be simulated; an effect that cannot be written.
    pub fn add_effects(
        &self,
        out: &Path,
        forward: &ForwardModel,
        effects: &[&'static dyn Effect],
        diagnosis: &KnownDiagnosis,
        request: &AddEffects,
    ) -> Result<WithEffects, Failure> {
        let (run, progress) = (&self.data, self.progress()?);
        let at_model = |text: String| Failure::from(Diagnostic::error(text).in_file(&run.loaded.path));
        if let Some(missing) = without_property(effects, run).into_iter().next() {
            return Err(Diagnostic { severity: Severity::Error, ..missing }.into());
        }
        let asked = self.estimation(forward, candidates(&[])?, request.seed)?;
        let what = format!("fitting {}", run.participant.name);
        progress.at(&what, 0, 1 + effects.len());
        let fitted = fit_steps(&asked, effects, &|done| progress.at(&what, done, 1 + effects.len()));
        progress.finished();
        let fitted = fitted.map_err(|e| at_model(e.to_string()))?;

        // Fits are content with less; what is reported is simulated as accurately as everywhere else, and of the angles
        // as recorded.
        let forward = &ForwardModel::new(&run.loaded.file.spec, &run.model, &run.trials)
            .map_err(|e| at_model(e.to_string()))?
            .with_given(run.given.clone());
        let mut steps = vec![written(self, forward, "0_base".to_owned(), None)?];
        for (i, step) in fitted.iter().enumerate() {
            let last = step.effects.last().map_or("refit", |s| s.effect.description().id);
            steps.push(written(self, forward, format!("{}_{last}", i + 1), Some(step))?);
        }
        let mut warnings = run.warnings.clone();
        for step in steps.iter().filter(|s| s.differs > SAME * asked.mvc) {
            let text = format!("the written model differs by {:.2e} N·m from the one that was fitted", step.differs);
            let folder = out.join(&run.participant.name).join(&step.folder);
            warnings.push(Diagnostic::warning(text).in_file(&folder));
        }
        let ledger = ledger(run, forward, asked.mvc, &fitted, &steps, choice(diagnosis, effects, request.i_choose));
        let mut results = results(self, request, &ledger, &steps)?;
        results.warnings = warnings.iter().map(warning_result).collect();
        let last = fitted.last();
        results.parameters = last.map(|step| parameters(run, &step.muscles, true)).unwrap_or_default();
        results.part_of_the_way = last.map(|step| rounded(step.part_of_the_way, 4));
        results.diagnosis = Some(diagnosis.result.clone());
        let of_step = |(step, fit): (&Step, &FittedStep)| {
            state(&step.label, &fit.parameters, &fit.muscles, &fit.effects, &fit.estimates)
        };
        let states = ledger.steps[1..].iter().zip(&fitted).map(of_step).collect();
        results.live = self.live_case(request.seed, false, states)?;
        results.ledger = Some(ledger);
        Ok(WithEffects { results, steps })
    }
}

impl WithEffects {
    /// The model with all effects that its file can have.
    pub fn model(&self) -> Option<&OsimFile> {
        self.steps.last().map(|step| &step.file)
    }

    /// Writes every step's model and the last one's, effects beside them, the ledger, `results.json` and its report.
    ///
    /// - `folder`: the participant's, in the folder of the results
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder, folder: &Path) -> Result<(), Failure> {
        for step in &self.steps {
            let at = folder.join("steps").join(&step.folder);
            out.write(at.join("model.osim"), step.file.document.bytes())?;
            put_side_car(out, &at, &step.side_car)?;
        }
        if let Some(last) = self.steps.last() {
            out.write(folder.join("model.osim"), last.file.document.bytes())?;
            put_side_car(out, folder, &last.side_car)?;
        }
        if let Some(ledger) = &self.results.ledger {
            let text = serde_json::to_string_pretty(ledger).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
            out.write(folder.join("ledger.json"), text.as_bytes())?;
        }
        write_results(out, folder, &self.results)
    }
}

/// Written models whose moments differ by more of the largest moment from what was fitted get a warning.
const SAME: f64 = 1e-3;

/// A step's model as it is written, and what it gives when it is read again.
struct Written {
    folder: String,
    file: OsimFile,
    side_car: SideCar,
    moments: Vec<Vec<f64>>,
    differs: f64,
}

/// Puts a step into a copy of the model file and simulates what stands there.
fn written(
    session: &Session<'_>,
    forward: &ForwardModel,
    folder: String,
    step: Option<&FittedStep>,
) -> Result<Written, Failure> {
    let (study, run) = (session.study, &session.data);
    let at_model = |text: String| Failure::from(Diagnostic::error(text).in_file(&run.loaded.path));
    let simulate = |forward: &ForwardModel, parameters: &[MuscleParameters], effects: &[Setting]| {
        let simulated = simulate_all(forward, parameters, effects).map_err(|e| at_model(e.to_string()))?;
        Ok::<_, Failure>(simulated.into_iter().map(|t| t.moment).collect::<Vec<_>>())
    };
    let mut file = run.loaded.file.clone();
    let mut side_car =
        SideCar { coordinate: study.tables.settings.dynamometer.coordinate.clone(), effects: run.given.clone() };
    let Some(step) = step else {
        let parameters = forward.nominal_parameters();
        let moments = simulate(forward, &parameters, &[])?;
        return Ok(Written { folder, file, side_car, moments, differs: 0.0 });
    };
    let names: Vec<String> = run.model.muscle_names().map(String::from).collect();
    let (given, arm_turns) = (run.model.nominal_parameters(), run.trials.iter().any(|t| t.info.arm_flipped));
    let setup = run.model.setup();
    let beside = export::write_step(&mut file, setup, &names, &given, &step.parameters, &step.effects, arm_turns)
        .map_err(|e| at_model(e.to_string()))?;
    side_car.effects.extend(beside);
    // What is reported is what the written files give.
    let compiled = MusculoskeletalModel::compile(&file.spec, run.model.setup()).map_err(|e| at_model(e.to_string()))?;
    let again = ForwardModel::new(&file.spec, &compiled, &run.trials).map_err(|e| at_model(e.to_string()))?;
    let again = again.with_given(side_car.effects.clone());
    let moments = simulate(&again, &again.nominal_parameters(), &[])?;
    let intended = simulate(forward, &step.parameters, &step.effects)?;
    let pairs = moments.iter().flatten().zip(intended.iter().flatten());
    let differs = pairs.fold(0.0, |most, (a, b)| f64::max(most, (a - b).abs()));
    Ok(Written { folder, file, side_car, moments, differs })
}

fn ledger(
    run: &LoadedParticipant,
    forward: &ForwardModel,
    mvc: f64,
    fitted: &[FittedStep],
    steps: &[Written],
    choice: Choice,
) -> Ledger {
    let given: Vec<String> = run.given.iter().map(|s| s.effect.description().id.to_owned()).collect();
    let error = |step: &Written, usage: TrialUse| {
        let simulated: Vec<(usize, Vec<f64>)> =
            forward.trials_for(usage).into_iter().map(|g| (g, step.moments[g].clone())).collect();
        rmse(forward, &simulated).map(|e| rounded(e / mvc, 6))
    };
    let step = |i: usize| {
        let (written, fit) = (&steps[i], i.checked_sub(1).map(|i| &fitted[i]));
        let settings = fit.map(|f| f.effects.as_slice()).unwrap_or_default();
        let label = match (i, settings.last()) {
            (0, _) => "Model as given".to_owned(),
            (_, None) => "Muscles refitted".to_owned(),
            (_, Some(last)) => format!("+ {}", last.effect.description().name),
        };
        let added = settings.iter().map(|s| s.effect.description().id.to_owned());
        Step {
            id: written.folder.clone(),
            label,
            effects: given.iter().cloned().chain(added).collect(),
            model: format!("steps/{}/model.osim", written.folder),
            side_car: (!written.side_car.effects.is_empty()).then(|| format!("steps/{}/effects.toml", written.folder)),
            train: error(written, TrialUse::Train).unwrap_or(0.0),
            held_out: error(written, TrialUse::Test),
            p_value: fit.and_then(|f| f.p_value),
            written_differs_n_m: fit.map(|_| rounded(written.differs, 3)),
            parameters: fit
                .iter()
                .flat_map(|f| &f.estimates)
                .map(|(name, e)| {
                    let unit = e.unit.to_owned();
                    (name.clone(), Estimate { value: e.value, unit, ci95: e.ci95, plausible: e.plausible })
                })
                .collect(),
        }
    };
    let steps: Vec<Step> = (0..steps.len()).map(step).collect();
    // Noise is no more than what is left.
    let left = steps.last().map_or(0.0, |last| last.train);
    let floor = fitted.last().map_or(0.0, |f| f.noise_floor / mvc).min(left);
    Ledger {
        schema: LEDGER_SCHEMA.to_owned(),
        participant: run.participant.name.clone(),
        measure: "RMSE / session MVC moment".to_owned(),
        noise_floor: rounded(floor, 6),
        choice,
        current: steps.len() - 1,
        steps,
    }
}

fn results(
    session: &Session<'_>,
    request: &AddEffects,
    ledger: &Ledger,
    steps: &[Written],
) -> Result<Results, Failure> {
    let run = &session.data;
    let models: Vec<ModelRun> = steps
        .iter()
        .zip(&ledger.steps)
        .map(|(written, step)| ModelRun {
            id: step.id.clone(),
            label: step.label.clone(),
            name: run.loaded.model.name.clone(),
            file: step.model.clone(),
            moments: written.moments.clone(),
        })
        .collect();
    let mut results = account(Kind::Effects, session, request, request.seed, &models)?;
    results.residuals = models.iter().map(|m| residual_result(run, &m.id, &m.moments)).collect();
    Ok(results)
}

/// What a person chose, beside what the diagnosis says.
fn choice(diagnosis: &KnownDiagnosis, effects: &[&'static dyn Effect], i_choose: bool) -> Choice {
    let chosen: Vec<String> = effects.iter().map(|e| e.description().id.to_owned()).collect();
    let explanations: Vec<Vec<String>> = diagnosis.result.explanations.iter().map(|e| e.effects.clone()).collect();
    let supported = is_supported(&diagnosis.result, &chosen);
    Choice { verdict: diagnosis.result.verdict.clone(), explanations, chosen, supported, i_choose }
}

/// Writes a side-car, or removes the one of an earlier run that would otherwise seem to belong to the model.
fn put_side_car(out: &OutputFolder, folder: &Path, side_car: &SideCar) -> Result<(), Failure> {
    let name = folder.join("effects.toml");
    if side_car.effects.is_empty() {
        let file = out.path().join(&name);
        out.refuse_input(&file)?;
        return remove_file(&file);
    }
    out.write(name, side_car.to_toml().as_bytes())?;
    Ok(())
}

/// Removes a file that may not be there.
///
/// # Errors
/// The disk.
pub fn remove_file(file: &Path) -> Result<(), Failure> {
    match std::fs::remove_file(file) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(Diagnostic::error(format!("cannot be removed: {e}")).in_file(file).into())
        }
        _ => Ok(()),
    }
}
