//! Coordinates that follow others: OpenSim's `CoordinateCouplerConstraint`.

use super::error::{CompileError, CouplerProblem};
use super::index::coordinate_in;
use carpus_osim::functions::{Function, FunctionOfSeveral};
use carpus_osim::osim::spec::{ConstraintKind, CoordinateIndex, ModelSpec};

/// `dependent = scale_factor · function(independent)`.
#[derive(Clone, Debug)]
pub struct Coupler {
    /// Name of the constraint.
    pub name: String,
    /// The arguments: one, but for functions of several variables.
    pub independent: Vec<CoordinateIndex>,
    /// The coordinate that follows.
    pub dependent: CoordinateIndex,
    function: CouplingFunction,
    /// Multiplies the function.
    scale_factor: f64,
    /// Whether second rates are those of OpenSim where its functions of several variables contradict their derivatives.
    follows_opensim: bool,
}

/// What a coupler evaluates.
#[derive(Clone, Debug)]
enum CouplingFunction {
    One(Box<Function>),
    Several(FunctionOfSeveral),
}

impl Coupler {
    /// A coordinate that follows another by a function.
    pub(super) fn by_function(
        name: String,
        independent: CoordinateIndex,
        dependent: CoordinateIndex,
        function: Function,
    ) -> Coupler {
        let function = CouplingFunction::One(Box::new(function));
        let independent = vec![independent];
        Coupler { name, independent, dependent, function, scale_factor: 1.0, follows_opensim: false }
    }

    /// The same, its second rates those of OpenSim.
    pub(super) fn with_second_rates_of_opensim(self) -> Coupler {
        Coupler { follows_opensim: true, ..self }
    }

    /// The same, its second rates those of its function: with them accelerations keep what velocities satisfy.
    pub(crate) fn with_own_second_rates(self) -> Coupler {
        Coupler { follows_opensim: false, ..self }
    }

    /// The only argument; `None` where there are several.
    pub fn only_argument(&self) -> Option<CoordinateIndex> {
        match self.independent[..] {
            [independent] => Some(independent),
            _ => None,
        }
    }

    /// Value of the dependent coordinate.
    ///
    /// - `q`: all coordinates [rad or m]
    pub fn value(&self, q: &[f64]) -> f64 {
        self.scale_factor
            * match &self.function {
                CouplingFunction::One(function) => function.value(q[self.independent[0].0]),
                CouplingFunction::Several(function) => function.value(|k| q[self.independent[k].0]),
            }
    }

    /// d dependent / d independent, for the argument at position `k`.
    pub fn derivative(&self, q: &[f64], k: usize) -> f64 {
        self.scale_factor
            * match &self.function {
                CouplingFunction::One(function) => function.derivative(q[self.independent[k].0]),
                CouplingFunction::Several(function) => function.derivative(|k| q[self.independent[k].0], k),
            }
    }

    /// Every argument and d dependent / d argument.
    pub fn derivatives<'a>(&'a self, q: &'a [f64]) -> impl Iterator<Item = (CoordinateIndex, f64)> + 'a {
        self.independent.iter().enumerate().map(|(k, &argument)| (argument, self.derivative(q, k)))
    }

    /// Rate of the dependent coordinate; arguments at rest are not differentiated by.
    pub fn rate(&self, q: &[f64], qdot: &[f64]) -> f64 {
        let moving = self.independent.iter().enumerate().filter(|(_, argument)| qdot[argument.0] != 0.0);
        moving.fold(0.0, |sum, (k, argument)| sum + self.derivative(q, k) * qdot[argument.0])
    }

