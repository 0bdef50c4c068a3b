//! Fitted muscle parameters, the model that has them, errors before and after.

use std::path::Path;

use super::diagnostic::{Diagnostic, Failure};
use super::errors::ErrorOverview;
use super::identify::{INTERVAL_LEVEL, usual_intervals};
use super::loading::LoadedParticipant;
use super::output::OutputFolder;
use super::participant::Session;
use super::progress::go_on;
use super::provenance::DEFAULT_SEED;
use super::result_files::{account, write_errors, write_results, write_series};
use super::study::Study;
use carpus_identifiability::ConfidenceInterval;
use carpus_multibody::muscles::Millard2012;
use carpus_osim::osim::OsimFile;
use carpus_personalization::personalization::{
    FitOptions, FitProblem, FittedParameter, Personalization, PersonalizationError, Progress as FitProgress, Property,
    RestingFiber, Stage, TrainingTrial, WriteBackError, personalize_while, write_parameters,
};
use carpus_report::results::{IntervalResult, Kind, ParameterResult, Results, StageResult, rounded};
use carpus_simulation::imaging::path_length;
use carpus_simulation::simulation::{MuscleParameters, TrialSimulation};
use carpus_study::study::{FascicleUse, TrialUse};

/// A personalization: the active muscles' parameters are fitted to the trials with use = train.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Personalize {
    /// Seed of the global search; the same seed gives the same bytes.
    pub seed: u64,
    /// Whether every fitted value gets a 90 % interval, which takes more than half of the time.
    pub intervals: bool,
}

impl Default for Personalize {
    fn default() -> Self {
        Personalize { seed: DEFAULT_SEED, intervals: true }
    }
}

/// A personalized model.
#[derive(Debug)]
pub struct Personalized<'a> {
    session: &'a Session<'a>,
    /// What is written as `results.json`: errors before and after, parameters with intervals, stages of the fit.
    pub results: Results,
    /// The model file with the fitted values.
    pub model: OsimFile,
    /// Every trial over time with the personalized model, in the order of the session.
    pub trials: Vec<TrialSimulation>,
}

impl Session<'_> {
    /// Fits the active muscles' parameters; trials with use = test are never fitted.
    ///
    /// # Errors
    /// The fit; a fitted value that the model file does not take; a request to stop.
    pub fn personalize(&self, request: &Personalize) -> Result<Personalized<'_>, Failure> {
        self.personalize_as(request, &Path::new(&self.data.participant.name).join("model.osim"))
    }

    /// As [`Session::personalize`], of a model whose file the results call by another name.
    ///
    /// - `file`: where the model is going to be written, in the folder of the results
    ///
    /// # Errors
    /// As there.
    pub fn personalize_as(&self, request: &Personalize, file: &Path) -> Result<Personalized<'_>, Failure> {
        let (run, progress) = (&self.data, self.progress()?);
        let nominal = run.model.nominal_parameters();
        let before = run.simulate(&nominal)?;
        let fit = self.fit(&nominal, request.seed)?;
        go_on(progress)?;
        let mut model = run.loaded.file.clone();
        write_parameters(&mut model, &fit.fitted).map_err(|e| writing_failure(&e, &run.loaded.path))?;
        // What is reported is what the written file gives.
        let after = self.study.simulate_edited(run, &model.spec)?;
        let models = [
            run.model_run("before", "Before", run.loaded.path.display().to_string(), &before),
            run.model_run("personalized", "Personalized", file.display().to_string(), &after),
        ];
        let mut results = account(Kind::Personalization, self, request, request.seed, &models)?;
        results.parameters = parameters(&fit.fitted);
        if request.intervals {
            progress.at(&format!("intervals of {}", run.participant.name), 0, 0);
            let found = usual_intervals(self.study, run, request.seed);
            progress.finished();
            add_intervals(&mut results.parameters, &found?);
        }
        results.stages = fit.stages.iter().map(stage).collect();
        Ok(Personalized { session: self, results, model, trials: after })
    }

    /// Fits the active muscles' parameters to the training trials; held-out trials are not handed over.
    fn fit(&self, nominal: &[MuscleParameters], seed: u64) -> Result<Personalization, Failure> {
        let (study, run, progress) = (self.study, &self.data, self.progress()?);
        let training = run.trials.iter().zip(&run.prepared).filter(|(trial, _)| trial.info.usage == TrialUse::Train);
        let problem = FitProblem {
            trials: training.map(|(trial, prepared)| TrainingTrial { prepared, measured: &trial.moment }).collect(),
            muscles: run.model.muscle_names().map(String::from).collect(),
            nominal: nominal.to_vec(),
            bounds: study.tables.settings.bounds,
            fibers: fibers(study, run)?,
        };
        let what = format!("fitting {}", run.participant.name);
        progress.at(&what, 0, 0);
        let options = FitOptions { seed, ..FitOptions::default() };
        let tell = |p: FitProgress| progress.at(&format!("{what}: {}", p.stage), p.evaluations, p.expected);
        let fit = personalize_while(&problem, &options, &tell, &|| !progress.is_cancelled());
        progress.finished();
        fit.map_err(|e| match e {
            PersonalizationError::Stopped => Failure::Cancelled,
            other => Diagnostic::error(other.to_string()).in_file(&study.tables.file).into(),
        })
    }
}

