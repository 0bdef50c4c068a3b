//! Which further trials would tell explanations apart, and by how much.
//!
//! The trials at hand and the simulated ones of an experiment add up their information about muscle parameters and
//! effects; z is the length of one effect's signature once muscles and the rival are fitted, at the size that the data
//! suggest, in standard deviations of the noise that the data show.

use nalgebra::{DMatrix, DVector};

use super::experiments::experiments;
use super::fit::{AMPLITUDE_PRECISION, Analysis, Fit};
use carpus_effects::catalogue::effect;
use carpus_effects::covered::Covered;
use carpus_effects::forward_model::ForwardModel;
use carpus_effects::trial_record::TrialRecord;
use carpus_osim::osim::spec::ModelSpec;
use carpus_simulation::simulation::{MusculoskeletalModel, SimulationError};
use carpus_study::study::{ParameterBounds, Trial};

/// Experiments that are kept for each pair.
const KEPT: usize = 3;

/// What an experiment does for a pair of explanations.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Separation {
    /// What to record.
    pub trials: &'static str,
    /// The explanations.
    pub separates: [&'static str; 2],
    /// z with the trials at hand.
    pub z_now: f64,
    /// z with the experiment as well.
    pub z_then: f64,
}

/// Information of trials about nuisance and directions, and where the directions of each effect are.
struct Information {
    normal: DMatrix<f64>,
    precision: Vec<f64>,
    blocks: Vec<(String, Vec<usize>)>,
}

/// What experiments are simulated with.
#[derive(Clone, Copy)]
pub struct Laboratory<'a> {
    /// Specification of the participant's model.
    pub spec: &'a ModelSpec,
    /// The model.
    pub model: &'a MusculoskeletalModel,
}

