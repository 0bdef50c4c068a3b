//! Points of Morris' screening: steps that change one parameter at a time.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::error::SensitivityError;
use super::hypercube::{maximin_latin_hypercube, shuffle};

/// A step between two points of a start that differ in one parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Move {
    /// The parameter that changes.
    pub parameter: usize,
    /// Point before the change, among those of the start.
    pub from: usize,
    /// Point after the change.
    pub to: usize,
}

/// One start: m + 1 points and the m moves between them, one for each parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// Points in the unit cube.
    pub points: Vec<Vec<f64>>,
    /// One move for each parameter.
    pub moves: Vec<Move>,
}

/// The points of a screening, K = r (m + 1) (equation 2.6 of Jadelis 2025).
#[derive(Clone, Debug, PartialEq)]
pub struct MorrisSample {
    n_parameters: usize,
    starts: Vec<Start>,
}

/// Latin hypercubes drawn, of which the one that fills the space best is taken.
const CANDIDATES: usize = 20;

impl MorrisSample {
    /// The radial design: `r` starts, each of whose parameters moves from the start to its value in a second point;
    /// starts and second points are one Latin hypercube of 2 r points. This is the design of the SAFE toolbox with
    /// `SampStrategy = 'lhs'`, `des_type = 'radial'`.
    ///
    /// # Errors
    /// [`SensitivityError::TooFew`]: no parameter, or fewer than two starts.
    ///
    /// # References
    /// Campolongo, Saltelli & Cariboni (2011), doi:10.1016/j.cpc.2010.12.039; Pianosi et al. (2015),
    /// doi:10.1016/j.envsoft.2015.04.009
    pub fn radial(n_parameters: usize, r: usize, seed: u64) -> Result<Self, SensitivityError> {
        enough(n_parameters, r)?;
        let cube = maximin_latin_hypercube(2 * r, n_parameters, CANDIDATES, seed);
        let start = |pair: &[Vec<f64>]| {
            let mut points = vec![pair[0].clone()];
            for parameter in 0..n_parameters {
                let mut point = pair[0].clone();
                point[parameter] = pair[1][parameter];
                points.push(point);
            }
            let moves = (0..n_parameters).map(|parameter| Move { parameter, from: 0, to: parameter + 1 }).collect();
            Start { points, moves }
        };
        Ok(Self { n_parameters, starts: cube.chunks_exact(2).map(start).collect() })
    }

    /// Morris' own design: `r` random walks on a grid of `levels` values per parameter (even), each step of size
    /// Δ = levels / (2 (levels − 1)).
    ///
    /// # Errors
    /// [`SensitivityError::TooFew`]: no parameter, fewer than two starts, or levels not even and at least 2.
    ///
    /// # References
    /// Morris (1991), doi:10.1080/00401706.1991.10484804
    pub fn trajectories(n_parameters: usize, r: usize, levels: usize, seed: u64) -> Result<Self, SensitivityError> {
        enough(n_parameters, r)?;
        if levels < 2 || !levels.is_multiple_of(2) {
            return Err(SensitivityError::TooFew { what: "levels (an even number)", expected: 2, found: levels });
        }
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let half = levels / 2;
        let step = half as f64 / (levels - 1) as f64;
        let mut order: Vec<usize> = (0..n_parameters).collect();
        let starts = (0..r)
            .map(|_| {
                shuffle(&mut order, &mut random);
                let mut upward = vec![false; n_parameters];
                let mut point: Vec<f64> = upward
                    .iter_mut()
                    .map(|upward| {
                        *upward = random.random();
                        let level = random.random_range(0..half) as f64 / (levels - 1) as f64;
                        if *upward { level } else { level + step }
                    })
                    .collect();
                let mut points = vec![point.clone()];
                for &parameter in &order {
                    point[parameter] += if upward[parameter] { step } else { -step };
                    points.push(point.clone());
                }
                let moves = order.iter().enumerate().map(|(i, &parameter)| Move { parameter, from: i, to: i + 1 });
                Start { points, moves: moves.collect() }
            })
            .collect();
        Ok(Self { n_parameters, starts })
    }

    /// Trajectories drawn elsewhere: the points of all of them one after the other, m + 1 each, in the unit cube.
    ///
    /// # Errors
    /// - [`SensitivityError::Length`]: not a multiple of m + 1 points, or a point of another dimension
    /// - [`SensitivityError::NotOneAtATime`]: neighbours that differ in no parameter or in several
    pub fn from_trajectories(points: &[Vec<f64>], n_parameters: usize) -> Result<Self, SensitivityError> {
        let length = n_parameters + 1;
        if let Some(point) = points.iter().find(|p| p.len() != n_parameters) {
            let what = "values of a point";
            return Err(SensitivityError::Length { what, expected: n_parameters, found: point.len() });
        }
        if !points.len().is_multiple_of(length) {
            let expected = points.len().next_multiple_of(length);
            return Err(SensitivityError::Length { what: "points", expected, found: points.len() });
        }
        enough(n_parameters, points.len() / length)?;
        let mut starts = Vec::new();
        for (start, points) in points.chunks_exact(length).enumerate() {
            let mut moves = Vec::new();
            for (step, pair) in points.windows(2).enumerate() {
                let changed: Vec<usize> = (0..n_parameters).filter(|&i| pair[0][i] != pair[1][i]).collect();
                let &[parameter] = &changed[..] else {
                    return Err(SensitivityError::NotOneAtATime { start, step, changed: changed.len() });
                };
                moves.push(Move { parameter, from: step, to: step + 1 });
            }
            starts.push(Start { points: points.to_vec(), moves });
        }
        Ok(Self { n_parameters, starts })
    }

    /// Number of parameters, m.
    pub fn n_parameters(&self) -> usize {
        self.n_parameters
    }

    /// The starts.
    pub fn starts(&self) -> &[Start] {
        &self.starts
    }

    /// All points in the unit cube, start after start: what has to be run.
    pub fn points(&self) -> Vec<Vec<f64>> {
        self.starts.iter().flat_map(|start| start.points.iter().cloned()).collect()
    }
}

fn enough(n_parameters: usize, r: usize) -> Result<(), SensitivityError> {
    if n_parameters == 0 {
        return Err(SensitivityError::TooFew { what: "parameters", expected: 1, found: 0 });
    }
    if r < 2 {
        return Err(SensitivityError::TooFew { what: "starts", expected: 2, found: r });
    }
    Ok(())
}
