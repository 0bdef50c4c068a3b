//! One factor for the forces of each functional group, so that the group reaches the maximum voluntary moment.

use super::strength_error::StrengthError;
use super::strength_target::{StrengthTarget, TargetSource, strength_targets};
use crate::simulation::{Setup, SimulationError, skeleton_in_posture};
use carpus_multibody::muscles::MuscleModel;
use carpus_multibody::paths::Path;
use carpus_osim::osim::OsimFile;
use carpus_osim::osim::spec::{ModelSpec, MotionType, MuscleSpec};
use carpus_study::study::{Direction, Participant, Settings, Study};

/// A moment arm below this is none: no muscle of a limb acts over less [m].
const NO_MOMENT_ARM: f64 = 1e-6;

/// The strength scaling of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct StrengthScaling {
    /// The groups whose maximum moment is known.
    pub groups: Vec<GroupScaling>,
    /// Active muscles of no group: no moment arm in the posture, or a group whose maximum moment is not known.
    pub unscaled: Vec<String>,
}

/// A functional group and its factor.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupScaling {
    /// Flexion or extension.
    pub direction: Direction,
    /// Value of the dynamometer's coordinate [rad or m].
    pub angle: f64,
    /// Moment to reach [N·m].
    pub target: f64,
    /// Where it comes from.
    pub source: TargetSource,
    /// Moment of the group before, in its direction [N·m].
    pub before: f64,
    /// Multiplies `max_isometric_force` of every muscle of the group.
    pub factor: f64,
    /// The muscles.
    pub muscles: Vec<ScaledMuscle>,
}

/// A muscle of a group, fully active and at rest in the posture.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaledMuscle {
    /// Name.
    pub name: String,
    /// Moment arm about the dynamometer's coordinate [m], positive towards the coordinate's positive direction.
    pub moment_arm: f64,
    /// Tendon force before [N].
    pub tendon_force: f64,
    /// `max_isometric_force` before [N].
    pub before: f64,
    /// `max_isometric_force` after [N].
    pub after: f64,
}

/// Scales the strength of a participant's model and writes it into the file.
///
/// # Errors
/// [`StrengthError`]; the file is then as it was.
pub fn strength_scale(
    file: &mut OsimFile,
    study: &Study,
    participant: &Participant,
) -> Result<StrengthScaling, StrengthError> {
    let name = &study.settings.dynamometer.coordinate;
    let coordinate = file.spec.coordinates.iter().find(|c| c.name == *name);
    let is_translation = coordinate.is_some_and(|c| c.motion_type == MotionType::Translational);
    let targets = strength_targets(study, participant, is_translation)?;
    let scaling = strength_scaling(&file.spec, &study.settings, &targets)?;
    scaling.write(file)?;
    Ok(scaling)
}

/// One factor per functional group so that the group's moment equals the maximum voluntary moment:
///
/// ```text
/// factor = M_mvc / |Σ F_i r_i|        F_i: tendon force of muscle i, fully active, fibre and tendon in equilibrium
/// ```
/// in the posture of the maximum contraction. The sum runs over the active muscles whose moment arm points to the
/// group's direction, or those that the study lists. Lengths at equilibrium do not depend on `max_isometric_force`, so
/// the factor is exact. Antagonists and the joint's passive moment are not part of it.
///
/// # Errors
/// A coordinate or muscle that is missing or cannot be computed; a group without muscles.
///
/// # References
/// McFarland et al. (2019), as Jadelis (2025), sections 1.4 and 3, applies it.
pub fn strength_scaling(
    spec: &ModelSpec,
    settings: &Settings,
    targets: &[StrengthTarget],
) -> Result<StrengthScaling, StrengthError> {
    let mut groups = Vec::new();
    for target in targets {
        groups.push(group(spec, settings, target)?);
    }
    // A moment arm that changes its sign between the two postures would put a muscle into both groups.
    keep_the_stronger(&mut groups);
    for (group, target) in groups.iter_mut().zip(targets) {
        finish(group, target, settings)?;
    }
    let is_scaled = |name: &&String| !groups.iter().any(|g| g.muscles.iter().any(|m| m.name == **name));
    let unscaled = settings.active_muscles.iter().filter(is_scaled).cloned().collect();
    Ok(StrengthScaling { groups, unscaled })
}

