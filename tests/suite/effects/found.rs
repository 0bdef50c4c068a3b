//! Every effect hidden in the bundled study and looked for. The simulator is the one that looks: studies that OpenSim
//! simulated are in `diagnosis_hidden` and in the table of `fixtures/laboratory`.

use carpus::diagnosis::diagnose::{Diagnosis, Request, Verdict, diagnose};
use carpus::effects::synthesis::{RecordingNoise, sized as asked, synthesize};
use rayon::prelude::*;

use super::*;

/// Effects that no diagnosis can find here: the same as strength of the muscles, or without influence.
const NOT_TESTABLE: [&str; 3] = ["emg_gain", "torque_gain", "unmodelled_muscles"];

/// Environment variable that names the one effect to look for, and has the estimate's steps printed.
const ONLY: &str = "CARPUS_EFFECT";

/// A baseline of the EMG, of full excitation.
const BASELINE: f64 = 0.03;
/// Effects that only show at the end of what is plausible and with a tenth of the noise in these trials, and that size.
const SHOWS_WHEN_LARGE: [(&str, &str, f64); 3] =
    [("inertia", "inertia", 0.05), ("angle_offset", "offset", 0.17), ("emg_floor", "baseline", BASELINE)];

/// Springs that act at the ends of the range, which these trials do not reach: that nothing is detectable is right.
const OUT_OF_REACH: [&str; 1] = ["end_range_spring"];

/// The diagnosis of a person with these effects, of a size that is plain to see, by these candidates; noise a quarter
/// of a laboratory's, so that it is plain.
fn found(hidden: &[&'static dyn Effect], candidates: Vec<&'static dyn Effect>) -> Diagnosis {
    let (study, file, model) = study();
    let mut trials = study.load_trials("P01").unwrap_or_else(|e| panic!("{e}"));
    if hidden.iter().any(|e| e.description().id == "emg_floor") {
        // The bundled recordings have none that could be taken off them.
        trials.iter_mut().flat_map(|t| &mut t.excitation).flatten().for_each(|e| *e = (*e + BASELINE).min(1.0));
    }
    let forward = ForwardModel::new(&file.spec, model, &trials).unwrap();
    let size = |effect: &&'static dyn Effect| {
        let large = SHOWS_WHEN_LARGE.iter().find(|(id, ..)| *id == effect.description().id);
        let values: Vec<(String, f64)> =
            large.map(|(_, name, value)| ((*name).to_owned(), *value)).into_iter().collect();
        asked(*effect, &values, &forward.muscles, &forward.joint).unwrap()
    };
    let effects: Vec<Setting> = hidden.iter().map(size).collect();
    let faint = hidden.iter().any(|e| SHOWS_WHEN_LARGE.iter().any(|(id, ..)| *id == e.description().id));
    let noise = RecordingNoise::REALISTIC.scaled(if faint { 0.1 } else { 0.25 });
    let recorded = synthesize(&forward, &trials, &effects, &noise, 7).unwrap().trials;
    let forward = ForwardModel::for_diagnosis(&file.spec, model, &recorded).unwrap();
    let request = Request {
        participant: "P01".to_owned(),
        forward: &forward,
        laboratory: None,
        bounds: study.settings.bounds,
        images: Vec::new(),
        candidates,
        mvc: recorded.iter().map(Trial::max_abs_moment).fold(0.0, f64::max),
        seed: 1,
    };
    let tell = std::env::var_os(ONLY).is_some();
    diagnose(&request, &|at| {
        if tell {
            println!("{at:?}")
        }
    })
    .unwrap()
    .diagnosis
}

#[test]
fn verif_every_effect_is_found_and_its_nearest_rival_not_blamed_in_its_place() {
    // Read before the pool's threads ask for it: reading asks for them.
    study();
    let only = std::env::var(ONLY).ok();
    let asked = |id: &str| only.as_ref().is_none_or(|only| only == id);
    let all =
        CATALOGUE.par_iter().map(|e| (e, e.description().id)).filter(|(_, id)| !NOT_TESTABLE.contains(id) && asked(id));
    let wrong: Vec<String> = all
        .filter_map(|(effect, _)| {
            let d = effect.description();
            let rival = d.rivals.iter().find(|r| !NOT_TESTABLE.contains(r));
            let candidates = std::iter::once(*effect).chain(rival.map(|r| named(r))).collect();
            let found = found(&[*effect], candidates);
            let sets: Vec<&[&str]> = found.explanations.iter().map(|e| e.effects.as_slice()).collect();
            let told = format!("{} (rival {rival:?}): p {:.4}, {:?} {sets:?}", d.id, found.null_p_value, found.verdict);
            println!("{told}");
            let is_found = match OUT_OF_REACH.contains(&d.id) {
                true => found.verdict == Verdict::NothingDetectable,
                false => sets.contains(&[d.id].as_slice()),
            };
            (!is_found).then_some(told)
        })
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn verif_no_effect_is_found_where_there_is_none() {
    let found = found(&[], CATALOGUE.to_vec());
    println!("p = {}", found.null_p_value);
    assert_eq!(found.verdict, Verdict::NothingDetectable);
}
