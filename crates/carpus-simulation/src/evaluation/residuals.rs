//! Where a model fails: measured minus simulated moment against angle, speed, time and the like, and what repetitions
//! of the same condition say about its noise.

use std::collections::BTreeMap;

use carpus_numerics::statistics::t_quantile;

/// Bins of a curve.
const BINS: usize = 9;
/// Edges of the frequency bands [Hz].
const BAND_EDGES: [f64; 7] = [0.0, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0];
/// A spectrum is taken of at most this many means over neighbouring samples.
const SPECTRUM_SAMPLES: usize = 512;
/// Time after which half of a movement is forgotten, times ln 2 [s].
const HISTORY_TIME: f64 = 1.0;

/// A trial's residual and what it is drawn against.
#[derive(Clone, Debug, Default)]
pub struct ResidualTrial {
    /// Time [s].
    pub time: Vec<f64>,
    /// Measured minus simulated moment [N·m].
    pub residual: Vec<f64>,
    /// Angle [rad].
    pub angle: Vec<f64>,
    /// Speed [rad/s].
    pub speed: Vec<f64>,
    /// Acceleration [rad/s²].
    pub acceleration: Vec<f64>,
    /// Activation of each muscle.
    pub activation: Vec<Vec<f64>>,
    /// Start within the session, in the unit of [`Residuals::session_unit`].
    pub session: f64,
    /// Effort asked for [% MVC], where one was.
    pub effort: Option<f64>,
    /// Trials of the same condition repeat each other.
    pub condition: String,
}

/// Muscles of a study.
#[derive(Clone, Debug)]
pub struct MuscleName {
    /// Name.
    pub name: String,
    /// Sign of its moment arm.
    pub direction: f64,
}

/// Mean residual over a part of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Mean of the axis.
    pub at: f64,
    /// Mean residual [N·m].
    pub mean: f64,
    /// 95 % interval, trials being the unit [N·m]; none from a single trial.
    pub interval: Option<[f64; 2]>,
    /// Trials.
    pub trials: usize,
}

/// The residual along an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisCurve {
    /// The axis: `angle`, `velocity`, …, `muscle:ECRL`.
    pub axis: String,
    /// Unit of the axis.
    pub unit: &'static str,
    /// Share of the residual's mean square that the binned means explain, less what chance would.
    pub share: f64,
    /// Along the axis.
    pub bins: Vec<Bin>,
}

/// A band of frequencies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// Lower edge [Hz].
    pub low: f64,
    /// Upper edge [Hz]; none for the last.
    pub high: Option<f64>,
    /// Share of the residual's mean square.
    pub share: f64,
    /// Its 95 % interval, trials being the unit; none from a single trial.
    pub interval: Option<[f64; 2]>,
}

/// What repetitions say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RepetitionNoise {
    /// Standard deviation of what differs between repetitions [N·m]: no model that knows only the condition does
    /// better.
    pub noise: f64,
    /// Pairs of repetitions.
    pub pairs: usize,
}

/// The residual of a model over trials.
#[derive(Clone, Debug, PartialEq)]
pub struct Residuals {
    /// Root mean square [N·m].
    pub rms: f64,
    /// Along every axis.
    pub axes: Vec<AxisCurve>,
    /// By frequency.
    pub bands: Vec<Band>,
    /// From repetitions, if there are any.
    pub repetitions: Option<RepetitionNoise>,
}

/// Unit of the session's axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionUnit {
    /// Minutes since the session began.
    Minutes,
    /// Place in the order of recording.
    Order,
}

