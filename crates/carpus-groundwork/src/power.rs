//! Power of a test, and the participants it needs.

use serde::Serialize;
use serde_json::{Value, json};

use super::diagnostic::{Diagnostic, Failure};
use carpus_numerics::statistics::{PowerAnalysis, StatisticsError, Tails, TestDesign};

/// Power that is asked for.
pub const DEFAULT_POWER: f64 = 0.8;
/// Significance level.
pub const DEFAULT_ALPHA: f64 = 0.05;

/// A question for the power of a test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Power {
    /// The test with its effect, level and tails.
    pub analysis: PowerAnalysis,
    /// Participants there are.
    pub n: Option<usize>,
    /// Power asked for.
    pub power: f64,
}

/// Power, and the participants it needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FoundPower {
    /// The test.
    pub analysis: PowerAnalysis,
    /// Participants there are.
    pub n: Option<usize>,
    /// The power that they have.
    pub achieved_power: Option<f64>,
    /// Power asked for.
    pub power_asked_for: f64,
    /// Participants that it needs.
    pub needed_n: usize,
}

impl Power {
    /// A test with the usual power.
    pub fn of(analysis: PowerAnalysis) -> Power {
        Power { analysis, n: None, power: DEFAULT_POWER }
    }

    /// The power of the participants there are, and those that the power asked for needs.
    ///
    /// # Errors
    /// An effect, level or power outside its domain.
    pub fn run(&self) -> Result<FoundPower, Failure> {
        Ok(FoundPower {
            analysis: self.analysis,
            n: self.n,
            achieved_power: self.n.map(|n| self.analysis.power(n)).transpose().map_err(refused)?,
            power_asked_for: self.power,
            needed_n: self.analysis.needed_n(self.power).map_err(refused)?,
        })
    }
}

impl FoundPower {
    /// For programs.
    pub fn value(&self) -> Value {
        json!({
            "schema": "carpus.power/1",
            "analysis": self.analysis,
            "n": self.n,
            "achieved_power": self.achieved_power,
            "power_asked_for": self.power_asked_for,
            "needed_n": self.needed_n,
        })
    }
}

/// One of the dissertation's power analyses.
#[derive(Clone, Copy, Debug)]
pub struct Published {
    /// Chapter.
    pub chapter: u8,
    /// Size of the effect.
    pub effect: f64,
    /// Participants.
    pub n: usize,
    /// Power that was published.
    pub power: f64,
    /// Participants that it says are needed.
    pub needed: usize,
    /// Tests that give one of its numbers, or that the question asks for.
    pub tests: [(&'static str, TestDesign, Tails); 4],
    /// How they come together.
    pub explanation: &'static str,
}

/// The power analyses of Jadelis (2025).
pub const PUBLISHED: [Published; 2] = [
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
        explanation: "The power is that of the paired test with one tail (0.67 from d = 0.715, which also rounds to \
                      0.72). The 25 is \
                      the size of each of two independent groups; every participant was measured under both \
                      conditions, so the \
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
        explanation: "Both numbers are of G*Power's point biserial model with one tail, the first of its correlation \
                      tests, which takes \
                      one variable for fixed. Both variables were measured: the bivariate normal model applies, which \
                      has less power \
                      and needs more.",
    },
];

/// What a test gives for a published analysis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Recomputed {
    /// The test.
    pub test: &'static str,
    /// Power of the published number of participants.
    pub power: f64,
    /// Participants that the power asked for needs.
    pub needed_n: usize,
}

impl Published {
    /// What each of its tests gives.
    ///
    /// # Errors
    /// A level or power outside its domain.
    pub fn recomputed(&self, alpha: f64, power: f64) -> Result<Vec<Recomputed>, Failure> {
        let of = |&(test, design, tails): &(&'static str, TestDesign, Tails)| {
            let analysis = PowerAnalysis { design, alpha, tails };
            let (achieved, needed_n) = (analysis.power(self.n), analysis.needed_n(power));
            Ok(Recomputed { test, power: achieved.map_err(refused)?, needed_n: needed_n.map_err(refused)? })
        };
        self.tests.iter().map(of).collect()
    }

    /// For programs.
    ///
    /// - `tests`: [`Published::recomputed`]
    pub fn value(&self, tests: &[Recomputed]) -> Value {
        json!({
            "chapter": self.chapter, "effect": self.effect, "n": self.n, "published_power": self.power,
            "published_needed_n": self.needed, "tests": tests, "explanation": self.explanation,
        })
    }
}

/// The dissertation's power analyses, each with what its tests give, for programs.
///
/// - `analyses`: each with [`Published::recomputed`]
pub fn published_value(analyses: &[(&Published, Vec<Recomputed>)]) -> Value {
    let values: Vec<Value> = analyses.iter().map(|(published, tests)| published.value(tests)).collect();
    json!({ "schema": "carpus.power_published/1", "analyses": values })
}

fn refused(error: StatisticsError) -> Failure {
    Diagnostic::error(error.to_string()).into()
}
