//! Pages of the book that are made from the program: the commands from their arguments, the catalogue from the
//! effects' descriptions.

use std::fmt::Write;

use clap::{Arg, Command, CommandFactory};

use super::args::Cli;
use super::help;
use carpus_session::catalogue_pages::{self, MADE, explanation, prose};

/// All pages: path below the book's sources, and text.
pub fn pages() -> Vec<(String, String)> {
    let mut pages = vec![("reference/commands.md".to_string(), commands())];
    pages.extend(catalogue_pages::pages());
    pages
}

fn commands() -> String {
    let mut root = Cli::command();
    root.build();
    let mut text = format!(
        "{MADE}# Commands\n\nResults go to standard output, messages to standard error. Exit codes: 0 done, 1 the \
         input is at \
         fault, 2 Carpus is at fault.\n\n## Options of every command\n\n"
    );
    let global: Vec<&Arg> = root.get_arguments().filter(|a| a.is_global_set()).collect();
    arguments(&mut text, &global);
    for (title, names) in help::GROUPS {
        let found: Vec<&Command> =
            names.iter().filter(|n| **n != "help").filter_map(|n| root.find_subcommand(n)).collect();
        let _ = write!(text, "## {title}\n\n");
        found.into_iter().for_each(|command| command_section(&mut text, command));
    }
    text
}

fn command_section(text: &mut String, command: &Command) {
    let mut shown = command.clone();
    let name = shown.get_bin_name().unwrap_or_else(|| command.get_name()).to_string();
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let usage = shown.render_usage().to_string();
    let usage = usage.trim_start_matches("Usage:").split_whitespace().collect::<Vec<_>>().join(" ");
    let _ = write!(text, "### {name}\n\n{}.\n\n```text\n{usage}\n```\n\n", prose(&about));
    let own: Vec<&Arg> = command
        .get_arguments()
        .filter(|a| !a.is_global_set() && !["help", "version"].contains(&a.get_id().as_str()))
        .collect();
    arguments(text, &own);
    if let Some(after) = command.get_after_help() {
        text.push_str(&explanation(&after.to_string()));
    }
    command.get_subcommands().filter(|c| c.get_name() != "help").for_each(|sub| command_section(text, sub));
}

fn arguments(text: &mut String, arguments: &[&Arg]) {
    if arguments.is_empty() {
        return;
    }
    text.push_str("| | |\n|---|---|\n");
    for argument in arguments {
        let values: Vec<String> =
            argument.get_value_names().unwrap_or_default().iter().map(|v| format!("<{v}>")).collect();
        let takes = argument.get_action().takes_values();
        let value = if takes { values.join(" ") } else { String::new() };
        let word = match (argument.get_long(), argument.get_short()) {
            (Some(long), Some(short)) => format!("-{short}, --{long} {value}"),
            (Some(long), None) => format!("--{long} {value}"),
            (None, Some(short)) => format!("-{short} {value}"),
            (None, None) => value,
        };
        let mut what = argument.get_help().map(ToString::to_string).unwrap_or_default();
        let defaults: Vec<_> = argument.get_default_values().iter().map(|d| d.to_string_lossy()).collect();
        if takes && !defaults.is_empty() {
            let _ = write!(what, " (default: {})", defaults.join(", "));
        }
        let possible: Vec<String> = argument.get_possible_values().iter().map(|v| v.get_name().to_string()).collect();
        if takes && !possible.is_empty() {
            let _ = write!(what, "; one of {}", possible.join(", "));
        }
        let _ = writeln!(text, "| `{}` | {} |", word.trim().replace('|', "\\|"), prose(&what).replace('|', "\\|"));
    }
    text.push('\n');
}