    /// Second rate of the dependent coordinate where those of the arguments are 0: `Σ f_kl q̇_k q̇_l`.
    pub fn second_rate_at_constant_rates(&self, q: &[f64], qdot: &[f64]) -> f64 {
        let rate = |k: usize| qdot[self.independent[k].0];
        self.scale_factor
            * match &self.function {
                // So does `ExpressionBasedFunction`.
                CouplingFunction::One(function) if self.follows_opensim && function.is_formula() => {
                    function.derivative(q[self.independent[0].0]) * rate(0) * rate(0)
                }
                CouplingFunction::One(function) => {
                    function.second_derivative(q[self.independent[0].0]) * rate(0) * rate(0)
                }
                // `MultivariatePolynomialFunction` gives its derivative by the first variable where one by two is asked
                // for.
                CouplingFunction::Several(function) if self.follows_opensim => {
                    let n = self.independent.len();
                    let slope = |k: usize| function.derivative(|k| q[self.independent[k].0], k);
                    let by_first: f64 = (0..n).map(|k| slope(k) * rate(k)).sum();
                    by_first * (0..n).map(rate).sum::<f64>()
                }
                CouplingFunction::Several(function) => {
                    let n = self.independent.len();
                    let value = |k: usize| q[self.independent[k].0];
                    let term = |(k, l): (usize, usize)| function.second_derivative(value, k, l) * rate(k) * rate(l);
                    (0..n).flat_map(|k| (0..n).map(move |l| (k, l))).map(term).sum()
                }
            }
    }
}

/// Builds the enforced couplers of a model, sorted so that a coupler comes after the one that drives its argument.
pub(super) fn compile_couplers(spec: &ModelSpec) -> Result<Vec<Coupler>, CompileError> {
    let mut couplers: Vec<(usize, Coupler)> = Vec::new();
    let mut driven_by: Vec<Option<usize>> = vec![None; spec.coordinates.len()];
    for (number, constraint) in spec.constraints.iter().enumerate().filter(|(_, c)| c.is_enforced) {
        let ConstraintKind::CoordinateCoupler {
            independent_coordinates: arguments,
            dependent_coordinate,
            function,
            scale_factor,
        } = &constraint.kind
        else {
            continue; // listed in Model::unsupported_constraints
        };
        let function = match arguments.len() {
            0 => {
                return Err(CompileError::ArgumentCount {
                    at: constraint.at.clone(),
                    property: "coupled_coordinates_function".into(),
                    found: 0,
                });
            }
            1 => Function::compile(function).map(|function| CouplingFunction::One(Box::new(function))),
            several => FunctionOfSeveral::compile(function, several).map(CouplingFunction::Several),
        };
        let function = function.map_err(|source| CompileError::Function {
            at: constraint.at.clone(),
            property: "coupled_coordinates_function".into(),
            source,
        })?;
        let independent = arguments
            .iter()
            .map(|&independent| coordinate_in(spec, independent, &constraint.at))
            .collect::<Result<_, _>>()?;
        let dependent = coordinate_in(spec, *dependent_coordinate, &constraint.at)?;
        if driven_by[dependent.0].replace(couplers.len()).is_some() {
            return Err(problem(spec, number, dependent, CouplerProblem::DrivenTwice));
        }
        let name = constraint.name.clone();
        couplers.push((
            number,
            Coupler { name, independent, dependent, function, scale_factor: *scale_factor, follows_opensim: false },
        ));
    }
    // Length of the longest chain of couplers that drives the arguments of each.
    let mut depths = vec![0; couplers.len()];
    for _ in 0..=couplers.len() {
        let mut longer = false;
        for (i, (_, coupler)) in couplers.iter().enumerate() {
            let drivers = coupler.independent.iter().filter_map(|argument| driven_by[argument.0]);
            let depth = drivers.map(|driver| depths[driver] + 1).max().unwrap_or(0);
            longer |= depth > depths[i];
            depths[i] = depth;
        }
        if !longer {
            let mut order: Vec<usize> = (0..couplers.len()).collect();
            order.sort_by_key(|&i| depths[i]);
            return Ok(order.into_iter().map(|i| couplers[i].1.clone()).collect());
        }
    }
    // Chains in a cycle grow without end.
    let (number, coupler) = couplers.iter().zip(&depths).max_by_key(|(_, depth)| **depth).map_or(&couplers[0], |c| c.0);
    Err(problem(spec, *number, coupler.dependent, CouplerProblem::Cycle))
}

fn problem(spec: &ModelSpec, number: usize, coordinate: CoordinateIndex, problem: CouplerProblem) -> CompileError {
    CompileError::Coupler {
        at: spec.constraints[number].at.clone(),
        coordinate: spec.coordinates[coordinate.0].name.clone(),
        problem,
    }
}
