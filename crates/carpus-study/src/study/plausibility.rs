//! Checks of one trial that cost no error, only a look: units, signs, sizes.

use super::columns::AngleUnit;
use super::fault::Fault;
use super::participants::Participant;
use super::problem::Problem;
use super::raw_emg::EmgSignal;
use super::settings::Settings;
use super::times::median;
use super::trial::Trial;
use super::trial_list::{Contraction, Direction};
use carpus_numerics::plausible;

/// Coarsest sampling that resolves activation dynamics (time constants of 10–40 ms) \[s\].
const COARSEST_STEP: f64 = 0.02;
/// Largest moment a wrist or elbow exerts on a dynamometer [N·m].
const LARGEST_MOMENT: f64 = 120.0;
/// A measured moment of an active trial stays below this multiple of the MVC moment.
const LARGEST_PART_OF_MVC: f64 = 2.0;
/// Travel below which a trial that should move does not \[deg\].
const LEAST_TRAVEL_DEG: f64 = 2.0;
/// Travel above which an isometric trial moves \[deg\].
const MOST_ISOMETRIC_TRAVEL_DEG: f64 = 10.0;
/// Difference between stated and measured posture worth a look \[deg\].
const POSTURE_TOLERANCE_DEG: f64 = 10.0;

/// What a person should look at in this trial.
pub(crate) fn check(trial: &Trial, settings: &Settings, participant: Option<&Participant>) -> Vec<Problem> {
    let mut faults = Vec::new();
    sampling(trial, &mut faults);
    angle(trial, settings, &mut faults);
    velocity(trial, settings, &mut faults);
    if settings.emg == EmgSignal::Normalized {
        constant_emg(trial, settings, &mut faults); // of raw channels this is said before they are filtered
    }
    moment(trial, participant, &mut faults);
    faults.into_iter().map(|fault| Problem::warning(&trial.info.file, None, fault)).collect()
}

fn sampling(trial: &Trial, faults: &mut Vec<Fault>) {
    let steps: Vec<f64> = trial.time.windows(2).map(|w| w[1] - w[0]).collect();
    let median_step_s = median(&steps);
    if let Some(doubt) = plausible::TIME_STEP.doubt(median_step_s).filter(|_| median_step_s < COARSEST_STEP) {
        faults.push(Fault::Implausible { name: "median time step".to_owned(), doubt });
    }
    if let Some(doubt) = plausible::TRIAL_DURATION.doubt(trial.duration()) {
        faults.push(Fault::Implausible { name: "duration".to_owned(), doubt });
    }
    // Times are written with few digits: a step of exactly the limit must not fail for rounding.
    if median_step_s > COARSEST_STEP * (1.0 + 1e-6) {
        faults.push(Fault::CoarseSampling { median_step_s, expected_s: COARSEST_STEP });
    }
    if let Some(own) = &trial.moment_samples {
        let rate_hz = (trial.len() - 1) as f64 / trial.duration();
        faults.push(Fault::MomentResampled { how: own.how, own_rate_hz: rate_hz / own.step, rate_hz });
    }
}

fn angle(trial: &Trial, settings: &Settings, faults: &mut Vec<Fault>) {
    let columns = &settings.columns;
    let name = || columns.angle.clone();
    let (lowest, highest) = range(&trial.angle);
    let travel_deg = (highest - lowest).to_degrees();
    let mean = mean(&trial.angle);
    let contraction = trial.info.contraction;
    let isometric = contraction == Contraction::Isometric;
    let moving = matches!(contraction, Contraction::Isotonic | Contraction::Freehand);
    let before = faults.len();
    match columns.angle_unit {
        AngleUnit::Degrees => {
            if columns.angle.to_lowercase().ends_with("_rad") {
                faults.push(Fault::LooksLikeRadians { name: name(), evidence: "its name ends in _rad".to_owned() });
            } else if moving && travel_deg < LEAST_TRAVEL_DEG {
                let evidence = format!("an {} trial travels only {travel_deg:.3}", contraction.word());
                faults.push(Fault::LooksLikeRadians { name: name(), evidence });
            } else if let Some(stated) = trial.info.posture.filter(|p| isometric && p.abs() > 5f64.to_radians()) {
                // The samples were taken as degrees; radians would have been smaller by 180/π.
                if (mean.to_degrees() - stated).abs() < 0.15 * stated.abs() {
                    let evidence = format!("mean {:.4}, stated posture {:.1}°", mean.to_degrees(), stated.to_degrees());
                    faults.push(Fault::LooksLikeRadians { name: name(), evidence });
                }
            }
        }
        AngleUnit::Radians => {
            let largest = lowest.abs().max(highest.abs());
            if columns.angle.to_lowercase().ends_with("_deg") {
                faults.push(Fault::LooksLikeDegrees { name: name(), evidence: "its name ends in _deg".to_owned() });
            } else if largest > std::f64::consts::TAU {
                let evidence = format!("it reaches {largest:.2}, more than a full turn");
                faults.push(Fault::LooksLikeDegrees { name: name(), evidence });
            }
        }
    }
    if faults.len() > before {
        return; // with the wrong unit, the rest would be the same complaint in other words
    }
    if isometric && travel_deg > MOST_ISOMETRIC_TRAVEL_DEG {
        faults.push(Fault::IsometricMoves { travel_deg });
    }
    if let Some(stated) = trial.info.posture.filter(|_| isometric) {
        let (mean_deg, stated_deg) = (mean.to_degrees(), stated.to_degrees());
        if (mean_deg - stated_deg).abs() > POSTURE_TOLERANCE_DEG {
            faults.push(Fault::PostureMismatch { mean_deg, stated_deg });
        }
    }
}

