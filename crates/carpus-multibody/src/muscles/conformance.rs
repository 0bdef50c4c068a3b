//! What every class of muscles has to keep, whatever its curves, on the muscles of `fixtures/muscle_laws`.

use std::path::Path;

use super::{MuscleLaw, MuscleModel, MuscleState};
use carpus_osim::osim::OsimFile;

struct Case {
    name: String,
    model: MuscleModel,
    optimal: f64,
    slack: f64,
    sine: f64,
}

impl Case {
    fn all() -> Vec<Case> {
        let classes = [
            "Millard2012EquilibriumMuscle",
            "Thelen2003Muscle",
            "DeGrooteFregly2016Muscle",
            "DeGrooteFregly2016Muscle_rigid",
            "RigidTendonMuscle",
            "Schutte1993Muscle_Deprecated",
            "Delp1990Muscle_Deprecated",
        ];
        classes.iter().flat_map(|class| ["FCR", "ECU", "ECRL"].map(|muscle| Case::of(class, muscle))).collect()
    }

    fn of(class: &str, muscle: &str) -> Case {
        let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let file = match class {
            "Millard2012EquilibriumMuscle" => root.join("models/wrist.osim"),
            other => root.join(format!("fixtures/muscle_laws/{other}.osim")),
        };
        let spec = OsimFile::read(file).unwrap().spec;
        let spec = spec.muscles.iter().find(|m| m.name == muscle).unwrap();
        Case {
            name: format!("{class} {muscle}"),
            model: MuscleModel::from_spec(spec).unwrap(),
            optimal: spec.optimal_fiber_length,
            slack: spec.tendon_slack_length,
            sine: spec.pennation_angle_at_optimal.sin(),
        }
    }

    /// Path length for a normalized fibre length and a tendon stretched by a share of its slack length [m].
    fn path(&self, x: f64, strain: f64) -> f64 {
        let strain = if self.model.ignore_tendon_compliance() { 0.0 } else { strain };
        self.optimal * (x * x - self.sine * self.sine).sqrt() + self.slack * (1.0 + strain)
    }

    /// The class's own state at a normalized fibre length.
    fn state(&self, x: f64, activation: f64, strain: f64) -> MuscleState {
        let equilibrium_state = match &self.model {
            MuscleModel::DeGrooteFregly2016(m) => m.as_ref().tendon(1.0 + strain).0,
            _ => x * self.optimal,
        };
        MuscleState { activation, equilibrium_state, fiber_velocity: 0.13 * self.optimal }
    }
}

/// Normalized fibre length, activation, strain of the tendon, speed of the path [m/s].
const STATES: [(f64, f64, f64, f64); 6] = [
    (0.9, 0.5, 0.02, 0.0),
    (1.2, 0.05, 0.03, 0.02),
    (0.75, 0.9, 0.01, -0.03),
    (1.4, 0.3, 0.035, 0.05),
    (1.05, 0.2, 0.004, -0.01),
    (1.0, 1.0, 0.025, 0.01),
];

fn assert_near(what: &str, name: &str, found: f64, expected: f64, scale: f64) {
    assert!(
        (found - expected).abs() < 1e-9 * scale.max(expected.abs()),
        "{name}: {what} is {found}, expected {expected}"
    );
}

