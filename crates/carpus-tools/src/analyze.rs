//! Analyses along a given motion: OpenSim's `AnalyzeTool`.

use super::analysis::{Analysis, Instant, add_results};
use super::error::{ToolError, ToolProblem};
use super::external_loads::add_external_loads;
use super::finite_columns::require_finite;
use super::force_analyses::{Actuation, ForceReporter, JointReaction};
use super::kinematics::{BodyKinematics, Kinematics, PointKinematics, StatesReporter};
use super::motion::{Motion, read_coordinates};
use super::muscle_analysis::MuscleAnalysis;
use super::result::Outcome;
use super::setup::Properties;
use super::static_optimization::StaticOptimization;
use super::system::{NotFinite, System, SystemState, SystemWork};
use carpus_multibody::dynamics::DynamicsError;
use carpus_multibody::muscles::EquilibriumError;
use carpus_numerics::printable::number;
use carpus_osim::osim::Document;
use carpus_osim::storage::{Storage, spline};

/// Analyses that are run.
const ANALYSES: &str = "Kinematics, BodyKinematics, PointKinematics, StatesReporter, MuscleAnalysis, ForceReporter, \
                        Actuation, JointReaction, StaticOptimization";

/// Digits behind the point that are written at most: doubles have no more than 17 that mean something.
const MOST_DIGITS: usize = 40;

/// Properties that all tools with a model have (`AbstractTool`).
pub struct Frame {
    /// Name, the beginning of results' names.
    pub name: String,
    /// Folder of results.
    pub results: std::path::PathBuf,
    /// Digits behind the point.
    pub precision: usize,
    /// First and last time [s].
    pub time: [f64; 2],
    /// Whether muscles are brought to equilibrium.
    pub equilibrate: bool,
    /// How a motion is integrated.
    pub integrator: IntegratorSettings,
}

/// How a motion is integrated.
#[derive(Clone, Copy, Debug)]
pub struct IntegratorSettings {
    /// Error allowed per step, as Simbody's `Integrator::setAccuracy` takes it.
    pub error_tolerance: f64,
    /// Least and largest step [s].
    pub step_range: [f64; 2],
    /// Steps of a simulation, rejected ones among them, at most.
    pub most_steps: usize,
}

impl IntegratorSettings {
    /// Reads them, with the defaults of OpenSim's `AbstractTool`.
    ///
    /// # Errors
    /// Values that no integrator can work with.
    fn read(tool: &Properties) -> Result<IntegratorSettings, ToolError> {
        let is_accuracy = |value: f64| value > 0.0 && value < 1.0;
        let error_tolerance =
            tool.number_that("integrator_error_tolerance", 1e-5, "a number above 0 and below 1", is_accuracy)?;
        let is_step = |value: f64| value > 0.0;
        let largest = tool.number_that("maximum_integrator_step_size", 1.0, "a time above 0 s", is_step)?;
        let expected = format!("a time from 0 s to maximum_integrator_step_size ({} s)", number(largest));
        let is_least = |value: f64| (0.0..=largest).contains(&value);
        let least = tool.number_that("minimum_integrator_step_size", 0.0, &expected, is_least)?;
        // Of formats of old; it has no effect in OpenSim 4.6 either.
        tool.number_that("integrator_fine_tolerance", 1e-5, "a number above 0", is_step)?;
        let most_steps = tool.count("maximum_number_of_integrator_steps", 20_000, 1..=usize::MAX)?;
        Ok(IntegratorSettings { error_tolerance, step_range: [least, largest], most_steps })
    }
}

