//! Moments for many sets of muscle parameters on all cores, and their exact derivatives.
//!
//! A set is an array (muscles, 4): maximum isometric force [N], optimal fibre length [m], tendon slack length [m],
//! pennation angle at optimal fibre length [rad]. Samples of all trials lie one after the other.

use carpus::session::diagnostic::Failure;
use carpus::session::study::simulation_message;
use carpus::simulation::{MuscleParameters, PreparedTrial, SimulationError};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::failure::{OrRaise, refused};
use crate::job::watched;
use crate::session::Session;

/// Parameters per muscle.
const PARAMETERS: usize = 4;

fn of_row(row: &[f64]) -> MuscleParameters {
    MuscleParameters {
        max_isometric_force: row[0],
        optimal_fiber_length: row[1],
        tendon_slack_length: row[2],
        pennation_angle_at_optimal: row[3],
    }
}

/// The trials that are simulated.
struct Chosen<'a> {
    trials: Vec<&'a PreparedTrial>,
    measured: Vec<&'a [f64]>,
    muscles: usize,
}

impl Chosen<'_> {
    fn samples(&self) -> usize {
        self.trials.iter().map(|t| t.len()).sum()
    }

    /// Moments of one set [N·m] into `out`.
    fn moments(&self, set: &[f64], out: &mut [f64]) -> Result<(), SimulationError> {
        let parameters: Vec<MuscleParameters> = set.chunks(PARAMETERS).map(of_row).collect();
        let mut rest = out;
        let mut unit = Vec::new();
        for trial in &self.trials {
            let (here, behind) = rest.split_at_mut(trial.len());
            rest = behind;
            here.copy_from_slice(&trial.moment_without_muscles());
            for (muscle, p) in parameters.iter().enumerate() {
                unit.clear();
                unit.resize(trial.len(), 0.0);
                trial.add_unit_moment(muscle, p, &mut unit)?;
                here.iter_mut().zip(&unit).for_each(|(m, u)| *m += p.max_isometric_force * u);
            }
        }
        Ok(())
    }

    /// Calls `see` with every trial's first sample, muscle, and the moment's derivatives by the muscle's parameters.
    fn derivatives(
        &self,
        set: &[f64],
        mut see: impl FnMut(usize, usize, f64, &carpus::simulation::UnitMoment),
    ) -> Result<(), SimulationError> {
        let mut first = 0;
        for trial in &self.trials {
            for (muscle, row) in set.chunks(PARAMETERS).enumerate() {
                let p = of_row(row);
                see(first, muscle, p.max_isometric_force, &trial.unit_moment_with_derivatives(muscle, &p)?);
            }
            first += trial.len();
        }
        Ok(())
    }

    /// Mean squared difference between simulated and measured moments [(N·m)²], and its gradient into `gradient`.
    fn loss(&self, set: &[f64], gradient: &mut [f64]) -> Result<f64, SimulationError> {
        let mut simulated: Vec<f64> = self.trials.iter().flat_map(|t| t.moment_without_muscles()).collect();
        let mut units = Vec::with_capacity(self.trials.len() * self.muscles);
        self.derivatives(set, |first, muscle, force, unit| {
            simulated[first..].iter_mut().zip(&unit.moment).for_each(|(m, u)| *m += force * u);
            units.push((first, muscle, force, unit.clone()));
        })?;
        let measured = self.measured.iter().flat_map(|m| m.iter());
        let residual: Vec<f64> = simulated.iter().zip(measured).map(|(s, m)| s - m).collect();
        let n = residual.len() as f64;
        gradient.fill(0.0);
        for (first, muscle, force, unit) in &units {
            let residual = &residual[*first..];
            let dot = |by: &[f64]| residual.iter().zip(by).map(|(r, d)| r * d).sum::<f64>() * 2.0 / n;
            let row = &mut gradient[muscle * PARAMETERS..(muscle + 1) * PARAMETERS];
            row[0] += dot(&unit.moment);
            row[1] += force * dot(&unit.by_optimal_fiber_length);
            row[2] += force * dot(&unit.by_tendon_slack_length);
            row[3] += force * dot(&unit.by_pennation_angle);
        }
        Ok(residual.iter().map(|r| r * r).sum::<f64>() / n)
    }
}

impl Session {
    fn chosen(&self, places: &[usize]) -> Result<Chosen<'_>, Failure> {
        let data = &self.library().data;
        if !data.given.is_empty() {
            return Err(refused("the study was opened with effects: moments by parameters are of models without them"));
        }
        if let Some(wrong) = places.iter().find(|i| **i >= data.trials.len()) {
            return Err(refused(format!("trials: expected places below {}, found {wrong}", data.trials.len())));
        }
        Ok(Chosen {
            trials: places.iter().map(|i| &data.prepared[*i]).collect(),
            measured: places.iter().map(|i| data.trials[*i].moment.as_slice()).collect(),
            muscles: data.model.muscle_names().count(),
        })
    }

    fn failed(&self, error: &SimulationError) -> Failure {
        simulation_message(error, &self.library().data.loaded).into()
    }

    fn checked(&self, shape: &[usize]) -> Result<(), Failure> {
        let muscles = self.library().data.model.muscle_names().count();
        match shape[shape.len() - 2..] == [muscles, PARAMETERS] {
            true => Ok(()),
            false => Err(refused(format!("parameters: expected (…, {muscles}, {PARAMETERS}), found {shape:?}"))),
        }
    }
}

