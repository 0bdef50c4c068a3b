//! Is anything left? Score tests of blocks of directions, with nuisance directions profiled out.
//!
//! ```text
//! s⊥ = s − J (JᵀV⁻¹J + Λ)⁻¹ JᵀV⁻¹ s,   U = Σ_g s⊥_gᵀ V_g⁻¹ r_g,   I = Σ_g s⊥_gᵀ V_g⁻¹ s⊥_g,   T = Uᵀ I⁻¹ U
//! ```
//! All of it follows from the normal matrix of the whitened columns [nuisance | directions | residual]. The smallest of
//! the blocks' p-values is judged against its distribution under the joint law of all scores (family-wise) and under
//! sign flips of whole trials' scores, which need no variances.
//!
//! The variances in V are estimates. What a score's variance would be with others is known, I = Σ_k σ_k² I_k, so that T
//! / rank is judged by F with Satterthwaite's degrees of freedom, and the joint law is a mixture over the variances'
//! logarithms:
//!
//! ```text
//! ν = 2 / (gᵀ S g),   g_k = σ_k² tr(I⁻¹ I_k) / rank,   U = Σ_k exp(δ_k / 2) (σ_k² I_k)^½ z_k,   δ ~ N(0, S)
//! ```
//! Of a variance near 0 (white noise of a torque that was filtered) the data say how large it may be at most, and
//! nothing of its logarithm: where S_kk > 1 the variance itself is taken as normal, not below 0, max(0, 1 + δ_k) in
//! place of exp(δ_k).
//!
//! # References
//! Hemerik, Goeman & Finos (2020), Robust testing in generalized linear models by sign flipping score contributions,
//! doi:10.1111/rssb.12369. Giesbrecht & Burns (1985), doi:10.2307/2530872 (degrees of freedom in mixed models).

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};

use carpus_effects::random::normal;
use carpus_numerics::numerics::{symmetric_eigen, symmetric_root};

/// Draws of the null distribution of the smallest p-value.
const DRAWS: usize = 2000;
/// Eigenvalues of a block's information below this share of its largest one count as zero.
const RANK_TOLERANCE: f64 = 1e-6;

/// Words of the random stream that a normal number takes: two of two each.
const WORDS_OF_NORMAL: usize = 4;
/// Variance of a variance's logarithm beyond which it is the variance that is taken as normal.
const UNKNOWN_LOGARITHM: f64 = 1.0;
/// More degrees of freedom than this are as good as infinitely many.
const MANY: f64 = 1e5;

/// Columns that are profiled out.
pub struct Nuisance<'a> {
    /// In the normal matrix.
    pub columns: &'a [usize],
    /// Prior precision.
    pub precision: &'a [f64],
    /// Distance of their present values from the prior's mean.
    pub offset: &'a [f64],
}

/// What estimated variances do to scores.
pub struct Variances<'a> {
    /// Per variance: `σ_k² Xᵀ V⁻¹ V_k V⁻¹ X`, all trials; columns as in the normal matrix.
    pub products: &'a [DMatrix<f64>],
    /// Covariance of the variances' logarithms.
    pub spread: &'a DMatrix<f64>,
}

/// Directions that are tested together.
#[derive(Clone, Debug)]
pub struct Block {
    /// Name.
    pub name: String,
    /// Columns in the normal matrix.
    pub columns: Vec<usize>,
}

/// Result for one block.
#[derive(Clone, Debug)]
pub struct BlockScore {
    /// Name.
    pub name: String,
    /// T.
    pub statistic: f64,
    /// Degrees of freedom.
    pub rank: usize,
    /// Degrees of freedom of the variances in it.
    pub freedom: f64,
    /// p-value of this block alone.
    pub p_value: f64,
    /// One-step estimate I⁻¹U, in units of the columns.
    pub one_step: DVector<f64>,
    /// I.
    pub information: DMatrix<f64>,
    /// Share of the directions' length that the nuisance does not explain.
    pub kept: f64,
}

/// Result for all blocks.
#[derive(Clone, Debug)]
pub struct Omnibus {
    /// Every block.
    pub blocks: Vec<BlockScore>,
    /// Family-wise p-value of the smallest p-value, by the normal law.
    pub p_value: f64,
    /// The same by sign flips of whole trials.
    pub sign_flip_p_value: f64,
}

