//! The population of one effect's sizes, by summation over a grid (`docs/src/theory/cohort.md`, equations
//! (C2) to (C5)).

use nalgebra::{DMatrix, DVector};

use carpus_numerics::numerics::cholesky;

/// Amplitudes that an effect may have.
pub(super) const MOST_AMPLITUDES: usize = 2;
/// Largest mean on the grid, in standard deviations of what is plausible.
const LARGEST_MEAN: f64 = 3.0;
/// Means on the grid of one amplitude, and of each of two: odd, so that 0 is one of them.
const MEANS: [usize; MOST_AMPLITUDES] = [121, 31];
/// Spreads on the grid: standard deviations over the population, in those of what is plausible.
const SPREADS: [f64; 7] = [0.0, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0];
/// Prior scale of the spread: half-normal.
const SPREAD_SCALE: f64 = 0.35;
/// Shares of the population that have the effect, on the grid: all alike before the data.
const SHARES: usize = 10;

/// The likelihood of one participant's amplitudes: exp(−½ xᵀ Λ x + hᵀ x).
#[derive(Clone, Debug)]
pub(super) struct Likelihood {
    pub(super) information: DMatrix<f64>,
    pub(super) score: DVector<f64>,
    /// Standard deviation of the amplitudes of a participant without the effect: κ.
    pub(super) small: f64,
}

/// A normal distribution of amplitudes, with the same variance in all directions, taken times a likelihood.
struct Product {
    /// Logarithm of the mass.
    log_mass: f64,
    mean: DVector<f64>,
    variance: DVector<f64>,
}

impl Likelihood {
    /// Taken times N(`mean`, `variance` I).
    fn times(&self, mean: &DVector<f64>, variance: f64) -> Product {
        let k = mean.len();
        let beyond = &self.score - &self.information * mean;
        let at_mean = self.score.dot(mean) - 0.5 * mean.dot(&(&self.information * mean));
        let m = DMatrix::identity(k, k) + &self.information * variance;
        // The information of a marginal likelihood is positive semidefinite but for rounding.
        let Some(factor) = cholesky(m) else {
            return Product { log_mass: at_mean, mean: mean.clone(), variance: DVector::from_element(k, variance) };
        };
        let step = factor.solve(&beyond) * variance;
        let log_determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
        Product {
            log_mass: at_mean + 0.5 * beyond.dot(&step) - 0.5 * log_determinant,
            mean: mean + step,
            variance: factor.inverse().diagonal() * variance,
        }
    }

    /// Logarithm of the mass of [`Likelihood::times`], in closed form.
    fn log_mass(&self, mean: &DVector<f64>, variance: f64) -> f64 {
        let (a, h) = (&self.information, &self.score);
        if mean.len() == 1 {
            let (a, h, m) = (a[(0, 0)], h[0], mean[0]);
            let (beyond, d) = (h - a * m, (1.0 + variance * a).max(f64::MIN_POSITIVE));
            return h * m - 0.5 * a * m * m + 0.5 * variance * beyond * beyond / d - 0.5 * d.ln();
        }
        let [m0, m1] = [mean[0], mean[1]];
        let through = [a[(0, 0)] * m0 + a[(0, 1)] * m1, a[(1, 0)] * m0 + a[(1, 1)] * m1];
        let at_mean = h[0] * m0 + h[1] * m1 - 0.5 * (m0 * through[0] + m1 * through[1]);
        let [b0, b1] = [h[0] - through[0], h[1] - through[1]];
        let [d0, d1, off] = [1.0 + variance * a[(0, 0)], 1.0 + variance * a[(1, 1)], variance * a[(0, 1)]];
        let determinant = (d0 * d1 - off * off).max(f64::MIN_POSITIVE);
        let squares = (d1 * b0 * b0 - 2.0 * off * b0 * b1 + d0 * b1 * b1) / determinant;
        at_mean + 0.5 * variance * squares - 0.5 * determinant.ln()
    }

    /// Amplitudes by these trials alone: value and ends of the 95 % interval, each.
    pub(super) fn alone(&self) -> Vec<[f64; 3]> {
        let found = self.times(&DVector::zeros(self.score.len()), 1.0);
        found.mean.iter().zip(&found.variance).map(|(m, v)| interval(*m, *v)).collect()
    }
}