/// The residual of a model along every axis.
///
/// - `trials`: those that are judged; `repeated`: those among which repetitions are looked for
pub fn along_axes(
    trials: &[ResidualTrial],
    repeated: &[ResidualTrial],
    muscles: &[MuscleName],
    session: SessionUnit,
) -> Residuals {
    let count: usize = trials.iter().map(|t| t.residual.len()).sum();
    let square: f64 = trials.iter().flat_map(|t| &t.residual).map(|r| r * r).sum();
    let mut axes = Vec::new();
    let mut add = |axis: String, unit: &'static str, values: &dyn Fn(&ResidualTrial) -> Option<Vec<f64>>| {
        let values: Vec<Option<Vec<f64>>> = trials.iter().map(values).collect();
        let samples: Vec<Sample> = trials
            .iter()
            .zip(&values)
            .enumerate()
            .filter_map(|(g, (t, v))| Some((g, t, v.as_ref()?)))
            .flat_map(|(g, t, v)| v.iter().zip(&t.residual).map(move |(x, r)| Sample { x: *x, residual: *r, trial: g }))
            .collect();
        let (share, bins) = binned(samples);
        if bins.len() > 1 {
            axes.push(AxisCurve { axis, unit, share, bins });
        }
    };
    let constant = |v: f64, t: &ResidualTrial| vec![v; t.residual.len()];
    add("angle".into(), "deg", &|t| Some(t.angle.iter().map(|v| v.to_degrees()).collect()));
    add("velocity".into(), "deg/s", &|t| Some(t.speed.iter().map(|v| v.to_degrees()).collect()));
    add("acceleration".into(), "deg/s²", &|t| Some(t.acceleration.iter().map(|v| v.to_degrees()).collect()));
    add("time_in_trial".into(), "s", &|t| Some(t.time.iter().map(|v| v - t.time[0]).collect()));
    let session_unit = match session {
        SessionUnit::Minutes => "min",
        SessionUnit::Order => "trial",
    };
    add("session".into(), session_unit, &|t| Some(constant(t.session, t)));
    add("effort".into(), "% MVC", &|t| t.effort.map(|e| constant(e, t)));
    for (axis, sign) in [("flexor_activation", 1.0), ("extensor_activation", -1.0)] {
        add(axis.into(), "1", &|t| mean_activation(t, muscles, sign));
    }
    add("history".into(), "deg", &|t| Some(history(t)));
    for (i, muscle) in muscles.iter().enumerate() {
        add(format!("muscle:{}", muscle.name), "1", &|t| t.activation.get(i).cloned());
    }
    Residuals {
        rms: (square / count.max(1) as f64).sqrt(),
        axes,
        bands: by_frequency(trials.iter().map(|t| (&t.time[..], &t.residual[..]))),
        repetitions: repetition_noise(repeated),
    }
}

fn mean_activation(trial: &ResidualTrial, muscles: &[MuscleName], sign: f64) -> Option<Vec<f64>> {
    let members: Vec<usize> = (0..muscles.len()).filter(|m| muscles[*m].direction == sign).collect();
    (!members.is_empty()).then(|| {
        (0..trial.residual.len())
            .map(|k| members.iter().map(|m| trial.activation[*m][k]).sum::<f64>() / members.len() as f64)
            .collect()
    })
}

/// How far the joint has travelled lately [deg]: a trace of its movement that fades.
fn history(trial: &ResidualTrial) -> Vec<f64> {
    let mut moved = 0.0;
    let mut out = Vec::with_capacity(trial.time.len());
    for k in 0..trial.time.len() {
        if k > 0 {
            let h = trial.time[k] - trial.time[k - 1];
            moved = moved * (-h / HISTORY_TIME).exp() + trial.angle[k] - trial.angle[k - 1];
        }
        out.push(f64::to_degrees(moved));
    }
    out
}

/// A residual at a place of an axis.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Place.
    pub x: f64,
    /// Measured minus simulated moment [N·m].
    pub residual: f64,
    /// Trial.
    pub trial: usize,
}

