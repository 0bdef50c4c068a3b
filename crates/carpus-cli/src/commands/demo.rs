//! `carpus demo`: the bundled study, end to end. The study is part of the program: it runs anywhere.

use std::path::Path;

use super::personalize;
use crate::args::{DemoArgs, Global, StudyArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::print_result;
use crate::study_run::StudyRun;
use carpus_session::bundled::write_study;
use carpus_session::output::OutputFolder;
use carpus_session::personalize::Personalize;

/// Runs the command.
///
/// # Errors
/// The output folder.
pub fn run(args: &DemoArgs, global: &Global) -> Result<(), Failure> {
    write_study(&OutputFolder::create(&args.out, &[])?.only_of("demo")?)?;
    let args_of_study = StudyArgs {
        study: args.out.join("study/study.toml"),
        participant: Vec::new(),
        model: None,
        out: args.out.clone(),
        allow_unsupported: false,
    };
    let study = StudyRun::prepare(&args_of_study, "demo")?;
    let bars = Bars::new(global);
    let mut outcomes = Vec::new();
    let request = Personalize { seed: global.seed, ..Personalize::default() };
    for participant in study.study.participants() {
        outcomes.push(personalize::personalize(&study, &participant, Path::new(""), &request, &bars)?);
    }
    study.close("demo")?;
    if global.json {
        return print_result(&personalize::json(&outcomes));
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
