//! Coordinates that follow others: OpenSim's `CoordinateCouplerConstraint`.

use super::error::{CompileError, CouplerProblem};
use super::model::{Model, coordinate_in};
use crate::functions::Function;
use crate::osim::spec::{ConstraintKind, CoordinateIndex, ModelSpec};

/// `dependent = scale_factor · function(independent)`.
#[derive(Clone, Debug)]
pub struct Coupler {
    /// Name of the constraint.
    pub name: String,
    /// The argument.
    pub independent: CoordinateIndex,
    /// The coordinate that follows.
    pub dependent: CoordinateIndex,
    /// The coupling function.
    pub function: Function,
    /// Multiplies the function.
    pub scale_factor: f64,
}

impl Coupler {
    /// Value of the dependent coordinate.
    pub fn value(&self, independent: f64) -> f64 {
        self.scale_factor * self.function.value(independent)
    }

    /// d dependent / d independent.
    pub fn derivative(&self, independent: f64) -> f64 {
        self.scale_factor * self.function.derivative(independent)
    }

    /// d² dependent / d independent².
    pub fn second_derivative(&self, independent: f64) -> f64 {
        self.scale_factor * self.function.second_derivative(independent)
    }
}

/// Builds the enforced couplers of a model, sorted so that a coupler comes after the one that drives its argument.
pub(super) fn compile_couplers(spec: &ModelSpec) -> Result<Vec<Coupler>, CompileError> {
    let mut couplers: Vec<(usize, Coupler)> = Vec::new();
    let mut driven_by: Vec<Option<usize>> = vec![None; spec.coordinates.len()];
    for (number, constraint) in spec.constraints.iter().enumerate().filter(|(_, c)| c.is_enforced) {
        let ConstraintKind::CoordinateCoupler { independent_coordinates, dependent_coordinate, function, scale_factor } =
            &constraint.kind
        else {
            continue; // listed in Model::unsupported_constraints
        };
        let &[independent] = independent_coordinates.as_slice() else {
            return Err(CompileError::ArgumentCount {
                at: constraint.at.clone(),
                property: "coupled_coordinates_function".into(),
                found: independent_coordinates.len(),
            });
        };
        let function = Function::compile(function).map_err(|source| CompileError::Function {
            at: constraint.at.clone(),
            property: "coupled_coordinates_function".into(),
            source,
        })?;
        let independent = coordinate_in(spec, independent, &constraint.at)?;
        let dependent = coordinate_in(spec, *dependent_coordinate, &constraint.at)?;
        if driven_by[dependent.0].replace(couplers.len()).is_some() {
            return Err(problem(spec, number, dependent, CouplerProblem::DrivenTwice));
        }
        let name = constraint.name.clone();
        couplers.push((number, Coupler { name, independent, dependent, function, scale_factor: *scale_factor }));
    }
    let mut order = Vec::with_capacity(couplers.len());
    for (i, (number, coupler)) in couplers.iter().enumerate() {
        let mut depth = 0;
        let mut argument = coupler.independent;
        while let Some(driver) = driven_by[argument.0] {
            depth += 1;
            argument = couplers[driver].1.independent;
            if depth > couplers.len() {
                return Err(problem(spec, *number, coupler.dependent, CouplerProblem::Cycle));
            }
        }
        order.push((depth, i));
    }
    order.sort_unstable();
    Ok(order.into_iter().map(|(_, i)| couplers[i].1.clone()).collect())
}

fn problem(spec: &ModelSpec, number: usize, coordinate: CoordinateIndex, problem: CouplerProblem) -> CompileError {
    CompileError::Coupler {
        at: spec.constraints[number].at.clone(),
        coordinate: spec.coordinates[coordinate.0].name.clone(),
        problem,
    }
}

impl Model {
    /// Sets every dependent coordinate to the value that its coupler gives.
    ///
    /// - `q`: coordinates [rad or m], length `n_coordinates`
    pub fn satisfy_couplers(&self, q: &mut [f64]) {
        for coupler in &self.couplers {
            q[coupler.dependent.0] = coupler.value(q[coupler.independent.0]);
        }
    }

