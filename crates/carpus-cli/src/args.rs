//! Arguments as they are typed.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

pub use super::args_diagnosis::{
    DiagnoseArgs, EffectArgs, EffectCommand, EffectsArgs, EffectsFile, PlanArgs, SynthArgs,
};
use carpus_session::equilibrium::DEFAULT_ACTIVATION;
use carpus_session::identify::{DEFAULT_DRAWS, TiedMuscles};
use carpus_session::personalize::INTERVAL_LEVEL;
use carpus_session::power::{DEFAULT_ALPHA, DEFAULT_POWER};
use carpus_session::provenance::DEFAULT_SEED;
use carpus_session::quantity::{Assignment, Sweep};
use carpus_session::screening::{DEFAULT_RESAMPLES, DEFAULT_STARTS};
use carpus_session::ultrasound::ModelCase;
use carpus_session::whole_study::{DEFAULT_BAYESIAN_EVALUATIONS, DEFAULT_SOBOL, DEFAULT_SQP_ITERATIONS};

/// Personalize OpenSim hand and wrist models from dynamometer and EMG recordings, and see where the model fails.
#[derive(Debug, Parser)]
#[command(
    name = "carpus",
    version,
    propagate_version = true,
    subcommand_required = true,
    arg_required_else_help = true
)]
#[command(
    after_help = "Start with:\n  carpus demo\n\nExit codes: 0 done, 1 the input is at fault, 2 carpus is at fault."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Options of every command.
    #[command(flatten)]
    pub global: Global,
}

/// Options of every command.
#[derive(Debug, Args)]
pub struct Global {
    /// Threads to use, at most one per core (default: one per core); results do not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = threads, help_heading = "Global options")]
    pub threads: Option<NonZeroUsize>,
    /// Seed of everything random; the same seed gives the same bytes
    #[arg(long, global = true, value_name = "N", default_value_t = DEFAULT_SEED, help_heading = "Global options")]
    pub seed: u64,
    /// Print the result as JSON, for programs
    #[arg(long, global = true, help_heading = "Global options")]
    pub json: bool,
    /// No progress bars
    #[arg(long, short, global = true, help_heading = "Global options")]
    pub quiet: bool,
}

/// The commands, as `carpus --help` groups them (`help::GROUPS`). What a command does is told in one line of 58
/// characters.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the bundled study end to end, in seconds
    Demo(DemoArgs),
    /// A study from a folder of exported files, and a model
    Init(InitArgs),
    /// Everything that can be found before a run: a study's faults
    Check(CheckArgs),
    /// Simulated beside measured moments: errors and a report
    Compare(CompareArgs),
    /// Fit muscle parameters to recordings: a personal .osim
    Personalize(PersonalizeArgs),
    /// Intervals of muscle parameters; which trial to record next
    Identify(IdentifyArgs),
    /// Where the model fails, and which physics could be missing
    Diagnose(DiagnoseArgs),
    /// Add a physical effect to a model, or take it away again
    Effect(EffectArgs),
    /// Further trials that would distinguish the explanations
    Plan(PlanArgs),
    /// Moments, fibre lengths and forces of every trial over time
    Simulate(SimulateArgs),
    /// All steps of a study and one report; resumable
    Study(WholeStudyArgs),
    /// A study with a hidden effect, made by Carpus, to learn on
    Synth(SynthArgs),
    /// What is in a model, and what is not supported, by line
    Info(InfoArgs),
    /// What no body has: jumps, slack tendons, wrong units or signs
    Audit(AuditArgs),
    /// Muscle lengths and moment arms over a coordinate
    Paths(PathsArgs),
    /// A model in three dimensions, to drag: one HTML page
    View(ViewArgs),
    /// Fibre lengths, forces and moments at rest in a posture
    Equilibrium(EquilibriumArgs),
    /// The catalogue of physical effects that a model may lack
    Effects(EffectsArgs),
    /// Scale a model to a person, as OpenSim's Scale Tool does
    Scale(ScaleArgs),
    /// Scale muscle forces to the maximum voluntary moments
    StrengthScale(StrengthScaleArgs),
    /// Write an old model in the format of OpenSim 4.6
    Upgrade(UpgradeArgs),
    /// Run an OpenSim setup file, as opensim-cmd run-tool does
    #[command(name = "run-tool")]
    RunTool(RunToolArgs),
    /// Dynamometer recordings to the trials of a new study
    Dynamometer(DynamometerArgs),
    /// The machine's own drag, from runs without a participant
    DynamometerDrag(DynamometerDragArgs),
    /// Raw EMG to normalized EMG; checks of every channel
    Emg(EmgArgs),
    /// Motion capture to markers (.trc) and channels (CSV)
    C3d(C3dArgs),
    /// Every model on every held-out trial, over participants
    Evaluate(EvaluateArgs),
    /// Which parameters matter: Morris screening, Sobol' indices
    Sensitivity(SensitivityArgs),
    /// Resting muscles beside ultrasound: correlation, agreement
    Ultrasound(UltrasoundArgs),
    /// Earlier fits to prior knowledge of the next participant
    Priors(PriorsArgs),
    /// Power of a test, and the participants that it needs
    Power(PowerArgs),
    /// Completions of commands and options for a shell
    Completions(CompletionsArgs),
    /// Man pages, one for each command
    Man(ManArgs),
    /// Pages of the book that are made from the program
    #[command(hide = true)]
    Book(BookArgs),
}

