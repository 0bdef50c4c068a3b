//! `carpus check`: what can be found in a study before a run.

use std::collections::BTreeSet;

use crate::args::{CheckArgs, Global};
use crate::bars::Bars;
use crate::failure::{Diagnostic, Failure};
use crate::next_steps::listed;
use crate::stdout::print_result;
use crate::study_run::reading;
use crate::table::{fixed, table};
use carpus_session::check::{Check, Checked, Level};
use carpus_session::determines::Determines;
use carpus_session::json;

/// Runs the command.
///
/// # Errors
/// A study with a red finding.
pub fn run(args: &CheckArgs, global: &Global) -> Result<(), Failure> {
    let opening = reading(&args.study, args.allow_unsupported);
    let checked = Check { opening }.run(&args.study.study, &Bars::new(global))?;
    print_result(&if global.json { json::line(&checked)? } else { readable(&checked) })?;
    match checked.red() {
        0 => Ok(()),
        n => Err(Diagnostic::error(format!("{n} red finding{}", if n == 1 { "" } else { "s" })).into()),
    }
}

fn readable(checked: &Checked) -> String {
    let mut text = String::new();
    if !checked.conditions.is_empty() {
        let held: BTreeSet<&String> = checked.conditions.iter().flat_map(|c| c.held.keys()).collect();
        let mut header = vec!["participant", "contraction", "direction", "effort %", "angle °"];
        header.extend(held.iter().map(|name| name.as_str()));
        header.extend(["max. N·m", "fit", "held out", "MVC"]);
        let rows = checked.conditions.iter().map(|c| {
            let efforts = c.efforts_percent.iter().map(|e| fixed(*e, 0)).collect::<Vec<_>>().join(" ");
            let angle = c.angle_deg.map_or(String::new(), |[a, b]| format!("{} to {}", fixed(a, 0), fixed(b, 0)));
            let moment = c.largest_moment_n_m.map_or(String::new(), |m| fixed(m, if m < 1.0 { 2 } else { 1 }));
            let at = |v: &f64| fixed(*v, 0);
            let other = |name: &&String| {
                c.held.get(*name).map_or(String::new(), |v| v.iter().map(at).collect::<Vec<_>>().join(" "))
            };
            let counts = [c.fitted, c.held_out, c.mvc].map(|n| n.to_string());
            let own = [c.participant.clone(), c.contraction.to_owned(), c.direction.to_owned(), efforts, angle];
            own.into_iter().chain(held.iter().map(other)).chain([moment]).chain(counts).collect()
        });
        text.push_str(&table(&header, 3, rows));
        text.push_str("\n\n");
    }
    for finding in &checked.findings {
        let level = match finding.level {
            Level::Green => "green",
            Level::Amber => "AMBER",
            Level::Red => "RED  ",
        };
        let place = finding.place.as_ref().map_or(String::new(), |place| format!("{place}: "));
        let also = match finding.also {
            0 => String::new(),
            n => format!(" (and {n} more)"),
        };
        text.push_str(&format!("{level}  {:<8} {place}{}{also}\n", finding.subject.word(), finding.text));
        if let Some(remedy) = &finding.remedy {
            text.push_str(&format!("                {remedy}\n"));
        }
    }
    checked.determines.iter().for_each(|expected| text.push_str(&expectation(expected)));
    text.trim_end().to_owned() + &listed(&checked.next)
}

/// Effects in a line of the screen.
const IN_A_LINE: usize = 4;

/// What trials can determine at all.
fn expectation(expected: &Determines) -> String {
    let mut text =
        format!("\n{}: what these trials can determine, before a fit, with usual noise\n", expected.participant);
    for (title, determined) in [("determined", true), ("left open", false)] {
        let of = expected.muscles(determined);
        let words = of.iter().map(|(property, muscles)| format!("{property} of {}", muscles.join(", ")));
        let all = words.collect::<Vec<_>>().join("; ");
        text.push_str(&format!("  {title:<12} {}\n", if all.is_empty() { "nothing".to_owned() } else { all }));
    }
    let (hidden, all) = (expected.hidden(), expected.effects_z.len());
    text.push_str(&format!("  effects      {} of {all} would show at a plausible size", all - hidden.len()));
    text.push_str(if hidden.is_empty() { "\n" } else { "; these would not:\n" });
    for some in hidden.chunks(IN_A_LINE) {
        text.push_str(&format!("               {}\n", some.join(", ")));
    }
    text
}
