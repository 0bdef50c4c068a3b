//! `carpus view`: a model in three dimensions.

use serde_json::json;

use crate::args::{Global, ViewArgs};
use crate::bars::Bars;
use crate::failure::{self, Diagnostic, Failure};
use crate::print_result;
use crate::provenance::command_line;
use carpus_session::view::ViewModel;

/// Runs the command.
///
/// # Errors
/// The model, a coordinate, a folder of geometry, the disk; a browser that cannot be opened.
pub fn run(args: &ViewArgs, global: &Global) -> Result<(), Failure> {
    let request = ViewModel {
        geometry: args.geometry.clone(),
        set: args.set.clone(),
        allow_unsupported: args.model.allow_unsupported,
        command: Some(command_line()),
        ..ViewModel::new(&args.model.model)
    };
    let viewed = request.run(&Bars::new(global))?;
    failure::print(&viewed.warnings);
    let page = viewed.write_to(&args.out)?;
    if args.open {
        let message = |e| Diagnostic::error(format!("cannot be opened: {e}")).in_file(&page);
        open::that_detached(&page).map_err(|e| message(e).hint("open it in a browser by hand"))?;
    }
    if global.json {
        let (found, missing) = (&viewed.geometry.found, &viewed.geometry.missing);
        let value = json!({
            "schema": "carpus.view/1", "file": page.display().to_string(), "muscles": viewed.muscles,
            "geometry": { "found": found, "missing": missing },
        });
        return print_result(&value.to_string());
    }
    failure::say(&format!("{} muscles: open the page and drag", viewed.muscles));
    print_result(&page.display().to_string())
}
