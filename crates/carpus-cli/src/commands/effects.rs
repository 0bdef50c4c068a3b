//! `carpus effects`: the catalogue, and effects of a laboratory's own.

mod check;

use serde::Serialize;

use crate::args::{EffectsArgs, Global};
use crate::args_diagnosis::EffectsCommand;
use crate::failure::Failure;
use crate::print_result;
use crate::table::table;
use carpus_diagnosis::catalogue::with_own;
use carpus_diagnosis::effect::Description;
use carpus_diagnosis::own_effect::registered;
use carpus_session::candidates::known;
use carpus_session::effect_words::{form, parameter, stage};

/// Lines of the description of one effect are broken before this column.
const WIDTH: usize = 100;
/// Width of the labels before them.
const LABEL: usize = 14;

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Catalogue<'a> {
    schema: &'static str,
    effects: &'a [&'static Description],
}

/// Runs the command.
///
/// # Errors
/// An unknown identifier.
pub fn run(args: &EffectsArgs, global: &Global) -> Result<(), Failure> {
    if let Some(EffectsCommand::Check(args)) = &args.command {
        return check::run(args, global);
    }
    let chosen: Vec<&'static Description> = match &args.id {
        Some(id) => vec![known(id)?.description()],
        None => with_own().iter().map(|e| e.description()).collect(),
    };
    if global.json {
        let catalogue = Catalogue { schema: "carpus.catalogue/1", effects: &chosen };
        return print_result(&serde_json::to_string(&catalogue).map_err(|e| Failure::Internal(e.to_string()))?);
    }
    match (&args.id, chosen.as_slice()) {
        (Some(_), [one]) => print_result(&details(one)),
        _ => print_result(&overview(&chosen)),
    }
}

fn overview(effects: &[&'static Description]) -> String {
    let rows = effects.iter().map(|d| {
        let note = if d.unidentifiable.is_some() { "no" } else { "" };
        vec![d.id.to_string(), d.name.to_string(), stage(d.stage).to_string(), form(d).0.to_string(), note.to_string()]
    });
    let own: Vec<String> = registered()
        .into_iter()
        .map(|e| format!("\n{}: your own, of {}", e.defined().id, e.defined().file.display()))
        .collect();
    format!(
        "{}\n\n{} effects. native: a component or property of stock OpenSim 4.6 gives its moment; controls: no \
         component \
         of it exists, and it could be baked into the excitations;\nside-car: neither. `effect add` keeps both in \
         effects.toml, beside \
         the model. carpus effects ID tells all about one.{}",
        table(&["effect", "what it is", "acts on", "in a model", "identifiable"], 5, rows),
        effects.len(),
        own.concat()
    )
}

fn details(d: &Description) -> String {
    let mut text = format!("{} ({})\n\n", d.name, d.id);
    let mut line = |label: &str, content: &str| text.push_str(&labelled(label, content));
    line("Equation", d.equation);
    line("Acts on", stage(d.stage));
    d.parameters.iter().for_each(|p| line("Parameter", &parameter(p)));
    line("Shows as", d.signature);
    line("Exposed by", d.experiment);
    line("Rivals", &if d.rivals.is_empty() { "none".to_string() } else { d.rivals.join(", ") });
    let (kind, what) = form(d);
    line("In a model", &format!("{kind}: {what}"));
    let identifiable = match d.unidentifiable {
        Some(why) => format!("no: {why}"),
        None => "where the trials allow it; carpus diagnose says so".to_string(),
    };
    line("Identifiable", &identifiable);
    text.trim_end().to_string()
}

/// A labelled paragraph, its lines indented behind the label.
fn labelled(label: &str, content: &str) -> String {
    let mut text = format!("{label:LABEL$}");
    let mut column = LABEL;
    for (i, word) in content.split_whitespace().enumerate() {
        let width = word.chars().count();
        if i > 0 && column + 1 + width > WIDTH {
            text.push_str(&format!("\n{:LABEL$}", ""));
            column = LABEL;
        } else if i > 0 {
            text.push(' ');
            column += 1;
        }
        text.push_str(word);
        column += width;
    }
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_diagnosis::catalogue::CATALOGUE;

    #[test]
    fn verif_every_effect_is_told_in_full_and_in_lines_that_fit() {
        for d in CATALOGUE.iter().map(|e| e.description()) {
            let text = details(d);
            let flat = text.split_whitespace().collect::<Vec<_>>().join(" ");
            for part in [d.id, d.equation, d.signature, d.experiment, form(d).1] {
                let part = part.split_whitespace().collect::<Vec<_>>().join(" ");
                assert!(flat.contains(&part), "{}: {part}", d.id);
            }
            for p in d.parameters {
                assert!(flat.contains(p.name) && flat.contains(p.unit), "{}.{}", d.id, p.name);
            }
            assert!(text.lines().all(|l| l.chars().count() <= WIDTH), "{text}");
        }
    }
}
