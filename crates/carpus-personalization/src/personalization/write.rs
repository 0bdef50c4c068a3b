//! Writing fitted parameters into the model file.

use super::parameters::FittedParameter;
use carpus_osim::osim::{EditError, OsimFile};
use carpus_simulation::simulation::Property;

/// Why fitted parameters are not in the file.
#[derive(Debug, thiserror::Error)]
pub enum WriteBackError {
    /// The file could not be edited.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// The edited file says something else.
    #[error("{muscle}: {property} reads back as {found:?}, expected {expected}")]
    ReadBack {
        /// The muscle.
        muscle: String,
        /// OpenSim property name.
        property: &'static str,
        /// What was written.
        expected: f64,
        /// What the file says; `None` if the muscle is gone.
        found: Option<f64>,
    },
}

/// Sets the fitted values in a model file: only the lines of parameters that changed are touched. The edited file is
/// read again, and every value compared.
///
/// # Errors
/// [`WriteBackError`].
pub fn write_parameters(file: &mut OsimFile, fitted: &[FittedParameter]) -> Result<(), WriteBackError> {
    let changes: Vec<(&str, &str, f64)> = fitted
        .iter()
        .filter(|p| p.after != p.before)
        .map(|p| (p.muscle.as_str(), p.property.name(), p.after))
        .collect();
    file.set_muscle_properties(&changes)?;
    for p in fitted {
        let found = file.spec.muscles.iter().find(|m| m.name == p.muscle).map(|m| match p.property {
            Property::OptimalFiberLength => m.optimal_fiber_length,
            Property::TendonSlackLength => m.tendon_slack_length,
            Property::MaxIsometricForce => m.max_isometric_force,
        });
        // Numbers are written with as many digits as it takes to read the same number.
        if !found.is_some_and(|found| (found - p.after).abs() <= 1e-12 * p.after.abs()) {
            let (muscle, property, expected) = (p.muscle.clone(), p.property.name(), p.after);
            return Err(WriteBackError::ReadBack { muscle, property, expected, found });
        }
    }
    Ok(())
}
