//! What a trial may be at most, and what of it is noise.

/// Fewest samples a trial may have: enough for a cubic spline with something to smooth.
pub const MIN_SAMPLES: usize = 10;
/// Most samples a trial may have (eight minutes at 2 kHz, an hour and more at 250 Hz). Simulated with five muscles a
/// sample takes up to
/// 2.6 kB, so that a trial stays below 3 GB.
pub const MAX_SAMPLES: usize = 1_000_000;
/// Longest median step, and longest mean step, of a trial: ten times the usual time constant of deactivation, 40 ms.
/// From one such sample to the next a
/// contraction comes and goes, so that time is in another unit \[s\].
pub const LONGEST_STEP: f64 = 0.4;
/// Shortest median step of a trial: a megahertz, a hundred times the rate of recorders of EMG \[s\].
pub const SHORTEST_STEP: f64 = 1e-6;
/// Longest trial: no contraction or passive movement on a dynamometer lasts an hour \[s\].
pub const LONGEST_TRIAL: f64 = 3600.0;
/// A step of more than this many median steps is a gap, unless `[checks] max_gap_s` says otherwise.
pub const GAP_IN_MEDIAN_STEPS: f64 = 5.0;
/// EMG up to this is noise about a full contraction: clamped to 1 with a warning. Above it, an error.
pub const EMG_NOISE_ABOVE: f64 = 1.05;
/// EMG down to this is filter ripple about rest: clamped to 0 with a warning. Below it, an error.
pub const EMG_NOISE_BELOW: f64 = -0.02;
/// How far a measured angle may leave the coordinate's range: an encoder's noise, 0.1° \[rad\].
pub const ANGLE_RANGE_TOLERANCE: f64 = 0.1 * std::f64::consts::PI / 180.0;
/// How far a measured angle may leave the coordinate's range with a warning: 12° \[rad\]. Beyond, zero, sign or unit
/// are wrong.
pub const ANGLE_RANGE_WARNING: f64 = 12.0 * std::f64::consts::PI / 180.0;
/// The same of a coordinate that is a translation \[m\].
pub const POSITION_RANGE_WARNING: f64 = 0.02;
