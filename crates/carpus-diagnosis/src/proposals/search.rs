//! Which terms are selected, and how much they explain: equations (1) and (2) of [`super`].

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::library::{Term, WAVES};
use super::proposal::{Proposal, ProposedTerm, short};
use super::trial_table::TrialTable;

/// Terms of a formula, at most: more are no short formula.
pub(super) const MOST_TERMS: usize = 3;
/// A further term must explain this much more of the mean square in left-out trials.
pub(super) const WORTH_A_TERM: f64 = 0.02;
/// Halves of the trials in which a term is looked for.
const HALVES: usize = 40;
/// Share of the halves in which a term, or one that looks like it, must be selected.
const STABLE: f64 = 0.6;
/// Terms whose correlation is larger look alike.
const ALIKE: f64 = 0.9;
/// Draws of the signs of whole trials; a formula must explain more than a term does in any of them: a level of 1/40.
const SIGN_DRAWS: usize = 39;
/// Steps of the search for a wave number between its neighbours.
const REFINEMENTS: usize = 30;
/// Columns shorter than this, relative to the longest, are not told from a constant.
const NOTHING: f64 = 1e-9;

/// Sums over one trial of whitened columns: X'X, the intercept first, the residual last.
pub(super) type Gram = DMatrix<f64>;

/// The library over the trials.
#[derive(Clone)]
pub(super) struct Search {
    pub(super) library: Vec<Term>,
    /// Columns before the first term: the intercept and those that are fitted beside.
    pub(super) first: usize,
    /// Whitened values of all trials.
    pub(super) rows: f64,
    pub(super) grams: Vec<Gram>,
    pub(super) total: Gram,
    /// The same without what the columns before the first term have of it.
    pub(super) beyond: Gram,
    /// Sum over all trials of one whitened column, squared: columns are of length 1 over all.
    pub(super) scales: Vec<f64>,
}

impl Search {
    pub(super) fn new(
        trials: &[TrialTable],
        library: Vec<Term>,
        variables: &[String],
        whiten: &dyn Fn(usize, &[f64]) -> Vec<f64>,
    ) -> Search {
        let first = 1 + trials.iter().filter_map(|t| t.beside).map(DMatrix::ncols).max().unwrap_or(0);
        let width = first + library.len() + 1;
        let rows: usize = trials.iter().enumerate().map(|(g, t)| whiten(g, t.residual).len()).sum();
        let rows = rows as f64;
        let gram = |(g, trial): (usize, &TrialTable)| {
            let mut columns = vec![whiten(g, &vec![1.0; trial.residual.len()])];
            let beside = trial.beside.into_iter().flat_map(DMatrix::column_iter);
            columns.extend(beside.map(|c| c.iter().copied().collect::<Vec<f64>>()));
            columns.resize(first, vec![0.0; columns[0].len()]);
            columns.extend(library.iter().map(|term| whiten(g, &term.values(trial, variables))));
            columns.push(whiten(g, trial.residual));
            let rows = columns[0].len();
            let x = DMatrix::from_fn(rows, width, |i, j| columns[j][i]);
            x.tr_mul(&x)
        };
        let mut grams: Vec<Gram> = trials.iter().enumerate().map(gram).collect();
        let total = grams.iter().fold(Gram::zeros(width, width), |sum, g| sum + g);
        let scales: Vec<f64> = (0..width).map(|j| total[(j, j)].max(0.0).sqrt()).collect();
        let longest = scales.iter().copied().fold(0.0, f64::max);
        let scale = |j: usize| {
            let usable = scales[j].is_finite() && scales[j] > NOTHING * longest;
            if usable { 1.0 / scales[j] } else { 0.0 }
        };
        for g in &mut grams {
            for i in 0..width {
                for j in 0..width {
                    let scaled = g[(i, j)] * scale(i) * scale(j);
                    g[(i, j)] = if scaled.is_finite() { scaled } else { 0.0 };
                }
            }
        }
        let total = grams.iter().fold(Gram::zeros(width, width), |sum, g| sum + g);
        let beyond = Search::beyond(&total, first);
        Search { library, first, rows, grams, total, beyond, scales }
    }

