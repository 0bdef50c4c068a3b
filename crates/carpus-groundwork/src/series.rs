//! Series of a simulated trial as files: CSV for everyone, `.sto` for OpenSim.

use std::borrow::Cow;
use std::io::Write;

use super::account::csv_text;
use carpus_numerics::printable::visible;
use carpus_report::results::rounded;
use carpus_simulation::simulation::{PreparedTrial, TrialSimulation};
use carpus_study::study::Trial;

/// Significant digits of numbers in CSV.
const DIGITS: i32 = 9;

/// A column: its name in CSV, its name in `.sto`, its values.
struct Column<'a> {
    csv: String,
    sto: String,
    values: Cow<'a, [f64]>,
}

/// Columns of a trial: motion, moments, and per muscle what was simulated.
fn columns<'a>(
    coordinate: &str,
    muscles: &[String],
    trial: &'a Trial,
    prepared: &'a PreparedTrial,
    simulation: &'a TrialSimulation,
    with_effects: bool,
) -> Vec<Column<'a>> {
    fn column<'a>(csv: String, sto: String, values: impl Into<Cow<'a, [f64]>>) -> Column<'a> {
        Column { csv, sto, values: values.into() }
    }
    let kinematics = prepared.kinematics();
    let degrees: Vec<f64> = trial.angle.iter().map(|a| a.to_degrees()).collect();
    let mut columns = vec![
        // OpenSim knows a coordinate by its name, and its unit by the header.
        column(format!("{coordinate}_deg"), coordinate.to_owned(), degrees),
        column("measured_n_m".into(), "measured_moment".into(), trial.moment.as_slice()),
        column("simulated_n_m".into(), "simulated_moment".into(), simulation.moment.as_slice()),
        column("passive_n_m".into(), "passive_moment".into(), kinematics.passive_moment.as_slice()),
        column("gravity_n_m".into(), "gravity_moment".into(), kinematics.gravity_moment.as_slice()),
        column("inertia_n_m".into(), "inertia_moment".into(), kinematics.inertia_moment.as_slice()),
        column(
            "dynamometer_damping_n_m".into(),
            "dynamometer_damping_moment".into(),
            kinematics.damping_moment.as_slice(),
        ),
    ];
    if with_effects {
        // What the parts do not sum to is what effects beside the model do to joint and sensor.
        let parts = prepared.moment_without_muscles();
        let effects: Vec<f64> = (0..parts.len())
            .map(|k| simulation.moment[k] - parts[k] - simulation.muscles.iter().map(|m| m.moment[k]).sum::<f64>())
            .collect();
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
            columns.push(column(format!("{name}_{csv}"), format!("/forceset/{name}|{sto}"), values.as_slice()));
        }
    }
    columns
}

/// The series of a trial, to be written.
pub struct Series<'a> {
    trial: &'a Trial,
    columns: Vec<Column<'a>>,
}

impl<'a> Series<'a> {
    /// Of one trial.
    ///
    /// - `with_effects`: also what effects beside the model add
    pub fn new(
        coordinate: &str,
        muscles: &[String],
        trial: &'a Trial,
        prepared: &'a PreparedTrial,
        simulation: &'a TrialSimulation,
        with_effects: bool,
    ) -> Series<'a> {
        Series { trial, columns: columns(coordinate, muscles, trial, prepared, simulation, with_effects) }
    }

    /// Writes a CSV table, row by row: the text of a long recording is larger than all that it is made from.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_csv(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let header: Vec<&str> = std::iter::once("time_s").chain(self.columns.iter().map(|c| c.csv.as_str())).collect();
        let header =
            csv_text(header.iter(), std::iter::empty()).map_err(|e| std::io::Error::other(format!("{e:?}")))?;
        out.write_all(header.as_bytes())?;
        for (i, time) in self.trial.time.iter().enumerate() {
            write!(out, "{}", rounded(*time, DIGITS))?;
            for column in &self.columns {
                write!(out, ",{}", rounded(column.values[i], DIGITS))?;
            }
            writeln!(out)?;
        }
        Ok(())
    }

    /// Writes an OpenSim storage file: the coordinate's angle in degrees, as `inDegrees` says, all else in SI units.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_sto(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let (name, rows, columns) = (&self.trial.info.name, self.trial.len(), self.columns.len() + 1);
        write!(out, "{name}\nversion=1\nnRows={rows}\nnColumns={columns}\ninDegrees=yes\nendheader\ntime")?;
        self.columns.iter().try_for_each(|c| write!(out, "\t{}", visible(&c.sto)))?;
        writeln!(out)?;
        for (i, time) in self.trial.time.iter().enumerate() {
            write!(out, "{time}")?;
            self.columns.iter().try_for_each(|c| write!(out, "\t{:.9e}", c.values[i]))?;
            writeln!(out)?;
        }
        Ok(())
    }
}
