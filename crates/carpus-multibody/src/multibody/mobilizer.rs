//! What a joint lets its bodies do.

use super::beyond::Beyond;
use super::index::BaseIndex;
use carpus_numerics::spatial::{Transform, rotation_about_axis};
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{CoordinateIndex, JointIndex};
use nalgebra::{Matrix3, Vector3};

/// How far a joint turns about, or moves along, one of its axes.
#[derive(Clone, Debug)]
pub(super) enum AxisMotion {
    /// A constant angle [rad] or displacement [m].
    Fixed(f64),
    /// `slope · q + intercept`.
    Linear { coordinate: CoordinateIndex, slope: f64, intercept: f64 },
    /// A function of one coordinate.
    Function { coordinate: CoordinateIndex, function: Function },
}

impl AxisMotion {
    /// The coordinate itself.
    pub fn identity(coordinate: CoordinateIndex) -> Self {
        AxisMotion::Linear { coordinate, slope: 1.0, intercept: 0.0 }
    }

    pub fn value(&self, q: &[f64]) -> f64 {
        match self {
            AxisMotion::Fixed(value) => *value,
            AxisMotion::Linear { coordinate, slope, intercept } => slope * q[coordinate.0] + intercept,
            AxisMotion::Function { coordinate, function } => function.value(q[coordinate.0]),
        }
    }

    /// Rate of the angle or displacement.
    pub fn rate(&self, q: &[f64], qdot: &[f64]) -> f64 {
        match self {
            AxisMotion::Fixed(_) => 0.0,
            AxisMotion::Linear { coordinate, slope, .. } => slope * qdot[coordinate.0],
            AxisMotion::Function { coordinate, function } => {
                let rate = qdot[coordinate.0];
                // Most coordinates rest when one moves: spare the function.
                if rate == 0.0 { 0.0 } else { function.derivative(q[coordinate.0]) * rate }
            }
        }
    }

    /// Second rate of the angle or displacement.
    pub fn second_rate(&self, q: &[f64], qdot: &[f64], qddot: &[f64]) -> f64 {
        match self {
            AxisMotion::Fixed(_) => 0.0,
            AxisMotion::Linear { coordinate, slope, .. } => slope * qddot[coordinate.0],
            AxisMotion::Function { coordinate, function } => {
                let (q, rate) = (q[coordinate.0], qdot[coordinate.0]);
                function.derivative(q) * qddot[coordinate.0] + function.second_derivative(q) * rate * rate
            }
        }
    }

    pub fn coordinate(&self) -> Option<CoordinateIndex> {
        match self {
            AxisMotion::Fixed(_) => None,
            AxisMotion::Linear { coordinate, .. } | AxisMotion::Function { coordinate, .. } => Some(*coordinate),
        }
    }
}

/// One axis of a mobilizer.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    /// Unit vector: for rotations in the frame that the rotations before it have turned, for translations in F.
    pub direction: Vector3<f64>,
    pub motion: AxisMotion,
    /// Rotation matrix of a fixed angle.
    fixed_rotation: Option<Matrix3<f64>>,
}

impl Axis {
    pub fn new(direction: Vector3<f64>, motion: AxisMotion) -> Self {
        let fixed_rotation = match motion {
            AxisMotion::Fixed(angle) => Some(rotation_about_axis(&direction, angle)),
            _ => None,
        };
        Self { direction, motion, fixed_rotation }
    }

    fn rotation(&self, q: &[f64]) -> Matrix3<f64> {
        self.fixed_rotation.unwrap_or_else(|| rotation_about_axis(&self.direction, self.motion.value(q)))
    }
}

/// What generalized speeds of OpenSim mean for this joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Speeds {
    /// Rates of the coordinates.
    CoordinateRates,
    /// Ball and free joints: the first three are the angular velocity `w_FM` expressed in F.
    AngularVelocity,
}

/// Which rotations turn the axis of which, by rows: `[k][j]` where the rate of rotation j turns axis k.
pub(super) type Turning = [[bool; 3]; 3];

