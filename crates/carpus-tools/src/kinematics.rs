//! Analyses of motion: `Kinematics`, `BodyKinematics`, `PointKinematics`, `StatesReporter`.

use nalgebra::Vector3;

use super::analysis::{Analysis, Instant, Options, UNITS};
use super::error::{ToolError, ToolProblem};
use super::setup::Properties;
use super::system::System;
use carpus_numerics::spatial::body_xyz_angles;
use carpus_osim::osim::spec::{BodyIndex, FrameIndex};
use carpus_osim::storage::Storage;

fn storage(name: &str, labels: &[String], description: &str, in_degrees: bool) -> Storage {
    let mut storage = Storage::new(name, labels.to_vec());
    (storage.description, storage.in_degrees) = (description.to_owned(), in_degrees);
    storage
}

fn unknown(analysis: &Properties, property: &str, kind: &'static str, name: &str, names: Vec<&str>) -> ToolError {
    let nearest = carpus_osim::osim::error::nearest(name, names);
    analysis.error_at(property, ToolProblem::Unknown { kind, name: name.to_owned(), nearest })
}

/// Coordinates, speeds and accelerations.
pub struct Kinematics {
    options: Options,
    coordinates: Vec<usize>,
    stores: [Storage; 3],
}

impl Kinematics {
    /// Reads the analysis.
    ///
    /// # Errors
    /// A coordinate that the model does not have.
    pub fn read(analysis: &Properties, system: &System) -> Result<Kinematics, ToolError> {
        let options = Options::read(analysis)?;
        let names = analysis.words("coordinates").unwrap_or_else(|| vec!["all".into()]);
        let all = &system.model.coordinates;
        let mut coordinates = Vec::new();
        for name in &names {
            if name == "all" {
                coordinates = (0..all.len()).collect();
                break;
            }
            let found = system.model.coordinate(name).ok_or_else(|| {
                unknown(analysis, "coordinates", "coordinate", name, all.iter().map(|c| c.name.as_str()).collect())
            })?;
            coordinates.push(found.0);
        }
        let labels: Vec<String> = coordinates.iter().map(|c| all[*c].name.clone()).collect();
        let stores = ["Accelerations", "Speeds", "Coordinates"].map(|n| storage(n, &labels, UNITS, options.in_degrees));
        Ok(Kinematics { options, coordinates, stores })
    }
}

impl Analysis for Kinematics {
    fn options(&self) -> &Options {
        &self.options
    }

    fn needs_accelerations(&self) -> bool {
        true
    }

    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        let state = instant.state;
        let udot = instant.udot.map(|u| u.as_slice()).unwrap_or_default();
        let degrees = self.options.in_degrees;
        let system = instant.system;
        for (store, values) in self.stores.iter_mut().zip([udot, &state.u, &state.q]) {
            let value = |c: &usize| if degrees && system.is_angle(*c) { values[*c].to_degrees() } else { values[*c] };
            store.push(state.time, self.coordinates.iter().map(value).collect());
        }
        Ok(())
    }

    fn results(&self) -> Vec<(String, &Storage)> {
        ["dudt", "u", "q"].into_iter().map(str::to_owned).zip(&self.stores).collect()
    }
}

/// Positions, velocities and accelerations of mass centres.
pub struct BodyKinematics {
    options: Options,
    bodies: Vec<BodyIndex>,
    center_of_mass: bool,
    in_body: bool,
    stores: [Storage; 3],
}

