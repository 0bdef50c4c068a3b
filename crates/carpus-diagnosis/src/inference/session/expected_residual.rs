//! What the linear model expects, by simulation: a state is as probable as its simulation is near the recorded moment
//! (`docs/src/theory/many-small-errors.md`, equation (20)).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::noise_along_the_way::weighted;
use super::state::{ExpectedResidual, Session, State};

/// Shares of the way to what is expected: the first that can be simulated counts.
const PARTS: [f64; 4] = [1.0, 0.5, 0.25, 0.0];
/// An effect that is expected to change −2 log likelihood by less stays linear.
const UNSEEN: f64 = 0.1;

impl Session<'_> {
    /// What is left of every trial where the linear model of a state expects everything; empty where not even
    /// its point can be simulated.
    fn expected_residuals(&self, state: &State) -> Vec<ExpectedResidual> {
        let (set, model) = (self.places(&state.point.effects), &state.model);
        let posterior = model.posterior(&set, self.sizes(state));
        let own = self.columns_of_point(&state.point);
        let step = &posterior.mean - &model.offset;
        let columns = self.all_columns(&state.point, &state.linear, &state.directions);
        let joint = &self.forward().joint;
        let emg = self.expected_emg(&state.noise, &weighted(&columns, &step, &state.factors), &state.levels);
        // Of −2 log likelihood, by some columns alone.
        let change = |columns: &[usize]| -> f64 {
            let of = |i: &usize| columns.iter().map(|j| step[*i] * model.products[(*i, *j)] * step[*j]).sum::<f64>();
            columns.iter().map(of).sum()
        };
        let simulated = |part: f64| {
            let mut point = self.analysis.moved(&state.point, &(step.rows(0, own) * part).into_owned());
            let towards = |here: &Vec<DVector<f64>>, to: &Vec<DVector<f64>>| {
                here.iter().zip(to).map(|(here, to)| here + (to - here) * part).collect()
            };
            let correction = point.correction.iter().zip(&emg).map(|(here, to)| towards(here, to)).collect();
            point = self.with_emg(&point, correction).ok()?;
            let mut is_simulated: Vec<usize> = (0..own).collect();
            for (place, of_effect) in self.amplitude_columns(model).into_iter().enumerate() {
                if set.contains(&place) || change(&of_effect.amplitudes) < UNSEEN {
                    continue;
                }
                let mut setting = joint.absent(self.analysis.candidates[place]);
                let description = setting.effect.description();
                for (i, column) in description.amplitudes().zip(&of_effect.amplitudes) {
                    setting.values[i] += part * step[*column] * joint.scale(&description.parameters[i]);
                }
                is_simulated.extend(of_effect.amplitudes);
                point.effects.push(setting);
            }
            let residuals = self.analysis.residuals(&point, &state.noise).ok()?;
            Some((residuals, is_simulated))
        };
        let Some((residuals, is_simulated)) = PARTS.into_iter().find_map(simulated) else { return Vec::new() };
        let of_trial = |(there, columns): (&DVector<f64>, &DMatrix<f64>)| {
            let p = model.len();
            let mut weights = step.clone();
            let linear = columns.column(p) - columns.columns(0, p) * &weights;
            is_simulated.iter().for_each(|column| weights[*column] = 0.0);
            let simulated = there - columns.columns(0, p) * &weights;
            ExpectedResidual { simulated, linear }
        };
        residuals.par_iter().zip(&columns).map(of_trial).collect()
    }

    /// By how much −2 log likelihood is larger by simulation than the linear model of a state expects.
    ///
    /// - `factors`: of the noise's covariance of every trial
    pub(super) fn beyond_the_linear_model(&self, state: &State, factors: &[Cholesky<f64, Dyn>]) -> f64 {
        let square = |v: &DVector<f64>, factor: &Cholesky<f64, Dyn>| {
            factor.l_dirty().solve_lower_triangular(v).map_or(f64::INFINITY, |w| w.norm_squared())
        };
        let expected = state.expected.get_or_init(|| self.expected_residuals(state));
        expected.iter().zip(factors).map(|(e, factor)| square(&e.simulated, factor) - square(&e.linear, factor)).sum()
    }
}
