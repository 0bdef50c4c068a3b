//! `carpus effects`: the catalogue.

use super::diagnose::known;
use crate::cli::args::{EffectsArgs, Global};
use crate::cli::failure::Failure;
use crate::cli::print_result;
use crate::cli::table::table;
use crate::diagnosis::catalogue::CATALOGUE;
use crate::diagnosis::effect::{Description, OsimForm, Role};

/// Runs the command.
///
/// # Errors
/// An unknown identifier.
pub fn run(args: &EffectsArgs, global: &Global) -> Result<(), Failure> {
    let chosen: Vec<&'static Description> = match &args.id {
        Some(id) => vec![known(id)?.description()],
        None => CATALOGUE.iter().map(|e| e.description()).collect(),
    };
    if global.json {
        return print_result(&serde_json::to_string(&chosen).map_err(|e| Failure::Internal(e.to_string()))?);
    }
    match (&args.id, chosen.as_slice()) {
        (Some(_), [one]) => print_result(&details(one)),
        _ => {
            let rows = chosen.iter().map(|d| vec![d.id.to_string(), d.equation.to_string(), form(d).0.to_string()]);
            print_result(&format!(
                "{}\n\ncarpus effects ID tells more.",
                table(&["effect", "equation", "in a model"], 3, rows)
            ))
        }
    }
}

fn form(d: &Description) -> (&'static str, &'static str) {
    match d.osim_form {
        OsimForm::Native(what) => ("native", what),
        OsimForm::Controls(what) => ("controls", what),
        OsimForm::SideCar(what) => ("side-car", what),
    }
}

fn details(d: &Description) -> String {
    let (kind, what) = form(d);
    let mut text = format!("{} ({})\n\n  {}\n\n", d.name, d.id, d.equation);
    for p in d.parameters {
        let role = if p.role == Role::Amplitude { "" } else { ", shape" };
        text.push_str(&format!(
            "  {} [{}]{role}: plausible {} to {}\n      {}\n",
            p.name, p.unit, p.plausible[0], p.plausible[1], p.source
        ));
    }
    text.push_str(&format!(
        "\nShows as     {}\nExposed by   {}\nRivals       {}\n",
        d.signature,
        d.experiment,
        if d.rivals.is_empty() { "none".to_string() } else { d.rivals.join(", ") }
    ));
    text.push_str(&format!("In a model   {kind}: {what}"));
    if let Some(why) = d.unidentifiable {
        text.push_str(&format!("\nUnidentifiable: {why}"));
    }
    text
}
