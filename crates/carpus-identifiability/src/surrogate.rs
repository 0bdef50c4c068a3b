//! The likelihood near the fit, fast enough for profiles and thousands of draws: each muscle's moment as a polynomial
//! of its own shape parameters.
//!
//! A moment is a sum over muscles, and strength only multiplies a muscle's part. So with Chebyshev polynomials φ of the
//! few shape parameters of each muscle the whitened residual is linear in a(θ) = (1, F₁ φ₁(θ), F₂ φ₂(θ), …):
//!
//! ```text
//! D(θ) = min_b |r(θ, b)|² + |b|² = a(θ)ᵀ M a(θ)
//! ```
//! with one matrix M for all trials. The region is the one that data and bounds leave: a rotated box about the fit.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::descent::Quadratic;
use super::likelihood::Fit;
use super::problem::Problem;
use carpus_numerics::numerics::symmetric_eigen;
use carpus_simulation::simulation::SimulationError;

/// How far the region reaches, in standard deviations of a muscle's parameters given data and bounds.
const REACH: f64 = 4.0;
/// Largest total degree, by number of shape parameters.
const DEGREES: [usize; 5] = [0, 12, 11, 6, 5];
/// Degree for still more parameters.
const LEAST_DEGREE: usize = 4;
/// Beyond the region D rises by the square of the excess times this.
const WALL: f64 = 400.0;
/// Attempts to find a region in which every muscle can be simulated, each with a smaller one.
const ATTEMPTS: usize = 4;

/// One muscle's region and polynomials.
#[derive(Clone, Debug)]
struct Muscle {
    shapes: Vec<usize>,
    strengths: Vec<usize>,
    center: DVector<f64>,
    /// Shape parameters from the region's coordinates, and back.
    from_unit: DMatrix<f64>,
    to_unit: DMatrix<f64>,
    /// Degrees of every product of polynomials.
    terms: Vec<Vec<usize>>,
    /// Position of its first element in a(θ).
    first: usize,
}

/// The likelihood as a function of logarithms of factors.
#[derive(Clone, Debug)]
pub(super) struct Surrogate {
    muscles: Vec<Muscle>,
    matrix: DMatrix<f64>,
    n: usize,
}

impl Surrogate {
    /// About a fit.
    ///
    /// # Errors
    /// Trials that cannot be simulated near the fit.
    pub(super) fn new(problem: &Problem, fit: &Fit) -> Result<Surrogate, SimulationError> {
        let mut reach = REACH;
        for _ in 1..ATTEMPTS {
            if let Ok(surrogate) = Self::within(problem, fit, reach) {
                return Ok(surrogate);
            }
            reach *= 0.6;
        }
        Self::within(problem, fit, reach)
    }

    fn within(problem: &Problem, fit: &Fit, reach: f64) -> Result<Surrogate, SimulationError> {
        let layout = &problem.layout;
        let n = layout.len();
        let covariance = region(problem, fit);
        let mut first = 1;
        let muscles: Vec<Muscle> = (0..problem.n_muscles())
            .map(|m| {
                let shapes = layout.shapes[m].clone();
                let p = shapes.len();
                let local = DMatrix::from_fn(p, p, |i, j| covariance[(shapes[i], shapes[j])]);
                let at = DVector::from_fn(p, |i, _| fit.at[shapes[i]]);
                let bounds: Vec<[f64; 2]> = shapes.iter().map(|i| layout.free[*i].log_bounds()).collect();
                let (center, axes) = smallest_box(&at, local, &bounds, reach);
                let degree = DEGREES.get(p).copied().unwrap_or(LEAST_DEGREE);
                let terms = terms(p, degree);
                let muscle = Muscle {
                    center,
                    shapes,
                    strengths: layout.strengths[m].clone(),
                    to_unit: axes.clone().try_inverse().unwrap_or_else(|| DMatrix::identity(p, p)),
                    from_unit: axes,
                    terms,
                    first,
                };
                first += muscle.terms.len();
                muscle
            })
            .collect();
        let size = first;
        let mut surrogate = Surrogate { muscles, matrix: DMatrix::zeros(size, size), n };
        surrogate.matrix = surrogate.gram(problem, fit, size)?;
        Ok(surrogate)
    }