impl BodyKinematics {
    /// Reads the analysis.
    ///
    /// # Errors
    /// A body that the model does not have.
    pub fn read(analysis: &Properties, system: &System) -> Result<BodyKinematics, ToolError> {
        let options = Options::read(analysis)?;
        let in_body = analysis.boolean("express_results_in_body_local_frame", false)?;
        let names = analysis.words("bodies").unwrap_or_else(|| vec!["all".into()]);
        let (mut bodies, mut center_of_mass) = (Vec::new(), false);
        for name in &names {
            match name.as_str() {
                "all" => {
                    bodies = (0..system.spec.bodies.len()).map(BodyIndex).collect();
                    center_of_mass = true;
                    break;
                }
                "center_of_mass" => center_of_mass = true,
                name => bodies.push(system.body(name).ok_or_else(|| {
                    let names = system.model.bodies.iter().map(|b| b.name.as_str()).collect();
                    unknown(analysis, "bodies", "body", name, names)
                })?),
            }
        }
        let label =
            |b: &BodyIndex| ["X", "Y", "Z", "Ox", "Oy", "Oz"].map(|k| format!("{}_{k}", system.model.bodies[b.0].name));
        let mut labels: Vec<String> = bodies.iter().flat_map(label).collect();
        if center_of_mass {
            labels.extend(["X", "Y", "Z"].map(|k| format!("center_of_mass_{k}")));
        }
        // OpenSim writes the description before it reads the setup: of the ground frame.
        let description = format!(
            "\nThis file contains the kinematics (positions and orientations,\nvelocities and angular velocities, or \
             accelerations and angular accelerations)\nof the centers of mass of the body segments in model \
             {}.\n\nBody segment orientations are described using body-fixed X-Y-Z Euler angles.\n\nAngular velocities \
             and accelerations are expressed in the {} frame.\n\nUnits are S.I. units (seconds, meters, Newtons, \
             ...)\nIf the header above contains a line with 'inDegrees', this indicates whether rotational values are \
             in degrees (yes) or radians (no).\n\n",
            system.spec.name,
            if in_body { "body-local" } else { "ground" }
        );
        let stores =
            ["Accelerations", "Velocities", "Positions"].map(|n| storage(n, &labels, &description, options.in_degrees));
        Ok(BodyKinematics { options, bodies, center_of_mass, in_body, stores })
    }
}

impl Analysis for BodyKinematics {
    fn options(&self) -> &Options {
        &self.options
    }

    fn needs_accelerations(&self) -> bool {
        true
    }

    #[allow(non_snake_case)]
    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        let cache = instant.work.dynamics.cache();
        let model = &instant.system.model;
        let angle = if self.options.in_degrees { 180.0 / std::f64::consts::PI } else { 1.0 };
        let center = |b: BodyIndex| {
            let (X, V, A) = (cache.X_GB(b), cache.V_GB(b), cache.A_GB(b));
            let p = X.R * model.bodies[b.0].mass_center;
            [A.acceleration_at(&p, &V.w), V.velocity_at(&p), X.p + p]
        };
        let mut rows: [Vec<f64>; 3] = Default::default();
        for &body in &self.bodies {
            let (X, V, A) = (cache.X_GB(body), cache.V_GB(body), cache.A_GB(body));
            let turned = [A.alpha, V.w, body_xyz_angles(&X.R)];
            for (k, (linear, angular)) in center(body).into_iter().zip(turned).enumerate() {
                let express = |v: Vector3<f64>| if self.in_body && k < 2 { X.R.tr_mul(&v) } else { v };
                rows[k].extend(express(linear).iter());
                rows[k].extend((angle * express(angular)).iter());
            }
        }
        if self.center_of_mass {
            let mass: f64 = model.bodies.iter().map(|b| b.mass).sum();
            let mut sums = [Vector3::zeros(); 3];
            for i in 0..model.bodies.len() {
                let at = center(BodyIndex(i));
                (0..3).for_each(|k| sums[k] += model.bodies[i].mass * at[k]);
            }
            (0..3).for_each(|k| rows[k].extend((sums[k] / mass).iter()));
        }
        for (store, row) in self.stores.iter_mut().zip(rows) {
            store.push(instant.state.time, row);
        }
        Ok(())
    }

    fn results(&self) -> Vec<(String, &Storage)> {
        let suffix = if self.in_body { "bodyLocal" } else { "global" };
        let names = [format!("acc_{suffix}"), format!("vel_{suffix}"), "pos_global".to_owned()];
        names.into_iter().zip(&self.stores).collect()
    }
}

