//! `carpus ultrasound`: resting muscles of models beside ultrasound images.

use crate::args::{Global, UltrasoundArgs};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::provenance::command_line;
use crate::stdout::print_result;
use crate::table::tables;
use carpus_session::json;
use carpus_session::ultrasound::{CompareImages, agreement, write};

/// Runs the command.
///
/// # Errors
/// The study, a model, or the output folder.
pub fn run(args: &UltrasoundArgs, global: &Global) -> Result<(), Failure> {
    let request = CompareImages {
        study: args.study.clone(),
        cases: args.case.clone(),
        allow_unsupported: args.allow_unsupported,
        seed: global.seed,
        command: Some(command_line()),
    };
    let study = request.read()?;
    let out = request.output_folder(&study, &args.out)?;
    let result = request.run(&study, &Bars::new(global))?;
    write(&out, &result)?;
    failure::print(&out.close("ultrasound", &[])?);
    if global.json {
        return print_result(&json::line(&result)?);
    }
    print_result(&format!("{}\n\n{}\n", tables(&[agreement(&result.cases)]), args.out.join("report.html").display()))
}