impl Personalized<'_> {
    /// Errors before and after, for each use of the trials.
    pub fn errors(&self) -> ErrorOverview {
        ErrorOverview::of(&self.results)
    }

    /// Writes the model, `results.json`, its report, tables of errors and the series of every trial.
    ///
    /// - `folder`: the participant's, in the folder of the results
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder, folder: &Path) -> Result<(), Failure> {
        let coordinate = &self.session.study.tables.settings.dynamometer.coordinate;
        out.write(folder.join("model.osim"), self.model.document.bytes())?;
        write_series(out, folder, coordinate, &self.session.data, &self.trials)?;
        write_errors(out, folder, &[&self.results])?;
        write_results(out, folder, &self.results)
    }

    /// Writes the files of `carpus personalize` into a folder of results: those of the participant P01 into its folder `P01`.
    /// Returns what a person should know about files of earlier runs.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of this study and command.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<Vec<Diagnostic>, Failure> {
        self.session.write_results(path.as_ref(), "personalize", |out, folder| self.write_to(out, folder))
    }
}

/// Why fitted parameters cannot be written into a model.
pub fn writing_failure(error: &WriteBackError, model: &Path) -> Failure {
    match error {
        WriteBackError::Edit(edit) => {
            let message = Diagnostic::error(error.to_string()).in_file(model);
            Failure::from(edit.hint().into_iter().fold(message, Diagnostic::hint))
        }
        WriteBackError::ReadBack { .. } => Failure::Internal(error.to_string()),
    }
}

/// Fascicle lengths of the participant's images, if the study says that they inform the fit.
fn fibers(study: &Study, run: &LoadedParticipant) -> Result<Vec<RestingFiber>, Failure> {
    let imaging = &study.tables.settings.imaging;
    if imaging.fascicles == FascicleUse::Check {
        return Ok(Vec::new());
    }
    let table = study.tables.folder.join("ultrasound.csv");
    let of_participant = study.tables.ultrasound.iter().filter(|m| m.participant == run.participant.name);
    let mut fibers = Vec::new();
    for (image, measured) in of_participant.filter_map(|m| Some((m, m.fascicle_length?))) {
        // A muscle that is not active has nothing to fit.
        let Some(muscle) = run.model.muscle_names().position(|name| name == image.muscle) else { continue };
        let at = |e: String| Failure::from(Diagnostic::error(e).in_file(&table).at_line(image.line));
        let (spec, path_length) = path_length(&run.loaded.file.spec, &run.loaded.model, &study.tables, image)
            .map_err(|e| at(format!("{} {}: {e}", run.participant.name, image.muscle)))?;
        let millard = Millard2012::from_spec(spec).map_err(|e| at(e.to_string()))?;
        fibers.push(RestingFiber {
            muscle,
            millard,
            path_length,
            activation: imaging.activation,
            measured,
            standard_deviation: imaging.fascicle_error * measured,
        });
    }
    Ok(fibers)
}

/// Fitted parameters, property by property.
fn parameters(fitted: &[FittedParameter]) -> Vec<ParameterResult> {
    let result = |p: &FittedParameter| ParameterResult {
        muscle: p.muscle.clone(),
        property: p.property.name().to_string(),
        unit: p.property.unit().to_string(),
        before: p.before,
        after: p.after,
        lower: p.lower,
        upper: p.upper,
        standard_deviation: p.determination.map(|d| rounded(d.relative_deviation * p.before, 6)),
        share_from_data: p.determination.map(|d| rounded(d.share_from_data, 6)),
        interval: None,
    };
    let of = |property: Property| fitted.iter().filter(move |p| p.property == property).map(result);
    Property::ALL.into_iter().flat_map(of).collect()
}

/// Gives every fitted parameter its interval.
fn add_intervals(fitted: &mut [ParameterResult], found: &[ConfidenceInterval]) {
    for result in fitted {
        let own =
            found.iter().find(|i| i.parameter.owner == result.muscle && i.parameter.property.name() == result.property);
        result.interval = own.map(|i| IntervalResult {
            level: INTERVAL_LEVEL,
            lower: rounded(i.interval[0], 7),
            upper: rounded(i.interval[1], 7),
            end_from_data: i.end_from_data,
        });
    }
}

fn stage(stage: &Stage) -> StageResult {
    StageResult {
        name: stage.name.to_string(),
        evaluations: stage.evaluations,
        objective_before: stage.objective_before,
        objective_after: stage.objective_after,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::progress::Progress;

    /// Lets work go on until it was asked a number of times.
    struct Impatient {
        left: AtomicUsize,
    }

    impl Progress for Impatient {
        fn is_cancelled(&self) -> bool {
            self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1)).is_err()
        }
    }

    #[test]
    fn verif_a_fit_stops_between_its_searches() {
        let study = Study::open(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/demo_study")).unwrap();
        let participant = study.participants().next().unwrap();
        // Asked before the work and before the fit; then between the searches.
        for asked in [0, 2, 3] {
            let impatient = Impatient { left: AtomicUsize::new(asked) };
            let session = participant.load().unwrap().with_progress(&impatient);
            let stopped = session.personalize(&Personalize { intervals: false, ..Personalize::default() });
            assert_eq!(stopped.err(), Some(Failure::Cancelled), "{asked}");
            assert_eq!(impatient.left.load(Ordering::Relaxed), 0);
        }
    }
}
