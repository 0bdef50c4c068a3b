//! Derivatives of samples at unequal steps.

/// Derivative of samples: central differences of second order on unequal steps, one-sided of second order at the ends
/// (`numpy.gradient` with `edge_order=2`). Fewer than three samples: zeros.
pub fn derivative(time: &[f64], x: &[f64]) -> Vec<f64> {
    let n = time.len().min(x.len());
    if n < 3 {
        return vec![0.0; n];
    }
    // The parabola through three samples, differentiated at t.
    let slope = |a: usize, t: f64| {
        let (ta, tb, tc) = (time[a], time[a + 1], time[a + 2]);
        x[a] * (2.0 * t - tb - tc) / ((ta - tb) * (ta - tc))
            + x[a + 1] * (2.0 * t - ta - tc) / ((tb - ta) * (tb - tc))
            + x[a + 2] * (2.0 * t - ta - tb) / ((tc - ta) * (tc - tb))
    };
    (0..n).map(|i| slope(i.clamp(1, n - 2) - 1, time[i])).collect()
}

#[cfg(test)]
mod tests {
    use super::derivative;

    #[test]
    fn verif_derivative_of_a_parabola_is_exact() {
        let time = [0.0, 0.1, 0.25, 0.3, 0.5, 0.51];
        let x = time.map(|t: f64| 3.0 * t * t - t + 2.0);
        for (t, found) in time.iter().zip(derivative(&time, &x)) {
            assert!((found - (6.0 * t - 1.0)).abs() < 1e-10, "{found}");
        }
    }
}