/// Everything that experiments do for every pair of these effects; the most useful first.
///
/// - `analysis`, `null`: of the trials at hand, and their fit without effects
/// - `bounds`: of the muscle parameters: priors
/// - `progress`: told how many experiments are done, of how many
///
/// # Errors
/// A trial that cannot be simulated.
pub fn separations(
    analysis: &Analysis,
    null: &Fit,
    laboratory: Laboratory,
    bounds: &ParameterBounds,
    rivals: &[&'static str],
    progress: &dyn Fn(usize, usize),
) -> Result<Vec<Separation>, SimulationError> {
    let Laboratory { spec, model } = laboratory;
    let limits = model.skeleton().coordinates[model.coordinate().0].range;
    let forward = analysis.forward;
    let now = at_hand(analysis, null, rivals);
    let sizes = sizes(analysis, null, rivals);
    let all = experiments(forward, limits);
    let mut found = Vec::new();
    progress(0, all.len());
    for (done, experiment) in all.iter().enumerate() {
        let then = after_session(forward, spec, model, &experiment.recordings)?;
        let candidates = rivals.iter().filter_map(|id| effect(id)).collect();
        let trials = (0..then.trials.len()).collect();
        let mut more =
            Analysis::without_data(&then, trials, candidates, bounds, analysis.seed).with_kernels_of(analysis);
        let information = more.information(null)?;
        let added = with_directions(information, &more, &now);
        let with =
            Information { normal: &now.normal + added, precision: now.precision.clone(), blocks: now.blocks.clone() };
        for (i, a) in rivals.iter().enumerate() {
            for b in &rivals[i + 1..] {
                let z = |information: &Information| separation(information, &sizes, a, b);
                if let (Some(z_now), Some(z_then)) = (z(&now), z(&with)) {
                    found.push(Separation { trials: experiment.trials, separates: [a, b], z_now, z_then });
                }
            }
        }
        progress(1 + done, all.len());
    }
    found.sort_by(|a, b| b.z_then.total_cmp(&a.z_then));
    Ok(found)
}

/// The most useful experiment of every pair, of those in which the most useful come first.
pub fn best_of_pairs(separations: &[Separation]) -> Vec<&Separation> {
    let mut best: Vec<&Separation> = Vec::new();
    for s in separations {
        if best.iter().all(|b| b.separates != s.separates) {
            best.push(s);
        }
    }
    best
}

/// The most useful experiments of every pair; the pair that is worst off first.
///
/// - `separations`: the most useful first
pub fn most_useful(separations: &[Separation]) -> Vec<&Separation> {
    let mut kept: Vec<&Separation> = Vec::new();
    for s in separations {
        if kept.iter().filter(|k| k.separates == s.separates).count() < KEPT {
            kept.push(s);
        }
    }
    let worst = |s: &Separation| separations.iter().find(|x| x.separates == s.separates).map_or(0.0, |x| x.z_now);
    kept.sort_by(|a, b| worst(a).total_cmp(&worst(b)).then(b.z_then.total_cmp(&a.z_then)));
    kept
}

/// Trials recorded at the end of a session: of muscles as used as they are then, at a joint as strong as it showed
/// itself.
///
/// - `session`: what was recorded; `recordings`: what would be, with zero moments
///
/// # Errors
/// A trial that cannot be simulated.
pub fn after_session(
    session: &ForwardModel,
    spec: &ModelSpec,
    model: &MusculoskeletalModel,
    recordings: &[Trial],
) -> Result<ForwardModel, SimulationError> {
    let mut then = ForwardModel::new(spec, model, recordings)?.with_given(session.given().to_vec());
    // Columns are in units of scales that go with its strength, and with what it covers.
    then.joint = session.joint;
    then.covered = Some(Covered::by(&session.trials, session.joint.strength));
    let used = session.trials.last().map(TrialRecord::exposure_after).unwrap_or_default();
    for trial in &mut then.trials {
        trial.session = 1.0;
        trial.exposure.iter_mut().zip(&used).for_each(|(exposure, used)| *exposure += used);
    }
    Ok(then)
}

/// What the trials at hand say.
fn at_hand(analysis: &Analysis, null: &Fit, rivals: &[&'static str]) -> Information {
    let nuisance = null.precision.len();
    let chosen: Vec<(String, Vec<usize>)> = analysis
        .blocks
        .iter()
        .filter(|b| rivals.contains(&b.name.as_str()))
        .map(|b| (b.name.clone(), b.columns.clone()))
        .collect();
    let columns: Vec<usize> =
        (0..nuisance).chain(chosen.iter().flat_map(|(_, c)| c.iter().map(|c| nuisance + c))).collect();
    let whole = analysis.normal(null);
    let normal = DMatrix::from_fn(columns.len(), columns.len(), |i, j| whole[(columns[i], columns[j])]);
    let mut next = nuisance;
    let blocks = chosen
        .into_iter()
        .map(|(name, c)| {
            let range = (next..next + c.len()).collect();
            next += c.len();
            (name, range)
        })
        .collect();
    Information { normal, precision: null.precision.clone(), blocks }
}

/// The information of an experiment, its columns in the order of the information at hand.
fn with_directions(normal: DMatrix<f64>, of: &Analysis, now: &Information) -> DMatrix<f64> {
    let nuisance = now.precision.len();
    let mut from: Vec<usize> = (0..nuisance).collect();
    for (name, columns) in &now.blocks {
        match of.blocks.iter().find(|b| b.name == *name) {
            Some(block) => from.extend(block.columns.iter().map(|c| nuisance + c)),
            None => from.extend(columns.iter().map(|_| usize::MAX)),
        }
    }
    let at = |i: usize, j: usize| if i == usize::MAX || j == usize::MAX { 0.0 } else { normal[(i, j)] };
    DMatrix::from_fn(from.len(), from.len(), |i, j| at(from[i], from[j]))
}

/// Sizes of the effects that the data suggest, in scales of their amplitudes.
fn sizes(analysis: &Analysis, null: &Fit, rivals: &[&'static str]) -> Vec<(&'static str, DVector<f64>)> {
    let Some(left) = analysis.anything_left(null, &[]) else { return Vec::new() };
    let size = |id: &&'static str| {
        let block = left.blocks.iter().find(|b| b.name == *id)?;
        Some((*id, block.one_step.clone()))
    };
    rivals.iter().filter_map(size).collect()
}

/// The smaller z of two explanations: each in turn taken to be true.
fn separation(information: &Information, sizes: &[(&'static str, DVector<f64>)], a: &str, b: &str) -> Option<f64> {
    Some(f64::min(one_way(information, sizes, a, b)?, one_way(information, sizes, b, a)?))
}

fn one_way(information: &Information, sizes: &[(&'static str, DVector<f64>)], truth: &str, rival: &str) -> Option<f64> {
    let columns = |id: &str| information.blocks.iter().find(|(name, _)| name == id).map(|(_, c)| c.as_slice());
    let size = &sizes.iter().find(|(id, _)| *id == truth)?.1;
    let (own, others) = (columns(truth)?, columns(rival)?);
    let nuisance = information.precision.len();
    let fitted: Vec<usize> = (0..nuisance).chain(others.iter().copied()).collect();
    let prior = |i: usize| information.precision.get(fitted[i]).copied().unwrap_or(AMPLITUDE_PRECISION);
    let normal = &information.normal;
    let inner = DMatrix::from_fn(fitted.len(), fitted.len(), |i, j| {
        normal[(fitted[i], fitted[j])] + if i == j { prior(i) } else { 0.0 }
    });
    let weighted = |row: usize| own.iter().zip(size.iter()).map(|(c, s)| normal[(row, *c)] * s).sum::<f64>();
    let cross = DVector::from_iterator(fitted.len(), fitted.iter().map(|row| weighted(*row)));
    let length: f64 = own.iter().zip(size.iter()).map(|(row, s)| s * weighted(*row)).sum();
    let explained = cross.dot(&inner.cholesky()?.solve(&cross));
    Some((length - explained).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_effects::forward_model::Setting;
    use carpus_osim::osim::OsimFile;
    use carpus_simulation::simulation::Setup;
    use carpus_study::study::{Study, TrialUse};

    /// The bundled study, moments times `factor`: held and moving trials, and the model.
    fn session(factor: f64) -> (ForwardModel, ModelSpec, MusculoskeletalModel) {
        let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let study = Study::read(root.join("fixtures/demo_study/study.toml")).unwrap();
        let file = OsimFile::read(root.join("models/wrist.osim")).unwrap();
        let model = MusculoskeletalModel::compile(&file.spec, &Setup::from_settings(&study.settings)).unwrap();
        let used = ["isometric_50_flexion_+30deg_1", "isotonic_50_extension_1"];
        let chosen = study.trials_of("P01").filter(|info| used.iter().any(|name| info.file_as_written.contains(name)));
        let mut trials: Vec<Trial> = chosen.map(|info| study.trial(info).unwrap()).collect();
        assert_eq!(trials.len(), used.len());
        for trial in &mut trials {
            trial.info.usage = TrialUse::Train;
            trial.moment.iter_mut().for_each(|m| *m *= factor);
        }
        (ForwardModel::new(&file.spec, &model, &trials).unwrap(), file.spec, model)
    }

    /// A column of an experiment in units of an effect's scale [N·m].
    fn column(of: &ForwardModel, id: &str) -> Vec<f64> {
        let settings = [Setting::absent(effect(id).unwrap())];
        let (input, parameters) = (of.recorded_input(0), of.nominal_parameters());
        let variants = of.difference_variants(&settings, 0).unwrap();
        let core = of.core(&of.variant(&settings).unwrap(), 0, &input, &parameters, &settings, true).unwrap();
        of.effect_derivative(0, &core, &input, &parameters, &settings, 0, &variants, 0).unwrap()
    }

    #[test]
    fn verif_experiments_are_in_the_units_of_the_session() {
        let (plain, ..) = session(1.0);
        let largest = plain.trials.iter().flat_map(|t| &t.moment).fold(0.0_f64, |most, m| most.max(m.abs()));
        // Three times the largest moment of wrists.
        let (strong, spec, model) = session(60.0 / largest);
        assert!((strong.joint.strength - 3.0).abs() < 1e-9, "{:?}", strong.joint);
        let recordings = &experiments(&strong, [-0.6, 0.6])[0].recordings;
        let then = after_session(&strong, &spec, &model, recordings).unwrap();
        assert_eq!(then.joint, strong.joint);
        // So that sizes, in scales, mean the same of both: a scale of 0.1 N·m at a wrist, and a share of it per rad.
        assert!(column(&then, "torque_offset").iter().all(|m| (m - 0.3).abs() < 1e-9));
        let [weak, own] = [&session(1.0).0, &strong].map(|session| {
            let then = after_session(session, &spec, &model, recordings).unwrap();
            column(&then, "joint_stiffness")
        });
        assert!(own.iter().zip(&weak).all(|(own, weak)| (own - 3.0 * weak).abs() < 1e-7));
        assert!(own.iter().any(|m| m.abs() > 0.1));
    }

    #[test]
    fn verif_experiments_find_muscles_as_used_as_the_session_left_them() {
        let (session, spec, model) = session(1.0);
        let recordings = &experiments(&session, [-0.6, 0.6])[0].recordings;
        let then = after_session(&session, &spec, &model, recordings).unwrap();
        let last = session.trials.last().unwrap();
        let used = last.exposure_after();
        assert_eq!(then.trials[0].exposure, used);
        assert!(used.iter().zip(&last.exposure).all(|(after, before)| after > before));
        assert!(then.trials.windows(2).all(|t| t[1].exposure.iter().zip(&t[0].exposure).all(|(b, a)| b > a)));
        assert!(then.trials.iter().all(|t| t.session == 1.0));
    }
}