    /// Sums without what the first columns have of the others.
    pub(super) fn beyond(total: &Gram, first: usize) -> Gram {
        let mut beyond = total.clone();
        (0..first).for_each(|column| sweep(&mut beyond, column));
        beyond
    }

    /// Places of the first columns and of some terms.
    pub(super) fn places(&self, terms: &[usize]) -> Vec<usize> {
        (0..self.first).chain(terms.iter().map(|t| t + self.first)).collect()
    }

    /// Place of the residual in the sums.
    pub(super) fn residual(&self) -> usize {
        self.first + self.library.len()
    }

    /// The sums over some trials.
    pub(super) fn sum(&self, trials: &[usize], signs: Option<&[f64]>) -> Gram {
        let (width, last) = (self.total.nrows(), self.residual());
        let mut sum = Gram::zeros(width, width);
        for g in trials {
            match signs {
                None => sum += &self.grams[*g],
                Some(signs) => {
                    let mut signed = self.grams[*g].clone();
                    for j in 0..last {
                        signed[(j, last)] *= signs[*g];
                        signed[(last, j)] *= signs[*g];
                    }
                    sum += signed;
                }
            }
        }
        sum
    }

    /// Whether two terms can hardly be told apart in these trials.
    pub(super) fn are_alike(&self, one: usize, other: usize) -> bool {
        if one == other {
            return true;
        }
        let [i, j] = [one + self.first, other + self.first];
        let size = (self.beyond[(i, i)] * self.beyond[(j, j)]).sqrt();
        size > NOTHING && self.beyond[(i, j)].abs() > ALIKE * size
    }

    /// Terms that the data call for most, one after the other.
    pub(super) fn greedy(&self, gram: &Gram, excluded: &[bool], most: usize) -> Vec<usize> {
        let last = self.residual();
        let mut chosen: Vec<usize> = Vec::new();
        // Sweeping a column out leaves what the others have beyond it.
        let mut left = Search::beyond(gram, self.first);
        let first = self.first;
        while chosen.len() < most {
            let whole = left[(last, last)];
            let gain = |j: usize| {
                let (size, with) = (left[(j + first, j + first)], left[(j + first, last)]);
                if size > NOTHING.sqrt() * gram[(j + first, j + first)] { with * with / size } else { 0.0 }
            };
            // Akaike's criterion: a shape is estimated, too.
            let better = |j: usize| {
                let shapes = if self.library[j].shape.is_some() { 1.0 } else { 0.0 };
                -self.rows * (1.0 - gain(j) / whole).max(NOTHING).ln() - 2.0 * shapes
            };
            let open = (0..self.library.len()).filter(|j| !excluded[*j] && !chosen.contains(j) && gain(*j) > 0.0);
            let Some(best) = open.max_by(|a, b| better(*a).total_cmp(&better(*b))) else { break };
            sweep(&mut left, best + first);
            chosen.push(best);
        }
        chosen
    }

    /// Coefficients of the first columns and some terms.
    pub(super) fn coefficients(&self, gram: &Gram, terms: &[usize]) -> Option<DVector<f64>> {
        let places = self.places(terms);
        let n = places.len();
        let mut a = DMatrix::from_fn(n, n, |i, j| gram[(places[i], places[j])]);
        for i in 0..n {
            a[(i, i)] += NOTHING * (1.0 + a[(i, i)]);
        }
        let b = DVector::from_fn(n, |i, _| gram[(places[i], self.residual())]);
        a.cholesky().map(|c| c.solve(&b))
    }