/// What turns the axes of a CustomJoint by Simbody's `FunctionBased` mobilizer, if that is not what does: it takes the
/// joint's first coordinate for the first rotation and the third one for the third, so that where one coordinate turns
/// several axes its accelerations contradict its velocities.
///
/// - `rotations`: those that move, with their positions among the joint's three
/// - `coordinates`: of the joint, in their order
pub(super) fn turning_in_simbody(rotations: &[(usize, &Axis)], coordinates: &[CoordinateIndex]) -> Option<Turning> {
    let of_first = |axis: &Axis| axis.motion.coordinate().is_some_and(|c| coordinates.first() == Some(&c));
    let of_third = |axis: &Axis| axis.motion.coordinate().is_some_and(|c| coordinates.get(2) == Some(&c));
    let turns = |axis: &Axis| axis.motion.coordinate().is_some();
    let (mut turning, mut contradicts) = ([[false; 3]; 3], false);
    for (k, (position, axis)) in rotations.iter().enumerate() {
        for (j, (_, by)) in rotations.iter().enumerate() {
            let counts = match position {
                0 => false,
                1 => of_first(by),
                _ => !of_third(by),
            };
            turning[k][j] = counts && j != k;
            contradicts |= turns(axis) && turns(by) && turning[k][j] != (j < k);
        }
    }
    contradicts.then_some(turning)
}

/// The motion of the joint's child frame M in its parent frame F: up to three body-fixed rotations, and translations
/// along axes fixed in F.
#[derive(Clone, Debug)]
pub(super) struct Mobilizer {
    pub rotations: Vec<Axis>,
    pub translations: Vec<Axis>,
    pub speeds: Speeds,
    /// What the joint does besides.
    pub beyond: Option<Beyond>,
    /// See [`turning_in_simbody`].
    pub in_simbody: Option<Turning>,
    /// Whether accelerations of speeds are those of Simbody even so.
    pub follows_simbody: bool,
}

impl Mobilizer {
    /// Pose `X_FM`; also the rotation axes, expressed in F.
    #[allow(non_snake_case)]
    pub fn pose(&self, q: &[f64], axes_F: &mut [Vector3<f64>; 3]) -> Transform {
        let mut R = Matrix3::identity();
        for (k, axis) in self.rotations.iter().enumerate() {
            if k == 0 {
                axes_F[0] = axis.direction;
                R = axis.rotation(q);
            } else {
                axes_F[k] = R * axis.direction;
                R *= axis.rotation(q);
            }
        }
        let mut p = Vector3::zeros();
        for axis in &self.translations {
            p += axis.direction * axis.motion.value(q);
        }
        match &self.beyond {
            Some(beyond) => beyond.pose(R, self.angles(q), q),
            None => Transform { R, p },
        }
    }

    /// Angles of the three rotations of a joint with something beyond them.
    fn angles(&self, q: &[f64]) -> [f64; 3] {
        std::array::from_fn(|k| self.rotations.get(k).map_or(0.0, |axis| axis.motion.value(q)))
    }

    /// The same for rates or second rates: their coordinates' share of `values`.
    fn of_angles(&self, values: &[f64]) -> [f64; 3] {
        let value = |axis: &Axis| axis.motion.coordinate().map_or(0.0, |c| values[c.0]);
        std::array::from_fn(|k| self.rotations.get(k).map_or(0.0, value))
    }

    /// Velocity (w_FM, v_FM) of M in F, expressed in F, for given rates of the coordinates.
    #[allow(non_snake_case)]
    pub fn velocity(&self, q: &[f64], qdot: &[f64], axes_F: &[Vector3<f64>; 3]) -> (Vector3<f64>, Vector3<f64>) {
        let mut w = Vector3::zeros();
        for (axis, direction) in self.rotations.iter().zip(axes_F) {
            w += direction * axis.motion.rate(q, qdot);
        }
        match &self.beyond {
            Some(beyond) => beyond.velocity(w, axes_F, self.angles(q), self.of_angles(qdot), (q, qdot)),
            None => (w, self.linear_velocity(q, qdot)),
        }
    }