/// Means of the residual over parts of an axis that hold about as many samples each, and the share of its mean square
/// that they explain, less what chance would.
pub fn binned(mut samples: Vec<Sample>) -> (f64, Vec<Bin>) {
    let total: f64 = samples.iter().map(|s| s.residual * s.residual).sum();
    if samples.is_empty() || total <= 0.0 {
        return (0.0, Vec::new());
    }
    samples.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.trial.cmp(&b.trial)));
    let mut explained = 0.0;
    let mut bins = Vec::new();
    let mut start = 0;
    for b in 1..=BINS {
        let mut end = (b * samples.len()) / BINS;
        // Equal values stay together: a held angle is one point of the axis.
        while end > start && end < samples.len() && samples[end].x == samples[end - 1].x {
            end += 1;
        }
        if end <= start {
            continue;
        }
        let members = &samples[start..end];
        start = end;
        let n = members.len() as f64;
        let mean = members.iter().map(|s| s.residual).sum::<f64>() / n;
        let mut by_trial: BTreeMap<usize, f64> = BTreeMap::new();
        members.iter().for_each(|s| *by_trial.entry(s.trial).or_default() += s.residual - mean);
        let count = by_trial.len();
        let spread: f64 = by_trial.values().map(|v| v * v).sum();
        let variance = if count > 1 { spread * count as f64 / (count as f64 - 1.0) / (n * n) } else { mean * mean };
        let half = (count > 1).then(|| t_quantile(0.975, count as f64 - 1.0) * variance.sqrt());
        explained += n * (mean * mean - variance);
        let at = members.iter().map(|s| s.x).sum::<f64>() / n;
        bins.push(Bin { at, mean, interval: half.map(|half| [mean - half, mean + half]), trials: count });
    }
    ((explained / total).clamp(0.0, 1.0), bins)
}

/// Share of the residual's mean square by frequency; empty where there is no residual.
///
/// - `trials`: times [s] and residuals
pub fn by_frequency<'a>(trials: impl Iterator<Item = (&'a [f64], &'a [f64])>) -> Vec<Band> {
    let trials: Vec<_> = trials.map(|(time, residual)| energies(time, residual)).collect();
    let all: f64 = trials.iter().flatten().sum();
    if !(all > 0.0) {
        return Vec::new();
    }
    let count = trials.len() as f64;
    let band = |i: usize| {
        let share = trials.iter().map(|t| t[i]).sum::<f64>() / all;
        // A ratio of sums over trials, linearized.
        let spread: f64 = trials.iter().map(|t| (t[i] - share * t.iter().sum::<f64>()).powi(2)).sum();
        let half =
            (count > 1.0).then(|| t_quantile(0.975, count - 1.0) * (spread * count / (count - 1.0)).sqrt() / all);
        let interval = half.map(|half| [(share - half).max(0.0), (share + half).min(1.0)]);
        Band { low: BAND_EDGES[i], high: BAND_EDGES.get(i + 1).copied(), share, interval }
    };
    (0..BAND_EDGES.len()).map(band).collect()
}

/// Sum of a trial's squared residuals by frequency.
fn energies(time: &[f64], residual: &[f64]) -> [f64; BAND_EDGES.len()] {
    let mut out = [0.0; BAND_EDGES.len()];
    let n = residual.len();
    let group = n.div_ceil(SPECTRUM_SAMPLES).max(1);
    let means: Vec<f64> = residual.chunks(group).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect();
    let m = means.len();
    let (Some(first), Some(last)) = (time.first(), time.last()) else { return out };
    for k in 0..=m / 2 {
        let (mut re, mut im) = (0.0, 0.0);
        for (i, v) in means.iter().enumerate() {
            let phase = std::f64::consts::TAU * ((k * i) % m) as f64 / m as f64;
            re += v * phase.cos();
            im -= v * phase.sin();
        }
        // Parseval: what negative frequencies hold counts for the positive ones.
        let twice = if k == 0 || 2 * k == m { 1.0 } else { 2.0 };
        let frequency = k as f64 / (last - first);
        let band = BAND_EDGES.iter().rposition(|edge| frequency >= *edge).unwrap_or(0);
        out[band] += twice * (re * re + im * im) / m as f64 * (n as f64 / m as f64);
    }
    // What averaging over neighbours took away is faster than anything the spectrum shows.
    let square: f64 = residual.iter().map(|r| r * r).sum();
    let known: f64 = out.iter().sum();
    out[BAND_EDGES.len() - 1] += (square - known).max(0.0);
    out
}

