//! How fast activation follows excitation, and steps of it. The dynamics are those of
//! `MuscleFirstOrderActivationDynamicModel`:
//!
//! ```text
//! ȧ = (e − â) / τ(â, e),   â = clamp(a, a_min, 1)
//! τ = τ_act (0.5 + 1.5 â)      if e > â
//!     τ_deact / (0.5 + 1.5 â)  otherwise
//! ```
//!
//! Other classes of muscles have dynamics of their own ([`ActivationLaw`]).
//!
//! As in OpenSim, the excitation itself is not limited: while e < a_min the state a drifts below a_min, while muscles
//! see â.

/// Parameters of first-order activation dynamics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ActivationDynamics {
    /// Activation time constant τ_act [s].
    pub(crate) activation_time_constant: f64,
    /// Deactivation time constant τ_deact [s].
    pub(crate) deactivation_time_constant: f64,
    /// Lower bound a_min of activation.
    pub(crate) minimum_activation: f64,
    /// How activation follows the excitation.
    pub(crate) law: ActivationLaw,
}

/// How activation follows the excitation, by the class of the muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ActivationLaw {
    /// Millard's and Thelen's muscles; see the head of this file.
    FirstOrder,
    /// De Groote's and Fregly's: both time constants, weighted by a smooth step.
    ///
    /// ```text
    /// ȧ = (e − a) [(½ + f)/(τ_act s) + (½ − f) s/τ_deact],   f = ½ tanh(b (e − a)),   s = ½ + 3a/2
    /// ```
    /// # References
    /// De Groote et al. (2016), equation 1, doi:10.1007/s10439-016-1591-9; OpenSim `DeGrooteFregly2016Muscle`.
    Smooth {
        /// b, `activation_dynamics_smoothing`.
        steepness: f64,
    },
    /// Schutte's and Delp's: rates that do not depend on activation, τ_act at full excitation, τ_deact at none.
    ///
    /// ```text
    /// ȧ = (e − a) [1/τ_deact + (1/τ_act − 1/τ_deact) e]  if e > a,   (e − a)/τ_deact  otherwise
    /// ```
    /// # References
    /// OpenSim `Schutte1993Muscle_Deprecated`, `Delp1990Muscle_Deprecated`: 1/τ_deact = `activation2`/`time_scale`, 1/τ_act = (`activation1` +
    /// `activation2`)/`time_scale`.
    Linear,
    /// Activation equals excitation (`ignore_activation_dynamics`, `RigidTendonMuscle`).
    Excitation,
}

/// The side of the kink at e = â that a step is on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Branch {
    Activating,
    Deactivating,
}

impl ActivationDynamics {
    pub(super) fn clamp(&self, a: f64) -> f64 {
        a.max(self.minimum_activation).min(1.0)
    }

    /// Whether activation is the excitation.
    pub(crate) fn is_ignored(&self) -> bool {
        self.law == ActivationLaw::Excitation
    }

    /// [∂ȧ/∂a, ∂ȧ/∂e, ȧ] of the laws that are not [`ActivationLaw::FirstOrder`], within the bounds.
    ///
    /// - `gap`: excitation less activation; `a`: activation as muscles see it
    #[inline(never)]
    pub(super) fn other_rate(&self, gap: f64, a: f64, branch: Branch) -> [f64; 3] {
        let (activating, deactivating) = (1.0 / self.activation_time_constant, 1.0 / self.deactivation_time_constant);
        // How fast a gap closes, and that by activation and by excitation.
        let (speed, by_a, by_e) = match self.law {
            ActivationLaw::Smooth { steepness } => {
                let tanh = (steepness * gap).tanh();
                let (f, f_by_gap) = (0.5 * tanh, 0.5 * steepness * (1.0 - tanh * tanh));
                let s = 0.5 + 1.5 * a;
                let by_gap = f_by_gap * (activating / s - s * deactivating);
                let by_s = -(0.5 + f) * activating / (s * s) + (0.5 - f) * deactivating;
                ((0.5 + f) * activating / s + (0.5 - f) * s * deactivating, 1.5 * by_s - by_gap, by_gap)
            }
            ActivationLaw::Linear if branch == Branch::Activating => {
                let per_excitation = activating - deactivating;
                (deactivating + per_excitation * (gap + a), 0.0, per_excitation)
            }
            ActivationLaw::Linear => (deactivating, 0.0, 0.0),
            ActivationLaw::FirstOrder | ActivationLaw::Excitation => (0.0, 0.0, 0.0),
        };
        [gap * by_a - speed, gap * by_e + speed, gap * speed]
    }

