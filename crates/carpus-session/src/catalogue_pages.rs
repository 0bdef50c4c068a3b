//! Pages of the book about the catalogue of effects, made of the effects' descriptions.

use std::fmt::Write;

use super::effect_words::{form, parameter, stage};
use carpus_effects::catalogue::CATALOGUE;
use carpus_effects::effect::Description;

/// Stands at the top of every page that is made here.
pub const MADE: &str = "<!-- Made by `cargo run -- book --out docs/src`. -->\n\n";

/// The pages: path below the book's sources, and text.
pub fn pages() -> Vec<(String, String)> {
    let mut pages = vec![("catalogue/index.md".to_string(), catalogue())];
    pages.extend(CATALOGUE.iter().map(|e| {
        let description = e.description();
        (format!("catalogue/{}.md", description.id), effect(description))
    }));
    pages
}

/// Text with the characters written out that Markdown would take for its own. Code in back quotes stays.
pub fn prose(text: &str) -> String {
    let escaped = |part: &str| part.replace('<', "&lt;").replace('*', "\\*").replace('[', "\\[").replace(']', "\\]");
    let parts = text.split('`').enumerate();
    parts.map(|(i, part)| if i % 2 == 1 { format!("`{part}`") } else { escaped(part) }).collect()
}

fn catalogue() -> String {
    let mut text = format!(
        "{MADE}# Catalogue of effects\n\n{} physical effects that a model may lack, each with its equation, plausible \
         sizes, \
         signature and rivals. `carpus effects` prints this list, `carpus effects ID` one of them, `--json` all of it \
         for \
         programs. [`carpus diagnose`](../tutorial/missing-physics.md) asks which of them the recordings call for.\n\n\
         In a model, *native* means that a component or property of stock OpenSim 4.6 gives the effect; *controls* \
         that no \
         component does, and that it could be computed into the excitations; *side-car* neither. `carpus effect add` \
         keeps the \
         last two in `effects.toml` beside the model.\n\n| effect | acts on | in a model | identifiable \
         |\n|---|---|---|---|\n",
        CATALOGUE.len()
    );
    for d in CATALOGUE.iter().map(|e| e.description()) {
        let identifiable = if d.unidentifiable.is_some() { "no" } else { "yes" };
        let _ = writeln!(
            text,
            "| [{}]({}.md) | {} | {} | {identifiable} |",
            prose(d.name),
            d.id,
            stage(d.stage),
            form(d).0
        );
    }
    text
}

fn effect(d: &Description) -> String {
    let mut text = format!("{MADE}# {}\n\n`{}`, acts on: {}.\n\n", prose(d.name), d.id, stage(d.stage));
    let equation = d.equation.split_whitespace().collect::<Vec<_>>().join(" ");
    let _ = write!(text, "## Equation\n\n```text\n{}\n```\n\n## Parameters\n\n", equation.replace("; ", ";\n"));
    d.parameters.iter().for_each(|p| {
        let _ = writeln!(text, "- {}", prose(&parameter(p)));
    });
    let _ = write!(text, "\n## How it shows\n\n{}.\n\n", capital(d.signature));
    let _ = write!(text, "Exposed by: {}.\n\n## Rivals\n\n", prose(d.experiment));
    let rivals: Vec<String> = d.rivals.iter().map(|id| rival(id)).collect();
    match rivals.is_empty() {
        true => text.push_str("None in the catalogue.\n"),
        false => rivals.iter().for_each(|r| {
            let _ = writeln!(text, "- {r}");
        }),
    }
    let (kind, what) = form(d);
    let _ = write!(text, "\n## In a model\n\n{}: {}.\n\n## Identifiable\n\n", capital(kind), prose(what));
    match d.unidentifiable {
        Some(why) => {
            let _ = writeln!(text, "No: {}.", prose(why));
        }
        None => text.push_str("Where the trials allow it; `carpus diagnose` says so.\n"),
    }
    text
}

/// A rival with its page; one that is no effect of the catalogue is named as it is.
fn rival(id: &str) -> String {
    match CATALOGUE.iter().map(|e| e.description()).find(|d| d.id == id) {
        Some(d) => format!("[{}]({}.md)", prose(d.name), d.id),
        None => prose(id),
    }
}

fn capital(text: &str) -> String {
    let mut characters = text.chars();
    let first: String = characters.next().into_iter().flat_map(char::to_uppercase).collect();
    prose(&format!("{first}{}", characters.as_str()))
}

/// The explanation below a command's options: indented lines are code, the others paragraphs.
pub fn explanation(after: &str) -> String {
    let mut text = String::new();
    let mut is_code = false;
    for line in after.lines() {
        let indented = line.starts_with("  ");
        if indented && !is_code {
            text.push_str("\n```text\n");
        } else if !indented && is_code {
            text.push_str("```\n\n");
        }
        is_code = indented;
        match line.strip_prefix("  ") {
            Some(code) => text.push_str(code),
            None => text.push_str(&prose(line)),
        }
        text.push('\n');
    }
    text.push_str(if is_code { "```\n\n" } else { "\n" });
    text
}
