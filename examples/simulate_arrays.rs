//! A trial that is made of arrays, simulated without any file: `cargo run --release --example simulate_arrays`.

use carpus::session::bundled;
use carpus::study::{
    Contraction, Direction, Participant, PostureCoordinate, Settings, Study as Tables, Trial, TrialInfo, TrialUse,
};
use carpus::{Compare, Simulate, Study};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let muscles = ["ECRL", "ECRB", "ECU", "FCR", "FCU"];
    let mut settings = Settings::with_defaults("a wrist that swings", "flexion", &muscles)?;
    settings.posture.push(PostureCoordinate { coordinate: "elbow_flexion".to_string(), line: 0, value_deg_or_m: 90.0 });

    // Two seconds at 100 Hz: the wrist swings by 30°, flexors and extensors in turn.
    let time: Vec<f64> = (0..200).map(|k| 0.01 * f64::from(k)).collect();
    let swing = |t: &f64| (2.0 * std::f64::consts::PI * 0.5 * t).sin();
    let angle: Vec<f64> = time.iter().map(|t| 30f64.to_radians() * swing(t)).collect();
    let excitation = muscles.map(|muscle| {
        let sign = if muscle.starts_with('F') { 1.0 } else { -1.0 };
        time.iter().map(|t| 0.05 + 0.3 * (sign * swing(t)).max(0.0)).collect()
    });
    let measured = time.iter().map(|t| 3.0 * swing(t)).collect();

    let info = TrialInfo::new("P01", "swing", Contraction::Isotonic, Direction::Flexion, TrialUse::Test);
    let trial = Trial::from_samples(info, time, angle, measured, excitation.to_vec());
    let tables = Tables::of_trials(settings, vec![Participant::named("P01")], vec![trial])?;
    let study = Study::from_memory(tables, bundled::model()?);
    let session = study.participants().next().ok_or("there is a participant")?.load()?;

    let simulated = session.simulate(&Simulate::default())?;
    let [swing] = simulated.trials.as_slice() else { return Err("there is one trial".into()) };
    println!("{:>8} {:>12}", "t [s]", "moment [N·m]");
    for (t, moment) in session.data.trials[0].time.iter().zip(&swing.moment).step_by(20) {
        println!("{t:>8.2} {moment:>12.3}");
    }
    println!("{}", session.compare(&Compare::default())?.errors());
    Ok(())
}