/// Every block tested by itself, and what a test of all of them together needs.
pub struct Tested {
    /// Every block.
    pub blocks: Vec<BlockScore>,
    solvers: Vec<Solver>,
    information: DMatrix<f64>,
    parts: Vec<DMatrix<f64>>,
    /// Covariance of the variances' logarithms.
    spread: DMatrix<f64>,
    contributions: Vec<DVector<f64>>,
}

/// Of one block.
struct Solver {
    /// Its first column among those of all blocks.
    first: usize,
    inverse: DMatrix<f64>,
    rank: usize,
    freedom: f64,
}

/// Tests blocks of directions, each by itself.
///
/// - `trials`: normal matrix of every trial
/// - `residual`: the column of the residual
pub fn tested(
    trials: &[DMatrix<f64>],
    nuisance: &Nuisance,
    variances: &Variances,
    blocks: &[Block],
    residual: usize,
) -> Option<Tested> {
    let columns: Vec<usize> = blocks.iter().flat_map(|b| b.columns.iter().copied()).collect();
    let profiled = profiled(trials, nuisance, &columns, residual)?;
    let contributions = contributions(trials, nuisance, &columns, residual, &profiled);
    let parts: Vec<DMatrix<f64>> =
        variances.products.iter().map(|all| of_directions(all, nuisance.columns, &columns, &profiled.carry)).collect();
    let Profiled { raw, information, score, .. } = profiled;
    let mut first = 0;
    let mut solvers = Vec::new();
    let mut results = Vec::new();
    for block in blocks {
        let n = block.columns.len();
        let own = information.view((first, first), (n, n)).into_owned();
        let u = score.view((first, 0), (n, 1)).into_owned();
        let (inverse, rank) = pseudo_inverse(&own);
        let statistic = u.dot(&(&inverse * &u));
        let shares = parts.iter().map(|all| inverse.dot(&all.view((first, first), (n, n))) / rank.max(1) as f64);
        let shares = DVector::from_iterator(parts.len(), shares);
        let freedom = 2.0 / shares.dot(&(variances.spread * &shares)).max(1.0 / MANY);
        let kept = (0..n).map(|i| own[(i, i)].max(0.0) / raw[(first + i, first + i)].max(1e-300)).fold(0.0, f64::max);
        results.push(BlockScore {
            name: block.name.clone(),
            statistic,
            rank,
            freedom,
            p_value: tail(rank, freedom, statistic),
            one_step: DVector::from_column_slice((&inverse * &u).as_slice()),
            information: own,
            kept: kept.sqrt(),
        });
        solvers.push(Solver { first, inverse, rank, freedom });
        first += n;
    }
    Some(Tested { blocks: results, solvers, information, parts, spread: variances.spread.clone(), contributions })
}

impl Tested {
    /// Tests all blocks together.
    pub fn omnibus(self, seed: u64) -> Omnibus {
        let Tested { blocks, solvers, information, parts, spread, contributions } = self;
        let found = blocks.iter().map(|b| b.p_value).fold(1.0, f64::min);
        let critical: Vec<f64> = solvers.iter().map(|s| quantile(s.rank, s.freedom, found)).collect();
        // Whether any block of these scores has as small a p-value.
        let as_small = |u: &DVector<f64>| {
            solvers.iter().zip(&critical).any(|(Solver { first, inverse, .. }, critical)| {
                let u = u.rows(*first, inverse.nrows());
                u.dot(&(inverse * u)) >= *critical
            })
        };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let law = Law::new(&information, &parts, &spread);
        // The same numbers as one after another, drawn side by side.
        let length = law.numbers() * WORDS_OF_NORMAL;
        let drawn = |draw: &usize| {
            let mut rng = rng.clone();
            rng.set_word_pos((draw * length) as u128);
            as_small(&law.draw(&mut rng))
        };
        let by_law = (0..DRAWS).into_par_iter().filter(drawn).count();
        rng.set_word_pos((DRAWS * length) as u128);
        let flips: Vec<Vec<bool>> = (0..DRAWS).map(|_| contributions.iter().map(|_| rng.random()).collect()).collect();
        let flipped = |flips: &Vec<bool>| {
            let nothing = DVector::zeros(information.nrows());
            contributions.iter().zip(flips).fold(nothing, |u, (c, up)| if *up { u + c } else { u - c })
        };
        let by_flips = flips.par_iter().filter(|flips| as_small(&flipped(flips))).count();
        let share = |count: usize| (count + 1) as f64 / (DRAWS + 1) as f64;
        Omnibus { blocks, p_value: share(by_law), sign_flip_p_value: share(by_flips) }
    }
}

