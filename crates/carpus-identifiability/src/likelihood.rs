//! How probable recorded moments are, given muscle parameters: noise of the moment, and noise of the EMG as it passes
//! through the muscles.
//!
//! ```text
//! y − τ(θ, ê) + G ŵ − B b ~ N(0, V),   ê = e exp(ŵ),   b ~ N(0, I)
//! ```
//! ŵ: expected noise of log excitation given the fit; V: [`carpus_diagnosis::noise`]; b: baseline of every EMG channel.
//! ŵ, G, B and V are held at the fit ([`Held`]), so that what is left is a sum of squares in θ and b. What that leaves
//! out, and noise of another kind, shows in how trials scatter about the fit ([`Fit::dispersion`]), by which intervals
//! are widened.
//!
//! # References
//! Lindstrom & Bates (1990), Nonlinear mixed effects models for repeated measures data, doi:10.2307/2532087.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::descent::{Limits, Quadratic, descend};
use super::held::{Held, HeldTrial, View, at_time, corrected, hat, knot_count, positive};
use super::problem::Problem;
use super::recorded::RecordedTrial;
use carpus_diagnosis::fit::block_means;
use carpus_diagnosis::kernel::{FAMILIES, Kernel};
use carpus_diagnosis::noise::{
    self, KNOT_SPACING, Kernels, LEAST_WHITE, NoiseLevels, Response, TrialNoise, TrialTimes,
};
use carpus_effects::effects::emg_floor::BASELINE_SD;
use carpus_simulation::simulation::{PreparedTrial, SimulationError};

/// Evaluations of the first descent, with usual noise, and of those after each estimate of the noise.
const EVALUATIONS: [usize; 6] = [12, 6, 5, 4, 4, 4];
/// Pass after which correlations of the noise in time are chosen.
const KERNEL_PASS: usize = 3;
/// A descent ends when a step promises less than this decrease of −2 log probability.
const CONVERGED: f64 = 0.005;
/// A fit that leaves more than this is not one whose intervals another factor could mend.
const MOST_DISPERSION: f64 = 25.0;
/// Channels of a trial are put this far apart in time [s], so that slow disturbances of one are not those of another.
const CHANNEL_OFFSET: f64 = 1e6;

/// A most probable parameter set.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    /// Logarithms of factors, then baselines.
    pub(super) at: DVector<f64>,
    pub(super) held: Held,
    /// Of data and baselines, without the parameters' prior; parameters first.
    pub(super) information: DMatrix<f64>,
    /// How much more the trials scatter about the fit than the noise says they should (variance ratio), at least 1.
    pub(super) dispersion: f64,
}

