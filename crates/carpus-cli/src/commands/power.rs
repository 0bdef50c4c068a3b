//! `carpus power`: power of a test, and the participants it needs.

use crate::args::{Global, PowerArgs, PowerTest};
use crate::failure::{Diagnostic, Failure};
use crate::print_result;
use crate::table::{fixed, table};
use carpus_numerics::statistics::{PowerAnalysis, StatisticsError, Tails, TestDesign};

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
    let refused = |e: StatisticsError| Failure::from(Diagnostic::error(e.to_string()));
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
    let per = if matches!(test, PowerTest::TwoSampleT) { "participants per group" } else { "participants" };
    let mut text = String::new();
    if let (Some(n), Some(power)) = (args.n, achieved) {
        text.push_str(&format!("power with {n} {per}: {}\n", fixed(power, 4)));
    }
    text.push_str(&format!("{per} for a power of {}: {needed}", args.power));
    print_result(&text)
}

/// One of the dissertation's power analyses.
struct Published {
    chapter: u8,
    effect: f64,
    n: usize,
    power: f64,
    needed: usize,
    /// Tests that give one of its numbers, or that the question asks for.
    tests: [(&'static str, TestDesign, Tails); 4],
    explanation: &'static str,
}

const PUBLISHED: [Published; 2] = [
    Published {
        chapter: 3,
        effect: 0.72,
        n: 10,
        power: 0.67,
        needed: 25,
        tests: [
            ("paired t, one tail", TestDesign::PairedT { cohen_d_z: 0.72 }, Tails::One),
            ("paired t, two tails", TestDesign::PairedT { cohen_d_z: 0.72 }, Tails::Two),
            ("two groups, one tail (n per group)", TestDesign::TwoSampleT { cohen_d: 0.72 }, Tails::One),
            ("two groups, two tails (n per group)", TestDesign::TwoSampleT { cohen_d: 0.72 }, Tails::Two),
        ],
        explanation: "The power is that of the paired test with one tail (0.67 from d = 0.715, which also rounds to 0.72). The 25 is \
                      the size of each of two independent groups; every participant was measured under both conditions, so the \
                      paired test applies, which needs fewer.",
    },
    Published {
        chapter: 4,
        effect: 0.64,
        n: 5,
        power: 0.42,
        needed: 11,
        tests: [
            ("point biserial correlation, one tail", TestDesign::PointBiserial { r: 0.64 }, Tails::One),
            ("point biserial correlation, two tails", TestDesign::PointBiserial { r: 0.64 }, Tails::Two),
            ("correlation of a bivariate normal, one tail", TestDesign::Correlation { r: 0.64 }, Tails::One),
            ("correlation of a bivariate normal, two tails", TestDesign::Correlation { r: 0.64 }, Tails::Two),
        ],
        explanation: "Both numbers are of G*Power's point biserial model with one tail, the first of its correlation tests, which takes \
                      one variable for fixed. Both variables were measured: the bivariate normal model applies, which has less power \
                      and needs more.",
    },
];

/// The dissertation's numbers beside what each test gives.
fn published(args: &PowerArgs, global: &Global) -> Result<(), Failure> {
    let refused = |e: StatisticsError| Failure::from(Diagnostic::error(e.to_string()));
    let (mut text, mut json) = (String::new(), Vec::new());
    for p in &PUBLISHED {
        let mut rows = vec![vec!["published".to_string(), fixed(p.power, 2), p.needed.to_string()]];
        let mut tests = Vec::new();
        for (name, design, tails) in p.tests {
            let analysis = PowerAnalysis { design, alpha: args.alpha, tails };
            let power = analysis.power(p.n).map_err(refused)?;
            let needed = analysis.needed_n(args.power).map_err(refused)?;
            rows.push(vec![name.to_string(), fixed(power, 3), needed.to_string()]);
            tests.push(serde_json::json!({ "test": name, "power": power, "needed_n": needed }));
        }
        let columns = ["test", &format!("power with n = {}", p.n), &format!("n for {}", args.power)];
        let title = format!("Jadelis (2025), chapter {}: effect size {}", p.chapter, p.effect);
        text.push_str(&format!("{title}\n{}\n{}\n\n", table(&columns, 1, rows), p.explanation));
        json.push(serde_json::json!({
            "chapter": p.chapter, "effect": p.effect, "n": p.n, "published_power": p.power,
            "published_needed_n": p.needed, "tests": tests, "explanation": p.explanation,
        }));
    }
    if global.json {
        return print_result(
            &serde_json::json!({ "schema": "carpus.power_published/1", "analyses": json }).to_string(),
        );
    }
    print_result(text.trim_end())
}
