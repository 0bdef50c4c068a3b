//! `carpus paths`: muscle lengths and moment arms over a coordinate.

use crate::args::{Global, PathsArgs};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::provenance::command_line;
use crate::stdout::print_result;
use carpus_session::sweep::{SweepPaths, csv, value};

/// Runs the command.
///
/// # Errors
/// The model, a coordinate, a muscle, or the output folder.
pub fn run(args: &PathsArgs, global: &Global) -> Result<(), Failure> {
    let request = SweepPaths {
        set: args.set.clone(),
        muscles: args.muscles.clone(),
        allow_unsupported: args.model.allow_unsupported,
        seed: global.seed,
        command: Some(command_line()),
        ..SweepPaths::new(&args.model.model, args.sweep.clone())
    };
    let out = args.out.as_ref().map(|dir| request.output_folder(dir)).transpose()?;
    let swept = request.run(&Bars::new(global))?;
    failure::print(&swept.warnings);
    let figure = &swept.figure;
    if let Some(out) = &out {
        let [table, page] = swept.write_to(out)?;
        failure::print(&out.close("paths", &[])?);
        let muscles = figure.muscles.len();
        failure::say(&format!("{muscles} muscles at {} values of {}", figure.values.len(), figure.coordinate));
        if !global.json {
            return print_result(&format!("{}\n{}\n", table.display(), page.display()));
        }
    }
    print_result(&if global.json { value(figure).to_string() } else { csv(figure)? })
}
