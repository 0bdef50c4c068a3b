//! Static equilibrium of fibre and tendon: the initial state of a simulation.

use super::parameters::Millard2012;
use super::pennation::significant_real;
use carpus_numerics::numerics::{Scalar, newton_bisection};
use carpus_numerics::plausible;
use carpus_numerics::printable::number;
use thiserror::Error;

/// Force imbalance that counts as equilibrium, over `max_isometric_force` (OpenSim's tolerance).
pub const EQUILIBRIUM_TOLERANCE: f64 = 1e-8;
/// Fibre lengths that differ by less than this share of optimal length are the same length.
const WELL_DETERMINED: f64 = 1e-6;
/// OpenSim's limit.
const MAX_ITERATIONS: usize = 200;

/// How an equilibrium was reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EquilibriumStatus {
    /// Fibre and tendon pull equally.
    Converged,
    /// Fibre and tendon pull equally within the tolerance, but over a range of fibre lengths (slack tendon, hardly any
    /// active force): the one reported is that which OpenSim's iteration arrives at.
    WeaklyDetermined,
    /// The fibre is at its minimum length, where it cannot shorten further.
    FiberAtLowerBound,
    /// The tendon is rigid: the fibre length follows from the path.
    RigidTendon,
}

/// A static equilibrium.
#[derive(Clone, Copy, Debug)]
pub struct Equilibrium<S = f64> {
    /// Fibre length [m].
    pub fiber_length: S,
    /// Tendon force [N].
    pub tendon_force: S,
    /// Fibre force along the tendon minus tendon force, over `max_isometric_force`.
    pub residual: f64,
    /// How it was reached.
    pub status: EquilibriumStatus,
    /// Newton iterations.
    pub iterations: usize,
    /// Whether OpenSim's own iteration converges here, too.
    pub opensim_converges: bool,
}

/// Why there is no equilibrium.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum EquilibriumError {
    /// An input is not a finite number.
    #[error("{muscle}: {quantity} is {value}")]
    NotFinite {
        /// Muscle name.
        muscle: String,
        /// The input.
        quantity: &'static str,
        /// Its value.
        value: f64,
    },
    /// A path cannot be that short.
    #[error("{muscle}: the path is {} m long, expected more than 0 m", number(*path_length))]
    PathLength {
        /// Muscle name.
        muscle: String,
        /// Length of the path [m].
        path_length: f64,
    },
    /// The search of a class ended at no length at all.
    #[error("{muscle}: no fibre length balances fibre and tendon, path {} m, activation \
             {activation}", number(*path_length))]
    NoLength {
        /// Muscle name.
        muscle: String,
        /// Length of the path [m].
        path_length: f64,
        /// Activation.
        activation: f64,
    },
    /// The search ended with forces that do not balance.
    #[error(
        "{muscle}: fibre and tendon differ by {residual:e}·Fmax at {} m, path {} m, activation {activation}",
        number(*fiber_length),
        number(*path_length)
    )]
    NotConverged {
        /// Muscle name.
        muscle: String,
        /// Force imbalance over `max_isometric_force`.
        residual: f64,
        /// Best fibre length [m].
        fiber_length: f64,
        /// Length of the path [m].
        path_length: f64,
        /// Activation, clamped.
        activation: f64,
    },
    /// Forces that are no finite numbers.
    #[error(
        "{muscle}: the forces of fibre and tendon are not finite, path {} m, activation {activation}: {cause}",
        number(*path_length)
    )]
    ForceNotFinite {
        /// Muscle name.
        muscle: String,
        /// Length of the path [m].
        path_length: f64,
        /// Activation, clamped.
        activation: f64,
        /// The parameters that make them so.
        cause: String,
    },
}

/// The force balance as a function of the fibre length.
#[derive(Clone, Copy, Debug)]
struct Balance<S> {
    /// Fibre force along the tendon minus tendon force, over `max_isometric_force`.
    residual: S,
    /// d residual / d fibre length [1/m], at the value.
    slope: f64,
    /// Normalized tendon force.
    tendon: S,
}

/// Outcome of the search in plain numbers.
struct Solution {
    fiber_length: f64,
    slope: f64,
    residual: f64,
    iterations: usize,
    status: EquilibriumStatus,
    opensim_converges: bool,
}

impl EquilibriumError {
    /// The muscle.
    pub fn muscle(&self) -> &str {
        match self {
            EquilibriumError::NotFinite { muscle, .. }
            | EquilibriumError::PathLength { muscle, .. }
            | EquilibriumError::NoLength { muscle, .. }
            | EquilibriumError::NotConverged { muscle, .. }
            | EquilibriumError::ForceNotFinite { muscle, .. } => muscle,
        }
    }
}

