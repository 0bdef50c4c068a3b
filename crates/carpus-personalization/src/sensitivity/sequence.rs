//! Sobol' sequences: points that fill a cube more evenly than random ones.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sobol::Sobol;
use sobol::params::JoeKuoD6;

/// Dimensions for which there are direction numbers.
pub const MOST_DIMENSIONS: usize = 1000;

/// The first `n` points of a Sobol' sequence in `m` dimensions, shifted digit by digit by random numbers of the seed,
/// which keeps what makes the sequence even and no point on a face of the cube; `None` beyond [`MOST_DIMENSIONS`].
///
/// Direction numbers of Joe & Kuo; `n` is best a power of two.
///
/// # References
/// Joe & Kuo (2008), doi:10.1137/070709359; Lemieux (2009), Monte Carlo and Quasi-Monte Carlo Sampling, section 6.2.1
pub fn sobol_sequence(n: usize, m: usize, seed: u64) -> Option<Vec<Vec<f64>>> {
    if m > MOST_DIMENSIONS {
        return None;
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let shift: Vec<u32> = (0..m).map(|_| random.random::<u32>()).collect();
    let place = |(digits, shift): (u32, &u32)| (f64::from(digits ^ shift) + 0.5) / 2f64.powi(32);
    Some(unshifted(m).take(n).map(|point| point.into_iter().zip(&shift).map(place).collect()).collect())
}

/// The sequence itself, as whole numbers of 2⁻³².
fn unshifted(m: usize) -> Sobol<u32> {
    Sobol::<u32>::new(m, &JoeKuoD6::standard())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_sequence_is_that_of_scipy() {
        // scipy.stats.qmc.Sobol(d=5, scramble=False).random(8)
        let expected = [
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [0.5, 0.5, 0.5, 0.5, 0.5],
            [0.75, 0.25, 0.25, 0.25, 0.75],
            [0.25, 0.75, 0.75, 0.75, 0.25],
            [0.375, 0.375, 0.625, 0.875, 0.375],
            [0.875, 0.875, 0.125, 0.375, 0.875],
            [0.625, 0.125, 0.875, 0.625, 0.625],
            [0.125, 0.625, 0.375, 0.125, 0.125],
        ];
        for (point, expected) in unshifted(5).zip(expected) {
            let found: Vec<f64> = point.iter().map(|digits| f64::from(*digits) / 2f64.powi(32)).collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn verif_every_slice_holds_one_of_a_power_of_two_points() {
        let points = sobol_sequence(64, 50, 7).unwrap();
        for dimension in 0..50 {
            let mut slices: Vec<usize> = points.iter().map(|p| (p[dimension] * 64.0) as usize).collect();
            slices.sort_unstable();
            assert_eq!(slices, (0..64).collect::<Vec<_>>());
        }
        assert!(points.iter().flatten().all(|x| *x > 0.0 && *x < 1.0));
        assert_eq!(points, sobol_sequence(64, 50, 7).unwrap());
        assert!(sobol_sequence(4, MOST_DIMENSIONS + 1, 1).is_none());
    }
}