/// What every trial, and everything that is known of the nuisance, contributes to the scores.
fn contributions(
    trials: &[DMatrix<f64>],
    Nuisance { columns: nuisance, precision, offset }: &Nuisance,
    tested: &[usize],
    residual: usize,
    Profiled { carry, step, .. }: &Profiled,
) -> Vec<DVector<f64>> {
    let of_trial = |n: &DMatrix<f64>| {
        let own = select(n, tested, &[residual]) - select(n, tested, nuisance) * step;
        let through = select(n, nuisance, &[residual]) - select(n, nuisance, nuisance) * step;
        (own - carry.tr_mul(&through)).column(0).into_owned()
    };
    // What is known of the nuisance beforehand are observations, too, one of each: with them the contributions add up
    // to U.
    let known = (0..step.len()).filter(|i| precision[*i] > 0.0);
    let of_known = known.map(|i| carry.row(i).transpose() * (precision[i] * (step[i] + offset[i])));
    trials.iter().map(of_trial).chain(of_known).collect()
}

/// A matrix of products of all columns, as that of directions from which the nuisance is taken.
fn of_directions(all: &DMatrix<f64>, nuisance: &[usize], tested: &[usize], carry: &DMatrix<f64>) -> DMatrix<f64> {
    let cross = select(all, nuisance, tested);
    let own = select(all, tested, tested) - cross.tr_mul(carry) - carry.tr_mul(&cross);
    own + carry.tr_mul(&(select(all, nuisance, nuisance) * carry))
}

/// Joint law of the scores where nothing is missing.
struct Law {
    /// Roots of what the variances contribute to the scores' covariance.
    parts: Vec<DMatrix<f64>>,
    /// Root of what is known.
    known: DMatrix<f64>,
    /// Root of the covariance of the variances' logarithms.
    spread: DMatrix<f64>,
    /// Variances that are near 0 as far as is known.
    near_zero: Vec<bool>,
}

impl Law {
    /// - `information`: covariance of the scores; `parts`: of it, what each variance contributes
    /// - `spread`: covariance of the variances' logarithms
    fn new(information: &DMatrix<f64>, parts: &[DMatrix<f64>], spread: &DMatrix<f64>) -> Law {
        let known = parts.iter().fold(information.clone(), |rest, part| rest - part);
        Law {
            parts: parts.par_iter().map(symmetric_root).collect(),
            known: symmetric_root(&known),
            spread: symmetric_root(spread),
            near_zero: spread.diagonal().iter().map(|v| *v > UNKNOWN_LOGARITHM).collect(),
        }
    }

    /// Normal numbers that a draw takes.
    fn numbers(&self) -> usize {
        self.spread.ncols() + self.known.ncols() + self.parts.iter().map(DMatrix::ncols).sum::<usize>()
    }

    fn draw(&self, rng: &mut ChaCha8Rng) -> DVector<f64> {
        let mut standard = |n: usize| DVector::from_fn(n, |_, _| normal(rng));
        let logarithms = &self.spread * standard(self.spread.ncols());
        let mut u = &self.known * standard(self.known.ncols());
        for ((root, log), near_zero) in self.parts.iter().zip(logarithms.iter()).zip(&self.near_zero) {
            let sd = if *near_zero { (1.0 + log).max(0.0).sqrt() } else { (0.5 * log).exp() };
            u.gemv(sd, root, &standard(root.ncols()), 1.0);
        }
        u
    }
}