impl<S: Scalar> Millard2012<S> {
    /// Fibre length at which fibre and tendon pull equally, both at rest.
    ///
    /// OpenSim's iteration is followed (where there are several equilibria, it decides which) and then brought to
    /// machine precision; where it fails, a bracketed search takes over. The path's speed has no influence: OpenSim 4.6
    /// evaluates the static balance also in `computeFiberEquilibrium(s, true)`.
    ///
    /// - `path_length` [m]
    /// - `activation`: clamped to `minimum_activation` and 1
    ///
    /// # Errors
    /// [`EquilibriumError::NotFinite`], [`EquilibriumError::PathLength`] for unusable input;
    /// [`EquilibriumError::NotConverged`] if no length balances the forces.
    ///
    /// # References
    /// OpenSim `Millard2012EquilibriumMuscle::computeInitialFiberEquilibrium`, `estimateMuscleFiberState`.
    pub fn equilibrium(&self, path_length: S, activation: S) -> Result<Equilibrium<S>, EquilibriumError> {
        for (quantity, value) in [("path length", path_length.value()), ("activation", activation.value())] {
            if !value.is_finite() {
                return Err(EquilibriumError::NotFinite { muscle: self.name().to_owned(), quantity, value });
            }
        }
        if path_length.value() <= 0.0 {
            let path_length = path_length.value();
            return Err(EquilibriumError::PathLength { muscle: self.name().to_owned(), path_length });
        }
        let activation = self.clamp_activation(activation);
        if self.structure.ignore_tendon_compliance {
            return Ok(self.rigid_equilibrium(path_length, activation));
        }
        let solution = self.solve_equilibrium(path_length.value(), activation.value())?;
        let fiber_length = match solution.status {
            EquilibriumStatus::FiberAtLowerBound => self.minimum_fiber_length,
            EquilibriumStatus::WeaklyDetermined => {
                let l_opt = self.parameters.optimal_fiber_length;
                l_opt * (solution.fiber_length / l_opt.value())
            }
            _ => {
                let at = self.balance(S::constant(solution.fiber_length), path_length, activation);
                S::constant(solution.fiber_length) - (at.residual - at.residual.value()) * (1.0 / solution.slope)
            }
        };
        let tendon = self.balance(fiber_length, path_length, activation).tendon;
        Ok(Equilibrium {
            fiber_length,
            tendon_force: self.parameters.max_isometric_force * tendon,
            residual: solution.residual,
            status: solution.status,
            iterations: solution.iterations,
            opensim_converges: solution.opensim_converges,
        })
    }

    /// Fibre force along the tendon minus tendon force, both at rest, over `max_isometric_force`; zero in equilibrium.
    ///
    /// For a compliant tendon. The fibre length is clamped to the minimum, the activation to its bounds.
    pub fn equilibrium_residual(&self, fiber_length: S, path_length: S, activation: S) -> S {
        self.balance(fiber_length, path_length, self.clamp_activation(activation)).residual
    }

    fn rigid_equilibrium(&self, path_length: S, activation: S) -> Equilibrium<S> {
        let at = self.dynamics(S::constant(0.0), activation, path_length, S::constant(0.0));
        Equilibrium {
            fiber_length: at.fiber_length,
            tendon_force: at.tendon_force,
            residual: 0.0,
            status: EquilibriumStatus::RigidTendon,
            iterations: 0,
            opensim_converges: true,
        }
    }

    fn balance(&self, fiber_length: S, path_length: S, activation: S) -> Balance<S> {
        let at = self.length_state(fiber_length, path_length);
        let tendon_at = self.structure.curves.tendon_force_length.value_and_derivative(at.norm_tendon_length.value());
        let fiber = activation * at.active_multiplier() + at.passive_multiplier();
        let tendon = at.norm_tendon_length.chain(tendon_at.value, tendon_at.derivative);
        let fiber_slope = (activation.value() * at.active.derivative + at.passive.derivative)
            / self.parameters.optimal_fiber_length.value();
        let (sin, cos) = (at.sin.value(), at.cos.value());
        let angle_slope = -sin / (at.fiber_length.value() * cos);
        let tendon_slope = tendon_at.derivative / self.parameters.tendon_slack_length.value();
        Balance {
            residual: fiber * at.cos - tendon,
            slope: fiber_slope * cos
                - fiber.value() * sin * angle_slope
                - tendon_slope * (at.fiber_length.value() * sin * angle_slope - cos),
            tendon,
        }
    }

    /// [`balance`](Self::balance) in plain numbers.
    fn balance_value(&self, fiber_length: f64, path_length: f64, activation: f64) -> (f64, f64) {
        let at = self.balance(S::constant(fiber_length), S::constant(path_length), S::constant(activation));
        (at.residual.value(), at.slope)
    }

