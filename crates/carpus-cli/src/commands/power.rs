//! `carpus power`: power of a test, and the participants it needs.

use crate::args::{Global, PowerArgs, PowerTest};
use crate::failure::Failure;
use crate::stdout::print_result;
use crate::table::{fixed, table};
use carpus_numerics::statistics::{PowerAnalysis, Tails, TestDesign};
use carpus_session::power::{PUBLISHED, Power, published_value};

/// Runs the command.
///
/// # Errors
/// An effect, level or power outside its domain.
pub fn run(args: &PowerArgs, global: &Global) -> Result<(), Failure> {
    let (Some(test), Some(effect)) = (args.test, args.effect) else { return published(args, global) };
    let design = match test {
        PowerTest::PairedT => TestDesign::PairedT { cohen_d_z: effect },
        PowerTest::TwoSampleT => TestDesign::TwoSampleT { cohen_d: effect },
        PowerTest::Correlation => TestDesign::Correlation { r: effect },
        PowerTest::PointBiserial => TestDesign::PointBiserial { r: effect },
    };
    let tails = if args.tails == 1 { Tails::One } else { Tails::Two };
    let analysis = PowerAnalysis { design, alpha: args.alpha, tails };
    let found = Power { analysis, n: args.n, power: args.power }.run()?;
    if global.json {
        return print_result(&found.value().to_string());
    }
    let per = if matches!(test, PowerTest::TwoSampleT) { "participants per group" } else { "participants" };
    let mut text = String::new();
    if let (Some(n), Some(power)) = (found.n, found.achieved_power) {
        text.push_str(&format!("power with {n} {per}: {}\n", fixed(power, 4)));
    }
    text.push_str(&format!("{per} for a power of {}: {}", args.power, found.needed_n));
    print_result(&text)
}

/// The dissertation's numbers beside what each test gives.
fn published(args: &PowerArgs, global: &Global) -> Result<(), Failure> {
    let (mut text, mut analyses) = (String::new(), Vec::new());
    for p in &PUBLISHED {
        let tests = p.recomputed(args.alpha, args.power)?;
        let mut rows = vec![vec!["published".to_string(), fixed(p.power, 2), p.needed.to_string()]];
        rows.extend(tests.iter().map(|t| vec![t.test.to_string(), fixed(t.power, 3), t.needed_n.to_string()]));
        let columns = ["test", &format!("power with n = {}", p.n), &format!("n for {}", args.power)];
        let title = format!("Jadelis (2025), chapter {}: effect size {}", p.chapter, p.effect);
        text.push_str(&format!("{title}\n{}\n{}\n\n", table(&columns, 1, rows), p.explanation));
        analyses.push((p, tests));
    }
    if global.json {
        return print_result(&published_value(&analyses).to_string());
    }
    print_result(text.trim_end())
}
