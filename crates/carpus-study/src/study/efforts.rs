//! What the trials of a participant say together: the direction of efforts, and the size of the largest.
//!
//! A dynamometer reads the moment of the effort and that of the relaxed limb together, and in a weak effort the second
//! may be
//! the larger one. So the effort is judged above rest: by how the moment follows the summed EMG at equal angles. A
//! moment
//! that is reversed in one trial is that trial's fault; reversed in all, it is the recording's.

use std::path::Path;

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::fault::Fault;
use super::participants::Participant;
use super::problem::Problem;
use super::settings::Settings;
use super::trial::Trial;
use super::trial_list::{Contraction, Direction, TrialInfo};

/// Travel of the angle above which the moment of the relaxed limb changes along a trial \[rad\]: 2°.
const LEAST_TRAVEL: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// Rest is seen in a trial whose summed EMG falls to this part of its largest: an effort begun or ended.
const REST_PART: f64 = 0.5;
/// Part of the moment's variation that the EMG has to explain for an effort to be judged: with less, what moves the
/// moment
/// is the joint's motion or noise.
const LEAST_EXPLAINED: f64 = 0.5;
/// Efforts from this part of the maximum on outweigh the relaxed limb \[%\]: without rest in the trial, their mean is
/// judged.
const STRONG_EFFORT_PERCENT: f64 = 50.0;
/// A mean below this part of the largest moment has no clear direction.
const CLEAR_PART: f64 = 0.2;
/// Stated and measured maximum voluntary moments agree to this ratio: repeated maxima of one person differ by up to a
/// fifth.
const MVC_AGREES: f64 = 1.25;
/// Trials from which on a moment reversed in all of them is the recording's fault, not the trials'.
const FEWEST_REVERSED: usize = 2;

/// What one trial says of its effort.
#[derive(Clone, Debug)]
pub(crate) struct Effort {
    info: TrialInfo,
    /// Moment of the effort [N·m], positive in the coordinate's positive direction, if it can be told.
    moment: Option<f64>,
    /// +1 or −1: sign of the moment that the stated direction has; 0 if that is not known.
    sign: f64,
    /// Largest absolute moment [N·m].
    largest: f64,
}

impl Effort {
    /// Looks at a trial.
    pub fn of(trial: &Trial, settings: &Settings) -> Effort {
        let sign = match (flexion_sign(settings), trial.info.direction) {
            (Some(sign), Direction::Flexion) => sign,
            (Some(sign), Direction::Extension) => -sign,
            _ => 0.0,
        };
        let active =
            matches!(trial.info.contraction, Contraction::Isometric | Contraction::Isotonic | Contraction::Mvc);
        let moment = if active && sign != 0.0 { above_rest(trial) } else { None };
        Effort { info: trial.info.clone(), moment, sign, largest: trial.max_abs_moment() }
    }

    fn is_reversed(&self) -> bool {
        self.moment.is_some_and(|moment| self.sign * moment < 0.0)
    }
}

/// Which way flexion turns the dynamometer's coordinate, if its name or `[strength_scaling]` says so.
pub(crate) fn flexion_sign(settings: &Settings) -> Option<f64> {
    if !settings.strength.flexion_is_positive {
        return Some(-1.0);
    }
    settings.dynamometer.coordinate.to_lowercase().contains("flexion").then_some(1.0)
}

/// Moment of a trial's effort [N·m], positive in the coordinate's positive direction; `None` if it cannot be told from
/// the moment of the relaxed limb.
///
/// ```text
/// moment ≈ c₀ + c₁ q + c₂ q² + b E,   effort = b (E₉₅ − E₅)
/// ```
/// - `q`: angle, where it moves; `E`: sum of the excitations, with its quantiles
fn above_rest(trial: &Trial) -> Option<f64> {
    let n = trial.len();
    let total: Vec<f64> = (0..n).map(|k| trial.excitation.iter().map(|e| e[k]).sum()).collect();
    let mut sorted = total.clone();
    sorted.sort_by(f64::total_cmp);
    let (rest, strong) = (sorted[n / 20], sorted[n - 1 - n / 20]);
    if strong <= 0.0 || rest > REST_PART * strong {
        let mean = trial.moment.iter().sum::<f64>() / n as f64;
        let is_strong = trial.info.is_mvc() || trial.info.effort_percent.is_some_and(|e| e >= STRONG_EFFORT_PERCENT);
        return Some(mean).filter(|mean| is_strong && mean.abs() > CLEAR_PART * trial.max_abs_moment());
    }
    let (low, high) = angles(std::slice::from_ref(trial));
    let moves = high - low > LEAST_TRAVEL;
    let sums = sums_of_products(std::slice::from_ref(trial), |_, k| total[k]);
    let relaxed: &[usize] = if moves { &[0, 1, 2] } else { &[0] };
    let with_effort = [relaxed, &[3]].concat();
    let (without, _) = regression(&sums, relaxed)?;
    let (with, coefficients) = regression(&sums, &with_effort)?;
    let explains = without > 0.0 && with <= (1.0 - LEAST_EXPLAINED) * without;
    explains.then(|| coefficients[relaxed.len()] * (strong - rest))
}