    /// Simulates every muscle at its nodes, and sums products of whitened columns over trials.
    fn gram(&self, problem: &Problem, fit: &Fit, size: usize) -> Result<DMatrix<f64>, SimulationError> {
        let nodes: Vec<Vec<Vec<f64>>> = self.muscles.iter().map(|m| nodes(m.shapes.len(), m.terms.len())).collect();
        let projections: Vec<DMatrix<f64>> = self
            .muscles
            .iter()
            .zip(&nodes)
            .map(|(m, nodes)| {
                let values = DMatrix::from_fn(nodes.len(), m.terms.len(), |s, t| product(&m.terms[t], &nodes[s]));
                values.pseudo_inverse(1e-12).expect("a tolerance above 0")
            })
            .collect();
        let local = |m: usize, s: usize| -> Vec<f64> {
            let muscle = &self.muscles[m];
            let s = s.min(nodes[m].len() - 1);
            (&muscle.center + &muscle.from_unit * DVector::from_column_slice(&nodes[m][s])).iter().copied().collect()
        };
        let most = nodes.iter().map(Vec::len).max().unwrap_or(0);
        // Curves, damping and activation of all muscles change together, node by node.
        let variants = problem
            .layout
            .changes_model()
            .then(|| {
                (0..most)
                    .map(|s| {
                        problem.model_with(&|m, i| {
                            let of = local(m, s);
                            self.muscles[m].shapes.iter().position(|k| *k == i).map_or(0.0, |k| of[k])
                        })
                    })
                    .collect::<Result<Vec<_>, _>>()
            })
            .transpose()?;
        let n_muscles = self.muscles.len();
        let per_trial: Vec<Result<(DMatrix<f64>, DMatrix<f64>, DMatrix<f64>), SimulationError>> = fit
            .held
            .trials
            .par_iter()
            .zip(&problem.trials)
            .map(|(held, trial)| {
                let rows = held.target.len();
                let mut at_nodes: Vec<DMatrix<f64>> = nodes.iter().map(|n| DMatrix::zeros(rows, n.len())).collect();
                for s in 0..most {
                    let own = match &variants {
                        Some(models) => Some(problem.prepare(&models[s], trial, held)?),
                        None => None,
                    };
                    for m in 0..n_muscles {
                        if s >= nodes[m].len() {
                            continue;
                        }
                        let (of, shapes) = (local(m, s), &self.muscles[m].shapes);
                        let value = |i: usize| shapes.iter().position(|k| *k == i).map_or(0.0, |k| of[k]);
                        let parameters = problem.layout.parameters(m, &problem.nominal[m], &value);
                        let force = held.expected_force(own.as_deref(), m, &parameters)?;
                        let moment = trial.moments_of(m, &force, &held.starts) * problem.nominal[m].max_isometric_force;
                        at_nodes[m].set_column(s, &moment);
                    }
                }
                let mut columns = DMatrix::zeros(rows, size);
                columns.set_column(0, &held.target);
                for (m, muscle) in self.muscles.iter().enumerate() {
                    let coefficients = -(&at_nodes[m] * projections[m].transpose());
                    columns.columns_mut(muscle.first, muscle.terms.len()).copy_from(&coefficients);
                }
                let x = held.whiten(&columns);
                let b = held.whiten(&held.baselines);
                Ok((x.tr_mul(&x), b.tr_mul(&x), b.tr_mul(&b)))
            })
            .collect();
        let mut matrix = DMatrix::zeros(size, size);
        let mut cross = DMatrix::zeros(n_muscles, size);
        let mut baselines = DMatrix::identity(n_muscles, n_muscles);
        for part in per_trial {
            let (x, c, b) = part?;
            matrix += x;
            cross += c;
            baselines += b;
        }
        // The baselines are linear with a normal prior: what they explain is taken out.
        if let Some(factor) = baselines.cholesky() {
            let explained = factor.solve(&cross);
            matrix -= cross.tr_mul(&explained);
        }
        Ok(matrix)
    }

