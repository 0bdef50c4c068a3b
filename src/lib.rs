//! Carpus personalizes OpenSim hand and wrist models from dynamometer and EMG recordings, and shows where the model
//! fails.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use carpus::Personalize;
//!
//! # let folder = tempfile::tempdir()?;
//! # let out = folder.path().join("out");
//! let study = carpus::Study::open("fixtures/demo_study")?;
//! for participant in study.participants() {
//!     let session = participant.load()?;
//!     let fit = session.personalize(&Personalize::default())?;
//!     println!("{}", fit.errors());
//!     fit.write(&out)?; // out/P01: model.osim, results.json, report.html, …
//! }
//! # assert!(["model.osim", "results.json", "report.html"].iter().all(|file| out.join("P01").join(file).is_file()));
//! # Ok(())
//! # }
//! ```
//!
//! That is the main job. [`Study::open`] reads and checks the whole study,
//! [`load`](session::participant::StudyParticipant::load) compiles the participant's model and prepares the trials, and
//! every analysis is a request with a `default()`: [`Compare`], [`Simulate`], [`Personalize`], [`Identify`],
//! [`Diagnose`], [`Plan`]. A result holds numbers; `write` makes its files. The command line does the same, and nothing
//! else.
//!
//! # A study from memory
//!
//! Settings, trials and model need no files. A trial made of arrays gets the checks of a trial's file.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use carpus::osim::OsimFile;
//! use carpus::study::{Contraction, Direction, Participant, Settings, Study as Tables, Trial, TrialInfo, TrialUse};
//! use carpus::{Simulate, Study};
//!
//! // One second at 100 Hz: the wrist flexes by 20° while the flexors are half active.
//! let time: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
//! let angle: Vec<f64> = time.iter().map(|t| 20f64.to_radians() * t).collect();
//! let measured = vec![2.0; 100]; // N·m
//! let excitation = [0.05, 0.05, 0.05, 0.5, 0.5].map(|level| vec![level; 100]).to_vec();
//!
//! let info = TrialInfo::new("P01", "slow_flexion", Contraction::Isotonic, Direction::Flexion, TrialUse::Test);
//! let trial = Trial::from_samples(info, time, angle, measured, excitation);
//! let settings = Settings::with_defaults("slow flexion", "flexion", &["ECRL", "ECRB", "ECU", "FCR", "FCU"])?;
//! let tables = Tables::of_trials(settings, vec![Participant::named("P01")], vec![trial])?;
//!
//! let study = Study::from_memory(tables, OsimFile::read("models/wrist.osim")?);
//! let session = study.participants().next().ok_or("no participant")?.load()?;
//! let simulated = session.simulate(&Simulate::default())?;
//! let last = simulated.trials[0].moment[99];
//! assert!(last > 0.0, "half active flexors flex: {last} N·m");
//! # Ok(())
//! # }
//! ```
//!
//! # Moment arms
//!
//! A model by itself, over a range of a coordinate:
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use carpus::session::progress::Silent;
//! use carpus::session::sweep::SweepPaths;
//!
//! let swept = SweepPaths::new("models/wrist.osim", "flexion=-60:60:20deg".parse()?).run(&Silent)?;
//! for muscle in &swept.figure.muscles {
//!     println!("{}: {:?} m", muscle.name, muscle.moment_arm_m);
//! }
//! let arm = |name: &str| swept.figure.muscles.iter().find(|m| m.name == name).map(|m| m.moment_arm_m[3]);
//! assert!(arm("FCR") > Some(0.0) && arm("ECRL") < Some(0.0), "flexors flex, extensors extend");
//! # Ok(())
//! # }
//! ```
//!
//! # Arrays into a model, without a study
//!
//! [`simulation`] compiles a model once and simulates arrays with any muscle parameters. What does not depend on the
//! parameters is computed once per trial, by [`prepare`](simulation::MusculoskeletalModel::prepare).
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use carpus::osim::OsimFile;
//! use carpus::simulation::{MusculoskeletalModel, Options, Recording, Setup};
//! use carpus::study::Settings;
//!
//! let names = ["ECRL", "ECRB", "ECU", "FCR", "FCU"];
//! let setup = Setup::from_settings(&Settings::with_defaults("arrays", "flexion", &names)?);
//! let model = MusculoskeletalModel::compile(&OsimFile::read("models/wrist.osim")?.spec, &setup)?;
//!
//! let time: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
//! let (angle, excitation) = (vec![0.0; 100], vec![0.3; 100]);
//! let name = "held".to_owned();
//! let excitation: Vec<&[f64]> = vec![&excitation; names.len()];
//! let recording = Recording { name, time: &time, angle: &angle, excitation, held: Vec::new() };
//! let trial = model.prepare(&recording, &Options::default())?;
//!
//! let mut parameters = model.nominal_parameters();
//! let before = trial.simulate(&parameters)?.moment;
//! parameters[3].max_isometric_force *= 2.0; // FCR
//! let after = trial.simulate(&parameters)?.moment;
//! assert!(after[99] > before[99], "a stronger flexor flexes more");
//! # Ok(())
//! # }
//! ```
//!
//! # An effect of your own
//!
//! A physical effect that the catalogue lacks is a formula in a text file. From then on every analysis knows it beside
//! those of the catalogue ([`effects::catalogue`]).
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use carpus::Study;
//! use carpus::effects::{forward_model::Setting, moments::simulate_all};
//! use carpus::session::{diagnose::forward_model, own_effects};
//!
//! // Cogging of the machine: A*sin(n*q).
//! let effect = own_effects::read("docs/src/guide/cogging.toml".as_ref(), None)?;
//! let study = Study::open("fixtures/demo_study")?;
//! let session = study.participants().next().ok_or("no participant")?.load()?;
//! let forward = forward_model(&session.data)?;
//! let simulate = |effects: &[Setting]| simulate_all(&forward, &forward.nominal_parameters(), effects);
//!
//! let cogging = Setting { effect, values: vec![0.3, 14.0] }; // A in N·m, n in 1/rad
//! let (without, with) = (simulate(&[])?, simulate(&[cogging])?);
//! let differences = without.iter().zip(&with).flat_map(|(a, b)| a.moment.iter().zip(&b.moment));
//! let largest = differences.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
//! assert!(0.2 < largest && largest < 0.31, "an amplitude of 0.3 N·m: {largest}");
//! # Ok(())
//! # }
//! ```
//!
//! # Where to look further
//!
//! | for | module |
//! |---|---|
//! | studies and analyses, as the command line has them | [`session`] |
//! | reading, editing and writing `.osim` files, byte for byte | [`osim`] |
//! | OpenSim's time series: `.sto`, `.mot`, `.trc`, `.c3d` | [`storage`] |
//! | kinematics and muscle paths | [`multibody`], [`paths`] |
//! | muscles, other forces, equations of motion | [`muscles`], [`forces`], [`dynamics`] |
//! | OpenSim's tools, from its setup files | [`tools`] |
//! | EMG and dynamometer recordings | [`signals`], [`dynamometer`] |
//! | error measures and statistics | [`evaluation`], [`statistics`] |
//!
//! `examples/` has five short programs. Data flow, modules and invariants are described in `ARCHITECTURE.md`. Inside
//! the library all quantities are SI units and radians; another unit is part of a name (`angle_deg`).
//!
//! The feature `session` alone leaves out the command line. Without default features there is neither [`session`] nor
//! [`report`].