/// The muscles of a group, before any factor.
fn group(spec: &ModelSpec, settings: &Settings, target: &StrengthTarget) -> Result<GroupScaling, StrengthError> {
    let setup = Setup::from_settings(settings);
    let moving = spec.coordinates.iter().find(|c| c.name == setup.coordinate);
    let is_translation = moving.is_some_and(|c| c.motion_type == MotionType::Translational);
    let value_deg_or_m = if is_translation { target.angle } else { target.angle.to_degrees() };
    let mut held = setup.posture;
    held.extend_from_slice(&target.held);
    // Loops are closed in the posture of this contraction.
    let (skeleton, coordinate, q) = skeleton_in_posture(spec, &setup.coordinate, &held, value_deg_or_m)?;
    let mut cache = skeleton.new_cache();
    skeleton.update_positions(&q, &mut cache);
    skeleton.update_unit_motion(&q, coordinate, &mut cache);

    let positive = settings.strength.flexion_is_positive == (target.direction == Direction::Flexion);
    let sign = if positive { 1.0 } else { -1.0 };
    let listed = match target.direction {
        Direction::Extension => settings.strength.extensors.as_ref(),
        _ => settings.strength.flexors.as_ref(),
    };
    let mut muscles = Vec::new();
    for name in listed.unwrap_or(&settings.active_muscles) {
        let muscle = named(spec, name)?;
        let path = Path::compile(&muscle.path, spec, &skeleton)
            .map_err(|source| SimulationError::Path { owner: name.clone(), source })?;
        let mut geometry = path.new_geometry();
        path.update(&q, &cache, &mut geometry);
        let moment_arm = path.moment_arm(&q, &cache, &geometry);
        if listed.is_none() && sign * moment_arm < NO_MOMENT_ARM {
            continue;
        }
        let tendon_force = MuscleModel::from_spec(muscle)?.at_rest(geometry.length(), 1.0)?.0.tendon_force;
        let before = muscle.max_isometric_force;
        muscles.push(ScaledMuscle { name: name.clone(), moment_arm, tendon_force, before, after: before });
    }
    Ok(GroupScaling {
        direction: target.direction,
        angle: target.angle,
        target: target.moment,
        source: target.source.clone(),
        before: 0.0,
        factor: 1.0,
        muscles,
    })
}

fn named<'s>(spec: &'s ModelSpec, name: &str) -> Result<&'s MuscleSpec, SimulationError> {
    spec.muscles.iter().find(|m| m.name == name).ok_or_else(|| SimulationError::UnknownMuscle {
        name: name.to_owned(),
        available: spec.muscles.iter().map(|m| m.name.clone()).collect(),
    })
}

fn keep_the_stronger(groups: &mut [GroupScaling]) {
    let [first, second] = groups else { return };
    let moment = |group: &GroupScaling, name: &str| {
        group.muscles.iter().find(|m| m.name == name).map(|m| (m.tendon_force * m.moment_arm).abs())
    };
    let both: Vec<(String, bool)> = first
        .muscles
        .iter()
        .filter_map(|m| Some((m.name.clone(), moment(first, &m.name)? >= moment(second, &m.name)?)))
        .collect();
    for (name, stays) in both {
        let loser = if stays { &mut *second } else { &mut *first };
        loser.muscles.retain(|m| m.name != name);
    }
}

/// The factor of a group whose muscles are known.
fn finish(group: &mut GroupScaling, target: &StrengthTarget, settings: &Settings) -> Result<(), StrengthError> {
    let direction = group.direction.word();
    let coordinate = settings.dynamometer.coordinate.clone();
    if group.muscles.is_empty() {
        return Err(StrengthError::NoMuscles { direction, coordinate, angle_deg: group.angle.to_degrees() });
    }
    let positive = settings.strength.flexion_is_positive == (group.direction == Direction::Flexion);
    let sign = if positive { 1.0 } else { -1.0 };
    group.before = sign * group.muscles.iter().map(|m| m.tendon_force * m.moment_arm).sum::<f64>();
    if !(group.before > 0.0) {
        return Err(StrengthError::Opposed { direction, coordinate, moment: group.before });
    }
    group.factor = target.moment / group.before;
    for muscle in &mut group.muscles {
        muscle.after = muscle.before * group.factor;
    }
    Ok(())
}

impl StrengthScaling {
    /// Writes the forces into a model file: one line per muscle changes.
    ///
    /// # Errors
    /// The file could not be edited; it is then as it was.
    pub fn write(&self, file: &mut OsimFile) -> Result<(), StrengthError> {
        let muscles = self.groups.iter().flat_map(|group| &group.muscles);
        let changes: Vec<(&str, &str, f64)> =
            muscles.map(|m| (m.name.as_str(), "max_isometric_force", m.after)).collect();
        Ok(file.set_muscle_properties(&changes)?)
    }
}
