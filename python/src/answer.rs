//! A result as Python has it: its JSON, its report, the model that came of it, arrays over time, its files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use carpus::osim::OsimFile;
use carpus::session::diagnosis_file::KnownDiagnosis;
use carpus::session::diagnostic::{Diagnostic, Failure};
use carpus::simulation::TrialSimulation;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::cells::DiagnosisCell;
use crate::failure::OrRaise;
use crate::job::warn;
use crate::model::Model;

/// What every result has.
pub trait Result_: Send + Sync + 'static {
    /// What is written as its main file.
    ///
    /// # Errors
    /// None that input can cause.
    fn json(&self) -> Result<String, Failure>;

    /// Writes the files of the command. Returns what a person should know about files of earlier runs.
    ///
    /// # Errors
    /// The folder.
    fn write(&self, path: &Path) -> Result<Vec<Diagnostic>, Failure>;

    /// Its report, a page of HTML.
    fn report(&self) -> Option<String> {
        None
    }

    /// The model that came of it.
    fn model(&self) -> Option<&OsimFile> {
        None
    }

    /// Every trial over time.
    fn trials(&self) -> &[TrialSimulation] {
        &[]
    }

    /// The diagnosis that it is.
    fn diagnosis(&self) -> Option<KnownDiagnosis> {
        None
    }

    /// The diagnosis of one participant that it is, with its files.
    fn diagnosed(&self) -> Option<&DiagnosisCell> {
        None
    }

    /// Draws from a posterior, as rows, and their columns.
    fn draws(&self) -> Option<(Vec<f64>, Vec<String>)> {
        None
    }
}

/// A result.
#[pyclass(module = "carpus._carpus", frozen)]
pub struct Answer {
    /// The result.
    pub inner: Arc<dyn Result_>,
}

impl Answer {
    /// A result as Python has it.
    pub fn of(result: impl Result_) -> Answer {
        Answer { inner: Arc::new(result) }
    }
}

#[pymethods]
impl Answer {
    /// What is written as the main file of the results.
    fn json(&self, py: Python<'_>) -> PyResult<String> {
        py.detach(|| self.inner.json()).or_raise(py)
    }

    /// Writes the files of the command.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let said = py.detach(|| self.inner.write(&path)).or_raise(py)?;
        warn(py, &said)
    }

    /// The report as HTML.
    fn report(&self, py: Python<'_>) -> Option<String> {
        py.detach(|| self.inner.report())
    }

    /// The model that came of it.
    fn model(&self) -> Option<Model> {
        self.inner.model().map(|file| Model::of(file.clone(), "model.osim"))
    }

    /// How many trials it has over time.
    fn n_trials(&self) -> usize {
        self.inner.trials().len()
    }

    /// A trial over time: `time`, `moment` (n); `fiber_length`, `fiber_velocity`, `tendon_force`, `muscle_moment`
    /// (muscles, n).
    fn trial<'py>(&self, py: Python<'py>, place: usize) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(trial) = self.inner.trials().get(place) else { return Ok(None) };
        let result = PyDict::new(py);
        result.set_item("time", PyArray1::from_slice(py, &trial.time))?;
        result.set_item("moment", PyArray1::from_slice(py, &trial.moment))?;
        type OfMuscle = fn(&carpus::simulation::MuscleSimulation) -> &Vec<f64>;
        let series: [(&str, OfMuscle); 4] = [
            ("fiber_length", |m| &m.fiber_length),
            ("fiber_velocity", |m| &m.fiber_velocity),
            ("tendon_force", |m| &m.tendon_force),
            ("muscle_moment", |m| &m.moment),
        ];
        for (name, of) in series {
            let rows: Vec<f64> = trial.muscles.iter().flat_map(|m| of(m).iter().copied()).collect();
            let shape = [trial.muscles.len(), trial.time.len()];
            result.set_item(name, rows.into_pyarray(py).reshape(shape)?)?;
        }
        Ok(Some(result))
    }

    /// Draws from a posterior (draws, parameters), and the parameters' names.
    fn draws<'py>(&self, py: Python<'py>) -> PyResult<Option<(Bound<'py, PyArray2<f64>>, Vec<String>)>> {
        let Some((rows, names)) = self.inner.draws() else { return Ok(None) };
        let shape = [rows.len() / names.len().max(1), names.len()];
        Ok(Some((rows.into_pyarray(py).reshape(shape)?, names)))
    }
}