    #[inline(always)]
    pub(super) fn rate(&self, a: f64, e: f64, branch: Branch) -> f64 {
        match self.law {
            ActivationLaw::FirstOrder => self.first_order_rate(a, e, branch),
            _ => {
                let a = self.clamp(a);
                self.other_rate(e - a, a, branch)[2]
            }
        }
    }

    #[inline(always)]
    pub(super) fn first_order_rate(&self, a: f64, e: f64, branch: Branch) -> f64 {
        let a = self.clamp(a);
        match branch {
            Branch::Activating => (e - a) / (self.activation_time_constant * (0.5 + 1.5 * a)),
            Branch::Deactivating => (e - a) * (0.5 + 1.5 * a) / self.deactivation_time_constant,
        }
    }

    /// [−∂ȧ/∂a, ∂ȧ/∂e] [1/s] of the activation that muscles see.
    ///
    /// - `a`: as muscles see it
    pub(crate) fn linearized(&self, a: f64, e: f64) -> [f64; 2] {
        let branch = if e > a { Branch::Activating } else { Branch::Deactivating };
        let (by_e, by_a) = self.derivatives(a, e, branch);
        // Below the minimum or above 1 it does not matter by how much; but that a state which an excitation above 1 has
        // driven beyond 1 comes back late is not in here.
        let asleep = a <= self.minimum_activation && e <= self.minimum_activation;
        let full = a >= 1.0 && e >= 1.0;
        [-by_a, if asleep || full { 0.0 } else { by_e }]
    }

    /// ∂ȧ/∂e and ∂ȧ/∂a within the bounds.
    pub(super) fn derivatives(&self, a: f64, e: f64, branch: Branch) -> (f64, f64) {
        let clamped = self.clamp(a);
        let [by_a, by_e, _] = self.derivatives_of_rate(e - clamped, clamped, true, branch);
        (by_e, by_a)
    }

    /// ∂ȧ/∂a, ∂ȧ/∂e and ȧ within the bounds.
    ///
    /// - `gap`: excitation less activation; `clamped`: activation as muscles see it; `moves`: whether it is within its
    ///   bounds
    #[inline(always)]
    pub(super) fn derivatives_of_rate(&self, gap: f64, clamped: f64, moves: bool, branch: Branch) -> [f64; 3] {
        if self.law != ActivationLaw::FirstOrder {
            let [by_a, by_e, rate] = self.other_rate(gap, clamped, branch);
            return [if moves { by_a } else { 0.0 }, by_e, rate];
        }
        let scale = 0.5 + 1.5 * clamped;
        let (by_e, by_scale) = match branch {
            Branch::Activating => {
                let by_e = 1.0 / (self.activation_time_constant * scale);
                (by_e, -gap * (by_e * by_e) * self.activation_time_constant)
            }
            Branch::Deactivating => {
                let per = 1.0 / self.deactivation_time_constant;
                (scale * per, gap * per)
            }
        };
        [if moves { 1.5 * by_scale - by_e } else { 0.0 }, by_e, gap * by_e]
    }

    /// ä for an excitation that changes at `slope`, where ȧ is `rate`.
    pub(super) fn acceleration(&self, a: f64, e: f64, slope: f64, rate: f64, branch: Branch) -> f64 {
        let (by_e, by_a) = self.derivatives(a, e, branch);
        let by_a = if a < self.minimum_activation || a > 1.0 { 0.0 } else { by_a };
        by_e * slope + by_a * rate
    }