fn interval(mean: f64, variance: f64) -> [f64; 3] {
    let half = 1.96 * variance.max(0.0).sqrt();
    [mean, mean - half, mean + half]
}

/// A point of the grid, and how probable it is.
struct Node {
    mean: DVector<f64>,
    spread: f64,
    share: f64,
    weight: f64,
}

/// One participant in the population.
#[derive(Clone, Debug)]
pub(super) struct Membership {
    /// Probability that it has the effect.
    pub(super) probability: f64,
    /// See [`super::Member::deviation`].
    pub(super) deviation: f64,
    /// Amplitudes should it have the effect: value and ends of the 95 % interval.
    pub(super) sizes: Vec<[f64; 3]>,
}

/// The population of an effect's sizes.
pub(super) struct Population {
    /// Natural logarithm of the Bayes factor for the effect.
    pub(super) log_bayes_factor: f64,
    nodes: Vec<Node>,
    members: Vec<Membership>,
}

/// Weights that sum to 1, and the logarithm of the sum.
fn normalized(logs: &[f64]) -> (Vec<f64>, f64) {
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = logs.iter().map(|l| (l - most).exp()).collect();
    let sum: f64 = weights.iter().sum();
    (weights.iter().map(|w| w / sum).collect(), most + sum.ln())
}

/// Means of the grid along one amplitude.
///
/// - `sign`: that it must have
fn means(count: usize, sign: Option<f64>) -> Vec<f64> {
    let step = 2.0 * LARGEST_MEAN / (count - 1) as f64;
    let all = (0..count).map(|i| step * i as f64 - LARGEST_MEAN);
    all.filter(|m| sign.is_none_or(|sign| sign * m > -0.5 * step)).collect()
}

impl Population {
    /// - `all`: of every participant
    /// - `signs`: of the amplitudes' means, where they must have one
    pub(super) fn of(all: &[Likelihood], signs: &[Option<f64>]) -> Population {
        let k = signs.len();
        let along: Vec<Vec<f64>> = signs.iter().map(|sign| means(MEANS[k - 1], *sign)).collect();
        let centres: Vec<DVector<f64>> = match along.as_slice() {
            [only] => only.iter().map(|m| DVector::from_element(1, *m)).collect(),
            [first, second] => {
                first.iter().flat_map(|a| second.iter().map(|b| DVector::from_vec(vec![*a, *b]))).collect()
            }
            _ => Vec::new(),
        };
        let none = DVector::zeros(k);
        let without: Vec<f64> = all.iter().map(|l| l.log_mass(&none, l.small * l.small)).collect();
        let mut nodes = Vec::new();
        let (mut logs, mut priors) = (Vec::new(), Vec::new());
        for mean in &centres {
            for spread in SPREADS {
                let prior = -0.5 * mean.norm_squared() - 0.5 * (spread / SPREAD_SCALE).powi(2);
                let with = all
                    .iter()
                    .zip(&without)
                    .map(|(l, without)| l.log_mass(mean, spread * spread + l.small * l.small) - without);
                // Ratios may be far beyond what a number can hold: all are relative to the larger of both.
                let with: Vec<(f64, f64, f64)> =
                    with.map(|log| (log.max(0.0), (log - log.max(0.0)).exp(), (-log.max(0.0)).exp())).collect();
                for i in 1..=SHARES {
                    let share = i as f64 / SHARES as f64;
                    let of = |(most, with, without): &(f64, f64, f64)| {
                        most + (share * with + (1.0 - share) * without).max(f64::MIN_POSITIVE).ln()
                    };
                    nodes.push(Node { mean: mean.clone(), spread, share, weight: 0.0 });
                    priors.push(prior);
                    logs.push(prior + with.iter().map(of).sum::<f64>());
                }
            }
        }
        let (weights, evidence) = normalized(&logs);
        nodes.iter_mut().zip(weights).for_each(|(node, weight)| node.weight = weight);
        let members = all.iter().zip(&without).map(|(l, without)| member(l, *without, &nodes)).collect();
        Population { log_bayes_factor: evidence - normalized(&priors).1, nodes, members }
    }

