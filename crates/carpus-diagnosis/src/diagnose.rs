//! The diagnosis of one participant: which effects the model misses, how sure that is, and what is left beside them.

mod account;
mod named;
mod request;
mod simulated;

use std::collections::BTreeMap;

use web_time::Instant;

use super::baselines::Ingredients;
use super::cohort::ParticipantEvidence;
use super::fit::{Analysis, Fit};
use super::inference::muscles::MuscleEstimate;
use super::inference::session::{HandedOver, Session, State};
use super::separation::{Separation, most_useful, separations};
use super::what_remains::formulas;
use super::where_it_fails::along_axes;
use crate::noise::NoiseLevels;
use crate::score_test::{BlockScore, Omnibus};
use carpus_effects::answers::RULED_OUT;
use carpus_effects::effect::{Effect, Role};
use carpus_effects::forward_model::{ForwardModel, Setting};
use carpus_simulation::simulation::{MuscleParameters, SimulationError};
use carpus_study::study::{Direction, TrialUse};

use named::named;
pub use request::Request;
pub use simulated::{rmse, simulate};

pub use account::{
    AccountStep, Candidate, Confusion, Diagnosis, Errors, Explanation, Left, NamedEffect, NotListed, ParameterEstimate,
    Shares, Steps, Verdict,
};

/// Something is left beside a model if the family-wise p-value of all directions is smaller than this.
pub const LEVEL: f64 = 0.02;

/// An effect whose signature keeps less than this share once muscle parameters are fitted cannot be tested.
const TESTABLE: f64 = 0.01;
/// Another effect may stand in the place of one that is named if −2 log posterior is larger by less than this: with a
/// tenth of its probability.
const BEHIND: f64 = 4.6;
/// z that an effect needs to be found with a probability of about 80 % among all others.
const DETECTABLE_Z: f64 = 4.2;
/// Effects that lower neither the training error of the joint mode nor that of left-out trials by this share are
/// negligible.
const NEGLIGIBLE: f64 = 0.02;
/// Candidates that are held against each other.
const CONFUSED: usize = 6;
/// So many effects are told apart by further trials where the data cannot: those of the first explanations.
const TOLD_APART: usize = 4;
/// Directions that are reported as left over.
const SHOWN: usize = 3;

/// A diagnosis and what is handed over.
pub struct Outcome {
    /// The account.
    pub diagnosis: Diagnosis,
    /// Muscles fitted without effects.
    pub recalibrated: HandedOver,
    /// What the trials say of these muscles' parameters.
    pub muscles: Vec<MuscleEstimate>,
    /// Muscles and effects.
    pub handed_over: HandedOver,
    /// What baselines need.
    pub ingredients: Ingredients,
    /// What a cohort is pooled from.
    pub evidence: ParticipantEvidence,
}

/// What a diagnosis does, in this order.
pub const PHASES: [&str; 5] = [
    "fitting the muscles alone",
    "searching for sets of effects",
    "leaving out each effect",
    "dividing the error",
    "testing what is left",
];

