//! `carpus effect remove`: a step back in the ledger.

use std::path::Path;

use super::readable;
use crate::args::Global;
use crate::args_diagnosis::EffectRemoveArgs;
use crate::failure::{Diagnostic, Failure};
use crate::print_result;
use carpus_report::ledger::Ledger;
use carpus_report::results::Results;
use carpus_report::{render_report, render_waterfall};
use carpus_session::effect_steps::remove_file;
use carpus_session::output::OutputFolder;

/// Runs the command.
///
/// # Errors
/// A folder without a ledger; a step that is not there; the disk.
pub fn run(args: &EffectRemoveArgs, global: &Global) -> Result<(), Failure> {
    let file = args.folder.join("results.json");
    let text = carpus_numerics::regular_file::read_text(&file).map_err(|e| {
        Diagnostic::error(format!("cannot be read: {e}"))
            .in_file(&file)
            .hint("give the folder of a participant that carpus effect add wrote")
    })?;
    let mut results = Results::parse(&text).map_err(|e| Diagnostic::error(e.to_string()).in_file(&file))?;
    let Some(ledger) = &mut results.ledger else {
        let message = Diagnostic::error("no effect was added here: there is no ledger").in_file(&file);
        return Err(message.hint("give the folder of a participant that carpus effect add wrote").into());
    };
    let to = match (args.to, ledger.current) {
        (Some(to), _) => to,
        (None, 0) => {
            return Err(Diagnostic::error("the model is as it was given: nothing to remove").in_file(&file).into());
        }
        (None, now) => now - 1,
    };
    if to >= ledger.steps.len() {
        let text = format!("there is no step {to}: the last one is {}", ledger.steps.len() - 1);
        return Err(Diagnostic::error(text).in_file(&file).into());
    }
    ledger.current = to;
    let (out, inside) = OutputFolder::of_earlier_run(&args.folder, "results.json")?;
    restore(&out, &inside, ledger)?;
    let shown = readable(ledger);
    let json = serde_json::to_string_pretty(&ledger).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
    out.write(inside.join("ledger.json"), json.as_bytes())?;
    out.write(inside.join("report.html"), render_report(&results).as_bytes())?;
    if let Some(figure) = render_waterfall(&results) {
        out.write(inside.join("error.svg"), figure.as_bytes())?;
    }
    out.write(inside.join("results.json"), results.to_json().as_bytes())?;
    out.close_changed("effect remove")?;
    print_result(if global.json { &json } else { &shown })
}

/// Puts the model of the step that is now current in place.
fn restore(out: &OutputFolder, inside: &Path, ledger: &Ledger) -> Result<(), Failure> {
    let Some(step) = ledger.now() else { return Ok(()) };
    let read = |name: &str| {
        let file = out.path().join(inside).join(name);
        carpus_numerics::regular_file::read(&file)
            .map_err(|e| Failure::from(Diagnostic::error(format!("cannot be read: {e}")).in_file(&file)))
    };
    let model = read(&step.model)?;
    let side_car = step.side_car.as_deref().map(read).transpose()?;
    out.write(inside.join("model.osim"), &model)?;
    match side_car {
        Some(text) => out.write(inside.join("effects.toml"), &text).map(|_| ()),
        None => remove_file(&out.path().join(inside).join("effects.toml")),
    }
}
