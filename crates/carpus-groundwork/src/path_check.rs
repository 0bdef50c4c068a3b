//! Warnings about muscle paths that no anatomy has: wound round a surface for decimetres, or jumping between
//! neighbouring values of a coordinate.
//!
//! OpenSim's wrapping makes such paths at some poses (the tangent points end on the far side of a surface), and as the
//! numbers follow OpenSim they are computed all the same. Whoever reads them has to know.

use std::fmt::Write;

use super::diagnostic::{Diagnostic, Failure, Severity};
use super::model::LoadedModel;
use carpus_numerics::printable::number;
use carpus_osim::osim::spec::{CoordinateIndex, MotionType, MuscleIndex};

/// A path is wound too far when it is longer than this much of the straight lines through its points …
const LONGEST_RELATIVE: f64 = 1.5;
/// … and this length [m].
const LONGEST_EXTRA: f64 = 0.1;
/// A path jumps where its change of length differs from moment arm times step by this length [m] …
const JUMP: f64 = 0.002;
/// … and this multiple of the larger moment arm times the step: coarse steps are no jumps.
const JUMP_RELATIVE: f64 = 2.0;
/// Jumps that are written out, per muscle.
const MOST_LISTED: usize = 3;

/// Whether wrapping makes a path absurdly long.
///
/// - `length`, `polyline`: of the path, and of the straight lines through its points [m]
pub fn wound_too_far(length: f64, polyline: f64) -> bool {
    length > LONGEST_RELATIVE * polyline + LONGEST_EXTRA
}

/// A path at one value of the coordinate that is swept.
#[derive(Clone, Copy, Debug)]
pub struct PathSample {
    /// Value of the coordinate [rad or m].
    pub value: f64,
    /// Length of the path [m].
    pub length: f64,
    /// Length of the straight lines through its points [m].
    pub polyline: f64,
    /// Moment arm about the coordinate [m].
    pub moment_arm: f64,
}

/// How much more the length changes between two samples than the moment arms say [m], if that is a jump.
///
/// Moment arm = −d(length)/d(coordinate), so that the change of length is −(mean moment arm) × step.
pub(super) fn jump(before: &PathSample, after: &PathSample) -> Option<f64> {
    let step = after.value - before.value;
    let excess = after.length - before.length + 0.5 * (before.moment_arm + after.moment_arm) * step;
    let arm = before.moment_arm.abs().max(after.moment_arm.abs());
    (excess.abs() > JUMP + JUMP_RELATIVE * arm * step.abs()).then_some(excess)
}

/// Warnings about one muscle's path over a sweep of a coordinate.
pub fn swept(
    loaded: &LoadedModel,
    muscle: MuscleIndex,
    moved: CoordinateIndex,
    samples: &[PathSample],
) -> Vec<Diagnostic> {
    let coordinate = &loaded.model.coordinates[moved.0];
    let show = |v: f64| match coordinate.motion_type {
        MotionType::Translational => format!("{v:.4} m"),
        _ => format!("{:.2}°", v.to_degrees()),
    };
    let mut warnings = Vec::new();
    let wound = samples.iter().filter(|s| wound_too_far(s.length, s.polyline));
    let longest = wound.clone().max_by(|a, b| (a.length - a.polyline).total_cmp(&(b.length - b.polyline)));
    if let Some(longest) = longest {
        let (count, all) = (wound.count(), samples.len());
        let pose = format!("{} = {}", coordinate.name, show(longest.value));
        warnings.push(wound_message(loaded, muscle, longest.length, longest.polyline, &pose, Some((count, all))));
    }
    let jumps: Vec<(&[PathSample], f64)> =
        samples.windows(2).filter_map(|pair| Some((pair, jump(&pair[0], &pair[1])?))).collect();
    if !jumps.is_empty() {
        let name = &loaded.file.spec.muscles[muscle.0].name;
        let mut text = format!("the path of {name} jumps");
        for (i, (pair, by)) in jumps.iter().take(MOST_LISTED).enumerate() {
            let joint = if i == 0 { "" } else { "," };
            let (from, to) = (show(pair[0].value), show(pair[1].value));
            // Writing to a string cannot fail.
            let _ = write!(text, "{joint} by {:.1} mm between {} = {from} and {to}", 1e3 * by, coordinate.name);
        }
        if jumps.len() > MOST_LISTED {
            let _ = write!(text, ", and {} times more", jumps.len() - MOST_LISTED);
        }
        let hint = "conditional path points and wrapping that flips to the far side of a surface do this; forces there \
                    are not physiological";
        warnings.push(warning(loaded, muscle, text).hint(hint));
    }
    warnings
}

