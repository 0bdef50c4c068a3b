//! Paths that jump, wrap the long way round, or cross no joint.

use super::super::diagnostic::Failure;
use super::super::model::LoadedModel;
use super::super::path_check::{self, PathSample, jump, wound_too_far};
use super::finding::{Check, Finding, Level, shown};
use super::poses::{Poses, Swept, of_muscle};
use carpus_osim::osim::spec::{MuscleIndex, PathPointKind};

/// Halvings of the step across a jump: what is left of it is no steep change.
const HALVINGS: usize = 12;
/// A jump is shorter than this where a fast but continuous change was halved away [m].
const LEAST_JUMP: f64 = 1e-3;

/// Findings about every muscle's path.
///
/// # Errors
/// A path that cannot be compiled.
pub(super) fn findings(loaded: &LoadedModel, poses: &Poses, swept: &[Swept]) -> Result<Vec<Finding>, Failure> {
    let mut findings = Vec::new();
    for (i, muscle) in loaded.file.spec.muscles.iter().enumerate() {
        let own = of_muscle(swept, i);
        findings.extend(long_way(loaded, i, own.clone()));
        let mut jumps = Vec::new();
        for sweep in own.clone() {
            for pair in sweep.samples.windows(2) {
                if jump(&pair[0], &pair[1]).is_some()
                    && let Some(found) = exact_jump(loaded, poses, sweep, [pair[0], pair[1]])?
                {
                    jumps.push((sweep, found));
                }
            }
        }
        findings.extend(jumping(loaded, i, &jumps));
        if own.clone().next().is_none() && !poses.moved.is_empty() && is_still(loaded, i)? {
            let text = format!("no coordinate changes the length of {}", muscle.name);
            let hint = "check which bodies its points are fixed to";
            findings.push(Finding::new(Level::Warning, Check::NoJoint, &muscle.path.at, text, hint));
        }
    }
    Ok(findings)
}

/// Whether no coordinate at all, locked or not, moves the path.
fn is_still(loaded: &LoadedModel, muscle: usize) -> Result<bool, Failure> {
    let paths = loaded.muscle_paths(&[MuscleIndex(muscle)])?;
    let coordinates = (0..loaded.model.n_coordinates()).map(carpus_osim::osim::spec::CoordinateIndex);
    Ok(paths.iter().all(|(path, _)| coordinates.clone().all(|c| !path.depends_on(&loaded.model, c))))
}

/// The jump between two neighbouring values, at the end of halvings: where, and by how much the length changes [m].
fn exact_jump(
    loaded: &LoadedModel,
    poses: &Poses,
    sweep: &Swept,
    mut pair: [PathSample; 2],
) -> Result<Option<(f64, f64)>, Failure> {
    let change = |a: &PathSample, b: &PathSample| {
        (b.length - a.length + 0.5 * (a.moment_arm + b.moment_arm) * (b.value - a.value)).abs()
    };
    for _ in 0..HALVINGS {
        let middle = 0.5 * (pair[0].value + pair[1].value);
        let of_middle = path_check::samples(loaded, &[sweep.muscle], sweep.coordinate, &poses.posture, &[middle])?;
        let Some(&middle) = of_middle.first().and_then(|samples| samples.first()) else { return Ok(None) };
        pair =
            if change(&pair[0], &middle) > change(&middle, &pair[1]) { [pair[0], middle] } else { [middle, pair[1]] };
    }
    let by = pair[1].length - pair[0].length;
    Ok((by.abs() > LEAST_JUMP).then_some((pair[1].value, by)))
}

fn jumping(loaded: &LoadedModel, muscle: usize, jumps: &[(&Swept, (f64, f64))]) -> Option<Finding> {
    let (sweep, (at, by)) = jumps.iter().max_by(|a, b| a.1.1.abs().total_cmp(&b.1.1.abs()))?;
    let spec = &loaded.file.spec.muscles[muscle];
    let coordinate = &loaded.model.coordinates[sweep.coordinate.0].name;
    let more = match jumps.len() - 1 {
        0 => String::new(),
        1 => ", and at 1 more place".to_owned(),
        n => format!(", and at {n} more places"),
    };
    let text = format!(
        "the path of {} jumps by {:.1} mm at {coordinate} = {}{more}",
        spec.name,
        1e3 * by,
        shown(loaded, sweep.coordinate, *at)
    );
    let conditional: Vec<&str> = spec
        .path
        .points
        .iter()
        .filter(|p| matches!(p.kind, PathPointKind::Conditional { .. }))
        .map(|p| p.name.as_str())
        .collect();
    let hint = match conditional.is_empty() {
        true => {
            "a surface is wrapped on its other side from there on: move it, resize it or limit its quadrant".to_owned()
        }
        false => format!("move the conditional points ({}) onto the path without them", conditional.join(", ")),
    };
    let finding = Finding::new(Level::Warning, Check::PathJump, &spec.path.at, text, hint);
    Some(finding.of_size(1e3 * by, "mm").over(loaded, sweep.coordinate))
}

fn long_way<'s>(loaded: &LoadedModel, muscle: usize, own: impl Iterator<Item = &'s Swept> + Clone) -> Option<Finding> {
    let wound = |s: &&PathSample| wound_too_far(s.length, s.polyline);
    let worst = own.flat_map(|sweep| sweep.samples.iter().filter(wound).map(move |sample| (sweep, sample)));
    let (sweep, sample) = worst.max_by(|a, b| (a.1.length - a.1.polyline).total_cmp(&(b.1.length - b.1.polyline)))?;
    let spec = &loaded.file.spec.muscles[muscle];
    let coordinate = &loaded.model.coordinates[sweep.coordinate.0].name;
    let count = sweep.samples.iter().filter(wound).count();
    let from = sweep.samples.iter().find(|s| wound_too_far(s.length, s.polyline)).map_or(sample.value, |s| s.value);
    let to = sweep.samples.iter().rev().find(|s| wound_too_far(s.length, s.polyline)).map_or(sample.value, |s| s.value);
    let text = format!(
        "the path of {} wraps the long way round: {:.3} m at {coordinate} = {}, and {:.3} m straight through its \
         points (at {count} of {} values between {} and {})",
        spec.name,
        sample.length,
        shown(loaded, sweep.coordinate, sample.value),
        sample.polyline,
        sweep.samples.len(),
        shown(loaded, sweep.coordinate, from),
        shown(loaded, sweep.coordinate, to)
    );
    let hint = "limit the surface's quadrant, move it, or use the model where this does not happen (--set holds a \
                coordinate)";
    let finding = Finding::new(Level::Error, Check::LongWay, &spec.path.at, text, hint);
    Some(finding.of_size(1e3 * (sample.length - sample.polyline), "mm").over(loaded, sweep.coordinate))
}
