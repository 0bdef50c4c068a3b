//! Arguments of the commands about a model.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::parts::{ModelArgs, OwnEffects, StudyArgs, text, trimmed};
use carpus_session::equilibrium::DEFAULT_ACTIVATION;
use carpus_session::quantity::{Assignment, Sweep};
use carpus_session::scale::BodyFactor;

/// `carpus info`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus info wrist.osim\n  carpus info wrist.osim --json | jq .coordinates")]
pub struct InfoArgs {
    /// The model
    #[arg(value_name = "MODEL.osim")]
    pub model: PathBuf,
    /// List every finding, also where everything was understood
    #[arg(long)]
    pub all: bool,
}

/// `carpus audit`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/audit.txt")))]
pub struct AuditArgs {
    /// The model
    #[arg(value_name = "MODEL.osim")]
    pub model: PathBuf,
    /// Move this coordinate alone; may be given several times
    #[arg(long = "coordinate", value_name = "NAME")]
    pub coordinates: Vec<String>,
    /// Hold a coordinate at a value, with unit; may be given several times
    #[arg(long = "set", value_name = "NAME=VALUE", allow_hyphen_values = true)]
    pub set: Vec<Assignment>,
    /// List every note
    #[arg(long)]
    pub all: bool,
}

/// `carpus view`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/view.txt")))]
pub struct ViewArgs {
    /// Model and strictness.
    #[command(flatten)]
    pub model: ModelArgs,
    /// The page
    #[arg(long, short, value_name = "FILE.html", default_value = "view.html")]
    pub out: PathBuf,
    /// Open the page in the browser
    #[arg(long)]
    pub open: bool,
    /// Folder with bone geometry, looked through first; may be given several times
    #[arg(long, value_name = "DIR")]
    pub geometry: Vec<PathBuf>,
    /// Value of a coordinate that the page begins with; may be given several times
    #[arg(long, value_name = "COORDINATE=VALUE")]
    pub set: Vec<Assignment>,
}

/// `carpus paths`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/paths.txt")))]
pub struct PathsArgs {
    /// Model and strictness.
    #[command(flatten)]
    pub model: ModelArgs,
    /// Coordinate to move: NAME=FROM:TO:STEP and unit (deg, rad, m, mm)
    #[arg(long, value_name = "NAME=FROM:TO:STEP", allow_hyphen_values = true)]
    pub sweep: Sweep,
    /// Hold a coordinate at a value, with unit; may be given several times
    #[arg(long = "set", value_name = "NAME=VALUE", allow_hyphen_values = true)]
    pub set: Vec<Assignment>,
    /// Only these muscles (comma-separated; default: all)
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = trimmed)]
    pub muscles: Vec<String>,
    /// Folder for paths.csv and paths.html; carpus-output.json says what made them
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// `carpus equilibrium`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/equilibrium.txt")))]
pub struct EquilibriumArgs {
    /// Model and strictness.
    #[command(flatten)]
    pub model: ModelArgs,
    /// Hold a coordinate at a value, with unit; may be given several times
    #[arg(long = "set", value_name = "NAME=VALUE", allow_hyphen_values = true)]
    pub set: Vec<Assignment>,
    /// Activation of every muscle, 0 to 1
    #[arg(long, value_name = "A", default_value_t = DEFAULT_ACTIVATION, value_parser = activation)]
    pub activation: f64,
    /// Coordinates about which moments are given (comma-separated; default: those that --set names)
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = trimmed)]
    pub moment_about: Vec<String>,
    /// Only these muscles (comma-separated; default: all)
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = trimmed)]
    pub muscles: Vec<String>,
    /// Write the table to this CSV file too
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
}

/// `carpus effects`
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "Example:\n  carpus effects\n  carpus effects joint_stiffness\n  carpus effects check my_effect.toml \
                  --study study/study.toml\n  carpus effects --own-effect my_effect.toml"
)]
pub struct EffectsArgs {
    /// Only this effect, in full
    #[arg(value_name = "ID")]
    pub id: Option<String>,
    /// Effects of your own.
    #[command(flatten)]
    pub own: OwnEffects,
    /// What else to do.
    #[command(subcommand)]
    pub command: Option<EffectsCommand>,
}

/// The commands of `carpus effects`.
#[derive(Debug, Subcommand)]
pub enum EffectsCommand {
    /// Check an effect of your own as those of the catalogue are checked, and show what it looks like
    Check(EffectsCheckArgs),
}

/// `carpus effects check`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/effects-check.txt")))]
pub struct EffectsCheckArgs {
    /// The effect
    #[arg(value_name = "my_effect.toml")]
    pub file: PathBuf,
    /// Show it on trials of this study
    #[arg(long, value_name = "STUDY/study.toml")]
    pub study: Option<PathBuf>,
    /// Of this participant (default: the first)
    #[arg(long, value_name = "NAME", requires = "study")]
    pub participant: Option<String>,
}

/// `carpus scale`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/scale.txt")))]
pub struct ScaleArgs {
    /// A model, or a study: its study.toml or the folder it is in
    #[arg(value_name = "MODEL.osim|STUDY/study.toml")]
    pub input: PathBuf,
    /// Model: scale a body along x, y, z (one number: all alike); may be given several times
    #[arg(long, value_name = "BODY=X[,Y,Z]")]
    pub factor: Vec<BodyFactor>,
    /// Model: mass of the scaled model [kg]
    #[arg(long, value_name = "KG", value_parser = positive)]
    pub mass: Option<f64>,
    /// Model: bodies keep their share of the mass instead of growing with their volume
    #[arg(long)]
    pub preserve_mass_distribution: bool,
    /// Study: only this participant; may be given several times (default: all)
    #[arg(long, value_name = "NAME")]
    pub participant: Vec<String>,
    /// Study: use this model instead of the one the study names
    #[arg(long, value_name = "OTHER.osim")]
    pub model: Option<PathBuf>,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Go on although the model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

/// `carpus strength-scale`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/strength-scale.txt")))]
pub struct StrengthScaleArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// First scale the model to the lengths of the participant's segments, as carpus scale does
    #[arg(long)]
    pub linear: bool,
}

/// `carpus upgrade`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/upgrade.txt")))]
pub struct UpgradeArgs {
    /// The old model
    #[arg(value_name = "OLD.osim")]
    pub old: PathBuf,
    /// The file to write; nothing else appears beside it
    #[arg(value_name = "NEW.osim")]
    pub new: PathBuf,
}

/// `carpus run-tool`
#[derive(Debug, Args)]
#[command(after_help = text(include_str!("help/run-tool.txt")))]
pub struct RunToolArgs {
    /// Setup file of a tool
    #[arg(value_name = "SETUP.xml")]
    pub setup: PathBuf,
    /// Model to use instead of the one that the setup names
    #[arg(long, value_name = "MODEL.osim")]
    pub model: Option<PathBuf>,
    /// Go on without forces that are not computed
    #[arg(long)]
    pub allow_unsupported: bool,
}

fn activation(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=1.0).contains(&value) => Ok(value),
        _ => Err("expected a number from 0 to 1".to_string()),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("expected a positive number".to_string()),
    }
}