/// The warning that a muscle's path is wound too far at a pose.
///
/// - `pose`: in words
/// - `of_sweep`: at how many values of how many this is so
pub fn wound_message(
    loaded: &LoadedModel,
    muscle: MuscleIndex,
    length: f64,
    polyline: f64,
    pose: &str,
    of_sweep: Option<(usize, usize)>,
) -> Diagnostic {
    let name = &loaded.file.spec.muscles[muscle.0].name;
    let extent = of_sweep.map_or(String::new(), |(count, all)| format!(" (so at {count} of {all} values)"));
    let text = format!(
        "the path of {name} is {length:.3} m long at {pose}, but the straight lines through its points only \
         {polyline:.3} m{extent}"
    );
    warning(loaded, muscle, text).hint(
        "wrapping takes the long way round a surface here, as it does in OpenSim; such forces are not physiological",
    )
}

fn warning(loaded: &LoadedModel, muscle: MuscleIndex, text: String) -> Diagnostic {
    let line = loaded.file.spec.muscles[muscle.0].path.at.line;
    Diagnostic { severity: Severity::Warning, ..loaded.message(text) }.at_line(line)
}

/// Values of the coordinate at which a study's paths are checked, over the range of its recorded angles.
const STUDY_VALUES: usize = 241;

/// Warnings about the paths of muscles over a range of the moving coordinate.
///
/// - `posture`: all coordinates, of which `moved` varies
/// - `range`: lowest and highest value [rad or m]
///
/// # Errors
/// A path that cannot be compiled.
pub fn over_range(
    loaded: &LoadedModel,
    muscles: &[MuscleIndex],
    moved: CoordinateIndex,
    posture: &[f64],
    range: [f64; 2],
) -> Result<Vec<Diagnostic>, Failure> {
    let [lower, upper] = range;
    // A held angle is one value.
    let count = if upper > lower { STUDY_VALUES } else { 1 };
    let value = |i: usize| lower + (upper - lower) * i as f64 / (count.max(2) - 1) as f64;
    let values: Vec<f64> = (0..count).map(value).collect();
    let samples = samples(loaded, muscles, moved, posture, &values)?;
    let mut warnings = Vec::new();
    for (muscle, samples) in muscles.iter().zip(&samples) {
        let found = swept(loaded, *muscle, moved, samples);
        // A path that is wound or jumps is too long for that reason.
        if found.is_empty() {
            let longest = samples.iter().map(|s| s.length).fold(0.0, f64::max);
            warnings.extend(overstretched(loaded, *muscle, longest));
            warnings.extend(never_taut(loaded, *muscle, longest));
        }
        warnings.extend(found);
    }
    Ok(warnings)
}

/// A fibre is overstretched where path less tendon is more than this multiple of its optimal length: muscles of the
/// rabbit rupture when they are stretched by 0.7 to 2.3 resting fibre lengths, tendon included (Garrett et al. 1988,
/// doi:10.1177/036354658801600102), and no joint takes them there.
const LONGEST_FIBER: f64 = 3.0;

/// Below this multiple of their optimal length fibres exert no active force (Millard et al. 2013: 0.44).
pub(super) const SHORTEST_ACTIVE_FIBER: f64 = 0.4;

