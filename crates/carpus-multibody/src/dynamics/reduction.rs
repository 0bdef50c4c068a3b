//! Free coordinates, and all others as functions of them: couplers, locked and prescribed coordinates.
//!
//! Couplers of several coordinates, and coordinates whose speeds are not their rates, are not reduced: they stay free,
//! and constraints hold them.

use super::error::PlantError;
use crate::multibody::{Coupler, Model};
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::CoordinateIndex;
use nalgebra::{DMatrix, DVector};

#[derive(Clone, Debug)]
enum Held {
    At(f64),
    Along(Box<Function>),
}

/// How coordinates follow from the free ones: `u = T u_free + …`, every row of T with one element at most.
#[derive(Clone, Debug)]
pub struct Reduction {
    /// The free coordinates.
    pub free: Vec<usize>,
    held: Vec<(usize, Held)>,
    couplers: Vec<Coupler>,
}

/// The relation at one state.
#[derive(Clone, Debug)]
pub struct Relation {
    /// Position among the free coordinates of what each coordinate follows.
    root: Vec<Option<usize>>,
    /// Speed for unit speed of that one.
    slope: Vec<f64>,
    /// Rate of the speed where those of the free ones are 0.
    bias: Vec<f64>,
}

impl Reduction {
    /// Sorts the coordinates of a model.
    ///
    /// # Errors
    /// A coordinate that is held twice.
    pub fn new(model: &Model, keep_locked: bool) -> Result<Reduction, PlantError> {
        let mut held = Vec::new();
        for (i, coordinate) in model.coordinates.iter().enumerate() {
            if !model.speed_is_rate(CoordinateIndex(i)) {
                continue;
            }
            let dependent = model.couplers.iter().any(|c| c.dependent.0 == i);
            let hold = match &coordinate.prescribed {
                Some(function) => Held::Along(Box::new(function.clone())),
                None if coordinate.locked && keep_locked => Held::At(coordinate.default_value),
                None => continue,
            };
            if dependent {
                return Err(PlantError::NotExplicit { constraint: coordinate.name.clone() });
            }
            held.push((i, hold));
        }
        let is_reduced = |c: &&Coupler| {
            let argument = c.only_argument();
            argument.is_some_and(|argument| model.speed_is_rate(argument)) && model.speed_is_rate(c.dependent)
        };
        let couplers: Vec<Coupler> = model.couplers.iter().filter(is_reduced).cloned().collect();
        let is_held = |i: &usize| held.iter().any(|(h, _)| h == i) || couplers.iter().any(|c| c.dependent.0 == *i);
        let free = (0..model.n_coordinates()).filter(|i| !is_held(i)).collect();
        Ok(Reduction { free, held, couplers })
    }

    /// Number of free coordinates.
    pub fn n_free(&self) -> usize {
        self.free.len()
    }

    /// Whether it holds a coordinate at a value or along a function.
    pub fn holds(&self, coordinate: CoordinateIndex) -> bool {
        self.held.iter().any(|(held, _)| *held == coordinate.0)
    }

    /// Whether a coupler's dependent coordinate follows in it.
    pub fn follows(&self, coupler: &Coupler) -> bool {
        self.couplers.iter().any(|own| own.dependent == coupler.dependent)
    }

    /// Buffers.
    pub fn new_relation(&self, model: &Model) -> Relation {
        let n = model.n_coordinates();
        Relation { root: vec![None; n], slope: vec![0.0; n], bias: vec![0.0; n] }
    }

    /// All coordinates and speeds from the free ones.
    pub fn expand(
        &self,
        time: f64,
        (q_free, u_free): (&[f64], &[f64]),
        (q, u): (&mut [f64], &mut [f64]),
        relation: &mut Relation,
    ) {
        for (k, &i) in self.free.iter().enumerate() {
            (q[i], u[i]) = (q_free[k], u_free[k]);
            (relation.root[i], relation.slope[i], relation.bias[i]) = (Some(k), 1.0, 0.0);
        }
        for (i, held) in &self.held {
            (q[*i], u[*i], relation.bias[*i]) = match held {
                Held::At(value) => (*value, 0.0, 0.0),
                Held::Along(f) => (f.value(time), f.derivative(time), f.second_derivative(time)),
            };
            (relation.root[*i], relation.slope[*i]) = (None, 0.0);
        }
        for coupler in &self.couplers {
            let (Some(i), d) = (coupler.only_argument().map(|i| i.0), coupler.dependent.0) else { continue };
            let slope = coupler.derivative(q, 0);
            q[d] = coupler.value(q);
            relation.bias[d] = slope * relation.bias[i] + coupler.second_rate_at_constant_rates(q, u);
            u[d] = slope * u[i];
            (relation.root[d], relation.slope[d]) = (relation.root[i], slope * relation.slope[i]);
        }
    }
}

impl Relation {
    /// Rates of all speeds where those of the free ones are 0.
    pub fn bias(&self) -> &[f64] {
        &self.bias
    }

    /// Tᵀ M T.
    pub fn reduce_matrix(&self, full: &DMatrix<f64>, reduced: &mut DMatrix<f64>) {
        reduced.fill(0.0);
        for (j, root_j) in self.root.iter().enumerate() {
            let Some(root_j) = root_j else { continue };
            for (i, root_i) in self.root.iter().enumerate() {
                let Some(root_i) = root_i else { continue };
                reduced[(*root_i, *root_j)] += self.slope[i] * full[(i, j)] * self.slope[j];
            }
        }
    }

    /// G T: derivatives by the free speeds from those by all speeds.
    pub fn reduce_columns(&self, full: &DMatrix<f64>, free: usize) -> DMatrix<f64> {
        let mut reduced = DMatrix::zeros(full.nrows(), free);
        for (i, root) in self.root.iter().enumerate() {
            if let Some(root) = root {
                reduced.column_mut(*root).axpy(self.slope[i], &full.column(i), 1.0);
            }
        }
        reduced
    }

    /// Tᵀ f.
    pub fn reduce(&self, full: &[f64], reduced: &mut DVector<f64>) {
        reduced.fill(0.0);
        for (i, root) in self.root.iter().enumerate() {
            if let Some(root) = root {
                reduced[*root] += self.slope[i] * full[i];
            }
        }
    }

    /// T u̇_free + bias.
    pub fn expand_rates(&self, free: &[f64], full: &mut [f64]) {
        for (i, root) in self.root.iter().enumerate() {
            full[i] = self.bias[i] + root.map_or(0.0, |root| self.slope[i] * free[root]);
        }
    }
}
