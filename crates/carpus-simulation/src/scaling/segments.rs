//! Scale factors of a participant from the lengths of segments.

use super::linear::{LinearScaling, LinearScalingError, ScaleRequest, scale};
use carpus_multibody::multibody::{CompileError, Model};
use carpus_osim::osim::OsimFile;
use carpus_osim::osim::spec::{FrameIndex, ModelSpec};
use carpus_study::study::{FinalMass, ModelLength, Participant, ScalingSettings, nearest};

/// A segment's length in the participant and in the model.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentFactor {
    /// The segment.
    pub segment: String,
    /// The participant's length \[m\].
    pub participant: f64,
    /// The model's length \[m\].
    pub model: f64,
    /// Their ratio: the factor of the segment's bodies.
    pub factor: f64,
}

/// Linear scaling of a model to a participant.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticipantScaling {
    /// The segments that were measured.
    pub segments: Vec<SegmentFactor>,
    /// Segments of the study without a length of this participant: left as they are.
    pub unmeasured: Vec<String>,
    /// What was done to the model.
    pub scaling: LinearScaling,
}

/// Why a model could not be scaled to a participant.
#[derive(Debug, thiserror::Error)]
pub enum ParticipantScalingError {
    /// The study says nothing about scaling.
    #[error("the study does not say which bodies the lengths of segments scale: [scaling] is missing")]
    NoSettings,
    /// None of the participant's lengths is used.
    #[error("participant {participant}: no length of a segment that [scaling.segments] names")]
    NoLengths {
        /// The participant.
        participant: String,
        /// Columns that would serve.
        columns: Vec<String>,
    },
    /// No mass where the study wants one.
    #[error("participant {participant}: mass_kg is needed to scale the model's mass")]
    NoMass {
        /// The participant.
        participant: String,
    },
    /// A name that the model does not have.
    #[error("[scaling.segments.{segment}]: the model has no {what} `{name}`")]
    NotInModel {
        /// The segment.
        segment: String,
        /// Line of study.toml.
        line: usize,
        /// `body`, `marker` or `joint`.
        what: &'static str,
        /// The name.
        name: String,
        /// The most similar name.
        nearest: Option<String>,
    },
    /// Two places that coincide.
    #[error("[scaling.segments.{segment}]: the model's length is {length} m")]
    NoModelLength {
        /// The segment.
        segment: String,
        /// Line of study.toml.
        line: usize,
        /// The length \[m\].
        length: f64,
    },
    /// The skeleton.
    #[error(transparent)]
    Compile(#[from] CompileError),
    /// The scaling itself.
    #[error(transparent)]
    Scaling(#[from] LinearScalingError),
}

impl ParticipantScalingError {
    /// Line of study.toml that it is about.
    pub fn line(&self) -> Option<usize> {
        match self {
            ParticipantScalingError::NotInModel { line, .. } | ParticipantScalingError::NoModelLength { line, .. } => {
                Some(*line)
            }
            _ => None,
        }
    }

    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            ParticipantScalingError::NoSettings => Some(
                "add a table per column <segment>_length_m of participants.csv, e.g.\n  [scaling.segments.forearm]\n  \
                 bodies = [\"ulna\", \"radius\"]\n  joints = [\"elbow\", \"wrist\"]      # or markers = [..], or \
                 model_length_m = 0.25"
                    .to_owned(),
            ),
            ParticipantScalingError::NoLengths { columns, .. } => {
                Some(format!("fill in {} in participants.csv", columns.join(", ")))
            }
            ParticipantScalingError::NotInModel { nearest, .. } => {
                nearest.as_ref().map(|nearest| format!("did you mean `{nearest}`?"))
            }
            ParticipantScalingError::Scaling(error) => error.hint(),
            _ => None,
        }
    }
}