/// Sums of products of 1, q, q², a predictor, and the moment, over all samples; q runs from −1 to 1 over the angles.
///
/// - `predictor`: of a trial's sample
pub(super) fn sums_of_products(trials: &[Trial], predictor: impl Fn(usize, usize) -> f64) -> SMatrix<f64, 5, 5> {
    let (low, high) = angles(trials);
    let mut sums = SMatrix::<f64, 5, 5>::zeros();
    for (t, trial) in trials.iter().enumerate() {
        for k in 0..trial.len() {
            let q = if high > low { 2.0 * (trial.angle[k] - low) / (high - low) - 1.0 } else { 0.0 };
            let row = SVector::from([1.0, q, q * q, predictor(t, k), trial.moment[k]]);
            sums += row * row.transpose();
        }
    }
    sums
}

/// Smallest and greatest angle \[rad\].
fn angles(trials: &[Trial]) -> (f64, f64) {
    let all = trials.iter().flat_map(|trial| &trial.angle);
    all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(*q), high.max(*q)))
}

/// Sum of squares that a regression of the last variable on some others leaves, and its coefficients.
///
/// - `sums`: sums of products of all variables
pub(super) fn regression(sums: &SMatrix<f64, 5, 5>, on: &[usize]) -> Option<(f64, DVector<f64>)> {
    let matrix = DMatrix::from_fn(on.len(), on.len(), |i, j| sums[(on[i], on[j])]);
    let products = DVector::from_fn(on.len(), |i, _| sums[(on[i], 4)]);
    let coefficients = matrix.cholesky()?.solve(&products);
    Some((sums[(4, 4)] - products.dot(&coefficients), coefficients))
}

/// What the trials of all participants given say together.
///
/// - `efforts`: of trials that could be read, each participant's in the order of recording
/// - `file`, `folder`: the study.toml, and the folder it is in
pub(crate) fn check(
    efforts: &[Effort],
    participants: &[Participant],
    settings: &Settings,
    file: &Path,
    folder: &Path,
) -> Vec<Problem> {
    let mut problems = Vec::new();
    let (mut reversed, mut trials) = (Vec::new(), 0);
    for participant in participants {
        let own: Vec<&Effort> = efforts.iter().filter(|e| e.info.participant == participant.name).collect();
        let judged: Vec<&&Effort> = own.iter().filter(|e| e.moment.is_some()).collect();
        let against: Vec<&&&Effort> = judged.iter().filter(|e| e.is_reversed()).collect();
        if against.len() == judged.len() && judged.len() >= FEWEST_REVERSED {
            reversed.push(participant.name.clone());
            trials += judged.len();
        } else {
            problems.extend(against.iter().map(|e| trial_reversed(e)));
        }
        problems.extend(check_mvc(folder, participant, &own));
    }
    if !reversed.is_empty() {
        let column = settings.columns.moment.clone();
        let fault = Fault::MomentReversed { column, trials, participants: reversed };
        problems.insert(0, Problem::error(file, settings.dynamometer.coordinate_line, fault));
    }
    problems
}

fn trial_reversed(effort: &Effort) -> Problem {
    let effort_n_m = effort.moment.unwrap_or(0.0);
    let fault = Fault::MomentSign { effort_n_m, direction: effort.info.direction.word() };
    Problem::warning(&effort.info.file, None, fault)
}

/// Compares the stated maximum voluntary moments with the MVC trials.
fn check_mvc(folder: &Path, participant: &Participant, efforts: &[&Effort]) -> Vec<Problem> {
    let stated = [
        ("mvc_flexion_n_m", Direction::Flexion, participant.mvc_flexion),
        ("mvc_extension_n_m", Direction::Extension, participant.mvc_extension),
    ];
    let table = folder.join("participants.csv");
    let mut problems = Vec::new();
    for (column, direction, stated) in stated {
        let of_direction = efforts.iter().filter(|e| e.info.is_mvc() && e.info.direction == direction);
        let largest = of_direction.max_by(|a, b| a.largest.total_cmp(&b.largest));
        let (Some(stated_n_m), Some(largest)) = (stated, largest) else { continue };
        let measured_n_m = largest.largest;
        if measured_n_m > 0.0 && !(1.0 / MVC_AGREES..=MVC_AGREES).contains(&(stated_n_m / measured_n_m)) {
            let trial = largest.info.file_as_written.clone();
            let fault = Fault::MvcDisagrees { column, stated_n_m, measured_n_m, trial };
            problems.push(Problem::warning(&table, participant.line, fault));
        }
    }
    problems
}
