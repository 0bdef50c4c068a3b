//! A diagnosis of every participant of a study, and what they say together. Of several participants each is a
//! [unit](crate::units): a run that was stopped goes on where it was, and several machines share the work.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::candidates::{candidates, without_property};
use crate::cohort_diagnosis::Cohort;
use crate::diagnose::{BASELINES, Diagnose, forward_model};
use crate::diagnosis_file;
use crate::diagnostic::{Diagnostic, Failure, Severity};
use crate::json;
use crate::loading::{LoadedParticipant, Purpose, memory_needed, participants_at_once};
use crate::output::OutputFolder;
use crate::participant::{Session, StudyParticipant};
use crate::progress::Progress;
use crate::result_files::write_results;
use crate::study::Study;
use crate::task::{FOLDER, Recorder, Task, TaskDone};
use crate::units::{Unit, UnitStore, value};
use carpus_diagnosis::cohort::ParticipantEvidence;
use carpus_diagnosis::diagnose::Diagnosis;
use carpus_report::results::{InputFile, Provenance, Results};

/// First part of the places of the units.
const STEP: &str = "diagnose";

/// How a diagnosis is told to a person.
pub type Tell<'a> = &'a (dyn Fn(&Diagnosis) -> String + Sync);

/// A participant's diagnosis, as its files hold it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParticipantDiagnosis {
    /// What is written as `diagnosis.json`.
    pub diagnosis: Value,
    /// What is written as `results.json`.
    pub results: Results,
    /// What is written as `evidence.json`.
    pub evidence: ParticipantEvidence,
    /// The diagnosis as a person is told it.
    pub told: String,
}

/// Diagnoses of the participants of a study.
#[derive(Clone, Debug)]
pub struct StudyDiagnosis {
    /// Of those that could be diagnosed, in the study's order.
    pub participants: Vec<ParticipantDiagnosis>,
    /// What they say together, if they are several.
    pub cohort: Option<Cohort>,
    /// Why the others could not.
    pub failed: Vec<Diagnostic>,
}

impl ParticipantDiagnosis {
    fn of(session: &Session<'_>, request: &Diagnose, tell: Tell) -> Result<ParticipantDiagnosis, Failure> {
        let found = session.diagnosed(&forward_model(&session.data)?, request)?;
        let told = tell(&found.diagnosis);
        Ok(ParticipantDiagnosis { diagnosis: found.written()?, results: found.results, evidence: found.evidence, told })
    }

    /// What commands and programs are told: `diagnosis.json` without what simpler methods need.
    pub fn value(&self) -> Value {
        let mut value = self.diagnosis.clone();
        if let Some(keys) = value.as_object_mut() {
            keys.remove(BASELINES);
        }
        value
    }

    /// The same of the same data, made by `provenance`.
    fn made_by(mut self, provenance: &Provenance) -> Result<ParticipantDiagnosis, Failure> {
        self.diagnosis["provenance"] = json::value(provenance)?;
        self.results.provenance = provenance.clone();
        Ok(self)
    }

    fn write_to(&self, out: &OutputFolder) -> Result<(), Failure> {
        let folder = Path::new(&self.evidence.participant);
        diagnosis_file::write(out, folder, &self.diagnosis)?;
        out.write(folder.join("evidence.json"), json::text(&self.evidence)?.as_bytes())?;
        write_results(out, folder, &self.results)
    }
}

/// A participant that could be read: what its diagnosis depends on.
struct Read<'s> {
    participant: StudyParticipant<'s>,
    inputs: Vec<InputFile>,
    depends_on: String,
    /// Memory that the diagnosis takes [bytes].
    memory: f64,
}

impl Study {
    /// Diagnoses every participant that is asked for and writes the files of `carpus diagnose`; the folder is not
    /// closed. One that cannot be diagnosed does not keep the others from it.
    ///
    /// - `out`: of this study and the command
    ///
    /// # Errors
    /// An unknown effect; no participant that could be diagnosed; the disk; a request to stop.
    pub fn diagnose_all(
        &self,
        request: &Diagnose,
        out: &OutputFolder,
        tell: Tell,
        progress: &dyn Progress,
    ) -> Result<StudyDiagnosis, Failure> {
        let (mut participants, mut inputs, mut failed) = (Vec::new(), Vec::new(), Vec::new());
        let mut add = |found: ParticipantDiagnosis, of: Vec<InputFile>| -> Result<(), Failure> {
            found.write_to(out)?;
            inputs.extend(of);
            participants.push(found);
            Ok(())
        };
        if self.chosen().len() > 1 || out.path().join(FOLDER).exists() {
            let store = UnitStore::new(out)?;
            let read = self.read_all(request, None, &mut failed, progress)?;
            failed.extend(self.diagnose_units(&read, request, &store, tell, progress)?);
            for Read { participant, inputs, .. } in read {
                let place = format!("{STEP}/{}", participant.about().name);
                if let Some(found) = store.get::<ParticipantDiagnosis>(&place)? {
                    let made = self.provenance(request, request.seed, inputs.clone());
                    add(found.made_by(&made)?, inputs)?;
                }
            }
        } else {
            let outcomes = self.each("diagnosing", progress, |participant| {
                let session = participant.load_for(Purpose::Diagnosis)?.with_progress(progress);
                progress.warnings(&session.data.warnings);
                add(ParticipantDiagnosis::of(&session, request, tell)?, session.data.inputs.clone())
            })?;
            failed = outcomes.failed;
        }
        if participants.is_empty() && !failed.is_empty() {
            return Err(Failure::Input(failed));
        }
        let evidence: Vec<ParticipantEvidence> = participants.iter().map(|p| p.evidence.clone()).collect();
        let cohort = self.cohort(&evidence, request, inputs);
        cohort.iter().try_for_each(|cohort| cohort.write_to(out))?;
        Ok(StudyDiagnosis { participants, cohort, failed })
    }