/// Scales a model to a participant by `[scaling]` of the study and writes the scaled values into the file.
///
/// A segment's factor is the participant's length over the model's, along the axes that the study names (all by
/// default), for all of the segment's bodies; bodies of no segment stay.
///
/// # Errors
/// [`ParticipantScalingError`]; the file is then as it was.
pub fn scale_participant(
    file: &mut OsimFile,
    settings: Option<&ScalingSettings>,
    participant: &Participant,
) -> Result<ParticipantScaling, ParticipantScalingError> {
    let settings = settings.ok_or(ParticipantScalingError::NoSettings)?;
    let skeleton = Model::compile(&file.spec)?;
    let mut factors: Vec<(String, [f64; 3])> = Vec::new();
    let mut segments = Vec::new();
    let mut unmeasured = Vec::new();
    for segment in &settings.segments {
        let lookup = Lookup { spec: &file.spec, skeleton: &skeleton, segment: &segment.segment, line: segment.line };
        for body in &segment.bodies {
            lookup.body(body)?;
        }
        let model = lookup.length(&segment.model_length)?;
        let measured = participant.segment_lengths.iter().find(|(name, _)| *name == segment.segment);
        let Some(&(_, length)) = measured else {
            unmeasured.push(segment.segment.clone());
            continue;
        };
        let factor = length / model;
        segments.push(SegmentFactor { segment: segment.segment.clone(), participant: length, model, factor });
        for body in &segment.bodies {
            // Several segments may scale a body along different axes.
            let known = factors.iter().position(|(name, _)| name == body);
            let at = known.unwrap_or_else(|| {
                factors.push((body.clone(), [1.0; 3]));
                factors.len() - 1
            });
            (0..3).filter(|k| segment.axes[*k]).for_each(|k| factors[at].1[k] = factor);
        }
    }
    if segments.is_empty() {
        let columns = settings.segments.iter().map(|s| format!("{}_length_m", s.segment)).collect();
        return Err(ParticipantScalingError::NoLengths { participant: participant.name.clone(), columns });
    }
    let needed = || participant.mass.ok_or(ParticipantScalingError::NoMass { participant: participant.name.clone() });
    let model_mass: f64 = file.spec.bodies.iter().map(|body| body.mass).sum();
    let final_mass = match settings.final_mass {
        FinalMass::FromBodies => None,
        FinalMass::Participant => Some(needed()?),
        FinalMass::InProportionTo(reference) => Some(model_mass * needed()? / reference),
    };
    let request = ScaleRequest { factors, preserve_mass_distribution: settings.preserve_mass_distribution, final_mass };
    let scaling = scale(file, &request)?;
    Ok(ParticipantScaling { segments, unmeasured, scaling })
}

/// Distance of two markers in the default pose \[m\]; the name that the model does not have otherwise.
///
/// # Errors
/// The first of the names that is no marker's.
pub fn marker_distance<'n>(spec: &ModelSpec, skeleton: &Model, names: [&'n str; 2]) -> Result<f64, &'n str> {
    let mut cache = skeleton.new_cache();
    skeleton.update_positions(&skeleton.default_coordinates(), &mut cache);
    let place = |name: &'n str| {
        let marker = spec.markers.iter().find(|marker| marker.name == name).ok_or(name)?;
        Ok(cache.X_GF(skeleton, marker.frame) * marker.location)
    };
    Ok((place(names[0])? - place(names[1])?).norm())
}

/// Names of a segment in the model.
struct Lookup<'a> {
    spec: &'a ModelSpec,
    skeleton: &'a Model,
    segment: &'a str,
    line: usize,
}

impl Lookup<'_> {
    fn missing<'n>(
        &self,
        what: &'static str,
        name: &str,
        names: impl Iterator<Item = &'n str>,
    ) -> ParticipantScalingError {
        ParticipantScalingError::NotInModel {
            segment: self.segment.to_owned(),
            line: self.line,
            what,
            name: name.to_owned(),
            nearest: nearest(name, names),
        }
    }

    fn body(&self, name: &str) -> Result<(), ParticipantScalingError> {
        let names = || std::iter::once("ground").chain(self.spec.bodies.iter().map(|body| body.name.as_str()));
        if names().any(|known| known == name) { Ok(()) } else { Err(self.missing("body", name, names())) }
    }

    /// The model's length in its default pose \[m\].
    fn length(&self, of: &ModelLength) -> Result<f64, ParticipantScalingError> {
        let q = self.skeleton.default_coordinates();
        let mut cache = self.skeleton.new_cache();
        self.skeleton.update_positions(&q, &mut cache);
        let origin = |frame: FrameIndex| cache.X_GF(self.skeleton, frame);
        let length = match of {
            ModelLength::Stated(length) => *length,
            ModelLength::Markers(names) => {
                let known = self.spec.markers.iter().map(|marker| marker.name.as_str());
                let [a, b] = [names[0].as_str(), names[1].as_str()];
                marker_distance(self.spec, self.skeleton, [a, b]).map_err(|name| self.missing("marker", name, known))?
            }
            ModelLength::Joints(names) => {
                let place = |name: &String| {
                    let joint = self.spec.joints.iter().find(|joint| joint.name == *name);
                    let names = self.spec.joints.iter().map(|joint| joint.name.as_str());
                    let joint = joint.ok_or_else(|| self.missing("joint", name, names))?;
                    Ok(origin(joint.child_frame) * nalgebra::Vector3::zeros())
                };
                let [a, b]: [Result<nalgebra::Vector3<f64>, ParticipantScalingError>; 2] =
                    [place(&names[0]), place(&names[1])];
                (a? - b?).norm()
            }
        };
        if length > 1e-6 {
            return Ok(length);
        }
        Err(ParticipantScalingError::NoModelLength { segment: self.segment.to_owned(), line: self.line, length })
    }
}
