//! `carpus identify`: intervals of muscle parameters, what the data leave open, and which trial would narrow it down.

use std::path::Path;

use crate::args::{Global, IdentifyArgs, IdentifyOptions};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::next_steps::listed;
use crate::study_run::StudyRun;
use crate::table::tables;
use carpus_report::identifiability::{CombinationResult, IdentifiabilityResult};
use carpus_report::next_steps::after_identification;
use carpus_session::identify::{Identify, Priors, properties_named};
use carpus_session::json;
use carpus_session::loading::Purpose;
use carpus_session::text_tables::of_identification;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the priors, or the output folder.
pub fn run(args: &IdentifyArgs, global: &Global) -> Result<(), Failure> {
    let request = request(&args.options, global.seed)?;
    let study = StudyRun::prepare(&args.study, "identify")?;
    let bars = Bars::new(global);
    let outcomes = study.study.each("identifying", &bars, |participant| {
        let session = participant.load_for(Purpose::Identification)?;
        let identified = session.identify(&request)?;
        failure::print(&identified.warnings);
        identified.write_to(&study.out, Path::new(&participant.about().name))?;
        Ok(identified.result)
    })?;
    let text = match global.json {
        true => json::line(&outcomes.done)?,
        false => outcomes.done.iter().map(|r| readable(r, &study)).collect::<Vec<_>>().join("\n\n"),
    };
    study.print("identify", &text, outcomes.failed)
}

/// What is asked on the command line.
///
/// # Errors
/// An unknown property; the priors.
fn request(options: &IdentifyOptions, seed: u64) -> Result<Identify, Failure> {
    let priors = options.priors.as_deref().map(Priors::read).transpose()?;
    Ok(Identify { priors, ..request_without_priors(options, seed)? })
}

/// As [`request`], before the priors are read.
///
/// # Errors
/// An unknown property.
pub fn request_without_priors(options: &IdentifyOptions, seed: u64) -> Result<Identify, Failure> {
    let properties = properties_named(&options.properties)?;
    let (tie, level, draws) = (options.tie.clone(), options.level, options.draws as usize);
    Ok(Identify { seed, properties, tie, priors: None, level, draws })
}

fn readable(r: &IdentifiabilityResult, study: &StudyRun) -> String {
    let mut text = tables(&[of_identification(r)]);
    text.push_str("\n[ ]: the bound, which the data do not reach\n\nthe data fix            known to\n");
    let line = |c: &CombinationResult| format!("  ±{:.2} %  {}\n", c.sd_percent, c.words);
    r.combinations.iter().filter(|c| c.share_from_data >= 0.5).take(3).for_each(|c| text.push_str(&line(c)));
    text.push_str("the data leave free     known to\n");
    r.combinations.iter().rev().filter(|c| c.share_from_data < 0.5).take(3).for_each(|c| text.push_str(&line(c)));
    text.push_str("\nnext trial              intervals shrink by\n");
    for t in r.next_trials.iter().take(3) {
        text.push_str(&format!(
            "  {:.1} %  {} (most: {} {:.0} %)\n",
            t.mean_shrinkage_percent, t.trial, t.most, t.most_percent
        ));
    }
    text.push_str(&format!("\n{}", study.report_of(&r.participant)));
    text + &listed(&after_identification(r))
}
