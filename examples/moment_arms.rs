//! Moment arms of a model's muscles against an angle: `cargo run --release --example moment_arms [MODEL.osim] [SWEEP]`.

use carpus::session::progress::Silent;
use carpus::session::quantity::Sweep;
use carpus::session::sweep::SweepPaths;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut given = std::env::args().skip(1);
    let model = given.next().unwrap_or_else(|| "models/wrist.osim".to_string());
    let sweep: Sweep = given.next().unwrap_or_else(|| "flexion=-60:60:20deg".to_string()).parse()?;
    let swept = SweepPaths::new(model, sweep).run(&Silent)?;
    swept.warnings.iter().for_each(|warning| eprintln!("{warning}"));

    let figure = &swept.figure;
    let names: String = figure.muscles.iter().map(|m| format!("{:>9}", m.name)).collect();
    println!("{:>14}{names}   moment arm [mm]", format!("{} [{}]", figure.coordinate, figure.unit));
    for (i, value) in figure.values.iter().enumerate() {
        let arms: String = figure.muscles.iter().map(|m| format!("{:>9.2}", 1e3 * m.moment_arm_m[i])).collect();
        println!("{value:>14.0}{arms}");
    }
    Ok(())
}
