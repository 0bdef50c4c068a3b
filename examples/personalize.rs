//! A participant's muscles fitted to the recordings of a study:
//! `cargo run --release --example personalize [STUDY] [OUT]`.

use carpus::{Personalize, Study};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [study, out] = arguments(["fixtures/demo_study", "target/examples/personalized"]);
    let study = Study::open(study)?;
    for participant in study.participants() {
        let session = participant.load()?;
        let fit = session.personalize(&Personalize::default())?;
        println!("{}", fit.errors());
        fit.write(&out)?; // OUT/P01: model.osim, results.json, report.html, …
    }
    Ok(())
}

/// Words of the command line, or what stands for them.
fn arguments<const N: usize>(default: [&str; N]) -> [String; N] {
    let mut given = std::env::args().skip(1);
    default.map(|word| given.next().unwrap_or_else(|| word.to_string()))
}
