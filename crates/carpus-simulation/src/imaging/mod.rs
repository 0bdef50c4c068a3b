//! Models beside imaging: what resting muscles of a model look like in the postures of ultrasound images, and how far
//! that agrees with what was measured (Jadelis 2025, chapter 4).
//!
//! | measured | of the model | converted for agreement |
//! |---|---|---|
//! | muscle belly length | fibre length at rest | fibre length over the fibre-to-belly ratio |
//! | external tendon length | tendon length at rest | measured length over the external-to-total ratio |
//! | cross-sectional area | maximum isometric force | area times specific tension |
//! | fascicle length, pennation | fibre length, pennation at rest | as they are |
//!
//! Correlations compare quantities as they are; limits of agreement compare them after conversion. Images of one person
//! are counted one by one, as in the dissertation: p-values take them for independent, which flatters them.

use crate::simulation::{HeldCoordinate, SimulationError, skeleton_in_posture};
use carpus_multibody::multibody::Model;
use carpus_multibody::muscles::{EquilibriumError, MuscleError, MuscleModel};
use carpus_multibody::paths::{Path, PathError};
use carpus_numerics::statistics::{
    Agreement, Correlation, LinearRegression, StatisticsError, bland_altman, linear_regression, pearson,
};
use carpus_osim::osim::spec::{ConstraintKind, ConstraintSpec, ModelSpec, MotionType, MuscleSpec};
use carpus_study::study::{ImagingSettings, Study, UltrasoundMeasurement};

/// A resting muscle of a model in an imaging posture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestingMuscle {
    /// Fibre length [m].
    pub fiber_length: f64,
    /// Tendon length [m].
    pub tendon_length: f64,
    /// Pennation angle [rad].
    pub pennation_angle: f64,
    /// `max_isometric_force` [N].
    pub max_isometric_force: f64,
}

