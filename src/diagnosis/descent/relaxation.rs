//! Shares of the steps of a fixed-point iteration that swings.

/// Least share of a step that is taken.
const LEAST_SHARE: f64 = 0.2;

/// A step that was asked for and the share of it that was taken.
///
/// # References
/// Irons & Tuck (1969), A version of the Aitken accelerator for computer iteration, doi:10.1002/nme.1620010306.
#[derive(Clone)]
pub(super) struct Relaxation {
    asked: Vec<f64>,
    share: f64,
}

impl Relaxation {
    /// The step after this one (after none: in full), shortened where it turns back.
    pub(super) fn next(last: Option<&Relaxation>, asked: Vec<f64>) -> Relaxation {
        let share = last.map_or(1.0, |last| last.share_of(&asked));
        Relaxation { asked, share }
    }

    /// Share that is taken.
    pub(super) fn share(&self) -> f64 {
        self.share
    }

    fn share_of(&self, asked: &[f64]) -> f64 {
        let (mut along, mut length) = (0.0, 0.0);
        for (before, now) in self.asked.iter().zip(asked) {
            along += before * (before - now);
            length += (before - now).powi(2);
        }
        if length > 0.0 { (self.share * along / length).clamp(LEAST_SHARE, 1.0) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_what_swings_comes_to_rest_and_what_does_not_is_left_alone() {
        let rest = |slope: f64| {
            let mut x = 1.0;
            let mut last = None;
            for _ in 0..6 {
                let step = Relaxation::next(last.as_ref(), vec![slope * x - x]);
                x += step.share() * step.asked[0];
                last = Some(step);
            }
            x
        };
        assert!(rest(-1.0).abs() < 1e-9);
        assert!(rest(-3.0).abs() < 1e-9);
        assert!((rest(0.5) - 0.5_f64.powi(6)).abs() < 1e-12);
    }
}
