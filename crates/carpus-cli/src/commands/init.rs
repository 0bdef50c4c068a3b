//! `carpus init`: a study from a laboratory's folder of exported files.

use std::io::{BufRead, IsTerminal, stdin};

use crate::args::{Global, InitArgs};
use crate::failure::{self, Failure};
use crate::next_steps::listed;
use crate::stdout::print_result;
use carpus_report::next_steps::{command, quoted};
use carpus_session::init::{Init, Note, Proposal, Proposed, Questions};
use carpus_session::json;

/// Runs the command.
///
/// # Errors
/// The folder, the model, or a study that is there already.
pub fn run(args: &InitArgs, global: &Global) -> Result<(), Failure> {
    let request = Init {
        folder: args.folder.clone(),
        model: args.model.clone(),
        out: args.out.clone(),
        coordinate: args.coordinate.clone(),
        allow_unsupported: args.allow_unsupported,
    };
    let asks = !args.yes && !global.json && !global.quiet && stdin().is_terminal();
    let questions: &dyn Questions = if asks { &Terminal } else { &Proposed };
    let proposal = request.run(questions)?;
    print_result(&if global.json { json::line(&proposal)? } else { readable(&proposal) })
}

/// Asks on the terminal.
struct Terminal;

impl Terminal {
    fn answer(question: &str) -> String {
        failure::say(question);
        let mut line = String::new();
        // Whoever ends the input takes what is proposed.
        let _ = stdin().lock().read_line(&mut line);
        line.trim().to_owned()
    }
}

impl Questions for Terminal {
    fn choose(&self, question: &str, answers: &[String]) -> usize {
        let list: Vec<String> = answers.iter().enumerate().map(|(i, a)| format!("  {} {a}", i + 1)).collect();
        let given = Self::answer(&format!("{question}\n{}\nNumber, or Enter for 1:", list.join("\n")));
        given.parse::<usize>().ok().filter(|n| (1..=answers.len()).contains(n)).map_or(0, |n| n - 1)
    }

    fn number(&self, question: &str, proposed: f64) -> f64 {
        let given = Self::answer(&format!("{question}\nNumber, or Enter for {proposed}:"));
        given.replace(',', ".").parse().ok().filter(|v: &f64| v.is_finite()).unwrap_or(proposed)
    }
}

fn readable(proposal: &Proposal) -> String {
    let mut text = String::from("Understood\n");
    for (what, of_it) in &proposal.understood {
        text.push_str(&format!("  {what:<12} {of_it}\n"));
    }
    let notes = |title: &str, notes: &[Note]| {
        let lines = notes.iter().map(|note| match note.remedy.as_str() {
            "" => format!("  - {}\n", note.what),
            remedy => format!("  - {}\n    {remedy}\n", note.what),
        });
        if notes.is_empty() { String::new() } else { format!("{title}\n{}", lines.collect::<String>()) }
    };
    text.push_str(&notes("Assumed", &proposal.assumed));
    text.push_str(&notes("Could not be told", &proposal.unknown));
    let study = proposal.study.display();
    let what = "Read what was assumed, then check the study.";
    let next = command(what, format!("carpus check {}", quoted(&study.to_string())));
    format!("{text}\n{study}{}", listed(&[next]))
}