/// `carpus completions`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus completions bash > ~/.local/share/bash-completion/completions/carpus\n  carpus \
                  completions zsh > ~/.zfunc/_carpus\n  carpus completions fish > \
                  ~/.config/fish/completions/carpus.fish"
)]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_name = "SHELL", value_enum)]
    pub shell: clap_complete::Shell,
}

/// `carpus man`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus man --out ~/.local/share/man/man1\n  man carpus-personalize")]
pub struct ManArgs {
    /// Folder for carpus.1, carpus-demo.1, …
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// `carpus book`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus book --out docs/src\n\nWrites DIR/reference/commands.md and DIR/catalogue/."
)]
pub struct BookArgs {
    /// Folder of the book's sources
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

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
#[command(
    after_help = "Example:\n  carpus init exports --model wrist.osim\n  carpus init exports --model wrist.osim --out \
                  study --yes --json\n\nLooks at all text files below FOLDER (.csv, .txt, .tsv, …), however they are \
                  laid out: columns by name, unit and behaviour, recorders by their files, trials by the names of \
                  files and folders. Writes DIR/{study.toml,participants.csv,trials.csv}, which refer to the files \
                  where they are, and prints what was understood, assumed, and could not be told. No file of the \
                  folder is changed or moved."
)]
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
#[command(
    after_help = "Example:\n  carpus check study/study.toml\n\nMakes all checks that other commands make when they \
                  read a study, and prints trials by condition and findings by subject: green, amber, red. The exit \
                  code is 1 if one is red."
)]
pub struct CheckArgs {
    /// The study: its study.toml or the folder it is in
    #[arg(value_name = "STUDY/study.toml")]
    pub study: PathBuf,
    /// Only this participant; may be given several times (default: all)
    #[arg(long, value_name = "NAME")]
    pub participant: Vec<String>,
    /// Use this model instead of the one the study names
    #[arg(long, value_name = "OTHER.osim")]
    pub model: Option<PathBuf>,
    /// Go on although the model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

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
#[command(after_help = "Example:\n  carpus audit wrist.osim\n  carpus audit arm.osim --coordinate flexion --set \
                  elbow_flexion=90deg --all\n\nEvery coordinate with a range is moved through it, the others at their \
                  defaults. An error is what no body has, a warning is probably not meant, a note is true of many good \
                  models. Ends with 1 where there are errors.")]
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
#[command(
    after_help = "Example:\n  carpus view wrist.osim --open\n  carpus view MOBL_ARMS_41.osim -o mobl.html --geometry \
                  ~/OpenSim/Geometry\n\nThe page needs no network. Bone geometry (.vtp, .stl, .obj) is looked for \
                  beside the model and in Geometry there."
)]
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
#[command(
    after_help = "Example:\n  carpus paths wrist.osim --sweep flexion=-70:70:1deg --set elbow_flexion=90deg --out \
                  sweep\n\nWithout --out the table goes to standard output as CSV."
)]
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
#[command(after_help = "Example:\n  carpus equilibrium wrist.osim --set flexion=30deg --activation 0.01\n  carpus \
                  equilibrium wrist.osim --set flexion=30deg --moment-about flexion,deviation --csv posture.csv")]
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

