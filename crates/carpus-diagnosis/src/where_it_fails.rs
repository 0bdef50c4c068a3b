//! Where a model fails: the residual against angle, speed, time and the like.

use serde::Serialize;

use crate::score_test::Omnibus;
use carpus_effects::covered::Covered;
use carpus_effects::forward_model::ForwardModel;
use carpus_simulation::evaluation::residuals::{Band, Bin, Sample, binned, by_frequency};
use carpus_simulation::simulation::PreparedTrial;

/// The axes, by name.
pub const AXES: [&str; 11] = [
    "constant",
    "angle",
    "velocity",
    "acceleration",
    "time_in_trial",
    "session",
    "flexor_activation",
    "extensor_activation",
    "history",
    EFFORT,
    LOCAL,
];
/// The moment itself, as the model says it was recorded: a sensor that does not read in proportion shows there.
const EFFORT: &str = "effort";
/// Axis of a test alone: the angle, in detail. A tendon that snaps over a bone and a machine that cogs show there and
/// hardly along a parabola.
const LOCAL: &str = "angle_detail";
/// Bumps over the range of angles.
const BUMPS: usize = 7;

/// The residual along one axis.
#[derive(Clone, Debug, Serialize)]
pub struct AxisResult {
    /// The axis.
    pub axis: &'static str,
    /// Unit of the axis.
    pub unit: &'static str,
    /// p-value of a straight line and a parabola along the axis, muscle parameters profiled out; none for frequency.
    pub p_value: Option<f64>,
    /// Share of the residual's mean square that the binned means explain, less what chance would; of frequency, that of
    /// the strongest band.
    pub share_of_error: f64,
    /// Per bin with samples of several trials: mean of the axis, mean residual, and its 95 % interval over trials
    /// [N·m]; of frequency: lower edge of the band, its share of the residual's mean square, and the share's interval.
    pub curve: Vec<[f64; 4]>,
}

/// Values of an axis over a trial.
///
/// - `prepared`: the trial, its excitations freed of noise where the axis is used for a test
/// - `moment`: that the model says is recorded [N·m]
fn series(forward: &ForwardModel, trial: usize, prepared: &PreparedTrial, moment: &[f64], axis: usize) -> Vec<f64> {
    let record = &forward.trials[trial];
    let kinematics = prepared.kinematics();
    let activation = |sign: f64| -> Vec<f64> {
        let members: Vec<usize> = (0..forward.muscles.len()).filter(|m| forward.directions[*m] == sign).collect();
        (0..record.time.len())
            .map(|k| {
                members.iter().map(|m| kinematics.muscles[*m].activation[k]).sum::<f64>() / members.len().max(1) as f64
            })
            .collect()
    };
    match AXES[axis] {
        "angle" | LOCAL => kinematics.angle.clone(),
        "velocity" => kinematics.speed.clone(),
        "acceleration" => kinematics.acceleration.clone(),
        "time_in_trial" => record.time.iter().map(|t| t - record.time[0]).collect(),
        "session" => vec![record.session; record.time.len()],
        EFFORT => moment.to_vec(),
        "flexor_activation" => activation(1.0),
        "extensor_activation" => activation(-1.0),
        "history" => {
            // How far the joint has travelled lately: a trace that fades in 1 s.
            let mut moved = 0.0;
            let mut out = vec![0.0];
            for k in 1..record.time.len() {
                let h = record.time[k] - record.time[k - 1];
                moved = moved * (-h).exp() + kinematics.angle[k] - kinematics.angle[k - 1];
                out.push(moved);
            }
            out
        }
        _ => vec![1.0; record.time.len()],
    }
}

fn unit(axis: usize) -> &'static str {
    match AXES[axis] {
        "angle" | "history" | LOCAL => "rad",
        "velocity" => "rad/s",
        "acceleration" => "rad/s²",
        "time_in_trial" => "s",
        "session" => "share of the session",
        EFFORT => "N·m",
        _ => "1",
    }
}

/// What the session covers whose columns these are.
fn covered(forward: &ForwardModel) -> Covered {
    forward.covered.unwrap_or_else(|| Covered::by(&forward.trials, forward.joint.strength))
}

/// Bumps along the angle, evenly over what the session covers.
fn bumps(forward: &ForwardModel, angle: &[f64]) -> Vec<Vec<f64>> {
    let [low, high] = covered(forward).angle;
    let spacing = (high - low) / BUMPS as f64;
    let center = |i: usize| low + spacing * (i as f64 + 0.5);
    let bump = |i: usize| -> Vec<f64> {
        let at = |q: &f64| (-0.5 * ((q - center(i)) / (0.5 * spacing).max(1e-6)).powi(2)).exp();
        angle.iter().map(at).collect()
    };
    (0..BUMPS).map(bump).collect()
}

