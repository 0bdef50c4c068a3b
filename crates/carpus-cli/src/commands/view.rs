//! `carpus view`: a model in three dimensions.

use crate::args::{Global, ViewArgs};
use crate::bars::Bars;
use crate::failure::{self, Diagnostic, Failure};
use crate::provenance::command_line;
use crate::stdout::print_result;
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
        return print_result(&viewed.value(&page).to_string());
    }
    failure::say(&format!("{} muscles: open the page and drag", viewed.muscles));
    print_result(&page.display().to_string())
}
