//! Where a function that is smooth but for one jump jumps, from its values at nine uniformly spaced points.
//!
//! A polynomial of degree five leaves nothing along the discrete orthogonal polynomials of degrees six to eight, a step
//! between two of the points leaves a direction of its own there.

/// Discrete orthogonal (Gram) polynomials of degrees 6, 7 and 8 on nine points, and the roots of their squared norms.
const GRAM: [([f64; 9], f64); 3] = [
    ([4.0, -17.0, 22.0, 1.0, -20.0, 1.0, 22.0, -17.0, 4.0], 44.497_190_922_573_98),
    ([-1.0, 6.0, -14.0, 14.0, 0.0, -14.0, 14.0, -6.0, 1.0], 29.291_637_031_753_62),
    ([1.0, -8.0, 28.0, -56.0, 70.0, -56.0, 28.0, -8.0, 1.0], 113.446_022_492_767_6),
];
/// What is left beside a step may be this part of what the step leaves.
const PURITY: f64 = 0.05;

/// The jump of a function that is otherwise smooth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SingleJump<const N: usize> {
    /// It lies between this point and the next.
    pub(crate) gap: usize,
    /// By how much each quantity jumps.
    pub(crate) height: [f64; N],
}

impl<const N: usize> SingleJump<N> {
    /// `None` if there is no jump, or more than one, or the function is not smooth enough beside it to tell.
    ///
    /// - `tolerance`: of each quantity; a jump is at least that high in one of them
    pub(crate) fn find(values: &[[f64; N]; 9], tolerance: &[f64; N]) -> Option<SingleJump<N>> {
        let rough: [[f64; 3]; N] = std::array::from_fn(|n| {
            GRAM.map(|(p, norm)| (0..9).map(|k| p[k] * values[k][n]).sum::<f64>() / (norm * tolerance[n]))
        });
        let mut best: Option<(f64, SingleJump<N>)> = None;
        for gap in 0..8 {
            let step = GRAM.map(|(p, norm)| p[gap + 1..].iter().sum::<f64>() / norm);
            let squared: f64 = step.iter().map(|s| s * s).sum();
            let (mut left, mut highest, mut height) = (0.0_f64, 0.0_f64, [0.0; N]);
            for n in 0..N {
                let h = (0..3).map(|d| rough[n][d] * step[d]).sum::<f64>() / squared;
                let squared_left: f64 = (0..3).map(|d| (rough[n][d] - h * step[d]).powi(2)).sum();
                left = left.max(squared_left.sqrt());
                highest = highest.max(h.abs());
                height[n] = h * tolerance[n];
            }
            let impurity = left / (highest * squared.sqrt());
            if highest > 1.0 && impurity < best.map_or(PURITY, |(least, _)| least) {
                best = Some((impurity, SingleJump { gap, height }));
            }
        }
        best.map(|(_, jump)| jump)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampled(f: impl Fn(f64) -> f64) -> [[f64; 1]; 9] {
        std::array::from_fn(|k| [f(k as f64 / 8.0)])
    }

    #[test]
    fn verif_a_jump_is_found_in_every_gap_with_its_height() {
        for gap in 0..8 {
            let at = (gap as f64 + 0.6) / 8.0;
            let f = |x: f64| 0.3 - x + 0.02 * (0.4 * x).sin() + if x > at { 2e-6 } else { 0.0 };
            let jump = SingleJump::find(&sampled(f), &[5e-8]).expect("a jump");
            assert_eq!(jump.gap, gap);
            assert!((jump.height[0] - 2e-6).abs() < 2e-7, "{:e}", jump.height[0]);
        }
    }

    #[test]
    fn verif_smooth_functions_kinks_and_two_jumps_are_none() {
        let smooth = |x: f64| 0.3 - x + 0.02 * (0.4 * x).sin();
        assert!(SingleJump::find(&sampled(smooth), &[5e-8]).is_none());
        assert!(SingleJump::find(&sampled(|x| smooth(x) + 1e-3 * (x - 0.41).max(0.0)), &[5e-8]).is_none());
        let two = |x: f64| smooth(x) + if x > 0.2 { 2e-6 } else { 0.0 } - if x > 0.7 { 3e-6 } else { 0.0 };
        assert!(SingleJump::find(&sampled(two), &[5e-8]).is_none());
    }
}
