//! What muscles did in the trials: where their fibres work, and EMG over moment.

use super::diagnostic::{Diagnostic, Failure};
use super::loading::LoadedParticipant;
use carpus_multibody::muscles::{Contraction, MuscleLaw, MuscleModel};
use carpus_osim::osim::spec::{ModelSpec, MuscleSpec};
use carpus_report::muscle_use::{MuscleOperation, MuscleUse, OperatingRange};
use carpus_report::results::{rounded, thinned};
use carpus_simulation::simulation::TrialSimulation;

/// Samples of EMG and moment that are drawn, of all trials together.
const DRAWN_SAMPLES: usize = 240;
/// Points of a curve.
const CURVE_POINTS: usize = 41;
/// Fibre lengths over optimal length, and velocities over the maximum, that curves span.
const LENGTHS: [f64; 2] = [0.4, 1.6];
const VELOCITIES: [f64; 2] = [-1.0, 1.0];
/// Share of the samples beyond either end of a range.
const BEYOND: f64 = 0.01;

/// A model whose trials were simulated.
pub(super) struct Simulated<'a> {
    /// Its key in the results.
    pub(super) id: &'a str,
    /// The model.
    pub(super) spec: &'a ModelSpec,
    /// Every trial.
    pub(super) trials: &'a [TrialSimulation],
}

/// What the active muscles did; curves are those of the last model.
///
/// # Errors
/// A muscle of a model that cannot be made of its properties, which a simulated one can.
pub(super) fn muscle_use(run: &LoadedParticipant, models: &[Simulated]) -> Result<Option<MuscleUse>, Failure> {
    let Some(last) = models.last() else { return Ok(None) };
    let samples: usize = run.trials.iter().map(|t| t.len()).sum();
    let places: Vec<(usize, usize)> =
        run.trials.iter().enumerate().flat_map(|(i, t)| (0..t.len()).map(move |k| (i, k))).collect();
    let drawn: Vec<(usize, usize)> = thinned(samples, DRAWN_SAMPLES).into_iter().map(|at| places[at]).collect();
    let moment_n_m = drawn.iter().map(|&(i, k)| rounded(run.trials[i].moment[k], 4)).collect();
    let of = |(position, name): (usize, &str)| -> Result<MuscleOperation, Failure> {
        let mut ranges = std::collections::BTreeMap::new();
        for model in models {
            let (spec, muscle) = muscle_of(run, model.spec, name)?;
            ranges.insert(model.id.to_owned(), range(spec, muscle.law(), position, model.trials));
        }
        let (_, muscle) = muscle_of(run, last.spec, name)?;
        let law = muscle.law();
        let length = even(holding(LENGTHS, ranges.values().map(|range| range.length)));
        let velocity = even(holding(VELOCITIES, ranges.values().map(|range| range.velocity)));
        let force = force_over_velocity(law, &velocity);
        Ok(MuscleOperation {
            muscle: name.to_owned(),
            excitation: drawn.iter().map(|&(i, k)| rounded(run.trials[i].excitation[position][k], 4)).collect(),
            ranges,
            active: length.iter().map(|x| rounded(law.active(*x).0, 4)).collect(),
            passive: length.iter().map(|x| rounded(law.passive(*x).0, 4)).collect(),
            length,
            velocity: if force.is_empty() { Vec::new() } else { velocity },
            force,
        })
    };
    let muscles = run.model.muscle_names().enumerate().map(of).collect::<Result<_, _>>()?;
    Ok(Some(MuscleUse { moment_n_m, muscles }))
}

fn muscle_of<'s>(
    run: &LoadedParticipant,
    spec: &'s ModelSpec,
    name: &str,
) -> Result<(&'s MuscleSpec, MuscleModel), Failure> {
    let own = spec.muscles.iter().find(|m| m.name == name);
    let own = own.ok_or_else(|| Failure::Internal(format!("muscle {name} is no longer in the model")))?;
    let muscle = MuscleModel::from_spec(own);
    Ok((own, muscle.map_err(|e| Diagnostic::error(e.to_string()).in_file(&run.loaded.path))?))
}

/// The interval that also holds others.
fn holding(whole: [f64; 2], others: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    others.fold(whole, |[low, high], other| [low.min(other[0]), high.max(other[1])])
}

fn even([low, high]: [f64; 2]) -> Vec<f64> {
    (0..CURVE_POINTS).map(|i| rounded(low + (high - low) * i as f64 / (CURVE_POINTS - 1) as f64, 4)).collect()
}

fn range(spec: &MuscleSpec, law: &dyn MuscleLaw, position: usize, trials: &[TrialSimulation]) -> OperatingRange {
    let optimal = spec.optimal_fiber_length;
    let fastest = optimal * law.max_velocity();
    let of = |values: &mut Vec<f64>, scale: f64| {
        values.retain(|v| v.is_finite());
        values.sort_by(f64::total_cmp);
        let last = values.len().saturating_sub(1);
        let at = |share: f64| values.get((share * last as f64).round() as usize).map_or(0.0, |v| rounded(v / scale, 4));
        [at(BEYOND), at(1.0 - BEYOND)]
    };
    let muscles = || trials.iter().map(|t| &t.muscles[position]);
    OperatingRange {
        length: of(&mut muscles().flat_map(|m| m.fiber_length.iter().copied()).collect(), optimal),
        velocity: of(&mut muscles().flat_map(|m| m.fiber_velocity.iter().copied()).collect(), fastest),
    }
}

/// Force of the fully active fibre at optimal length, less the passive force, over that at rest; empty for a class
/// that does not state the force of a moving fibre, and where the curve gives none at rest.
fn force_over_velocity(law: &dyn MuscleLaw, velocities: &[f64]) -> Vec<f64> {
    let (active, passive) = (law.active(1.0), law.passive(1.0));
    let force = |u: f64| {
        let at = Contraction { u, activation: 1.0, active, passive, cosine: 1.0, secant: 1.0, tendon: 0.0 };
        law.fiber_force(&at)[0] - passive.0
    };
    let rest = force(0.0);
    let found: Vec<f64> = velocities.iter().map(|u| rounded(force(*u) / rest, 4)).collect();
    let is_curve = rest > 0.0 && found.iter().all(|f| f.is_finite()) && found.iter().any(|f| *f != found[0]);
    if is_curve { found } else { Vec::new() }
}