impl Problem {
    /// Most probable parameters and their noise.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn fit(&self) -> Result<Fit, SimulationError> {
        let n = self.layout.len() + self.n_muscles();
        let mut at = DVector::zeros(n);
        for (i, p) in self.layout.free.iter().enumerate() {
            at[i] = p.prior.factor.ln();
        }
        let mut held = self.recorded(&at)?;
        for (pass, evaluations) in EVALUATIONS.into_iter().enumerate() {
            if pass > 0 {
                held = self.noise(held, &at, pass)?;
            }
            let result = self.descend(&held, at, evaluations)?;
            at = result.0;
        }
        let (total, data) = self.account(&held, &at, true)?;
        let dispersion = self.dispersion(&held, &at, &total)?;
        Ok(Fit { at, held, information: data.information, dispersion })
    }

    /// Variance of the trials' scores over what the noise predicts: trials are the unit that repeats, whatever happens
    /// within them.
    ///
    /// ```text
    /// c = tr(A⁻¹ Σ s_t s_tᵀ) / tr(A⁻¹ Σ (A_t − A_t A⁻¹ A_t))
    /// s_t = X_tᵀ V⁻¹ r_t,  A_t = X_tᵀ V⁻¹ X_t,  A = Σ A_t + prior
    /// ```
    /// A fit takes part of the scatter away, which the denominator accounts for.
    ///
    /// # References
    /// McCullagh & Nelder (1989), Generalized linear models, section 9.2 (quasi-likelihood); Liang & Zeger (1986),
    /// doi:10.1093/biomet/73.1.13 (clusters).
    fn dispersion(&self, held: &Held, at: &DVector<f64>, total: &Quadratic) -> Result<f64, SimulationError> {
        let n = at.len();
        let Some(factor) = total.information.clone().cholesky() else { return Ok(1.0) };
        let (mut found, mut expected) = (0.0, 0.0);
        for w in self.whitened(held, at)? {
            let x = w.columns(0, n);
            let score = x.tr_mul(&w.column(n));
            let own = x.tr_mul(&x);
            let share = factor.solve(&own);
            found += score.dot(&factor.solve(&score));
            expected += share.trace() - (&share * &share).trace();
        }
        Ok(if expected > 0.0 { (found / expected).clamp(1.0, MOST_DISPERSION) } else { 1.0 })
    }

    fn descend(
        &self,
        held: &Held,
        start: DVector<f64>,
        evaluations: usize,
    ) -> Result<(DVector<f64>, Quadratic), SimulationError> {
        let n = start.len();
        let p = self.layout.len();
        let (mut lower, mut upper, mut step) = (vec![-8.0; n], vec![8.0; n], vec![4.0; n]);
        for (i, parameter) in self.layout.free.iter().enumerate() {
            [lower[i], upper[i]] = parameter.log_bounds();
            step[i] = 0.2 * (upper[i] - lower[i]);
        }
        debug_assert!(p <= n);
        let limits = Limits {
            lower: &lower,
            upper: &upper,
            fixed: &vec![false; n],
            step: &step,
            evaluations,
            tolerance: CONVERGED,
        };
        let mut failure = None;
        let found = descend(
            &mut |x| self.account(held, x, true).map(|(q, _)| q).map_err(|e| failure = Some(e)).ok(),
            start,
            &limits,
        );
        // The start itself must be computable; a later failure only shortened a step.
        found.ok_or_else(|| failure.expect("a start that fails says why"))
    }

    /// The sum of squares at a point: with priors, and of data and baselines alone.
    pub(super) fn account(
        &self,
        held: &Held,
        at: &DVector<f64>,
        prior: bool,
    ) -> Result<(Quadratic, Quadratic), SimulationError> {
        let whitened = self.whitened(held, at)?;
        let n = at.len();
        let mut data = Quadratic { value: 0.0, gradient: DVector::zeros(n), information: DMatrix::zeros(n, n) };
        for w in &whitened {
            let x = w.columns(0, n);
            let r = w.column(n);
            data.value += r.norm_squared();
            data.gradient -= x.tr_mul(&r);
            data.information += x.tr_mul(&x);
        }
        for i in self.layout.len()..n {
            data.value += at[i] * at[i];
            data.gradient[i] += at[i];
            data.information[(i, i)] += 1.0;
        }
        let mut total = data.clone();
        if prior {
            for (i, p) in self.layout.free.iter().enumerate() {
                let (off, precision) = (at[i] - p.prior.factor.ln(), p.prior.log_sd.powi(-2));
                total.value += precision * off * off;
                total.gradient[i] += precision * off;
                total.information[(i, i)] += precision;
            }
        }
        Ok((total, data))
    }

    /// Everything as recorded, weighted with white noise alone: what the first descent sees.
    fn recorded(&self, at: &DVector<f64>) -> Result<Held, SimulationError> {
        let levels = NoiseLevels::default();
        let mut trials = Vec::with_capacity(self.trials.len());
        for trial in &self.trials {
            let starts = trial.starts();
            let target = self.target(trial, &starts);
            let identity = DMatrix::identity(target.len(), target.len());
            let (excitation, prepared) = (trial.excitation.clone(), trial.prepared.clone());
            trials.push(HeldTrial {
                views: vec![View { weight: 1.0, excitation, prepared }],
                correction: vec![DVector::zeros(knot_count(&trial.time)); self.n_muscles()],
                baselines: DMatrix::zeros(target.len(), self.n_muscles()),
                target,
                starts,
                noise: None,
                factor: positive(identity),
            });
        }
        let mut held = Held { trials, levels, kernels: Kernels::default() };
        self.restructure(&mut held, at)?;
        Ok(held)
    }

    fn target(&self, trial: &RecordedTrial, starts: &[usize]) -> DVector<f64> {
        trial.stacked(starts, |c| {
            let channel = &trial.channels[c];
            channel.measured.iter().zip(&channel.without_muscles).map(|(y, fixed)| y - fixed).collect()
        })
    }

    /// How noise enters every trial at a point; targets, baselines and factors follow.
    fn restructure(&self, held: &mut Held, at: &DVector<f64>) -> Result<(), SimulationError> {
        let model = if self.layout.changes_model() { Some(self.model_with(&|_, i| at[i])?) } else { None };
        let (levels, kernels) = (held.levels, held.kernels);
        held.trials
            .par_iter_mut()
            .zip(&self.trials)
            .map(|(held, trial)| {
                let own = model.as_ref().map(|m| self.prepare(m, trial, held)).transpose()?;
                let first = own.as_ref().map_or(&held.views[0].prepared, |own| &own[0]);
                let noise = self.structure(trial, held, first, at, &kernels)?;
                held.target = self.target(trial, &held.starts) + noise.respond(&held.correction);
                for m in 0..self.n_muscles() {
                    held.baselines.set_column(m, &(noise.respond_to_baseline(m) * BASELINE_SD));
                }
                held.factor = positive(noise.covariance(&levels));
                held.noise = Some(noise);
                Ok(())
            })
            .collect::<Vec<Result<(), SimulationError>>>()
            .into_iter()
            .collect()
    }

    fn structure(
        &self,
        trial: &RecordedTrial,
        held: &HeldTrial,
        prepared: &PreparedTrial,
        at: &DVector<f64>,
        kernels: &Kernels,
    ) -> Result<TrialNoise, SimulationError> {
        let starts = &held.starts;
        let (blocks, channels) = (starts.len() - 1, trial.channels.len());
        let counts: Vec<usize> = starts.windows(2).map(|w| w[1] - w[0]).collect();
        let knots = knot_count(&trial.time);
        let block_of: Vec<usize> = counts.iter().enumerate().flat_map(|(b, c)| std::iter::repeat_n(b, *c)).collect();
        let (mut responses, mut at_knots) = (Vec::new(), Vec::new());
        for m in 0..self.n_muscles() {
            let e = &held.views[0].excitation[m];
            let parameters = self.layout.parameters(m, &self.nominal[m], &|i| at[i]);
            let response = prepared.force_response(m, &prepared.solve(m, &parameters)?, e);
            let mut g = Response::new(blocks * channels, knots);
            for j in 0..knots {
                let (first, disturbance) = hat(&trial.time, e, j);
                response.respond(first, &disturbance, |k, force| {
                    let b = block_of[k];
                    for (c, channel) in trial.channels.iter().enumerate() {
                        g.add(c * blocks + b, j, channel.moment_arms[m][k] * force / counts[b] as f64);
                    }
                });
            }
            responses.push(g);
            at_knots
                .push((0..knots).map(|j| at_time(&trial.time, e, trial.time[0] + KNOT_SPACING * j as f64)).collect());
        }
        Ok(TrialNoise::correlated(&trial_times(trial, starts, &kernels.moment), responses, &at_knots, &kernels.emg))
    }

    /// Chooses the correlations of the noise by restricted likelihood: of the EMG's, then of the moment's, then again.
    fn choose_kernels(&self, held: &mut Held, columns: &[DMatrix<f64>]) {
        let (regressors, residuals) = self.regression(columns);
        let precision = DVector::from_vec(self.precision());
        let mut structure: Vec<TrialNoise> = held.trials.iter().filter_map(|t| t.noise.clone()).collect();
        if structure.len() < held.trials.len() {
            return;
        }
        for of_emg in [true, false, true] {
            let known = held.kernels;
            let with = |structure: &[TrialNoise], kernels: &Kernels| -> Vec<TrialNoise> {
                let pairs = structure.par_iter().zip(&self.trials).zip(&held.trials);
                let one = |((noise, trial), held): ((&TrialNoise, &RecordedTrial), &HeldTrial)| match of_emg {
                    true => noise.clone().with_emg_kernel(&kernels.emg),
                    false => noise.clone().with_times(trial_times(trial, &held.starts, &kernels.moment)),
                };
                pairs.map(one).collect()
            };
            let changed = |kernel: &Kernel| {
                if of_emg { Kernels { emg: *kernel, ..known } } else { Kernels { moment: *kernel, ..known } }
            };
            let start = if of_emg { known.emg } else { known.moment };
            let best = noise::best_kernel(&start, &FAMILIES, |kernel| {
                let noise = with(&structure, &changed(kernel));
                let trials = triples(&noise, &regressors, &residuals);
                let levels = noise::estimate_within(2, &trials, &precision, LEAST_WHITE, held.levels);
                noise::restricted_deviance(&trials, &precision, &levels)
            });
            held.kernels = changed(&best);
            structure = with(&structure, &held.kernels);
            held.levels =
                noise::estimate(&triples(&structure, &regressors, &residuals), &precision, LEAST_WHITE, held.levels);
        }
    }

    /// Regressors and residual of every trial from its columns.
    fn regression(&self, columns: &[DMatrix<f64>]) -> (Vec<DMatrix<f64>>, Vec<DVector<f64>>) {
        let n = self.layout.len() + self.n_muscles();
        let of = |c: &DMatrix<f64>| (c.columns(0, n).into_owned(), c.column(n).into_owned());
        columns.iter().map(of).unzip()
    }

    /// Prior precision of logarithms of factors and of baselines.
    fn precision(&self) -> Vec<f64> {
        let own = self.layout.free.iter().map(|p| p.prior.log_sd.powi(-2));
        own.chain(std::iter::repeat_n(1.0, self.n_muscles())).collect()
    }

    /// Estimates the variances, corrects the excitations, and computes how noise enters anew.
    fn noise(&self, mut held: Held, at: &DVector<f64>, pass: usize) -> Result<Held, SimulationError> {
        self.restructure(&mut held, at)?;
        let n = at.len();
        let columns = self.columns(&held, at)?;
        // In the first pass the EMG's noise is not allowed for yet: what it does would be taken for more of it.
        if pass == KERNEL_PASS {
            self.choose_kernels(&mut held, &columns);
            self.restructure(&mut held, at)?;
        } else if pass > 1 {
            let (regressors, residuals) = self.regression(&columns);
            let structure: Vec<&TrialNoise> = held.trials.iter().filter_map(|t| t.noise.as_ref()).collect();
            let trials: Vec<_> =
                structure.into_iter().zip(&regressors).zip(&residuals).map(|((t, x), r)| (t, x, r)).collect();
            let before = held.levels;
            let found = noise::estimate(&trials, &DVector::from_vec(self.precision()), LEAST_WHITE, before);
            // Estimates alternate about their common value: take the middle.
            held.levels = if pass > 2 { before.between(&found) } else { found };
        }
        let levels = held.levels;
        held.trials
            .par_iter_mut()
            .zip(&self.trials)
            .zip(&columns)
            .map(|((held, trial), columns)| {
                let Some(noise) = &held.noise else { return Ok(()) };
                let factor = positive(noise.covariance(&levels));
                let weighted = factor.solve(&columns.column(n).into_owned());
                let mut correction = noise.expected_noise(&levels, &weighted);
                for w in correction.iter_mut().flat_map(|w| w.iter_mut()) {
                    *w = w.clamp(-0.7, 0.7);
                }
                let excitation = corrected(&trial.time, &trial.excitation, &correction);
                let recording = trial.recording(&excitation);
                let prepared = self.model.prepare_like(&recording, &trial.prepared, &self.options)?;
                held.views = vec![View { weight: 1.0, excitation, prepared }];
                held.correction = correction;
                Ok(())
            })
            .collect::<Vec<Result<(), SimulationError>>>()
            .into_iter()
            .collect::<Result<(), _>>()?;
        self.restructure(&mut held, at)?;
        Ok(held)
    }

    /// Expected information of further trials about parameters and baselines, with the noise of a fit: what
    /// [`Fit::information`] gains by them.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn expected_information(
        &self,
        trials: Vec<RecordedTrial>,
        fit: &Fit,
    ) -> Result<Vec<DMatrix<f64>>, SimulationError> {
        let other = Problem { trials, ..self.clone() };
        let mut held = other.recorded(&fit.at)?;
        held.levels = fit.held.levels;
        held.kernels = fit.held.kernels;
        other.restructure(&mut held, &fit.at)?;
        let n = fit.at.len();
        let whitened = other.whitened(&held, &fit.at)?;
        Ok(whitened
            .iter()
            .map(|w| {
                let x = w.columns(0, n);
                x.tr_mul(&x)
            })
            .collect())
    }
}

/// What of a trial's noise depends on its times and direction alone; slow disturbances of one channel are not those of
/// another.
fn trial_times(trial: &RecordedTrial, starts: &[usize], kernel: &Kernel) -> Arc<TrialTimes> {
    let counts: Vec<usize> = starts.windows(2).map(|w| w[1] - w[0]).collect();
    let times = block_means(&trial.time, starts);
    let channels = trial.channels.len();
    let all_times: Vec<f64> =
        (0..channels).flat_map(|c| times.iter().map(move |t| t + CHANNEL_OFFSET * c as f64)).collect();
    let all_counts: Vec<usize> = (0..channels).flat_map(|_| counts.iter().copied()).collect();
    let times = TrialTimes::correlated(trial.direction, &all_times, &all_counts, kernel);
    Arc::new(times.sampled_every(trial.rows_per_moment))
}

/// What estimates of the noise are made from.
fn triples<'a>(
    noise: &'a [TrialNoise],
    regressors: &'a [DMatrix<f64>],
    residuals: &'a [DVector<f64>],
) -> Vec<(&'a TrialNoise, &'a DMatrix<f64>, &'a DVector<f64>)> {
    noise.iter().zip(regressors).zip(residuals).map(|((n, x), r)| (n, x, r)).collect()
}
