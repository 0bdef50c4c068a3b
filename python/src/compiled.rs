//! A compiled model with the paths of all its muscles.

use std::path::Path;

use carpus::multibody::Cache;
use carpus::osim::OsimFile;
use carpus::osim::spec::{CoordinateIndex, MuscleIndex};
use carpus::paths::{Path as MusclePath, PathGeometry};
use carpus::session::diagnostic::{Diagnostic, Failure};
use carpus::session::model::{self, LoadedModel, Needs};
use rayon::prelude::*;

use crate::job::Watch;

/// A compiled model with the paths of all its muscles.
pub struct Compiled {
    /// The model.
    pub loaded: LoadedModel,
    /// What was said on the way.
    pub warnings: Vec<Diagnostic>,
    /// Paths of all muscles.
    pub paths: Vec<MusclePath>,
}

impl Compiled {
    /// Compiles a model; components that are not supported are warnings where they matter, as a program decides what it
    /// computes.
    ///
    /// # Errors
    /// A model that cannot be computed with.
    pub fn of(path: &Path, file: &OsimFile) -> Result<Compiled, Failure> {
        let mut warnings = Vec::new();
        let loaded = model::compiled(path, file.clone(), Needs::Motion, true, &mut warnings)?;
        let all: Vec<MuscleIndex> = (0..file.spec.muscles.len()).map(MuscleIndex).collect();
        let paths = loaded.muscle_paths(&all)?.into_iter().map(|(path, _)| path).collect();
        Ok(Compiled { loaded, warnings, paths })
    }

    /// Number of coordinates.
    pub fn n_coordinates(&self) -> usize {
        self.loaded.model.n_coordinates()
    }
}

/// Buffers of a thread.
pub struct Buffers {
    q: Vec<f64>,
    /// Poses.
    pub cache: Cache,
    geometries: Vec<PathGeometry>,
}

impl Compiled {
    /// Buffers.
    pub fn buffers(&self) -> Buffers {
        Buffers {
            q: Vec::with_capacity(self.n_coordinates()),
            cache: self.loaded.model.new_cache(),
            geometries: self.paths.iter().map(MusclePath::new_geometry).collect(),
        }
    }

    /// Puts the model into a posture; coordinates that follow others are set.
    pub fn pose(&self, q: &[f64], buffers: &mut Buffers) {
        buffers.q.clear();
        buffers.q.extend_from_slice(q);
        self.loaded.model.satisfy_couplers(&mut buffers.q);
        self.loaded.model.update_positions(&buffers.q, &mut buffers.cache);
    }

    /// Lengths of all paths in many postures, and moment arms about a coordinate.
    ///
    /// # Errors
    /// It is to stop.
    pub fn paths(&self, q: &[f64], about: Option<CoordinateIndex>, watch: &Watch) -> Result<[Vec<f64>; 2], Failure> {
        let (n_q, n_m) = (self.n_coordinates(), self.paths.len());
        let n = q.len() / n_q.max(1);
        let mut lengths = vec![0.0; n * n_m];
        let mut arms = vec![0.0; if about.is_some() { n * n_m } else { 0 }];
        if n_m == 0 {
            return Ok([lengths, arms]);
        }
        let one = |buffers: &mut Buffers,
                   (k, lengths): (usize, &mut [f64]),
                   arms: Option<&mut [f64]>|
         -> Result<(), Failure> {
            watch.go_on()?;
            self.pose(&q[k * n_q..(k + 1) * n_q], buffers);
            let Buffers { q, cache, geometries } = buffers;
            for ((path, geometry), length) in self.paths.iter().zip(geometries.iter_mut()).zip(lengths) {
                path.update(q, cache, geometry);
                *length = geometry.length();
            }
            let (Some(about), Some(arms)) = (about, arms) else { return Ok(()) };
            self.loaded.model.update_unit_motion(q, about, cache);
            for ((path, geometry), arm) in self.paths.iter().zip(geometries.iter()).zip(arms) {
                *arm = path.moment_arm(q, cache, geometry);
            }
            Ok(())
        };
        let rows = lengths.par_chunks_mut(n_m).enumerate();
        if about.is_some() {
            let rows = rows.zip(arms.par_chunks_mut(n_m));
            rows.try_for_each_init(|| self.buffers(), |buffers, (row, arms)| one(buffers, row, Some(arms)))?;
        } else {
            rows.try_for_each_init(|| self.buffers(), |buffers, row| one(buffers, row, None))?;
        }
        Ok([lengths, arms])
    }
}
