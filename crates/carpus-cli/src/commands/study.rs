//! `carpus study`: chapters 2 to 4 of the dissertation from one study folder, resumable.

use crate::args::{Global, WholeStudyArgs};
use crate::bars::Bars;
use crate::commands::identify;
use crate::failure::Failure;
use crate::provenance;
use crate::stdout::print_result;
use crate::study_run::{opening, task_done};
use crate::table::tables;
use carpus_session::study::Study;
use carpus_session::whole_study::{Told, WholeStudy};

/// Runs the command.
///
/// # Errors
/// The study, an unknown step, the output folder; after everything else is done, whatever could not be done.
pub fn run(args: &WholeStudyArgs, global: &Global) -> Result<(), Failure> {
    let request = WholeStudy {
        steps: args.steps.clone(),
        starts: args.starts as usize,
        sobol: args.sobol as usize,
        bayesian_evaluations: args.bayesian_evaluations as usize,
        sqp_iterations: u64::from(args.sqp_iterations),
        identify: identify::request_without_priors(&args.identify, global.seed)?,
        priors: args.identify.priors.clone(),
        seed: global.seed,
    };
    request.check()?;
    let study = Study::open_with(&args.study.input.study, opening(&args.study, None))?;
    if let Some(task) = args.task {
        let (arguments, out) = (provenance::arguments_of_task(), &args.study.out);
        return task_done(&study.study_task(&request, task, &arguments, out, &Bars::new(global))?, out, global);
    }
    let done = study.whole_study(&request, &args.study.out, &Bars::new(global))?;
    if global.json {
        print_result(&done.value().to_string())?;
    } else {
        let mut text = String::new();
        for step in &done.steps {
            let told = match &step.told {
                Told::Parts(part) => tables(&part.overview),
                Told::NotRun(why) => format!("not run: {why}"),
            };
            text.push_str(&format!("{}\n{told}\n\n", step.title));
        }
        let (found, computed) = (done.units_found_finished, done.units_computed);
        text.push_str(&format!("{found} units were finished before, {computed} were computed\n"));
        text.push_str(&format!("{}\n", done.report.display()));
        print_result(&text)?;
    }
    if done.failed.is_empty() { Ok(()) } else { Err(Failure::Input(done.failed)) }
}