    /// D and its derivatives at logarithms of factors. Beyond the region, a wall.
    pub(super) fn evaluate(&self, theta: &[f64], information: bool) -> Quadratic {
        let size = self.matrix.nrows();
        let mut a = DVector::zeros(size);
        a[0] = 1.0;
        // Per muscle: parameters and the derivatives of its part of a by them.
        let mut slopes: Vec<(usize, usize, DMatrix<f64>, Vec<usize>)> = Vec::with_capacity(self.muscles.len());
        let mut wall =
            Quadratic { value: 0.0, gradient: DVector::zeros(self.n), information: DMatrix::zeros(self.n, self.n) };
        for muscle in &self.muscles {
            let p = muscle.shapes.len();
            let strength = muscle.strengths.iter().map(|i| theta[*i]).sum::<f64>().exp();
            let offset = DVector::from_fn(p, |k, _| theta[muscle.shapes[k]] - muscle.center[k]);
            let mut unit = &muscle.to_unit * offset;
            for k in 0..p {
                let excess = unit[k].abs() - 1.0;
                if excess > 0.0 {
                    wall.value += WALL * excess * excess;
                    let row: Vec<f64> = (0..p).map(|j| muscle.to_unit[(k, j)] * unit[k].signum()).collect();
                    for (j, i) in muscle.shapes.iter().enumerate() {
                        wall.gradient[*i] += WALL * excess * row[j];
                        for (l, o) in muscle.shapes.iter().enumerate() {
                            wall.information[(*i, *o)] += WALL * row[j] * row[l];
                        }
                    }
                    unit[k] = unit[k].signum();
                }
            }
            let degree = muscle.terms.iter().flatten().copied().max().unwrap_or(0);
            let polynomials: Vec<(Vec<f64>, Vec<f64>)> = unit.iter().map(|x| chebyshev(*x, degree)).collect();
            let count = muscle.terms.len();
            let mut by_unit = DMatrix::zeros(count, p);
            for (t, term) in muscle.terms.iter().enumerate() {
                let mut value = strength;
                for (k, d) in term.iter().enumerate() {
                    value *= polynomials[k].0[*d];
                }
                a[muscle.first + t] = value;
                for k in 0..p {
                    let mut slope = strength * polynomials[k].1[term[k]];
                    for (j, d) in term.iter().enumerate() {
                        if j != k {
                            slope *= polynomials[j].0[*d];
                        }
                    }
                    by_unit[(t, k)] = slope;
                }
            }
            let mut by = DMatrix::zeros(count, p + muscle.strengths.len());
            by.columns_mut(0, p).copy_from(&(by_unit * &muscle.to_unit));
            for k in 0..muscle.strengths.len() {
                by.column_mut(p + k).copy_from(&a.rows(muscle.first, count));
            }
            let owners: Vec<usize> = muscle.shapes.iter().chain(&muscle.strengths).copied().collect();
            slopes.push((muscle.first, count, by, owners));
        }
        let weighted = &self.matrix * &a;
        let mut out = wall;
        out.value += a.dot(&weighted).max(0.0);
        for (first, count, by, owners) in &slopes {
            let gradient = by.tr_mul(&weighted.rows(*first, *count));
            owners.iter().zip(gradient.iter()).for_each(|(i, g)| out.gradient[*i] += g);
        }
        if information {
            for (first, count, by, owners) in &slopes {
                for (other_first, other_count, other_by, other_owners) in &slopes {
                    let block = self.matrix.view((*first, *other_first), (*count, *other_count));
                    let product = by.tr_mul(&(block * other_by));
                    for (r, i) in owners.iter().enumerate() {
                        for (c, j) in other_owners.iter().enumerate() {
                            out.information[(*i, *j)] += product[(r, c)];
                        }
                    }
                }
            }
        }
        out
    }

    /// Whether a point lies within the region.
    pub(super) fn covers(&self, theta: &[f64]) -> bool {
        self.muscles.iter().all(|m| {
            let offset = DVector::from_fn(m.shapes.len(), |k, _| theta[m.shapes[k]] - m.center[k]);
            (&m.to_unit * offset).iter().all(|u| u.abs() <= 1.0)
        })
    }
}

/// Covariance of the parameters given data and bounds, which a parameter fills evenly if the data say nothing of it.
fn region(problem: &Problem, fit: &Fit) -> DMatrix<f64> {
    let n = problem.layout.len();
    let mut information = &fit.information / fit.dispersion;
    for (i, p) in problem.layout.free.iter().enumerate() {
        let [lower, upper] = p.log_bounds();
        let sd = (upper - lower) / 12f64.sqrt();
        information[(i, i)] += 1.0 / (sd * sd);
    }
    information.try_inverse().map_or_else(
        || DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| problem.layout.free[i].prior.log_sd.powi(2))),
        |c| c.view((0, 0), (n, n)).into_owned(),
    )
}

/// Centre and half axes (columns) of the smaller of two boxes that hold what data and bounds leave: along the principal
/// axes of the covariance, or along the parameters and within their bounds.
fn smallest_box(
    at: &DVector<f64>,
    covariance: DMatrix<f64>,
    bounds: &[[f64; 2]],
    reach: f64,
) -> (DVector<f64>, DMatrix<f64>) {
    let p = at.len();
    if p == 0 {
        // Only forces are asked for: nothing is nonlinear.
        return (at.clone(), covariance);
    }
    let ends: Vec<[f64; 2]> = (0..p)
        .map(|i| {
            let half = reach * covariance[(i, i)].max(1e-12).sqrt();
            [(at[i] - half).max(bounds[i][0]), (at[i] + half).min(bounds[i][1])]
        })
        .collect();
    let eigen = symmetric_eigen(covariance);
    let lengths = eigen.eigenvalues.map(|v| reach * v.max(1e-12).sqrt());
    let along: f64 = ends.iter().map(|[a, b]| 0.5 * (b - a)).product();
    if lengths.product() < along {
        return (at.clone(), &eigen.eigenvectors * DMatrix::from_diagonal(&lengths));
    }
    let center = DVector::from_fn(p, |i, _| 0.5 * (ends[i][0] + ends[i][1]));
    // A little wider, so that the bounds themselves lie inside.
    let half = DVector::from_fn(p, |i, _| (0.5 * (ends[i][1] - ends[i][0]) * 1.001).max(1e-6));
    (center, DMatrix::from_diagonal(&half))
}