    /// Square that coefficients leave.
    pub(super) fn left(&self, gram: &Gram, terms: &[usize], coefficients: &DVector<f64>) -> f64 {
        let places = self.places(terms);
        let last = self.residual();
        let mut square = gram[(last, last)];
        for (i, p) in places.iter().enumerate() {
            square -= 2.0 * coefficients[i] * gram[(*p, last)];
            for (j, q) in places.iter().enumerate() {
                square += coefficients[i] * coefficients[j] * gram[(*p, *q)];
            }
        }
        square
    }

    /// Equation (2).
    pub(super) fn share(&self, terms: &[usize], signs: Option<&[f64]>) -> f64 {
        let all: Vec<usize> = (0..self.grams.len()).collect();
        let whole = self.sum(&all, signs);
        let (mut with, mut without) = (0.0, 0.0);
        for g in 0..self.grams.len() {
            let one = self.sum(&[g], signs);
            let rest = &whole - &one;
            let (Some(fit), Some(mean)) = (self.coefficients(&rest, terms), self.coefficients(&rest, &[])) else {
                return 0.0;
            };
            with += self.left(&one, terms, &fit);
            without += self.left(&one, &[], &mean);
        }
        if without > 0.0 { 1.0 - with / without } else { 0.0 }
    }

    /// The same with the residual that the best formula leaves, and the share of the mean square that it leaves.
    pub(super) fn without_its_best_formula(&self) -> (Search, f64) {
        let terms = self.greedy(&self.total, &vec![false; self.library.len()], MOST_TERMS);
        let all = |terms: &[usize]| {
            let fit = self.coefficients(&self.total, terms)?;
            let left = self.left(&self.total, terms, &fit);
            Some((fit, left))
        };
        let (Some((fit, with)), Some((_, without))) = (all(&terms), all(&[])) else { return (self.clone(), 1.0) };
        let places = self.places(&terms);
        let last = self.residual();
        // r − X β, in rows and columns of the sums.
        let taken_off = |gram: &Gram| {
            let mut out = gram.clone();
            for (i, place) in places.iter().enumerate() {
                let column = fit[i] * out.column(*place);
                out.column_mut(last).axpy(-1.0, &column, 1.0);
            }
            for (i, place) in places.iter().enumerate() {
                let row = fit[i] * out.row(*place);
                let left = out.row(last) - row;
                out.set_row(last, &left);
            }
            out
        };
        let total = taken_off(&self.total);
        let rest = Search {
            library: self.library.clone(),
            first: self.first,
            rows: self.rows,
            grams: self.grams.iter().map(taken_off).collect(),
            beyond: Search::beyond(&total, self.first),
            total,
            scales: self.scales.clone(),
        };
        (rest, if without > 0.0 { (with / without).clamp(0.0, 1.0) } else { 1.0 })
    }

    /// What one term explains at most where the signs of trials are drawn.
    pub(super) fn share_by_chance(&self, all: &[usize], rng: &mut ChaCha8Rng) -> f64 {
        let excluded = vec![false; self.library.len()];
        let mut most = 0.0_f64;
        for _ in 0..SIGN_DRAWS {
            let mut signs: Vec<f64> = all.iter().map(|_| if rng.random::<bool>() { 1.0 } else { -1.0 }).collect();
            if signs.iter().all(|s| *s == signs[0]) {
                signs[0] = -signs[0];
            }
            let path = self.greedy(&self.sum(all, Some(&signs)), &excluded, 1);
            most = most.max(self.share(&path, Some(&signs)));
        }
        most
    }

    /// Terms that are selected in halves of the trials.
    pub(super) fn selected_in_halves(&self, rng: &mut ChaCha8Rng) -> Vec<Vec<usize>> {
        let excluded = vec![false; self.library.len()];
        let mut trials: Vec<usize> = (0..self.grams.len()).collect();
        let mut half = || {
            trials.shuffle(rng);
            self.greedy(&self.sum(&trials[..trials.len().div_ceil(2)], None), &excluded, MOST_TERMS)
        };
        (0..HALVES).map(|_| half()).collect()
    }

