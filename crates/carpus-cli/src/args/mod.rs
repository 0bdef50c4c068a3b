//! Arguments as they are typed.

mod model;
mod parts;
mod program;
mod recordings;
mod statistics;
mod study;

use std::num::NonZeroUsize;

use clap::{Args, Parser, Subcommand};

pub use model::{
    AuditArgs, EffectsArgs, EffectsCheckArgs, EffectsCommand, EquilibriumArgs, InfoArgs, PathsArgs, RunToolArgs,
    ScaleArgs, StrengthScaleArgs, UpgradeArgs, ViewArgs,
};
pub use parts::{EffectsFile, IdentifyOptions, StudyArgs, StudyInput, StudyWithEffects};
pub use program::{BookArgs, CompletionsArgs, ManArgs};
pub use recordings::{C3dArgs, DynamometerDragArgs};
pub use statistics::{EvaluateArgs, GroupsArgs, PowerArgs, PowerTest, PriorsArgs, SensitivityArgs, UltrasoundArgs};
pub use study::{
    CheckArgs, DemoArgs, DiagnoseArgs, EffectAddArgs, EffectArgs, EffectCommand, EffectRemoveArgs, IdentifyArgs,
    InitArgs, MergeArgs, NoiseLevel, PersonalizeArgs, PlanArgs, SynthArgs, UnitsArgs, WholeStudyArgs,
};

#[cfg(feature = "live")]
pub use study::LiveArgs;

use carpus_session::provenance::DEFAULT_SEED;

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
    #[command(
        after_help = "Example:\n  carpus compare study/study.toml --out compared\n  carpus compare study/study.toml \
                  --model personalized/P01/model.osim --participant P01 --out compared\n\nWrites \
                  DIR/P01/{results.json,report.html,errors_per_trial.csv,errors_per_condition.csv,series/}."
    )]
    Compare(StudyWithEffects),
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
    #[command(after_help = "Example:\n  carpus simulate study/study.toml --participant P01 --out simulated\n\nWrites \
                  DIR/P01/{results.json,report.html} and for every trial DIR/P01/series/TRIAL.csv and .sto.")]
    Simulate(StudyWithEffects),
    /// All steps of a study and one report; resumable
    Study(WholeStudyArgs),
    /// A study in progress, in a browser: check, run, walk back
    #[cfg(feature = "live")]
    Live(LiveArgs),
    /// Which parts of a study several machines have done
    Units(UnitsArgs),
    /// One report of the parts that several machines have done
    Merge(MergeArgs),
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
    #[command(after_help = parts::text(include_str!("help/dynamometer.txt")))]
    Dynamometer(StudyArgs),
    /// The machine's own drag, from runs without a participant
    DynamometerDrag(DynamometerDragArgs),
    /// Raw EMG to normalized EMG; checks of every channel
    #[command(after_help = parts::text(include_str!("help/emg.txt")))]
    Emg(StudyArgs),
    /// Motion capture to markers (.trc) and channels (CSV)
    C3d(C3dArgs),
    /// Every model on every held-out trial, over participants
    Evaluate(EvaluateArgs),
    /// Which parameters matter: Morris screening, Sobol' indices
    Sensitivity(SensitivityArgs),
    /// Resting muscles beside ultrasound: correlation, agreement
    Ultrasound(UltrasoundArgs),
    /// What differs between groups of participants or visits
    Groups(GroupsArgs),
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

fn threads(text: &str) -> Result<NonZeroUsize, String> {
    text.parse().map_err(|_| "expected a whole number from 1 on".to_owned())
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
