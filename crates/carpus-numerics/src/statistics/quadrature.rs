//! Integrals of smooth functions over an interval, for distributions without closed form.

use std::sync::LazyLock;

/// Nodes of one Gauss–Legendre panel.
const NODES: usize = 20;

/// Nodes and weights on [−1, 1].
static RULE: LazyLock<[(f64, f64); NODES]> = LazyLock::new(|| std::array::from_fn(node));

/// Node `i` as root of the Legendre polynomial, by Newton's method from Tricomi's estimate.
fn node(i: usize) -> (f64, f64) {
    let n = NODES as f64;
    let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5)).cos();
    let mut slope = 1.0;
    for _ in 0..50 {
        let (mut before, mut p) = (1.0, x);
        for k in 2..=NODES {
            let k = k as f64;
            (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
        }
        slope = n * (x * p - before) / (x * x - 1.0);
        let step = p / slope;
        x -= step;
        if step.abs() < 1e-16 {
            break;
        }
    }
    (x, 2.0 / ((1.0 - x * x) * slope * slope))
}

/// Integral of `f` over [a, b] by Gauss–Legendre quadrature on `panels` equal panels.
pub(super) fn integral(f: impl Fn(f64) -> f64, a: f64, b: f64, panels: usize) -> f64 {
    let width = (b - a) / panels as f64;
    (0..panels)
        .map(|panel| {
            let middle = a + (panel as f64 + 0.5) * width;
            RULE.iter().map(|(x, w)| w * f(middle + 0.5 * width * x)).sum::<f64>() * 0.5 * width
        })
        .sum()
}
