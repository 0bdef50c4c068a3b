//! What trials would tell of muscles and effects, without anything being fitted.

use std::sync::atomic::AtomicUsize;

use nalgebra::{DMatrix, DVector};

use super::{AMPLITUDE_PRECISION, Analysis, Fit, Point, log_bounds, prior_sd, trial_times, whiten};
use crate::noise::{self, Kernels};
use carpus_effects::effect::Effect;
use carpus_effects::forward_model::ForwardModel;
use carpus_simulation::simulation::SimulationError;
use carpus_study::study::ParameterBounds;

impl<'a> Analysis<'a> {
    /// Trials that were not recorded: nothing is fitted.
    pub(crate) fn without_data(
        forward: &'a ForwardModel,
        train: Vec<usize>,
        candidates: Vec<&'static dyn Effect>,
        bounds: &ParameterBounds,
        seed: u64,
    ) -> Analysis<'a> {
        let kernels = Kernels::default();
        let times = train.iter().map(|g| trial_times(&forward.trials[*g], &kernels.moment)).collect();
        Analysis {
            forward,
            train,
            candidates,
            prior_sd: prior_sd(bounds),
            log_bounds: log_bounds(bounds),
            tied: Vec::new(),
            blocks: Vec::new(),
            times,
            kernels,
            seed,
            targets: None,
            linearized: AtomicUsize::new(0),
        }
    }

    /// The same with noise that goes with itself in time as in another analysis.
    pub(crate) fn with_kernels_of(mut self, other: &Analysis) -> Self {
        self.kernels = other.kernels;
        let time = |g: &usize| trial_times(&self.forward.trials[*g], &other.kernels.moment);
        self.times = self.train.iter().map(time).collect();
        self
    }

    /// Information [nuisance | directions] of trials that were not recorded, at another fit's parameters and noise.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(crate) fn information(&mut self, at: &Fit) -> Result<DMatrix<f64>, SimulationError> {
        let point = Point { parameters: at.point.parameters.clone(), ..self.nominal_point() };
        let rough = self.linearize(&point, &[])?;
        let noise = self.noise_structure(&rough, &point);
        let linear = self.linearize(&point, &noise)?;
        let directions;
        (directions, self.blocks) = self.calc_directions(&linear, &point)?;
        let n = self.n_nuisance();
        let columns = directions.first().map_or(0, DMatrix::ncols);
        let mut normal = DMatrix::zeros(n + columns, n + columns);
        for ((linear, directions), noise) in linear.iter().zip(&directions).zip(&noise) {
            let Some(factor) = noise::factor(noise, &at.levels) else { continue };
            let mut x = linear.nuisance.clone().resize_horizontally(n + columns, 0.0);
            x.columns_mut(n, columns).copy_from(directions);
            let x = whiten(&factor, &x);
            normal += x.tr_mul(&x);
        }
        Ok(normal)
    }

    /// Information [nuisance | directions] of the training trials at a fit without effects.
    pub(crate) fn normal(&self, null: &Fit) -> DMatrix<f64> {
        let p = null.precision.len();
        let columns = null.directions.first().map_or(0, DMatrix::ncols);
        let mut normal = DMatrix::zeros(p + columns, p + columns);
        for ((w, d), factor) in null.whitened.iter().zip(&*null.directions).zip(&null.factors) {
            let mut x = w.columns(0, p).clone_owned().resize_horizontally(p + columns, 0.0);
            x.columns_mut(p, columns).copy_from(&whiten(factor, d));
            normal += x.tr_mul(&x);
        }
        normal
    }

    /// z of an effect against a rival: length of its signature, muscles and rival profiled out, at a given size.
    ///
    /// - `size`: of its amplitudes, in units of their scales
    pub fn pairwise_z(&self, null: &Fit, truth: &str, size: &DVector<f64>, rival: &str) -> Option<f64> {
        let p = null.precision.len();
        let columns = |name: &str| self.blocks.iter().find(|b| b.name == name).map(|b| b.columns.clone());
        let (own, others) = (columns(truth)?, columns(rival)?);
        let asked = [&others[..], &own[..]].concat();
        let count = p + others.len();
        let mut information = DMatrix::from_diagonal(&DVector::from_iterator(
            count,
            null.precision.iter().copied().chain(std::iter::repeat_n(AMPLITUDE_PRECISION, others.len())),
        ));
        let (mut cross, mut length) = (DVector::zeros(count), 0.0);
        for ((w, d), factor) in null.whitened.iter().zip(&*null.directions).zip(&null.factors) {
            let d = whiten(factor, &d.select_columns(&asked));
            let mut x = DMatrix::zeros(w.nrows(), count);
            x.columns_mut(0, p).copy_from(&w.columns(0, p));
            let mut signature = DVector::zeros(w.nrows());
            x.columns_mut(p, others.len()).copy_from(&d.columns(0, others.len()));
            d.columns(others.len(), own.len()).column_iter().zip(size.iter()).for_each(|(d, s)| signature += d * *s);
            information += x.tr_mul(&x);
            cross += x.tr_mul(&signature);
            length += signature.norm_squared();
        }
        let explained = cross.dot(&information.cholesky()?.solve(&cross));
        Some((length - explained).max(0.0).sqrt())
    }
}
