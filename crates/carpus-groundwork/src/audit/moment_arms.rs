//! Moment arms that change sign within the range, and those against the muscle's anatomical action.
//!
//! Sizes of published moment arms are not compared: they depend on posture and on how a model's axes lie.

use super::super::model::LoadedModel;
use super::finding::{Check, Finding, Level, shown};
use super::poses::{Poses, Swept};

/// Smaller moment arms have no sure sign [m].
const LEAST_ARM: f64 = 0.002;
/// An arm against anatomy is this long in the middle of the range [m].
const LEAST_CONTRARY: f64 = 0.003;
/// Least number of muscles whose actions are known before one of them is judged by the others.
const LEAST_KNOWN: usize = 3;

/// A joint's motion and the muscles that are known to turn it one way (+1) or the other (−1).
struct Actions {
    /// Beginnings of the names that coordinates of this motion have, in lower case.
    coordinates: &'static [&'static str],
    /// What +1 and −1 are.
    words: [&'static str; 2],
    /// Beginnings of muscles' names, in lower case, letters only.
    muscles: &'static [(&'static str, i8)],
    /// Where this is from.
    source: &'static str,
}

static ACTIONS: [Actions; 3] = [
    Actions {
        coordinates: &["flexion", "wrist_flex"],
        words: ["a flexor", "an extensor"],
        muscles: &[
            ("fcr", 1),
            ("fcu", 1),
            ("pl", 1),
            ("fds", 1),
            ("fdp", 1),
            ("flexcarp", 1),
            ("flexdigit", 1),
            ("palmarislong", 1),
            ("ecrl", -1),
            ("ecrb", -1),
            ("ecu", -1),
            ("edc", -1),
            ("edm", -1),
            ("eip", -1),
            ("extcarp", -1),
            ("extdigit", -1),
        ],
        source: "Loren et al. 1996, J Biomech 29:331; Brand & Hollister 1999, Clinical Mechanics of the Hand",
    },
    Actions {
        coordinates: &["deviation", "wrist_dev"],
        words: ["an ulnar deviator", "a radial deviator"],
        muscles: &[("fcu", 1), ("ecu", 1), ("ecrl", -1), ("ecrb", -1), ("fcr", -1), ("apl", -1), ("epb", -1)],
        source: "Loren et al. 1996, J Biomech 29:331; Brand & Hollister 1999, Clinical Mechanics of the Hand",
    },
    Actions {
        coordinates: &["elbow_flex", "r_elbow_flex", "l_elbow_flex"],
        words: ["an elbow flexor", "an elbow extensor"],
        muscles: &[("bic", 1), ("bra", 1), ("brd", 1), ("brachialis", 1), ("tri", -1), ("anc", -1)],
        source: "Murray, Delp & Buchanan 1995, doi:10.1016/0021-9290(94)00114-J; Ettema et al. 1998, \
                 Hum Mov Sci 17:201",
    },
];

/// Findings about every muscle and every coordinate that moves it.
pub(super) fn findings(loaded: &LoadedModel, poses: &Poses, swept: &[Swept]) -> Vec<Finding> {
    let mut findings: Vec<Finding> = swept.iter().filter_map(|s| sign_change(loaded, s)).collect();
    for c in &poses.moved {
        let name = loaded.model.coordinates[c.0].name.to_lowercase();
        let known = ACTIONS.iter().find(|a| a.coordinates.iter().any(|start| name.starts_with(start)));
        let own: Vec<&Swept> = swept.iter().filter(|s| s.coordinate == *c).collect();
        findings.extend(known.into_iter().flat_map(|actions| contrary(loaded, actions, &own)));
    }
    findings
}

fn sign_change(loaded: &LoadedModel, sweep: &Swept) -> Option<Finding> {
    let arms = || sweep.samples.iter().map(|s| s.moment_arm);
    let (least, most) = (arms().fold(f64::INFINITY, f64::min), arms().fold(f64::NEG_INFINITY, f64::max));
    if least > -LEAST_ARM || most < LEAST_ARM {
        return None;
    }
    let crossing = sweep.samples.windows(2).find(|pair| (pair[0].moment_arm > 0.0) != (pair[1].moment_arm > 0.0))?;
    let spec = &loaded.file.spec.muscles[sweep.muscle.0];
    let coordinate = &loaded.model.coordinates[sweep.coordinate.0].name;
    let text = format!(
        "the moment arm of {} about {coordinate} changes sign at {}: it is {:.1} to {:.1} mm over the range",
        spec.name,
        shown(loaded, sweep.coordinate, crossing[1].value),
        1e3 * least,
        1e3 * most
    );
    let hint = "a muscle may well do so; if it is to act one way only, move its points or surfaces";
    let finding = Finding::new(Level::Note, Check::MomentArmSign, &spec.path.at, text, hint);
    Some(finding.of_size(1e3 * least.abs().min(most), "mm").over(loaded, sweep.coordinate))
}

/// Muscles that turn a joint against what they are known to do, as the other muscles of the model define the direction.
fn contrary(loaded: &LoadedModel, actions: &Actions, own: &[&Swept]) -> Vec<Finding> {
    let action = |s: &&Swept| {
        let name = letters(&loaded.file.spec.muscles[s.muscle.0].name);
        actions.muscles.iter().find(|(start, _)| name.starts_with(start)).map(|(_, action)| *action)
    };
    let known: Vec<(&Swept, i8, f64)> = own
        .iter()
        .filter_map(|s| Some((*s, action(s)?, median(s.samples.iter().map(|s| s.moment_arm).collect())?)))
        .filter(|(.., arm)| arm.abs() > LEAST_ARM)
        .collect();
    // Which way is positive in this model.
    let votes: i32 = known.iter().map(|(_, action, arm)| i32::from(*action) * arm.signum() as i32).sum();
    if known.len() < LEAST_KNOWN || (votes.unsigned_abs() as usize) * 3 < known.len() {
        return Vec::new();
    }
    let is_contrary = |(_, action, arm): &&(&Swept, i8, f64)| {
        f64::from(*action) * arm * f64::from(votes.signum()) < 0.0 && arm.abs() > LEAST_CONTRARY
    };
    let finding = |(sweep, action, arm): &(&Swept, i8, f64)| {
        let spec = &loaded.file.spec.muscles[sweep.muscle.0];
        let word = if *action > 0 { actions.words[0] } else { actions.words[1] };
        let text = format!(
            "{} is {word}, but its moment arm about {} is {:.1} mm in the middle of its values, against those of the \
             other muscles",
            spec.name,
            loaded.model.coordinates[sweep.coordinate.0].name,
            1e3 * arm
        );
        let hint = format!("check on which side of the axis its points lie ({})", actions.source);
        Finding::new(Level::Warning, Check::Action, &spec.path.at, text, hint)
            .of_size(1e3 * arm, "mm")
            .over(loaded, sweep.coordinate)
    };
    known.iter().filter(is_contrary).map(finding).collect()
}

fn letters(name: &str) -> String {
    name.chars().filter(|c| c.is_ascii_alphabetic()).map(|c| c.to_ascii_lowercase()).collect()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
