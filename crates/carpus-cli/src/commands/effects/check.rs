//! `carpus effects check`: an effect of a laboratory's own, checked as those of the catalogue are, and shown.

use super::description::details;
use crate::args::{EffectsCheckArgs, Global};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::stdout::print_result;
use crate::table::table;
use carpus_effects::conformance::Check;
use carpus_effects::effect::Effect;
use carpus_effects::own_effect::OwnEffect;
use carpus_report::significant;
use carpus_session::check_effect::{CheckEffect, Curve, shape};

/// Runs the command.
///
/// # Errors
/// The file, the study, its model and trials; an effect that fails a check.
pub fn run(args: &EffectsCheckArgs, global: &Global) -> Result<(), Failure> {
    let (file, study, participant) = (args.file.clone(), args.study.clone(), args.participant.clone());
    let checked = CheckEffect { file, study, participant }.run(&Bars::new(global))?;
    let text = if global.json {
        checked.value().to_string()
    } else {
        format!(
            "{}\n\n{}\n\nshown on trials of {}: {}\n\n{}",
            details(checked.effect.description()),
            curves(checked.effect),
            checked.shown_on,
            checked.trials.join(", "),
            readable(&checked.checks)
        )
    };
    print_result(&text)?;
    checked.fault().map_or(Ok(()), |fault| Err(fault.into()))
}

fn readable(found: &[Check]) -> String {
    let row = |c: &Check| {
        let mark = if c.passed { "ok" } else { "FAILED" };
        vec![mark.to_owned(), c.what.clone(), c.found.clone(), c.expected.clone()]
    };
    table(&["", "check", "found", "expected"], 4, found.iter().map(row))
}

/// The formula over each of its variables.
fn curves(effect: &OwnEffect) -> String {
    let shape = shape(effect);
    let row = |curve: &Curve| {
        let ends = |[low, high]: [f64; 2]| format!("{} to {}", significant(low, 3), significant(high, 3));
        vec![
            curve.variable.clone(),
            ends(curve.range),
            curve.heights(),
            format!("{} {}", ends(curve.reaches()), shape.unit),
        ]
    };
    let sizes = shape.sizes.iter().map(|(name, size)| format!("{name} = {}", significant(*size, 3)));
    let title = format!("what it looks like at {}", sizes.collect::<Vec<_>>().join(", "));
    match shape.curves.is_empty() {
        true => format!("{title}: {} {} throughout", significant(shape.middle, 3), shape.unit),
        false => {
            format!("{title}\n{}", table(&["over", "from", "", "the formula is"], 4, shape.curves.iter().map(row)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    use carpus_effects::own_effect::{Definition, register};

    #[test]
    fn verif_a_curve_shows_each_variable() {
        let text = "[effect]\nid = \"shown_drag\"\nname = \"Drag\"\nstage = \"joint\"\nformula = \"-b*qdot*(1+q)\"\n\n\
                    [parameters.b]\nunit = \"N·m·s/rad\"\nrole = \"amplitude\"\nplausible = [0, 1]\nsource = \"a \
                    guess\"\n";
        let definition = Definition::parse(text, Path::new("drag.toml")).unwrap();
        let shown = curves(register(definition).unwrap());
        let lines: Vec<&str> = shown.lines().collect();
        assert!(lines.len() == 4 && lines[2].starts_with("qdot") && lines[3].starts_with('q'), "{shown}");
        assert!(lines[2].contains("█") && lines[2].contains("▁"), "{shown}");
    }
}