/// Diagnoses one participant.
///
/// - `at`: told which of [`PHASES`] begins
///
/// # Errors
/// A trial that cannot be simulated.
pub fn diagnose(request: &Request, at: &dyn Fn(usize)) -> Result<Outcome, SimulationError> {
    let forward = request.forward;
    let mut session = request.session();
    let report = request.report();
    let clock = Instant::now();
    let begins = |phase: usize| {
        report(&format!("{:.1?}: {}", clock.elapsed(), PHASES[phase]));
        at(phase);
    };
    begins(0);
    let muscles = request.muscles()?;
    session.starting_from(&muscles);
    begins(1);
    let found = session.estimate(&[], false, &report)?;
    // Beside effects the noise is smaller, and tests of what is left see more.
    let alone = session.taken_up(&muscles, &report)?;
    begins(2);
    let (state, evidence) = session.likely(found, &report)?;
    let null = session.as_fit(&alone);
    let first = session.analysis.blocks_left(&null, &[]).ok_or(SimulationError::NoiseCovariance)?;
    let not_testable: Vec<&'static str> = session
        .analysis
        .candidates
        .iter()
        .map(|e| e.description())
        .filter(|d| {
            d.unidentifiable.is_some() || named_block(&first, d.id).is_none_or(|b| b.kept < TESTABLE || b.rank == 0)
        })
        .map(|d| d.id)
        .collect();
    let left_alone = test(&session.analysis, &null, &not_testable)?;

    begins(3);
    let recalibrated = muscles.handed_over;
    let handed_over = session.handed_over(&state)?;
    let (effects, mut account) = named(request, &session, &state, &evidence, [&handed_over, &recalibrated])?;
    begins(4);
    let left = test(&session.analysis, &session.as_fit(&state), &not_testable)?;
    let something_is_left = left.p_value < LEVEL;
    let judge = Judge { request, session: &session, null: &null, not_testable: &not_testable };
    let refit_error = judge.rmse_of(&recalibrated)?.unwrap_or(0.0).max(f64::MIN_POSITIVE);
    let mut explanations = match effects.len() {
        1 | 2 if !something_is_left => judge.explanations(&state, refit_error)?,
        _ => Vec::new(),
    };
    let implausible = !explanations.is_empty() && explanations.iter().all(|e| !e.plausible);
    if !implausible {
        explanations.retain(|e| e.plausible);
    }
    let at_joint_mode = judge.rmse_at(&state)? / judge.rmse_at(&alone)?.max(f64::MIN_POSITIVE);
    let left_out = handed_over.left_out_ratio / recalibrated.left_out_ratio.max(f64::MIN_POSITIVE);
    let fall = 1.0 - at_joint_mode.min(left_out);
    let dominant = effects.iter().filter(|e| e.dominant).count();
    let verdict = match explanations.as_slice() {
        [] if effects.is_empty() && something_is_left => Verdict::Unknown,
        [] if effects.is_empty() => Verdict::NothingDetectable,
        [] if dominant == 1 => Verdict::Dominant,
        [] => Verdict::Several,
        _ if implausible => Verdict::Implausible,
        _ if fall < NEGLIGIBLE => Verdict::Negligible,
        [only] if only.effects.len() == 2 => Verdict::TwoEffects,
        [_] => Verdict::Identified,
        _ => Verdict::CannotTell,
    };
    let kept: Vec<&'static str> =
        explanations.iter().flat_map(|e| e.effects.clone()).chain(effects.iter().map(|e| e.effect)).collect();
    let separating_experiments = match verdict {
        // Trials that nobody recorded must not cost the diagnosis: where one cannot be simulated, `carpus plan` says
        // why.
        Verdict::CannotTell => judge.experiments(&explanations).unwrap_or_default(),
        _ => Vec::new(),
    };
    let moments = simulate(forward, &handed_over.parameters, &handed_over.effects, TrialUse::Train)?;
    let proposals = match verdict {
        Verdict::Unknown | Verdict::Dominant | Verdict::Several => {
            formulas(forward, &moments, &state.factors, &session.of_muscle_parameters(&state), request.seed)
        }
        _ => Vec::new(),
    };
    let candidates = judge.candidates(&first, &state, &explanations);
    let mut not_listed = NotListed::default();
    for c in candidates.iter().filter(|c| !kept.contains(&c.effect) && !not_testable.contains(&c.effect)) {
        let list = match c.probability < RULED_OUT {
            true => &mut not_listed.ruled_out,
            false => &mut not_listed.less_likely,
        };
        list.push(c.effect);
    }
    let left_by_all = judge.rmse_of(&handed_over)?.unwrap_or(f64::INFINITY);
    // Noise of the EMG passes through the muscles: where they are far off, its estimate is too large. It is no more
    // than what is left.
    let noise_floor = (session.noise_floor(&state) / request.mvc).min(left_by_all);
    account.push(AccountStep { step: "noise".to_owned(), train: noise_floor, held_out: None });
    let diagnosis = Diagnosis {
        schema: "carpus.diagnosis/2",
        participant: request.participant.clone(),
        verdict,
        null_p_value: left_alone.p_value,
        null_sign_flip_p_value: left_alone.sign_flip_p_value,
        p_value: left.p_value,
        candidates,
        confusion: judge.confusion(&left_alone, &kept),
        separating_experiments,
        account,
        part_of_the_way: handed_over.part,
        proposals,
        not_listed,
        error: judge.errors(&recalibrated, &handed_over, noise_floor)?,
        where_it_fails: along_axes(forward, &residuals(forward, &moments), &left),
        noise: by_name(&state.levels, &session.analysis),
        noise_correlation: session.analysis.kernels,
        not_testable: not_testable.iter().copied().filter(|id| session.may_name(id)).collect(),
        explanations,
        effects,
    };
    let ingredients = Ingredients::of(&session.analysis, &null);
    let evidence = session.amplitude_evidence(&state, &request.participant);
    report(&format!("{:.1?}: done", clock.elapsed()));
    Ok(Outcome { diagnosis, recalibrated, muscles: muscles.parameters, handed_over, ingredients, evidence })
}

