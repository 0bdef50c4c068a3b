//! A participant's trials, simulated with any set of effects.

mod effect_derivatives;
mod effects_in_order;
pub mod recorded_changes;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock};

use super::angle_noise::{AngleNoise, Disturbance, moving};
use super::covered::Covered;
use super::denoising::{Denoised, denoised};
use super::effect::{ExcitationScope, JointState, Role, Stage, TrialContext};
use super::holds::steadied_trials;
use super::joint_traits::JointTraits;
pub use super::setting::Setting;
use super::silent_muscles::SilentMuscles;
use super::trial_record::{TrialRecord, records};
use effects_in_order::{MuscleChange, add_moments, changes_excitation, in_order, muscle_change, scope, shown_effects};
use nalgebra::DMatrix;

use carpus_osim::osim::spec::{ModelSpec, MuscleSpec};
use carpus_simulation::simulation::{
    AngleResponse, ExcitationTangent, FiberAccuracy, HeldCoordinate, MuscleParameters, MuscleSolution,
    MusculoskeletalModel, Options, PreparedTrial, Recording, RestResponse, SimulationError,
};
use carpus_study::study::{Trial, TrialUse};

/// Noise of the recorded angle.
#[derive(Clone)]
struct DrawnNoise {
    noise: AngleNoise,
    /// Per trial.
    draws: Vec<Vec<Disturbance>>,
    /// Whether some of it was white, so that speeds are off by more than the rest makes them.
    was_white: bool,
}

/// A participant's trials and model, ready to be simulated with effects.
#[derive(Clone)]
pub struct ForwardModel {
    /// The trials, in the order of recording.
    pub trials: Vec<TrialRecord>,
    /// Specifications of the active muscles.
    pub muscles: Vec<MuscleSpec>,
    /// Sign of each muscle's moment arm.
    pub directions: Vec<f64>,
    /// Effects that the model has beside its file; they act in every simulation.
    given: Vec<Setting>,
    /// None: the angle is exact.
    angle_noise: Option<DrawnNoise>,
    silent_muscles: Vec<Arc<SilentMuscles>>,
    /// How strong the joint is beside a wrist, and where its middle is.
    pub joint: JointTraits,
    /// What another session covers, in whose units columns are; `None`: what these trials do.
    pub covered: Option<Covered>,
    model: MusculoskeletalModel,
    base: Vec<PreparedTrial>,
    options: Options,
    by_motion: Vec<ByMotion>,
}