impl Frame {
    /// Reads them and adds external loads to the system.
    ///
    /// # Errors
    /// Values or files that cannot be used.
    pub fn read(tool: &Properties, system: &mut System, outcome: &mut Outcome) -> Result<Frame, ToolError> {
        if let Some(loads) = tool.file("external_loads_file") {
            for text in add_external_loads(&loads, system)? {
                outcome.warn(&loads, 0, text);
            }
        }
        tool.ignore_all(&["model_file"]);
        let precision = tool.count("output_precision", 8, 0..=MOST_DIGITS)?;
        let time = [tool.time("initial_time", 0.0)?, tool.time("final_time", 1.0)?];
        if time[0] == f64::INFINITY {
            return Err(tool.bad_value("initial_time", "a finite time", &tool.string("initial_time")));
        }
        if time[1] < time[0] {
            let expected = format!("a time from initial_time ({} s) on", number(time[0]));
            return Err(tool.bad_value("final_time", &expected, &format!("{}", time[1])));
        }
        Ok(Frame {
            name: tool.name(),
            results: tool.setup().resolve(&tool.string("results_directory")),
            precision,
            time,
            integrator: IntegratorSettings::read(tool)?,
            equilibrate: tool.boolean("solve_for_equilibrium_for_auxiliary_states", false)?,
        })
    }
}

/// Reads the analyses of a tool.
///
/// - `wanted`: accelerations of the motion, where it is given
///
/// # Errors
/// A class that is not supported; values that cannot be used.
pub fn read_analyses(
    tool: &Properties,
    system: &System,
    wanted: Option<&dyn Fn() -> Result<Storage, ToolError>>,
) -> Result<Vec<Box<dyn Analysis>>, ToolError> {
    let mut analyses: Vec<Box<dyn Analysis>> = Vec::new();
    for analysis in tool.objects("AnalysisSet") {
        if !analysis.boolean("on", true)? {
            analysis.ignore();
            continue;
        }
        analyses.push(match (analysis.class(), wanted) {
            ("Kinematics", _) => Box::new(Kinematics::read(&analysis, system)?),
            ("BodyKinematics", _) => Box::new(BodyKinematics::read(&analysis, system)?),
            ("PointKinematics", _) => Box::new(PointKinematics::read(&analysis, system)?),
            ("StatesReporter", _) => Box::new(StatesReporter::read(&analysis, system)?),
            ("MuscleAnalysis", _) => Box::new(MuscleAnalysis::read(&analysis, system)?),
            ("ForceReporter", _) => Box::new(ForceReporter::read(&analysis, system)?),
            ("Actuation", _) => Box::new(Actuation::read(&analysis, system)?),
            ("JointReaction", _) => Box::new(JointReaction::read(&analysis, system)?),
            ("StaticOptimization", Some(wanted)) => Box::new(StaticOptimization::read(&analysis, system, wanted()?)?),
            (class, _) => {
                let problem =
                    ToolProblem::Unsupported { what: class.to_owned(), instead: format!("analyses are {ANALYSES}") };
                return Err(ToolError::at(tool.setup().path(), analysis.line(), problem));
            }
        });
    }
    Ok(analyses)
}

/// Lets analyses record an instant, and notes what is not finite of it.
///
/// # Errors
/// What cannot be computed.
pub fn record<'s>(
    analyses: &mut [Box<dyn Analysis>],
    system: &'s System,
    work: &mut SystemWork<'s>,
    state: &SystemState,
    step: Option<usize>,
    faults: &mut Faults,
) -> Result<(), ToolError> {
    let proceeds = |a: &dyn Analysis| step.is_none_or(|step| step % a.options().step_interval == 0);
    if !analyses.iter().any(|a| proceeds(a.as_ref())) {
        return Ok(());
    }
    let evaluation = system.evaluate(work, state, &|_| true);
    if analyses.iter().any(|a| proceeds(a.as_ref()) && a.uses_forces()) {
        faults.note_not_finite(system.not_finite(work, state, &evaluation, &|_| true));
        // The check may have evaluated single forces.
        work.dynamics.update(&state.q, &state.u);
    }
    let (mut udot, mut multipliers) = (None, None);
    if analyses.iter().any(|a| a.needs_accelerations() && proceeds(a.as_ref())) {
        let (found, error) = system.accelerations(work, state, &evaluation.applied);
        // Accelerations of bodies into the buffers.
        work.dynamics.inverse_dynamics(&state.q, &state.u, found.udot.as_slice(), &evaluation.applied);
        (udot, multipliers) = (Some(found.udot), Some(found.multipliers));
        faults.note_undetermined(state.time, error);
    }
    for analysis in analyses.iter_mut().filter(|a| proceeds(a.as_ref())) {
        let (udot, multipliers) = (udot.as_ref(), multipliers.as_ref());
        let mut instant = Instant { system, work, state, evaluation: &evaluation, udot, multipliers };
        analysis.record(&mut instant)?;
    }
    Ok(())
}

