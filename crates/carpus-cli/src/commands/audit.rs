//! `carpus audit`: what no body has, over the ranges of a model's coordinates.

use crate::args::{AuditArgs, Global};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::next_steps::listed;
use crate::provenance::command_line;
use crate::stdout::print_result;
use carpus_session::audit::{Audit, AuditModel, Check, Finding, Level};
use carpus_session::diagnostic::Diagnostic;
use carpus_session::json;

/// Notes of one kind that are written out before the rest is only counted.
const LISTED: usize = 3;

/// Runs the command.
///
/// # Errors
/// The file cannot be read as a model, a coordinate; the model has errors.
pub fn run(args: &AuditArgs, global: &Global) -> Result<(), Failure> {
    let request = AuditModel {
        coordinates: args.coordinates.clone(),
        set: args.set.clone(),
        command: Some(command_line()),
        ..AuditModel::new(&args.model)
    };
    let (audit, messages) = request.run(&Bars::new(global))?;
    failure::print(&messages);
    print_result(&if global.json { json::readable(&audit)? } else { readable(&audit, args.all) })?;
    match audit.of(Level::Error).count() {
        0 => Ok(()),
        n => {
            let what = if n == 1 { "an error".to_owned() } else { format!("{n} errors") };
            Err(Diagnostic::error(format!("the model has {what}")).in_file(&args.model).into())
        }
    }
}

fn readable(audit: &Audit, all: bool) -> String {
    let mut text = format!(
        "{} ({}): {} muscles over the ranges of {} coordinates\n",
        audit.model,
        audit.file,
        audit.muscles,
        audit.coordinates.len()
    );
    for (level, title) in [(Level::Error, "errors"), (Level::Warning, "warnings"), (Level::Note, "notes")] {
        let found: Vec<&Finding> = audit.of(level).collect();
        let count = if found.is_empty() { "none".to_owned() } else { found.len().to_string() };
        text.push_str(&format!("\n{title}: {count}\n"));
        let mut kinds: Vec<Check> = found.iter().map(|finding| finding.check).collect();
        kinds.sort_unstable();
        kinds.dedup();
        for kind in kinds {
            let of_kind: Vec<&&Finding> = found.iter().filter(|finding| finding.check == kind).collect();
            let shown = if all || level != Level::Note { of_kind.len() } else { LISTED.min(of_kind.len()) };
            text.push_str(&format!("  {}\n", kind.title()));
            for finding in &of_kind[..shown] {
                text.push_str(&format!("    {}:{}: {}: {}\n", audit.file, finding.line, finding.path, finding.text));
            }
            if shown < of_kind.len() {
                text.push_str(&format!("    … and {} more (--all lists them)\n", of_kind.len() - shown));
            }
            let mut hints: Vec<&str> = of_kind[..shown].iter().map(|finding| finding.hint.as_str()).collect();
            hints.dedup();
            text.extend(hints.iter().map(|hint| format!("      hint: {hint}\n")));
        }
    }
    text.trim_end().to_owned() + &listed(&audit.next_steps())
}
