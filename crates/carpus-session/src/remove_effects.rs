//! A step back in the ledger of effects that were added to a model.

use std::path::{Path, PathBuf};

use super::diagnostic::{Diagnostic, Failure};
use super::effect_steps::remove_file;
use super::output::OutputFolder;
use carpus_report::ledger::Ledger;
use carpus_report::results::Results;
use carpus_report::{render_report, render_waterfall};

/// A step back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RemoveEffects {
    /// The participant's folder among the results of `carpus effect add`.
    pub folder: PathBuf,
    /// The step to go to; without it the one before the current one.
    pub to: Option<usize>,
}

impl RemoveEffects {
    /// Puts the model of the step in place, with its ledger and report. The ledger comes back.
    ///
    /// # Errors
    /// A folder without a ledger; a step that is not there; the disk.
    pub fn run(&self) -> Result<Ledger, Failure> {
        let file = self.folder.join("results.json");
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
        let to = match (self.to, ledger.current) {
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
        let (out, inside) = OutputFolder::of_earlier_run(&self.folder, "results.json")?;
        restore(&out, &inside, ledger)?;
        let now = ledger.clone();
        out.write(inside.join("ledger.json"), text_of(&now)?.as_bytes())?;
        out.write(inside.join("report.html"), render_report(&results).as_bytes())?;
        if let Some(figure) = render_waterfall(&results) {
            out.write(inside.join("error.svg"), figure.as_bytes())?;
        }
        out.write(inside.join("results.json"), results.to_json().as_bytes())?;
        out.close_changed("effect remove")?;
        Ok(now)
    }
}

/// The ledger as it is written.
///
/// # Errors
/// None that input can cause.
pub fn text_of(ledger: &Ledger) -> Result<String, Failure> {
    Ok(serde_json::to_string_pretty(ledger).map_err(|e| Failure::Internal(e.to_string()))? + "\n")
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
