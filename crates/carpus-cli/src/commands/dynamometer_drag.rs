//! `carpus dynamometer-drag`: the machine's own damping from runs at constant velocity without a participant.

use crate::args::{DynamometerDragArgs, Global};
use crate::failure::Failure;
use crate::provenance::command_line;
use crate::stdout::print_result;
use crate::table::{fixed, table};
use carpus_report::significant;
use carpus_session::drag::{FoundDrag, MachineDrag};

/// Runs the command.
///
/// # Errors
/// The files, or runs that do not tell the drag.
pub fn run(args: &DynamometerDragArgs, global: &Global) -> Result<(), Failure> {
    let request = MachineDrag { input: args.input.clone(), seed: global.seed, command: Some(command_line()) };
    let found = request.run()?;
    if global.json {
        return print_result(&found.value()?.to_string());
    }
    print_result(&readable(&found))
}

fn readable(found: &FoundDrag) -> String {
    let (drag, files) = (&found.drag, &found.files);
    let header = ["run", "from s", "to s", "velocity °/s", "mean moment N·m"];
    let rows = drag.phases.iter().map(|p| {
        let name = files[p.run].file_name().unwrap_or_default().to_string_lossy().into_owned();
        vec![name, fixed(p.time[0], 2), fixed(p.time[1], 2), fixed(p.velocity.to_degrees(), 2), fixed(p.moment, 4)]
    });
    let mut text = table(&header, 1, rows);
    let per_degree = 1f64.to_radians();
    let [low, high] = drag.interval.map(|v| significant(v * per_degree, 3));
    text.push_str(&format!("\n\nresidual           {} N·m\n", significant(drag.residual, 3)));
    match drag.friction {
        Some((friction, [low, high])) => text.push_str(&format!(
            "Coulomb friction   {} N·m (95 %: {} to {})\n",
            significant(friction, 3),
            significant(low, 3),
            significant(high, 3)
        )),
        None => text.push_str("Coulomb friction   counted as drag: the runs have one speed or one direction\n"),
    }
    text.push_str(&format!("viscous drag       95 %: {low} to {high} N·m·s/deg\n\nfor study.toml:\n"));
    let negative = "nothing: the drag is negative, so the sign of moment or angle is turned in these runs\n";
    text + found.for_study().as_deref().unwrap_or(negative)
}
