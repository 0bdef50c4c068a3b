//! Which physics is missing, and the model with it: `cargo run --release --example diagnose [STUDY] [OUT]`.
//!
//! The study is simulated first, with drag in the joint that the model does not have.

use std::path::Path;

use carpus::session::candidates::EffectSize;
use carpus::session::diagnose::forward_model;
use carpus::session::effect_choice::decide;
use carpus::session::effect_steps::AddEffects;
use carpus::session::loading::Purpose;
use carpus::session::progress::Silent;
use carpus::session::synth::Synthesize;
use carpus::{Diagnose, Study};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut given = std::env::args().skip(1);
    let (study, out) = (given.next(), given.next().unwrap_or_else(|| "target/examples/diagnosed".to_string()));
    let study = match study {
        Some(study) => Study::open(study)?,
        None => with_hidden_drag(&Path::new(&out).join("study"))?,
    };
    let results = study.output_folder(&Path::new(&out).join("results"), "effect")?;
    for participant in study.participants() {
        let session = participant.load_for(Purpose::Diagnosis)?;
        let forward = forward_model(&session.data)?;
        let diagnosed = session.diagnosed(&forward, &Diagnose::default())?;
        println!("{}: {:?}", participant.about().name, diagnosed.diagnosis.verdict);
        for explanation in &diagnosed.diagnosis.explanations {
            println!("  consistent with {:?}, p = {:.3}", explanation.effects, explanation.p_value);
        }
        // What the data identify goes into the model, if anything does.
        let (effects, why_not) = decide(&diagnosed.known.result)?;
        if let Some(why) = why_not {
            println!("  {why}");
        }
        let request = AddEffects::default();
        let added = session.add_effects(results.path(), &forward, &effects, &diagnosed.known, &request)?;
        added.write_to(&results, Path::new(&participant.about().name))?;
        for step in added.results.ledger.iter().flat_map(|ledger| &ledger.steps) {
            println!("  {:<40} training error {:.2} %", step.label, 100.0 * step.train);
        }
    }
    results.close("effect", &study.others())?;
    Ok(())
}

/// The bundled study, simulated with viscous drag in the joint.
fn with_hidden_drag(folder: &Path) -> Result<Study, Box<dyn std::error::Error>> {
    let recorded = Study::open("fixtures/demo_study")?;
    let drag = EffectSize { id: "joint_damping".to_string(), values: Vec::new() };
    let request = Synthesize { effects: vec![drag], ..Synthesize::default() };
    let out = recorded.output_folder(folder, "synth")?;
    recorded.synthesize(&request, &out, &Silent)?;
    out.close("synth", &recorded.others())?;
    Ok(Study::open(folder)?)
}