/// What went wrong along a motion: with how many times, and the first.
#[derive(Default)]
pub struct Faults {
    /// Times at which accelerations are not determined.
    undetermined: (usize, Option<(f64, DynamicsError)>),
    /// Times at which a force is not finite.
    not_finite: (usize, Option<NotFinite>),
    /// Muscles that could not be balanced: at how many times, the first of them, and why.
    unbalanced: Vec<(String, usize, f64, EquilibriumError)>,
}

impl Faults {
    fn note_undetermined(&mut self, time: f64, found: Option<DynamicsError>) {
        if let Some(error) = found {
            self.undetermined.0 += 1;
            self.undetermined.1.get_or_insert((time, error));
        }
    }

    fn note_not_finite(&mut self, found: Option<NotFinite>) {
        if let Some(found) = found {
            self.not_finite.0 += 1;
            self.not_finite.1.get_or_insert(found);
        }
    }

    /// Notes muscles that could not be balanced at a time.
    pub fn note_unbalanced(&mut self, time: f64, failed: Vec<EquilibriumError>) {
        for error in failed {
            match self.unbalanced.iter_mut().find(|(muscle, ..)| muscle == error.muscle()) {
                Some((_, times, ..)) => *times += 1,
                None => self.unbalanced.push((error.muscle().to_owned(), 1, time, error)),
            }
        }
    }

    /// Fails if a force that acts is not finite at a state.
    ///
    /// - `acts`: whether an actor applies its force
    ///
    /// # Errors
    /// Its muscle, pose and cause.
    pub fn require_finite(
        &mut self,
        system: &System,
        work: &mut SystemWork,
        state: &SystemState,
        acts: &dyn Fn(usize) -> bool,
    ) -> Result<(), ToolError> {
        let evaluation = system.evaluate(work, state, acts);
        self.note_not_finite(system.not_finite(work, state, &evaluation, acts));
        self.not_finite_error(system).map_or(Ok(()), Err)
    }

    fn not_finite_error(&self, system: &System) -> Option<ToolError> {
        let (times, found) = (self.not_finite.0, self.not_finite.1.as_ref()?);
        let own = self.unbalanced.iter().find(|(muscle, ..)| *muscle == found.owner);
        let unbalanced = own.map(|(_, times, first, error)| {
            format!("; it could not be balanced at {}, the first t = {first} s: {error}", counted(*times, "time"))
        });
        let others = (times > 1).then(|| format!("; so it is at {} in all", counted(times, "time")));
        let problem = ToolProblem::NotFinite {
            owner: found.owner.clone(),
            quantity: found.quantity,
            value: found.value,
            time: found.time,
            pose: found.pose.clone(),
            cause: unbalanced.or(others).unwrap_or_default(),
        };
        let line = system.spec.muscles.iter().find(|m| m.name == found.owner).map_or(0, |m| m.at.line);
        Some(ToolError::at(&system.path, line, problem))
    }