/// A study and what of it is used.
#[derive(Clone, Debug, Args)]
pub struct StudyArgs {
    /// The study: its study.toml or the folder it is in
    #[arg(value_name = "STUDY/study.toml")]
    pub study: PathBuf,
    /// Only this participant; may be given several times (default: all)
    #[arg(long, value_name = "NAME")]
    pub participant: Vec<String>,
    /// Use this model instead of the one the study names
    #[arg(long, value_name = "OTHER.osim")]
    pub model: Option<PathBuf>,
    /// Folder for the results of this study: one folder per participant; carpus-output.json says who made what
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Go on although the model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

/// `carpus simulate`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus simulate study/study.toml --participant P01 --out simulated\n\nWrites \
                  DIR/P01/{results.json,report.html} and for every trial DIR/P01/series/TRIAL.csv and .sto.")]
pub struct SimulateArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Effects beside the model.
    #[command(flatten)]
    pub effects: EffectsFile,
}

/// `carpus compare`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus compare study/study.toml --out compared\n  carpus compare study/study.toml \
                  --model personalized/P01/model.osim --participant P01 --out compared\n\nWrites \
                  DIR/P01/{results.json,report.html,errors_per_trial.csv,errors_per_condition.csv,series/}."
)]
pub struct CompareArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Effects beside the model.
    #[command(flatten)]
    pub effects: EffectsFile,
}

/// `carpus personalize`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus personalize study/study.toml --out personalized --seed 1\n\nWrites \
                  DIR/P01/{model.osim,results.json,report.html,errors_per_trial.csv,errors_per_condition.csv,series/}. \
                  Held-out trials (use = test) are never fitted.\n\nAll parameters are fitted together, with the \
                  noise, the error of the EMG and a little of everything that may be wrong. If left-out training \
                  trials ask for it, only a part of the way from the given model to the fit is taken. Every fitted \
                  value comes with a 90 % interval (carpus identify says more). Where the trials do not determine a \
                  value, the report says so: it then stays near the model's.")]
pub struct PersonalizeArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// No 90 % intervals of the fitted parameters
    #[arg(long)]
    pub no_intervals: bool,
}

/// `carpus evaluate`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus evaluate study/study.toml --models done/models --out evaluated\n  carpus evaluate \
                  study/study.toml --models personalized --models other_fit --out evaluated\n\nReads DIR/P01/NAME.osim \
                  for every participant and evaluates every NAME on the trials with use = test; the control `linear` \
                  is NAME = linear or, without it, the study's own model. Writes \
                  DIR/{report.html,evaluation_errors.csv,evaluation_means.csv,evaluation_anova.csv,\
                  evaluation_pairwise.csv}."
)]
pub struct EvaluateArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Folder with one folder of models a participant; may be given several times
    #[arg(long, value_name = "DIR", required = true)]
    pub models: Vec<PathBuf>,
}