/// Derivatives of the joint's moment by parameters of absent effects that follow the recorded motion alone,
/// of one trial, once asked for: by identifier and place of the parameter.
#[derive(Default)]
struct ByMotion(Mutex<BTreeMap<(&'static str, usize), Arc<Vec<f64>>>>);

impl Clone for ByMotion {
    /// A model that is changed may have other units.
    fn clone(&self) -> ByMotion {
        ByMotion::default()
    }
}

/// Excitations of one trial, and the trial prepared with them.
#[derive(Clone)]
pub struct TrialInput {
    /// Excitation of each muscle before effects: as recorded, or without its noise.
    pub excitation: Vec<Vec<f64>>,
    prepared: PreparedTrial,
}

/// What comes out of the muscles in one trial: everything before joint and sensor.
pub struct Core {
    /// The trial with its excitations, angle and muscles.
    pub prepared: PreparedTrial,
    /// Excitation of each muscle after the effects on it.
    pub excitation: Vec<Vec<f64>>,
    /// Moment of muscles, passive forces, drag [N·m].
    pub moment: Vec<f64>,
    /// Moment of the muscles alone [N·m].
    muscle_moment: Vec<f64>,
    /// What effects multiply the moment of every muscle by, per sample.
    pub factors: Vec<Vec<f64>>,
    /// Derivatives of the moment by log F_max, log l_opt and log l_slack of every muscle, in this order;
    /// empty unless asked for.
    pub by_parameters: Vec<Vec<f64>>,
    /// Of every muscle; empty unless derivatives were asked for.
    pub solutions: Vec<MuscleSolution>,
    /// The trial whose moment effects are shown ([`shown_effects`]), where one of them changes what drives
    /// the muscles; `None`: they are shown this one's.
    without: Option<Box<Core>>,
    /// Of every muscle, once asked for ([`Core::tangents`]).
    tangents: OnceLock<Option<Vec<ExcitationTangent>>>,
    /// Of all muscles and of everything else, once asked for.
    by_angle: OnceLock<AngleResponse>,
    rest_by_angle: OnceLock<RestResponse>,
}

/// Accuracy that a diagnosis needs: moments within about 10⁻³ N·m, far below any sensor's noise, in half the time.
pub const DIAGNOSIS_ACCURACY: FiberAccuracy = FiberAccuracy { tolerance: 5e-5, max_step: 0.04 };

/// Times that the moment of the muscles is computed anew where it acts back on the joint's angle: what is
/// missing is then 1 to 2 % of the effect at the most compliant joint, and would be 10 to 15 % without.
const FEEDBACK_ROUNDS: usize = 1;

/// Muscle parameters whose logarithms are fitted, per muscle.
pub const FITTED_PER_MUSCLE: usize = 3;

impl Core {
    /// Without derivatives.
    fn bare(prepared: PreparedTrial, excitation: Vec<Vec<f64>>, moment: Vec<f64>) -> Core {
        Core {
            muscle_moment: of_muscles(&moment, &prepared),
            prepared,
            excitation,
            moment,
            factors: Vec::new(),
            by_parameters: Vec::new(),
            solutions: Vec::new(),
            without: None,
            tangents: OnceLock::new(),
            by_angle: OnceLock::new(),
            rest_by_angle: OnceLock::new(),
        }
    }

    /// The muscles' moment that effects are shown: without those that ask for it.
    fn shown(&self) -> &[f64] {
        self.without.as_ref().map_or(&self.muscle_moment, |without| &without.muscle_moment)
    }
}

/// A trial's moment without its forces that are not muscles'.
fn of_muscles(moment: &[f64], prepared: &PreparedTrial) -> Vec<f64> {
    moment.iter().zip(prepared.moment_without_muscles()).map(|(all, rest)| all - rest).collect()
}

impl ForwardModel {
    /// Prepares the trials of a participant.
    ///
    /// - `spec`, `model`: the participant's model, compiled for the study
    /// - `trials`: all that are not ignored, in the order of recording
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn new(
        spec: &ModelSpec,
        model: &MusculoskeletalModel,
        trials: &[Trial],
    ) -> Result<ForwardModel, SimulationError> {
        Self::with_accuracy(spec, model, trials, FiberAccuracy::default())
    }

    /// As [`ForwardModel::new`], with another accuracy of fibre lengths.
    ///
    /// # Errors
    /// As there.
    pub fn with_accuracy(
        spec: &ModelSpec,
        model: &MusculoskeletalModel,
        trials: &[Trial],
        accuracy: FiberAccuracy,
    ) -> Result<ForwardModel, SimulationError> {
        let muscles: Vec<MuscleSpec> =
            model.muscle_names().filter_map(|name| spec.muscles.iter().find(|m| m.name == name)).cloned().collect();
        let recordings: Vec<Recording> = trials.iter().map(Recording::from).collect();
        let options = Options { allow_angle_outside_range: true, fiber: accuracy, ..Options::default() };
        let base = model.prepare_all_with_margin(&recordings, &options)?;
        let directions = directions(&base, muscles.len());
        Ok(ForwardModel {
            trials: records(trials, muscles.len()),
            muscles,
            directions,
            given: Vec::new(),
            angle_noise: None,
            silent_muscles: SilentMuscles::of_trials(spec, model, &recordings, &base)?,
            joint: JointTraits::of(trials, spec.coordinates[model.coordinate().0].range, model.weight_moment()),
            covered: None,
            model: model.clone(),
            by_motion: base.iter().map(|_| ByMotion::default()).collect(),
            base,
            options,
        })
    }

    /// Prepares trials for a diagnosis: the joint is still where the machine holds it, and elsewhere its
    /// recorded angle is taken to be noisy.
    ///
    /// # Errors
    /// As there.
    pub fn for_diagnosis(
        spec: &ModelSpec,
        model: &MusculoskeletalModel,
        trials: &[Trial],
    ) -> Result<ForwardModel, SimulationError> {
        let Denoised { trials, left } = denoised(trials);
        let was_white = !left.is_empty();
        let noise = match AngleNoise::of(&trials) {
            Some(noise) => noise,
            None if was_white => AngleNoise { sd: 0.0, length: LEFT_LENGTH },
            None => return Self::with_accuracy(spec, model, &trials, DIAGNOSIS_ACCURACY),
        };
        let trials = steadied_trials(&trials, &noise);
        let forward = Self::with_accuracy(spec, model, &trials, DIAGNOSIS_ACCURACY)?;
        let draws = |(g, t): (usize, &TrialRecord)| {
            let mut draws = noise.draws(&t.time, &t.angle, g as u64);
            if let Some(left) = left.get(g) {
                add_where_it_moves(&mut draws, left, &t.time, &t.angle);
            }
            draws
        };
        let draws = forward.trials.iter().enumerate().map(draws).collect();
        Ok(ForwardModel { angle_noise: Some(DrawnNoise { noise, draws, was_white }), ..forward })
    }

    /// The model with effects that it has beside its file: they act in every simulation, before others of their kind.
    pub fn with_given(self, given: Vec<Setting>) -> ForwardModel {
        ForwardModel { given, ..self }
    }

    /// The effects that the model has beside its file.
    pub fn given(&self) -> &[Setting] {
        &self.given
    }

    /// Effects that act: those that the model has, then those asked for.
    fn acting<'a>(&self, effects: &'a [Setting]) -> Cow<'a, [Setting]> {
        match self.given.is_empty() {
            true => Cow::Borrowed(effects),
            false => Cow::Owned(self.given.iter().chain(effects).cloned().collect()),
        }
    }

    /// Muscles that the study does not activate: which there are. What they do depends on the trial's posture.
    fn silent(&self) -> &SilentMuscles {
        static NONE: SilentMuscles = SilentMuscles::none();
        self.silent_muscles.first().map_or(&NONE, |silent| silent)
    }

    /// Positions of the trials of a use.
    pub fn trials_for(&self, usage: TrialUse) -> Vec<usize> {
        (0..self.trials.len()).filter(|g| self.trials[*g].info.usage == usage).collect()
    }

    /// The muscles' parameters as the model has them.
    pub fn nominal_parameters(&self) -> Vec<MuscleParameters> {
        self.model.nominal_parameters()
    }

    /// The recorded trial as prepared without effects.
    pub fn base(&self, trial: usize) -> &PreparedTrial {
        &self.base[trial]
    }

    /// The model with what effects change in the muscles.
    ///
    /// # Errors
    /// A property that is not allowed.
    pub fn variant(&self, effects: &[Setting]) -> Result<Cow<'_, MusculoskeletalModel>, SimulationError> {
        let effects = self.acting(effects);
        let effects = &effects[..];
        let mut muscles = self.muscles.clone();
        let mut changed = false;
        for setting in in_order(effects) {
            changed |= setting.effect.change_muscles(&setting.values, &mut muscles);
        }
        let model = if changed { Cow::Owned(self.model.with_muscles(&muscles)?) } else { Cow::Borrowed(&self.model) };
        let lambda: f64 = effects.iter().map(|s| s.effect.length_by_activation(&s.values)).sum();
        Ok(if lambda == 0.0 { model } else { Cow::Owned(model.with_length_by_activation(lambda)) })
    }

    fn context<'a>(&'a self, trial: usize, excitation: &'a [Vec<f64>], muscle_moment: &'a [f64]) -> TrialContext<'a> {
        let record = &self.trials[trial];
        TrialContext {
            time: &record.time,
            session: record.session,
            arm_flipped: record.info.arm_flipped,
            exposure: &record.exposure,
            recorded_angle: &record.angle,
            neutral_angle: self.joint.neutral_angle,
            muscle_moment,
            directions: &self.directions,
            excitation,
            silent_muscles: &self.silent_muscles[trial],
            muscles: &self.muscles,
        }
    }

    /// Angle and excitations after the effects on them.
    fn driven(&self, trial: usize, ordered: &[&Setting], context: &TrialContext) -> (Vec<f64>, Vec<Vec<f64>>) {
        let mut excitation = context.excitation.to_vec();
        let mut angle = self.trials[trial].angle.clone();
        for setting in ordered {
            setting.effect.excite(&setting.values, context, &mut excitation);
            setting.effect.change_angle(&setting.values, context, &mut angle);
        }
        (angle, excitation)
    }

    /// Excitations after the effects on them, of some samples of a trial: of all, unless
    /// [`ForwardModel::excites_instantaneously`].
    ///
    /// - `excitation`: of each muscle at these samples, before effects; empty for those that are not asked for, unless
    ///   [`ForwardModel::mixes_muscles`]
    pub fn excited(
        &self,
        trial: usize,
        samples: Range<usize>,
        excitation: &[Vec<f64>],
        effects: &[Setting],
    ) -> Vec<Vec<f64>> {
        let acting = self.acting(effects);
        let mut out = excitation.to_vec();
        let record = &self.trials[trial];
        let context = TrialContext {
            time: &record.time[samples.clone()],
            recorded_angle: &record.angle[samples],
            ..self.context(trial, excitation, &[])
        };
        for setting in in_order(&acting).into_iter().filter(|s| changes_excitation(s)) {
            setting.effect.excite(&setting.values, &context, &mut out);
        }
        out
    }

    /// Whether what effects make of an excitation depends, sample by sample, on that sample alone.
    pub fn excites_instantaneously(&self, effects: &[Setting]) -> bool {
        self.acting(effects).iter().filter(|s| changes_excitation(s)).all(|s| scope(s) != ExcitationScope::WholeTrial)
    }

    /// Whether what effects make of a muscle's excitation depends on other muscles'.
    pub fn mixes_muscles(&self, effects: &[Setting]) -> bool {
        self.acting(effects).iter().any(|s| changes_excitation(s) && scope(s) == ExcitationScope::SampleOfAllMuscles)
    }

    /// Whether effects change excitations.
    pub fn excitation_changes(&self, effects: &[Setting]) -> bool {
        self.acting(effects).iter().any(changes_excitation)
    }

    fn recording<'a>(&'a self, trial: usize, angle: &'a [f64], excitation: &'a [Vec<f64>]) -> Recording<'a> {
        let record = &self.trials[trial];
        Recording {
            name: record.info.file_as_written.clone(),
            time: &record.time,
            angle,
            excitation: excitation.iter().map(Vec::as_slice).collect(),
            held: record.info.held.iter().map(HeldCoordinate::from).collect(),
        }
    }

    /// A trial with the excitation as recorded.
    pub fn recorded_input(&self, trial: usize) -> TrialInput {
        TrialInput { excitation: self.trials[trial].excitation.clone(), prepared: self.base[trial].clone() }
    }

    /// A trial with another excitation.
    ///
    /// - `excitation`: of each muscle, before effects
    ///
    /// # Errors
    /// An excitation that is not a number.
    pub fn input(&self, trial: usize, excitation: Vec<Vec<f64>>) -> Result<TrialInput, SimulationError> {
        let recording = self.recording(trial, &self.trials[trial].angle, &excitation);
        let prepared = self.model.prepare_like(&recording, &self.base[trial], &self.options)?;
        Ok(TrialInput { excitation, prepared })
    }

    /// Simulates a trial up to the joint.
    ///
    /// - `variant`: from [`ForwardModel::variant`] of the same effects
    ///
    /// # Errors
    /// A muscle whose forces cannot be balanced.
    pub fn core(
        &self,
        variant: &MusculoskeletalModel,
        trial: usize,
        input: &TrialInput,
        parameters: &[MuscleParameters],
        effects: &[Setting],
        derivatives: bool,
    ) -> Result<Core, SimulationError> {
        self.core_with(variant, trial, input, parameters, (&self.acting(effects), FEEDBACK_ROUNDS), derivatives)
    }

    /// As [`ForwardModel::core`], with these effects and no others, and so many rounds of feedback.
    fn core_with(
        &self,
        variant: &MusculoskeletalModel,
        trial: usize,
        input: &TrialInput,
        parameters: &[MuscleParameters],
        (effects, rounds): (&[Setting], usize),
        derivatives: bool,
    ) -> Result<Core, SimulationError> {
        let drives = |s: &Setting| s.effect.description().needs_moment() && s.effect.description().stage < Stage::Joint;
        // What only adds at the joint leaves the muscles' moment as it is.
        let without = if effects.iter().any(drives) {
            let (shown, rounds) = shown_effects(effects, rounds);
            Some(Box::new(self.core_with(variant, trial, input, parameters, (&shown, rounds), derivatives)?))
        } else {
            None
        };
        let muscle_moment = without.as_ref().map_or(&[][..], |core| &core.muscle_moment);
        let context = self.context(trial, &input.excitation, muscle_moment);
        let effects = in_order(effects);
        let (angle, excitation) = self.driven(trial, &effects, &context);
        let recording = self.recording(trial, &angle, &excitation);
        let prepared = variant.prepare_like(&recording, &input.prepared, &self.options)?;
        let mut moment = prepared.moment_without_muscles();
        let (mut by_parameters, mut solutions) = (Vec::new(), Vec::new());
        let change = |i| muscle_change(&effects, &context, &prepared, i, &angle);
        let (factors, added): (Vec<_>, Vec<_>) =
            (0..parameters.len()).map(change).map(|MuscleChange { factor, force }| (factor, force)).unzip();
        for (i, (p, factor)) in parameters.iter().zip(&factors).enumerate() {
            let force = p.max_isometric_force;
            let arm = &prepared.kinematics().muscles[i].moment_arm;
            if derivatives {
                let solution = prepared.solve(i, p)?;
                let n = moment.len();
                let mut by = vec![vec![0.0; n]; FITTED_PER_MUSCLE];
                for k in 0..n {
                    let f = force * factor[k];
                    by[0][k] = f * (arm[k] * (solution.force[k] + added[i][k]));
                    by[1][k] = f * (arm[k] * solution.by_optimal_fiber_length[k]) * p.optimal_fiber_length;
                    by[2][k] = f * (arm[k] * solution.by_tendon_slack_length[k]) * p.tendon_slack_length;
                    moment[k] += by[0][k];
                }
                by_parameters.extend(by);
                solutions.push(solution);
            } else {
                let mut unit = vec![0.0; moment.len()];
                prepared.add_unit_moment(i, p, &mut unit)?;
                for k in 0..moment.len() {
                    moment[k] += force * factor[k] * (unit[k] + arm[k] * added[i][k]);
                }
            }
        }
        Ok(Core { factors, by_parameters, solutions, without, ..Core::bare(prepared, excitation, moment) })
    }

    /// The moment that the sensor records [N·m]: what effects on joint, inertia and sensor make of a trial's core.
    pub fn recorded_moment(&self, trial: usize, core: &Core, effects: &[Setting]) -> Vec<f64> {
        self.recorded(trial, core, core.moment.clone(), core.shown(), effects, true)
    }

    /// - `moment`: of muscles, passive forces and drag, with all effects; `muscle_moment`: that effects are shown
    /// - `expected`: as expected with noise in the recorded angle; otherwise as were the angle free of noise
    fn recorded(
        &self,
        trial: usize,
        core: &Core,
        mut moment: Vec<f64>,
        muscle_moment: &[f64],
        effects: &[Setting],
        expected: bool,
    ) -> Vec<f64> {
        let context = self.context(trial, &core.excitation, muscle_moment);
        let effects = self.acting(effects);
        let effects = in_order(&effects);
        let drawn = if expected { self.drawn_moments(trial, core, &context, &effects) } else { Vec::new() };
        match drawn.as_slice() {
            [] => joint_state(core, &context, |joint| add_moments(&effects, joint, &mut moment)),
            draws => {
                for draw in draws {
                    moment.iter_mut().zip(draw).for_each(|(m, d)| *m += d / draws.len() as f64);
                }
            }
        }
        for setting in &effects {
            setting.effect.sense(&setting.values, &context, &mut moment);
        }
        moment
    }

    /// What effects add at the joint, per draw of the angle's noise [N·m]; empty if there is none or nothing adds.
    fn drawn_moments(&self, trial: usize, core: &Core, context: &TrialContext, ordered: &[&Setting]) -> Vec<Vec<f64>> {
        let adds = |s: &&&Setting| s.effect.description().stage.adds_moment() && !s.is_absent();
        let (Some(DrawnNoise { draws, .. }), true) = (&self.angle_noise, ordered.iter().any(|s| adds(&s))) else {
            return Vec::new();
        };
        let kinematics = core.prepared.kinematics();
        let sum = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a + b).collect() };
        let drawn = |d: &Disturbance| {
            let mut moment = vec![0.0; kinematics.angle.len()];
            let joint = JointState {
                trial: context,
                angle: &sum(&kinematics.angle, &d.angle),
                speed: &sum(&kinematics.speed, &d.speed),
                acceleration: &sum(&kinematics.acceleration, &d.acceleration),
                muscles: &kinematics.muscles,
            };
            add_moments(ordered, &joint, &mut moment);
            moment
        };
        draws[trial].iter().map(drawn).collect()
    }

    /// Covariance of the recorded moment that the angle's noise causes through effects on the joint, and
    /// through the machine's drag where that is noticeable [(N·m)²]; `None` if none.
    ///
    /// - `average`: of a series over blocks of samples; `times`: of the blocks [s]
    pub fn angle_covariance(
        &self,
        trial: usize,
        core: &Core,
        effects: &[Setting],
        average: impl Fn(&[f64]) -> Vec<f64>,
        times: &[f64],
    ) -> Option<DMatrix<f64>> {
        let context = self.context(trial, &core.excitation, core.shown());
        let effects = self.acting(effects);
        let mut draws = self.drawn_moments(trial, core, &context, &in_order(&effects));
        let DrawnNoise { noise, draws: disturbances, was_white } = self.angle_noise.as_ref()?;
        let drag = self.model.setup().dynamometer_damping;
        if *was_white || drag * noise.sd / noise.length > NOTICEABLE_DRAG * self.joint.strength {
            // What effects do not see acts all the same: with it left out, a friction that cancels it would be found.
            draws.resize(disturbances[trial].len(), vec![0.0; context.time.len()]);
            for (moment, draw) in draws.iter_mut().zip(&disturbances[trial]) {
                moment.iter_mut().zip(&draw.speed).for_each(|(m, speed)| *m -= drag * speed);
            }
        }
        let draws: Vec<Vec<f64>> = draws.iter().map(|d| average(d)).collect();
        (!draws.is_empty()).then(|| noise.covariance(&draws, times))
    }
}

