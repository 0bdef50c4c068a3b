//! Arguments that several commands have.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::RangedI64ValueParser;

use carpus_session::identify::{DEFAULT_DRAWS, TiedMuscles};
use carpus_session::personalize::INTERVAL_LEVEL;

/// A model and how strictly it is read.
#[derive(Debug, Args)]
pub struct ModelArgs {
    /// The model
    #[arg(value_name = "MODEL.osim")]
    pub model: PathBuf,
    /// Go on although the model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

/// A study and what of it is read.
#[derive(Clone, Debug, Args)]
pub struct StudyInput {
    /// The study: its study.toml or the folder it is in
    #[arg(value_name = "STUDY/study.toml")]
    pub study: PathBuf,
    /// Only this participant; may be given several times (default: all)
    #[arg(long, value_name = "NAME")]
    pub participant: Vec<String>,
    /// Use this model instead of the one the study names
    #[arg(long, value_name = "OTHER.osim")]
    pub model: Option<PathBuf>,
}

/// A study, what of it is read, and where the results go.
#[derive(Clone, Debug, Args)]
pub struct StudyArgs {
    /// What is read.
    #[command(flatten)]
    pub input: StudyInput,
    /// Folder for the results of this study: one folder per participant; carpus-output.json says who made what
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Go on although the model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

/// Effects that a laboratory defines itself.
#[derive(Clone, Debug, Default, Args)]
pub struct OwnEffects {
    /// An effect of your own, beside the catalogue; may be given several times (in study.toml: [effects] own =
    /// ["my_effect.toml"]; carpus effects check --help tells the format)
    #[arg(long = "own-effect", visible_alias = "effects-file", value_name = "my_effect.toml", id = "own_effect")]
    pub files: Vec<PathBuf>,
}

/// Effects that a model has beside its file.
#[derive(Debug, Args)]
pub struct EffectsFile {
    /// Effects that the model has beside its file, as `carpus effect add` writes them
    #[arg(long = "effects", value_name = "effects.toml", id = "effects_file")]
    file: Option<PathBuf>,
    /// Effects of your own.
    #[command(flatten)]
    pub own: OwnEffects,
}

/// A study whose model may have effects beside its file.
#[derive(Debug, Args)]
pub struct StudyWithEffects {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Effects beside the model.
    #[command(flatten)]
    pub effects: EffectsFile,
}

impl EffectsFile {
    /// The file.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }
}

/// What is asked about a study's parameters.
#[derive(Clone, Debug, Args)]
pub struct IdentifyOptions {
    /// Properties in question, under OpenSim's names (comma-separated; default: optimal_fiber_length,
    /// tendon_slack_length, max_isometric_force)
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = trimmed)]
    pub properties: Vec<String>,
    /// One factor for several muscles, per property; may be given several times
    #[arg(long, value_name = "GROUP=MUSCLE,…")]
    pub tie: Vec<TiedMuscles>,
    /// Prior knowledge: a CSV with muscle, property, mean, sd (in the file's unit; with unit = model, multiples of the
    /// model's value) and perhaps source; `carpus priors` writes one from earlier fits
    #[arg(long, value_name = "FILE")]
    pub priors: Option<PathBuf>,
    /// Level of intervals
    #[arg(long, value_name = "P", default_value_t = INTERVAL_LEVEL, value_parser = level)]
    pub level: f64,
    /// Draws from the posterior
    #[arg(long, value_name = "N", default_value_t = DEFAULT_DRAWS as u32, value_parser = count(40..=1_000_000))]
    pub draws: u32,
}

/// An item of a list, which may have spaces behind its commas.
pub(super) fn trimmed(text: &str) -> Result<String, std::convert::Infallible> {
    Ok(text.trim().to_owned())
}

fn level(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.5..=0.999).contains(&value) => Ok(value),
        _ => Err("expected a number from 0.5 to 0.999".to_string()),
    }
}

/// A whole number in a range.
pub(super) fn count(range: RangeInclusive<i64>) -> RangedI64ValueParser<u32> {
    clap::value_parser!(u32).range(range)
}

/// A text of `help/`: a line that ends with a backslash goes on with the next.
pub(super) fn text(file: &str) -> String {
    file.trim_end().replace("\\\n", "")
}
