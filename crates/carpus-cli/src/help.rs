//! The first page of help: commands in groups.

use clap::{Command, CommandFactory};

use super::args::Cli;

/// Longest line of the page, so that it fits a terminal of usual width.
#[cfg(test)]
const WIDTH: usize = 80;
/// Column at which the commands' descriptions begin.
const ABOUT: usize = 20;

/// The groups and their commands, in the order in which they are shown.
pub const GROUPS: [(&str, &[&str]); 6] = [
    ("Start here", &["demo", "init", "check"]),
    (
        "A study",
        &[
            "compare",
            "personalize",
            "identify",
            "diagnose",
            "effect",
            "plan",
            "simulate",
            "study",
            #[cfg(feature = "live")]
            "live",
            "units",
            "merge",
            "synth",
        ],
    ),
    (
        "A model",
        &["info", "audit", "view", "paths", "equilibrium", "effects", "scale", "strength-scale", "upgrade", "run-tool"],
    ),
    ("Recordings", &["dynamometer", "dynamometer-drag", "emg", "c3d"]),
    ("Statistics", &["evaluate", "sensitivity", "ultrasound", "groups", "priors", "power"]),
    ("This program", &["completions", "man", "help"]),
];

/// The command line with commands in groups.
pub fn command() -> Command {
    let command = Cli::command();
    let mut groups = String::new();
    for (title, names) in GROUPS {
        groups.push_str(&format!("{title}:\n"));
        for name in names {
            groups.push_str(&format!("  {name:width$}{}\n", about(&command, name), width = ABOUT - 2));
        }
        groups.push('\n');
    }
    command.help_template(format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{groups}Options:\n{{options}}{{after-help}}"
    ))
}

fn about(command: &Command, name: &str) -> String {
    match command.find_subcommand(name) {
        Some(found) => found.get_about().map(ToString::to_string).unwrap_or_default(),
        // clap adds this one itself when it parses.
        None => "The help of a command, as carpus COMMAND --help".to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_every_command_stands_in_one_group_and_no_other_does() {
        let command = Cli::command();
        let mut shown: Vec<&str> =
            command.get_subcommands().filter(|c| !c.is_hide_set()).map(Command::get_name).collect();
        shown.push("help");
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        shown.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(grouped, shown);
    }

    #[test]
    fn verif_the_first_page_fits_a_terminal_and_holds_groups_and_options() {
        let help = command().term_width(WIDTH).render_help().to_string();
        for part in ["Usage: carpus", "A study:\n  compare ", "Statistics:\n", "--threads", "--version", "Exit codes:"]
        {
            assert!(help.contains(part), "{part} is not in\n{help}");
        }
        let long: Vec<&str> = help.lines().filter(|line| line.chars().count() > WIDTH).collect();
        assert!(long.is_empty(), "{long:#?}");
    }
}
