//! Fascicle lengths of ultrasound images as data of a fit.

use super::diagnostic::{Diagnostic, Failure};
use super::loading::LoadedParticipant;
use super::study::Study;
use carpus_multibody::muscles::Millard2012;
use carpus_personalization::personalization::RestingFiber;
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
        let millard = Millard2012::from_spec(spec).map_err(|e| match spec.is_computed() {
            true => at(format!(
                "{}: fascicle lengths inform the fit of a Millard2012EquilibriumMuscle only, not of a {}; with \
                 `fascicles = \"check\"` in [ultrasound] of study.toml they are compared with the model afterwards",
                image.muscle,
                spec.class()
            )),
            false => at(e.to_string()),
        })?;
        fibers.push(RestingFiber {
            muscle,
            millard,
            path_length,
            activation: imaging.activation,
            measured,
            standard_deviation: imaging.fascicle_error * measured,
        });
    }
    Ok(fibers)
}
