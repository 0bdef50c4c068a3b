//! Draws from the posterior by the no-U-turn sampler: Hamiltonian Monte Carlo that finds its own path length.
//!
//! Inside the bounds, each parameter is mapped to the whole line by the logit, so that no path hits a wall. The mass
//! matrix begins as the inverse of the covariance at the fit and is learned in windows of the warm-up, dense, as the
//! density is bent; the step size is adapted by dual averaging.
//!
//! Own code of a page, because the crate nuts-rs brings a linear algebra of its own. Checked against closed forms and
//! against random-walk Metropolis.
//!
//! # References
//! Hoffman & Gelman (2014), The No-U-Turn Sampler, J. Mach. Learn. Res. 15; Betancourt (2017), arXiv:1701.02434
//! (multinomial sampling of trajectories).

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use carpus_numerics::statistics::normal_of_uniform;

/// Most doublings of a path.
const MOST_DOUBLINGS: usize = 8;
/// Acceptance that the step size aims at.
const ACCEPTANCE: f64 = 0.9;
/// Ends of the windows from which the mass matrix is learned, as shares of the warm-up.
const WINDOWS: [f64; 3] = [0.25, 0.5, 0.85];
/// Draws that the covariance that was told counts for in each.
const TOLD: f64 = 20.0;
/// A path has left the typical set when its energy is off by this much.
const DIVERGENT: f64 = 1000.0;

/// A log density on the whole line, and its gradient.
pub(super) trait LogDensity: Sync {
    fn calc(&self, x: &DVector<f64>) -> (f64, DVector<f64>);
}

/// How much is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Amount {
    pub(super) chains: usize,
    pub(super) warm_up: usize,
    pub(super) draws: usize,
}

/// Draws of all chains, and how far they can be trusted.
#[derive(Clone, Debug)]
pub(super) struct Draws {
    /// Chain by chain.
    pub(super) chains: Vec<Vec<DVector<f64>>>,
    /// Paths that left the typical set.
    pub(super) divergent: usize,
}

#[derive(Clone)]
struct State {
    x: DVector<f64>,
    momentum: DVector<f64>,
    log_density: f64,
    gradient: DVector<f64>,
}

/// Part of a path.
struct Tree {
    left: State,
    right: State,
    proposal: State,
    /// Logarithm of the sum of weights.
    log_weight: f64,
    /// Sum of momenta.
    rho: DVector<f64>,
    turning: bool,
    divergent: bool,
    acceptance: f64,
    steps: usize,
}

struct Sampler<'a, D: LogDensity> {
    density: &'a D,
    /// Lower Cholesky factor of the covariance.
    factor: DMatrix<f64>,
    covariance: DMatrix<f64>,
    rng: ChaCha8Rng,
    step: f64,
}

/// Draws chains in parallel; the same at any number of threads.
///
/// - `start`: where every chain starts
/// - `covariance`: about that of the density
pub(super) fn draw<D: LogDensity>(
    density: &D,
    start: &DVector<f64>,
    covariance: &DMatrix<f64>,
    amount: Amount,
    seed: u64,
) -> Option<Draws> {
    let factor = covariance.clone().cholesky()?.l();
    let chains: Vec<(Vec<DVector<f64>>, usize)> = (0..amount.chains)
        .into_par_iter()
        .map(|chain| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(1000 + chain as u64);
            let mut sampler =
                Sampler { density, factor: factor.clone(), covariance: covariance.clone(), rng, step: 0.5 };
            sampler.chain(start, amount)
        })
        .collect();
    let divergent = chains.iter().map(|(_, d)| d).sum();
    Some(Draws { chains: chains.into_iter().map(|(c, _)| c).collect(), divergent })
}

