//! Arguments of the commands about statistics over participants.

use std::path::PathBuf;

use clap::Args;

use super::parts::{StudyArgs, count, text};
use carpus_session::power::{DEFAULT_ALPHA, DEFAULT_POWER};
use carpus_session::screening::{DEFAULT_RESAMPLES, DEFAULT_STARTS};
use carpus_session::ultrasound::ModelCase;

/// `carpus evaluate`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/evaluate.txt")))]
pub struct EvaluateArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Folder with one folder of models a participant; may be given several times
    #[arg(long, value_name = "DIR", required = true)]
    pub models: Vec<PathBuf>,
}

/// `carpus sensitivity`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/sensitivity.txt")))]
pub struct SensitivityArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Starts r of the screening: r (m + 1) runs per condition for m parameters
    #[arg(long, value_name = "R", default_value_t = DEFAULT_STARTS as u32, value_parser = count(2..=100_000))]
    pub starts: u32,
    /// Also Sobol' indices, from a Sobol' sequence and N (m + 2) runs per condition; best a power of two
    #[arg(long, value_name = "N", value_parser = count(2..=1_000_000))]
    pub sobol: Option<u32>,
    /// Resamples of the bootstrap behind the intervals
    #[arg(long, value_name = "N", default_value_t = DEFAULT_RESAMPLES as u32, value_parser = count(0..=1_000_000))]
    pub resamples: u32,
}

/// `carpus ultrasound`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/ultrasound.txt")))]
pub struct UltrasoundArgs {
    /// The study: its study.toml or the folder it is in
    #[arg(value_name = "STUDY/study.toml")]
    pub study: PathBuf,
    /// A further model case: a name, and the model of each participant; may be given several times
    #[arg(long, value_name = "NAME=PATH/{participant}/model.osim")]
    pub case: Vec<ModelCase>,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Go on although a model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

/// `carpus groups`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/groups.txt")))]
pub struct GroupsArgs {
    /// The study: its study.toml or the folder it is in
    #[arg(value_name = "STUDY/study.toml")]
    pub study: PathBuf,
    /// Folders of carpus identify, or of carpus diagnose of several participants; required without --values
    #[arg(value_name = "FOLDER", required_unless_present = "values")]
    pub results: Vec<PathBuf>,
    /// Table with a column participant and columns of numbers to compare; may be given several times
    #[arg(long, value_name = "FILE")]
    pub values: Vec<PathBuf>,
    /// Only this participant; may be given several times (default: all)
    #[arg(long, value_name = "NAME")]
    pub participant: Vec<String>,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// `carpus priors`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/priors.txt")))]
pub struct PriorsArgs {
    /// Folders of carpus identify or carpus study (searched for identifiability.json), or such files
    #[arg(value_name = "FOLDER", required = true)]
    pub fits: Vec<PathBuf>,
    /// The table to write
    #[arg(long, short, value_name = "FILE")]
    pub out: PathBuf,
}

/// `carpus power`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/power.txt")))]
pub struct PowerArgs {
    /// The test
    #[arg(value_name = "TEST", required_unless_present = "published")]
    pub test: Option<PowerTest>,
    /// Size of the effect: Cohen's d, or r
    #[arg(long, value_name = "SIZE", allow_hyphen_values = true, required_unless_present = "published")]
    pub effect: Option<f64>,
    /// The power analyses of Jadelis (2025): what was published, and the tests that give these numbers and other ones
    #[arg(long, conflicts_with_all = ["test", "effect", "n"])]
    pub published: bool,
    /// Participants there are: the power they have
    #[arg(long, value_name = "N")]
    pub n: Option<usize>,
    /// Power asked for: the participants it needs
    #[arg(long, value_name = "P", default_value_t = DEFAULT_POWER)]
    pub power: f64,
    /// Significance level
    #[arg(long, value_name = "P", default_value_t = DEFAULT_ALPHA)]
    pub alpha: f64,
    /// One- or two-sided test
    #[arg(long, value_name = "1|2", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=2))]
    pub tails: u8,
}

/// Tests whose power can be asked for.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum PowerTest {
    /// t-test of paired measurements (d_z)
    PairedT,
    /// t-test of two independent groups (d)
    TwoSampleT,
    /// Pearson's correlation, exact
    Correlation,
    /// Correlation with one variable fixed (G*Power's point biserial model)
    PointBiserial,
}