/// `carpus study`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus study study/study.toml --out done\n  carpus study study/study.toml --steps \
                  personalize,evaluate --out done\n\nSteps, in their order: dynamometer (with [processing]: the \
                  processed study goes to DIR/processed and all other steps work on it), emg (with [emg] kind \
                  = \"raw\"), scale, sensitivity, personalize, evaluate, identify, ultrasound (with ultrasound.csv), \
                  power, conclusions (which of the dissertation's hold). What a study has no data for is named in the \
                  report with the reason.\n\nStopped at any time, even by force, and started again with the same \
                  words, it goes on where it was: what is finished lies in DIR/units under a key made of everything \
                  that it depends on. Writes DIR/report.html, the tables as CSV, DIR/models/P01/CASE.osim, \
                  DIR/identify/P01 and DIR/emg/P01. Only DIR/timings and DIR/timings.csv depend on the \
                  machine.\n\nOptional in a study, beyond the essential keys:\n  study.toml        [processing], \
                  [emg], [scaling], [strength_scaling]: see dynamometer, emg, scale, strength-scale \
                  --help\n                    [ultrasound] activation, specific_tension_n_per_cm2, posture_deg, \
                  muscle_posture_deg, fiber_to_belly_length,\n                    external_to_total_tendon_length, \
                  source;\n                    fascicles = \"fit\" with fascicle_error_percent: personalize fits \
                  fascicle_length_m, too (default: a check)\n                    [dynamometer] further_moments = \
                  { COORDINATE = \"column\" }: moments about coordinates that are held\n                    [columns] \
                  ignore = [\"column\", …], angle_unit = \"rad\"; [checks] max_gap_s\n  trials.csv        \
                  start_time_s; arm, upright (default) or flipped: the forearm turned over\n  ultrasound.csv    \
                  fascicle_length_m, pennation_angle_deg"
)]
pub struct WholeStudyArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Only these steps (comma-separated; default: all)
    #[arg(long, value_name = "STEP,…", value_delimiter = ',')]
    pub steps: Vec<String>,
    /// Starts r of the Morris screening
    #[arg(
        long,
        value_name = "R",
        default_value_t = DEFAULT_STARTS as u32,
        value_parser = clap::value_parser!(u32).range(2..=100_000)
    )]
    pub starts: u32,
    /// Rows N of the Sobol' analysis: N (m + 2) runs per condition; 0 for none
    #[arg(
        long,
        value_name = "N",
        default_value_t = DEFAULT_SOBOL as u32,
        value_parser = clap::value_parser!(u32).range(0..=1_000_000)
    )]
    pub sobol: u32,
    /// Evaluations of each Bayesian optimization
    #[arg(
        long,
        value_name = "N",
        default_value_t = DEFAULT_BAYESIAN_EVALUATIONS as u32,
        value_parser = clap::value_parser!(u32).range(11..=100_000)
    )]
    pub bayesian_evaluations: u32,
    /// Iterations of each sequential quadratic programming
    #[arg(
        long,
        value_name = "N",
        default_value_t = DEFAULT_SQP_ITERATIONS as u32,
        value_parser = clap::value_parser!(u32).range(1..=100_000)
    )]
    pub sqp_iterations: u32,
    /// What is asked about the parameters' intervals.
    #[command(flatten)]
    pub identify: IdentifyOptions,
}

/// `carpus identify`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus identify study/study.toml --out identified\n  carpus identify study/study.toml \
                  --priors literature.csv --out identified\n\nWrites \
                  DIR/P01/{identifiability.json,intervals.csv,combinations.csv,correlations.csv,next_trials.csv,\
                  draws.csv,report.html}. Held-out trials (use = test) are not used."
)]
pub struct IdentifyArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// What is asked.
    #[command(flatten)]
    pub options: IdentifyOptions,
}