    /// Warns of what OpenSim goes on with: accelerations that are not determined are not numbers, muscles that cannot
    /// be balanced keep their default fibre length.
    ///
    /// # Errors
    /// A force that is not finite, with muscle, pose and cause.
    pub fn conclude(self, system: &System, outcome: &mut Outcome) -> Result<(), ToolError> {
        let is_told = system.muscles_never_finite();
        let told = |muscle: &str| is_told.iter().any(|(i, _)| system.muscles[*i].name == muscle);
        for (i, why) in &is_told {
            let (muscle, line) = (&system.muscles[*i].name, system.spec.muscles[*i].at.line);
            outcome.warn(&system.path, line, format!("{muscle}: {why}"));
        }
        if let Some(error) = self.not_finite_error(system) {
            return Err(error);
        }
        let unbalanced: Vec<_> = self.unbalanced.iter().filter(|(muscle, ..)| !told(muscle)).collect();
        if let Some((_, times, time, error)) = unbalanced.first() {
            let muscles = counted(unbalanced.len(), "muscle");
            let text = format!(
                "{muscles} could not be balanced; the first at {}, from t = {time} s on: {error}",
                counted(*times, "time")
            );
            outcome.warn(&system.path, 0, text);
        }
        if let (times, Some((time, error))) = &self.undetermined {
            let text = format!(
                "accelerations are not numbers at {}, the first t = {time} s: {error}",
                counted(*times, "time")
            );
            outcome.warn(&system.path, 0, text);
        }
        Ok(())
    }
}

/// A number of things in words.
fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// Runs the tool.
///
/// - `document`: the model's own text, for its controllers
///
/// # Errors
/// The setup, its files, or what the analyses ask for.
pub fn run(tool: &Properties, mut system: System, document: Document, outcome: &mut Outcome) -> Result<(), ToolError> {
    let frame = Frame::read(tool, &mut system, outcome)?;
    let cutoff = tool.number("lowpass_cutoff_frequency_for_coordinates", -1.0)?;
    if tool.file("controls_file").is_some() {
        let text = "controls_file is not used along a given motion: activations are those of the states";
        outcome.warn(tool.setup().path(), tool.line(), text);
    }
    system.read_controllers_as_needed(document, tool, &|_, _, _| false, outcome)?;
    let file = tool.file("states_file").or_else(|| tool.file("coordinates_file"));
    let Some(file) = file else {
        return Err(tool.missing("states_file", "a states_file or a coordinates_file"));
    };
    let (states, others) = match tool.file("states_file") {
        Some(file) => {
            tool.ignore_all(&["coordinates_file", "speeds_file"]);
            (states_from_file(&file, &system, outcome)?, None)
        }
        None => {
            let storage = read_coordinates(&file, cutoff, &system)?;
            storage.warnings.iter().for_each(|text| outcome.warn(&file, 0, text.clone()));
            let motion = Motion::from_storage(storage, &system, &file)?;
            (states_from_motion(motion, tool, &system, outcome)?, Some(system.default_state()?))
        }
    };
    let index = |time: f64| states.partition_point(|s| s.time <= time).saturating_sub(1);
    let (first, last) = (index(frame.time[0]), index(frame.time[1]));
    let wanted = || accelerations_of(&states, &system, &file);
    let mut analyses = read_analyses(tool, &system, Some(&wanted))?;
    if analyses.is_empty() {
        return Err(tool.missing("AnalysisSet", "an analysis that is on"));
    }
    if analyses.iter().any(|a| a.needs_forces()) {
        system.require_all_forces(&|_| false)?;
    }
    let mut work = system.new_work();
    let mut faults = Faults::default();
    for (i, state) in states.iter().enumerate().take(last + 1).skip(first) {
        let mut state = match &others {
            Some(others) => SystemState { time: state.time, q: state.q.clone(), u: state.u.clone(), ..others.clone() },
            None => state.clone(),
        };
        system.assemble(state.time, &mut state.q)?;
        if frame.equilibrate {
            let failed = system.equilibrate(&mut work, &mut state);
            faults.note_unbalanced(state.time, failed);
        }
        let step = (i != first && i != last).then_some(i);
        record(&mut analyses, &system, &mut work, &state, step, &mut faults)?;
    }
    faults.conclude(&system, outcome)?;
    for analysis in &analyses {
        analysis.warnings().into_iter().for_each(|text| outcome.warn(tool.setup().path(), 0, text));
        add_results(analysis.as_ref(), &frame.name, &frame.results, frame.precision, outcome);
    }
    let (from, to) = (states[first].time, states[last].time);
    outcome.summary.push(format!("{} analyses of {} times, {from} to {to} s", analyses.len(), last + 1 - first));
    Ok(())
}

