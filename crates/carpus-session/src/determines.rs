//! What a participant's trials can determine at all, before a fit.

use std::collections::BTreeMap;

use serde::Serialize;

use super::diagnostic::Failure;
use super::images::images;
use super::loading::Purpose;
use super::participant::Session;
use super::prepared::forward_model_of;
use super::provenance::DEFAULT_SEED;
use super::study::simulation_message;
use carpus_diagnosis::inference::muscles::{DETERMINED, MuscleProblem};
use carpus_effects::answers::SEPARABLE_Z;
use carpus_study::study::TrialUse;

/// What trials can determine: expected of their postures, motions and EMG with usual noise. What they measured does not
/// matter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Determines {
    /// The participant.
    pub participant: String,
    /// Of every fitted parameter of the muscles.
    pub parameters: Vec<ExpectedKnowledge>,
    /// Of every effect that these trials can hold: by how many standard deviations they would tell one of a plausible size
    /// from none.
    pub effects_z: BTreeMap<&'static str, f64>,
}

/// What trials would say of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExpectedKnowledge {
    /// The muscle.
    pub muscle: String,
    /// OpenSim's property.
    pub property: &'static str,
    /// Share of the variance before the data that the trials would remove; determined from ½.
    pub share_from_data: f64,
}

impl Session<'_> {
    /// What the training trials can determine; `None` without any.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn determines(&self) -> Result<Option<Determines>, Failure> {
        let again = self.read_for(Purpose::Identification)?;
        let run = again.as_ref().map_or(&self.data, |session| &session.data);
        let forward = forward_model_of(run)?;
        if forward.trials_for(TrialUse::Train).is_empty() {
            return Ok(None);
        }
        let problem = MuscleProblem {
            forward: &forward,
            bounds: self.study.tables.settings.bounds,
            images: images(self.study, run)?,
            priors: Vec::new(),
            seed: DEFAULT_SEED,
        };
        let found = problem.determinable().map_err(|e| Failure::from(simulation_message(&e, &run.loaded)))?;
        let of = |(muscle, property, share): (usize, carpus_simulation::simulation::Property, f64)| ExpectedKnowledge {
            muscle: forward.muscles[muscle].name.clone(),
            property: property.name(),
            share_from_data: rounded(share),
        };
        Ok(Some(Determines {
            participant: run.participant.name.clone(),
            parameters: found.parameters.into_iter().map(of).collect(),
            effects_z: found.effects.into_iter().map(|(id, z)| (id, rounded(z))).collect(),
        }))
    }
}

fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

impl Determines {
    /// Parameters that the trials would determine, or leave open: muscles of every property.
    pub fn muscles(&self, determined: bool) -> BTreeMap<&'static str, Vec<&str>> {
        let mut out: BTreeMap<&'static str, Vec<&str>> = BTreeMap::new();
        for p in self.parameters.iter().filter(|p| (p.share_from_data >= DETERMINED) == determined) {
            out.entry(p.property).or_default().push(&p.muscle);
        }
        out
    }

    /// Effects of which one of a plausible size would not show.
    pub fn hidden(&self) -> Vec<&'static str> {
        self.effects_z.iter().filter(|(_, z)| **z < SEPARABLE_Z).map(|(id, _)| *id).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundled;
    use crate::identify::Identify;
    use crate::output::OutputFolder;
    use crate::study::Study;

    /// What is expected before a fit is what the fit finds determined.
    #[test]
    fn verif_expectation_is_what_the_fit_determines() {
        let folder = tempfile::tempdir().unwrap();
        bundled::write_study(&OutputFolder::create(folder.path(), &[]).unwrap()).unwrap();
        let study = Study::open(folder.path().join("study")).unwrap();
        let session = study.participants().next().unwrap().load().unwrap();
        let expected = session.determines().unwrap().unwrap();
        assert!(expected.effects_z.len() > 20 && !expected.hidden().is_empty());
        let found = session.identify(&Identify { draws: 40, ..Identify::default() }).unwrap().result;
        assert_eq!(found.parameters.len(), expected.parameters.len());
        for p in &found.parameters {
            let same = |e: &&ExpectedKnowledge| e.muscle == p.muscle && e.property == p.property;
            let before = expected.parameters.iter().find(same).unwrap();
            let (before, after) = (before.share_from_data >= DETERMINED, p.share_from_data >= DETERMINED);
            assert_eq!(before, after, "{} {}", p.muscle, p.property);
        }
    }
}