/// Least-squares ratio of the velocity column to the central difference of the angle, if the trial moves.
fn velocity(trial: &Trial, settings: &Settings, faults: &mut Vec<Fault>) {
    let Some(velocity) = &trial.velocity else { return };
    let (lowest, highest) = range(&trial.angle);
    if (highest - lowest).to_degrees() < LEAST_TRAVEL_DEG {
        return;
    }
    let (mut product, mut square, mut own_square) = (0.0, 0.0, 0.0);
    for i in 1..trial.len() - 1 {
        let derivative = (trial.angle[i + 1] - trial.angle[i - 1]) / (trial.time[i + 1] - trial.time[i - 1]);
        product += velocity[i] * derivative;
        square += derivative * derivative;
        own_square += velocity[i] * velocity[i];
    }
    if square == 0.0 {
        return;
    }
    // Noise of the differentiated angle shrinks product/square; the ratio of sizes, with the sign of the product,
    // bounds it from the other side. Only if both are off is the unit or the sign wrong.
    let ratio = product / square;
    let size_ratio = (own_square / square).sqrt().copysign(ratio);
    let plausible = 0.5..=2.0;
    if !plausible.contains(&ratio) && !plausible.contains(&size_ratio) {
        faults.push(Fault::VelocityDisagrees { column: settings.columns.velocity.clone(), ratio: size_ratio });
    }
}

fn constant_emg(trial: &Trial, settings: &Settings, faults: &mut Vec<Fault>) {
    for (i, samples) in trial.excitation.iter().enumerate() {
        let column = &settings.columns.emg[i];
        let (lowest, highest) = range(samples);
        let relaxed = trial.info.contraction == Contraction::Passive && highest == 0.0;
        if lowest == highest && !relaxed && !settings.columns.emg[..i].contains(column) {
            faults.push(Fault::ConstantEmg { column: column.clone(), value: lowest });
        }
    }
}

fn moment(trial: &Trial, participant: Option<&Participant>, faults: &mut Vec<Fault>) {
    let max_abs_n_m = trial.max_abs_moment();
    let info = &trial.info;
    let active = matches!(info.contraction, Contraction::Isometric | Contraction::Isotonic | Contraction::Mvc);
    let effort = info.effort_percent.unwrap_or(if info.contraction == Contraction::Mvc { 100.0 } else { 0.0 });
    let mvc = participant.and_then(|p| match info.direction {
        Direction::Flexion => p.mvc_flexion,
        Direction::Extension => p.mvc_extension,
        Direction::None => None,
    });
    let expected = if max_abs_n_m == 0.0 && active {
        Some("the moment of an active trial is zero throughout".to_owned())
    } else if max_abs_n_m > LARGEST_MOMENT {
        Some(format!("expected at most {LARGEST_MOMENT} N·m"))
    } else if let Some(mvc) = mvc.filter(|mvc| max_abs_n_m > LARGEST_PART_OF_MVC * mvc) {
        Some(format!("the maximum voluntary moment is {mvc} N·m"))
    } else if let Some(mvc) = mvc.filter(|mvc| active && max_abs_n_m < 0.05 * effort / 100.0 * mvc) {
        Some(format!("expected about {:.2} N·m, {effort} % of the maximum voluntary moment", mvc * effort / 100.0))
    } else if active && effort >= 10.0 && max_abs_n_m < 0.02 {
        Some(format!("expected more of an effort of {effort} %"))
    } else {
        None
    };
    faults.extend(expected.map(|expected| Fault::MomentScale { max_abs_n_m, expected }));
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn range(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)))
}
