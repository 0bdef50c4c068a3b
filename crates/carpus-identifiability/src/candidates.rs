//! Trials that a laboratory could record next, as the model and the trials so far let one expect them.

use super::next_trial::Candidate;
use super::recorded::RecordedTrial;
use carpus_osim::osim::spec::MotionType;
use carpus_simulation::simulation::{HeldCoordinate, MusculoskeletalModel, Options, Recording, SimulationError};
use carpus_study::study::{Contraction, Direction, PostureCoordinate, Trial, TrialInfo, TrialUse, is_same_posture};

/// Efforts offered, in percent of the maximum.
const EFFORTS: [f64; 4] = [25.0, 50.0, 75.0, 100.0];
/// Half the range of postures where nothing has moved yet [rad].
const USUAL_RANGE: f64 = 0.52;
/// Rate of what is simulated [1/s].
const RATE: f64 = 100.0;
/// Postures of other joints at most in which trials are offered: lowest, middle and highest tell most of the others.
const MOST_POSTURES: usize = 3;
/// Duration of an offered trial [s].
const DURATION: f64 = 4.0;

/// What every candidate is made from.
struct Known<'a> {
    model: &'a MusculoskeletalModel,
    trials: Vec<&'a Trial>,
    /// Angles between which candidates lie [rad].
    range: [f64; 2],
    /// Excitation at rest, per muscle.
    rest: Vec<f64>,
}

/// A candidate before it is prepared.
struct Plan {
    name: String,
    direction: Direction,
    angle: Vec<f64>,
    excitation: Vec<Vec<f64>>,
    held: Vec<PostureCoordinate>,
}

/// [`usual_candidates`] as trials, with zero moments, to be recorded after others.
pub fn usual_recordings(model: &MusculoskeletalModel, trials: &[Trial]) -> Vec<Trial> {
    let (Some(known), Some(first)) = (Known::new(model, trials), trials.first()) else { return Vec::new() };
    let time: Vec<f64> = (0..=(DURATION * RATE) as usize).map(|k| k as f64 / RATE).collect();
    let trial = |plan: Plan| {
        let info = TrialInfo {
            name: plan.name,
            direction: plan.direction,
            usage: TrialUse::Train,
            start_time: None,
            arm_flipped: false,
            held: plan.held,
            ..first.info.clone()
        };
        Trial::from_samples(info, time.clone(), plan.angle, vec![0.0; time.len()], plan.excitation)
    };
    known.plans().into_iter().map(trial).collect()
}

/// Contractions × efforts × postures × directions.
///
/// Excitations are those of the recorded trial that is most like the candidate, scaled by the effort. Held trials are
/// offered in the middle of the recorded range and near its ends, moving ones over it; all of them in postures of other
/// joints that trials were recorded in.
///
/// # Errors
/// A candidate that cannot be simulated with the model as it is.
pub fn usual_candidates(model: &MusculoskeletalModel, trials: &[Trial]) -> Result<Vec<Candidate>, SimulationError> {
    let Some(known) = Known::new(model, trials) else { return Ok(Vec::new()) };
    let plans = known.plans();
    let time: Vec<f64> = (0..=(DURATION * RATE) as usize).map(|k| k as f64 / RATE).collect();
    let recordings: Vec<Recording> = plans
        .iter()
        .map(|p| Recording {
            name: p.name.clone(),
            time: &time,
            angle: &p.angle,
            excitation: p.excitation.iter().map(Vec::as_slice).collect(),
            held: p.held.iter().map(HeldCoordinate::from).collect(),
        })
        .collect();
    let options = Options { allow_angle_outside_range: true, ..Options::default() };
    let prepared = model.prepare_all(&recordings, &options)?;
    let coordinate = &model.setup().coordinate;
    let zeros = vec![0.0; time.len()];
    Ok(plans
        .iter()
        .zip(recordings.iter().zip(&prepared))
        .map(|(plan, (recording, prepared))| Candidate {
            name: plan.name.clone(),
            trial: RecordedTrial::new(&plan.name, plan.direction, coordinate, recording, &zeros, prepared),
        })
        .collect())
}

