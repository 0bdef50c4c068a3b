//! Single sets of effects: those that are more likely missing than not, and the same state with another set.

use std::sync::atomic::AtomicUsize;

use nalgebra::DMatrix;

use super::super::linear_model::{Prior, Sizes};
use super::super::muscles::Muscles;
use super::super::search::Budget;
use super::steps::profiled;
use super::{Around, Begun, STEPS, Session, Start, State};
use crate::effect::Effect;
use crate::fit::{Analysis, Point};
use crate::forward_model::{FITTED_PER_MUSCLE, ForwardModel};
use carpus_simulation::simulation::SimulationError;

/// Gauss–Newton steps towards moments that another model made.
const DISTANT_STEPS: usize = 12;

/// An effect is named if it, or one that may stand in its place, is more likely missing than not.
const LIKELY: f64 = 0.5;

impl Session<'_> {
    /// The state with the effects that are more likely missing than not, and no others (the median probability model; Barbieri &
    /// Berger 2004, doi:10.1214/009053604000000238), less those without which a state is ahead and predicts left-out trials as well. And for
    /// each of the others, the strongest first, by how much −2 log posterior is larger
    /// where it is taken out and everything else is fitted anew.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn likely(
        &self,
        mut state: State,
        report: &dyn Fn(&str),
    ) -> Result<(State, Vec<(usize, f64)>), SimulationError> {
        let candidates = self.testable();
        let mut set: Vec<(f64, usize)> =
            self.places(&state.point.effects).into_iter().map(|e| (self.group(&state, e).1, e)).collect();
        set.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut evidence = Vec::new();
        for (probability, effect) in set {
            let rest: Vec<usize> = self.places(&state.point.effects).into_iter().filter(|e| *e != effect).collect();
            let without = self.with_set(&state, &rest, &candidates)?;
            let behind = self.behind(&without, &state);
            report(&format!("without {:?} ({probability:.2}) {behind:.1} behind", self.ids(&[effect])));
            let left_out = |state: &State| self.handed_over(state).map(|model| model.left_out_ratio);
            let is_better = behind < 0.0 && left_out(&without)? <= left_out(&state)?;
            match probability < LIKELY || is_better {
                true => state = without,
                false => evidence.push((effect, behind)),
            }
        }
        evidence.sort_by(|a, b| b.1.total_cmp(&a.1));
        Ok((state, evidence))
    }

    /// The muscles alone, from where a session of the same trials has them, with the noise and the autocorrelations of this one if it has
    /// estimated them.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn taken_up(&mut self, muscles: &Muscles, report: &dyn Fn(&str)) -> Result<State, SimulationError> {
        let Muscles { session, state, .. } = muscles;
        if !self.noise_is_final {
            let Analysis { kernels, times, blocks, .. } = &session.analysis;
            (self.analysis.kernels, self.analysis.times) = (*kernels, times.clone());
            self.analysis.blocks = blocks.clone();
            (self.levels, self.noise_is_final) = (state.levels, true);
        }
        let start = Start {
            point: state.point.clone(),
            levels: self.levels,
            set: Vec::new(),
            sizes: self.sizes(state).clone(),
            directions: state.directions.clone(),
        };
        let state = self.assessed(start, &[], &[])?;
        self.settle(Begun { state, candidates: Vec::new(), always: Vec::new() }, report)
    }

    /// The state with these effects and no others: muscles, effects and noise estimated anew.
    ///
    /// - `set`: places of the effects, ascending; `others`: of those that are weighed beside them
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn with_set(&self, state: &State, set: &[usize], others: &[usize]) -> Result<State, SimulationError> {
        let from = Around {
            point: &state.point,
            model: &state.model,
            sizes: self.sizes(state),
            noise: &state.noise,
            factors: &state.factors,
            directions: &state.directions,
        };
        let reached = self.reach(&from, set, STEPS)?;
        self.assessed(reached.start(state.levels), others, if others.is_empty() { set } else { &[] })
    }

    /// Sizes that go with the effects of the point.
    pub(crate) fn sizes<'s>(&self, state: &'s State) -> &'s Sizes {
        let set = self.places(&state.point.effects);
        &state.sets.found.iter().find(|s| s.effects == set).unwrap_or(state.sets.best()).sizes
    }

    /// The same trials with other moments, of a model with effects that are on: nothing is estimated but these and the muscles.
    ///
    /// - `forward`: the model; `targets`: moments of every training trial [N·m]
    pub fn beside<'b>(
        &self,
        forward: &'b ForwardModel,
        effects: Vec<&'static dyn Effect>,
        targets: Vec<Vec<f64>>,
    ) -> Session<'b> {
        let analysis = Analysis {
            forward,
            train: self.analysis.train.clone(),
            candidates: effects,
            prior_sd: self.analysis.prior_sd,
            log_bounds: self.analysis.log_bounds,
            tied: self.analysis.tied.clone(),
            blocks: Vec::new(),
            times: self.analysis.times.clone(),
            kernels: self.analysis.kernels,
            seed: self.analysis.seed,
            targets: Some(targets),
            linearized: AtomicUsize::new(0),
        };
        Session::of(analysis, Budget::none())
    }

    /// Least distance of the session's moments from what its model can do: muscles and effects are fitted, the noise is a state's.
    /// Penalized sum of squares, beyond that of the state's muscles; its root [standard deviations].
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn distance(&self, start: Point, at: &State) -> Result<f64, SimulationError> {
        let set: Vec<usize> = (0..self.analysis.candidates.len()).collect();
        let sizes = Sizes { everything: 0.0, discrepancy: vec![0.0; self.analysis.n_muscles() + 1] };
        let mut point = start;
        let mut linear = self.linearized(&point, &at.noise)?;
        let amplitudes: usize = self.analysis.candidates.iter().map(|e| e.description().amplitudes().count()).sum();
        let directions: Vec<DMatrix<f64>> =
            linear.iter().map(|l| DMatrix::zeros(l.residual.len(), amplitudes)).collect();
        let (noise, factors) = (&at.noise, &at.factors);
        let model = self.descend(&mut point, &mut linear, noise, factors, &directions, &set, &sizes, DISTANT_STEPS)?;
        let own = self.analysis.n_nuisance() + point.effects.iter().map(|s| s.values.len()).sum::<usize>();
        let muscles = 0..self.analysis.n_muscles() * FITTED_PER_MUSCLE;
        let of_state: f64 = muscles
            .map(|j| match at.model.priors[j] {
                Prior::Known(sd) => (at.model.offset[j] / sd).powi(2),
                _ => 0.0,
            })
            .sum();
        Ok((profiled(&model, own, &set, &sizes) - of_state).max(0.0).sqrt())
    }
}
