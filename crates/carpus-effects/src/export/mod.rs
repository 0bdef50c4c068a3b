//! Effects in a model file: as components and properties of stock OpenSim 4.6 where these give exactly the moment that
//! Carpus computes, in a side-car ([`SideCar`], `effects.toml`) otherwise.

mod error;
mod native;
mod side_car;

use super::effect::{FlippedArm, OsimForm};
use super::forward_model::Setting;
use carpus_osim::osim::OsimFile;
use carpus_simulation::simulation::{MuscleParameters, Property, Setup};
pub use error::ExportError;
pub use side_car::{SIDE_CAR_SCHEMA, SideCar, SideCarError};

/// What became of the effects.
pub struct ExportReport {
    /// Those in the model itself.
    pub native: Vec<NativeEffect>,
    /// Those beside the model; empty if there are none.
    pub side_car: SideCar,
    /// Why each effect of the side-car is there, in its order.
    pub reasons: Vec<String>,
}

/// An effect that the model itself has now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NativeEffect {
    /// The effect.
    pub id: &'static str,
    /// Components added and properties changed, as `path: property`.
    pub changes: Vec<String>,
}

/// Writes muscles and effects into a model file; what comes beside it. Values that are the model's own stay as they are
/// written.
///
/// - `names`: of the active muscles; `given`, `parameters`: the model's own parameters of these, and those to be
///   written
/// - `arm_turns`: whether the forearm is turned over in some trials; a force of the model acts the same way in all, so
///   that weight that turns with the arm then stays beside it
///
/// # Errors
/// [`ExportError`]; the file is then as it was.
pub fn write_step(
    file: &mut OsimFile,
    setup: &Setup,
    names: &[String],
    given: &[MuscleParameters],
    parameters: &[MuscleParameters],
    effects: &[Setting],
    arm_turns: bool,
) -> Result<Vec<Setting>, ExportError> {
    let before = file.clone();
    let mut changes = Vec::new();
    for property in Property::ALL {
        for (name, (own, new)) in names.iter().zip(given.iter().zip(parameters)) {
            if property.of(own) != property.of(new) {
                changes.push((name.as_str(), property.name(), property.of(new)));
            }
        }
    }
    file.set_muscle_properties(&changes).map_err(ExportError::Muscle)?;
    let turns = |s: &&Setting| arm_turns && s.effect.description().behaviour.flipped_arm == FlippedArm::Reversed;
    let (beside, within): (Vec<&Setting>, Vec<&Setting>) = effects.iter().partition(turns);
    let within: Vec<Setting> = within.into_iter().cloned().collect();
    match write(file, setup, &within) {
        Ok(report) => Ok(report.side_car.effects.into_iter().chain(beside.into_iter().cloned()).collect()),
        Err(e) => {
            *file = before;
            Err(e)
        }
    }
}

/// Writes effects into a model file, changing nothing else. Effects whose amplitudes are all 0 are left out.
///
/// An effect goes into the model only where the moment of the study counts the part that would carry it (`passive` for
/// forces, `inertia` for inertia): the exported model, simulated as the study says, then gives the moment that the
/// effect gives.
///
/// # Errors
/// [`ExportError`]; the file is then as it was.
pub fn write(file: &mut OsimFile, setup: &Setup, effects: &[Setting]) -> Result<ExportReport, ExportError> {
    let before = file.clone();
    let result = write_all(file, setup, effects);
    if result.is_err() {
        *file = before;
    }
    result
}

fn write_all(file: &mut OsimFile, setup: &Setup, effects: &[Setting]) -> Result<ExportReport, ExportError> {
    let coordinate = native::MovingCoordinate::find(&file.spec, setup)?;
    let side_car = SideCar { coordinate: setup.coordinate.clone(), effects: Vec::new() };
    let mut report = ExportReport { native: Vec::new(), side_car, reasons: Vec::new() };
    for item in effects {
        let description = item.effect.description();
        let expected = description.parameters.len();
        if item.values.len() != expected || item.values.iter().any(|v| !v.is_finite()) {
            let found = item.values.clone();
            return Err(ExportError::BadValues { effect: description.id, expected, found });
        }
        if description.is_absent(&item.values) {
            continue;
        }
        let written = native::write(file, setup, &coordinate, item)
            .map_err(|source| ExportError::Edit { effect: description.id, source })?;
        match written {
            Ok(changes) => report.native.push(NativeEffect { id: description.id, changes }),
            Err(reason) => {
                report.side_car.effects.push(item.clone());
                report.reasons.push(reason.unwrap_or_else(|| form_text(&description.osim_form)));
            }
        }
    }
    Ok(report)
}

fn form_text(form: &OsimForm) -> String {
    match form {
        OsimForm::Native(text) | OsimForm::SideCar(text) => (*text).to_owned(),
        OsimForm::Controls(text) => format!("no component of OpenSim does it; {text} would"),
    }
}