    /// Velocity of M in F, expressed in F, for given generalized speeds as OpenSim defines them.
    #[allow(non_snake_case)]
    pub fn velocity_of_speeds(
        &self,
        q: &[f64],
        speeds: &[f64],
        axes_F: &[Vector3<f64>; 3],
    ) -> (Vector3<f64>, Vector3<f64>) {
        if self.speeds == Speeds::CoordinateRates {
            return self.velocity(q, speeds, axes_F);
        }
        let mut w = Vector3::zeros();
        for axis in &self.rotations {
            w += axis.direction * axis.motion.rate(q, speeds);
        }
        match &self.beyond {
            Some(beyond) => beyond.velocity(w, axes_F, self.angles(q), [0.0; 3], (q, speeds)),
            None => (w, self.linear_velocity(q, speeds)),
        }
    }

    fn linear_velocity(&self, q: &[f64], qdot: &[f64]) -> Vector3<f64> {
        let mut v = Vector3::zeros();
        for axis in &self.translations {
            v += axis.direction * axis.motion.rate(q, qdot);
        }
        v
    }

    /// Acceleration (α_FM, a_FM) of M in F, expressed in F.
    #[allow(non_snake_case)]
    pub fn acceleration(
        &self,
        q: &[f64],
        qdot: &[f64],
        qddot: &[f64],
        axes_F: &[Vector3<f64>; 3],
    ) -> (Vector3<f64>, Vector3<f64>) {
        let (mut w, mut alpha) = (Vector3::zeros(), Vector3::zeros());
        for (axis, direction) in self.rotations.iter().zip(axes_F) {
            let rate = axis.motion.rate(q, qdot);
            alpha += direction * axis.motion.second_rate(q, qdot, qddot) + w.cross(direction) * rate;
            w += direction * rate;
        }
        let mut a = Vector3::zeros();
        for axis in &self.translations {
            a += axis.direction * axis.motion.second_rate(q, qdot, qddot);
        }
        match &self.beyond {
            Some(beyond) => {
                let (rates, second) = (self.of_angles(qdot), self.of_angles(qddot));
                beyond.acceleration((w, alpha), axes_F, self.angles(q), rates, second, (q, qdot, qddot))
            }
            None => (alpha, a),
        }
    }

    /// Acceleration of M in F, expressed in F, for given rates of OpenSim's generalized speeds.
    #[allow(non_snake_case)]
    pub fn acceleration_of_speeds(
        &self,
        q: &[f64],
        speeds: &[f64],
        rates: &[f64],
        axes_F: &[Vector3<f64>; 3],
    ) -> (Vector3<f64>, Vector3<f64>) {
        if self.speeds == Speeds::CoordinateRates {
            let (alpha, a) = self.acceleration(q, speeds, rates, axes_F);
            let contradiction = match &self.in_simbody {
                Some(turning) if self.follows_simbody => self.contradiction(turning, q, speeds, axes_F),
                _ => Vector3::zeros(),
            };
            return (alpha + contradiction, a);
        }
        // Speeds are components in F itself, so that their rates are too.
        let along = |axes: &[Axis]| axes.iter().map(|axis| axis.direction * axis.motion.rate(q, rates)).sum();
        let alpha = along(&self.rotations);
        match &self.beyond {
            Some(beyond) => {
                let w = self.rotations.iter().map(|axis| axis.direction * axis.motion.rate(q, speeds)).sum();
                let none = [0.0; 3];
                beyond.acceleration((w, alpha), axes_F, self.angles(q), none, none, (q, speeds, rates))
            }
            None => (alpha, along(&self.translations)),
        }
    }

