//! Every kind of result: its JSON, its files, its report.

use std::path::Path;
use std::sync::Arc;

use carpus::osim::OsimFile;
use carpus::report::results::Results;
use carpus::report::{render_article, render_report};
use carpus::session::cohort_diagnosis::Cohort;
use carpus::session::diagnose::Diagnose;
use carpus::session::diagnosis_file::{self, KnownDiagnosis};
use carpus::session::diagnostic::{Diagnostic, Failure};
use carpus::session::effect_steps::WithEffects;
use carpus::session::groups::GroupComparison;
use carpus::session::json::pretty;
use carpus::session::plan::Planned;
use carpus::simulation::TrialSimulation;
use serde_json::json;

use crate::answer::Result_;
use crate::cells::{
    ComparisonCell, DiagnosisCell, EvaluationCell, IdentificationCell, PersonalizationCell, SensitivityCell,
    SimulationCell,
};
use crate::loaded::{LoadedSession, Opened};

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

    fn diagnosed(&self) -> Option<&DiagnosisCell> {
        Some(self)
    }
}

/// What several participants' diagnoses say together, with these.
pub struct CohortAnswer {
    /// The study.
    pub study: Arc<Opened>,
    /// Diagnoses of the participants, in the study's order.
    pub diagnoses: Vec<Arc<dyn Result_>>,
    /// What they say together.
    pub cohort: Cohort,
}

impl CohortAnswer {
    /// Of several diagnoses; `None` of fewer than two.
    pub fn of(study: Arc<Opened>, diagnoses: Vec<Arc<dyn Result_>>, request: &Diagnose) -> Option<CohortAnswer> {
        let cells = || diagnoses.iter().filter_map(|d| d.diagnosed());
        let evidence: Vec<_> = cells().map(|d| d.borrow_dependent().evidence.clone()).collect();
        let inputs = cells().flat_map(|d| d.borrow_owner().borrow_dependent().data.inputs.clone()).collect();
        let cohort = study.study.cohort(&evidence, request, inputs)?;
        Some(CohortAnswer { study, diagnoses, cohort })
    }
}

impl Result_ for CohortAnswer {
    fn json(&self) -> Result<String, Failure> {
        pretty(&self.cohort.value()?)
    }

    fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
        let diagnosed: Vec<_> =
            self.diagnoses.iter().filter_map(|d| d.diagnosed()).map(DiagnosisCell::borrow_dependent).collect();
        self.study.study.write_cohort(&self.cohort, &diagnosed, path)
    }

    fn report(&self) -> Option<String> {
        Some(self.cohort.report())
    }
}

/// A comparison of groups, and the study that it is of.
pub struct GroupsAnswer {
    /// The study.
    pub study: Arc<Opened>,
    /// What differs.
    pub found: GroupComparison,
}

impl Result_ for GroupsAnswer {
    fn json(&self) -> Result<String, Failure> {
        pretty(&self.found.value()?)
    }

    fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure> {
        self.study.study.write_groups(&self.found, path)
    }

    fn report(&self) -> Option<String> {
        Some(self.found.report())
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
        let experiment = |s: &carpus::diagnosis::separation::Separation| {
            json!({
                "trials": s.trials, "separates": s.separates, "z_now": s.z_now, "z_then": s.z_then,
            })
        };
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