#[test]
fn verif_quantities_of_a_muscle_agree_with_each_other() {
    for case in Case::all() {
        let (name, force) = (&case.name, case.model.max_isometric_force());
        let mut checked = 0;
        for (x, activation, strain, speed) in STATES {
            let (state, path) = (case.state(x, activation, strain), case.path(x, strain));
            let at = case.model.dynamics(state, path, speed);
            // At which no fibre moves: a state far from any balance.
            if at.normalized_fiber_velocity.abs() > 10.0 {
                continue;
            }
            checked += 1;
            let near = |what, found, expected, scale| assert_near(what, name, found, expected, scale);
            let (optimal, cos) = (case.optimal, at.cos_pennation_angle);
            near("normalized length", at.normalized_fiber_length, x, 1.0);
            near("fibre length", at.fiber_length, x * optimal, optimal);
            near("cosine", cos, at.pennation_angle.cos(), 1.0);
            near("height", at.fiber_length * at.pennation_angle.sin(), optimal * case.sine, optimal);
            near("length along the tendon", at.fiber_length_along_tendon, at.fiber_length * cos, optimal);
            near("tendon length", at.tendon_length, path - at.fiber_length * cos, case.slack);
            near("strain", at.tendon_strain, at.tendon_length / case.slack - 1.0, 1.0);
            near("fibre force", at.fiber_force, at.active_fiber_force + at.passive_fiber_force, force);
            let parts = at.passive_fiber_elastic_force + at.passive_fiber_damping_force;
            near("passive force", at.passive_fiber_force, parts, force);
            near("elastic force", at.passive_fiber_elastic_force, force * at.passive_force_multiplier, force);
            near("force along the tendon", at.fiber_force_along_tendon, at.fiber_force * cos, force);
            near("active along the tendon", at.active_fiber_force_along_tendon, at.active_fiber_force * cos, force);
            near("passive along the tendon", at.passive_fiber_force_along_tendon, at.passive_fiber_force * cos, force);
            // As in OpenSim, this class's damping does not act on a fibre in series with a spring, and is reported.
            let is_reported_only =
                matches!(case.model, MuscleModel::DeGrooteFregly2016(_)) && !case.model.ignore_tendon_compliance();
            let only_reported = if is_reported_only { at.passive_fiber_damping_force } else { 0.0 };
            near("tendon force", at.tendon_force, (at.fiber_force - only_reported) * cos, force);
            let product = at.activation * at.active_force_length_multiplier * at.force_velocity_multiplier;
            near("active force", at.active_fiber_force, force * product, force);
            let fastest = optimal * case.model.max_contraction_velocity();
            near("normalized velocity", at.normalized_fiber_velocity, at.fiber_velocity / fastest, 1.0);
            // As in OpenSim, a RigidTendonMuscle's fibre is as fast as its path.
            if !matches!(case.model, MuscleModel::RigidTendon(_)) {
                near("velocity along the tendon", at.fiber_velocity_along_tendon, at.fiber_velocity / cos, optimal);
                let turns = -at.fiber_velocity / at.fiber_length * at.pennation_angle.tan();
                near("rate of pennation", at.pennation_angular_velocity, turns, 1.0);
                near("tendon velocity", at.tendon_velocity, speed - at.fiber_velocity_along_tendon, 1.0);
            }
            let rates = case.model.rates(state, path, speed);
            near("tendon force of the rates", rates.tendon_force, at.tendon_force, force);
            if case.model.equilibrium_state_name() == "fiber_length" && !case.model.ignore_tendon_compliance() {
                near("rate of the fibre length", rates.equilibrium_state, at.fiber_velocity, optimal);
            }
        }
        assert!(checked >= 2, "{name}: {checked} states checked");
    }
}

#[test]
fn verif_a_muscle_in_equilibrium_rests() {
    for case in Case::all().into_iter().filter(|case| !case.model.ignore_tendon_compliance()) {
        for (x, activation, strain, _) in STATES {
            let path = case.path(x, strain);
            let equilibrium_state = case.model.equilibrium(path, 0.0, activation).unwrap();
            let state = MuscleState { activation, equilibrium_state, fiber_velocity: 0.0 };
            let rates = case.model.rates(state, path, 0.0);
            // OpenSim ends the search of the deprecated classes within 0.01 N.
            let tolerance = if matches!(case.model, MuscleModel::Deprecated(_)) { 5e-3 } else { 1e-5 };
            let [scale, rate] = match case.model.has_velocity_state() {
                // The force on the mass.
                true => [1e6 * case.optimal, rates.fiber_velocity],
                false => [case.model.equilibrium_state_scale(), rates.equilibrium_state],
            };
            assert!((rate / scale).abs() < tolerance, "{} {x}: {rate} of {scale}", case.name);
        }
    }
}

#[test]
fn verif_activation_follows_excitation() {
    for case in Case::all().into_iter().filter(|case| !case.model.ignore_activation_dynamics()) {
        for (activation, excitation) in [(0.2, 0.9), (0.9, 0.2), (0.5, 0.55), (0.5, 0.45), (0.05, 1.0)] {
            let rate = case.model.activation_rate(activation, excitation);
            assert!(rate * (excitation - activation) > 0.0, "{}: {rate}", case.name);
            // 10 to 100 ms.
            let constant = (excitation - activation) / rate;
            assert!((0.005..0.2).contains(&constant), "{}: {constant} s", case.name);
            let h = 1e-6;
            let of = |a: f64| case.model.activation_rate(a, excitation);
            let slope = (of(activation + h) - of(activation - h)) / (2.0 * h);
            let found = case.model.activation_rate_slope(activation, excitation);
            assert!((slope - found).abs() < 1e-5 * slope.abs(), "{}: {slope} {found}", case.name);
        }
        assert!(case.model.activation_rate(0.4, 0.4).abs() < 1e-12, "{}", case.name);
    }
}

