//! Why a model or a trial cannot be simulated.

use carpus_multibody::forces::ForceError;
use carpus_multibody::multibody::CompileError;
use carpus_multibody::muscles::MuscleError;
use carpus_multibody::paths::PathError;
use carpus_osim::functions::FunctionError;
use carpus_study::study::outside_range;

/// Why a model or a trial cannot be simulated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// A muscle of a class that is computed, in a form that is not simulated along recorded motions.
    #[error("{muscle}: not simulated along a recorded motion: {reason}")]
    LawNotSimulated {
        /// Muscle name.
        muscle: String,
        /// Why.
        reason: &'static str,
    },
    /// The skeleton cannot be compiled.
    #[error(transparent)]
    Model(#[from] CompileError),
    /// A force cannot be compiled.
    #[error(transparent)]
    Force(#[from] ForceError),
    /// A muscle cannot be computed.
    #[error(transparent)]
    Muscle(#[from] MuscleError),
    /// A path cannot be compiled.
    #[error("{owner}: {source}")]
    Path {
        /// Muscle or force that owns the path.
        owner: String,
        /// What is wrong.
        source: PathError,
    },
    /// The model has no such coordinate.
    #[error("the model has no coordinate `{name}`; it has {}", .available.join(", "))]
    UnknownCoordinate {
        /// The name asked for.
        name: String,
        /// The model's coordinates.
        available: Vec<String>,
    },
    /// A coupler determines the coordinate, so that it cannot be set.
    #[error("coordinate `{name}` follows {driver} through coupler `{coupler}`; set {driver} instead")]
    DependentCoordinate {
        /// The coordinate.
        name: String,
        /// The coordinates that it follows, as they are named in a sentence.
        driver: String,
        /// The coupler.
        coupler: String,
    },
    /// A value that a coordinate is held at is outside its range.
    #[error(
        "coordinate `{name}` is held at {}",
        outside_range(*value, [*lower, *upper], *is_translation)
    )]
    PostureOutOfRange {
        /// The coordinate.
        name: String,
        /// Whether it is a translation.
        is_translation: bool,
        /// The value [rad or m].
        value: f64,
        /// Least value of the range [rad or m].
        lower: f64,
        /// Greatest value of the range [rad or m].
        upper: f64,
    },
    /// The model has no such muscle.
    #[error("the model has no muscle `{name}`; it has {}", .available.join(", "))]
    UnknownMuscle {
        /// The name asked for.
        name: String,
        /// The model's muscles.
        available: Vec<String>,
    },
    /// An active muscle that the model lets apply no force, so that it would be silent in OpenSim.
    #[error("muscle `{name}` applies no force in the model (<appliesForce> is false, or <isDisabled> true)")]
    AppliesNoForce {
        /// The muscle.
        name: String,
    },
    /// A muscle is listed twice.
    #[error("muscle `{name}` is listed twice")]
    RepeatedMuscle {
        /// The muscle.
        name: String,
    },
    /// Forces of the model that this program does not compute, so that the moment would be wrong.
    #[error("the model has forces that are not computed: {}; the simulated moment would lack them", list(.forces))]
    UnsupportedForces {
        /// Name and class of each.
        forces: Vec<(String, String)>,
    },
    /// Constraints of the model that this program does not enforce, so that the motion would be wrong.
    #[error("the model has constraints that are not enforced: {}; its motion would be wrong", list(.constraints))]
    UnsupportedConstraints {
        /// Name and class of each.
        constraints: Vec<(String, String)>,
    },
    /// Constraints between bodies that cannot hold.
    #[error("the posture of the study does not satisfy the model's constraints {}: {reason}", list(.constraints))]
    Constraint {
        /// Name and class of each.
        constraints: Vec<(String, String)>,
        /// Why.
        reason: String,
    },
    /// Constraints between bodies that hold in several ways.
    #[error(
        "the model's constraints {} do not determine the coordinates of their loops: {}", list(.constraints),
        .free.join(", ")
    )]
    LoopUndetermined {
        /// Name and class of each.
        constraints: Vec<(String, String)>,
        /// Coordinates that are free to satisfy them.
        free: Vec<String>,
    },
    /// Constraints between bodies that cannot hold over the motion of the trials.
    #[error(
        "the model's constraints {} hold for `{coordinate}` from {:.3} to {:.3} rad or m, the trials need {:.3} to \
         {:.3}",
        list(.constraints), .closed[0], .closed[1], .found[0], .found[1]
    )]
    LoopOpen {
        /// Name and class of each.
        constraints: Vec<(String, String)>,
        /// The moving coordinate.
        coordinate: String,
        /// Where they hold [rad or m].
        closed: [f64; 2],
        /// Range of the trials [rad or m].
        found: [f64; 2],
    },
    /// A posture of a trial that sets a coordinate of a loop: loops are closed in the posture of the study.
    #[error(
        "coordinate `{coordinate}` belongs to a loop that the model's constraints {} close: it cannot be held at a \
         value of its own in a single trial",
        list(.constraints)
    )]
    LoopPosture {
        /// Name and class of each.
        constraints: Vec<(String, String)>,
        /// The coordinate.
        coordinate: String,
    },
    /// Moment arms about a coordinate of a loop that is closed for the moving coordinate alone.
    #[error(
        "there are no moment arms about `{coordinate}`: it belongs to a loop that the model's constraints {} close for \
         the dynamometer's coordinate alone",
        list(.constraints)
    )]
    LoopMomentArms {
        /// Name and class of each.
        constraints: Vec<(String, String)>,
        /// The coordinate.
        coordinate: String,
    },
    /// Constraints between bodies that hold over the range of a coordinate, which is empty.
    #[error(
        "the model's constraints {} are to hold over the range of `{coordinate}`, which is {} to {} rad or m: it is \
         empty",
        list(.constraints), .range[0], .range[1]
    )]
    LoopRange {
        /// Name and class of each.
        constraints: Vec<(String, String)>,
        /// The moving coordinate.
        coordinate: String,
        /// Its range [rad or m].
        range: [f64; 2],
    },
    /// Not enough samples to interpolate.
    #[error("{recording}: {found} samples, expected at least {expected}")]
    TooFewSamples {
        /// The recording.
        recording: String,
        /// Samples found.
        found: usize,
        /// Fewest samples.
        expected: usize,
    },
    /// A column of a recording has another length than its time column.
    #[error("{recording}: {column} has {found} samples, time has {expected}")]
    ColumnLength {
        /// The recording.
        recording: String,
        /// The column.
        column: String,
        /// Samples found.
        found: usize,
        /// Samples of the time column.
        expected: usize,
    },
    /// The recording does not have one excitation per active muscle.
    #[error("{recording}: {found} excitations, expected {expected}, one for each active muscle")]
    ExcitationCount {
        /// The recording.
        recording: String,
        /// Excitations found.
        found: usize,
        /// Active muscles.
        expected: usize,
    },
    /// A sample is not a finite number.
    #[error("{recording}: {column} is {value} at sample {sample}, expected a finite number")]
    NotFinite {
        /// The recording.
        recording: String,
        /// The column.
        column: String,
        /// Index of the sample, from 0.
        sample: usize,
        /// Its value.
        value: f64,
    },
    /// Time does not increase.
    #[error("{recording}: time goes from {before} s to {time} s, expected it to increase")]
    TimeNotIncreasing {
        /// The recording.
        recording: String,
        /// A time [s].
        time: f64,
        /// The time of the sample before [s].
        before: f64,
    },
    /// The angle leaves the range of the coordinate.
    #[error(
        "{recording}: at {time} s the angle is {angle} rad, outside the range {lower} to {upper} rad of coordinate \
         `{coordinate}`"
    )]
    AngleOutOfRange {
        /// The recording.
        recording: String,
        /// First time outside [s].
        time: f64,
        /// The angle then [rad or m].
        angle: f64,
        /// The coordinate.
        coordinate: String,
        /// Least value of its range.
        lower: f64,
        /// Greatest value of its range.
        upper: f64,
    },
    /// The motion cannot be interpolated.
    #[error("{recording}: {source}")]
    Motion {
        /// The recording.
        recording: String,
        /// What is wrong.
        source: FunctionError,
    },
    /// A muscle's path has no length that a muscle can have at some angle.
    #[error("{muscle}: the path is {length:.4} m long at {angle:.4} rad, expected a length above 0 m and below 20 m")]
    PathLength {
        /// The muscle or force.
        muscle: String,
        /// Angle of the moving coordinate [rad or m].
        angle: f64,
        /// Length found [m].
        length: f64,
    },
    /// A parameter is not allowed.
    #[error("{muscle}: {property} is {value}, expected {expected}")]
    InvalidParameter {
        /// The muscle.
        muscle: String,
        /// OpenSim property name.
        property: &'static str,
        /// The value.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
    /// The covariance of the noise of a trial has no Cholesky factor.
    #[error("the noise of the trials cannot be estimated: its covariance is not positive definite")]
    NoiseCovariance,
    /// The number of parameter sets differs from that of the muscles.
    #[error("{found} parameter sets, expected {expected}, one for each active muscle")]
    ParameterCount {
        /// Sets given.
        found: usize,
        /// Active muscles.
        expected: usize,
    },
    /// Activation changes faster than the samples by orders of magnitude.
    #[error(
        "{recording}: {muscle}: activation cannot be followed after {time} s: its time constants, \
         {activation_time_constant} s and {deactivation_time_constant} s, are too short for the steps of time"
    )]
    ActivationTooFast {
        /// The recording.
        recording: String,
        /// The muscle.
        muscle: String,
        /// Time up to which it was followed [s].
        time: f64,
        /// Time constant of activation [s].
        activation_time_constant: f64,
        /// Time constant of deactivation [s].
        deactivation_time_constant: f64,
    },
    /// A result that is no number, or one far beyond what can be computed with.
    #[error(
        "{recording}: {}{quantity} is {value} at {time} s (coordinate at {angle} rad or m); expected a number that can \
         be computed with",
        of_muscle(.muscle)
    )]
    NotFiniteResult {
        /// The recording.
        recording: String,
        /// The muscle, if it is of one.
        muscle: Option<String>,
        /// What is not finite, with its unit.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// Time [s].
        time: f64,
        /// The moving coordinate then [rad or m].
        angle: f64,
    },
    /// The fibre of a muscle cannot be integrated further.
    #[error("{recording}: {muscle}: no fibre length balances the forces after {time} s")]
    NoBalance {
        /// The recording.
        recording: String,
        /// The muscle.
        muscle: String,
        /// Time [s].
        time: f64,
    },
}