#[cfg(feature = "session")]
pub use session::compare::Compare;
#[cfg(feature = "session")]
pub use session::diagnose::Diagnose;
#[cfg(feature = "session")]
pub use session::diagnostic::{Diagnostic, Failure};
#[cfg(feature = "session")]
pub use session::evaluate::Evaluate;
#[cfg(feature = "session")]
pub use session::identify::Identify;
#[cfg(feature = "session")]
pub use session::personalize::Personalize;
#[cfg(feature = "session")]
pub use session::plan::Plan;
#[cfg(feature = "session")]
pub use session::simulate::Simulate;
#[cfg(feature = "session")]
pub use session::study::Study;
#[cfg(feature = "session")]
pub use session::whole_study::WholeStudy;

#[cfg(feature = "cli")]
pub use carpus_cli as cli;
pub use carpus_diagnosis as diagnosis;
pub use carpus_effects as effects;
pub use carpus_identifiability as identifiability;
pub use carpus_multibody::{dynamics, forces, multibody, muscles, paths};
pub use carpus_numerics::{numerics, plausible, printable, regular_file, signals, spatial, statistics};
pub use carpus_osim::{functions, osim, storage};
pub use carpus_personalization::{personalization, sensitivity};
#[cfg(feature = "report")]
pub use carpus_report as report;
#[cfg(feature = "session")]
pub use carpus_session as session;
pub use carpus_simulation::{evaluation, imaging, scaling, simulation};
pub use carpus_study::{dynamometer, study};
pub use carpus_tools as tools;
