//! Tension laws of ligaments and springs along a path.

use super::{ForceError, check_finite};
use crate::functions::Function;
use crate::osim::spec::{ForceKind, ForceSpec};

/// A passive force along a path.
#[derive(Clone, Debug)]
pub enum PathForce {
    /// `Ligament`.
    Ligament(Ligament),
    /// `PathSpring`.
    PathSpring(PathSpring),
}

impl PathForce {
    /// Tension [N], positive when the path is pulled shorter.
    ///
    /// - `length`: length of the path [m]
    /// - `lengthening_speed`: rate of the length [m/s]
    pub fn tension(&self, length: f64, lengthening_speed: f64) -> f64 {
        match self {
            PathForce::Ligament(ligament) => ligament.tension(length),
            PathForce::PathSpring(spring) => spring.tension(length, lengthening_speed),
        }
    }
}

/// OpenSim's `Ligament`: `pcsa_force · force_length_curve(length / resting_length)` beyond the resting length, zero up
/// to it.
#[derive(Clone, Debug)]
pub struct Ligament {
    /// Resting length [m].
    pub resting_length: f64,
    /// Force scale [N].
    pub pcsa_force: f64,
    /// Force per `pcsa_force` as a function of length per `resting_length`.
    pub force_length_curve: Function,
}

impl Ligament {
    pub(super) fn compile(force: &ForceSpec) -> Result<Self, ForceError> {
        let ForceKind::Ligament { resting_length, pcsa_force, force_length_curve, .. } = &force.kind else {
            unreachable!("called for a Ligament only")
        };
        let resting_length = check_finite(&force.at, "resting_length", *resting_length)?;
        if resting_length <= 0.0 {
            let (at, found) = (force.at.clone(), resting_length);
            return Err(ForceError::NotPositive { at, property: "resting_length", found });
        }
        let force_length_curve = Function::compile(force_length_curve).map_err(|source| ForceError::Function {
            at: force.at.clone(),
            property: "force_length_curve",
            source,
        })?;
        let pcsa_force = check_finite(&force.at, "pcsa_force", *pcsa_force)?;
        Ok(Self { resting_length, pcsa_force, force_length_curve })
    }

    /// Tension [N] at a length [m].
    pub fn tension(&self, length: f64) -> f64 {
        if length <= self.resting_length {
            return 0.0;
        }
        self.force_length_curve.value(length / self.resting_length) * self.pcsa_force
    }
}

/// OpenSim's `PathSpring`: `stiffness · stretch · (1 + dissipation · lengthening speed)`, zero when not stretched.
#[derive(Clone, Copy, Debug)]
pub struct PathSpring {
    /// Resting length [m].
    pub resting_length: f64,
    /// Stiffness [N/m].
    pub stiffness: f64,
    /// Dissipation [s/m].
    pub dissipation: f64,
}

impl PathSpring {
    pub(super) fn compile(force: &ForceSpec) -> Result<Self, ForceError> {
        let &ForceKind::PathSpring { resting_length, stiffness, dissipation, .. } = &force.kind else {
            unreachable!("called for a PathSpring only")
        };
        check_finite(&force.at, "resting_length", resting_length)?;
        check_finite(&force.at, "stiffness", stiffness)?;
        check_finite(&force.at, "dissipation", dissipation)?;
        Ok(Self { resting_length, stiffness, dissipation })
    }

    /// Tension [N] at a length [m] and lengthening speed [m/s].
    pub fn tension(&self, length: f64, lengthening_speed: f64) -> f64 {
        let stretch = (length - self.resting_length).max(0.0);
        self.stiffness * stretch * (1.0 + self.dissipation * lengthening_speed)
    }
}
