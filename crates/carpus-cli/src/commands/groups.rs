//! `carpus groups`: what differs between groups of participants, or before and after.

use crate::args::{Global, GroupsArgs};
use crate::failure::{self, Failure};
use crate::provenance::command_line;
use crate::stdout::print_result;
use crate::table::table;
use carpus_session::groups::{CompareGroups, GroupComparison};
use carpus_session::study::{Opening, Study};

/// Runs the command.
///
/// # Errors
/// The study; participants of one group and visit; results that are not of the study; the output folder.
pub fn run(args: &GroupsArgs, global: &Global) -> Result<(), Failure> {
    let (participants, command) = (args.participant.clone(), Some(command_line()));
    let study = Study::open_with(&args.study, Opening { participants, command, ..Opening::default() })?;
    let request = CompareGroups { results: args.results.clone(), tables: args.values.clone(), seed: global.seed };
    let found = study.compare_groups(&request)?;
    failure::print(&study.write_groups(&found, &args.out)?);
    if global.json {
        return print_result(&found.value()?.to_string());
    }
    let (header, words) = GroupComparison::HEADER;
    let warnings: Vec<_> = found.warnings.iter().map(|w| failure::Diagnostic::warning(w.clone())).collect();
    failure::print(&warnings);
    let mut text = table(&header, words, found.rows());
    for left in &found.left_out {
        text.push_str(&format!("\nnot compared: {}: {}", left.quantity, left.reason));
    }
    print_result(&format!("{text}\n\n{}\n\n{}", found.in_words(), args.out.join("groups.html").display()))
}
