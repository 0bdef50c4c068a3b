//! Lengths of fibres over the ranges, the tendon as long as it is unloaded.

use super::super::model::LoadedModel;
use super::super::path_check::{PathSample, SHORTEST_ACTIVE_FIBER, wound_too_far};
use super::finding::{Check, Finding, Level, shown};
use super::poses::{Poses, Swept, of_muscle};
use carpus_osim::osim::spec::{MuscleSpec, PathPointKind};

/// Normalized fibre lengths over which fibres exert active force: nominally 0.5 to 1.5 (Zajac & Gordon 1989).
const USEFUL: [f64; 2] = [0.5, 1.5];
/// Fibres that are longer everywhere never exert active force: the filaments of man overlap up to 1.6 optimal lengths,
/// by thick filaments of 1.6 µm and I segments of 2.64 µm (Walker & Schrodt 1974, doi:10.1002/ar.1091780107).
const BEYOND_OVERLAP: f64 = 2.0;

/// Findings about every muscle.
pub(super) fn findings(loaded: &LoadedModel, poses: &Poses, swept: &[Swept]) -> Vec<Finding> {
    let muscles = loaded.file.spec.muscles.iter().enumerate();
    muscles.filter_map(|(i, muscle)| of_one(loaded, poses, muscle, of_muscle(swept, i))).collect()
}

/// Fibre length over optimal length, of fixed-width pennation and a tendon at its slack length; 0 where the path is
/// shorter than the tendon.
fn normalized_fiber_length(muscle: &MuscleSpec, path_length: f64) -> f64 {
    let along = path_length - muscle.tendon_slack_length;
    if along <= 0.0 {
        return 0.0;
    }
    along.hypot(muscle.optimal_fiber_length * muscle.pennation_angle_at_optimal.sin()) / muscle.optimal_fiber_length
}

fn of_one<'s>(
    loaded: &LoadedModel,
    poses: &Poses,
    muscle: &MuscleSpec,
    own: impl Iterator<Item = &'s Swept> + Clone,
) -> Option<Finding> {
    // A path that is wound is too long for that reason.
    let usable = |s: &&PathSample| !wound_too_far(s.length, s.polyline);
    let length = |s: &PathSample| normalized_fiber_length(muscle, s.length);
    let mut all: Vec<f64> = own.clone().flat_map(|s| s.samples.iter().filter(usable).map(length)).collect();
    all.sort_by(f64::total_cmp);
    let (&shortest, &longest, &median) = (all.first()?, all.last()?, all.get(all.len() / 2)?);
    let finding = |level, check, text: String, hint: &str, value| {
        Some(Finding::new(level, check, &muscle.at, text, hint).of_size(value, ""))
    };
    if longest < SHORTEST_ACTIVE_FIBER {
        let text = format!(
            "the tendon of {} is always slack or nearly so: fibres reach {longest:.2} of their optimal length at most",
            muscle.name
        );
        let hint = "shorten the tendon (tendon_slack_length), or check the path's points and the unit of lengths";
        return finding(Level::Error, Check::SlackTendon, text, hint, longest);
    }
    if shortest > BEYOND_OVERLAP {
        let cause = far_point(loaded, poses, muscle);
        let text = format!(
            "the fibres of {} are {shortest:.2} to {longest:.2} times their optimal length in all poses{}",
            muscle.name,
            cause.as_ref().map_or(String::new(), |(name, far)| format!("; its point {name} lies {far:.2} m off"))
        );
        let hint = match cause {
            Some(_) => "check the point: its body, and whether it is in mm",
            None => "lengthen the tendon (tendon_slack_length), or check the path's points and the unit of lengths",
        };
        return finding(Level::Error, Check::FiberLength, text, hint, shortest);
    }
    let range = || format!("{shortest:.2} to {longest:.2} over all poses, median {median:.2}");
    if !(USEFUL[0]..=USEFUL[1]).contains(&median) {
        let text = format!("the fibres of {} in optimal lengths: {}", muscle.name, range());
        let hint = "check optimal_fiber_length and tendon_slack_length: fibres work at 0.5 to 1.5";
        return finding(Level::Warning, Check::FiberLength, text, hint, median);
    }
    let excess = |s: &PathSample| (USEFUL[0] - length(s)).max(length(s) - USEFUL[1]);
    let samples = own.flat_map(|sweep| sweep.samples.iter().filter(usable).map(move |s| (sweep, s)));
    let (sweep, worst) = samples.max_by(|a, b| excess(a.1).total_cmp(&excess(b.1))).filter(|w| excess(w.1) > 0.0)?;
    let text = format!(
        "the fibres of {} are {:.2} times their optimal length at {} = {} ({})",
        muscle.name,
        length(worst),
        loaded.model.coordinates[sweep.coordinate.0].name,
        shown(loaded, sweep.coordinate, worst.value),
        range()
    );
    let hint = "forces there follow the ends of the curves; use the model where fibres are within 0.5 to 1.5";
    finding(Level::Note, Check::FiberLength, text, hint, length(worst)).map(|f| f.over(loaded, sweep.coordinate))
}

/// The point that makes a path longer than 1 m, and how far it lies from both its neighbours [m].
fn far_point(loaded: &LoadedModel, poses: &Poses, muscle: &MuscleSpec) -> Option<(String, f64)> {
    const FAR: f64 = 1.0;
    let mut cache = loaded.model.new_cache();
    loaded.model.update_positions(&poses.posture, &mut cache);
    let places: Vec<_> = muscle
        .path
        .points
        .iter()
        .filter_map(|point| match &point.kind {
            PathPointKind::Fixed { location } | PathPointKind::Conditional { location, .. } => {
                Some((&point.name, cache.X_GF(&loaded.model, point.frame) * *location))
            }
            PathPointKind::Moving { .. } => None,
        })
        .collect();
    let distance = |i: usize| {
        let neighbours = [i.checked_sub(1), Some(i + 1)].into_iter().flatten().filter_map(|k| places.get(k));
        neighbours.map(|(_, place)| (place - places[i].1).norm()).fold(f64::INFINITY, f64::min)
    };
    let far = (0..places.len()).map(|i| (i, distance(i))).filter(|(_, d)| d.is_finite() && *d > FAR);
    // Of two that are far from one another the one farther from ground's middle of all others is off.
    let middle = |i: usize| {
        let others = places.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, (_, place))| place);
        others.map(|place| (place - places[i].1).norm()).sum::<f64>()
    };
    far.max_by(|a, b| middle(a.0).total_cmp(&middle(b.0))).map(|(i, d)| (places[i].0.clone(), d))
}
