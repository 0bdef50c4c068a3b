//! Arguments of the commands about a study.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::parts::{
    EffectsFile, IdentifyOptions, OwnEffects, StudyArgs, StudyInput, StudyWithEffects, count, text, trimmed,
};
use carpus_session::candidates::EffectSize;
use carpus_session::screening::DEFAULT_STARTS;
use carpus_session::task::Task;
use carpus_session::whole_study::{DEFAULT_BAYESIAN_EVALUATIONS, DEFAULT_SOBOL, DEFAULT_SQP_ITERATIONS};

/// `carpus demo`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus demo\n  carpus demo --out somewhere/else")]
pub struct DemoArgs {
    /// Folder for the study and its results
    #[arg(long, value_name = "DIR", default_value = "carpus-demo")]
    pub out: PathBuf,
}

/// `carpus init`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/init.txt")))]
pub struct InitArgs {
    /// The folder of the exported files
    #[arg(value_name = "FOLDER")]
    pub folder: PathBuf,
    /// The model
    #[arg(long, value_name = "MODEL.osim")]
    pub model: PathBuf,
    /// Folder of the study (default: FOLDER-study)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// The coordinate that the dynamometer moves (default: found)
    #[arg(long, value_name = "NAME")]
    pub coordinate: Option<String>,
    /// Ask nothing, take what is proposed
    #[arg(long)]
    pub yes: bool,
    /// Go on although the model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

/// `carpus check`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/check.txt")))]
pub struct CheckArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyInput,
    /// Go on although the model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

/// `carpus personalize`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/personalize.txt")))]
pub struct PersonalizeArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// No 90 % intervals of the fitted parameters
    #[arg(long)]
    pub no_intervals: bool,
}

/// `carpus identify`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/identify.txt")))]
pub struct IdentifyArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// What is asked.
    #[command(flatten)]
    pub options: IdentifyOptions,
}

/// `carpus diagnose`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/diagnose.txt")))]
pub struct DiagnoseArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Name only these effects (comma-separated; default: all); the others are taken to be as small as
    /// everything in a laboratory
    #[arg(long, value_name = "ID,…", value_delimiter = ',', value_parser = trimmed)]
    pub candidates: Vec<String>,
    /// Also write what simpler methods need to compare themselves (key `baselines`, megabytes)
    #[arg(long)]
    pub baselines: bool,
    /// Only the I-th of N parts of the participants, without results; `carpus merge` then writes them
    #[arg(long, value_name = "I/N")]
    pub task: Option<Task>,
    /// Effects beside the model.
    #[command(flatten)]
    pub effects: EffectsFile,
}

/// `carpus effect`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/effect.txt")))]
pub struct EffectArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: EffectCommand,
}

/// The commands of `carpus effect`.
#[derive(Debug, Subcommand)]
pub enum EffectCommand {
    /// Add effects to the model, refitted jointly with its muscles
    Add(EffectAddArgs),
    /// Let the diagnosis choose: what it names, nothing where it cannot tell
    #[command(
        after_help = "Example:\n  carpus effect auto study/study.toml --out with\n\nWrites what `carpus effect add` \
                  writes. Adds the effects that the diagnosis names, one after the other; where it cannot tell, finds \
                  nothing, or knows no explanation, the muscles are refitted and nothing is added."
    )]
    Auto(StudyWithEffects),
    /// Go a step back in the ledger: the model without the effect that came last
    Remove(EffectRemoveArgs),
}

/// `carpus effect add`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/effect-add.txt")))]
pub struct EffectAddArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Effects to add, in this order (comma-separated; `carpus effects` lists them)
    #[arg(value_name = "EFFECT,…", value_delimiter = ',', value_parser = trimmed, required = true)]
    pub chosen: Vec<String>,
    /// Add the effects although the diagnosis cannot tell, or does not support them; the choice is recorded
    #[arg(long)]
    pub i_choose: bool,
    /// Effects beside the model.
    #[command(flatten)]
    pub effects: EffectsFile,
}

