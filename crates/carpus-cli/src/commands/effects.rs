//! `carpus effects`: the catalogue, and effects of a laboratory's own.

mod check;
mod description;

use self::description::details;
use crate::args::{EffectsArgs, EffectsCommand, Global};
use crate::failure::Failure;
use crate::stdout::print_result;
use crate::table::table;
use carpus_effects::catalogue::with_own;
use carpus_effects::effect::Description;
use carpus_effects::own_effect::registered;
use carpus_session::candidates::known;
use carpus_session::effect_words::{Catalogue, form, stage};
use carpus_session::json;

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
        return print_result(&json::line(&Catalogue::of(&chosen))?);
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