impl<'a> Known<'a> {
    fn new(model: &'a MusculoskeletalModel, trials: &'a [Trial]) -> Option<Known<'a>> {
        let trials: Vec<&Trial> =
            trials.iter().filter(|t| matches!(t.info.usage, TrialUse::Train | TrialUse::Mvc)).collect();
        let first = trials.first()?;
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for angle in trials.iter().flat_map(|t| &t.angle) {
            range = [range[0].min(*angle), range[1].max(*angle)];
        }
        if range[1] - range[0] < 0.1 {
            let middle = range[0].midpoint(range[1]);
            let limits = model.skeleton().coordinates[model.coordinate().0].range;
            range = [(middle - USUAL_RANGE).max(limits[0]), (middle + USUAL_RANGE).min(limits[1])];
        }
        let rest = (0..first.excitation.len())
            .map(|m| {
                let lowest = |t: &&Trial| {
                    let mut e = t.excitation[m].clone();
                    e.sort_by(f64::total_cmp);
                    e[e.len() / 20]
                };
                trials.iter().map(lowest).fold(f64::INFINITY, f64::min)
            })
            .collect();
        Some(Known { model, trials, range, rest })
    }

    fn plans(&self) -> Vec<Plan> {
        let in_posture = |held: Vec<PostureCoordinate>| {
            let suffix = held.iter().map(|h| self.words(h)).collect::<String>();
            self.plans_of_angles().into_iter().map(move |plan| Plan {
                name: format!("{}{suffix}", plan.name),
                held: held.clone(),
                ..plan
            })
        };
        self.postures().into_iter().flat_map(in_posture).collect()
    }

    /// A coordinate and its value with all digits: no two postures have the same words.
    fn words(&self, held: &PostureCoordinate) -> String {
        let mut coordinates = self.model.skeleton().coordinates.iter();
        let is_translation =
            coordinates.any(|c| c.name == held.coordinate && c.motion_type == MotionType::Translational);
        let unit = if is_translation { "\u{202f}m" } else { "°" };
        // Adding 0 leaves no −0.
        let value = (held.value_deg_or_m + 0.0).to_string().replace('-', "−");
        format!(", {} {value}{unit}", held.coordinate)
    }

    /// Postures of other joints than the moving one, of which some stand for all.
    fn postures(&self) -> Vec<Vec<PostureCoordinate>> {
        fn values(held: &[PostureCoordinate]) -> Vec<(&str, f64)> {
            held.iter().map(|h| (h.coordinate.as_str(), h.value_deg_or_m)).collect()
        }
        let mut found: Vec<&Vec<PostureCoordinate>> = Vec::new();
        for trial in &self.trials {
            if !found.iter().any(|held| is_same_posture(held, &trial.info.held)) {
                found.push(&trial.info.held);
            }
        }
        found.sort_by(|a, b| values(a).partial_cmp(&values(b)).unwrap_or(std::cmp::Ordering::Equal));
        let last = found.len() - 1;
        let kept = match found.len() {
            0..=MOST_POSTURES => (0..=last).collect::<Vec<_>>(),
            _ => (0..MOST_POSTURES).map(|k| k * last / (MOST_POSTURES - 1)).collect(),
        };
        kept.into_iter().map(|i| found[i].clone()).collect()
    }

    fn plans_of_angles(&self) -> Vec<Plan> {
        let mut plans = Vec::new();
        let [low, high] = self.range;
        // Round angles, so that noise of the recorded angles does not make other candidates of every participant.
        let grid = if high - low > 0.5 { 5.0 } else { 1.0 };
        let round = |angle: f64| ((angle.to_degrees() / grid).round() * grid + 0.0).to_radians();
        let mut postures =
            [low + 0.1 * (high - low), 0.5 * (low + high), high - 0.1 * (high - low)].map(round).to_vec();
        postures.dedup();
        let steps = (DURATION * RATE) as usize + 1;
        for direction in [Direction::Flexion, Direction::Extension] {
            for effort in EFFORTS {
                let how = format!("{effort:.0} % {}", direction.word());
                if let Some(excitation) = self.excitation(direction, effort, Contraction::Isometric) {
                    for &posture in &postures {
                        let name = format!("isometric, {how} at {:.0}°", posture.to_degrees()).replace('-', "−");
                        plans.push(Plan {
                            name,
                            direction,
                            angle: vec![posture; steps],
                            excitation: excitation.clone(),
                            held: Vec::new(),
                        });
                    }
                }
                if let Some(excitation) = self.excitation(direction, effort, Contraction::Isotonic) {
                    let (from, to) = if direction == Direction::Flexion { (low, high) } else { (high, low) };
                    let angle = sweep(from, to, 0.8, 1.65, None);
                    plans.push(Plan {
                        name: format!("isotonic, {how}"),
                        direction,
                        angle,
                        excitation,
                        held: Vec::new(),
                    });
                }
            }
        }
        for (words, duration) in [("slow", 1.7), ("fast", 0.8)] {
            let angle = sweep(low, high, 0.2, duration, Some(0.4 + duration));
            let excitation = self.rest.iter().map(|e| vec![*e; steps]).collect();
            let name = format!("passive, {words} sweep");
            plans.push(Plan { name, direction: Direction::None, angle, excitation, held: Vec::new() });
        }
        plans
    }

    /// Excitations of an effort: those of the most similar trial, stretched over the candidate's duration.
    fn excitation(&self, direction: Direction, effort: f64, contraction: Contraction) -> Option<Vec<Vec<f64>>> {
        let effort_of = |t: &Trial| t.info.effort_percent.unwrap_or(100.0);
        let distance = |t: &&&Trial| {
            let kind = if t.info.contraction == contraction { 0.0 } else { 1000.0 };
            kind + (effort_of(t) / effort).max(effort / effort_of(t))
        };
        let template = self
            .trials
            .iter()
            .filter(|t| t.info.direction == direction && effort_of(t) > 0.0)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let scale = effort / effort_of(template);
        let (start, end) = (template.time[0], template.time[template.time.len() - 1]);
        let steps = (DURATION * RATE) as usize + 1;
        let at = |e: &[f64], rest: f64, k: usize| {
            let t = start + (end - start) * k as f64 / (steps - 1) as f64;
            let i = template.time.partition_point(|x| *x <= t).clamp(1, template.time.len() - 1);
            let part = ((t - template.time[i - 1]) / (template.time[i] - template.time[i - 1])).clamp(0.0, 1.0);
            let value = e[i - 1] + part * (e[i] - e[i - 1]);
            (rest + (value - rest) * scale).clamp(0.0, 1.0)
        };
        let series = template.excitation.iter().zip(&self.rest);
        Some(series.map(|(e, rest)| (0..steps).map(|k| at(e, *rest, k)).collect()).collect())
    }
}

/// There, and back if asked, by minimum jerk.
fn sweep(from: f64, to: f64, start: f64, duration: f64, back: Option<f64>) -> Vec<f64> {
    let smooth = |t: f64| {
        let x = t.clamp(0.0, 1.0);
        x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
    };
    (0..=(DURATION * RATE) as usize)
        .map(|k| {
            let t = k as f64 / RATE;
            let there = smooth((t - start) / duration) - back.map_or(0.0, |b| smooth((t - b) / duration));
            from + (to - from) * there
        })
        .collect()
}
