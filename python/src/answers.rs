//! Results that borrow the session or the study which they are of, held together with it.

use std::path::Path;
use std::sync::Arc;

use carpus::osim::OsimFile;
use carpus::report::results::Results;
use carpus::report::{render_article, render_report};
use carpus::session::compare::Comparison;
use carpus::session::diagnose::Diagnosed;
use carpus::session::diagnosis_file::{self, KnownDiagnosis};
use carpus::session::diagnostic::{Diagnostic, Failure};
use carpus::session::effect_steps::WithEffects;
use carpus::session::evaluate::Evaluation;
use carpus::session::identify::Identified;
use carpus::session::json::pretty;
use carpus::session::personalize::Personalized;
use carpus::session::plan::Planned;
use carpus::session::sensitivity::Sensitivity;
use carpus::session::simulate::Simulated;
use carpus::simulation::TrialSimulation;
use self_cell::self_cell;
use serde_json::json;

use crate::answer::Result_;
use crate::session::LoadedSession;
use crate::study::Opened;

/// A result and what it borrows.
macro_rules! cell {
    ($(#[$doc:meta])* $name:ident, $owner:ty, $dependent:ident) => {
        self_cell!(
            $(#[$doc])*
            pub struct $name {
                owner: Arc<$owner>,
                #[covariant]
                dependent: $dependent,
            }
        );
    };
}

cell!(
    /// A simulation.
    SimulationCell,
    LoadedSession,
    Simulated
);
cell!(
    /// A comparison.
    ComparisonCell,
    LoadedSession,
    Comparison
);
cell!(
    /// A personalization.
    PersonalizationCell,
    LoadedSession,
    Personalized
);
cell!(
    /// An identification.
    IdentificationCell,
    LoadedSession,
    Identified
);
cell!(
    /// A diagnosis.
    DiagnosisCell,
    LoadedSession,
    Diagnosed
);
cell!(
    /// An evaluation.
    EvaluationCell,
    Opened,
    Evaluation
);
cell!(
    /// A sensitivity analysis.
    SensitivityCell,
    Opened,
    Sensitivity
);

/// What results of one participant with series have in common.
macro_rules! with_results {
    ($cell:ident { $($more:item)* }) => {
        impl Result_ for $cell {
            fn json(&self) -> Result<String, Failure> {
                Ok(results_of(self).to_json())
            }

            fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
                self.borrow_dependent().write(path)
            }

            fn report(&self) -> Option<String> {
                Some(render_report(results_of(self)))
            }

            fn trials(&self) -> &[TrialSimulation] {
                &self.borrow_dependent().trials
            }

            $($more)*
        }

        impl HasResults for $cell {
            fn results(&self) -> &Results {
                &self.borrow_dependent().results
            }
        }
    };
}

/// Has what is written as `results.json`.
trait HasResults {
    fn results(&self) -> &Results;
}

fn results_of(of: &impl HasResults) -> &Results {
    of.results()
}

with_results!(SimulationCell {});
with_results!(ComparisonCell {});
with_results!(PersonalizationCell {
    fn model(&self) -> Option<&OsimFile> {
        Some(&self.borrow_dependent().model)
    }
});

impl Result_ for DiagnosisCell {
    fn json(&self) -> Result<String, Failure> {
        let diagnosed = self.borrow_dependent();
        pretty(&json!({ "diagnosis": diagnosed.known.value, "results": diagnosed.results }))
    }

    fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
        self.borrow_dependent().write(path)
    }

    fn report(&self) -> Option<String> {
        Some(render_report(&self.borrow_dependent().results))
    }

    fn diagnosis(&self) -> Option<KnownDiagnosis> {
        Some(self.borrow_dependent().known.clone())
    }
}

impl Result_ for IdentificationCell {
    fn json(&self) -> Result<String, Failure> {
        pretty(&self.borrow_dependent().result)
    }

    fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
        self.borrow_dependent().write(path)
    }

    fn draws(&self) -> Option<(Vec<f64>, Vec<String>)> {
        let draws = &self.borrow_dependent().found.draws;
        let names = self.borrow_dependent().found.parameters.iter().map(|k| k.parameter.name()).collect();
        Some((draws.transpose().as_slice().to_vec(), names))
    }
}

/// Effects that were added, with the diagnosis behind them.
pub struct EffectsAnswer {
    /// Whose trials they are.
    pub session: Arc<LoadedSession>,
    /// The diagnosis.
    pub diagnosis: KnownDiagnosis,
    /// The steps.
    pub added: WithEffects,
}

impl Result_ for EffectsAnswer {
    fn json(&self) -> Result<String, Failure> {
        Ok(self.added.results.to_json())
    }

    fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
        self.session.borrow_dependent().write_results(path, "effect", |out, folder| {
            diagnosis_file::write(out, folder, &self.diagnosis.value)?;
            self.added.write_to(out, folder)
        })
    }

    fn report(&self) -> Option<String> {
        Some(render_report(&self.added.results))
    }

    fn model(&self) -> Option<&OsimFile> {
        self.added.model()
    }
}

/// A plan of further trials.
pub struct PlanAnswer {
    /// Whose trials they are.
    pub session: Arc<LoadedSession>,
    /// The plan.
    pub planned: Planned,
}

impl Result_ for PlanAnswer {
    fn json(&self) -> Result<String, Failure> {
        let experiment = |s: &carpus::diagnosis::separation::Separation| json!({ "trials": s.trials, "separates": s.separates, "z_now": s.z_now, "z_then": s.z_then });
        let all: Vec<_> = self.planned.separations.iter().map(experiment).collect();
        pretty(&json!({ "participant": self.planned.participant, "experiments": all }))
    }

    fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
        let write = |out: &_, folder: &Path| self.planned.write_to(out, folder);
        self.session.borrow_dependent().write_results(path, "plan", write)
    }
}

impl Result_ for EvaluationCell {
    fn json(&self) -> Result<String, Failure> {
        pretty(&self.borrow_dependent().value(Path::new("report.html")))
    }

    fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
        self.borrow_dependent().write(path)
    }

    fn report(&self) -> Option<String> {
        Some(render_article(&self.borrow_dependent().article))
    }
}

impl Result_ for SensitivityCell {
    fn json(&self) -> Result<String, Failure> {
        pretty(&self.borrow_dependent().value)
    }

    fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
        self.borrow_dependent().write(path)
    }

    fn report(&self) -> Option<String> {
        Some(render_article(&self.borrow_dependent().article))
    }
}
