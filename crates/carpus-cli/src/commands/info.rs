//! `carpus info`: what is in a model, and what was made of it.

use crate::args::{Global, InfoArgs};
use crate::failure::Failure;
use crate::stdout::print_result;
use crate::table::tables;
use carpus_session::info::Info;
use carpus_session::json;

/// Runs the command.
///
/// # Errors
/// The file cannot be read as a model.
pub fn run(args: &InfoArgs, global: &Global) -> Result<(), Failure> {
    let (info, reason) = Info::read(&args.model)?;
    print_result(&if global.json { json::readable(&info)? } else { readable(&info, args.all) })?;
    reason.map_or(Ok(()), |reason| Err(reason.into()))
}

fn readable(info: &Info, all: bool) -> String {
    let mut parts = vec![info.counts(), tables(&info.tables())];
    if let Some(study) = &info.study {
        let lines: Vec<String> = study.lines().iter().map(|line| format!("  {line}")).collect();
        parts.push(format!("in a study:\n{}", lines.join("\n")));
    }
    parts.push(info.findings(all));
    parts.join("\n\n")
}