/// What is asked about a study's parameters.
#[derive(Clone, Debug, Args)]
pub struct IdentifyOptions {
    /// Properties in question, under OpenSim's names (comma-separated; default: optimal_fiber_length,
    /// tendon_slack_length, max_isometric_force)
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = trimmed)]
    pub properties: Vec<String>,
    /// One factor for several muscles, per property; may be given several times
    #[arg(long, value_name = "GROUP=MUSCLE,…", value_parser = tied)]
    pub tie: Vec<TiedMuscles>,
    /// Prior knowledge: a CSV with muscle, property, mean, sd (in the file's unit; with unit = model, multiples of the
    /// model's value) and perhaps source; `carpus priors` writes one from earlier fits
    #[arg(long, value_name = "FILE")]
    pub priors: Option<PathBuf>,
    /// Level of intervals
    #[arg(long, value_name = "P", default_value_t = INTERVAL_LEVEL, value_parser = level)]
    pub level: f64,
    /// Draws from the posterior
    #[arg(
        long,
        value_name = "N",
        default_value_t = DEFAULT_DRAWS as u32,
        value_parser = clap::value_parser!(u32).range(40..=1_000_000)
    )]
    pub draws: u32,
}

/// `carpus priors`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus identify earlier/study.toml --out identified\n  carpus priors identified --out \
                  priors.csv\n  carpus identify new/study.toml --priors priors.csv --out with_priors\n\nMean and \
                  standard deviation are multiples of the value in each participant's model (unit = model), so that \
                  models scaled to different persons go together."
)]
pub struct PriorsArgs {
    /// Folders of carpus identify or carpus study (searched for identifiability.json), or such files
    #[arg(value_name = "FOLDER", required = true)]
    pub fits: Vec<PathBuf>,
    /// The table to write
    #[arg(long, short, value_name = "FILE")]
    pub out: PathBuf,
}

/// `carpus ultrasound`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus ultrasound study/study.toml --out imaging\n  carpus ultrasound study/study.toml \
                  --case personalized=personalized/{participant}/model.osim --out imaging\n\nMeasurements are read \
                  from ultrasound.csv beside study.toml; ratios and tension from its [ultrasound] section. Writes \
                  DIR/{ultrasound.json,correlations.csv,agreement.csv,measurements.csv,report.html}."
)]
pub struct UltrasoundArgs {
    /// The study: its study.toml or the folder it is in
    #[arg(value_name = "STUDY/study.toml")]
    pub study: PathBuf,
    /// A further model case: a name, and the model of each participant; may be given several times
    #[arg(long, value_name = "NAME=PATH/{participant}/model.osim", value_parser = model_case)]
    pub case: Vec<ModelCase>,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Go on although a model has components that would change the result and are not supported
    #[arg(long)]
    pub allow_unsupported: bool,
}

/// `carpus sensitivity`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus sensitivity study/study.toml --out sensitivity\n  carpus sensitivity \
                  study/study.toml --sobol 256 --out sensitivity\n\nWrites \
                  DIR/{report.html,sensitivity.json,morris.csv,convergence.csv,sensitivity_means.csv}, with --sobol \
                  sobol.csv, and with two or more participants the tests of tables 2.3 to 2.5 and 2.3b: anova.csv, \
                  anova_muscles.csv, pairwise.csv, pairwise_muscles.csv. Trials held out (use = test) are not used.")]
pub struct SensitivityArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// Starts r of the screening: r (m + 1) runs per condition for m parameters
    #[arg(
        long,
        value_name = "R",
        default_value_t = DEFAULT_STARTS as u32,
        value_parser = clap::value_parser!(u32).range(2..=100_000)
    )]
    pub starts: u32,
    /// Also Sobol' indices, from a Sobol' sequence and N (m + 2) runs per condition; best a power of two
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    pub sobol: Option<u32>,
    /// Resamples of the bootstrap behind the intervals
    #[arg(
        long,
        value_name = "N",
        default_value_t = DEFAULT_RESAMPLES as u32,
        value_parser = clap::value_parser!(u32).range(0..=1_000_000)
    )]
    pub resamples: u32,
}