    /// Value and ends of the 95 % interval of something of the nodes.
    fn summary(&self, of: impl Fn(&Node) -> f64) -> [f64; 3] {
        let mut values: Vec<(f64, f64)> = self.nodes.iter().map(|n| (of(n), n.weight)).collect();
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mean = values.iter().map(|(value, weight)| value * weight).sum();
        let quantile = |level: f64| {
            let mut below = 0.0;
            let found = values.iter().find(|(_, weight)| {
                below += weight;
                below >= level
            });
            found.or(values.last()).map_or(f64::NAN, |(value, _)| *value)
        };
        [mean, quantile(0.025), quantile(0.975)]
    }

    /// The mean of an amplitude.
    pub(super) fn mean(&self, amplitude: usize) -> [f64; 3] {
        self.summary(|n| n.mean[amplitude])
    }

    /// The standard deviation over the population.
    pub(super) fn spread(&self) -> [f64; 3] {
        self.summary(|n| n.spread)
    }

    /// The share of the population that has the effect.
    pub(super) fn prevalence(&self) -> [f64; 3] {
        self.summary(|n| n.share)
    }

    /// A participant.
    pub(super) fn member(&self, place: usize) -> &Membership {
        &self.members[place]
    }
}

impl Likelihood {
    /// Taken times the population of those that have the effect.
    fn at(&self, mean: &DVector<f64>, spread: f64) -> Product {
        self.times(mean, spread * spread + self.small * self.small)
    }
}

/// A participant in a population.
fn member(likelihood: &Likelihood, without: f64, nodes: &[Node]) -> Membership {
    let k = likelihood.score.len();
    let (mut probability, mut deviation) = (0.0, vec![0.0; k]);
    let mut first: DVector<f64> = DVector::zeros(k);
    let mut second: DVector<f64> = DVector::zeros(k);
    let alone = likelihood.times(&DVector::zeros(k), 1.0);
    let mut before: Option<(Product, f64)> = None;
    for (i, node) in nodes.iter().enumerate() {
        // Nodes of one mean and spread follow one another.
        if i % SHARES == 0 {
            before = None;
        }
        if node.weight < 1e-12 {
            continue;
        }
        let (found, odds) = before.get_or_insert_with(|| {
            let found = likelihood.at(&node.mean, node.spread);
            let odds = (found.log_mass - without).exp();
            (found, odds)
        });
        let has = node.share * *odds / (node.share * *odds + 1.0 - node.share);
        probability += node.weight * if has.is_finite() { has } else { 1.0 };
        for j in 0..k {
            let (m, v) = (found.mean[j], found.variance[j]);
            first[j] += node.weight * m;
            second[j] += node.weight * (v + m * m);
            let sd = (node.spread * node.spread + likelihood.small * likelihood.small + alone.variance[j]).sqrt();
            deviation[j] += node.weight * (alone.mean[j] - node.mean[j]) / sd.max(f64::MIN_POSITIVE);
        }
    }
    let sizes = (0..k).map(|j| interval(first[j], second[j] - first[j] * first[j])).collect();
    let deviation = deviation.into_iter().fold(0.0, |most: f64, d| if d.abs() > most.abs() { d } else { most });
    Membership { probability, deviation, sizes }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_masses_in_closed_form_are_those_of_the_factorization() {
        let one = Likelihood {
            information: DMatrix::from_element(1, 1, 7.0),
            score: DVector::from_element(1, 2.0),
            small: 0.1,
        };
        let two = Likelihood {
            information: DMatrix::from_row_slice(2, 2, &[7.0, -2.0, -2.0, 3.0]),
            score: DVector::from_vec(vec![2.0, -1.5]),
            small: 0.1,
        };
        for (likelihood, mean) in [(one, vec![0.4]), (two, vec![0.4, -0.2])] {
            let mean = DVector::from_vec(mean);
            for variance in [0.0, 0.3] {
                let expected = likelihood.times(&mean, variance).log_mass;
                assert!((likelihood.log_mass(&mean, variance) - expected).abs() < 1e-12);
            }
        }
    }
}