/// Measured minus simulated moments [N·m].
fn residuals(forward: &ForwardModel, simulated: &[(usize, Vec<f64>)]) -> Vec<(usize, Vec<f64>)> {
    let of = |(g, moment): &(usize, Vec<f64>)| {
        (*g, forward.trials[*g].moment.iter().zip(moment).map(|(y, m)| y - m).collect())
    };
    simulated.iter().map(of).collect()
}

/// Standard deviations by name; slow disturbances of the directions of effort that there are trials of.
fn by_name(levels: &NoiseLevels, analysis: &Analysis) -> BTreeMap<&'static str, f64> {
    let [envelope, gain, floor] = levels.of_emg();
    let named = [
        ("moment_white_n_m", levels.white()),
        ("emg_envelope", envelope),
        ("emg_gain_per_trial", gain),
        ("emg_baseline", floor),
    ];
    let slow = analysis.train.iter().map(|g| {
        let direction = analysis.forward.trials[*g].info.direction;
        let name = match direction {
            Direction::Flexion => "moment_slow_flexion_n_m",
            Direction::Extension => "moment_slow_extension_n_m",
            Direction::None => "moment_slow_no_direction_n_m",
        };
        (name, levels.slow(direction))
    });
    named.into_iter().chain(slow).map(|(name, variance)| (name, variance.sqrt())).collect()
}

fn test(analysis: &Analysis, fit: &Fit, skip: &[&str]) -> Result<Omnibus, SimulationError> {
    analysis.anything_left(fit, skip).ok_or(SimulationError::NoiseCovariance)
}

/// The directions of smallest p-value.
fn left_over(omnibus: &Omnibus) -> Vec<Left> {
    let mut blocks: Vec<&BlockScore> = omnibus.blocks.iter().filter(|b| b.rank > 0).collect();
    blocks.sort_by(|a, b| a.p_value.total_cmp(&b.p_value));
    let of = |b: &&BlockScore| Left {
        direction: b.name.clone(),
        p_value: b.p_value,
        size: b.one_step.iter().copied().collect(),
    };
    blocks.iter().take(SHOWN).map(of).collect()
}

fn named_block<'a>(blocks: &'a [BlockScore], name: &str) -> Option<&'a BlockScore> {
    blocks.iter().find(|b| b.name == name)
}

struct Judge<'a> {
    request: &'a Request<'a>,
    session: &'a Session<'a>,
    /// The muscles fitted without effects.
    null: &'a Fit,
    not_testable: &'a [&'static str],
}

