//! Series of a simulated trial as files: CSV for everyone, `.sto` for OpenSim.

use std::fmt::Write;

use super::account::csv_text;
use super::failure::Failure;
use crate::printable::visible;
use crate::simulation::{PreparedTrial, TrialSimulation};
use crate::study::Trial;

/// A column: its name in CSV, its name in `.sto`, its values.
struct Column {
    csv: String,
    sto: String,
    values: Vec<f64>,
}

/// Columns of a trial: motion, moments, and per muscle what was simulated.
fn columns(
    coordinate: &str,
    muscles: &[String],
    trial: &Trial,
    prepared: &PreparedTrial,
    simulation: &TrialSimulation,
    with_effects: bool,
) -> Vec<Column> {
    let column = |csv: String, sto: String, values: Vec<f64>| Column { csv, sto, values };
    let kinematics = prepared.kinematics();
    let degrees = trial.angle.iter().map(|a| a.to_degrees()).collect();
    let mut columns = vec![
        // OpenSim knows a coordinate by its name, and its unit by the header.
        column(format!("{coordinate}_deg"), coordinate.to_owned(), degrees),
        column("measured_n_m".into(), "measured_moment".into(), trial.moment.clone()),
        column("simulated_n_m".into(), "simulated_moment".into(), simulation.moment.clone()),
        column("passive_n_m".into(), "passive_moment".into(), kinematics.passive_moment.clone()),
        column("gravity_n_m".into(), "gravity_moment".into(), kinematics.gravity_moment.clone()),
        column("inertia_n_m".into(), "inertia_moment".into(), kinematics.inertia_moment.clone()),
        column(
            "dynamometer_damping_n_m".into(),
            "dynamometer_damping_moment".into(),
            kinematics.damping_moment.clone(),
        ),
    ];
    // What the parts do not sum to is what effects beside the model do to joint and sensor.
    let parts = prepared.moment_without_muscles();
    let effects: Vec<f64> = (0..parts.len())
        .map(|k| simulation.moment[k] - parts[k] - simulation.muscles.iter().map(|m| m.moment[k]).sum::<f64>())
        .collect();
    if with_effects {
        columns.push(column("effects_n_m".into(), "effects_moment".into(), effects));
    }
    for ((name, path), result) in muscles.iter().zip(&kinematics.muscles).zip(&simulation.muscles) {
        let quantities = [
            ("moment_n_m", "moment", &result.moment),
            ("tendon_force_n", "tendon_force", &result.tendon_force),
            ("fiber_length_m", "fiber_length", &result.fiber_length),
            ("fiber_velocity_m_per_s", "fiber_velocity", &result.fiber_velocity),
            ("activation", "activation", &path.activation),
            ("path_length_m", "length", &path.length),
            ("moment_arm_m", "moment_arm", &path.moment_arm),
        ];
        for (csv, sto, values) in quantities {
            columns.push(column(format!("{name}_{csv}"), format!("/forceset/{name}|{sto}"), values.clone()));
        }
    }
    columns
}

/// The CSV and `.sto` text of a trial.
///
/// - `with_effects`: also what effects beside the model add
///
/// # Errors
/// None that input can cause.
pub fn texts(
    coordinate: &str,
    muscles: &[String],
    trial: &Trial,
    prepared: &PreparedTrial,
    simulation: &TrialSimulation,
    with_effects: bool,
) -> Result<(String, String), Failure> {
    let columns = columns(coordinate, muscles, trial, prepared, simulation, with_effects);
    let header: Vec<&str> = std::iter::once("time_s").chain(columns.iter().map(|c| c.csv.as_str())).collect();
    let cell = |v: f64| crate::report::results::rounded(v, 9).to_string();
    let rows =
        trial.time.iter().enumerate().map(|(i, t)| {
            std::iter::once(cell(*t)).chain(columns.iter().map(|c| cell(c.values[i]))).collect::<Vec<_>>()
        });
    Ok((csv_text(header.iter(), rows)?, sto(trial, &columns)))
}

/// An OpenSim storage file: the coordinate's angle in degrees, as `inDegrees` says, all else in SI units.
fn sto(trial: &Trial, columns: &[Column]) -> String {
    let mut text = String::new();
    let w = &mut text;
    let name = &trial.info.name;
    let _ = write!(
        w,
        "{name}\nversion=1\nnRows={}\nnColumns={}\ninDegrees=yes\nendheader\ntime",
        trial.len(),
        columns.len() + 1
    );
    columns.iter().for_each(|c| {
        let _ = write!(w, "\t{}", visible(&c.sto));
    });
    w.push('\n');
    for (i, time) in trial.time.iter().enumerate() {
        let _ = write!(w, "{time}");
        columns.iter().for_each(|c| {
            let _ = write!(w, "\t{:.9e}", c.values[i]);
        });
        w.push('\n');
    }
    text
}
