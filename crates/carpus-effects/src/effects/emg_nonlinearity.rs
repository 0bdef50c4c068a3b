//! Nonlinear EMG.

use crate::effect::{Behaviour, Description, Effect, ExcitationScope, OsimForm, Stage, TrialContext, amplitude};

/// Nonlinear EMG: `(exp(A e) - 1)/(exp(A) - 1)`.
pub struct EmgNonlinearity;

static DESCRIPTION: Description = Description {
    id: "emg_nonlinearity",
    name: "Nonlinear EMG",
    stage: Stage::Excitation,
    order: 60,
    behaviour: Behaviour { excitation: ExcitationScope::Sample, ..Behaviour::PLAIN },
    equation: "(exp(A e) - 1)/(exp(A) - 1)",
    parameters: &[amplitude(
        "curvature",
        "1",
        0.5,
        [-3.0, 0.5],
        "A from -3 to 0: Buchanan et al. 2004 (neuromusculoskeletal modeling, PMC1357215); up to 0.5 is still taken \
         for plausible",
    )],
    signature: "curved against activation",
    experiment: "four or more levels of effort",
    rivals: &["tendon_compliance"],
    osim_form: OsimForm::Controls("transformed controls"),
    unidentifiable: None,
};

impl Effect for EmgNonlinearity {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn excite(&self, values: &[f64], _: &TrialContext, excitation: &mut [Vec<f64>]) {
        let [a] = *values else { return };
        if a == 0.0 {
            return;
        }
        let greatest = a.exp_m1();
        for e in excitation.iter_mut().flatten() {
            *e = (a * *e).exp_m1() / greatest;
        }
    }
}