#[test]
fn verif_derivatives_of_rates_match_differences() {
    for case in Case::all().into_iter().filter(|case| !case.model.ignore_tendon_compliance()) {
        for (x, activation, strain, speed) in STATES {
            // Below 1, at which classes clamp it.
            let (state, path) = (case.state(x, activation.min(0.95), strain), case.path(x, strain));
            let [by_activation, by_length, _] = case.model.linearize(state, path, speed);
            let rates = |activation: f64, length: f64| {
                let equilibrium_state = state.equilibrium_state + length;
                let moved = MuscleState { activation: state.activation + activation, equilibrium_state, ..state };
                case.model.rates(moved, path, speed)
            };
            let scale = case.model.equilibrium_state_scale();
            let (h, l) = (1e-5, 1e-5 * scale);
            for (found, [up, down], step) in
                [(by_activation, [rates(h, 0.0), rates(-h, 0.0)], h), (by_length, [rates(0.0, l), rates(0.0, -l)], l)]
            {
                let pairs = [
                    (found.equilibrium_state, up.equilibrium_state - down.equilibrium_state),
                    (found.tendon_force, up.tendon_force - down.tendon_force),
                    (found.fiber_velocity, up.fiber_velocity - down.fiber_velocity),
                ];
                for (found, difference) in pairs {
                    let expected = difference / (2.0 * step);
                    let close = (found - expected).abs() < 1e-4 * (expected.abs() + 1e-3);
                    assert!(close, "{} {x}: {found} {expected}", case.name);
                }
            }
        }
    }
}

/// OpenSim's simulation of a motion: time, and of every muscle activation, path length, its speed, fibre length, tendon
/// force.
struct Motion {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Motion {
    fn read(class: &str) -> Motion {
        let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let file = match class {
            "Millard2012EquilibriumMuscle" => root.join("fixtures/prescribed_motion/wrist.csv"),
            other => root.join(format!("fixtures/muscle_laws/{other}.csv")),
        };
        let text = std::fs::read_to_string(file).unwrap();
        let mut lines = text.lines();
        let columns = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|line| line.split(',').map(|number| number.parse().unwrap()).collect()).collect();
        Motion { columns, rows }
    }

    fn column(&self, muscle: &str, quantity: &str) -> Vec<f64> {
        let name = format!("{muscle}_{quantity}");
        let at = self.columns.iter().position(|column| *column == name).expect(&name);
        self.rows.iter().map(|row| row[at]).collect()
    }
}

/// At OpenSim's states along a motion: its tendon forces or fibre lengths, and velocities as fast as its fibres move
/// from row to row.
#[test]
fn regress_muscles_along_the_motions_of_opensim() {
    for case in Case::all() {
        let (class, muscle) = case.name.split_once(' ').unwrap();
        let motion = Motion::read(class);
        let of = |quantity| motion.column(muscle, quantity);
        let (activation, path, speed) = (of("activation"), of("length"), of("lengthening_speed"));
        let (fiber, force) = (of("fiber_length"), of("tendon_force"));
        let most = case.model.max_isometric_force();
        let is_force_state = case.model.equilibrium_state_name() != "fiber_length";
        let is_rigid = case.model.ignore_tendon_compliance();
        assert!(activation.len() > 200, "{}", case.name);
        let (mut squares, mut differences, mut count) = (0.0, 0.0, 0);
        for k in 0..activation.len() {
            let equilibrium_state = if is_force_state { force[k] / most } else { fiber[k] };
            let state = MuscleState { activation: activation[k], equilibrium_state, fiber_velocity: 0.0 };
            let at = case.model.dynamics(state, path[k], speed[k]);
            let place = || format!("{} in row {k}", case.name);
            assert_near("fibre length", &place(), 1e-3 * at.fiber_length, 1e-3 * fiber[k], case.optimal);
            let found = case.model.rates(state, path[k], speed[k]).tendon_force;
            assert!((found - force[k]).abs() < 1e-6 * most, "{}: {found} N, expected {} N", place(), force[k]);
            // The first 0.1 s apart: there fibres relax from where the motion starts them.
            let step = motion.rows[1][0] - motion.rows[0][0];
            if motion.rows[k][0] < 0.1 || k + 2 >= fiber.len() || is_rigid || case.model.has_velocity_state() {
                continue;
            }
            let [near, far] = [fiber[k + 1] - fiber[k - 1], fiber[k + 2] - fiber[k - 2]];
            let moved = (8.0 * near - far) / (12.0 * step);
            squares += moved * moved;
            differences += (at.fiber_velocity - moved) * (at.fiber_velocity - moved);
            count += 1;
        }
        if is_rigid || case.model.has_velocity_state() {
            continue;
        }
        assert!(count > 150, "{}: {count} rows", case.name);
        println!("{}: velocities within {:.1e}", case.name, (differences / squares).sqrt());
        // Differences over rows of 10 or 20 ms miss what is faster.
        assert!(differences < 1e-3 * squares, "{}: {differences:e} of {squares:e}", case.name);
    }
}