/// Noise from repetitions: half the mean square of the differences between their residuals.
fn repetition_noise(trials: &[ResidualTrial]) -> Option<RepetitionNoise> {
    let mut conditions: BTreeMap<&str, Vec<&ResidualTrial>> = BTreeMap::new();
    trials.iter().for_each(|t| conditions.entry(&t.condition).or_default().push(t));
    let (mut square, mut count, mut pairs) = (0.0, 0usize, 0usize);
    for repeats in conditions.values().filter(|r| r.len() > 1) {
        for (i, a) in repeats.iter().enumerate() {
            for b in &repeats[i + 1..] {
                pairs += 1;
                for (t, r) in a.time.iter().zip(&a.residual) {
                    let at = b.time[0] + t - a.time[0];
                    if at > b.time[b.time.len() - 1] {
                        break;
                    }
                    let k = b.time.partition_point(|x| *x <= at).clamp(1, b.time.len() - 1);
                    let part = (at - b.time[k - 1]) / (b.time[k] - b.time[k - 1]);
                    let other = b.residual[k - 1] + part * (b.residual[k] - b.residual[k - 1]);
                    square += (r - other).powi(2);
                    count += 1;
                }
            }
        }
    }
    (count > 0).then(|| RepetitionNoise { noise: (0.5 * square / count as f64).sqrt(), pairs })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals that are a line against angle, in trials that sweep it.
    fn trial(g: usize, residual: impl Fn(f64, f64) -> f64) -> ResidualTrial {
        let time: Vec<f64> = (0..400).map(|k| 0.01 * f64::from(k)).collect();
        let angle: Vec<f64> = time.iter().map(|t| 0.6 * (1.5 * t + g as f64).sin()).collect();
        let speed: Vec<f64> = time.iter().map(|t| 0.9 * (1.5 * t + g as f64).cos()).collect();
        ResidualTrial {
            residual: time.iter().zip(&angle).map(|(t, q)| residual(*t, *q)).collect(),
            acceleration: angle.iter().map(|q| -2.25 * q).collect(),
            activation: vec![vec![0.1; 400]],
            session: g as f64,
            effort: Some(25.0),
            condition: "sweep".into(),
            time,
            angle,
            speed,
        }
    }

    fn account(residual: impl Fn(f64, f64) -> f64 + Copy) -> Residuals {
        let trials: Vec<_> = (0..8).map(|g| trial(g, residual)).collect();
        let muscles = [MuscleName { name: "FCR".into(), direction: 1.0 }];
        along_axes(&trials, &trials, &muscles, SessionUnit::Order)
    }

    #[test]
    fn verif_a_spring_shows_along_the_angle_and_not_along_velocity() {
        let found = account(|_, q| -1.3 * q);
        let share = |axis: &str| found.axes.iter().find(|a| a.axis == axis).unwrap().share;
        assert!(share("angle") > 0.97, "{}", share("angle"));
        assert!(share("velocity") < 0.2 && share("time_in_trial") < 0.4, "{found:?}");
        let angle = &found.axes.iter().find(|a| a.axis == "angle").unwrap().bins;
        for bin in angle {
            assert!((bin.mean + 1.3 * bin.at.to_radians()).abs() < 1e-9);
            let [low, high] = bin.interval.unwrap();
            assert!(low <= bin.mean && bin.mean <= high);
        }
    }

    #[test]
    fn verif_bands_hold_a_tone_where_it_is_and_sum_to_one() {
        let found = account(|t, _| (std::f64::consts::TAU * 3.0 * t).sin());
        let inside = found.bands.iter().find(|b| b.low == 2.0).unwrap().share;
        assert!(inside > 0.95, "{inside}");
        assert!((found.bands.iter().map(|b| b.share).sum::<f64>() - 1.0).abs() < 1e-12);
        for band in &found.bands {
            let [low, high] = band.interval.unwrap();
            assert!(low <= band.share && band.share <= high && high - low < 0.1, "{band:?}");
        }
    }

    #[test]
    fn verif_repetitions_that_differ_by_noise_only_give_its_size() {
        let trials: Vec<_> = (0..4)
            .map(|g| {
                let sign = if g % 2 == 0 { 0.1 } else { -0.1 };
                ResidualTrial { condition: "same".into(), ..trial(0, |_, q| -q + sign) }
            })
            .collect();
        let found = repetition_noise(&trials).unwrap();
        // Of six pairs four differ by 0.2: half of the mean square is 4/6 · 0.02.
        assert!((found.noise - (4.0_f64 / 6.0 * 0.02).sqrt()).abs() < 1e-12);
        assert_eq!(found.pairs, 6);
        assert!(repetition_noise(&trials[..1]).is_none());
    }
}