    /// Default values of all coordinates [rad or m], couplers satisfied.
    pub fn default_coordinates(&self) -> Vec<f64> {
        let mut q: Vec<f64> = self.coordinates.iter().map(|c| c.default_value).collect();
        self.satisfy_couplers(&mut q);
        q
    }

    /// Whether a coupler determines the coordinate.
    pub fn is_dependent(&self, coordinate: CoordinateIndex) -> bool {
        self.driver_of(coordinate).is_some()
    }

    /// The coupler that determines the coordinate.
    pub fn driver_of(&self, coordinate: CoordinateIndex) -> Option<&Coupler> {
        self.driven_by[coordinate.0].map(|i| &self.couplers[i])
    }

    /// Whether a chain of couplers ties the two coordinates to one another.
    pub fn are_coupled(&self, a: CoordinateIndex, b: CoordinateIndex) -> bool {
        self.root_of(a) == self.root_of(b)
    }

    /// The independent coordinate at the start of a coordinate's chain of couplers (itself, if not dependent).
    pub fn root_of(&self, mut coordinate: CoordinateIndex) -> CoordinateIndex {
        while let Some(coupler) = self.driver_of(coordinate) {
            coordinate = coupler.independent;
        }
        coordinate
    }

    /// Coupling vector: rate of every coordinate for unit rate of coordinate `c`, couplers followed, all other
    /// independent coordinates at rest.
    ///
    /// If `c` itself is dependent, the coordinate that drives it moves along (as in OpenSim's `MomentArmSolver`); the
    /// result is not finite where that coordinate's coupling function is flat.
    ///
    /// - `q`: coordinates [rad or m], couplers satisfied
    /// - `coupling`: receives dqᵢ/dq_c, length `n_coordinates`
    pub fn update_coupling(&self, q: &[f64], c: CoordinateIndex, coupling: &mut [f64]) {
        coupling.fill(0.0);
        let mut root_rate = 1.0;
        let mut root = c;
        while let Some(coupler) = self.driver_of(root) {
            root_rate /= coupler.derivative(q[coupler.independent.0]);
            root = coupler.independent;
        }
        coupling[root.0] = root_rate;
        self.follow_couplers(q, coupling);
        coupling[c.0] = 1.0;
    }

    /// Allocating form of [`Model::update_coupling`].
    pub fn coupling(&self, q: &[f64], c: CoordinateIndex) -> Vec<f64> {
        let mut coupling = vec![0.0; self.n_coordinates()];
        self.update_coupling(q, c, &mut coupling);
        coupling
    }

    /// Sets the rate of every dependent coordinate from that of the coordinate that drives it.
    ///
    /// - `q`: coordinates [rad or m], couplers satisfied
    /// - `qdot`: rates [rad/s or m/s]; those of dependent coordinates are overwritten
    pub fn follow_couplers(&self, q: &[f64], qdot: &mut [f64]) {
        for coupler in &self.couplers {
            let independent = coupler.independent.0;
            qdot[coupler.dependent.0] =
                if qdot[independent] == 0.0 { 0.0 } else { coupler.derivative(q[independent]) * qdot[independent] };
        }
    }

    /// Sets the second rate of every dependent coordinate:
    /// `q̈_d = f′(q_i)·q̈_i + f″(q_i)·q̇_i²`.
    ///
    /// - `qddot`: second rates [rad/s² or m/s²]; those of dependent coordinates are overwritten
    pub fn follow_couplers_second(&self, q: &[f64], qdot: &[f64], qddot: &mut [f64]) {
        for coupler in &self.couplers {
            let i = coupler.independent.0;
            qddot[coupler.dependent.0] =
                coupler.derivative(q[i]) * qddot[i] + coupler.second_derivative(q[i]) * qdot[i] * qdot[i];
        }
    }
}
