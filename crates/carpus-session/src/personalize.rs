//! Fitted muscle parameters, the model that has them, errors before and after.

use std::collections::BTreeMap;
use std::path::Path;

use super::diagnostic::{Diagnostic, Failure};
use super::errors::ErrorOverview;
use super::images::images;
use super::live_case::state;
use super::loading::{LoadedParticipant, Purpose};
use super::muscle_use::{Simulated, muscle_use};
use super::output::OutputFolder;
use super::participant::Session;
use super::prepared::forward_model_of;
use super::progress::go_on;
use super::provenance::DEFAULT_SEED;
use super::result_files::{account, write_errors, write_results, write_series};
use carpus_osim::osim::OsimFile;
use carpus_personalization::personalization::{
    MuscleEstimate, MuscleProblem, Personalization, PersonalizationError, Progress as FitProgress, Property, Stage,
    WriteBackError, personalize, write_parameters,
};
use carpus_report::intervals::{NOT_VALID, holds};
use carpus_report::results::{IntervalResult, Kind, ParameterResult, Results, StageResult, rounded};
use carpus_simulation::simulation::TrialSimulation;

/// Level of the intervals of fitted values.
pub const INTERVAL_LEVEL: f64 = 0.9;

/// A personalization: the active muscles' parameters are fitted to the trials with use = train.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Personalize {
    /// Seed of everything random; the same seed gives the same bytes.
    pub seed: u64,
    /// Whether every fitted value gets a 90 % interval.
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
        let fit = self.read_for(Purpose::Identification)?.as_ref().unwrap_or(self).fit(request.seed)?;
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
        let estimates: Vec<MuscleEstimate> = fit.fitted.iter().filter_map(|p| p.estimate.clone()).collect();
        results.parameters = parameters(run, &estimates, request.intervals);
        results.part_of_the_way = Some(rounded(fit.part_of_the_way, 4));
        results.stages = fit.stages.iter().map(stage).collect();
        results.muscles = muscle_use(
            run,
            &[
                Simulated { id: "before", spec: &run.loaded.file.spec, trials: &before },
                Simulated { id: "personalized", spec: &model.spec, trials: &after },
            ],
        )?;
        let state = state("Personalized", &fit.parameters, &estimates, &[], &BTreeMap::new());
        results.live = self.live_case(request.seed, true, vec![state])?;
        Ok(Personalized { session: self, results, model, trials: after })
    }

    /// Fits the active muscles' parameters to the training trials; held-out trials are not handed over.
    fn fit(&self, seed: u64) -> Result<Personalization, Failure> {
        let (study, run, progress) = (self.study, &self.data, self.progress()?);
        let forward = forward_model_of(run)?;
        let problem = MuscleProblem {
            forward: &forward,
            bounds: study.tables.settings.bounds,
            images: images(study, run)?,
            priors: Vec::new(),
            seed,
        };
        let what = format!("fitting {}", run.participant.name);
        progress.at(&what, 0, 0);
        let tell = |p: FitProgress| progress.at(&format!("{what}: {}", p.stage), p.done, p.expected);
        let fit = personalize(&problem, &tell, &|| !progress.is_cancelled());
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

    /// Writes the files of `carpus personalize` into a folder of results: those of the participant P01 into its folder
    /// `P01`. Returns what a person should know about files of earlier runs.
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

/// Muscle parameters, property by property.
///
/// - `estimates`: muscle by muscle
pub(super) fn parameters(
    run: &LoadedParticipant,
    estimates: &[MuscleEstimate],
    intervals: bool,
) -> Vec<ParameterResult> {
    let muscles: Vec<&str> = run.model.muscle_names().collect();
    let interval = |p: &MuscleEstimate| {
        let [lower, upper] = p.interval(INTERVAL_LEVEL).map(|end| rounded(end, 7));
        IntervalResult { level: INTERVAL_LEVEL, lower, upper, end_from_data: p.end_from_data(INTERVAL_LEVEL) }
    };
    let result = |p: &MuscleEstimate| ParameterResult {
        muscle: muscles[p.muscle].to_string(),
        property: p.property.name().to_string(),
        unit: p.property.unit().to_string(),
        before: p.given,
        after: p.value,
        lower: p.bounds[0],
        upper: p.bounds[1],
        standard_deviation: Some(rounded(p.log_sd * p.joint_mode, 6)),
        share_from_data: Some(rounded(p.share_from_data(), 6)),
        interval: intervals.then(|| interval(p)),
    };
    let of = |property: Property| estimates.iter().filter(move |p| p.property == property).map(result);
    Property::ALL.into_iter().flat_map(of).collect()
}

/// What a person should know of fitted parameters: how far the fit was gone, values on a bound, intervals that do not
/// hold, and what the trials do not determine. A line for each.
pub fn remarks(results: &Results) -> Vec<String> {
    let of = |what: &str, is_so: &dyn Fn(&ParameterResult) -> bool| {
        let names = results.parameters.iter().filter(|p| is_so(p)).map(|p| format!("{} {}", p.muscle, p.property));
        let names: Vec<String> = names.collect();
        (!names.is_empty()).then(|| format!("{what}: {}", names.join(", ")))
    };
    let part = results.part_of_the_way.filter(|part| *part < 1.0).map(|part| {
        let percent = 100.0 * part;
        format!(
            "{percent:.0} % of the way from the given model to the fit, as left-out training trials are predicted best"
        )
    });
    let is_open = |p: &ParameterResult| p.interval.as_ref().is_some_and(|i| !i.is_determined());
    let is_invalid = |p: &ParameterResult| p.interval.as_ref().is_some_and(|i| !holds([i.lower, i.upper], p.after));
    let remarks = [
        part,
        of("on a bound", &ParameterResult::at_bound),
        of(&format!("interval {NOT_VALID}"), &is_invalid),
        of("not determined by these trials", &is_open),
    ];
    remarks.into_iter().flatten().map(|remark| format!("{}: {remark}", results.participant.id)).collect()
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
    use crate::study::Study;

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
