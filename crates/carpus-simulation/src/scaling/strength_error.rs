//! Why a model's strength could not be scaled.

use crate::simulation::SimulationError;
use carpus_multibody::muscles::{EquilibriumError, MuscleError};
use carpus_osim::osim::EditError;
use carpus_study::study::StudyErrors;

/// Why a model's strength could not be scaled.
#[derive(Debug, thiserror::Error)]
pub enum StrengthError {
    /// Neither a maximum voluntary moment nor a trial that shows one.
    #[error("participant {participant}: there is no maximum voluntary moment")]
    NoMoment {
        /// The participant.
        participant: String,
    },
    /// The moment is known, the angle at which it was exerted is not.
    #[error("participant {participant}: the posture of the maximum {direction} moment is not known")]
    NoPosture {
        /// The participant.
        participant: String,
        /// `flexion` or `extension`.
        direction: &'static str,
    },
    /// An MVC trial whose moment points the other way.
    #[error(
        "{file}: the largest moment of this maximum {direction} is {found:.3} N·m in the other direction, {along:.3} \
         N·m in its own"
    )]
    WrongDirection {
        /// The trial's file.
        file: String,
        /// `flexion` or `extension`.
        direction: &'static str,
        /// Largest moment in the direction [N·m].
        along: f64,
        /// Largest moment against it [N·m].
        found: f64,
    },
    /// No active muscle acts in a direction.
    #[error("none of the active muscles exerts a {direction} moment about `{coordinate}` at {angle_deg:.1}°")]
    NoMuscles {
        /// `flexion` or `extension`.
        direction: &'static str,
        /// The dynamometer's coordinate.
        coordinate: String,
        /// Its angle [deg].
        angle_deg: f64,
    },
    /// A group whose muscles, all fully active, push the other way.
    #[error("the {direction} group exerts {moment:.4} N·m about `{coordinate}`: no factor turns it round")]
    Opposed {
        /// `flexion` or `extension`.
        direction: &'static str,
        /// The dynamometer's coordinate.
        coordinate: String,
        /// Moment in the group's direction [N·m].
        moment: f64,
    },
    /// The model or its posture.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// A muscle.
    #[error(transparent)]
    Muscle(#[from] MuscleError),
    /// A muscle whose forces do not balance.
    #[error(transparent)]
    Equilibrium(#[from] EquilibriumError),
    /// The study's MVC trials.
    #[error(transparent)]
    Study(#[from] StudyErrors),
    /// The file could not be edited.
    #[error(transparent)]
    Edit(#[from] EditError),
}

impl StrengthError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        Some(match self {
            StrengthError::NoMoment { .. } => "fill in mvc_flexion_n_m and mvc_extension_n_m in participants.csv, or \
                                               list the MVC trials with contraction mvc and their direction in \
                                               trials.csv"
                .to_owned(),
            StrengthError::NoPosture { .. } => {
                "set posture_deg in [strength_scaling] of study.toml, or list the MVC trial in trials.csv".to_owned()
            }
            StrengthError::WrongDirection { .. } => "if flexion is the negative direction of the coordinate, say \
                                                     flexion = \"negative\" in [strength_scaling] of \
                                                     study.toml"
                .to_owned(),
            StrengthError::NoMuscles { .. } | StrengthError::Opposed { .. } => {
                "list the groups yourself: flexors = [..], extensors = [..] in [strength_scaling] of \
                 study.toml"
                    .to_owned()
            }
            StrengthError::Simulation(error) => return error.hint().map(str::to_owned),
            StrengthError::Edit(error) => return error.hint(),
            _ => return None,
        })
    }
}
