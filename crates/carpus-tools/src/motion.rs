//! Motion of all coordinates from the columns of a file.

use std::path::Path;

use super::error::{ToolError, ToolProblem};
use super::finite_columns::require_finite;
use super::system::System;
use carpus_osim::functions::Function;
use carpus_osim::storage::{Storage, spline};

/// Coordinates over time that satisfy the constraints, and speeds.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// Times [s].
    pub time: Vec<f64>,
    /// Coordinates at every time.
    pub q: Vec<Vec<f64>>,
    /// Speeds at every time.
    pub u: Vec<Vec<f64>>,
    /// Coordinates that the file does not have.
    pub missing: Vec<String>,
}

/// Reads a file of coordinates, without columns of anything else, and filters it.
///
/// # Errors
/// The file; a value of a coordinate that is not finite; a spline that cannot be made.
pub fn read_coordinates(path: &Path, cutoff_hz: f64, system: &System) -> Result<Storage, ToolError> {
    let mut storage = Storage::read(path)?;
    let mut columns: Vec<usize> = columns_of(&storage, system).into_iter().flatten().collect();
    columns.sort_unstable();
    columns.dedup();
    require_finite(&storage, &columns, path)?;
    storage.labels = columns.iter().map(|column| storage.labels[*column].clone()).collect();
    for row in &mut storage.rows {
        *row = columns.iter().map(|column| row[*column]).collect();
    }
    if cutoff_hz >= 0.0 {
        storage.pad(storage.len() / 2);
        storage.lowpass(cutoff_hz).map_err(|e| ToolError::new(path, ToolProblem::Function(e)))?;
    }
    Ok(storage)
}

/// The column of every coordinate, by its name or the path of its value.
pub fn columns_of(storage: &Storage, system: &System) -> Vec<Option<usize>> {
    let find = |c: &carpus_osim::osim::spec::CoordinateSpec| {
        storage.find(&c.name).or_else(|| storage.find_state(&format!("{}/value", c.at.path)))
    };
    system.spec.coordinates.iter().map(find).collect()
}

/// Turns the columns of angles from degrees to radians, if the file is in degrees.
pub fn to_radians(storage: &mut Storage, system: &System) {
    if !storage.in_degrees {
        return;
    }
    storage.in_degrees = false;
    let scaled: Vec<bool> = storage
        .labels
        .iter()
        .map(|label| {
            let owns = |c: &carpus_osim::osim::spec::CoordinateSpec| {
                let speed = format!("{}_u", c.name);
                *label == c.name || *label == speed || label.rsplit_once('/').is_some_and(|(p, _)| p == c.at.path)
            };
            system.spec.coordinates.iter().position(owns).is_some_and(|i| system.is_angle(i))
        })
        .collect();
    for row in &mut storage.rows {
        row.iter_mut().zip(&scaled).filter(|(_, s)| **s).for_each(|(value, _)| *value = value.to_radians());
    }
}

/// Splines of degree 5 through the coordinates of a storage in radians; `None` where it lacks one.
///
/// # Errors
/// A spline that cannot be made.
pub fn coordinate_splines(
    storage: &Storage,
    columns: &[Option<usize>],
    file: &Path,
) -> Result<Vec<Option<Function>>, ToolError> {
    let degree = if storage.len() >= 6 {
        5
    } else if storage.len() >= 4 {
        3
    } else {
        1
    };
    let make = |column: &Option<usize>| {
        let Some(column) = column else { return Ok(None) };
        spline(degree, &storage.time, &storage.column(*column))
            .map(Some)
            .map_err(|e| ToolError::new(file, ToolProblem::Function(e)))
    };
    columns.iter().map(make).collect()
}

impl Motion {
    /// Coordinates of a storage that satisfy the constraints at every time, speeds by splines through its own
    /// (`SimbodyEngine::formCompleteStorages`). Coordinates that the storage lacks are 0.
    ///
    /// # Errors
    /// Splines that cannot be made; constraints that cannot be satisfied.
    pub fn from_storage(mut storage: Storage, system: &System, file: &Path) -> Result<Motion, ToolError> {
        to_radians(&mut storage, system);
        let columns = columns_of(&storage, system);
        let splines = coordinate_splines(&storage, &columns, file)?;
        let name = |(i, c): (usize, &Option<usize>)| c.is_none().then(|| system.model.coordinates[i].name.clone());
        let missing = columns.iter().enumerate().filter_map(name).collect();
        let mut motion = Motion { time: storage.time.clone(), missing, ..Motion::default() };
        for (time, row) in storage.time.iter().zip(&storage.rows) {
            let mut q: Vec<f64> = columns.iter().map(|c| c.map_or(0.0, |c| row[c])).collect();
            let u: Vec<f64> = splines.iter().map(|s| s.as_ref().map_or(0.0, |s| s.derivative(*time))).collect();
            system.assemble(*time, &mut q)?;
            motion.q.push(q);
            motion.u.push(u);
        }
        Ok(motion)
    }
}
