//! Motion from forces: forward dynamics of a model in memory.

use carpus::dynamics::{ForwardOptions, Plant, PlantState, simulate_forward};
use carpus::session::diagnostic::{Diagnostic, Failure};
use numpy::{IntoPyArray, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::compiled::Compiled;
use crate::failure::{OrRaise, refused};
use crate::job::{Watch, watched};
use crate::kinematics::rows;
use crate::model::Model;

/// What a forward simulation is asked for.
struct Asked {
    times: Vec<f64>,
    q: Vec<f64>,
    u: Vec<f64>,
    activation: f64,
    /// Of every muscle at every time, in rows of one time.
    excitation: Vec<f64>,
    accuracy: f64,
    allow_unsupported: bool,
}

/// Rate at which violations of constraints between bodies decay [1/s], as in `carpus run-tool`.
const STABILIZATION: f64 = 50.0;

/// Integrates the equations of motion. Returns the muscles' names and a state per time.
fn simulated(compiled: &Compiled, asked: &Asked, watch: &Watch) -> Result<(Vec<String>, Vec<PlantState>), Failure> {
    let loaded = &compiled.loaded;
    let at_model = |text: String| Failure::from(Diagnostic::error(text).in_file(&loaded.path));
    let mut plant = Plant::compile(&loaded.file.spec, &loaded.model, asked.allow_unsupported)
        .map_err(|e| at_model(e.to_string()))?;
    plant.stabilization = STABILIZATION;
    let names: Vec<String> = plant.muscles.iter().map(|m| m.muscle.name().to_owned()).collect();
    let n = names.len();
    if asked.excitation.len() != n * asked.times.len() {
        let found = asked.excitation.len() / asked.times.len().max(1);
        let text =
            format!("excitation: expected a column for each of the {n} muscles ({}), found {found}", names.join(", "));
        return Err(refused(text));
    }
    let mut work = plant.new_work();
    let start = plant
        .equilibrium_state(asked.times[0], &asked.q, &asked.u, &vec![asked.activation; n], &mut work)
        .map_err(|e| at_model(e.to_string()))?;
    let mut after = 1;
    let excite = |time: f64, values: &mut [f64]| {
        watch.look(after);
        let last = asked.times.len() - 1;
        while after < last && asked.times[after] < time {
            after += 1;
        }
        while after > 1 && asked.times[after - 1] > time {
            after -= 1;
        }
        let [t0, t1] = [asked.times[after - 1], asked.times[after]];
        let share = ((time - t0) / (t1 - t0)).clamp(0.0, 1.0);
        for (i, value) in values.iter_mut().enumerate().take(n) {
            let [e0, e1] = [after - 1, after].map(|k| asked.excitation[k * n + i]);
            *value = e0 + share * (e1 - e0);
        }
    };
    let options = ForwardOptions {
        times: asked.times.clone(),
        accuracy: asked.accuracy,
        first_step: 1e-3,
        step_range: [1e-12, f64::INFINITY],
        most_steps: 1_000_000,
    };
    let trajectory = simulate_forward(&plant, &start, excite, &options).map_err(|e| at_model(e.to_string()))?;
    Ok((names, trajectory.states))
}

/// One series of all states: rows of one time.
fn series(states: &[PlantState], of: fn(&PlantState) -> &Vec<f64>) -> Vec<f64> {
    states.iter().flat_map(|s| of(s).iter().copied()).collect()
}

#[pymethods]
impl Model {
    /// Forward dynamics from a posture at which muscles are in equilibrium.
    ///
    /// Returns a dictionary: `muscles` (names), `q`, `u` (times, coordinates), `activation`, `fiber_length` (times,
    /// muscles).
    #[pyo3(signature = (times, q, u, activation, excitation, accuracy, allow_unsupported))]
    fn forward<'py>(
        this: &Bound<'py, Self>,
        py: Python<'py>,
        times: PyReadonlyArray1<'py, f64>,
        q: PyReadonlyArray1<'py, f64>,
        u: PyReadonlyArray1<'py, f64>,
        activation: f64,
        excitation: PyReadonlyArray2<'py, f64>,
        accuracy: f64,
        allow_unsupported: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let compiled = this.borrow_mut().compiled(py)?;
        let n_q = compiled.loaded.model.n_coordinates();
        let list = |array: &PyReadonlyArray1<'_, f64>| array.as_array().iter().copied().collect::<Vec<f64>>();
        let asked = Asked {
            times: list(&times),
            q: list(&q),
            u: list(&u),
            activation,
            excitation: rows(&excitation, excitation.shape()[1], "excitation").or_raise(py)?.into_owned(),
            accuracy,
            allow_unsupported,
        };
        let sound = asked.times.len() > 1 && asked.times.windows(2).all(|w| w[0] < w[1]);
        let fault = match () {
            () if !sound => Some("times: expected at least two, ascending".to_owned()),
            () if asked.q.len() != n_q || asked.u.len() != n_q => Some(format!("q, u: expected {n_q} values each")),
            () if excitation.shape()[0] != asked.times.len() => Some("excitation: expected a row per time".to_owned()),
            () => None,
        };
        if let Some(fault) = fault {
            return Err(refused(fault)).or_raise(py);
        }
        let (names, states) =
            watched(py, "forward dynamics", asked.times.len(), |watch| simulated(&compiled, &asked, watch))?;
        let result = PyDict::new(py);
        let n_t = states.len();
        for (name, of) in [("q", (|s| &s.q) as fn(&PlantState) -> &Vec<f64>), ("u", |s| &s.u)] {
            result.set_item(name, series(&states, of).into_pyarray(py).reshape([n_t, n_q])?)?;
        }
        let of_muscles: [(&str, fn(&PlantState) -> &Vec<f64>); 2] =
            [("activation", |s| &s.activation), ("fiber_length", |s| &s.fiber_length)];
        for (name, of) in of_muscles {
            result.set_item(name, series(&states, of).into_pyarray(py).reshape([n_t, names.len()])?)?;
        }
        result.set_item("muscles", names)?;
        Ok(result)
    }
}