    fn solve_equilibrium(&self, path_length: f64, activation: f64) -> Result<Solution, EquilibriumError> {
        let balance = |length: f64| self.balance_value(length, path_length, activation);
        let minimum = self.minimum_fiber_length.value();
        let first_tendon = self.parameters.tendon_slack_length * 1.01;
        let start = self.pennation.fiber_length(S::constant(path_length), S::constant(first_tendon.value()));
        let mut solution = opensim_iteration(start.value().max(minimum), minimum, balance);
        if solution.opensim_converges {
            self.polish(&mut solution, balance);
            return Ok(solution);
        }
        // OpenSim gives up; at the lower bound it says so, elsewhere it throws.
        let at_minimum = balance(minimum);
        if at_minimum.0 >= 0.0 {
            return Ok(Solution {
                fiber_length: minimum,
                residual: at_minimum.0,
                status: EquilibriumStatus::FiberAtLowerBound,
                opensim_converges: solution.fiber_length <= minimum,
                ..solution
            });
        }
        // A fibre so long that the tendon is slack cannot pull less than the tendon.
        let slack = S::constant(self.parameters.tendon_slack_length.value());
        let longest = self.pennation.fiber_length(S::constant(path_length), slack).value().max(minimum);
        let root = newton_bisection(minimum, longest, balance).ok();
        match root.filter(|root| root.residual.abs() <= EQUILIBRIUM_TOLERANCE) {
            Some(root) => Ok(Solution {
                fiber_length: root.x,
                slope: balance(root.x).1,
                residual: root.residual,
                iterations: solution.iterations + root.evaluations,
                status: EquilibriumStatus::Converged,
                opensim_converges: false,
            }),
            None if !root.map_or(at_minimum.0, |root| root.residual).is_finite() => {
                let (muscle, cause) = (self.name().to_owned(), self.implausible_parameters());
                Err(EquilibriumError::ForceNotFinite { muscle, path_length, activation, cause })
            }
            None => Err(EquilibriumError::NotConverged {
                muscle: self.name().to_owned(),
                residual: root.map_or(at_minimum.0, |root| root.residual),
                fiber_length: root.map_or(minimum, |root| root.x),
                path_length,
                activation,
            }),
        }
    }

    /// The parameters that no muscle has; if there is none, all that a balance at rest depends on.
    fn implausible_parameters(&self) -> String {
        let own = &self.parameters;
        let all = [
            ("optimal_fiber_length", own.optimal_fiber_length.value(), &plausible::OPTIMAL_FIBER_LENGTH),
            ("tendon_slack_length", own.tendon_slack_length.value(), &plausible::TENDON_SLACK_LENGTH),
            ("pennation_angle_at_optimal", own.pennation_angle_at_optimal.value(), &plausible::PENNATION_ANGLE),
        ];
        let doubts: Vec<String> = all
            .iter()
            .filter_map(|(name, value, range)| range.doubt(*value).map(|doubt| format!("{name}: {doubt}")))
            .collect();
        let given = || all.iter().map(|(name, value, range)| format!("{name} {value} {}", range.unit)).collect();
        let listed: Vec<String> = if doubts.is_empty() { given() } else { doubts };
        listed.join("; ")
    }

    /// Newton steps from within the tolerance to machine precision, where the length is determined that well.
    fn polish(&self, solution: &mut Solution, balance: impl Fn(f64) -> (f64, f64)) {
        let minimum = self.minimum_fiber_length.value();
        let l_opt = self.parameters.optimal_fiber_length.value();
        if solution.fiber_length <= minimum {
            solution.status = EquilibriumStatus::FiberAtLowerBound;
            return;
        }
        let imprecision = EQUILIBRIUM_TOLERANCE / solution.slope.abs();
        if imprecision > WELL_DETERMINED * l_opt {
            solution.status = EquilibriumStatus::WeaklyDetermined;
            return;
        }
        for _ in 0..4 {
            let next = solution.fiber_length - solution.residual / solution.slope;
            if next < minimum || next == solution.fiber_length {
                return;
            }
            let (residual, slope) = balance(next);
            if residual.abs() >= solution.residual.abs() {
                return;
            }
            (solution.fiber_length, solution.residual, solution.slope) = (next, residual, slope);
        }
    }
}

/// Newton's method with step halving exactly as OpenSim does it.
fn opensim_iteration(start: f64, minimum: f64, balance: impl Fn(f64) -> (f64, f64)) -> Solution {
    let mut length = start;
    let (mut residual, mut slope) = balance(length);
    let mut iterations = 0;
    while residual.abs() > EQUILIBRIUM_TOLERANCE && iterations < MAX_ITERATIONS {
        let (previous_length, previous_residual) = (length, residual);
        let mut h = 1.0;
        let mut next_slope = slope;
        while residual.abs() >= previous_residual.abs() {
            let step = -h * previous_residual / slope;
            if step.abs() > significant_real() {
                length = previous_length + step;
            } else {
                // Stagnation: step aside and end the search along this direction.
                length = previous_length - sign(step) * f64::EPSILON.sqrt();
                h = 0.0;
            }
            length = length.max(minimum);
            (residual, next_slope) = balance(length);
            if h <= f64::EPSILON.sqrt() {
                break;
            }
            h *= 0.5;
        }
        slope = next_slope;
        iterations += 1;
    }
    Solution {
        fiber_length: length.max(minimum),
        slope,
        residual,
        iterations,
        status: EquilibriumStatus::Converged,
        opensim_converges: residual.abs() <= EQUILIBRIUM_TOLERANCE,
    }
}

/// −1, 0 or 1.
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}
