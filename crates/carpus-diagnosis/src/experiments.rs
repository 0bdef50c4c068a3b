//! Experiments that a lab can add to a session: what the joint does, and how hard the muscles work.
//!
//! In: the trials that were recorded, for their range of angles and their rest. Out: trials without measured moments.

use carpus_effects::forward_model::ForwardModel;
use carpus_study::study::{Contraction, Direction, Trial, TrialInfo, TrialUse};

/// Sampling interval [s].
const STEP: f64 = 0.01;
/// Excitation of a relaxed muscle, where the study has no relaxed trial.
const USUAL_REST: f64 = 0.015;
/// Co-contraction of antagonists, as a share of the agonists' excitation.
const ANTAGONISTS: f64 = 0.2;

/// Trials to record.
pub struct Experiment {
    /// What to record, in words.
    pub trials: &'static str,
    /// The trials, with zero moments.
    pub recordings: Vec<Trial>,
}

/// What experiments are built from.
struct Workshop {
    /// Angles that were reached [rad].
    low: f64,
    high: f64,
    /// Angles that the coordinate allows [rad].
    limits: [f64; 2],
    rest: Vec<f64>,
    directions: Vec<f64>,
    template: TrialInfo,
}

/// All experiments that suit a study.
///
/// - `limits`: range of the coordinate [rad]
pub fn experiments(forward: &ForwardModel, limits: [f64; 2]) -> Vec<Experiment> {
    let Some(first) = forward.trials.first() else { return Vec::new() };
    let angles = forward.trials.iter().flat_map(|t| &t.angle);
    let [low, high] = angles.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], q| [a.min(*q), b.max(*q)]);
    let shop = Workshop {
        low: low.max(limits[0]),
        high: high.min(limits[1]),
        limits,
        rest: rest(forward),
        directions: forward.directions.clone(),
        template: first.info.clone(),
    };
    shop.all()
}

/// Median excitation of each muscle in relaxed trials.
fn rest(forward: &ForwardModel) -> Vec<f64> {
    let relaxed = || forward.trials.iter().filter(|t| t.info.contraction == Contraction::Passive);
    (0..forward.muscles.len())
        .map(|m| {
            let mut values: Vec<f64> = relaxed().flat_map(|t| t.excitation[m].iter().copied()).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(USUAL_REST)
        })
        .collect()
}

/// 0 to 1 with vanishing first and second derivatives at both ends.
fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
}

impl Workshop {
    fn middle(&self) -> f64 {
        0.5 * (self.low + self.high)
    }

    fn trial(
        &self,
        contraction: Contraction,
        seconds: f64,
        angle: impl Fn(f64) -> f64,
        effort: impl Fn(f64) -> [f64; 2],
    ) -> Trial {
        let n = (seconds / STEP).round() as usize + 1;
        let time: Vec<f64> = (0..n).map(|k| k as f64 * STEP).collect();
        let excitation = self
            .rest
            .iter()
            .zip(&self.directions)
            .map(|(rest, direction)| {
                let level = |t: &f64| {
                    let [up, down] = effort(*t);
                    let (own, other) = if *direction > 0.0 { (up, down) } else { (down, up) };
                    (rest + own + ANTAGONISTS * other).clamp(0.0, 1.0)
                };
                time.iter().map(level).collect()
            })
            .collect();
        let info = TrialInfo {
            contraction,
            direction: Direction::None,
            usage: TrialUse::Train,
            start_time: None,
            arm_flipped: false,
            ..self.template.clone()
        };
        let angle = time.iter().map(|t| angle(*t).clamp(self.limits[0], self.limits[1])).collect();
        Trial::from_samples(info, time, angle, vec![0.0; n], excitation)
    }

    /// Sweeps there and back between two angles, each way in `way` seconds, after half a second of rest.
    fn sweep(&self, [from, to]: [f64; 2], way: f64, times: usize, effort: f64) -> Trial {
        let (period, start) = (2.0 * way, 0.5);
        let angle = move |t: f64| {
            let t = (t - start).max(0.0);
            let phase = if t >= period * times as f64 { 0.0 } else { t % period };
            from + (to - from) * (smoothstep(phase / way) - smoothstep((phase - way) / way))
        };
        let contraction = if effort == 0.0 { Contraction::Passive } else { Contraction::Isotonic };
        let burst = move |t: f64| {
            let on = effort * smoothstep((t - 0.1) / 0.4);
            if to > from { [on, 0.0] } else { [0.0, on] }
        };
        self.trial(contraction, 1.0 + period * times as f64, angle, burst)
    }

