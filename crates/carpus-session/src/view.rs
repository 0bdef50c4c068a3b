//! A model as a page that computes: in three dimensions, in any posture, with lengths and moment arms of its muscles.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::account::warning_result;
use super::diagnostic::{Diagnostic, Failure};
use super::geometry::PackedGeometry;
use super::info::unit_of;
use super::model::{self, Needs};
use super::output::OutputFolder;
use super::progress::{Progress, go_on};
use super::provenance::{DEFAULT_SEED, input_file, made_by};
use super::quantity::Assignment;
use carpus_osim::osim::spec::{CoordinateIndex, MuscleIndex};
use carpus_report::live::packed;
use carpus_report::model_page::{ModelPage, render_model};

/// A page that shows a model.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewModel {
    /// The model.
    pub model: PathBuf,
    /// Folders in which bone geometry is looked for, before those beside the model.
    pub geometry: Vec<PathBuf>,
    /// The posture that the page begins with; coordinates that are not set are as the model gives them.
    pub set: Vec<Assignment>,
    /// Whether work goes on without components that are not supported.
    pub allow_unsupported: bool,
    /// Words that the page gives as what made it; without them the request itself.
    pub command: Option<String>,
}

/// The page.
#[derive(Clone, Debug)]
pub struct ViewedModel {
    /// One HTML page that needs no network.
    pub page: String,
    /// Bone geometry that is in it, and that was not found.
    pub geometry: PackedGeometry,
    /// Muscles that it shows.
    pub muscles: usize,
    /// What a person should know.
    pub warnings: Vec<Diagnostic>,
    model: PathBuf,
}

/// Triangles of a mesh that the page carries at most: bones of OpenSim's models have a tenth of it, and a page with all
/// bones of an arm stays below some megabytes.
const MOST_TRIANGLES: usize = 20_000;

/// Missing files of geometry that are named one by one.
const NAMED: usize = 3;

impl ViewModel {
    /// The model as it is, geometry from beside it.
    pub fn new(model: impl Into<PathBuf>) -> ViewModel {
        ViewModel {
            model: model.into(),
            geometry: Vec::new(),
            set: Vec::new(),
            allow_unsupported: false,
            command: None,
        }
    }

    /// Makes the page.
    ///
    /// # Errors
    /// The model, a coordinate, the path of a muscle, a folder of geometry that is none; a request to stop.
    pub fn run(&self, progress: &dyn Progress) -> Result<ViewedModel, Failure> {
        go_on(progress)?;
        if let Some(folder) = self.geometry.iter().find(|folder| !folder.is_dir()) {
            let message = Diagnostic::error("this is no folder").in_file(folder);
            return Err(message.hint("give a folder with .vtp, .stl or .obj files").into());
        }
        let mut warnings = Vec::new();
        let loaded = model::load(&self.model, Needs::Motion, self.allow_unsupported, &mut warnings)?;
        let start = loaded.posture(&self.set, &mut warnings)?;
        let every: Vec<_> = (0..loaded.file.spec.muscles.len()).map(MuscleIndex).collect();
        loaded.muscle_paths(&every)?;
        let geometry = loaded.geometry(&self.geometry, MOST_TRIANGLES, &mut warnings);
        if let Some(message) = missing(&geometry) {
            warnings.push(message.in_file(&self.model));
        }
        let internal = |e: std::io::Error| Failure::Internal(e.to_string());
        let page = render_model(&ModelPage {
            name: loaded.model.name.clone(),
            file: self.model.display().to_string(),
            model: packed(loaded.file.document.bytes()).map_err(internal)?,
            geometry: packed(&geometry.bytes).map_err(internal)?,
            start,
            units: (0..loaded.model.n_coordinates()).map(|c| unit_of(&loaded.file.spec, CoordinateIndex(c))).collect(),
            warnings: warnings.iter().map(warning_result).collect(),
            provenance: made_by(
                self.command.as_deref(),
                self,
                DEFAULT_SEED,
                vec![input_file(&self.model, &self.model.display().to_string(), "model")?],
            ),
        });
        Ok(ViewedModel { page, geometry, muscles: every.len(), warnings, model: self.model.clone() })
    }
}

impl ViewedModel {
    /// For programs.
    ///
    /// - `page`: the file that the page was written to
    pub fn value(&self, page: &Path) -> Value {
        let (found, missing) = (&self.geometry.found, &self.geometry.missing);
        json!({
            "schema": "carpus.view/1", "file": page.display().to_string(), "muscles": self.muscles,
            "geometry": { "found": found, "missing": missing },
        })
    }

    /// Writes the page, whose path comes back.
    ///
    /// # Errors
    /// The disk; a path that is that of the model.
    pub fn write_to(&self, page: &Path) -> Result<PathBuf, Failure> {
        let folder = page.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let Some(name) = page.file_name() else {
            return Err(Diagnostic::error("expected a file to write").in_file(page).into());
        };
        OutputFolder::create(folder, std::slice::from_ref(&self.model))?.write(name, self.page.as_bytes())
    }
}

/// The warning that files of geometry were not found.
fn missing(geometry: &PackedGeometry) -> Option<Diagnostic> {
    let (first, count) = (geometry.missing.iter().take(NAMED).cloned().collect::<Vec<_>>(), geometry.missing.len());
    let more = if count > NAMED { format!(" and {} more", count - NAMED) } else { String::new() };
    let text = match count {
        0 => return None,
        1 => format!("the bone geometry {} is not beside the model; a plain shape is shown instead", first[0]),
        _ => {
            format!("bone geometry is not beside the model: {}{more}; plain shapes are shown instead", first.join(", "))
        }
    };
    Some(Diagnostic::warning(text).hint("--geometry FOLDER names the folder that has it, such as OpenSim's Geometry"))
}
