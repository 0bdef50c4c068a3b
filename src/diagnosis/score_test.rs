//! Is anything left? Score tests of blocks of directions, with nuisance directions profiled out.
//!
//! ```text
//! s⊥ = s − J (JᵀV⁻¹J + Λ)⁻¹ JᵀV⁻¹ s,   U = Σ_g s⊥_gᵀ V_g⁻¹ r_g,   I = Σ_g s⊥_gᵀ V_g⁻¹ s⊥_g,   T = Uᵀ I⁻¹ U
//! ```
//! All of it follows from the normal matrix of the whitened columns [nuisance | directions | residual]. The smallest of
//! the blocks' p-values is judged against its distribution under the joint normal law of all scores (family-wise) and under
//! sign flips of whole trials' scores, which need no variances.
//!
//! # References
//! Hemerik, Goeman & Finos (2020), Robust testing in generalized linear models by sign flipping score contributions,
//! doi:10.1111/rssb.12369.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Draws of the null distribution of the smallest p-value.
const DRAWS: usize = 2000;
/// Eigenvalues of a block's information below this share of its largest one count as zero.
const RANK_TOLERANCE: f64 = 1e-6;

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

/// Tests blocks of directions.
///
/// - `trials`: normal matrix of every trial
/// - `nuisance`: columns that are profiled out; `precision`: their prior precision; `offset`: distance of their present
///   values from the prior's mean
/// - `residual`: the column of the residual
pub fn omnibus(
    trials: &[DMatrix<f64>],
    nuisance: &[usize],
    precision: &[f64],
    offset: &[f64],
    blocks: &[Block],
    residual: usize,
    seed: u64,
) -> Option<Omnibus> {
    let tested: Vec<usize> = blocks.iter().flat_map(|b| b.columns.iter().copied()).collect();
    let Profiled { carry, step, raw, information, score } =
        profiled(trials, nuisance, precision, offset, &tested, residual)?;
    let at = |matrix: &DMatrix<f64>, rows: &[usize], columns: &[usize]| select(matrix, rows, columns);
    // Contributions of trials.
    let contributions: Vec<DVector<f64>> = trials
        .iter()
        .map(|n| {
            let own = at(n, &tested, &[residual]) - at(n, &tested, nuisance) * &step;
            let through = at(n, nuisance, &[residual]) - at(n, nuisance, nuisance) * &step;
            let u = own - carry.tr_mul(&through);
            DVector::from_column_slice(u.as_slice())
        })
        .collect();
    let mut first = 0;
    let mut solvers = Vec::new();
    let mut results = Vec::new();
    for block in blocks {
        let n = block.columns.len();
        let own = information.view((first, first), (n, n)).into_owned();
        let u = score.view((first, 0), (n, 1)).into_owned();
        let (inverse, rank) = pseudo_inverse(&own);
        let statistic = u.dot(&(&inverse * &u));
        let kept = (0..n).map(|i| own[(i, i)].max(0.0) / raw[(first + i, first + i)].max(1e-300)).fold(0.0, f64::max);
        results.push(BlockScore {
            name: block.name.clone(),
            statistic,
            rank,
            p_value: tail(rank, statistic),
            one_step: DVector::from_column_slice((&inverse * &u).as_slice()),
            information: own,
            kept: kept.sqrt(),
        });
        solvers.push((first, n, inverse, rank));
        first += n;
    }
    let smallest = |u: &DVector<f64>| {
        solvers
            .iter()
            .map(|(first, n, inverse, rank)| {
                let u = u.rows(*first, *n);
                tail(*rank, u.dot(&(inverse * u)))
            })
            .fold(1.0, f64::min)
    };
    let found = results.iter().map(|b| b.p_value).fold(1.0, f64::min);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let root = root(&information);
    let (mut by_law, mut by_flips) = (1, 1);
    for _ in 0..DRAWS {
        let z = DVector::from_fn(root.ncols(), |_, _| normal(&mut rng));
        if smallest(&(&root * z)) <= found {
            by_law += 1;
        }
    }
    for _ in 0..DRAWS {
        let mut u = DVector::zeros(tested.len());
        for contribution in &contributions {
            if rng.random::<bool>() { u += contribution } else { u -= contribution }
        }
        if smallest(&u) <= found {
            by_flips += 1;
        }
    }
    Some(Omnibus {
        blocks: results,
        p_value: f64::from(by_law) / (DRAWS + 1) as f64,
        sign_flip_p_value: f64::from(by_flips) / (DRAWS + 1) as f64,
    })
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
    nuisance: &[usize],
    precision: &[f64],
    offset: &[f64],
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
    nuisance: &[usize],
    precision: &[f64],
    blocks: &[Block],
    products: &DVector<f64>,
) -> f64 {
    let tested: Vec<usize> = blocks.iter().flat_map(|b| b.columns.iter().copied()).collect();
    let Some(Profiled { carry, information, .. }) =
        profiled(trials, nuisance, precision, &vec![0.0; precision.len()], &tested, 0)
    else {
        return 0.0;
    };
    let score = products.select_rows(&tested) - carry.tr_mul(&products.select_rows(nuisance));
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

/// P(χ²_rank > statistic).
pub fn tail(rank: usize, statistic: f64) -> f64 {
    if rank == 0 || !statistic.is_finite() {
        return 1.0;
    }
    if rank == 1 {
        return libm_erfc((0.5 * statistic.max(0.0)).sqrt());
    }
    if rank == 2 {
        return (-0.5 * statistic.max(0.0)).exp();
    }
    ChiSquared::new(rank as f64).map_or(1.0, |law| law.sf(statistic.max(0.0)))
}

fn libm_erfc(x: f64) -> f64 {
    statrs::function::erf::erfc(x)
}

/// A standard normal number (Box–Muller).
pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let u: f64 = rng.random::<f64>().max(1e-300);
    let v: f64 = rng.random();
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

fn pseudo_inverse(matrix: &DMatrix<f64>) -> (DMatrix<f64>, usize) {
    let n = matrix.nrows();
    let eigen = SymmetricEigen::new(matrix.clone());
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

fn root(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = SymmetricEigen::new(matrix.clone());
    let mut out = eigen.eigenvectors;
    for (mut column, value) in out.column_iter_mut().zip(eigen.eigenvalues.iter()) {
        column *= value.max(0.0).sqrt();
    }
    out
}