impl SimulationError {
    /// Whether loops that constraints close are the reason.
    pub fn is_about_loops(&self) -> bool {
        matches!(
            self,
            SimulationError::Constraint { .. }
                | SimulationError::LoopUndetermined { .. }
                | SimulationError::LoopOpen { .. }
                | SimulationError::LoopPosture { .. }
                | SimulationError::LoopMomentArms { .. }
                | SimulationError::LoopRange { .. }
        )
    }

    /// The muscle that it is about, if it is about one.
    pub fn muscle(&self) -> Option<&str> {
        match self {
            SimulationError::NotFiniteResult { muscle, .. } => muscle.as_deref(),
            SimulationError::PathLength { muscle, .. }
            | SimulationError::InvalidParameter { muscle, .. }
            | SimulationError::NoBalance { muscle, .. }
            | SimulationError::LawNotSimulated { muscle, .. }
            | SimulationError::Muscle(MuscleError::NotComputed { muscle, .. })
            | SimulationError::Muscle(MuscleError::InMuscle { muscle, .. }) => Some(muscle),
            _ => None,
        }
    }

    /// What a person may do about it, where there is something.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            SimulationError::UnsupportedForces { .. } | SimulationError::UnsupportedConstraints { .. } => {
                Some("remove or disable them in the model, or allow unsupported components to leave them out")
            }
            SimulationError::Constraint { .. } => {
                Some("change [posture_deg] in study.toml, or remove the constraint from the model (isEnforced: false)")
            }
            SimulationError::LoopUndetermined { .. } => {
                Some("hold some of them in [posture_deg] of study.toml, so that the constraints determine the others")
            }
            SimulationError::LoopPosture { .. } => Some(
                "hold it in [posture_deg] of study.toml for the whole study; if it follows the dynamometer's \
                 coordinate, leave it out",
            ),
            SimulationError::LoopRange { .. } => Some("widen the coordinate's range in the model"),
            SimulationError::AngleOutOfRange { .. } => {
                Some("check the angle's unit and zero; if it is right, widen the coordinate's range in the model")
            }
            SimulationError::NoBalance { .. } => {
                Some("check the muscle's tendon slack length and optimal fibre length against its path length")
            }
            SimulationError::ActivationTooFast { .. } => {
                Some("usual time constants are 0.01 s and 0.04 s; are they in another unit?")
            }
            SimulationError::PathLength { .. } => Some(
                "lengths of a model are in metres, not millimetres; else one of the path's points or wrapping surfaces \
                 lies far outside of the body",
            ),
            SimulationError::AppliesNoForce { .. } => {
                Some("let it apply its force in the model, or leave it out of [muscles] active in study.toml")
            }
            SimulationError::NotFiniteResult { .. } => Some(
                "a number of the model is too large or too small to be computed with: check those of this muscle and \
                 the bodies",
            ),
            SimulationError::PostureOutOfRange { .. } => Some("posture values are degrees (metres for translations)"),
            SimulationError::Muscle(MuscleError::NotComputed { .. }) | SimulationError::LawNotSimulated { .. } => Some(
                "leave it out of [muscles] active in study.toml, or make it a muscle of another class in the model; \
                 `carpus info` lists the classes",
            ),
            _ => None,
        }
    }
}

fn of_muscle(name: &Option<String>) -> String {
    name.as_ref().map(|name| format!("{name}: ")).unwrap_or_default()
}

fn list(items: &[(String, String)]) -> String {
    items.iter().map(|(name, class)| format!("{name} ({class})")).collect::<Vec<_>>().join(", ")
}
