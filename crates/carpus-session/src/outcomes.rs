//! Work on every participant that is asked for: one that cannot be worked on does not keep the others from it.

use super::diagnostic::{Diagnostic, Failure};
use super::participant::StudyParticipant;
use super::progress::{Progress, go_on};
use super::study::Study;

/// What came of work on every participant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcomes<T> {
    /// Of the participants that could be done, in the study's order.
    pub done: Vec<T>,
    /// Why the others could not.
    pub failed: Vec<Diagnostic>,
}

impl Study {
    /// Does work for every participant that is asked for.
    ///
    /// - `what`: is done, in the field's words
    ///
    /// # Errors
    /// A fault of this program; no participant that could be done; a request to stop.
    pub fn each<'s, T>(
        &'s self,
        what: &str,
        progress: &dyn Progress,
        mut work: impl FnMut(StudyParticipant<'s>) -> Result<T, Failure>,
    ) -> Result<Outcomes<T>, Failure> {
        let mut outcomes = Outcomes { done: Vec::new(), failed: Vec::new() };
        let steps = self.chosen().len();
        for (done, participant) in self.participants().enumerate() {
            go_on(progress)?;
            progress.about(Some(&participant.about().name));
            progress.at(what, done, steps);
            match work(participant) {
                Ok(done) => outcomes.done.push(done),
                Err(Failure::Input(messages)) => outcomes.failed.extend(messages),
                Err(other) => {
                    progress.finished();
                    return Err(other);
                }
            }
        }
        progress.finished();
        progress.about(None);
        if outcomes.done.is_empty() && !outcomes.failed.is_empty() {
            return Err(Failure::Input(outcomes.failed));
        }
        Ok(outcomes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundled;
    use crate::progress::Silent;
    use carpus_study::study::{Participant, Settings, Study as Tables};

    fn study() -> Study {
        let settings = Settings::with_defaults("three", "flexion", &["FCR"]).unwrap();
        let participants = ["P01", "P02", "P03"].map(Participant::named).to_vec();
        Study::from_memory(Tables::of_trials(settings, participants, Vec::new()).unwrap(), bundled::model().unwrap())
    }

    #[test]
    fn verif_one_that_cannot_be_done_does_not_keep_the_others() {
        let study = study();
        let work = |participant: StudyParticipant<'_>| match participant.about().name.as_str() {
            "P02" => Err(Diagnostic::error("no trials").into()),
            name => Ok(name.to_owned()),
        };
        let outcomes = study.each("working", &Silent, work).unwrap();
        assert_eq!(outcomes.done, ["P01", "P03"]);
        assert_eq!(outcomes.failed, [Diagnostic::error("no trials")]);
        let none = study.each("working", &Silent, |_| Err::<(), _>(Diagnostic::error("no trials").into()));
        assert_eq!(none.unwrap_err(), Failure::Input(vec![Diagnostic::error("no trials"); 3]));
    }

    #[test]
    fn verif_work_stops_before_the_next_participant() {
        struct Stopped;
        impl Progress for Stopped {
            fn is_cancelled(&self) -> bool {
                true
            }
        }
        let mut begun = 0;
        let study = study();
        let stopped = study.each("working", &Stopped, |_| {
            begun += 1;
            Ok(())
        });
        assert_eq!((stopped, begun), (Err(Failure::Cancelled), 0));
    }
}