    /// Diagnoses the participants of a task; [`Study::diagnose_all`] with the same request and folder finds them
    /// diagnosed.
    ///
    /// - `arguments`: what is asked, without the task, as the command has it
    ///
    /// # Errors
    /// As there.
    pub fn diagnose_task(
        &self,
        request: &Diagnose,
        (task, arguments): (Task, &[String]),
        out: &OutputFolder,
        tell: Tell,
        progress: &dyn Progress,
    ) -> Result<TaskDone, Failure> {
        let store = UnitStore::new(out)?;
        let mut recorder = Recorder::begin(out, task, arguments)?;
        let mut work = || {
            let mut failed = Vec::new();
            let read = self.read_all(request, Some(task), &mut failed, progress)?;
            let places: Vec<String> = read.iter().map(|r| format!("{STEP}/{}", r.participant.about().name)).collect();
            recorder.plan(places.iter().map(String::as_str))?;
            failed.extend(self.diagnose_units(&read, request, &store, tell, progress)?);
            Ok(failed)
        };
        match work() {
            Ok(failed) => recorder.end(failed, store.counts()),
            Err(reason) => Err(recorder.fail(reason)),
        }
    }

    /// Reads the participants, or those of a task, and tells what a person should know of their data.
    ///
    /// - `failed`: why some cannot be read
    fn read_all<'s>(
        &'s self,
        request: &Diagnose,
        task: Option<Task>,
        failed: &mut Vec<Diagnostic>,
        progress: &dyn Progress,
    ) -> Result<Vec<Read<'s>>, Failure> {
        let effects = candidates(&request.candidates)?;
        let mut read = Vec::new();
        for (i, participant) in self.participants().enumerate() {
            if task.is_some_and(|task| !task.has(i)) {
                continue;
            }
            let name = participant.about().name.as_str();
            progress.about(Some(name));
            progress.at(&format!("{name}: reading"), i, self.chosen().len());
            match participant.load_for(Purpose::Diagnosis) {
                Ok(Session { data, .. }) => {
                    progress.warnings(&data.warnings);
                    progress.warnings(&without_property(&effects, &data));
                    let depends_on = self.depends_on(request, &data);
                    let memory = memory_needed(&data.trials, data.model.muscle_names().count(), true);
                    read.push(Read { participant, inputs: data.inputs, depends_on, memory });
                }
                Err(Failure::Input(messages)) => failed.extend(messages),
                Err(other) => return Err(other),
            }
        }
        progress.finished();
        progress.about(None);
        Ok(read)
    }

    /// What a diagnosis depends on beside the participant's name.
    fn depends_on(&self, request: &Diagnose, run: &LoadedParticipant) -> String {
        let hashes = run.inputs.iter().map(|i| i.sha256.as_str()).collect::<Vec<_>>().join(" ");
        // Paths and warnings are in the results.
        let (folder, model) = (self.tables.folder.display(), run.loaded.path.display());
        let opening = (self.opening.allow_unsupported, self.opening.scales_models);
        let warnings = run.warnings.iter().map(|w| w.text.as_str()).collect::<Vec<_>>().join("\n");
        format!("{request:?} {opening:?} {folder} {model} {hashes} {warnings}")
    }

    /// Does the units of these participants. Why some could not be done.
    fn diagnose_units(
        &self,
        read: &[Read<'_>],
        request: &Diagnose,
        store: &UnitStore,
        tell: Tell,
        progress: &dyn Progress,
    ) -> Result<Vec<Diagnostic>, Failure> {
        let phases = Phases { progress, finished: AtomicUsize::new(0), of: read.len() };
        let mut units: Vec<Unit> = Vec::new();
        for Read { participant, depends_on, .. } in read {
            let phases = &phases;
            let work = move || {
                let session = participant.load_for(Purpose::Diagnosis)?.with_progress(phases);
                // The unit is stored under the key of what was read first.
                if self.depends_on(request, &session.data) != *depends_on {
                    let text = format!("{}: a file was changed while it was diagnosed", participant.about().name);
                    return Err(Diagnostic::error(text).hint("start again with the same words").into());
                }
                let mut found = ParticipantDiagnosis::of(&session, request, tell)?;
                // Who asked is known when the files are written.
                found = found.made_by(&Provenance::default())?;
                value(&found)
            };
            let place = format!("{STEP}/{}", participant.about().name);
            units.push(Unit { place, depends_on: depends_on.clone(), work: Box::new(work) });
        }
        let largest = read.iter().map(|r| r.memory).fold(0.0, f64::max);
        let mut said = Vec::new();
        for together in units.chunks(participants_at_once(largest)) {
            said.extend(store.run(together, "", &phases, [0, read.len()])?);
        }
        let (damaged, failed): (Vec<_>, Vec<_>) = said.into_iter().partition(|m| m.severity == Severity::Warning);
        progress.finished();
        progress.warnings(&damaged);
        Ok(failed)
    }
}

/// Progress of several diagnoses at once: what one of them is at, and how many are finished. Warnings were told when
/// their participant was read.
struct Phases<'p> {
    progress: &'p dyn Progress,
    finished: AtomicUsize,
    of: usize,
}

impl Progress for Phases<'_> {
    fn at(&self, what: &str, _: usize, _: usize) {
        let is_unit = what.strip_prefix(STEP).is_some_and(|rest| rest.starts_with('/'));
        let finished = self.finished.fetch_add(usize::from(is_unit), Ordering::Relaxed) + usize::from(is_unit);
        self.progress.at(what, finished, self.of);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}