impl<D: LogDensity> Sampler<'_, D> {
    fn chain(&mut self, start: &DVector<f64>, amount: Amount) -> (Vec<DVector<f64>>, usize) {
        let n = start.len();
        // Chains start apart: half a standard deviation about the fit.
        let scatter = DVector::from_fn(n, |_, _| 0.5 * self.normal());
        let x = start + &self.factor * scatter;
        let (log_density, gradient) = self.density.calc(&x);
        let mut state = State { x, momentum: DVector::zeros(n), log_density, gradient };
        let (mut draws, mut divergent) = (Vec::with_capacity(amount.draws), 0);
        // Dual averaging (Hoffman & Gelman 2014, section 3.2).
        let (gamma, t0, kappa) = (0.05, 10.0, 0.75);
        let (mut mu, mut m, mut h_bar, mut log_step_bar) = ((10.0 * self.step).ln(), 0.0, 0.0, 0.0);
        let ends = WINDOWS.map(|share| (share * amount.warm_up as f64) as usize);
        let (told, mut window) = (self.covariance.clone(), Vec::new());
        for iteration in 0..amount.warm_up + amount.draws {
            let tree = self.path(&state);
            let acceptance = tree.acceptance / tree.steps.max(1) as f64;
            state = tree.proposal;
            if iteration < amount.warm_up {
                m += 1.0;
                let w = 1.0 / (m + t0);
                h_bar = (1.0 - w) * h_bar + w * (ACCEPTANCE - acceptance);
                let log_step = mu - m.sqrt() / gamma * h_bar;
                let eta = m.powf(-kappa);
                log_step_bar = eta * log_step + (1.0 - eta) * log_step_bar;
                let now = if iteration + 1 == amount.warm_up { log_step_bar } else { log_step };
                self.step = now.exp().clamp(1e-4, 2.0);
                window.push(state.x.clone());
                if ends.contains(&(iteration + 1)) {
                    self.learn(&told, &window);
                    window.clear();
                    self.step = log_step_bar.exp().clamp(1e-4, 2.0);
                    (mu, m, h_bar, log_step_bar) = ((10.0 * self.step).ln(), 0.0, 0.0, 0.0);
                }
            } else {
                divergent += usize::from(tree.divergent);
                draws.push(state.x.clone());
            }
        }
        (draws, divergent)
    }

    /// The mass matrix from draws, with the covariance that was told as if it were some more of them.
    fn learn(&mut self, told: &DMatrix<f64>, draws: &[DVector<f64>]) {
        let (n, dimension) = (draws.len() as f64, told.nrows());
        if n < 2.0 {
            return;
        }
        let mean = draws.iter().fold(DVector::zeros(dimension), |sum, x| sum + x) / n;
        let mut sum = told * TOLD;
        for x in draws {
            let off = x - &mean;
            sum.ger(1.0, &off, &off, 1.0);
        }
        let covariance = sum / (n - 1.0 + TOLD);
        if let Some(factor) = covariance.clone().cholesky() {
            (self.factor, self.covariance) = (factor.l(), covariance);
        }
    }

    /// A path from a state with a fresh momentum.
    fn path(&mut self, from: &State) -> Tree {
        let n = from.x.len();
        // Momentum of covariance = inverse of the parameters'.
        let z = DVector::from_fn(n, |_, _| self.normal());
        let momentum = self.factor.tr_solve_lower_triangular(&z).unwrap_or(z);
        let start = State { momentum, ..from.clone() };
        let energy = self.energy(&start);
        let mut tree = Tree {
            left: start.clone(),
            right: start.clone(),
            rho: start.momentum.clone(),
            proposal: start,
            log_weight: 0.0,
            turning: false,
            divergent: false,
            acceptance: 0.0,
            steps: 0,
        };
        for depth in 0..MOST_DOUBLINGS {
            let forward = self.rng.random::<f64>() < 0.5;
            let end = if forward { &tree.right } else { &tree.left }.clone();
            let other = self.build(&end, depth, if forward { 1.0 } else { -1.0 }, energy);
            tree.acceptance += other.acceptance;
            tree.steps += other.steps;
            tree.divergent |= other.divergent;
            if other.turning || other.divergent {
                break;
            }
            // Progressive sampling towards the new half.
            if self.rng.random::<f64>().ln() < other.log_weight - tree.log_weight {
                tree.proposal = other.proposal;
            }
            tree.log_weight = log_sum(tree.log_weight, other.log_weight);
            tree.rho += &other.rho;
            if forward {
                tree.right = other.right
            } else {
                tree.left = other.left
            }
            if self.turns(&tree.left, &tree.right, &tree.rho) {
                break;
            }
        }
        tree
    }

    fn build(&mut self, from: &State, depth: usize, direction: f64, energy: f64) -> Tree {
        if depth == 0 {
            let state = self.leap(from, direction * self.step);
            let off = energy - self.energy(&state);
            let off = if off.is_finite() { off } else { f64::NEG_INFINITY };
            return Tree {
                left: state.clone(),
                right: state.clone(),
                rho: state.momentum.clone(),
                proposal: state,
                log_weight: off,
                turning: false,
                divergent: off < -DIVERGENT,
                acceptance: off.min(0.0).exp(),
                steps: 1,
            };
        }
        let mut first = self.build(from, depth - 1, direction, energy);
        if first.turning || first.divergent {
            return first;
        }
        let end = if direction > 0.0 { &first.right } else { &first.left }.clone();
        let second = self.build(&end, depth - 1, direction, energy);
        first.acceptance += second.acceptance;
        first.steps += second.steps;
        first.turning = second.turning;
        first.divergent = second.divergent;
        if second.turning || second.divergent {
            return first;
        }
        let total = log_sum(first.log_weight, second.log_weight);
        if self.rng.random::<f64>().ln() < second.log_weight - total {
            first.proposal = second.proposal;
        }
        first.log_weight = total;
        first.rho += &second.rho;
        if direction > 0.0 {
            first.right = second.right
        } else {
            first.left = second.left
        }
        first.turning = self.turns(&first.left, &first.right, &first.rho);
        first
    }

    fn leap(&self, from: &State, step: f64) -> State {
        let half = &from.momentum + &from.gradient * (0.5 * step);
        let x = &from.x + &self.covariance * &half * step;
        let (log_density, gradient) = self.density.calc(&x);
        let momentum = half + &gradient * (0.5 * step);
        State { x, momentum, log_density, gradient }
    }

    fn energy(&self, state: &State) -> f64 {
        0.5 * state.momentum.dot(&(&self.covariance * &state.momentum)) - state.log_density
    }

    fn turns(&self, left: &State, right: &State, rho: &DVector<f64>) -> bool {
        let along = &self.covariance * rho;
        left.momentum.dot(&along) <= 0.0 || right.momentum.dot(&along) <= 0.0
    }

    fn normal(&mut self) -> f64 {
        normal_of_uniform([1.0 - self.rng.random::<f64>(), self.rng.random()])
    }
}

