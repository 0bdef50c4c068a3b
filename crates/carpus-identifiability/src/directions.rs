//! Which combinations of parameters the data fix and which they leave free.

use nalgebra::{DMatrix, DVector};

use super::parameters::FreeParameter;
use carpus_numerics::numerics::symmetric_eigen;

/// Components of a combination below this share of its largest are left out of its words.
const WORTH_NAMING: f64 = 0.25;

/// A parameter's part in a combination.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// Position of the parameter.
    pub parameter: usize,
    /// Its exponent: the combination is the product of factors raised to exponents, the largest being 1.
    pub exponent: f64,
    /// Its weight in units of prior standard deviations: −1 to 1, squares sum to 1 over all parameters.
    pub weight: f64,
}

/// A product of powers of parameters, independent of the other combinations in prior and data.
#[derive(Clone, Debug, PartialEq)]
pub struct Combination {
    /// The parameters that matter in it, the weightiest first.
    pub components: Vec<Component>,
    /// In words: `FCR strength × FCU strength^-0.8`.
    pub words: String,
    /// Share of the prior variance that the data removed.
    pub share_from_data: f64,
    /// Standard deviation of the combination's logarithm before the data.
    pub prior_log_sd: f64,
    /// And after.
    pub log_sd: f64,
}

/// Eigenvectors of the information, parameters in units of their prior standard deviations: the best known first.
///
/// - `information`: of the data about the logarithms of factors
pub(super) fn combinations(free: &[FreeParameter], information: &DMatrix<f64>) -> Vec<Combination> {
    let n = free.len();
    let sd = DVector::from_fn(n, |i, _| free[i].prior.log_sd);
    let scaled = DMatrix::from_fn(n, n, |i, j| sd[i] * information[(i, j)] * sd[j]);
    let eigen = symmetric_eigen(scaled);
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    order
        .into_iter()
        .map(|k| combination(free, eigen.eigenvectors.column(k).into_owned(), eigen.eigenvalues[k]))
        .collect()
}

fn combination(free: &[FreeParameter], mut weights: DVector<f64>, information: f64) -> Combination {
    let information = information.max(0.0);
    let heaviest = weights.iamax();
    if weights[heaviest] < 0.0 {
        weights = -weights;
    }
    // weights · θ/sd as a sum over θ, scaled so that the heaviest parameter has exponent 1.
    let scale = weights[heaviest] / free[heaviest].prior.log_sd;
    let mut components: Vec<Component> = (0..free.len())
        .filter(|i| weights[*i].abs() >= WORTH_NAMING * weights[heaviest])
        .map(|i| Component { parameter: i, exponent: weights[i] / free[i].prior.log_sd / scale, weight: weights[i] })
        .collect();
    components.sort_by(|a, b| b.weight.abs().total_cmp(&a.weight.abs()));
    let words: Vec<String> = components
        .iter()
        .map(|c| {
            let name = free[c.parameter].words();
            let power = format!("{:.2}", c.exponent);
            if power == "1.00" { name } else { format!("{name}^{}", power.trim_end_matches('0').trim_end_matches('.')) }
        })
        .collect();
    let prior_log_sd = 1.0 / scale;
    Combination {
        components,
        words: words.join(" × "),
        share_from_data: information / (1.0 + information),
        prior_log_sd,
        log_sd: prior_log_sd / (1.0 + information).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::parameters::MuscleProperty;
    use super::*;
    use carpus_study::study::RelativeBounds;

    #[test]
    fn verif_a_known_product_and_a_free_ratio_are_found() {
        let strength = |owner: &str| {
            let bounds = RelativeBounds { lower: 0.5, upper: 2.0 };
            FreeParameter::new(owner, MuscleProperty::MaxIsometricForce, vec![0], 1.0, bounds)
        };
        let free = [strength("FCR"), strength("FCU")];
        // Only the product is seen, with a standard deviation of 1 % of its logarithm.
        let information = DMatrix::from_element(2, 2, 1e4);
        let found = combinations(&free, &information);
        assert_eq!(found[0].words, "FCR strength × FCU strength");
        assert!((found[0].log_sd - 0.01).abs() < 1e-4, "{}", found[0].log_sd);
        assert!(found[0].share_from_data > 0.99);
        assert!(found[1].share_from_data < 1e-9 && found[1].words.contains("^-1"), "{}", found[1].words);
        assert!((found[1].log_sd - 2f64.sqrt() * free[0].prior.log_sd).abs() < 1e-9);
    }
}
