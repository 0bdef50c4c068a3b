//! Fascicle lengths of ultrasound images as data of a fit.

use super::diagnostic::{Diagnostic, Failure};
use super::loading::LoadedParticipant;
use super::study::Study;
use carpus_diagnosis::inference::resting_fiber::{ImagedMuscle, RestingFiber};
use carpus_simulation::imaging::path_length;
use carpus_study::study::FascicleUse;

/// Fascicle lengths of the participant's images, if the study says that they inform the fit.
pub(super) fn images(study: &Study, run: &LoadedParticipant) -> Result<Vec<RestingFiber>, Failure> {
    let imaging = &study.tables.settings.imaging;
    if imaging.fascicles == FascicleUse::Check {
        return Ok(Vec::new());
    }
    let table = study.tables.folder.join("ultrasound.csv");
    let of_participant = study.tables.ultrasound.iter().filter(|m| m.participant == run.participant.name);
    let mut fibers = Vec::new();
    for (image, measured) in of_participant.filter_map(|m| Some((m, m.fascicle_length?))) {
        // A muscle that is not active has nothing to fit.
        let Some(muscle) = run.model.muscle_names().position(|name| name == image.muscle) else { continue };
        let at = |e: String| Failure::from(Diagnostic::error(e).in_file(&table).at_line(image.line));
        let (spec, path_length) = path_length(&run.loaded.file.spec, &run.loaded.model, &study.tables, image)
            .map_err(|e| at(format!("{} {}: {e}", run.participant.name, image.muscle)))?;
        let imaged = ImagedMuscle::from_spec(spec).map_err(|e| at(e.to_string()))?;
        fibers.push(RestingFiber {
            muscle,
            imaged,
            path_length,
            activation: imaging.activation,
            measured,
            standard_deviation: imaging.fascicle_error * measured,
        });
    }
    Ok(fibers)
}
