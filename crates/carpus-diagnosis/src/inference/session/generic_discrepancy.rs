//! The last step of the account of the error: what the generic discrepancy takes of what is handed over.

use std::sync::atomic::AtomicUsize;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::state::{HandedOver, Session, State};
use crate::fit::linearization::Linear;
use crate::fit::{Analysis, Point, block_means, block_starts, trial_times};
use carpus_effects::series::interpolate;
use carpus_simulation::simulation::SimulationError;
use carpus_study::study::TrialUse;

/// Trials around a point.
struct There {
    point: Point,
    linear: Vec<Linear>,
    /// All columns and the residual.
    columns: Vec<DMatrix<f64>>,
}

impl<'a> Session<'a> {
    /// Root mean square of the residuals of what is handed over, EMG as recorded, once the discrepancy (6),
    /// (7) and the small sizes of all effects that are not in it have taken their part [N·m]: of training
    /// trials, to which their coefficients are fitted with their priors and white noise, and of held-out
    /// trials with the same coefficients; `None` without trials.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn beside_discrepancy(
        &self,
        state: &State,
        handed_over: &HandedOver,
    ) -> Result<[Option<f64>; 2], SimulationError> {
        let there = self.at(handed_over)?;
        let (own, set) = (self.columns_of_point(&there.point), self.places(&there.point.effects));
        // The plain error is what is accounted for: all samples count alike.
        let noise = self.noise_floor(state);
        let white = |c: &DMatrix<f64>| Cholesky::pack_dirty(DMatrix::identity(c.nrows(), c.nrows()) * noise);
        let factors: Vec<Cholesky<f64, Dyn>> = there.columns.iter().map(white).collect();
        let model = self.model(&there.point, &there.columns, &factors).holding(own);
        let mean = model.posterior(&set, self.sizes(state)).mean;
        let held_out = self.on(self.forward().trials_for(TrialUse::Test));
        let of_held_out = held_out.at(handed_over)?;
        Ok([self.left_by(&there, &mean), held_out.left_by(&of_held_out, &mean)])
    }

    /// The same session on other trials.
    fn on(&self, trials: Vec<usize>) -> Session<'a> {
        let (forward, kernels) = (self.analysis.forward, self.analysis.kernels);
        let analysis = Analysis {
            times: trials.iter().map(|g| trial_times(&forward.trials[*g], &kernels.moment)).collect(),
            forward,
            train: trials,
            candidates: self.analysis.candidates.clone(),
            prior_sd: self.analysis.prior_sd,
            log_bounds: self.analysis.log_bounds,
            tied: self.analysis.tied.clone(),
            blocks: Vec::new(),
            kernels,
            seed: self.analysis.seed,
            targets: None,
            linearized: AtomicUsize::new(0),
        };
        Session { ranges: self.ranges, ..Session::of(analysis, self.budget) }
    }

    /// At what is handed over, the EMG as recorded.
    fn at(&self, handed_over: &HandedOver) -> Result<There, SimulationError> {
        let HandedOver { parameters, effects, .. } = handed_over;
        let point = Point { parameters: parameters.clone(), effects: effects.clone(), ..self.analysis.nominal_point() };
        let linear = self.analysis.linearize(&point, &[])?;
        let (directions, _) = self.analysis.calc_directions(&linear, &point)?;
        let columns = self.all_columns(&point, &linear, &directions);
        Ok(There { point, linear, columns })
    }

    /// Columns of muscles, baselines and the parameters of the effects that are on.
    pub(super) fn columns_of_point(&self, point: &Point) -> usize {
        self.analysis.n_nuisance() + point.effects.iter().map(|s| s.values.len()).sum::<usize>()
    }

    /// Root mean square of what coefficients leave of the residuals in all samples [N·m]; `None` without trials.
    fn left_by(&self, there: &There, coefficients: &DVector<f64>) -> Option<f64> {
        let of_trial = |(position, columns): (usize, &DMatrix<f64>)| {
            let g = self.analysis.train[position];
            let record = &self.forward().trials[g];
            let times = block_means(&record.time, &block_starts(&record.time));
            let taken = columns.columns(0, coefficients.len()) * coefficients;
            let simulated = self.forward().recorded_moment(g, &there.linear[position].core, &there.point.effects);
            let left = |((t, y), s): ((&f64, &f64), &f64)| y - s - interpolate(times.as_slice(), taken.as_slice(), *t);
            let samples = record.time.iter().zip(&record.moment).zip(&simulated);
            (samples.map(left).map(|left| left * left).sum::<f64>(), simulated.len())
        };
        let sums: Vec<(f64, usize)> = there.columns.par_iter().enumerate().map(of_trial).collect();
        let (sum, count) = sums.into_iter().fold((0.0, 0), |sum, s| (sum.0 + s.0, sum.1 + s.1));
        (count > 0).then(|| (sum / count as f64).sqrt())
    }
}