/// Numbers of an array in order, without a copy where they lie so.
fn numbers<'a>(
    slice: Result<&'a [f64], numpy::AsSliceError>,
    all: impl Iterator<Item = &'a f64>,
) -> std::borrow::Cow<'a, [f64]> {
    match slice {
        Ok(slice) => slice.into(),
        Err(_) => all.copied().collect::<Vec<_>>().into(),
    }
}

#[pymethods]
impl Session {
    /// The model's own parameters (muscles, 4).
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let nominal = self.library().data.model.nominal_parameters();
        let row = |p: &MuscleParameters| {
            [p.max_isometric_force, p.optimal_fiber_length, p.tendon_slack_length, p.pennation_angle_at_optimal]
        };
        let all: Vec<f64> = nominal.iter().flat_map(row).collect();
        all.into_pyarray(py).reshape([nominal.len(), PARAMETERS])
    }

    /// Moments [N·m] of N sets of parameters (N, muscles, 4) in trials: (N, samples).
    fn moments<'py>(
        &self,
        py: Python<'py>,
        parameters: PyReadonlyArray3<'py, f64>,
        trials: Vec<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.checked(parameters.shape()).or_raise(py)?;
        let chosen = self.chosen(&trials).or_raise(py)?;
        let view = parameters.as_array();
        let sets = numbers(parameters.as_slice(), view.iter());
        let (n, samples) = (parameters.shape()[0], chosen.samples());
        // Not set to zero: every row is written in full.
        let out = PyArray2::<f64>::zeros(py, [n, samples], false);
        let mut writable = out.readwrite();
        let rows = writable.as_slice_mut()?;
        let stride = (chosen.muscles * PARAMETERS).max(1);
        watched(py, "simulating sets of parameters", n, |watch| {
            let rows = rows.par_chunks_mut(samples.max(1)).zip(sets.par_chunks(stride));
            let one = |(row, set): (&mut [f64], &[f64])| -> Result<_, Failure> {
                watch.go_on()?;
                chosen.moments(set, row).map_err(|e| self.failed(&e))
            };
            rows.try_for_each(one)
        })?;
        drop(writable);
        Ok(out)
    }

    /// Moments [N·m] of one set (muscles, 4) and their derivatives: (samples), (samples, muscles, 4).
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        parameters: PyReadonlyArray2<'py, f64>,
        trials: Vec<usize>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray3<f64>>)> {
        self.checked(parameters.shape()).or_raise(py)?;
        let chosen = self.chosen(&trials).or_raise(py)?;
        let view = parameters.as_array();
        let set = numbers(parameters.as_slice(), view.iter());
        let stride = chosen.muscles * PARAMETERS;
        let (moment, by) = watched(py, "derivatives", chosen.trials.len(), |watch| {
            let each: Result<Vec<(Vec<f64>, Vec<f64>)>, Failure> = (0..chosen.trials.len())
                .into_par_iter()
                .map(|i| {
                    watch.go_on()?;
                    let one = Chosen {
                        trials: vec![chosen.trials[i]],
                        measured: vec![chosen.measured[i]],
                        muscles: chosen.muscles,
                    };
                    let mut moment = chosen.trials[i].moment_without_muscles();
                    let mut by = vec![0.0; moment.len() * stride];
                    one.derivatives(&set, |_, muscle, force, unit| {
                        for k in 0..moment.len() {
                            moment[k] += force * unit.moment[k];
                            let row = &mut by[k * stride + muscle * PARAMETERS..][..PARAMETERS];
                            row.copy_from_slice(&[
                                unit.moment[k],
                                force * unit.by_optimal_fiber_length[k],
                                force * unit.by_tendon_slack_length[k],
                                force * unit.by_pennation_angle[k],
                            ]);
                        }
                    })
                    .map_err(|e| self.failed(&e))?;
                    Ok((moment, by))
                })
                .collect();
            let (moments, by): (Vec<_>, Vec<_>) = each?.into_iter().unzip();
            Ok((moments.concat(), by.concat()))
        })?;
        let shape = [moment.len(), chosen.muscles, PARAMETERS];
        Ok((moment.into_pyarray(py), by.into_pyarray(py).reshape(shape)?))
    }

    /// Mean squared errors [(N·m)²] of N sets (N, muscles, 4) in trials, and their gradients: (N), (N, muscles, 4).
    fn loss<'py>(
        &self,
        py: Python<'py>,
        parameters: PyReadonlyArray3<'py, f64>,
        trials: Vec<usize>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray3<f64>>)> {
        self.checked(parameters.shape()).or_raise(py)?;
        let chosen = self.chosen(&trials).or_raise(py)?;
        if chosen.samples() == 0 {
            return Err(refused("trials: expected at least one")).or_raise(py);
        }
        let view = parameters.as_array();
        let sets = numbers(parameters.as_slice(), view.iter());
        let (n, stride) = (parameters.shape()[0], chosen.muscles * PARAMETERS);
        let mut gradient = vec![0.0; n * stride];
        let losses: Vec<f64> = watched(py, "errors of sets of parameters", n, |watch| {
            let rows = gradient.par_chunks_mut(stride.max(1)).zip(sets.par_chunks(stride.max(1)));
            let one = |(row, set): (&mut [f64], &[f64])| -> Result<_, Failure> {
                watch.go_on()?;
                chosen.loss(set, row).map_err(|e| self.failed(&e))
            };
            rows.map(one).collect()
        })?;
        Ok((losses.into_pyarray(py), gradient.into_pyarray(py).reshape([n, chosen.muscles, PARAMETERS])?))
    }
}
