//! What a session's trials say of the amplitudes of all effects, everything else left open
//! (`docs/src/theory/cohort.md`, equation (C1)).

use nalgebra::{DMatrix, DVector};

use super::state::{Session, State};
use crate::cohort::{Amplitude, ParticipantEvidence};
use carpus_numerics::numerics::cholesky;

impl Session<'_> {
    /// The likelihood of the amplitudes of all effects that may be named, to second order at a state:
    /// muscles, baselines, shapes and the discrepancy have their priors and are integrated out.
    ///
    /// - `participant`: its name
    /// - returns: in shares of what is plausible of each amplitude
    pub fn amplitude_evidence(&self, state: &State, participant: &str) -> ParticipantEvidence {
        let (model, set) = (&state.model, self.places(&state.point.effects));
        let sizes = self.sizes(state);
        let columns = self.amplitude_columns(model);
        let mut amplitudes = Vec::new();
        let mut tested: Vec<(usize, f64)> = Vec::new();
        for place in self.testable() {
            let effect = self.analysis.candidates[place];
            let description = effect.description();
            let absent = self.analysis.forward.joint.absent(effect);
            let usual = effect.reported(&absent.values, &self.analysis.forward.muscles);
            for (i, column) in description.amplitudes().zip(&columns[place].amplitudes) {
                let (plausible, sign) = self.plausible(effect, i);
                let size = plausible * self.analysis.forward.joint.scale(&description.parameters[i]);
                if !(size > 0.0 && size.is_finite()) {
                    continue;
                }
                amplitudes.push(Amplitude {
                    effect: description.id.to_owned(),
                    parameter: description.parameters[i].name.to_owned(),
                    unit: description.parameters[i].unit.to_owned(),
                    start: usual[i],
                    size,
                    is_ratio: effect.has_log_ratios(),
                    sign,
                });
                tested.push((*column, plausible));
            }
        }
        let (products, right) = model.about_prior_mean();
        let (information, score) = marginal((&products, &right), &tested, &model.sds(&set, sizes));
        ParticipantEvidence {
            schema: ParticipantEvidence::SCHEMA.to_owned(),
            participant: participant.to_owned(),
            amplitudes,
            information: (0..tested.len()).map(|i| information.row(i).iter().copied().collect()).collect(),
            score: score.as_slice().to_vec(),
            everything: sizes.everything,
            named: self.ids(&set).into_iter().map(str::to_owned).collect(),
        }
    }
}

/// Information and score of some columns, in units of their own, all others with their priors integrated out.
///
/// - `(products, right)`: ZᵀZ, Zᵀr₀
/// - `tested`: columns and the units in which they are wanted; `sd`: prior standard deviations of all columns
pub(super) fn marginal(
    (products, right): (&DMatrix<f64>, &DVector<f64>),
    tested: &[(usize, f64)],
    sd: &DVector<f64>,
) -> (DMatrix<f64>, DVector<f64>) {
    let is_tested = |j: &usize| tested.iter().any(|(column, _)| column == j);
    let others: Vec<usize> = (0..sd.len()).filter(|j| sd[*j] > 0.0 && !is_tested(j)).collect();
    let (n, t) = (others.len(), tested.len());
    let mut m = DMatrix::from_fn(n, n, |i, j| {
        sd[others[i]] * products[(others[i], others[j])] * sd[others[j]] + if i == j { 1.0 } else { 0.0 }
    });
    m.fill_upper_triangle_with_lower_triangle();
    let cross = DMatrix::from_fn(n, t + 1, |i, k| {
        let value = tested.get(k).map_or(right[others[i]], |(column, unit)| products[(others[i], *column)] * unit);
        sd[others[i]] * value
    });
    let mut information =
        DMatrix::from_fn(t, t, |i, k| tested[i].1 * products[(tested[i].0, tested[k].0)] * tested[k].1);
    let mut score = DVector::from_fn(t, |i, _| tested[i].1 * right[tested[i].0]);
    if let Some(factor) = cholesky(m) {
        let solved = factor.solve(&cross);
        let taken = cross.columns(0, t).tr_mul(&solved);
        information -= taken.columns(0, t);
        score -= taken.column(t);
    }
    (information, score)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same as a posterior with a prior on everything, the tested columns' prior taken away again.
    #[test]
    fn verif_others_are_integrated_out() {
        let z = DMatrix::from_fn(9, 4, |i, j| ((i * 3 + j * 7) as f64 * 0.37).sin());
        let r = DVector::from_fn(9, |i, _| (i as f64 * 0.71).cos());
        let sd = DVector::from_vec(vec![0.5, 2.0, 0.0, 0.7]);
        let (found, score) = marginal((&z.tr_mul(&z), &z.tr_mul(&r)), &[(1, 0.5)], &sd);
        // Marginal covariance of r given the tested column.
        let others = [0, 3].map(|j| z.column(j) * sd[j]);
        let v = DMatrix::identity(9, 9) + &others[0] * others[0].transpose() + &others[1] * others[1].transpose();
        let inverse = v.try_inverse().unwrap();
        let x = z.column(1) * 0.5;
        assert!((found[(0, 0)] - (x.transpose() * &inverse * &x)[0]).abs() < 1e-12);
        assert!((score[0] - (x.transpose() * &inverse * &r)[0]).abs() < 1e-12);
    }
}