/// Scores with nuisance profiled out.
struct Profiled {
    /// (JᵀAJ + Λ)⁻¹ JᵀAS.
    carry: DMatrix<f64>,
    /// Step of the nuisance that the residual asks for.
    step: DVector<f64>,
    /// Information of the directions as they are, and with nuisance profiled out.
    raw: DMatrix<f64>,
    information: DMatrix<f64>,
    /// U.
    score: DVector<f64>,
}

fn select(matrix: &DMatrix<f64>, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, j| matrix[(rows[i], columns[j])])
}

fn profiled(
    trials: &[DMatrix<f64>],
    Nuisance { columns: nuisance, precision, offset }: &Nuisance,
    tested: &[usize],
    residual: usize,
) -> Option<Profiled> {
    let mut total = trials.first()?.clone();
    trials[1..].iter().for_each(|n| total += n);
    let prior = DMatrix::from_diagonal(&DVector::from_column_slice(precision));
    let inner = (select(&total, nuisance, nuisance) + &prior).cholesky()?;
    let cross = select(&total, nuisance, tested);
    let column = |rows: &[usize]| DVector::from_fn(rows.len(), |i, _| total[(rows[i], residual)]);
    let pull = column(nuisance) - &prior * DVector::from_column_slice(offset);
    let carry = inner.solve(&cross);
    let step = inner.solve(&pull);
    let raw = select(&total, tested, tested);
    let information = &raw - cross.tr_mul(&carry);
    let score = column(tested) - cross.tr_mul(&step);
    Some(Profiled { carry, step, raw, information, score })
}

/// The largest T of any block, were these the residual's products with all columns.
///
/// - `products`: in place of the residual's column, summed over trials
pub fn largest_statistic(
    trials: &[DMatrix<f64>],
    nuisance: &Nuisance,
    blocks: &[Block],
    products: &DVector<f64>,
) -> f64 {
    let tested: Vec<usize> = blocks.iter().flat_map(|b| b.columns.iter().copied()).collect();
    let Some(Profiled { carry, information, .. }) = profiled(trials, nuisance, &tested, 0) else {
        return 0.0;
    };
    let score = products.select_rows(&tested) - carry.tr_mul(&products.select_rows(nuisance.columns));
    let mut first = 0;
    let mut largest = 0.0_f64;
    for block in blocks {
        let n = block.columns.len();
        let (inverse, _) = pseudo_inverse(&information.view((first, first), (n, n)).into_owned());
        let own = score.rows(first, n);
        largest = largest.max(own.dot(&(inverse * own)));
        first += n;
    }
    largest
}

/// P(rank F > statistic), F with `rank` and `freedom` degrees of freedom.
pub fn tail(rank: usize, freedom: f64, statistic: f64) -> f64 {
    if rank == 0 || !statistic.is_finite() {
        return 1.0;
    }
    let statistic = statistic.max(0.0);
    if freedom < MANY {
        return FisherSnedecor::new(rank as f64, freedom).map_or(1.0, |law| law.sf(statistic / rank as f64));
    }
    match rank {
        1 => libm_erfc((0.5 * statistic).sqrt()),
        2 => (-0.5 * statistic).exp(),
        _ => ChiSquared::new(rank as f64).map_or(1.0, |law| law.sf(statistic)),
    }
}

/// The statistic of which [`tail`] is `p_value`, or just below it.
fn quantile(rank: usize, freedom: f64, p_value: f64) -> f64 {
    if rank == 0 {
        return f64::INFINITY;
    }
    let (mut low, mut high) = (0.0, 1.0);
    while tail(rank, freedom, high) > p_value && high < 1e12 {
        (low, high) = (high, 2.0 * high);
    }
    while high - low > 1e-10 * high {
        let middle = 0.5 * (low + high);
        if tail(rank, freedom, middle) > p_value { low = middle } else { high = middle }
    }
    low
}

fn libm_erfc(x: f64) -> f64 {
    statrs::function::erf::erfc(x)
}

