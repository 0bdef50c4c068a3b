//! EMG cross-talk.

use crate::effect::{Behaviour, Description, Effect, ExcitationScope, OsimForm, Stage, TrialContext, amplitude, shape};
use nalgebra::{DMatrix, DVector};

/// EMG cross-talk: `e_meas = (I + c X) e`, X the mean of the muscles on the same side, and a share w of that of the
/// other side.
pub struct EmgCrosstalk;

static DESCRIPTION: Description = Description {
    id: "emg_crosstalk",
    name: "EMG cross-talk",
    stage: Stage::Excitation,
    order: 20,
    behaviour: Behaviour { excitation: ExcitationScope::SampleOfAllMuscles, ..Behaviour::PLAIN },
    equation: "e_meas = (I + c X) e, X = (1 - w) mean of the other muscles on the same side + w mean of those on the \
        other side",
    parameters: &[
        amplitude(
            "cross_talk",
            "1",
            0.1,
            [0.0, 0.7],
            "32 to 50 % of the amplitude in wrist flexors, 11 to 25 % in finger flexors, during grip (Crosstalk \
             effect on surface electromyogram of the forearm flexors during a static grip task, 2010); up to 0.7 is \
             still taken for plausible",
        ),
        shape(
            "share_of_other_side",
            "1",
            0.1,
            0.15,
            [0.0, 0.6],
            "w; no source: electrodes lie nearer to their own side",
        ),
    ],
    signature: "follows the EMG of the neighbour",
    experiment: "contractions of single muscles",
    rivals: &["emg_gain_drift"],
    osim_form: OsimForm::Controls("unmixed controls"),
    unidentifiable: None,
};

impl Effect for EmgCrosstalk {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn excite(&self, values: &[f64], trial: &TrialContext, excitation: &mut [Vec<f64>]) {
        let [c, across] = *values else { return };
        if c == 0.0 {
            return;
        }
        let n = excitation.len();
        let same = |i: usize, j: usize| i != j && trial.directions[i] == trial.directions[j];
        let neighbours = |i: usize| (0..n).filter(|j| same(i, *j)).count().max(1) as f64;
        let opposite = |i: usize| (0..n).filter(|j| i != *j && !same(i, *j)).count().max(1) as f64;
        let mixing = DMatrix::from_fn(n, n, |i, j| {
            if i == j {
                1.0
            } else if same(i, j) {
                c * (1.0 - across) / neighbours(i)
            } else {
                c * across / opposite(i)
            }
        });
        let Some(unmixing) = mixing.try_inverse() else { return };
        let (mut recorded, mut pure) = (DVector::zeros(n), DVector::zeros(n));
        for k in 0..trial.time.len() {
            for i in 0..n {
                recorded[i] = excitation[i][k];
            }
            unmixing.mul_to(&recorded, &mut pure);
            for i in 0..n {
                excitation[i][k] = pure[i].max(0.0);
            }
        }
    }
}