    /// Holds an angle; the effort rises, stays and falls. Positive levels pull in the coordinate's positive direction.
    fn hold(&self, angle: f64, level: f64, rise: f64, stay: f64) -> Trial {
        let effort = move |t: f64| {
            let on = level.abs() * smoothstep((t - 0.4) / rise) * (1.0 - smoothstep((t - 0.4 - rise - stay) / rise));
            if level > 0.0 { [on, 0.0] } else { [0.0, on] }
        };
        self.trial(Contraction::Isometric, 1.0 + 2.0 * rise + stay, move |_| angle, effort)
    }

    fn all(&self) -> Vec<Experiment> {
        let whole = [self.low, self.high];
        let back = [self.high, self.low];
        let at = |share: f64| self.low + share * (self.high - self.low);
        let slow =
            || vec![self.sweep(whole, 6.0, 1, 0.0), self.sweep(back, 6.0, 1, 0.0), self.sweep(whole, 8.0, 1, 0.0)];
        let turned = |mut trials: Vec<Trial>| {
            trials.iter_mut().for_each(|t| t.info.arm_flipped = true);
            trials
        };
        let small = [self.middle() - 0.09, self.middle() + 0.09];
        let experiment = |trials, recordings| Experiment { trials, recordings };
        let both = |make: &dyn Fn(f64) -> Trial| vec![make(1.0), make(-1.0)];
        vec![
            experiment("3 relaxed slow sweeps", slow()),
            experiment("3 relaxed slow sweeps, arm flipped", turned(slow())),
            experiment(
                "3 relaxed fast sweeps",
                vec![self.sweep(whole, 0.4, 4, 0.0), self.sweep(back, 0.4, 4, 0.0), self.sweep(whole, 0.6, 3, 0.0)],
            ),
            experiment(
                "4 relaxed sweeps, four speeds",
                vec![
                    self.sweep(whole, 6.0, 1, 0.0),
                    self.sweep(whole, 2.0, 2, 0.0),
                    self.sweep(whole, 0.8, 3, 0.0),
                    self.sweep(whole, 0.4, 4, 0.0),
                ],
            ),
            experiment(
                "2 relaxed slow sweeps over the whole range of the joint",
                vec![self.sweep(self.limits, 8.0, 1, 0.0), self.sweep([self.limits[1], self.limits[0]], 8.0, 1, 0.0)],
            ),
            experiment(
                "3 relaxed small sweeps after rest, slow reversals",
                vec![
                    self.sweep(small, 1.5, 4, 0.0),
                    self.sweep([small[1], small[0]], 1.5, 4, 0.0),
                    self.sweep(small, 4.0, 2, 0.0),
                ],
            ),
            experiment(
                "10 isometric contractions, five angles, both directions, 50 %",
                [0.0, 0.25, 0.5, 0.75, 1.0]
                    .iter()
                    .flat_map(|s| both(&|d| self.hold(at(*s), 0.5 * d, 0.5, 1.5)))
                    .collect(),
            ),
            experiment(
                "8 isometric contractions, one angle, four levels, both directions",
                [0.1, 0.25, 0.5, 0.9]
                    .iter()
                    .flat_map(|l| both(&|d| self.hold(self.middle(), l * d, 0.5, 1.5)))
                    .collect(),
            ),
            experiment(
                "4 isometric ramps, slow and fast, both directions",
                [2.5, 0.15].iter().flat_map(|rise| both(&|d| self.hold(self.middle(), 0.6 * d, *rise, 1.0))).collect(),
            ),
            experiment(
                "6 isometric pulses and quick releases, both directions",
                [0.05, 0.05, 0.3]
                    .iter()
                    .flat_map(|stay| both(&|d| self.hold(self.middle(), 0.5 * d, 0.08, *stay)))
                    .collect(),
            ),
            experiment(
                "2 holds of 30 s at 50 %, both directions",
                both(&|d| self.hold(self.middle(), 0.5 * d, 0.5, 30.0)),
            ),
            experiment(
                "4 contractions while moving, two loads, both directions",
                vec![
                    self.sweep(whole, 1.0, 1, 0.2),
                    self.sweep(back, 1.0, 1, 0.2),
                    self.sweep(whole, 1.0, 1, 0.6),
                    self.sweep(back, 1.0, 1, 0.6),
                ],
            ),
            experiment(
                "4 contractions while moving fast, both directions",
                vec![
                    self.sweep(whole, 0.35, 2, 0.4),
                    self.sweep(back, 0.35, 2, 0.4),
                    self.sweep(whole, 0.35, 2, 0.15),
                    self.sweep(back, 0.35, 2, 0.15),
                ],
            ),
        ]
    }
}
