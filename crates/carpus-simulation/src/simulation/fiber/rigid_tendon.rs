//! A muscle with a rigid tendon: its fibre follows from the path alone, nothing is integrated.

use super::equation::{Fiber, PARAMETERS};

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
    /// Fibre state and tendon force for a tendon at its slack length.
    ///
    /// A fibre shorter than the model allows, or a tendon that buckles, carries no force; nor does a fibre push.
    ///
    /// - `activation`; `length` [m], `speed` [m/s]: of the path
    ///
    /// # References
    /// OpenSim `Millard2012EquilibriumMuscle` with `ignore_tendon_compliance`.
    pub(crate) fn rigid_tendon(&self, activation: f64, length: f64, speed: f64) -> RigidSample {
        let c = &*self.curves;
        let y = (length - self.slack) / self.optimal;
        let shortest = self.along_tendon(self.shortest);
        let slack = RigidSample { x: self.shortest, u: 0.0, force: 0.0, by_parameters: [0.0; PARAMETERS] };
        if y < shortest {
            return slack;
        }
        let x = (y * y + self.sine * self.sine).sqrt();
        let cosine = y / x;
        let u = speed * cosine / (self.optimal * c.max_velocity);
        if x <= self.shortest && u <= 0.0 {
            return slack;
        }
        let (active, active_slope) = c.active_at(x, activation);
        let (passive, passive_slope) = c.passive.value_and_slope(x);
        let (velocity, velocity_slope) = c.force_velocity.value_and_slope(u);
        let fiber = activation * active * velocity + passive + c.damping * u;
        if fiber < 0.0 {
            return RigidSample { x, u, force: 0.0, by_parameters: [0.0; PARAMETERS] };
        }
        let by_x = activation * active_slope * velocity + passive_slope;
        let by_u = activation * active * velocity_slope + c.damping;
        // y depends on the two lengths, x and cos φ on y and s, u on cos φ and the optimal length.
        let y_by = [-y / self.optimal, -1.0 / self.optimal, 0.0];
        let mut by_parameters = [0.0; PARAMETERS];
        for p in 0..PARAMETERS {
            let sine_by = if p == 2 { 1.0 } else { 0.0 };
            let x_by = cosine * y_by[p] + self.sine / x * sine_by;
            let cosine_by = (y_by[p] - cosine * x_by) / x;
            let mut u_by = u / cosine * cosine_by;
            if p == 0 {
                u_by -= u / self.optimal;
            }
            by_parameters[p] = (by_x * x_by + by_u * u_by) * cosine + fiber * cosine_by;
        }
        RigidSample { x, u, force: fiber * cosine, by_parameters }
    }
}
