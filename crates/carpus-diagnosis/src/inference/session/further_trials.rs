//! What trials that were not recorded yet would tell of muscle parameters.

use std::sync::atomic::AtomicUsize;

use nalgebra::{DMatrix, DVector};

use super::noise_along_the_way::factors;
use super::state::{Session, State};
use crate::fit::{Analysis, Point, trial_times};
use carpus_effects::forward_model::{FITTED_PER_MUSCLE, ForwardModel};
use carpus_simulation::simulation::SimulationError;

impl Session<'_> {
    /// Standard deviations of the logarithms of muscle parameters if one more trial is recorded, for each of
    /// some: to first order at a state, with its noise and sizes. What a trial measures does not matter.
    ///
    /// - `then`: the trials
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn deviations_after(&self, state: &State, then: &ForwardModel) -> Result<Vec<DVector<f64>>, SimulationError> {
        let kernels = self.analysis.kernels;
        let trials: Vec<usize> = (0..then.trials.len()).collect();
        let analysis = Analysis {
            times: trials.iter().map(|g| trial_times(&then.trials[*g], &kernels.moment)).collect(),
            forward: then,
            train: trials,
            candidates: self.analysis.candidates.clone(),
            prior_sd: self.analysis.prior_sd,
            log_bounds: self.analysis.log_bounds,
            tied: self.analysis.tied.clone(),
            blocks: self.analysis.blocks.clone(),
            kernels,
            seed: self.analysis.seed,
            targets: None,
            linearized: AtomicUsize::new(0),
        };
        let muscle_priors = self.muscle_priors.clone();
        let session = Session { ranges: self.ranges, muscle_priors, ..Session::of(analysis, self.budget) };
        let (parameters, effects) = (state.point.parameters.clone(), state.point.effects.clone());
        let point = Point { parameters, effects, ..session.analysis.nominal_point() };
        let mut linear = session.analysis.linearize(&point, &[])?;
        let noise = session.structure(&mut linear, &point);
        let directions = session.analysis.calc_directions(&linear, &point)?.0;
        let columns = session.all_columns(&point, &linear, &directions);
        let told = session.model(&point, &columns, &factors(&noise, &state.levels)?).by_trial;
        let (set, sizes) = (self.places(&state.point.effects), self.sizes(state));
        let muscles = self.analysis.n_muscles() * FITTED_PER_MUSCLE;
        let after = |more: &DMatrix<f64>| {
            let posterior = state.model.posterior_of(&(&state.model.products + more), &set, sizes);
            DVector::from_fn(muscles, |j, _| posterior.sd_of(j))
        };
        Ok(told.iter().map(after).collect())
    }
}