/// Why a muscle at rest cannot be found.
#[derive(Debug, thiserror::Error)]
pub enum ImagingError {
    /// The model has no such coordinate.
    #[error("the model has no coordinate `{0}`")]
    Coordinate(String),
    /// The model has no such muscle.
    #[error("the model has no muscle `{0}`")]
    Muscle(String),
    /// A row without the posture it needs.
    #[error("ultrasound.csv:{line}: no posture_deg; expected the angle of {coordinate} while imaged")]
    NoPosture {
        /// Line of the row.
        line: usize,
        /// The dynamometer's coordinate.
        coordinate: String,
    },
    /// A posture outside the coordinate's range.
    #[error("{coordinate} = {value} is outside its range {lower} to {upper} [rad or m]")]
    Range {
        /// The coordinate.
        coordinate: String,
        /// Its value.
        value: f64,
        /// Lower end.
        lower: f64,
        /// Upper end.
        upper: f64,
    },
    /// A posture that the model cannot take.
    #[error(transparent)]
    Posture(#[from] SimulationError),
    /// The muscle's path.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The muscle itself.
    #[error(transparent)]
    Properties(#[from] MuscleError),
    /// No length balances its forces.
    #[error(transparent)]
    Equilibrium(#[from] EquilibriumError),
}

/// The muscle of a measurement as the model has it: at rest, at the study's posture with the coordinates that
/// `[ultrasound]` gives, and the dynamometer's coordinate at the measurement's posture.
///
/// # Errors
/// [`ImagingError`].
pub fn at_rest(
    spec: &ModelSpec,
    skeleton: &Model,
    study: &Study,
    measurement: &UltrasoundMeasurement,
) -> Result<RestingMuscle, ImagingError> {
    let (muscle, length) = path_length(spec, skeleton, study, measurement)?;
    let (state, _) = MuscleModel::from_spec(muscle)?.at_rest(length, study.settings.imaging.activation)?;
    Ok(RestingMuscle {
        fiber_length: state.fiber_length,
        tendon_length: state.tendon_length,
        pennation_angle: state.pennation_angle,
        max_isometric_force: muscle.max_isometric_force,
    })
}

/// The muscle of a measurement in the model, and the length of its path in the posture of the image [m]. Loops of
/// constraints are closed in that posture.
///
/// # Errors
/// [`ImagingError`].
pub fn path_length<'s>(
    spec: &'s ModelSpec,
    skeleton: &Model,
    study: &Study,
    measurement: &UltrasoundMeasurement,
) -> Result<(&'s MuscleSpec, f64), ImagingError> {
    let settings = &study.settings;
    let coordinate = &settings.dynamometer.coordinate;
    let Some(angle) = measurement.posture else {
        return Err(ImagingError::NoPosture { line: measurement.line, coordinate: coordinate.clone() });
    };
    let mut q = skeleton.default_coordinates();
    let mut set = |name: &str, value: &dyn Fn(bool) -> f64| -> Result<(), ImagingError> {
        let index = skeleton.coordinate(name).ok_or_else(|| ImagingError::Coordinate(name.to_string()))?;
        let c = &skeleton.coordinates[index.0];
        let value = value(c.motion_type == MotionType::Translational);
        let [lower, upper] = c.range;
        // Rounding of values written in degrees.
        let slack = 1.8e-3;
        if !(value >= lower - slack && value <= upper + slack) {
            return Err(ImagingError::Range { coordinate: name.to_string(), value, lower, upper });
        }
        q[index.0] = value;
        Ok(())
    };
    let postures = || settings.posture.iter().chain(settings.imaging.posture_of(&measurement.muscle));
    for held in postures() {
        set(&held.coordinate, &|translation| held.value(translation))?;
    }
    set(coordinate, &|_| angle)?;
    skeleton.satisfy_couplers(&mut q);
    let closed;
    let skeleton = if has_loops(spec) {
        let held: Vec<HeldCoordinate> = postures().map(HeldCoordinate::from).collect();
        let moving = skeleton.coordinate(coordinate).map(|c| skeleton.coordinates[c.0].motion_type);
        let value_deg_or_m = if moving == Some(MotionType::Translational) { angle } else { angle.to_degrees() };
        (closed, _, q) = skeleton_in_posture(spec, coordinate, &held, value_deg_or_m)?;
        &closed
    } else {
        skeleton
    };
    let muscle = spec
        .muscles
        .iter()
        .find(|m| m.name == measurement.muscle)
        .ok_or_else(|| ImagingError::Muscle(measurement.muscle.clone()))?;
    let path = Path::compile(&muscle.path, spec, skeleton)?;
    let mut cache = skeleton.new_cache();
    skeleton.update_positions(&q, &mut cache);
    let mut geometry = path.new_geometry();
    path.update(&q, &cache, &mut geometry);
    Ok((muscle, geometry.length()))
}

/// Whether constraints or joints close loops.
fn has_loops(spec: &ModelSpec) -> bool {
    let closes = |c: &ConstraintSpec| c.is_enforced && !matches!(c.kind, ConstraintKind::CoordinateCoupler { .. });
    spec.constraints.iter().any(closes) || !spec.loop_joints().is_empty()
}

/// What is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Fibre length and belly length.
    BellyLength,
    /// Tendon length and external tendon length.
    TendonLength,
    /// Maximum isometric force and cross-sectional area.
    Force,
    /// Fibre length and fascicle length.
    FascicleLength,
    /// Pennation angle.
    Pennation,
}

impl Quantity {
    /// All, in the order of the dissertation's tables.
    pub const ALL: [Quantity; 5] =
        [Quantity::BellyLength, Quantity::TendonLength, Quantity::Force, Quantity::FascicleLength, Quantity::Pennation];

    /// In words: model against measurement.
    pub fn words(self) -> &'static str {
        match self {
            Quantity::BellyLength => "fibre length – muscle belly length",
            Quantity::TendonLength => "tendon length – external tendon length",
            Quantity::Force => "maximum isometric force – cross-sectional area",
            Quantity::FascicleLength => "fibre length – fascicle length",
            Quantity::Pennation => "pennation – pennation",
        }
    }

    /// Unit of differences in tables, and how many of them are in one SI unit.
    pub fn agreement_unit(self) -> (&'static str, f64) {
        match self {
            Quantity::Force => ("N", 1.0),
            Quantity::Pennation => ("deg", 1f64.to_degrees()),
            _ => ("cm", 100.0),
        }
    }

    /// Unit of the measured quantity, and how many of them are in one SI unit.
    pub fn measured_unit(self) -> (&'static str, f64) {
        match self {
            Quantity::Force => ("cm²", 1e4),
            other => other.agreement_unit(),
        }
    }

    /// What was measured, in SI units.
    pub fn measured(self, m: &UltrasoundMeasurement) -> Option<f64> {
        match self {
            Quantity::BellyLength => m.muscle_belly_length,
            Quantity::TendonLength => m.external_tendon_length,
            Quantity::Force => m.cross_sectional_area,
            Quantity::FascicleLength => m.fascicle_length,
            Quantity::Pennation => m.pennation_angle,
        }
    }

