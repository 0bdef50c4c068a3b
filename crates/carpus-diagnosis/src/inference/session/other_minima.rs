//! Other local minima with the same effects: descents from muscles that are drawn from their prior
//! (`docs/src/theory/many-small-errors.md`, equation (34)).

use nalgebra::DVector;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::super::muscle_columns::COLUMNS;
use super::super::search::NEGLIGIBLE;
use super::state::{ODDS, OtherMinimum, Reached, Session, State};
use crate::fit::Point;
use carpus_effects::forward_model::{FITTED_PER_MUSCLE, Setting};
use carpus_effects::random::normal;
use carpus_simulation::simulation::SimulationError;

/// Pairs of opposite draws from the muscles' prior.
const PAIRS: usize = 2;
/// Their standard deviation, over that of the prior.
const WIDTH: f64 = 0.5;
/// Gauss–Newton steps from a draw.
const STEPS: usize = 10;

impl Session<'_> {
    /// States with a state's effects that descents from other muscles come to, if they are not much less probable.
    pub(super) fn other_minima(&self, state: &State) -> Result<Vec<State>, SimulationError> {
        let set = self.places(&state.point.effects);
        let sizes = self.sizes(state);
        let from = state.around(sizes);
        // With the state's noise, as those that are reached.
        let here = state.model.sizes_for(&set, sizes).1 + 2.0 * ODDS.ln() * set.len() as f64;
        let points = self.drawn_points(&state.point);
        let reach = |point: &Point| self.reach_from(&from, point.clone(), &set, STEPS).ok();
        let reached: Vec<Option<Reached>> = points.par_iter().with_max_len(1).map(reach).collect();
        // A draw that cannot be simulated leads nowhere.
        let near = reached.into_iter().flatten().filter(|r| r.deviance < here + NEGLIGIBLE);
        Ok(near.filter_map(|r| self.assessed(r.start(state.levels), &[], &set).ok()).collect())
    }

    /// The state with the other minima, each as probable as equation (20) says.
    pub(super) fn beside_others(&self, mut state: State, others: &[State]) -> State {
        state.others = others.iter().map(|other| self.other(other, &state, self.behind(other, &state))).collect();
        state
    }

    /// A minimum beside a state.
    ///
    /// - `behind`: by how much, equation (20)
    pub(super) fn other(&self, other: &State, state: &State, behind: f64) -> OtherMinimum {
        let [there, here] = [other, state].map(|s| self.own_values(&s.point));
        let first = self.analysis.n_nuisance();
        let mut away = DVector::from_element(self.columns_of_point(&state.point), f64::NAN);
        away.rows_mut(0, first).copy_from(&(there.rows(0, first) - here.rows(0, first)));
        let mut own = first;
        for setting in &state.point.effects {
            let id = setting.effect.description().id;
            let is_it = |s: &&Setting| s.effect.description().id == id;
            if other.point.effects.iter().any(|s| is_it(&s)) {
                let before = other.point.effects.iter().take_while(|s| !is_it(s));
                let at = first + before.map(|s| s.values.len()).sum::<usize>();
                let count = setting.values.len();
                away.rows_mut(own, count).copy_from(&(there.rows(at, count) - here.rows(own, count)));
            }
            own += setting.values.len();
        }
        OtherMinimum { away, odds: (-0.5 * behind.max(0.0)).exp() }
    }

    /// A point, its muscles as drawn: pairs of opposite draws about the prior's mean.
    fn drawn_points(&self, point: &Point) -> Vec<Point> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.analysis.seed);
        let given = self.analysis.forward.nominal_parameters();
        let columns = given.len() * FITTED_PER_MUSCLE;
        let mut out = Vec::new();
        for _ in 0..PAIRS {
            let draw: Vec<f64> = (0..columns).map(|_| WIDTH * normal(&mut rng)).collect();
            for side in [1.0, -1.0] {
                let log = |column: usize| {
                    let [mean, sd] = self.muscle_prior(column);
                    let [low, high] = self.analysis.log_bounds[column % FITTED_PER_MUSCLE];
                    (mean + side * sd * draw[column]).clamp(low, high)
                };
                let mut logs: Vec<f64> = (0..columns).map(log).collect();
                self.analysis.tied.iter().for_each(|[first, other]| logs[*other] = logs[*first]);
                let mut point = point.clone();
                for (column, log) in logs.into_iter().enumerate() {
                    let (muscle, property) = (column / FITTED_PER_MUSCLE, COLUMNS[column % FITTED_PER_MUSCLE]);
                    *property.of_mut(&mut point.parameters[muscle]) = property.of(&given[muscle]) * log.exp();
                }
                out.push(point);
            }
        }
        out
    }

    /// Muscles, baselines and parameters of effects of a point, in the units of their columns.
    fn own_values(&self, point: &Point) -> DVector<f64> {
        self.priors(point).1
    }
}
