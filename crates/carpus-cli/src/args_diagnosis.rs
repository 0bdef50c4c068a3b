//! Arguments of the commands about missing physical effects.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::args::{StudyArgs, trimmed};
use carpus_session::candidates::EffectSize;

/// `carpus diagnose`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus diagnose study/study.toml --out diagnosed\n  carpus diagnose study/study.toml \
                  --candidates joint_stiffness,gravity --out diagnosed\n\nWrites \
                  DIR/P01/{diagnosis.json,results.json,report.html,error.svg}. Held-out trials (use = test) are never \
                  fitted."
)]
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
    /// Effects beside the model.
    #[command(flatten)]
    pub effects: EffectsFile,
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
#[command(
    after_help = "Example:\n  carpus effects check my_effect.toml\n  carpus effects check my_effect.toml --study \
                  study/study.toml --participant P01\n\nWithout --study the effect is shown on trials of the bundled \
                  study.\n\nmy_effect.toml:\n  [effect]\n  id = \"cogging\"                     # small letters and \
                  _\n  name = \"Cogging of the machine\"\n  stage = \"joint\"                    # adds the formula \
                  [N·m]; \"muscles\": multiplies their moment by 1 + formula\n  formula = \"A*sin(n*q)\"\n\n  \
                  [parameters.A]\n  unit = \"N·m\"\n  role = \"amplitude\"                 # without the effect it is \
                  0\n  plausible = [0.0, 1.0]\n  source = \"bench test of the motor\"\n\n  [parameters.n]\n  unit \
                  = \"1/rad\"\n  role = \"shape\"\n  start = 14.0                       # the usual value\n  plausible \
                  = [8.0, 20.0]\n  source = \"poles of the motor\"\n\nOptional: in [effect] muscles = [\"FCR\"] (with \
                  stage = \"muscles\"; default: all), signature, experiment, rivals; in a parameter typical (a usual \
                  size, of a shape its spread) and, of a shape, starts = [..] (values that a fit also starts \
                  from).\nVariables at the joint: q, qdot, qddot, t, t_session (0 to 1), tau (moment of the muscles); \
                  of a muscle as FCR a_FCR, e_FCR (activation, excitation), l_FCR, v_FCR (length from origin to \
                  insertion, its rate), r_FCR (moment arm); SI units and radians. On muscles: q, t, t_session, a and r \
                  of the muscle itself.\nFunctions: sin cos tan asin acos atan sinh cosh tanh exp log sqrt abs sign \
                  min max step hinge square cube recip erf; pi; powers with ^."
)]
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

/// Effects that a laboratory defines itself.
#[derive(Clone, Debug, Default, Args)]
pub struct OwnEffects {
    /// An effect of your own, beside the catalogue; may be given several times (in study.toml: [effects] own =
    /// ["my_effect.toml"]; carpus effects check --help tells the format)
    #[arg(long = "own-effect", visible_alias = "effects-file", value_name = "my_effect.toml", id = "own_effect")]
    pub files: Vec<PathBuf>,
}

/// `carpus synth`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus synth study/study.toml --effect joint_stiffness:stiffness=1.2 --out hidden\n  \
                  carpus synth study/study.toml --effect gravity --effect joint_damping --seed 7 --out \
                  hidden\n\nWrites DIR/{study.toml,participants.csv,trials.csv,data/}, the model beside them, \
                  truth.json (what is hidden) and manifest.json. Angles, excitations and protocol are those of the \
                  given study; muscle parameters are drawn from the seed. Without --effect nothing is hidden. Carpus \
                  itself is the simulator: such a study teaches and tests the tools, and says nothing about their \
                  agreement with OpenSim."
)]
pub struct SynthArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Effect to hide, with its parameters in the units of `carpus effects ID`; may be given several times
    #[arg(long = "effect", value_name = "ID[:NAME=VALUE,…]", value_parser = effect_size, allow_hyphen_values = true)]
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

/// An effect of a size, as typed: `joint_stiffness:stiffness=1.2,rest_angle=0.1`.
fn effect_size(text: &str) -> Result<EffectSize, String> {
    let (id, listed) = text.split_once(':').unwrap_or((text, ""));
    let value = |item: &str| {
        let (name, value) = item.split_once('=').ok_or_else(|| format!("expected NAME=VALUE, found `{item}`"))?;
        match value.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok((name.trim().to_owned(), number)),
            _ => Err(format!("{}: expected a number, found `{value}`", name.trim())),
        }
    };
    let values = listed.split(',').filter(|item| !item.trim().is_empty()).map(value).collect::<Result<_, _>>()?;
    Ok(EffectSize { id: id.trim().to_owned(), values })
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

impl EffectsFile {
    /// The file.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }
}

/// `carpus effect`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus effect add study/study.toml joint_stiffness --out with\n  carpus effect auto \
                  study/study.toml --out with\n  carpus effect remove with/P01"
)]
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
    Auto(EffectAutoArgs),
    /// Go a step back in the ledger: the model without the effect that came last
    Remove(EffectRemoveArgs),
}

/// `carpus effect add`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus effect add study/study.toml joint_stiffness --out with\n  carpus effect add \
                  study/study.toml gravity,joint_damping --out with --i-choose\n\nWrites \
                  DIR/P01/{model.osim,results.json,report.html,error.svg,ledger.json,diagnosis.json,steps/}, and \
                  effects.toml for what no component of OpenSim does. A DIR/P01/diagnosis.json of the same files is \
                  used; without one the data are diagnosed first. Where the diagnosis cannot tell or knows no \
                  explanation, nothing is added unless --i-choose says so."
)]
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

/// `carpus effect auto`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus effect auto study/study.toml --out with\n\nWrites what `carpus effect add` \
                  writes. Adds the effects that the diagnosis names, one after the other; where it cannot tell, finds \
                  nothing, or knows no explanation, the muscles are refitted and nothing is added."
)]
pub struct EffectAutoArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Effects beside the model.
    #[command(flatten)]
    pub effects: EffectsFile,
}

/// `carpus effect remove`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus effect remove with/P01\n  carpus effect remove with/P01 --to 0      # the model \
                  as it was given\n\nPuts the model of the step before into model.osim (and effects.toml) and writes \
                  the report again. No step is lost: --to goes forward, too."
)]
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
#[command(
    after_help = "Example:\n  carpus plan study/study.toml --out planned\n  carpus plan study/study.toml --candidates \
                  joint_stiffness,gravity --out planned\n  carpus plan study/study.toml --effect gravity --out \
                  told\n\nWrites DIR/P01/plan.json, and the separating experiments into DIR/P01/diagnosis.json; with \
                  --effect DIR/P01/separability.json alone. A DIR/P01/diagnosis.json of the same files is used; \
                  without one the data are diagnosed first."
)]
pub struct PlanArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Tell these effects apart (comma-separated; default: those that the diagnosis leaves)
    #[arg(long, value_name = "ID,…", value_delimiter = ',', value_parser = trimmed)]
    pub candidates: Vec<String>,
    /// Say instead how far an effect of this size would be, in the trials at hand, from none and from every other
    /// effect; parameters in the units of `carpus effects ID`
    #[arg(
        long,
        value_name = "ID[:NAME=VALUE,…]",
        value_parser = effect_size,
        allow_hyphen_values = true,
        conflicts_with = "candidates"
    )]
    pub effect: Option<EffectSize>,
    /// Effects beside the model.
    #[command(flatten)]
    pub effects: EffectsFile,
}