/// `carpus emg`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus emg study/study.toml --out emg\n\nWrites DIR/P01/{report.html,emg/TRIAL.csv} \
                  (time_s, emg_MUSCLE: 1 = maximum voluntary contraction) and DIR/emg.json. Channels are checked for \
                  samples that are missing, flat or clipped, mains hum, and values above MVC. The MVC level is found \
                  over the trials with contraction or use mvc. Constants, all optional, with their defaults:\n  \
                  [emg]\n  kind = \"raw\"\n  band_pass_hz = [30, 250]\n  filter_order = 4                 # of the \
                  Butterworth prototype; run forward and backward: no delay, gain 1/2 at the edges\n  envelope \
                  = \"moving_rms\"          # or \"moving_mean_of_rectified\"\n  rms_window_s = 0.1\n  savitzky_golay \
                  = { order = 3, window_s = 0.1 }\n  mvc_window_s = 0.5               # largest mean over this; \
                  default: the largest sample\n  resample_hz = 100                # default: as recorded"
)]
pub struct EmgArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
}

/// `carpus dynamometer`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus dynamometer recorded/study.toml --out study\n\nWrites a study into DIR \
                  (study.toml, tables, models, data/), DIR/reports/P01.html and DIR/dynamometer.json. What is done \
                  stands in study.toml; all keys are optional, and without a key nothing of it is done:\n  \
                  [processing]\n  filter_hz = 6                # zero-phase Butterworth low-pass of angle, velocity \
                  and moment\n  filter_order = 4\n  remove_drag = true           # adds damping_n_m_s_per_deg x \
                  velocity; the new study has damping 0\n  subtract_passive = true      # the relaxed limb's moment \
                  (gravity and tissue) from the passive trials; the new study no longer includes passive and \
                  gravity\n  passive_order = 5            # polynomial in the angle, and viscous damping\n  \
                  [processing.repetitions]     # cuts trials that have no repetition number\n  by \
                  = \"moment\"                # or \"movement\"\n  threshold = 0.2              # of the largest\n  \
                  min_duration_s = 0.5\n  max_pause_s = 0.3\n  margin_s = 0.25\n  contractions = \
                  [\"isometric\", \"isotonic\", \"passive\"]\n  [emg_recorder] # EMG recorded apart, \
                  aligned by cross-correlation to a fraction of a sample\n  file = \"{trial}_emg.csv\"     # beside \
                  the trial's file\n  time = \"time_s\"\n  shared = \"torque_v\"          # its column of what both \
                  recorded\n  shared_with = \"moment_n_m\"   # the trial's column of it\n  max_delay_s = 2")]
pub struct DynamometerArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
}

/// `carpus dynamometer-drag`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus dynamometer-drag machine_30.csv machine_60.csv machine_120.csv\n  carpus \
                  dynamometer-drag study/study.toml\n\nFiles have columns time_s, angle_deg, moment_n_m and perhaps \
                  velocity_deg_per_s; a study names them by [processing] drag_runs and [columns]. The moment of an \
                  empty machine at constant velocity is -drag x velocity - friction x sign(velocity) + offset + weight \
                  of the attachment; all are estimated together, and the interval holds although neighbouring samples \
                  err alike.")]
pub struct DynamometerDragArgs {
    /// Recordings of the machine alone, or a study
    #[arg(value_name = "FILE.csv…|STUDY/study.toml", required = true)]
    pub input: Vec<PathBuf>,
}

/// `carpus scale`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus scale study/study.toml --out scaled\n  carpus scale wrist.osim --factor hand=1.05 \
                  --factor radius=1,1.08,1 --mass 3.9 --out scaled\n\nWrites DIR/P01/model.osim (DIR/model.osim for a \
                  model): the lab's file with the scaled values alone changed, and DIR/{scale.json,path_lengths.csv}. \
                  Scaled as OpenSim 4.6 does it: joint frames, mass centres, masses, inertias, path points, wrap \
                  objects, markers, translations of custom joints, and optimal fibre, tendon slack and resting lengths \
                  by the ratio of path lengths in the default pose. Maximum isometric forces stay: see carpus \
                  strength-scale.\n\nIn study.toml, a table per column <segment>_length_m of participants.csv:\n  \
                  [scaling]\n  preserve_mass_distribution = false\n  reference_mass_kg = 75.3      # the model is part \
                  of a body of this mass; or whole_body = true; or neither\n  [scaling.segments.forearm]    # column \
                  forearm_length_m\n  bodies = [\"ulna\", \"radius\"]\n  joints = [\"elbow\", \"wrist\"]  # the same \
                  length in the model; or markers = [..]; or model_length_m = 0.25\n  axes = [\"y\"]                 # \
                  default: all three"
)]
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

