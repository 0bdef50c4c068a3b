//! Tension laws of ligaments and springs along a path.

use super::error::{ForceError, check_finite};
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{ForceKind, ForceSpec};

/// A passive force along a path.
#[derive(Clone, Debug)]
pub enum PathForce {
    /// `Ligament`.
    Ligament(Ligament),
    /// `PathSpring`.
    PathSpring(PathSpring),
    /// `Blankevoort1991Ligament`.
    Blankevoort1991(Blankevoort1991Ligament),
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
            PathForce::Blankevoort1991(ligament) => ligament.tension(length, lengthening_speed),
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

/// Strain over which damping fades in.
const DAMPED_FROM: f64 = 0.01;

/// OpenSim's `Blankevoort1991Ligament`: quadratic in strain up to the transition strain, linear beyond, damped while it
/// lengthens.
///
/// # References
/// Blankevoort and Huiskes (1991), doi:10.1115/1.2894883; OpenSim `Blankevoort1991Ligament`.
#[derive(Clone, Debug)]
pub struct Blankevoort1991Ligament {
    /// Force per strain beyond the transition [N].
    pub linear_stiffness: f64,
    /// Strain where the toe ends.
    pub transition_strain: f64,
    /// Force per rate of strain [N·s].
    pub damping_coefficient: f64,
    /// Slack length [m].
    pub slack_length: f64,
    fading: Function,
}

impl Blankevoort1991Ligament {
    pub(super) fn compile(force: &ForceSpec) -> Result<Self, ForceError> {
        let &ForceKind::Blankevoort1991Ligament {
            linear_stiffness,
            transition_strain,
            damping_coefficient,
            slack_length,
            ..
        } = &force.kind
        else {
            unreachable!("called for a Blankevoort1991Ligament only")
        };
        let at = &force.at;
        check_finite(at, "linear_stiffness", linear_stiffness)?;
        check_finite(at, "transition_strain", transition_strain)?;
        check_finite(at, "damping_coefficient", damping_coefficient)?;
        if !(check_finite(at, "slack_length", slack_length)? > 0.0) {
            return Err(ForceError::NotPositive { at: at.clone(), property: "slack_length", found: slack_length });
        }
        let fading = Function::step(0.0, 1.0, 0.0, DAMPED_FROM).map_err(|source| ForceError::Function {
            at: at.clone(),
            property: "damping_coefficient",
            source,
        })?;
        Ok(Self { linear_stiffness, transition_strain, damping_coefficient, slack_length, fading })
    }

    /// Strain at a length [m].
    pub fn strain(&self, length: f64) -> f64 {
        length / self.slack_length - 1.0
    }

    /// Elastic tension [N].
    pub fn spring_force(&self, length: f64) -> f64 {
        let (strain, transition) = (self.strain(length), self.transition_strain);
        if strain <= 0.0 {
            0.0
        } else if strain < transition {
            0.5 * self.linear_stiffness / transition * strain * strain
        } else {
            self.linear_stiffness * (strain - transition / 2.0)
        }
    }

    /// Tension by damping [N].
    pub fn damping_force(&self, length: f64, lengthening_speed: f64) -> f64 {
        let strain = self.strain(length);
        if strain <= 0.0 || lengthening_speed <= 0.0 {
            return 0.0;
        }
        self.damping_coefficient * lengthening_speed / self.slack_length * self.fading.value(strain)
    }

    /// Tension [N] at a length [m] and lengthening speed [m/s].
    pub fn tension(&self, length: f64, lengthening_speed: f64) -> f64 {
        (self.spring_force(length) + self.damping_force(length, lengthening_speed)).max(0.0)
    }
}
