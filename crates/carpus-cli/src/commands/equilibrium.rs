//! `carpus equilibrium`: fibre and tendon lengths, forces and moments of muscles at rest in a posture.

use crate::args::{EquilibriumArgs, Global};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::stdout::print_result;
use crate::table::{fixed, table};
use carpus_session::equilibrium::{Equilibrium, MuscleAtRest, csv};

/// Runs the command.
///
/// # Errors
/// The model, a coordinate, a muscle, or the output file.
pub fn run(args: &EquilibriumArgs, global: &Global) -> Result<(), Failure> {
    let request = Equilibrium {
        model: args.model.model.clone(),
        set: args.set.clone(),
        activation: args.activation,
        moment_about: args.moment_about.clone(),
        muscles: args.muscles.clone(),
        allow_unsupported: args.model.allow_unsupported,
    };
    let csv_file = args.csv.as_ref().map(|file| request.target(file)).transpose()?;
    let found = request.run(&Bars::new(global))?;
    failure::print(&found.warnings);
    if let Some((folder, name)) = &csv_file {
        folder.write(name, csv(&found.muscles)?.as_bytes())?;
    }
    if global.json {
        return print_result(&found.value().to_string());
    }
    print_result(&readable(&found.muscles))
}

fn readable(rows: &[MuscleAtRest]) -> String {
    let mut header: Vec<String> = [
        "muscle",
        "path mm",
        "fibre mm",
        "l/l_opt",
        "tendon mm",
        "pennation °",
        "active N",
        "passive N",
        "tendon force N",
    ]
    .map(String::from)
    .to_vec();
    if let Some(first) = rows.first() {
        header.extend(
            first
                .moments
                .iter()
                .flat_map(|m| [format!("arm({}) mm", m.coordinate), format!("moment({}) N·m", m.coordinate)]),
        );
    }
    header.push("note".to_string());
    let body = rows.iter().map(|r| {
        let mut cells = vec![
            r.muscle.clone(),
            fixed(1e3 * r.path_length_m, 1),
            fixed(1e3 * r.fiber_length_m, 2),
            fixed(r.normalized_fiber_length, 3),
            fixed(1e3 * r.tendon_length_m, 1),
            fixed(r.pennation_angle_deg, 1),
            fixed(r.active_fiber_force_n, 2),
            fixed(r.passive_fiber_force_n, 2),
            fixed(r.tendon_force_n, 2),
        ];
        for m in &r.moments {
            cells.extend([fixed(1e3 * m.moment_arm_m, 2), fixed(m.moment_n_m, 4)]);
        }
        cells.push(if r.status == "converged" { String::new() } else { r.status.replace('_', " ") });
        cells
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    table(&header, 1, body)
}