/// Position, velocity and acceleration of a point.
pub struct PointKinematics {
    options: Options,
    body: FrameIndex,
    relative_to: Option<FrameIndex>,
    point: Vector3<f64>,
    point_name: String,
    stores: [Storage; 3],
}

impl PointKinematics {
    /// Reads the analysis.
    ///
    /// # Errors
    /// A body that the model does not have.
    pub fn read(analysis: &Properties, system: &System) -> Result<PointKinematics, ToolError> {
        let options = Options::read(analysis)?;
        let names = || system.model.bodies.iter().map(|b| b.name.as_str()).collect();
        let body_name = analysis.text("body_name").unwrap_or_else(|| "ground".into());
        let relative = analysis.text("relative_to_body_name").unwrap_or_else(|| "none".into());
        let body =
            system.frame(&body_name).ok_or_else(|| unknown(analysis, "body_name", "body", &body_name, names()))?;
        let relative_to = system.frame(&relative);
        let point = analysis.vector("point")?;
        let point_name = analysis.text("point_name").unwrap_or_else(|| "NONAME".into());
        // OpenSim 4.6 loses labels and description of this analysis when it reads it from a file.
        let labels = [0, 1, 2].map(|k| format!("state_{k}"));
        let stores = ["PointAcceleration", "PointVelocity", "PointPosition"]
            .map(|n| storage(n, &labels, "No description.\n", false));
        Ok(PointKinematics { options, body, relative_to, point, point_name, stores })
    }
}

impl Analysis for PointKinematics {
    fn options(&self) -> &Options {
        &self.options
    }

    fn needs_accelerations(&self) -> bool {
        true
    }

    #[allow(non_snake_case)]
    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        let cache = instant.work.dynamics.cache();
        let model = &instant.system.model;
        let base = model.frame(self.body).base;
        let p = cache.X_GF(model, self.body) * self.point;
        let offset = p - cache.X_GB(base).p;
        let (V, A) = (cache.V_GB(base), cache.A_GB(base));
        let found = [A.acceleration_at(&offset, &V.w), V.velocity_at(&offset), p];
        for (k, (store, vector)) in self.stores.iter_mut().zip(found).enumerate() {
            let vector = match self.relative_to.map(|frame| cache.X_GF(model, frame)) {
                Some(X) if k == 2 => X.inverse_transform_point(&vector),
                Some(X) => X.R.tr_mul(&vector),
                None => vector,
            };
            store.push(instant.state.time, vector.iter().copied().collect());
        }
        Ok(())
    }

    fn results(&self) -> Vec<(String, &Storage)> {
        let ends = ["acc", "vel", "pos"].map(|end| format!("{}_{end}", self.point_name));
        ends.into_iter().zip(&self.stores).collect()
    }
}

/// All states.
pub struct StatesReporter {
    options: Options,
    store: Storage,
}

impl StatesReporter {
    /// Reads the analysis.
    ///
    /// # Errors
    /// Values that cannot be used.
    pub fn read(analysis: &Properties, system: &System) -> Result<StatesReporter, ToolError> {
        let options = Options::read(analysis)?;
        let description = format!("\nThis file contains the states of a model during a simulation.\n{UNITS}");
        let store = storage("ModelStates", &system.state_names(), &description, false);
        Ok(StatesReporter { options, store })
    }
}

impl Analysis for StatesReporter {
    fn options(&self) -> &Options {
        &self.options
    }

    fn needs_forces(&self) -> bool {
        false
    }

    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        self.store.push(instant.state.time, instant.system.state_values(instant.state));
        Ok(())
    }

    fn results(&self) -> Vec<(String, &Storage)> {
        vec![("states".to_owned(), &self.store)]
    }
}