/// `carpus effect remove`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/effect-remove.txt")))]
pub struct EffectRemoveArgs {
    /// A participant's folder of `carpus effect add`
    #[arg(value_name = "DIR/P01")]
    pub folder: PathBuf,
    /// The step to go to, counted from 0, the model as given (default: one back)
    #[arg(long, value_name = "STEP")]
    pub to: Option<usize>,
    /// Effects of your own.
    #[command(flatten)]
    pub own: OwnEffects,
}

/// `carpus plan`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/plan.txt")))]
pub struct PlanArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Tell these effects apart (comma-separated; default: those that the diagnosis leaves)
    #[arg(long, value_name = "ID,…", value_delimiter = ',', value_parser = trimmed)]
    pub candidates: Vec<String>,
    /// Say instead how far an effect of this size would be, in the trials at hand, from none and from every other
    /// effect; parameters in the units of `carpus effects ID`
    #[arg(long, value_name = "ID[:NAME=VALUE,…]", allow_hyphen_values = true, conflicts_with = "candidates")]
    pub effect: Option<EffectSize>,
    /// Effects beside the model.
    #[command(flatten)]
    pub effects: EffectsFile,
}

/// `carpus study`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/study.txt")))]
pub struct WholeStudyArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Only these steps (comma-separated; default: all)
    #[arg(long, value_name = "STEP,…", value_delimiter = ',')]
    pub steps: Vec<String>,
    /// Only the I-th of N parts of the participants, without a report; `carpus merge` then makes it
    #[arg(long, value_name = "I/N")]
    pub task: Option<Task>,
    /// Starts r of the Morris screening
    #[arg(long, value_name = "R", default_value_t = DEFAULT_STARTS as u32, value_parser = count(2..=100_000))]
    pub starts: u32,
    /// Rows N of the Sobol' analysis: N (m + 2) runs per condition; 0 for none
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SOBOL as u32, value_parser = count(0..=1_000_000))]
    pub sobol: u32,
    /// Evaluations of each Bayesian optimization
    #[arg(
        long,
        value_name = "N",
        default_value_t = DEFAULT_BAYESIAN_EVALUATIONS as u32,
        value_parser = count(11..=100_000)
    )]
    pub bayesian_evaluations: u32,
    /// Iterations of each sequential quadratic programming
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SQP_ITERATIONS as u32, value_parser = count(1..=100_000))]
    pub sqp_iterations: u32,
    /// What is asked about the parameters' intervals.
    #[command(flatten)]
    pub identify: IdentifyOptions,
}

/// `carpus live`
#[cfg(feature = "live")]
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/live.txt")))]
pub struct LiveArgs {
    /// The study: its study.toml or the folder it is in
    #[arg(value_name = "STUDY/study.toml")]
    pub study: PathBuf,
    /// Folder for the steps, one folder each, and the ledger
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Port of this machine to listen on (default: a free one)
    #[arg(long, value_name = "PORT")]
    pub port: Option<u16>,
    /// Do not open a browser
    #[arg(long)]
    pub no_browser: bool,
    /// Go on although the model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

/// `carpus synth`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/synth.txt")))]
pub struct SynthArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Effect to hide, with its parameters in the units of `carpus effects ID`; may be given several times
    #[arg(long = "effect", value_name = "ID[:NAME=VALUE,…]", allow_hyphen_values = true)]
    pub effects: Vec<EffectSize>,
    /// Noise of the recordings
    #[arg(long, value_name = "LEVEL", value_enum, default_value_t = NoiseLevel::Realistic)]
    pub noise: NoiseLevel,
    /// Effects of your own.
    #[command(flatten)]
    pub own: OwnEffects,
}

/// How noisy recordings are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum NoiseLevel {
    /// EMG 10 % envelope and 5 % gain per trial, angle 0.2°, moment 0.05 N·m and 1 % of the largest
    Realistic,
    /// A quarter of it
    Small,
    /// None
    None,
}

/// `carpus units`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/units.txt")))]
pub struct UnitsArgs {
    /// The folder that `carpus study --out` or `carpus diagnose --out` writes to
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}

/// `carpus merge`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/merge.txt")))]
pub struct MergeArgs {
    /// The folder that the tasks share
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}
