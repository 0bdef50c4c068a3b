//! Variances of the noise, by component, and its correlations in time.

use std::ops::Range;

use crate::kernel::{Family, Kernel};
use carpus_study::study::Direction;

/// Number of variance components.
pub const COMPONENTS: usize = 7;
/// Those of slow disturbances, by the direction of effort.
pub(super) const SLOW: Range<usize> = 1..4;
/// Those of the EMG.
pub(super) const EMG: Range<usize> = 4..COMPONENTS;

/// Variances: white [(N·m)²], slow in flexion, in extension and without direction [(N·m)²], relative EMG envelope,
/// relative EMG gain per trial, additive EMG.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseLevels(pub [f64; COMPONENTS]);

impl Default for NoiseLevels {
    /// Usual laboratory noise: 0.05 N·m white, 0.07 N·m slow, EMG 10 % envelope, 5 % gain, 0.002 additive.
    fn default() -> Self {
        NoiseLevels([0.05, 0.07, 0.07, 0.07, 0.10, 0.05, 0.002].map(|sd: f64| sd * sd))
    }
}

impl NoiseLevels {
    /// Usual noise at a joint so many times as strong as a wrist.
    pub fn usual(strength: f64) -> NoiseLevels {
        let mut levels = NoiseLevels::default();
        levels.0[..EMG.start].iter_mut().for_each(|v| *v *= strength * strength);
        levels
    }
}

/// Which component is that of slow disturbances in trials of a direction.
pub(super) fn slow_component(direction: Direction) -> usize {
    SLOW.start
        + match direction {
            Direction::Flexion => 0,
            Direction::Extension => 1,
            Direction::None => 2,
        }
}

impl NoiseLevels {
    /// Of slow disturbances in trials of a direction [(N·m)²].
    pub fn slow(&self, direction: Direction) -> f64 {
        self.0[slow_component(direction)]
    }

    /// Of white noise [(N·m)²].
    pub fn white(&self) -> f64 {
        self.0[0]
    }

    /// Of the EMG: relative envelope, relative gain per trial, additive.
    pub fn of_emg(&self) -> [f64; 3] {
        let [.., envelope, gain, floor] = self.0;
        [envelope, gain, floor]
    }

    /// Geometric means of both.
    pub fn between(&self, other: &NoiseLevels) -> NoiseLevels {
        let mut out = *self;
        out.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a = (*a * b).sqrt());
        out
    }
}

/// How noise goes with itself in time.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Kernels {
    /// Envelope of the EMG.
    pub emg: Kernel,
    /// Slow disturbances of the moment.
    pub moment: Kernel,
}

impl Default for Kernels {
    fn default() -> Self {
        Kernels {
            emg: Kernel { family: Family::Matern32, length: 0.12 },
            moment: Kernel { family: Family::Matern32, length: 0.36 },
        }
    }
}