/// `carpus run-tool`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus run-tool inverse_dynamics_setup.xml\n  carpus run-tool reach_IK_Setup.xml --model \
                  scaled.osim\n\nTools: ScaleTool, InverseKinematicsTool, InverseDynamicsTool, ForwardTool, \
                  AnalyzeTool with Kinematics, BodyKinematics, PointKinematics, StatesReporter, MuscleAnalysis, \
                  ForceReporter, Actuation, JointReaction, StaticOptimization.\nControllers: PrescribedController, \
                  ControlSetController, CorrectionController (of a ForwardTool's setup). force_set_files: every force \
                  and muscle that a model may hold.\nSetup files of every age, IKTool and controls_file too.\nFiles \
                  are named, read and written as OpenSim 4.6 does; paths in a setup are relative to its folder. What \
                  is not supported is refused, with its line.\nThe folder of results says in carpus-output.json which \
                  setup made them; earlier ones stay, and are named."
)]
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

/// `carpus c3d`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus c3d grasp_03.c3d --out grasp_03\n\nWrites FILE_markers.trc (in metres, for \
                  inverse kinematics and scaling; run-tool reads .c3d as marker file too) and\nFILE_analog.csv (time_s \
                  and every channel, scaled to its unit). Time begins at 0 with the first frame, as in OpenSim."
)]
pub struct C3dArgs {
    /// The motion capture file
    #[arg(value_name = "FILE.c3d")]
    pub file: PathBuf,
    /// Folder to write into; carpus-output.json says what is from which recording
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
}

/// `carpus upgrade`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  carpus upgrade arm26_20.osim arm26.osim\n\nReads formats 10901 to 40600 and writes \
                  40600: OpenSim 4.6 computes the same lengths, moment arms, masses and forces as when it\nloads the \
                  old file. Files from format 40000 on keep their text but for what changed since. Older ones are \
                  written anew:\nbodies, joints, constraints, wrap objects, muscles, forces, markers and the meshes of \
                  bodies; what is left out (controllers,\nprobes, contact, …) is listed with its line."
)]
pub struct UpgradeArgs {
    /// The old model
    #[arg(value_name = "OLD.osim")]
    pub old: PathBuf,
    /// The file to write; nothing else appears beside it
    #[arg(value_name = "NEW.osim")]
    pub new: PathBuf,
}

/// A body and its scale factors.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyFactor {
    /// The body.
    pub body: String,
    /// Factors along x, y, z.
    pub factors: [f64; 3],
}

impl std::str::FromStr for BodyFactor {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || "expected BODY=FACTOR or BODY=X,Y,Z with positive numbers, e.g. hand=1.05".to_string();
        let (body, numbers) = text.rsplit_once('=').ok_or_else(expected)?;
        let numbers: Vec<f64> =
            numbers.split(',').map(|word| positive(word.trim())).collect::<Result<_, _>>().map_err(|_| expected())?;
        let factors = match numbers[..] {
            [all] => [all; 3],
            [x, y, z] => [x, y, z],
            _ => return Err(expected()),
        };
        if body.is_empty() { Err(expected()) } else { Ok(BodyFactor { body: body.to_string(), factors }) }
    }
}

