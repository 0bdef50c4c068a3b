//! `carpus demo`: the bundled study, end to end. The study is part of the program: it runs anywhere.

use std::path::Path;

use super::personalize;
use crate::args::{DemoArgs, Global, StudyArgs, StudyInput};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::stdout::print_result;
use crate::study_run::StudyRun;
use carpus_session::bundled::write_study;
use carpus_session::output::OutputFolder;
use carpus_session::personalize::Personalize;
use carpus_session::result_files::summaries;

/// Runs the command.
///
/// # Errors
/// The output folder.
pub fn run(args: &DemoArgs, global: &Global) -> Result<(), Failure> {
    write_study(&OutputFolder::create(&args.out, &[])?.only_of("demo")?)?;
    let input = StudyInput { study: args.out.join("study/study.toml"), participant: Vec::new(), model: None };
    let study = StudyArgs { input, out: args.out.clone(), allow_unsupported: false };
    let study = StudyRun::prepare(&study, "demo")?;
    let bars = Bars::new(global);
    let mut outcomes = Vec::new();
    let request = Personalize { seed: global.seed, ..Personalize::default() };
    for participant in study.study.participants() {
        let session = participant.load()?.with_progress(&bars);
        failure::print(&session.data.warnings);
        outcomes.push(personalize::personalize(&study, &session, Path::new(""), &request)?);
    }
    study.close("demo")?;
    if global.json {
        return print_result(&summaries(&outcomes));
    }
    let report = args.out.join("report.html");
    let mut text = personalize::readable(&outcomes);
    text.push_str(&format!(
        "\n\npersonalized model  {}\nthe study           {}\n\nopen {} and drag\n",
        args.out.join("model.osim").display(),
        args.out.join("study").display(),
        report.display()
    ));
    print_result(&text)
}