/// All products of polynomials of `p` variables up to a total degree.
fn terms(p: usize, degree: usize) -> Vec<Vec<usize>> {
    let mut out = vec![Vec::new()];
    for _ in 0..p {
        out = out
            .into_iter()
            .flat_map(|term: Vec<usize>| {
                let used: usize = term.iter().sum();
                (0..=degree - used).map(move |d| {
                    let mut term = term.clone();
                    term.push(d);
                    term
                })
            })
            .collect();
    }
    out
}

/// Points to fit polynomials at: dense towards the sides of the box, where polynomials go astray first.
fn nodes(p: usize, terms: usize) -> Vec<Vec<f64>> {
    let cosine = |u: f64| (std::f64::consts::PI * u).cos();
    if p == 0 {
        return vec![Vec::new()];
    }
    if p <= 2 {
        let side = if p == 1 { terms + 2 } else { DEGREES[2] + 1 };
        let at = |i: usize| cosine((i as f64 + 0.5) / side as f64);
        return if p == 1 {
            (0..side).map(|i| vec![at(i)]).collect()
        } else {
            (0..side * side).map(|i| vec![at(i / side), at(i % side)]).collect()
        };
    }
    const PRIMES: [usize; 9] = [2, 3, 5, 7, 11, 13, 17, 19, 23];
    (1..=5 * terms / 2).map(|s| (0..p).map(|k| cosine(radical_inverse(s, PRIMES[k % 9]))).collect()).collect()
}

/// Halton's sequence.
fn radical_inverse(mut i: usize, base: usize) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0 / base as f64);
    while i > 0 {
        value += digit * (i % base) as f64;
        i /= base;
        digit /= base as f64;
    }
    value
}

fn product(term: &[usize], unit: &[f64]) -> f64 {
    term.iter().zip(unit).map(|(d, x)| (*d as f64 * x.clamp(-1.0, 1.0).acos()).cos()).product()
}

/// Chebyshev polynomials up to a degree, and their slopes.
fn chebyshev(x: f64, degree: usize) -> (Vec<f64>, Vec<f64>) {
    let (mut value, mut slope) = (vec![1.0; degree + 1], vec![0.0; degree + 1]);
    for d in 1..=degree {
        if d == 1 {
            (value[1], slope[1]) = (x, 1.0);
        } else {
            value[d] = 2.0 * x * value[d - 1] - value[d - 2];
            slope[d] = 2.0 * value[d - 1] + 2.0 * x * slope[d - 1] - slope[d - 2];
        }
    }
    (value, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_polynomials_reproduce_a_smooth_function_and_its_slope() {
        let terms = terms(2, DEGREES[2]);
        let nodes = nodes(2, terms.len());
        let f = |x: f64, y: f64| (0.7 * x - 0.4 * y).exp() * (1.0 + 0.2 * x * y);
        let matrix = DMatrix::from_fn(nodes.len(), terms.len(), |s, t| product(&terms[t], &nodes[s]));
        let values = DVector::from_fn(nodes.len(), |s, _| f(nodes[s][0], nodes[s][1]));
        let c = matrix.pseudo_inverse(1e-12).unwrap() * values;
        let at = |x: f64, y: f64| -> f64 { terms.iter().zip(c.iter()).map(|(t, c)| c * product(t, &[x, y])).sum() };
        for (x, y) in [(0.3, -0.9), (0.99, 0.2), (-0.5, 0.5)] {
            assert!((at(x, y) - f(x, y)).abs() < 1e-8);
        }
        let (_, slope) = chebyshev(0.37, 6);
        let (up, down) = (chebyshev(0.37 + 1e-6, 6).0, chebyshev(0.37 - 1e-6, 6).0);
        for d in 0..=6 {
            assert!((slope[d] - (up[d] - down[d]) / 2e-6).abs() < 1e-7);
        }
        assert_eq!(terms.len(), 78);
    }
}
