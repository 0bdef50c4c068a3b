//! `carpus priors`: what earlier fits say about the next participant, as a table for `carpus identify --priors`.

use crate::args::{Global, PriorsArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::stdout::print_result;
use crate::table::{fixed, table};
use carpus_session::priors::{Known, LearnPriors};

/// Runs the command.
///
/// # Errors
/// No fits; a file that is none; a participant twice; the disk.
pub fn run(args: &PriorsArgs, global: &Global) -> Result<(), Failure> {
    let request = LearnPriors { seed: global.seed, ..LearnPriors::new(args.fits.clone()) };
    let learned = request.run(&Bars::new(global))?;
    let written = learned.write(&args.out)?;
    if global.json {
        return print_result(&learned.value(&written).to_string());
    }
    let header = ["muscle", "property", "× model", "± %", "between persons %", "before ± %", "fits that tell"];
    let text = table(&header, 2, learned.known.iter().map(row));
    print_result(&format!("{text}\n\n{} fits → {}", learned.files.len(), written.display()))
}

fn row(k: &Known) -> Vec<String> {
    let percent = |log_sd: f64| fixed(100.0 * log_sd, 1);
    vec![
        k.muscle.clone(),
        k.property.clone(),
        fixed(k.next.mean.exp(), 3),
        percent(k.next.sd),
        percent(k.next.between),
        percent(k.before),
        k.fits.to_string(),
    ]
}