/// Directions along an axis, of about unit size: a line and a parabola, or bumps.
///
/// - `prepared`, `moment`: as simulated, excitations freed of noise
pub(crate) fn directions(
    forward: &ForwardModel,
    trial: usize,
    prepared: &PreparedTrial,
    moment: &[f64],
    axis: usize,
) -> Vec<Vec<f64>> {
    let values = series(forward, trial, prepared, moment, axis);
    if AXES[axis] == LOCAL {
        return bumps(forward, &values);
    }
    let scale = match AXES[axis] {
        "angle" | "history" => 0.5,
        "velocity" => 1.0,
        "acceleration" => 10.0,
        "time_in_trial" => 3.0,
        "flexor_activation" | "extensor_activation" => 0.3,
        EFFORT => covered(forward).moment,
        _ => 1.0,
    };
    let line: Vec<f64> = values.iter().map(|v| v / scale).collect();
    if matches!(AXES[axis], "constant") {
        return vec![line];
    }
    if AXES[axis] == EFFORT {
        // Odd in the moment; the line is the sensor's gain, which is the muscles' strength.
        return vec![line.iter().map(|v| v * v.abs()).collect(), line.iter().map(|v| v * v * v).collect()];
    }
    let parabola = match AXES[axis] {
        // Drag is odd in velocity.
        "velocity" => line.iter().map(|v| (v * 10.0).tanh()).collect(),
        _ => line.iter().map(|v| v * v).collect(),
    };
    vec![line, parabola]
}

/// The residuals of trials along every axis.
///
/// - `residuals`: trial and residual [N·m]
/// - `left`: what the score test found
pub fn along_axes(forward: &ForwardModel, residuals: &[(usize, Vec<f64>)], left: &Omnibus) -> Vec<AxisResult> {
    let mut out: Vec<AxisResult> = (1..AXES.len())
        .filter(|axis| AXES[*axis] != LOCAL)
        .map(|axis| {
            let name = format!("axis:{}", AXES[axis]);
            let p_value = left.blocks.iter().find(|b| b.name == name).map_or(1.0, |b| b.p_value);
            let (share_of_error, curve) = along_axis(forward, residuals, axis);
            AxisResult { axis: AXES[axis], unit: unit(axis), p_value: Some(p_value), share_of_error, curve }
        })
        .collect();
    let p_value = |a: &AxisResult| a.p_value.unwrap_or(1.0);
    out.sort_by(|a, b| p_value(a).total_cmp(&p_value(b)).then(b.share_of_error.total_cmp(&a.share_of_error)));
    out.push(frequency(forward, residuals));
    out
}

/// Where in frequency the residual is.
fn frequency(forward: &ForwardModel, residuals: &[(usize, Vec<f64>)]) -> AxisResult {
    let bands = by_frequency(residuals.iter().map(|(g, r)| (&forward.trials[*g].time[..], &r[..])));
    let share_of_error = bands.iter().map(|b| b.share).fold(0.0, f64::max);
    let point = |b: &Band| {
        let [low, high] = b.interval.unwrap_or([0.0, 1.0]);
        [b.low, b.share, low, high]
    };
    AxisResult {
        axis: "frequency",
        unit: "Hz",
        p_value: None,
        share_of_error,
        curve: bands.iter().map(point).collect(),
    }
}

/// Share that the means along an axis explain, and the means that have an interval.
fn along_axis(forward: &ForwardModel, residuals: &[(usize, Vec<f64>)], axis: usize) -> (f64, Vec<[f64; 4]>) {
    let of_trial = |(g, r): &(usize, Vec<f64>)| -> Vec<Sample> {
        let moment: Vec<f64> = forward.trials[*g].moment.iter().zip(r).map(|(m, r)| m - r).collect();
        let places = series(forward, *g, forward.base(*g), &moment, axis);
        places.into_iter().zip(r).map(|(x, r)| Sample { x, residual: *r, trial: *g }).collect()
    };
    let (share, bins) = binned(residuals.iter().flat_map(of_trial).collect());
    let point = |b: &Bin| b.interval.map(|[low, high]| [b.at, b.mean, low, high]);
    (share, bins.iter().filter_map(point).collect())
}