fn log_sum(a: f64, b: f64) -> f64 {
    let most = a.max(b);
    if most == f64::NEG_INFINITY { most } else { most + ((a - most).exp() + (b - most).exp()).ln() }
}

impl Draws {
    /// One coordinate of all draws, chain by chain.
    pub(super) fn of(&self, f: impl Fn(&DVector<f64>) -> f64) -> Vec<Vec<f64>> {
        self.chains.iter().map(|c| c.iter().map(&f).collect()).collect()
    }
}

/// Split R̂: near 1 when chains, and halves of chains, agree (Gelman et al. 2013, section 11.4).
pub(super) fn split_r_hat(chains: &[Vec<f64>]) -> f64 {
    let halves: Vec<&[f64]> = chains.iter().flat_map(|c| [&c[..c.len() / 2], &c[c.len() / 2..]]).collect();
    let n = halves.iter().map(|h| h.len()).min().unwrap_or(0) as f64;
    if n < 2.0 {
        return f64::NAN;
    }
    let means: Vec<f64> = halves.iter().map(|h| mean(h)).collect();
    let within = mean(&halves.iter().map(|h| variance(h)).collect::<Vec<_>>());
    let between = n * variance(&means);
    if within == 0.0 { 1.0 } else { (((n - 1.0) / n * within + between / n) / within).sqrt() }
}