fn pseudo_inverse(matrix: &DMatrix<f64>) -> (DMatrix<f64>, usize) {
    let n = matrix.nrows();
    let eigen = symmetric_eigen(matrix.clone());
    let largest = eigen.eigenvalues.max().max(0.0);
    let mut out = DMatrix::zeros(n, n);
    let mut rank = 0;
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > RANK_TOLERANCE * largest && *value > 1e-9 {
            out += vector * vector.transpose() / *value;
            rank += 1;
        }
    }
    (out, rank)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_tails_are_those_of_tables() {
        // t, 10 degrees of freedom: 2.228 at 5 %; F(3, 20): 3.098 at 5 %; chi-square, 3: 7.815 at 5 %.
        for (rank, freedom, statistic) in
            [(1, 10.0, 2.228_f64.powi(2)), (3, 20.0, 3.0 * 3.098), (3, f64::INFINITY, 7.815), (1, 1e9, 3.841)]
        {
            let p = tail(rank, freedom, statistic);
            assert!((p - 0.05).abs() < 1e-4, "{rank} {freedom}: {p}");
            assert!((quantile(rank, freedom, p) / statistic - 1.0).abs() < 1e-8);
        }
    }

    /// Trials with one direction each and noise of unknown variance, which is estimated from as many residuals.
    #[test]
    fn verif_false_alarms_are_as_frequent_as_said_where_the_variance_is_an_estimate() {
        let freedom = 12;
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let nobody = Nuisance { columns: &[], precision: &[], offset: &[] };
        let blocks: Vec<Block> = (0..4).map(|i| Block { name: i.to_string(), columns: vec![i] }).collect();
        let sets = 600;
        let mut alarms = [0, 0];
        for seed in 0..sets {
            let variance = (0..freedom).map(|_| normal(&mut rng).powi(2)).sum::<f64>() / f64::from(freedom);
            // Directions of unit length, whitened by the estimate; the last column is the residual.
            let trials: Vec<DMatrix<f64>> = (0..4)
                .map(|i| {
                    let mut x = DVector::zeros(5);
                    (x[i], x[4]) = (1.0 / variance.sqrt(), normal(&mut rng) / variance.sqrt());
                    &x * x.transpose()
                })
                .collect();
            let products = [DMatrix::from_fn(5, 5, |i, j| if i == j && i < 4 { 1.0 / variance } else { 0.0 })];
            for (spread, alarms) in [0.0, 2.0 / f64::from(freedom)].into_iter().zip(&mut alarms) {
                let variances = Variances { products: &products, spread: &DMatrix::from_element(1, 1, spread) };
                let found = tested(&trials, &nobody, &variances, &blocks, 4).expect("no nuisance to fail at");
                let found = found.omnibus(seed);
                *alarms += usize::from(found.p_value <= 0.05);
            }
        }
        // As if known: about 10 %.
        let share = |alarms: usize| alarms as f64 / sets as f64;
        assert!(share(alarms[0]) > 0.08, "{alarms:?}");
        assert!((share(alarms[1]) - 0.05).abs() < 0.02, "{alarms:?}");
    }

    /// Torque that was filtered has no white noise: that its variance is 1e-6 or 1e-9 of the whole, nobody can say, and
    /// it matters to no score.
    #[test]
    fn verif_a_variance_near_zero_does_not_hide_what_is_missing() {
        let nobody = Nuisance { columns: &[], precision: &[], offset: &[] };
        let blocks = [Block { name: "a".into(), columns: vec![0] }];
        // A score of 6 standard deviations.
        let trial = DMatrix::from_row_slice(2, 2, &[1.0, 6.0, 6.0, 36.0]);
        let of = |share: f64| DMatrix::from_row_slice(2, 2, &[share, 0.0, 0.0, 0.0]);
        let products = [of(1e-6), of(1.0 - 1e-6)];
        for unknown in [1e2, 1e4, 1e7] {
            let spread = DMatrix::from_diagonal(&DVector::from_column_slice(&[unknown, 0.02]));
            let variances = Variances { products: &products, spread: &spread };
            let found =
                tested(std::slice::from_ref(&trial), &nobody, &variances, &blocks, 1).expect("nothing to fail at");
            assert!(found.blocks[0].p_value < 1e-5);
            let found = found.omnibus(7);
            assert!(found.p_value < 0.005, "spread {unknown}: p {}", found.p_value);
        }
    }
}