/// `carpus strength-scale`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus strength-scale study/study.toml --out strong\n  carpus strength-scale \
                  study/study.toml --linear --out strong\n\nWrites DIR/P01/model.osim, the lab's file with \
                  max_isometric_force of the active muscles changed, and DIR/{strength.csv,strength.json}.\n\nOne \
                  factor per functional group: the group's moment, all its muscles fully active and at equilibrium in \
                  the posture of the maximum contraction, becomes the maximum voluntary moment: mvc_flexion_n_m and \
                  mvc_extension_n_m of participants.csv, else the largest moment of the trials with contraction mvc. \
                  Muscles belong to a group by the sign of their moment arm. In study.toml, all optional:\n  \
                  [strength_scaling]\n  posture_deg = 0            # angle of the maximum contractions; else that of \
                  the MVC trials\n  mvc_window_s = 0.1         # an MVC trial's moment is averaged over this\n  \
                  flexion = \"positive\"       # or \"negative\": sign of flexion in the coordinate\n  flexors = \
                  [\"FCR\", \"FCU\"]  # groups by name instead of by moment arm\n  extensors = [\"ECU\"]")]
pub struct StrengthScaleArgs {
    /// The study.
    #[command(flatten)]
    pub study: StudyArgs,
    /// First scale the model to the lengths of the participant's segments, as carpus scale does
    #[arg(long)]
    pub linear: bool,
}

/// `carpus power`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  carpus power paired-t --effect 0.72 --n 10 --tails 2\n  carpus power correlation \
                  --effect 0.64 --n 5 --tails 1\n  carpus power --published\n\nThe effect is Cohen's d (t-tests) or r \
                  (correlations); n is the number of participants, of two-sample-t per group.")]
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

/// An item of a list, which may have spaces behind its commas.
pub(super) fn trimmed(text: &str) -> Result<String, std::convert::Infallible> {
    Ok(text.trim().to_owned())
}

fn threads(text: &str) -> Result<NonZeroUsize, String> {
    text.parse().map_err(|_| "expected a whole number from 1 on".to_owned())
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("expected a positive number".to_string()),
    }
}

fn activation(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=1.0).contains(&value) => Ok(value),
        _ => Err("expected a number from 0 to 1".to_string()),
    }
}

fn tied(text: &str) -> Result<TiedMuscles, String> {
    let (name, muscles) = text.split_once('=').ok_or("expected GROUP=MUSCLE,MUSCLE, as in flexors=FCR,FCU")?;
    let muscles: Vec<String> = muscles.split(',').map(|m| m.trim().to_string()).filter(|m| !m.is_empty()).collect();
    if name.is_empty() || muscles.is_empty() {
        return Err("expected GROUP=MUSCLE,MUSCLE, as in flexors=FCR,FCU".to_string());
    }
    Ok(TiedMuscles { name: name.to_string(), muscles })
}

fn model_case(text: &str) -> Result<ModelCase, String> {
    match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => {
            Ok(ModelCase { name: name.to_string(), path: path.to_string() })
        }
        _ => Err("expected NAME=PATH, as in personalized=results/{participant}/model.osim".to_string()),
    }
}

fn level(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.5..=0.999).contains(&value) => Ok(value),
        _ => Err("expected a number from 0.5 to 0.999".to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn verif_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn verif_every_command_has_an_example() {
        for command in Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.contains(&format!("carpus {}", command.get_name())), "{}", command.get_name());
        }
    }

    #[test]
    fn verif_lists_may_have_spaces_behind_their_commas() {
        let line = ["carpus", "diagnose", "study.toml", "--out", "out", "--candidates", "gravity, joint_stiffness"];
        let Command::Diagnose(args) = Cli::try_parse_from(line).unwrap().command else { panic!("diagnose expected") };
        assert_eq!(args.candidates, ["gravity", "joint_stiffness"]);
    }

    #[test]
    fn verif_negative_values_are_not_taken_for_options() {
        let line = ["carpus", "paths", "m.osim", "--sweep", "flexion=-70:70:1deg", "--set", "a=-5deg"];
        let Command::Paths(args) = Cli::try_parse_from(line).unwrap().command else { panic!("paths expected") };
        assert_eq!(args.set[0].value.value, -5.0);
    }
}
