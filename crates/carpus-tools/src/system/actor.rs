//! What acts in a model.

use super::super::controls::Controls;
use super::super::correction::Correction;
use super::super::external_force::ExternalForce;
use carpus_multibody::forces::{Actuator, Force, PathForce, PrescribedForce};
use carpus_multibody::muscles::MuscleModel;
use carpus_multibody::paths::Path as MusclePath;

/// A muscle with its path.
#[derive(Clone, Debug)]
pub struct SystemMuscle {
    /// Name.
    pub name: String,
    /// Component path.
    pub path_name: String,
    /// Path.
    pub path: MusclePath,
    /// Its law; `None`: a class whose force is not computed.
    pub law: Option<MuscleModel>,
    /// Class, for messages.
    pub class: String,
    /// Whether it applies its force.
    pub applies_force: bool,
}

/// What acts, in the order of the force set.
#[derive(Clone, Debug)]
pub enum Actor {
    /// A muscle (index).
    Muscle(usize),
    /// A force that needs only coordinates and poses.
    Law(Box<Force>),
    /// A force along a path.
    Along {
        /// Name.
        name: String,
        /// Path.
        path: Box<MusclePath>,
        /// Tension.
        law: Box<PathForce>,
    },
    /// An actuator that follows a control.
    Actuator(Box<Actuator>),
    /// A `PathActuator`.
    PathActuator(Box<PathActuator>),
    /// A force given over time.
    OverTime(Box<PrescribedForce>),
    /// A force from data.
    External(Box<ExternalForce>),
    /// Forces on all coordinates that draw them to a motion.
    Correction(Box<Correction>),
}

impl Actor {
    /// Name.
    pub fn name<'a>(&'a self, muscles: &'a [SystemMuscle]) -> &'a str {
        match self {
            Actor::Muscle(i) => &muscles[*i].name,
            Actor::Law(force) => &force.name,
            Actor::Along { name, .. } => name,
            Actor::Actuator(actuator) => &actuator.name,
            Actor::PathActuator(actuator) => &actuator.name,
            Actor::OverTime(force) => &force.name,
            Actor::External(force) => &force.name,
            Actor::Correction(correction) => &correction.name,
        }
    }

    /// Whether it is a muscle or another actuator.
    pub fn is_actuator(&self) -> bool {
        matches!(self, Actor::Muscle(_) | Actor::Actuator(_) | Actor::PathActuator(_))
    }

    /// Force for a control of 1 and the range of controls, of actuators that are not muscles.
    pub fn control(&self) -> Option<(f64, [f64; 2])> {
        match self {
            Actor::Actuator(actuator) => Some((actuator.optimal_force, actuator.control_range)),
            Actor::PathActuator(actuator) => Some((actuator.optimal_force, actuator.control_range)),
            _ => None,
        }
    }

    /// Force of an actuator that is no muscle, and has no activation, at a time; without a control, none [N or N·m].
    pub fn controlled_force(&self, controls: &Controls, time: f64) -> Option<f64> {
        let name = match self {
            Actor::Actuator(actuator) if actuator.activation.is_none() => &actuator.name,
            Actor::PathActuator(actuator) => &actuator.name,
            _ => return None,
        };
        // OpenSim keeps controls within their bounds only where it looks for them.
        Some(controls.at(name, time).unwrap_or(0.0) * self.control()?.0)
    }
}

/// OpenSim's `PathActuator`: control times optimal force, a tension along a path.
#[derive(Clone, Debug)]
pub struct PathActuator {
    /// Name.
    pub name: String,
    /// Path.
    pub path: MusclePath,
    /// Tension for a control of 1 [N].
    pub optimal_force: f64,
    /// Lowest and highest control.
    pub control_range: [f64; 2],
}
