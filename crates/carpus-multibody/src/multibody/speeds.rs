//! OpenSim's generalized speeds and the rates of coordinates: the same, but for ball and free joints, whose first three
//! speeds are the angular velocity of the child frame in the parent frame, expressed in the latter.

use super::cache::Cache;
use super::mobilizer::{Node, Speeds};
use super::model::Model;
use carpus_osim::osim::spec::CoordinateIndex;
use nalgebra::{Matrix3, Vector3};

impl Model {
    /// Whether speeds and rates of coordinates are the same for every joint.
    pub fn speeds_are_rates(&self) -> bool {
        self.nodes.iter().all(|node| node.mobilizer.speeds == Speeds::CoordinateRates)
    }

    /// Whether the speed of a coordinate is its rate.
    pub fn speed_is_rate(&self, coordinate: CoordinateIndex) -> bool {
        let turns =
            |node: &Node| node.mobilizer.rotations.iter().any(|axis| axis.motion.coordinate() == Some(coordinate));
        !self.turning_nodes().any(|(_, node)| turns(node))
    }

    /// Rates of the coordinates for given speeds. Not finite where the three angles of a ball joint lock.
    ///
    /// - `cache`: positions of the coordinates
    pub fn rates_of_speeds(&self, cache: &Cache, u: &[f64], qdot: &mut [f64]) {
        qdot.copy_from_slice(u);
        for (i, node) in self.turning_nodes() {
            let (angles, axes) = angles_of(node, cache, i);
            let w = Vector3::from(angles.map(|c| u[c]));
            let rates = axes.try_inverse().map_or_else(|| Vector3::repeat(f64::NAN), |inverse| inverse * w);
            angles.iter().zip(rates.iter()).for_each(|(c, rate)| qdot[*c] = *rate);
        }
    }

    /// Speeds for given rates of the coordinates.
    ///
    /// - `cache`: positions of the coordinates
    pub fn speeds_of_rates(&self, cache: &Cache, qdot: &[f64], u: &mut [f64]) {
        u.copy_from_slice(qdot);
        for (i, node) in self.turning_nodes() {
            let (angles, axes) = angles_of(node, cache, i);
            let w = axes * Vector3::from(angles.map(|c| qdot[c]));
            angles.iter().zip(w.iter()).for_each(|(c, w)| u[*c] = *w);
        }
    }

    /// The rate of one coordinate as a row over the speeds, and its second rate where u̇ = 0.
    ///
    /// - `factor`: multiplies both
    /// - `add`: receives coordinate and coefficient
    /// - `bias`: receives what the second rate is without u̇, if not 0
    pub fn add_rate_row(
        &self,
        cache: &Cache,
        coordinate: CoordinateIndex,
        factor: f64,
        qdot: &[f64],
        mut add: impl FnMut(usize, f64),
        mut bias: impl FnMut(f64),
    ) {
        let turning = self.turning_nodes().find_map(|(i, node)| {
            let (angles, axes) = angles_of(node, cache, i);
            let k = angles.iter().position(|c| *c == coordinate.0)?;
            Some((angles, axes, k))
        });
        let Some((angles, axes, k)) = turning else { return add(coordinate.0, factor) };
        let inverse = axes.try_inverse().unwrap_or_else(|| Matrix3::repeat(f64::NAN));
        for (j, c) in angles.iter().enumerate() {
            add(*c, factor * inverse[(k, j)]);
        }
        // d/dt (axes · q̇) with constant q̇: later axes are carried by the rotations before them.
        let (mut w, mut carried) = (Vector3::zeros(), Vector3::zeros());
        for (axis, c) in axes.column_iter().zip(&angles) {
            let turn = axis * qdot[*c];
            carried += w.cross(&turn);
            w += turn;
        }
        bias(-factor * (inverse * carried)[k]);
    }

    fn turning_nodes(&self) -> impl Iterator<Item = (usize, &Node)> {
        self.nodes.iter().enumerate().filter(|(_, node)| node.mobilizer.speeds == Speeds::AngularVelocity)
    }
}

/// The three angles of a ball or free joint, and their axes as columns, by components along the directions that the
/// three speeds belong to.
fn angles_of(node: &Node, cache: &Cache, i: usize) -> ([usize; 3], Matrix3<f64>) {
    let rotations = &node.mobilizer.rotations;
    let angle = |k: usize| rotations[k].motion.coordinate().map_or(0, |c| c.0);
    let directions = Matrix3::from_columns(&[rotations[0].direction, rotations[1].direction, rotations[2].direction]);
    ([angle(0), angle(1), angle(2)], directions.tr_mul(&Matrix3::from_columns(&cache.nodes[i].axes_F)))
}