    /// The first terms of a path, as many as are stable and worth it, and how stable the least is.
    pub(super) fn short(&self, path: &[usize], halves: &[Vec<usize>]) -> Option<(Vec<usize>, f64)> {
        let stability = |term: usize| {
            let in_half = |half: &&Vec<usize>| half.iter().any(|other| self.are_alike(term, *other));
            halves.iter().filter(in_half).count() as f64 / halves.len() as f64
        };
        let (mut terms, mut least, mut share) = (Vec::new(), 1.0_f64, 0.0);
        for term in path {
            let with: Vec<usize> = terms.iter().copied().chain([*term]).collect();
            let (stable, explained) = (stability(*term), self.share(&with, None));
            if stable < STABLE || explained < share + WORTH_A_TERM {
                break;
            }
            (terms, least, share) = (with, least.min(stable), explained);
        }
        (!terms.is_empty()).then_some((terms, least))
    }

    /// The formula of some terms, their shapes searched between those that were scanned.
    pub(super) fn proposal(
        &self,
        terms: &[usize],
        stability: f64,
        trials: &[TrialTable],
        variables: &[String],
        whiten: &dyn Fn(usize, &[f64]) -> Vec<f64>,
    ) -> Proposal {
        let mut chosen: Vec<Term> = terms.iter().map(|t| self.library[*t].clone()).collect();
        let fitted = |chosen: &[Term]| Search::new(trials, chosen.to_vec(), variables, whiten);
        let places: Vec<usize> = (0..chosen.len()).collect();
        let rest = |chosen: &[Term]| {
            let search = fitted(chosen);
            let fit = search.coefficients(&search.total, &places);
            fit.map_or(f64::INFINITY, |fit| search.left(&search.total, &places, &fit))
        };
        for i in 0..chosen.len() {
            let Some((k, unit)) = chosen[i].shape.filter(|_| chosen[i].text.contains("k*q")) else { continue };
            let with = |k: f64| {
                let mut chosen = chosen.clone();
                chosen[i].shape = Some((k, unit));
                rest(&chosen)
            };
            let k = golden_section([k - WAVES[2], k + WAVES[2]], with);
            chosen[i].shape = Some((k, unit));
        }
        let search = fitted(&chosen);
        let scales = &search.scales;
        let fit =
            search.coefficients(&search.total, &places).unwrap_or_else(|| DVector::zeros(chosen.len() + search.first));
        let last = scales[search.residual()];
        let term = |(i, term): (usize, &Term)| ProposedTerm {
            term: term.text.clone(),
            coefficient: fit[i + search.first] * last / scales[i + search.first].max(f64::MIN_POSITIVE),
            unit: term.unit(),
            shape: term.shape,
        };
        let terms: Vec<ProposedTerm> = chosen.iter().enumerate().map(term).collect();
        let share = search.share(&places, None);
        let shown = |t: &ProposedTerm| {
            let text = t.shape.map_or_else(|| t.term.clone(), |(k, _)| t.term.replace("k*", &format!("{}*", short(k))));
            format!("{}*{text}", short(t.coefficient))
        };
        let formula = terms.iter().map(shown).collect::<Vec<_>>().join(" + ").replace("+ -", "- ");
        Proposal { formula, share, stability, terms }
    }
}

/// Takes out of all columns what they have of one.
fn sweep(gram: &mut Gram, column: usize) {
    let pivot = gram[(column, column)];
    if !(pivot > 0.0) {
        return;
    }
    let of = gram.column(column).clone_owned();
    gram.ger(-1.0 / pivot, &of, &of, 1.0);
}

/// Where a function of one variable is least, between two ends.
fn golden_section([mut low, mut high]: [f64; 2], f: impl Fn(f64) -> f64) -> f64 {
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut a, mut b) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut at_a, mut at_b) = (f(a), f(b));
    for _ in 0..REFINEMENTS {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - ratio * (high - low);
            at_a = f(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + ratio * (high - low);
            at_b = f(b);
        }
    }
    0.5 * (low + high)
}
