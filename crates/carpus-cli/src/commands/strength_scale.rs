//! `carpus strength-scale`: forces of flexors and extensors scaled to the maximum voluntary moments.

use std::path::Path;

use crate::args::{Global, StrengthScaleArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::study_run::StudyRun;
use crate::table::{fixed, table};
use carpus_session::strength::{ParticipantStrength, StrengthScale};

/// Runs the command.
///
/// # Errors
/// The study, its models and MVC trials, or the output folder.
pub fn run(args: &StrengthScaleArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study, "strength-scale")?;
    let request = StrengthScale { linear: args.linear, seed: global.seed };
    let done = study.study.strength_scale(&request, &study.out, &Bars::new(global))?;
    let text = if global.json { done.value.to_string() } else { readable(&done.participants, study.out.path()) };
    study.print("strength-scale", &text, done.failed)
}

fn readable(outcomes: &[ParticipantStrength], folder: &Path) -> String {
    let header = ["participant", "group", "muscles", "angle °", "before N·m", "MVC N·m", "factor"];
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.groups.iter().map(move |g| {
            let muscles: Vec<&str> = g.muscles.iter().map(|m| m.muscle.as_str()).collect();
            vec![
                outcome.participant.clone(),
                g.direction.word().to_string(),
                muscles.join(" "),
                fixed(g.angle_deg, 1),
                fixed(g.before_n_m, 3),
                fixed(g.target_n_m, 3),
                fixed(g.factor, 4),
            ]
        })
    });
    let mut text = table(&header, 3, rows);
    text.push_str("\n\n");
    for outcome in outcomes {
        text.push_str(&format!("{}\n", folder.join(&outcome.model).display()));
    }
    text
}
