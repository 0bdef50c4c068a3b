//! What answers about effects are judged by, wherever they are shown.

/// An effect that is missing with a smaller probability is ruled out.
pub const RULED_OUT: f64 = 0.01;
/// z from which two explanations count as told apart.
pub const SEPARABLE_Z: f64 = 4.5;

/// Whether a 95 % interval says anything: one of a ratio's logarithm may span a thousandfold and more.
pub fn is_determined(ci95: [f64; 2]) -> bool {
    let [low, high] = ci95;
    !(low > 0.0 && high > 1e3 * low)
}
