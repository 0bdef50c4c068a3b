//! A muscle with a rigid tendon: its fibre follows from the path alone, nothing is integrated.

use super::equation::{Fiber, PARAMETERS};
use super::law::of_law;
use carpus_multibody::muscles::{Contraction, MuscleLaw, RigidTendonRule};

/// Force of a muscle with a rigid tendon at one instant.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RigidSample {
    /// Normalized fibre length.
    pub(crate) x: f64,
    /// Normalized fibre velocity.
    pub(crate) u: f64,
    /// Tendon force over maximum isometric force.
    pub(crate) force: f64,
    /// Its derivatives by the parameters.
    pub(crate) by_parameters: [f64; PARAMETERS],
}

impl Fiber {
    /// Fibre state and tendon force for a tendon at its slack length, by the rule of the class ([`RigidTendonRule`]).
    ///
    /// - `activation`; `length` [m], `speed` [m/s]: of the path
    ///
    /// # References
    /// OpenSim `Millard2012EquilibriumMuscle` and `DeGrooteFregly2016Muscle` with `ignore_tendon_compliance`,
    /// `RigidTendonMuscle`.
    pub(crate) fn rigid_tendon(&self, activation: f64, length: f64, speed: f64) -> RigidSample {
        let c = &*self.curves;
        let rule = c.law.rigid_tendon_rule();
        let unilateral = rule == RigidTendonRule::Unilateral;
        let mut y = (length - self.slack) / self.optimal;
        let slack = RigidSample { x: self.shortest, u: 0.0, force: 0.0, by_parameters: [0.0; PARAMETERS] };
        if unilateral && y < self.along_tendon(self.shortest) {
            return slack;
        }
        let mut y_by = [-y / self.optimal, -1.0 / self.optimal, 0.0];
        let follows_path = rule == RigidTendonRule::FollowsPath;
        if follows_path && y < 0.0 {
            (y, y_by) = (0.0, [0.0; PARAMETERS]);
        }
        let x = (y * y + self.sine * self.sine).sqrt();
        let cosine = if x > 0.0 { y / x } else { 1.0 };
        let along = if follows_path { 1.0 } else { cosine };
        let u = speed * along / (self.optimal * c.max_velocity);
        if unilateral && x <= self.shortest && u <= 0.0 {
            return slack;
        }
        let [fiber, by_x, by_u] = of_law!(&c.law, law => {
            let (active, passive) = (c.active_at(law, x, activation), law.passive(x));
            law.fiber_force(&Contraction { u, activation, active, passive, ..Contraction::default() })
        });
        if unilateral && fiber < 0.0 {
            return RigidSample { x, u, force: 0.0, by_parameters: [0.0; PARAMETERS] };
        }
        // y depends on the two lengths, x and cos φ on y and s, u on cos φ and the optimal length.
        let mut by_parameters = [0.0; PARAMETERS];
        for p in 0..PARAMETERS {
            let sine_by = if p == 2 { 1.0 } else { 0.0 };
            let (x_by, cosine_by) = if x > 0.0 {
                let x_by = cosine * y_by[p] + self.sine / x * sine_by;
                (x_by, (y_by[p] - cosine * x_by) / x)
            } else {
                (0.0, 0.0)
            };
            let mut u_by = if follows_path { 0.0 } else { speed * cosine_by / (self.optimal * c.max_velocity) };
            if p == 0 {
                u_by -= u / self.optimal;
            }
            by_parameters[p] = (by_x * x_by + by_u * u_by) * cosine + fiber * cosine_by;
        }
        RigidSample { x, u, force: fiber * cosine, by_parameters }
    }
}
