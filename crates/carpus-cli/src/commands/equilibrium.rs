//! `carpus equilibrium`: fibre and tendon lengths, forces and moments of muscles at rest in a posture.

use crate::args::{EquilibriumArgs, Global};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::stdout::print_result;
use crate::table::tables;
use carpus_session::equilibrium::{Equilibrium, csv};
use carpus_session::text_tables::of_equilibrium;

/// Runs the command.
///
/// # Errors
/// The model, a coordinate, a muscle, or the output file.
pub fn run(args: &EquilibriumArgs, global: &Global) -> Result<(), Failure> {
    let request = Equilibrium {
        model: args.model.model.clone(),
        set: args.set.clone(),
        activation: args.activation,
        moment_about: args.moment_about.clone(),
        muscles: args.muscles.clone(),
        allow_unsupported: args.model.allow_unsupported,
    };
    let csv_file = args.csv.as_ref().map(|file| request.target(file)).transpose()?;
    let found = request.run(&Bars::new(global))?;
    failure::print(&found.warnings);
    if let Some((folder, name)) = &csv_file {
        folder.write(name, csv(&found.muscles)?.as_bytes())?;
    }
    if global.json {
        return print_result(&found.value().to_string());
    }
    print_result(&tables(&[of_equilibrium(&found.muscles)]))
}