    /// A Dormand–Prince step of order 5 within one branch, where ȧ is `k1`; returns the new activation, the error
    /// estimate and ȧ at the end.
    pub(super) fn step(&self, a: f64, e: f64, slope: f64, h: f64, k1: f64, branch: Branch) -> (f64, f64, f64) {
        let ([a], [error], [k7]) = steps([self], [a], [e], [slope], h, [k1], branch);
        (a, error, k7)
    }
}

/// [`ActivationDynamics::step`] for several activations at once: a step is a chain of divisions that wait for each
/// other, so that two side by side take hardly longer than one.
#[inline(always)]
pub(super) fn steps<const N: usize>(
    dynamics: [&ActivationDynamics; N],
    a: [f64; N],
    e: [f64; N],
    slope: [f64; N],
    h: f64,
    k1: [f64; N],
    branch: Branch,
) -> ([f64; N], [f64; N], [f64; N]) {
    if dynamics.iter().all(|d| d.law == ActivationLaw::FirstOrder) {
        let rate = |i: usize, a: f64, e: f64| dynamics[i].first_order_rate(a, e, branch);
        return steps_with(rate, a, e, slope, h, k1);
    }
    steps_with(|i, a, e| dynamics[i].rate(a, e, branch), a, e, slope, h, k1)
}

/// - `rate`: ȧ of one of them for an activation and an excitation
#[inline(always)]
fn steps_with<const N: usize>(
    rate: impl Fn(usize, f64, f64) -> f64,
    a: [f64; N],
    e: [f64; N],
    slope: [f64; N],
    h: f64,
    k1: [f64; N],
) -> ([f64; N], [f64; N], [f64; N]) {
    let f = |da: [f64; N], c: f64| each(|i| rate(i, a[i] + h * da[i], e[i] + slope[i] * c * h));
    let k2 = f(each(|i| k1[i] / 5.0), 0.2);
    let k3 = f(each(|i| 3.0 / 40.0 * k1[i] + 9.0 / 40.0 * k2[i]), 0.3);
    let k4 = f(each(|i| 44.0 / 45.0 * k1[i] - 56.0 / 15.0 * k2[i] + 32.0 / 9.0 * k3[i]), 0.8);
    let by_k4 = |i: usize| {
        19372.0 / 6561.0 * k1[i] - 25360.0 / 2187.0 * k2[i] + 64448.0 / 6561.0 * k3[i] - 212.0 / 729.0 * k4[i]
    };
    let k5 = f(each(by_k4), 8.0 / 9.0);
    let by_k5 = |i: usize| {
        9017.0 / 3168.0 * k1[i] - 355.0 / 33.0 * k2[i] + 46732.0 / 5247.0 * k3[i] + 49.0 / 176.0 * k4[i]
            - 5103.0 / 18656.0 * k5[i]
    };
    let k6 = f(each(by_k5), 1.0);
    let increment = each(|i| {
        35.0 / 384.0 * k1[i] + 500.0 / 1113.0 * k3[i] + 125.0 / 192.0 * k4[i] - 2187.0 / 6784.0 * k5[i]
            + 11.0 / 84.0 * k6[i]
    });
    let k7 = f(increment, 1.0);
    let error = |i: usize| {
        71.0 / 57600.0 * k1[i] - 71.0 / 16695.0 * k3[i] + 71.0 / 1920.0 * k4[i] - 17253.0 / 339200.0 * k5[i]
            + 22.0 / 525.0 * k6[i]
            - k7[i] / 40.0
    };
    (each(|i| a[i] + h * increment[i]), each(|i| (h * error(i)).abs()), k7)
}

#[inline(always)]
fn each<const N: usize>(of: impl Fn(usize) -> f64) -> [f64; N] {
    std::array::from_fn(of)
}