/// Effective number of independent draws, by Geyer's initial positive sequence over all chains.
pub(super) fn effective_draws(chains: &[Vec<f64>]) -> f64 {
    let n = chains.iter().map(Vec::len).min().unwrap_or(0);
    let total = (n * chains.len()) as f64;
    let average = mean(&chains.iter().flatten().copied().collect::<Vec<_>>());
    let correlation = |lag: usize| -> f64 {
        chains
            .iter()
            .map(|c| (0..n - lag).map(|k| (c[k] - average) * (c[k + lag] - average)).sum::<f64>() / n as f64)
            .sum::<f64>()
    };
    let at_zero = correlation(0);
    if n < 4 || at_zero == 0.0 {
        return total;
    }
    let mut sum = 0.0;
    let mut lag = 1;
    while lag + 1 < n {
        let pair = (correlation(lag) + correlation(lag + 1)) / at_zero;
        if pair <= 0.0 {
            break;
        }
        sum += pair;
        lag += 2;
    }
    (total / (1.0 + 2.0 * sum)).min(2.0 * total)
}

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

pub(super) fn variance(values: &[f64]) -> f64 {
    let m = mean(values);
    values.iter().map(|v| (v - m).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Normal(DMatrix<f64>);
    impl LogDensity for Normal {
        fn calc(&self, x: &DVector<f64>) -> (f64, DVector<f64>) {
            let g = &self.0 * x;
            (-0.5 * x.dot(&g), -g)
        }
    }

    /// A banana: y ~ N(0, 1), x | y ~ N(y²/2, 1). E x = 1/2, var x = 3/2.
    struct Banana;
    impl LogDensity for Banana {
        fn calc(&self, p: &DVector<f64>) -> (f64, DVector<f64>) {
            let (x, y) = (p[0], p[1]);
            let r = x - 0.5 * y * y;
            (-0.5 * (r * r + y * y), DVector::from_vec(vec![-r, r * y - y]))
        }
    }

    const AMOUNT: Amount = Amount { chains: 4, warm_up: 300, draws: 2000 };

    #[test]
    fn verif_draws_of_a_normal_have_its_mean_and_covariance() {
        let covariance = DMatrix::from_row_slice(2, 2, &[1.0, 0.9, 0.9, 2.0]);
        let precision = covariance.clone().try_inverse().unwrap();
        // The sampler is told a wrong covariance.
        let told = DMatrix::identity(2, 2);
        let draws = draw(&Normal(precision), &DVector::zeros(2), &told, AMOUNT, 5).unwrap();
        for i in 0..2 {
            let of = draws.of(|x| x[i]);
            let all: Vec<f64> = of.concat();
            let n = effective_draws(&of);
            assert!(n > 1000.0 && split_r_hat(&of) < 1.02, "{n}");
            assert!(mean(&all).abs() < 4.0 * (covariance[(i, i)] / n).sqrt());
            assert!((variance(&all) / covariance[(i, i)] - 1.0).abs() < 6.0 / n.sqrt());
        }
        let product: Vec<f64> = draws.of(|x| x[0] * x[1]).concat();
        assert!((mean(&product) - 0.9).abs() < 0.1);
    }

    #[test]
    fn verif_draws_of_a_banana_have_its_moments() {
        // Variances of squares need many draws.
        let many = Amount { draws: 20_000, ..AMOUNT };
        let draws = draw(&Banana, &DVector::zeros(2), &DMatrix::identity(2, 2), many, 3).unwrap();
        let x: Vec<f64> = draws.of(|p| p[0]).concat();
        let y: Vec<f64> = draws.of(|p| p[1]).concat();
        assert!((mean(&x) - 0.5).abs() < 0.05 && (variance(&x) - 1.5).abs() < 0.15, "{} {}", mean(&x), variance(&x));
        assert!(mean(&y).abs() < 0.04 && (variance(&y) - 1.0).abs() < 0.05, "{} {}", mean(&y), variance(&y));
    }

    #[test]
    fn verif_r_hat_sees_chains_that_disagree() {
        let around = |c: f64| (0..200).map(|i| c + ((i * 37 % 101) as f64 / 50.0 - 1.0)).collect::<Vec<_>>();
        assert!(split_r_hat(&[around(0.0), around(0.0)]) < 1.05);
        assert!(split_r_hat(&[around(0.0), around(3.0)]) > 1.5);
    }
}