    /// What Simbody adds to the angular acceleration, expressed in F.
    #[allow(non_snake_case)]
    fn contradiction(&self, turning: &Turning, q: &[f64], speeds: &[f64], axes_F: &[Vector3<f64>; 3]) -> Vector3<f64> {
        let rate = |k: usize| self.rotations.get(k).map_or(0.0, |axis| axis.motion.rate(q, speeds));
        let rates: [f64; 3] = std::array::from_fn(rate);
        let mut sum = Vector3::zeros();
        for (k, row) in turning.iter().enumerate() {
            for (j, counts) in row.iter().enumerate() {
                let share = f64::from(i8::from(*counts) - i8::from(j < k));
                sum += axes_F[j].cross(&axes_F[k]) * (share * rates[j] * rates[k]);
            }
        }
        sum
    }

    /// The coordinates that move M.
    pub fn coordinates(&self) -> impl Iterator<Item = CoordinateIndex> + '_ {
        let beyond = self.beyond.as_ref().and_then(Beyond::coordinate);
        self.rotations.iter().chain(&self.translations).filter_map(|axis| axis.motion.coordinate()).chain(beyond)
    }
}

/// A joint in the tree: from the inboard body, whose pose is known first, to the outboard body.
#[derive(Clone, Debug)]
#[allow(non_snake_case)]
pub(super) struct Node {
    pub joint: JointIndex,
    pub inboard: BaseIndex,
    pub outboard: BaseIndex,
    /// The joint's child is the inboard body.
    pub reversed: bool,
    /// Joint frame on the inboard body (F, or M if reversed).
    pub X_PF: Transform,
    /// The outboard body in the joint frame on it (M, or F if reversed).
    pub X_MB: Transform,
    pub mobilizer: Mobilizer,
    /// The joint's coordinates that move it, each once.
    pub coordinates: Vec<usize>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A CustomJoint that turns about x, y and z.
    fn joint(coordinates: [usize; 3], count: usize) -> Mobilizer {
        let axis = |k: usize| {
            let motion = AxisMotion::Linear {
                coordinate: CoordinateIndex(coordinates[k]),
                slope: 1.0 + k as f64,
                intercept: 0.0,
            };
            Axis::new(Vector3::ith(k, 1.0), motion)
        };
        let rotations: Vec<Axis> = (0..3).map(axis).collect();
        let numbered: Vec<(usize, &Axis)> = rotations.iter().enumerate().collect();
        let coordinates: Vec<CoordinateIndex> = (0..count).map(CoordinateIndex).collect();
        let in_simbody = turning_in_simbody(&numbered, &coordinates);
        let speeds = Speeds::CoordinateRates;
        Mobilizer { rotations, translations: Vec::new(), speeds, beyond: None, in_simbody, follows_simbody: true }
    }

    #[test]
    fn verif_accelerations_of_simbody_where_one_coordinate_turns_three_axes() {
        let mut joint = joint([0; 3], 1);
        let (q, u) = ([0.0], [0.5]);
        let mut axes = [Vector3::zeros(); 3];
        joint.pose(&q, &mut axes);
        let mut alpha = |follows: bool| {
            joint.follows_simbody = follows;
            joint.acceleration_of_speeds(&q, &u, &[0.0], &axes).0 / 0.25
        };
        // Rates 1, 2, 3 about x, y, z: y is turned by x, z by x and y; in Simbody y by z, too.
        assert!((alpha(false) - Vector3::new(6.0, -3.0, 2.0)).norm() < 1e-14);
        assert!((alpha(true) - Vector3::new(0.0, -3.0, 2.0)).norm() < 1e-14);
    }

    #[test]
    fn verif_joints_whose_coordinates_turn_one_axis_each_are_not_changed() {
        assert!(joint([0, 1, 2], 3).in_simbody.is_none());
        // The second coordinate turns two axes, the third of them last.
        assert!(joint([0, 1, 1], 2).in_simbody.is_none());
        assert!(joint([0, 1, 0], 2).in_simbody.is_some());
    }
}