/// The warning that even the longest path leaves the fibres of a muscle too short for any force.
///
/// - `longest`: path over all recorded angles [m]
fn never_taut(loaded: &LoadedModel, muscle: MuscleIndex, longest: f64) -> Option<Diagnostic> {
    let spec = &loaded.file.spec.muscles[muscle.0];
    let length = (longest - spec.tendon_slack_length) / spec.optimal_fiber_length;
    (length < SHORTEST_ACTIVE_FIBER).then(|| {
        let text = format!(
            "the path of {} is {longest:.4} m long at most, and its tendon {} m: with an optimal length of {} m its \
             fibres exert no force",
            spec.name,
            number(spec.tendon_slack_length),
            number(spec.optimal_fiber_length)
        );
        warning(loaded, muscle, text).hint("a point of the path, or a length of the muscle, is not where it should be")
    })
}

/// The warning that a muscle's path leaves to its fibres a length to which none can be stretched.
///
/// - `length`: of the path [m]
pub fn overstretched(loaded: &LoadedModel, muscle: MuscleIndex, length: f64) -> Option<Diagnostic> {
    let spec = &loaded.file.spec.muscles[muscle.0];
    let stretch = (length - spec.tendon_slack_length) / spec.optimal_fiber_length;
    (stretch > LONGEST_FIBER).then(|| {
        let text = format!(
            "the path of {} is {} m long, and its tendon {} m: its fibres are stretched to {stretch:.1} times their \
             optimal length of {} m",
            spec.name,
            number(1e-4 * (1e4 * length).round()),
            number(spec.tendon_slack_length),
            number(spec.optimal_fiber_length)
        );
        warning(loaded, muscle, text).hint("a point of the path, or a length of the muscle, is not where it should be")
    })
}

/// The error that a path is not finite at a pose.
fn not_finite(loaded: &LoadedModel, muscle: MuscleIndex, pose: &str, length: f64, moment_arm: f64) -> Diagnostic {
    let name = &loaded.file.spec.muscles[muscle.0].name;
    let line = loaded.file.spec.muscles[muscle.0].path.at.line;
    let text = format!("the path of {name} has the length {length} m and the moment arm {moment_arm} at {pose}");
    let hint = "one of its points or wrapping surfaces lies where numbers end, or a coordinate does";
    loaded.message(text).at_line(line).hint(hint)
}

/// Each muscle's path at each value [rad or m] of the coordinate.
///
/// # Errors
/// A path that cannot be compiled, or whose length or moment arm is not finite.
pub fn samples(
    loaded: &LoadedModel,
    muscles: &[MuscleIndex],
    moved: CoordinateIndex,
    posture: &[f64],
    values: &[f64],
) -> Result<Vec<Vec<PathSample>>, Failure> {
    let model = &loaded.model;
    let mut paths = loaded.muscle_paths(muscles)?;
    let mut samples = vec![Vec::with_capacity(values.len()); muscles.len()];
    let coordinate = &model.coordinates[moved.0];
    let at = |value: f64| match coordinate.motion_type {
        MotionType::Translational => format!("{} = {value} m", coordinate.name),
        _ => format!("{} = {:.2}°", coordinate.name, value.to_degrees()),
    };
    let mut cache = model.new_cache();
    let mut q = posture.to_vec();
    for &value in values {
        q[moved.0] = value;
        model.satisfy_couplers(&mut q);
        model.update_positions(&q, &mut cache);
        model.update_unit_motion(&q, moved, &mut cache);
        for (((path, geometry), samples), muscle) in paths.iter_mut().zip(&mut samples).zip(muscles) {
            path.update(&q, &cache, geometry);
            let (length, polyline) = (geometry.length(), path.polyline_length(&q, &cache));
            let moment_arm = path.moment_arm(&q, &cache, geometry);
            if !(length.is_finite() && moment_arm.is_finite()) {
                return Err(not_finite(loaded, *muscle, &at(value), length, moment_arm).into());
            }
            samples.push(PathSample { value, length, polyline, moment_arm });
        }
    }
    Ok(samples)
}