    /// The model's counterpart, in SI units.
    pub fn modelled(self, muscle: &RestingMuscle) -> f64 {
        match self {
            Quantity::BellyLength | Quantity::FascicleLength => muscle.fiber_length,
            Quantity::TendonLength => muscle.tendon_length,
            Quantity::Force => muscle.max_isometric_force,
            Quantity::Pennation => muscle.pennation_angle,
        }
    }

    /// Model and measurement made comparable; `None` without the ratio that it takes.
    pub fn comparable(
        self,
        muscle: &str,
        modelled: f64,
        measured: f64,
        settings: &ImagingSettings,
    ) -> Option<[f64; 2]> {
        Some(match self {
            Quantity::BellyLength => [modelled / settings.fiber_to_belly_of(muscle)?, measured],
            Quantity::TendonLength => [modelled, measured / settings.external_to_total_tendon_of(muscle)?],
            Quantity::Force => [modelled, measured * settings.specific_tension],
            Quantity::FascicleLength | Quantity::Pennation => [modelled, measured],
        })
    }
}

/// One measurement beside a model.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Pair {
    /// The participant.
    pub participant: String,
    /// The muscle.
    pub muscle: String,
    /// Posture of the dynamometer's coordinate [rad].
    pub posture: f64,
    /// What is compared.
    pub quantity: Quantity,
    /// Measured, SI.
    pub measured: f64,
    /// Of the model, SI.
    pub modelled: f64,
    /// Model and measurement made comparable, SI.
    pub comparable: Option<[f64; 2]>,
}

/// Pairs of one measurement with a model's muscle.
pub fn pairs(measurement: &UltrasoundMeasurement, muscle: &RestingMuscle, settings: &ImagingSettings) -> Vec<Pair> {
    Quantity::ALL
        .into_iter()
        .filter_map(|quantity| {
            let measured = quantity.measured(measurement)?;
            let modelled = quantity.modelled(muscle);
            Some(Pair {
                participant: measurement.participant.clone(),
                muscle: measurement.muscle.clone(),
                posture: measurement.posture.unwrap_or_default(),
                quantity,
                measured,
                modelled,
                comparable: quantity.comparable(&measurement.muscle, modelled, measured, settings),
            })
        })
        .collect()
}

/// How one quantity of one model case goes with imaging.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// What is compared.
    pub quantity: Quantity,
    /// Number of measurements, and of participants they are from.
    pub measurements: usize,
    /// Participants.
    pub participants: usize,
    /// Pearson's correlation of model with measurement, as they are; in SI units.
    pub correlation: Result<Correlation, StatisticsError>,
    /// Line of the model's value over the measured one; SI units.
    pub regression: Result<LinearRegression, StatisticsError>,
    /// Model minus measurement after conversion; `None` where a ratio is missing for all.
    pub agreement: Option<Result<Agreement, StatisticsError>>,
    /// Measurements without the ratio that conversion takes.
    pub unconverted: usize,
}

/// Compares every quantity for which there are measurements.
pub fn compare(pairs: &[Pair]) -> Vec<Comparison> {
    Quantity::ALL
        .into_iter()
        .filter_map(|quantity| {
            let of: Vec<&Pair> = pairs.iter().filter(|p| p.quantity == quantity).collect();
            if of.is_empty() {
                return None;
            }
            let measured: Vec<f64> = of.iter().map(|p| p.measured).collect();
            let modelled: Vec<f64> = of.iter().map(|p| p.modelled).collect();
            let converted: Vec<[f64; 2]> = of.iter().filter_map(|p| p.comparable).collect();
            let side = |i: usize| converted.iter().map(|c| c[i]).collect::<Vec<_>>();
            let mut people: Vec<&str> = of.iter().map(|p| p.participant.as_str()).collect();
            people.sort_unstable();
            people.dedup();
            Some(Comparison {
                quantity,
                measurements: of.len(),
                participants: people.len(),
                correlation: pearson(&measured, &modelled),
                regression: linear_regression(&measured, &modelled),
                agreement: (!converted.is_empty()).then(|| bland_altman(&side(0), &side(1), 0.95)),
                unconverted: of.len() - converted.len(),
            })
        })
        .collect()
}