impl Judge<'_> {
    /// RMSE of the training trials / session MVC moment.
    fn rmse_of(&self, model: &HandedOver) -> Result<Option<f64>, SimulationError> {
        self.error(&model.parameters, &model.effects, TrialUse::Train)
    }

    /// The same at a state's joint mode.
    fn rmse_at(&self, state: &State) -> Result<f64, SimulationError> {
        Ok(self.error(&state.point.parameters, &state.point.effects, TrialUse::Train)?.unwrap_or(0.0))
    }

    /// RMSE of the trials of a use / session MVC moment.
    fn error(
        &self,
        parameters: &[MuscleParameters],
        effects: &[Setting],
        usage: TrialUse,
    ) -> Result<Option<f64>, SimulationError> {
        let simulated = simulate(self.request.forward, parameters, effects, usage)?;
        Ok(rmse(self.request.forward, &simulated).map(|e| e / self.request.mvc))
    }

    /// Errors of the model as given, with its muscles recalibrated, and of what is handed over if it has effects.
    fn errors(
        &self,
        recalibrated: &HandedOver,
        handed_over: &HandedOver,
        noise_floor: f64,
    ) -> Result<Errors, SimulationError> {
        let steps = |usage| -> Result<Option<Steps>, SimulationError> {
            let base = self.error(&self.request.forward.nominal_parameters(), &[], usage)?;
            let refit = self.error(&recalibrated.parameters, &recalibrated.effects, usage)?;
            let with = self.error(&handed_over.parameters, &handed_over.effects, usage)?;
            let with_effect = with.filter(|_| !handed_over.effects.is_empty());
            Ok(base.zip(refit).map(|(base, refit_only)| Steps { base, refit_only, with_effect }))
        };
        let nothing = Steps { base: 0.0, refit_only: 0.0, with_effect: None };
        Ok(Errors {
            train: steps(TrialUse::Train)?.unwrap_or(nothing),
            held_out: steps(TrialUse::Test)?,
            noise_floor,
            measure: "RMSE / session MVC moment",
        })
    }

    /// The sets of effects that leave nothing: that of a state, and those with another effect in the place of one of
    /// them that are not much less probable.
    ///
    /// - `refit_error`: training error of the refitted muscles alone
    fn explanations(&self, state: &State, refit_error: f64) -> Result<Vec<Explanation>, SimulationError> {
        let session = self.session;
        let set = session.places(&state.point.effects);
        let mut sets: Vec<Vec<usize>> = vec![set.clone()];
        for effect in &set {
            for other in session.group(state, *effect).0.into_iter().skip(1) {
                let mut exchanged: Vec<usize> = set.iter().copied().filter(|e| e != effect).chain([other]).collect();
                exchanged.sort_unstable();
                if !sets.contains(&exchanged) {
                    sets.push(exchanged);
                }
            }
        }
        let fitted: Vec<State> = sets.iter().map(|set| session.with_set(state, set, &[])).collect::<Result<_, _>>()?;
        let behind: Vec<f64> = fitted.iter().map(|state| session.behind(state, &fitted[0])).collect();
        let least = behind.iter().copied().fold(f64::INFINITY, f64::min);
        let mut out = Vec::new();
        for (state, behind) in fitted.iter().zip(behind).filter(|(_, behind)| *behind < least + BEHIND) {
            let left = test(&session.analysis, &session.as_fit(state), self.not_testable)?;
            let estimates = session.estimates(state);
            let model = session.handed_over(state)?;
            out.push(Explanation {
                effects: state.point.effects.iter().map(|s| s.effect.description().id).collect(),
                p_value: left.p_value,
                deviance_behind: behind - least,
                error_fall: 1.0 - self.rmse_of(&model)?.unwrap_or(0.0) / refit_error,
                held_out_error: self.error(&model.parameters, &model.effects, TrialUse::Test)?,
                plausible: estimates.values().all(ParameterEstimate::reaches_plausible),
                parameters: estimates,
                left: left_over(&left),
            });
        }
        out.retain(|e| e.p_value >= LEVEL);
        out.sort_by(|a, b| a.deviance_behind.total_cmp(&b.deviance_behind));
        Ok(out)
    }

    /// - `first`: scores of every candidate beside the muscles alone
    fn candidates(&self, first: &[BlockScore], state: &State, explanations: &[Explanation]) -> Vec<Candidate> {
        let session = self.session;
        let of = |(place, effect): (usize, &&'static dyn Effect)| {
            let description = effect.description();
            let score = named_block(first, description.id).filter(|_| session.may_name(description.id))?;
            let explanation = explanations.iter().find(|e| e.effects == [description.id]);
            let detectable_size = description
                .amplitudes()
                .enumerate()
                .filter(|(i, _)| score.information[(*i, *i)] > 1e-9)
                .map(|(i, p)| {
                    let size = DETECTABLE_Z / score.information[(i, i)].sqrt();
                    (description.parameters[p].name, self.change(*effect, p, size))
                })
                .collect();
            let plausible =
                description.parameters.iter().map(|p| (p.name, self.request.forward.joint.plausible(p))).collect();
            Some(Candidate {
                effect: description.id,
                probability: state.sets.of_effect(place),
                p_value: explanation.map(|e| e.p_value),
                score_p_value: score.p_value,
                score: score.statistic,
                kept: score.kept,
                detectable_size,
                plausible,
                held_out_error: explanation.and_then(|e| e.held_out_error),
                parameters: explanation.map(|e| e.parameters.clone()).unwrap_or_default(),
                left: explanation.map(|e| e.left.clone()).unwrap_or_default(),
            })
        };
        let mut out: Vec<Candidate> = session.analysis.candidates.iter().enumerate().filter_map(of).collect();
        out.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(b.score.total_cmp(&a.score)));
        out
    }

    /// By how much an effect of a size in scales changes one of its parameters, in the parameter's unit.
    fn change(&self, effect: &'static dyn Effect, parameter: usize, size: f64) -> f64 {
        let forward = self.request.forward;
        let absent = Setting::absent(effect).values;
        let mut present = absent.clone();
        present[parameter] += size * forward.joint.scale(&effect.description().parameters[parameter]);
        let reported = |values: &[f64]| effect.reported(values, &forward.muscles)[parameter];
        (reported(&present) - reported(&absent)).abs()
    }

    /// The most useful experiments that would tell the effects of the first explanations apart.
    fn experiments(&self, explanations: &[Explanation]) -> Result<Vec<Separation>, SimulationError> {
        let mut rivals: Vec<&'static str> = Vec::new();
        for id in explanations.iter().flat_map(|e| &e.effects) {
            if rivals.len() < TOLD_APART && !rivals.contains(id) {
                rivals.push(id);
            }
        }
        let Some(laboratory) = self.request.laboratory else { return Ok(Vec::new()) };
        let analysis = &self.session.analysis;
        let mut all = separations(analysis, self.null, laboratory, &self.request.bounds, &rivals, &|_, _| {})?;
        // Two effects are rivals where one stands in the other's place, beside the same second effect if there is one.
        let beside = |id: &str| -> Vec<Vec<&str>> {
            let others = |e: &Explanation| e.effects.iter().copied().filter(|x| *x != id).collect();
            explanations.iter().filter(|e| e.effects.contains(&id)).map(others).collect()
        };
        all.retain(|s| beside(s.separates[0]).iter().any(|others| beside(s.separates[1]).contains(others)));
        Ok(most_useful(&all).into_iter().cloned().collect())
    }

    /// Pairwise z of the explanations' effects and of the leading candidates at their one-step sizes.
    ///
    /// - `explaining`: effects of the explanations
    fn confusion(&self, left: &Omnibus, explaining: &[&str]) -> Vec<Confusion> {
        let mut leaders: Vec<&BlockScore> =
            left.blocks.iter().filter(|b| self.session.may_name(&b.name) && b.rank > 0).collect();
        let explains = |b: &BlockScore| explaining.contains(&b.name.as_str());
        leaders.sort_by(|a, b| explains(b).cmp(&explains(a)).then(b.statistic.total_cmp(&a.statistic)));
        leaders.truncate(CONFUSED.max(leaders.iter().filter(|b| explains(b)).count()));
        let mut out = Vec::new();
        for truth in &leaders {
            for rival in leaders.iter().filter(|r| r.name != truth.name) {
                let Some(z) = self.session.analysis.pairwise_z(self.null, &truth.name, &truth.one_step, &rival.name)
                else {
                    continue;
                };
                let id = |name: &str| carpus_effects::catalogue::effect(name).map(|e| e.description().id);
                if let Some((truth, rival)) = id(&truth.name).zip(id(&rival.name)) {
                    out.push(Confusion { truth, rival, z });
                }
            }
        }
        out
    }
}

/// Whether a setting has an amplitude that is not 0: for messages.
pub fn is_on(setting: &Setting) -> bool {
    let parameters = setting.effect.description().parameters;
    parameters.iter().zip(&setting.values).any(|(p, v)| p.role == Role::Amplitude && *v != 0.0)
}