/// States from a file; what it lacks is at its default.
///
/// # Errors
/// The file.
pub fn states_from_file(
    file: &std::path::Path,
    system: &System,
    outcome: &mut Outcome,
) -> Result<Vec<SystemState>, ToolError> {
    let storage = Storage::read(file)?;
    storage.warnings.iter().for_each(|text| outcome.warn(file, 0, text.clone()));
    if storage.in_degrees {
        let what = "states have to be in radians: the header says inDegrees=yes".to_owned();
        return Err(ToolError::new(file, ToolProblem::Data { what }));
    }
    let default = system.default_state()?;
    let names = system.state_names();
    let columns: Vec<Option<usize>> = names.iter().map(|name| storage.find_state(name)).collect();
    require_finite(&storage, &columns.iter().flatten().copied().collect::<Vec<_>>(), file)?;
    let missing: Vec<&str> = names.iter().zip(&columns).filter(|(_, c)| c.is_none()).map(|(n, _)| n.as_str()).collect();
    if !missing.is_empty() {
        let shown = missing.iter().take(4).copied().collect::<Vec<_>>().join(", ");
        let text = format!("{} states are not in this file and take their default values: {shown}", missing.len());
        outcome.warn(file, 0, text);
    }
    let state = |(time, row): (&f64, &Vec<f64>)| {
        let mut state = SystemState { time: *time, ..default.clone() };
        for (name, column) in names.iter().zip(&columns) {
            if let Some(column) = column {
                system.set_state(&mut state, name, row[*column]);
            }
        }
        state
    };
    Ok(storage.time.iter().zip(&storage.rows).map(state).collect())
}

/// Times, coordinates and speeds; other states are empty: those of many muscles at all times of a long motion would not
/// fit into memory.
fn states_from_motion(
    motion: Motion,
    tool: &Properties,
    system: &System,
    outcome: &mut Outcome,
) -> Result<Vec<SystemState>, ToolError> {
    if !motion.missing.is_empty() {
        let text = format!("coordinates that are not in the coordinates_file are 0: {}", motion.missing.join(", "));
        outcome.warn(tool.setup().path(), tool.line(), text);
    }
    let mut states: Vec<SystemState> = motion
        .time
        .iter()
        .zip(motion.q.into_iter().zip(motion.u))
        .map(|(time, (q, u))| SystemState { time: *time, q, u, ..SystemState::default() })
        .collect();
    if let Some(file) = tool.file("speeds_file") {
        let mut speeds = Storage::read(&file)?;
        super::motion::to_radians(&mut speeds, system);
        let columns: Vec<Option<usize>> = system
            .spec
            .coordinates
            .iter()
            .map(|c| speeds.find_state(&format!("{}/speed", c.at.path)).or_else(|| speeds.find(&c.name)))
            .collect();
        require_finite(&speeds, &columns.iter().flatten().copied().collect::<Vec<_>>(), &file)?;
        for state in &mut states {
            let row = speeds.at(state.time);
            for (u, column) in state.u.iter_mut().zip(&columns) {
                if let Some(column) = column {
                    *u = row[*column];
                }
            }
        }
    }
    Ok(states)
}

/// Accelerations of all coordinates: derivatives of splines of degree 5 through their speeds.
fn accelerations_of(states: &[SystemState], system: &System, file: &std::path::Path) -> Result<Storage, ToolError> {
    let time: Vec<f64> = states.iter().map(|s| s.time).collect();
    let degree = if time.len() >= 6 { 5 } else { 1 };
    let splines = (0..system.model.n_coordinates()).map(|i| {
        let speeds: Vec<f64> = states.iter().map(|s| s.u[i]).collect();
        spline(degree, &time, &speeds).map_err(|e| ToolError::new(file, ToolProblem::Function(e)))
    });
    let splines = splines.collect::<Result<Vec<_>, _>>()?;
    let mut storage = Storage::new("accelerations", system.model.coordinates.iter().map(|c| c.name.clone()).collect());
    for t in &time {
        storage.push(*t, splines.iter().map(|s| s.derivative(*t)).collect());
    }
    Ok(storage)
}
