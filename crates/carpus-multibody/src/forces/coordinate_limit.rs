//! Passive stiffness and damping at the limits of a coordinate.

use super::error::{ForceError, check_finite, check_index};
use crate::multibody::{Cache, Model};
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{CoordinateIndex, ForceKind, ForceSpec, MotionType};

/// OpenSim's `CoordinateLimitForce`: a spring and damper that fade in, with a smooth step, over `transition` beyond
/// each limit.
///
/// ```text
/// s_up  = step(0 → 1 over q_up … q_up + transition)
/// s_low = step(1 → 0 over q_low − transition … q_low)
/// f = −K_up·s_up·(q − q_up) + K_low·s_low·(q_low − q) − d·(s_up + s_low)·u
/// ```
/// The file gives limits and transition in degrees and stiffness and damping per degree if, and only if, the coordinate
/// is rotational; here they are SI. OpenSim computes the damping from s·K/K and so gives NaN for zero stiffness; here
/// it is d·s also then.
#[derive(Clone, Debug)]
pub struct CoordinateLimitForce {
    /// The coordinate.
    pub coordinate: CoordinateIndex,
    /// Upper limit [rad or m].
    pub upper_limit: f64,
    /// Lower limit [rad or m].
    pub lower_limit: f64,
    /// Stiffness beyond the upper limit [N·m/rad or N/m].
    pub upper_stiffness: f64,
    /// Stiffness beyond the lower limit [N·m/rad or N/m].
    pub lower_stiffness: f64,
    /// Damping beyond a limit [N·m·s/rad or N·s/m].
    pub damping: f64,
    /// Width of the transition [rad or m].
    pub transition: f64,
    /// Whether what the damping takes is a state.
    pub computes_dissipation: bool,
    upper_step: Function,
    lower_step: Function,
}

impl CoordinateLimitForce {
    pub(super) fn compile(force: &ForceSpec, model: &Model) -> Result<Self, ForceError> {
        let &ForceKind::CoordinateLimit {
            coordinate,
            upper_stiffness,
            upper_limit,
            lower_stiffness,
            lower_limit,
            damping,
            transition,
            computes_dissipation,
        } = &force.kind
        else {
            unreachable!("called for a CoordinateLimit only")
        };
        let at = &force.at;
        check_index(at, "coordinate", coordinate.0, model.n_coordinates())?;
        for (property, value) in [
            ("upper_stiffness", upper_stiffness),
            ("upper_limit", upper_limit),
            ("lower_stiffness", lower_stiffness),
            ("lower_limit", lower_limit),
            ("damping", damping),
            ("transition", transition),
        ] {
            check_finite(at, property, value)?;
        }
        let unit = match model.coordinates[coordinate.0].motion_type {
            MotionType::Rotational => std::f64::consts::PI / 180.0,
            MotionType::Translational | MotionType::Coupled => 1.0,
        };
        let (upper, lower, width) = (unit * upper_limit, unit * lower_limit, unit * transition);
        let step = |y0: f64, y1: f64, x0: f64, x1: f64| {
            Function::step(y0, y1, x0, x1).map_err(|source| ForceError::Function {
                at: at.clone(),
                property: "transition",
                source,
            })
        };
        Ok(Self {
            coordinate,
            upper_limit: upper,
            lower_limit: lower,
            upper_stiffness: upper_stiffness / unit,
            lower_stiffness: lower_stiffness / unit,
            damping: damping / unit,
            transition: width,
            computes_dissipation,
            upper_step: step(0.0, 1.0, upper, upper + width)?,
            lower_step: step(1.0, 0.0, lower - width, lower)?,
        })
    }

    /// Force on the coordinate itself [N·m or N] (OpenSim: `calcLimitForce`).
    ///
    /// - `q`: value of the coordinate [rad or m]
    /// - `u`: its speed [rad/s or m/s]
    pub fn limit_force(&self, q: f64, u: f64) -> f64 {
        let (s_up, s_low) = (self.upper_step.value(q), self.lower_step.value(q));
        let upper = -self.upper_stiffness * s_up * (q - self.upper_limit);
        let lower = self.lower_stiffness * s_low * (self.lower_limit - q);
        upper + lower - self.damping * (s_up + s_low) * u
    }

    /// Power that the damping takes \[W\] (OpenSim: `getPowerDissipation`).
    ///
    /// - `q`: value of the coordinate [rad or m]
    /// - `u`: its speed [rad/s or m/s]
    pub fn dissipated_power(&self, q: f64, u: f64) -> f64 {
        self.damping * (self.upper_step.value(q) + self.lower_step.value(q)) * u * u
    }

    /// Energy stored in the stiffness [J] (OpenSim: `computePotentialEnergy`).
    pub fn potential_energy(&self, q: f64) -> f64 {
        let (stiffness, beyond) = if q > self.upper_limit {
            (self.upper_stiffness, q - self.upper_limit)
        } else if q < self.lower_limit {
            (self.lower_stiffness, self.lower_limit - q)
        } else {
            return 0.0;
        };
        if beyond >= self.transition {
            return stiffness * (0.5 * beyond * beyond - self.transition * self.transition / 7.0);
        }
        let x = beyond / self.transition;
        stiffness * x * x * x * (2.0 - 2.5 * x + 6.0 / 7.0 * x * x) * (beyond * beyond)
    }

    /// Generalized force about the coordinate of the cache's unit motion.
    pub fn generalized_force(&self, q: &[f64], u: &[f64], cache: &Cache) -> f64 {
        let coupling = cache.coupling()[self.coordinate.0];
        if coupling == 0.0 { 0.0 } else { coupling * self.limit_force(q[self.coordinate.0], u[self.coordinate.0]) }
    }
}
