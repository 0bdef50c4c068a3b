//! `carpus power`: power of a test, and the participants it needs.

use crate::cli::args::{Global, PowerArgs, PowerTest};
use crate::cli::failure::{Failure, Message};
use crate::cli::print_result;
use crate::cli::table::fixed;
use crate::statistics::{PowerAnalysis, StatisticsError, Tails, TestDesign};

/// Runs the command.
///
/// # Errors
/// An effect, level or power outside its domain.
pub fn run(args: &PowerArgs, global: &Global) -> Result<(), Failure> {
    let effect = args.effect;
    let design = match args.test {
        PowerTest::PairedT => TestDesign::PairedT { cohen_d_z: effect },
        PowerTest::TwoSampleT => TestDesign::TwoSampleT { cohen_d: effect },
        PowerTest::Correlation => TestDesign::Correlation { r: effect },
        PowerTest::PointBiserial => TestDesign::PointBiserial { r: effect },
    };
    let tails = if args.tails == 1 { Tails::One } else { Tails::Two };
    let analysis = PowerAnalysis { design, alpha: args.alpha, tails };
    let refused = |e: StatisticsError| Failure::from(Message::error(e.to_string()));
    let achieved = args.n.map(|n| analysis.power(n)).transpose().map_err(refused)?;
    let needed = analysis.needed_n(args.power).map_err(refused)?;
    if global.json {
        let result = serde_json::json!({
            "schema": "carpus.power/1",
            "analysis": analysis,
            "n": args.n,
            "achieved_power": achieved,
            "power_asked_for": args.power,
            "needed_n": needed,
        });
        return print_result(&result.to_string());
    }
    let per = if matches!(args.test, PowerTest::TwoSampleT) { "participants per group" } else { "participants" };
    let mut text = String::new();
    if let (Some(n), Some(power)) = (args.n, achieved) {
        text.push_str(&format!("power with {n} {per}: {}\n", fixed(power, 4)));
    }
    text.push_str(&format!("{per} for a power of {}: {needed}", args.power));
    print_result(&text)
}