/// Correlation length of what smoothing leaves of an angle's white noise [s], if it is all that there is.
const LEFT_LENGTH: f64 = 0.1;

/// Adds further draws of an angle's noise where the joint is not held.
fn add_where_it_moves(draws: &mut [Disturbance], more: &[Disturbance], time: &[f64], angle: &[f64]) {
    let weight = moving(time, angle);
    let add = |to: &mut [f64], more: &[f64]| {
        for ((to, more), weight) in to.iter_mut().zip(more).zip(&weight) {
            *to += weight * more;
        }
    };
    for (draw, more) in draws.iter_mut().zip(more) {
        add(&mut draw.angle, &more.angle);
        add(&mut draw.speed, &more.speed);
        add(&mut draw.acceleration, &more.acceleration);
    }
}

/// The machine's drag upon the angle's noise is left out of the noise of moments where it is smaller than
/// this, of a wrist [N·m].
const NOTICEABLE_DRAG: f64 = 0.005;

/// Shows a trial's joint as recorded.
fn joint_state(core: &Core, context: &TrialContext, mut see: impl FnMut(&JointState)) {
    let kinematics = core.prepared.kinematics();
    see(&JointState {
        trial: context,
        angle: &kinematics.angle,
        speed: &kinematics.speed,
        acceleration: &kinematics.acceleration,
        muscles: &kinematics.muscles,
    });
}

/// Whether a parameter can matter at these values: shapes do not while the effect is absent.
pub fn matters(setting: &Setting, parameter: usize) -> bool {
    setting.effect.description().parameters[parameter].role == Role::Amplitude || !setting.is_absent()
}

fn directions(base: &[PreparedTrial], muscles: usize) -> Vec<f64> {
    (0..muscles)
        .map(|m| {
            let arms = base.iter().flat_map(|t| &t.kinematics().muscles[m].moment_arm);
            if arms.sum::<f64>() < 0.0 { -1.0 } else { 1.0 }
        })
        .collect()
}
